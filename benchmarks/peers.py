"""Compare other inverse kinematics libraries on the tracker's hand and markers.

    python -m benchmarks.peers [--frames 600] [--noise 0] [--peers placo ...] [--json OUT]

The demo motion at 120 Hz with all markers visible. Every peer has the same URDF with a frame at
each marker, starts from its last solution, enforces the joint limits, and is timed from markers to
angles. The wrist is solved by the peer, or given: then the markers are transformed into the true
wrist's frame before, which is not timed. `mean_mm` is the distance of the markers from their
places on the solved pose, `joints_mm` the error of all joints and tips, `degrees` that of the
angles. No marker observes the distal joints of the fingers and two joints of the thumb: there the
tracker has a model of the hand, the peers have none.

Install the peers with `pip install -r requirements/peers.in`; missing ones are left out.
"""

import argparse
import os
import sys
import time
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from tempfile import TemporaryDirectory
from xml.etree import ElementTree

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
# Threads would only wait for each other: the matrices are small.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import numpy as np

from benchmarks.common import RATE, add_json_option, environment, write_rows
from hand_tracker.calibration.landmarks import landmark_positions
from hand_tracker.core.inverse_kinematics.digit import digit_chains, solve_digits
from hand_tracker.core.model.hand import JOINTS, LINKS, ROOT, Hand
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.marker_layout import (
    MARKERS,
    MarkerLayout,
    marker_positions,
)
from hand_tracker.core.model.palm_triangle import fit_wrist
from hand_tracker.core.numerics.jit import jit
from hand_tracker.core.numerics.packs import packed
from hand_tracker.core.numerics.vectors import components, frame, subtract, vector
from hand_tracker.core.tracker import PALM_COUNT, HandTracker
from hand_tracker.files.urdf_file import urdf
from hand_tracker.simulation.motions import motion_named

UNTIMED = 20         # frames that are not counted
BUDGET = 20.         # [s] for each peer
MOST_ROUNDS = 30     # greatest number of iterations of a peer
STILL = 1e-4         # [rad] and [m] change of an iteration that ends them
ANGLE_DAMPING = 1e-9       # regularises angles that no marker observes


class Scene:
    """Hand model, motion and markers for all peers.

    Parameters
    ----------
    count : int
        Frames.
    noise : float
        Standard deviation per axis [m].

    Attributes
    ----------
    movable : list of int
        Indices in `JOINTS` of joints that are not locked.
    urdf : str
        With a link `marker_NAME` for each marker and without geometry.
    angles, rotation, position : ndarray, shape (n, 25), (n, 3, 3) and (n, 3)
        The truth [rad, m].
    markers, local : ndarray, shape (n, 8, 3)
        In the world, and in the frame of the wrist [m].
    """

    def __init__(self, count, noise):
        self.hand = Hand.scaled()
        self.mounting = MarkerLayout().mounting(self.hand)
        self.table = joint_table(self.hand)
        motion = motion_named('demo', self.hand)
        self.angles, self.rotation, self.position = motion.sample(
            np.arange(count) / RATE % motion.duration)
        self.markers = self.places(self.angles, self.rotation, self.position)
        self.markers += np.random.default_rng(0).normal(scale=noise, size=self.markers.shape)
        self.local = np.einsum('nij,nmi->nmj', self.rotation,
                               self.markers - self.position[:, None])
        lower, upper = self.hand.limits.T
        self.movable = np.flatnonzero(upper > lower).tolist()
        self.names = [JOINTS[i] for i in self.movable]
        self.lower, self.upper = lower[self.movable], upper[self.movable]
        self.urdf = self._urdf()

    def places(self, angles, rotation, position):
        """Return the marker positions of poses, shape (n, 8, 3) [m]."""
        return marker_positions(self.mounting, forward(self.table, angles, rotation, position),
                                rotation, position)

    def joints(self, angles, rotation, position):
        """Return the positions of the 21 joints and tips of poses, shape (n, 21, 3) [m]."""
        pose = forward(self.table, angles, rotation, position)
        return landmark_positions(self.hand, pose, position)

    def whole(self, movable):
        """Return all 25 angles from those of the movable joints [rad]."""
        angles = np.zeros(len(JOINTS))
        angles[self.movable] = movable
        return angles

    def _urdf(self):
        robot = ElementTree.fromstring(urdf(self.hand).partition('?>')[2])
        for link in robot.findall('link'):
            for part in [*link.findall('visual'), *link.findall('collision')]:
                link.remove(part)
        for joint in robot.findall('joint'):
            if joint.get('name') in JOINTS and joint.get('name') not in self.names:
                joint.set('type', 'fixed')
        for marker, link, place in zip(MARKERS, self.mounting.link, self.mounting.position):
            ElementTree.SubElement(robot, 'link', name=f'marker_{marker}')
            joint = ElementTree.SubElement(robot, 'joint', name=f'to_{marker}', type='fixed')
            ElementTree.SubElement(joint, 'parent', link=ROOT if link < 0 else LINKS[link])
            ElementTree.SubElement(joint, 'child', link=f'marker_{marker}')
            ElementTree.SubElement(joint, 'origin', xyz=' '.join(map(repr, place.tolist())))
        return ElementTree.tostring(robot, encoding='unicode')


@jit
def solve_fingers(chains, roots, markers, angles):
    """Solve the digits from markers in the wrist's frame."""
    solve_digits(chains[0], roots, markers[3:], angles, 1. / RATE, False, 0., 0)


@jit
def solve_hand(chains, template, roots, markers, angles, rotation, position):
    """Solve palm and digits, with the last angles as the only state."""
    digits = np.empty((5, 3))
    fit_wrist(markers, template, rotation, position)
    axes, origin = frame(rotation), vector(position)
    for i in range(5):
        local = components(axes, subtract(vector(markers[3 + i]), origin))
        for k in range(3):
            digits[i, k] = local[k]
    solve_digits(chains[0], roots, digits, angles, 1. / RATE, False, 0., 0)


class Ours:
    """The tracker's inverse kinematics alone: rigid palm, then plane and flexion of each digit."""

    def __init__(self, scene, given):
        digits = digit_chains(scene.hand, scene.mounting)
        self._given, self._roots = given, digits.root.copy()
        self._chains, _ = packed(digits)
        self._template = scene.mounting.position[:PALM_COUNT].copy()
        self.pose = np.zeros(len(JOINTS)), np.eye(3), np.zeros(3)

    def solve(self, markers):
        if self._given:
            solve_fingers(self._chains, self._roots, markers, self.pose[0])
        else:
            solve_hand(self._chains, self._template, self._roots, markers, *self.pose)


class Core:
    """The whole tracker: `HandTracker.update`."""

    def __init__(self, scene, given):
        self._tracker = HandTracker(scene.hand)

    def solve(self, markers):
        self._state = self._tracker.update(markers)

    @property
    def pose(self):
        return self._state.angles, self._state.wrist_rotation, self._state.wrist_position


class Programmes:
    """Peer that iterates quadratic programmes until the change is small.

    `aim` sets the markers as targets, `step` solves one programme and returns the change.
    """

    def __init__(self, rounds):
        self._rounds = rounds

    def solve(self, markers):
        self.aim(markers)
        for _ in range(self._rounds):
            if np.abs(self.step()).max() < STILL:
                break


class Placo(Programmes):
    """Position tasks, limits of joints, a little regularisation."""

    def __init__(self, scene, given, rounds):
        import placo
        super().__init__(rounds)
        self._scene = scene
        self._robot = placo.RobotWrapper('', placo.Flags.ignore_collisions, scene.urdf)
        self._solver = placo.KinematicsSolver(self._robot)
        self._solver.mask_fbase(given)
        self._solver.add_regularization_task(ANGLE_DAMPING)
        if not given:
            start = np.eye(4)
            start[:3, :3], start[:3, 3] = scene.rotation[0], scene.position[0]
            self._robot.set_T_world_fbase(start)
        self._robot.update_kinematics()
        self._first = PALM_COUNT if given else 0
        self._tasks = [self._solver.add_position_task(f'marker_{marker}', np.zeros(3))
                       for marker in MARKERS[self._first:]]

    def aim(self, markers):
        for task, marker in zip(self._tasks, markers[self._first:]):
            task.target_world = marker

    def step(self):
        change = self._solver.solve(True)
        self._robot.update_kinematics()
        return change

    @property
    def pose(self):
        wrist = self._robot.get_T_world_fbase()
        return (self._scene.whole([self._robot.get_joint(name) for name in self._scene.names]),
                wrist[:3, :3], wrist[:3, 3])


class Pink(Programmes):
    """Frame tasks on positions, limits of joints, DAQP."""

    def __init__(self, scene, given, rounds):
        import pink
        import pinocchio
        super().__init__(rounds)
        self._scene, self._pink, self._pinocchio = scene, pink, pinocchio
        floating = () if given else (pinocchio.JointModelFreeFlyer(),)
        model = pinocchio.buildModelFromXML(scene.urdf, *floating)
        start = pinocchio.neutral(model)
        if not given:
            start[:7] = pinocchio.SE3ToXYZQUAT(
                pinocchio.SE3(scene.rotation[0], scene.position[0]))
        self._configuration = pink.Configuration(model, model.createData(), start)
        self._at = [model.joints[model.getJointId(name)].idx_q for name in scene.names]
        self._limits = [pink.limits.ConfigurationLimit(model, config_limit_gain=1.)]
        self._first = PALM_COUNT if given else 0
        self._tasks = [pink.tasks.FrameTask(f'marker_{marker}', 1., 0.)
                       for marker in MARKERS[self._first:]]

    def aim(self, markers):
        for task, marker in zip(self._tasks, markers[self._first:]):
            task.set_target(self._pinocchio.SE3(np.eye(3), marker))

    def step(self):
        change = self._pink.solve_ik(
            self._configuration, self._tasks, 1., solver='daqp', damping=ANGLE_DAMPING,
            limits=self._limits, safety_break=False)
        self._configuration.integrate_inplace(change, 1.)
        return change

    @property
    def pose(self):
        wrist = self._configuration.get_transform_frame_to_world(ROOT)
        return (self._scene.whole(self._configuration.q[self._at]), wrist.rotation,
                wrist.translation)


def with_masses(robot):
    """Return a URDF's element with the masses and unfused bodies that MuJoCo needs, no geometry."""
    compiler = ElementTree.SubElement(robot, 'mujoco')
    ElementTree.SubElement(compiler, 'compiler', fusestatic='false')
    for link in robot.findall('link'):
        inertial = ElementTree.Element('inertial')
        ElementTree.SubElement(inertial, 'mass', value='1')
        ElementTree.SubElement(inertial, 'inertia', ixx='1', iyy='1', izz='1',
                               ixy='0', ixz='0', iyz='0')
        link[:] = [inertial]
    return robot


class Mink(Programmes):
    """Frame tasks on positions, limits of joints, DAQP, on MuJoCo."""

    def __init__(self, scene, given, rounds):
        import mink
        import mujoco
        super().__init__(rounds)
        self._scene, self._mink = scene, mink
        model = mujoco.MjModel.from_xml_string(self._model(scene.urdf, given))
        self._configuration = mink.Configuration(model)
        if not given:
            quaternion = np.zeros(4)
            mujoco.mju_mat2Quat(quaternion, scene.rotation[0].ravel())
            start = model.qpos0.copy()
            start[:7] = (*scene.position[0], *quaternion)
            self._configuration.update(start)
        self._at = [model.joint(name).qposadr[0] for name in scene.names]
        self._limits = [mink.ConfigurationLimit(model, gain=1.)]
        self._first = PALM_COUNT if given else 0
        self._tasks = [mink.FrameTask(f'marker_{marker}', 'body', 1., 0.)
                       for marker in MARKERS[self._first:]]

    @staticmethod
    def _model(text, given):
        """Return the URDF with what MuJoCo needs, and a free joint unless the wrist is given."""
        robot = with_masses(ElementTree.fromstring(text))
        if not given:
            ElementTree.SubElement(robot, 'link', name='world')
            joint = ElementTree.SubElement(robot, 'joint', name='free', type='floating')
            ElementTree.SubElement(joint, 'parent', link='world')
            ElementTree.SubElement(joint, 'child', link=ROOT)
        return ElementTree.tostring(robot, encoding='unicode')

    def aim(self, markers):
        for task, marker in zip(self._tasks, markers[self._first:]):
            task.set_target(self._mink.SE3.from_translation(marker))

    def step(self):
        change = self._mink.solve_ik(
            self._configuration, self._tasks, 1., solver='daqp', damping=ANGLE_DAMPING,
            limits=self._limits)
        self._configuration.integrate_inplace(change, 1.)
        return change

    @property
    def pose(self):
        wrist = self._configuration.get_transform_frame_to_world(ROOT, 'body')
        return (self._scene.whole(self._configuration.q[self._at]),
                wrist.rotation().as_matrix(), wrist.translation())


class Scipy:
    """`least_squares` with bounds and the geometric Jacobian, by the tracker's own kinematics."""

    def __init__(self, scene, given):
        from scipy.optimize import least_squares
        from scipy.spatial.transform import Rotation
        self._least_squares, self._turn, self._scene = least_squares, Rotation.from_rotvec, scene
        self._first, count = PALM_COUNT if given else 0, len(scene.names)
        self._free = 0 if given else 6
        self._bounds = (np.r_[scene.lower, np.full(self._free, -np.inf)],
                        np.r_[scene.upper, np.full(self._free, np.inf)])
        self._count, self._found = count, np.zeros(count)
        # Which joints move which marker, shape (8, number of joints, 1)
        self._moves = np.zeros((len(MARKERS), len(JOINTS), 1))
        for marker, link in enumerate(scene.mounting.link):
            while link >= 0:
                self._moves[marker, link] = 1.
                link = scene.table.parent[link]
        self.pose = (np.zeros(len(JOINTS)), np.eye(3), np.zeros(3)) if given else (
            np.zeros(len(JOINTS)), scene.rotation[0], scene.position[0])

    def _posed(self, x):
        _, rotation, position = self.pose
        if self._free:
            rotation = self._turn(x[self._count:self._count + 3]).as_matrix() @ rotation
            position = position + x[self._count + 3:]
        return self._scene.whole(x[:self._count]), rotation, position

    def solve(self, markers):
        def miss(x):
            return (self._scene.places(*self._posed(x)) - markers)[self._first:].ravel()

        def slopes(x):
            angles, rotation, position = self._posed(x)
            pose = forward(self._scene.table, angles, rotation, position)
            axes = np.einsum('nij,nj->ni', pose.rotation, self._scene.table.axis)
            places = self._scene.places(angles, rotation, position)[:, None]
            columns = self._moves * np.cross(axes, places - pose.position)
            columns = columns[:, self._scene.movable]
            if self._free:
                turns = np.cross(np.eye(3), places - position)
                shifts = np.broadcast_to(np.eye(3), turns.shape)
                columns = np.concatenate((columns, turns, shifts), axis=1)
            return columns[self._first:].swapaxes(1, 2).reshape(-1, len(x))

        # The initial guess must be strictly within the bounds.
        start = np.r_[np.clip(self._found, self._scene.lower + STILL, self._scene.upper - STILL),
                      np.zeros(self._free)]
        x = self._least_squares(miss, start, slopes, self._bounds).x
        self.pose, self._found = self._posed(x), x[:self._count]


class DexRetargeting:
    """`PositionOptimizer`: SLSQP on a Huber loss; `exact` without the pull to the last frame."""

    def __init__(self, scene, given, exact):
        from dex_retargeting.optimizer import PositionOptimizer
        from dex_retargeting.robot_wrapper import RobotWrapper
        self._scene = scene
        with TemporaryDirectory() as folder:
            path = Path(folder, 'hand.urdf')
            path.write_text(scene.urdf, encoding='utf-8')
            robot = RobotWrapper(str(path))
        links = [f'marker_{marker}' for marker in MARKERS[PALM_COUNT:]]
        self._optimizer = PositionOptimizer(
            robot, scene.names, links, np.arange(len(links)),
            **{'norm_delta': 0.} if exact else {})
        self._optimizer.set_joint_limit(np.stack((scene.lower, scene.upper), axis=1))
        if exact:
            self._optimizer.opt.set_ftol_abs(1e-12)
        self._found = np.zeros(len(scene.names))

    def solve(self, markers):
        # Its rounded solution may exceed a limit, which it refuses as an initial guess.
        start = np.clip(self._found, self._scene.lower, self._scene.upper)
        self._found = self._optimizer.retarget(
            markers[PALM_COUNT:].astype(np.float32), np.empty(0), start)

    @property
    def pose(self):
        return self._scene.whole(self._found), np.eye(3), np.zeros(3)


class IKPy:
    """Separate chains of the digits."""

    def __init__(self, scene, given):
        from ikpy.chain import Chain
        parents = {joint.find('child').get('link'): joint for joint in
                   ElementTree.fromstring(scene.urdf).findall('joint')}
        self._chains, self._angles = [], np.zeros(len(JOINTS))
        with TemporaryDirectory() as folder:
            path = Path(folder, 'hand.urdf')
            path.write_text(scene.urdf, encoding='utf-8')
            for marker in MARKERS[PALM_COUNT:]:
                way = [f'marker_{marker}']
                while way[0] != ROOT:
                    joint = parents[way[0]]
                    way[:0] = joint.find('parent').get('link'), joint.get('name')
                names = ['', *way[1::2]]
                self._chains.append((Chain.from_urdf_file(
                    str(path), base_elements=way,
                    active_links_mask=[name in scene.names for name in names]),
                    [(i, JOINTS.index(name)) for i, name in enumerate(names)
                     if name in scene.names], np.zeros(len(names))))

    def solve(self, markers):
        for (chain, active, found), marker in zip(self._chains, markers[PALM_COUNT:]):
            found[:] = chain.inverse_kinematics(marker, initial_position=found)
            for i, joint in active:
                self._angles[joint] = found[i]

    @property
    def pose(self):
        return self._angles, np.eye(3), np.zeros(3)


ONE_ROUND, ALL_ROUNDS = {'rounds': 1}, {'rounds': MOST_ROUNDS}
WRIST_GIVEN = (True, False)  # whether the wrist is given
# Name, class, package, methods with their arguments, whether the wrist is given
PEERS = (
    ('hand_tracker', Ours, None, {'inverse kinematics alone': {}}, WRIST_GIVEN),
    ('hand_tracker', Core, None, {'the whole core': {}}, (False,)),
    ('placo', Placo, 'placo', {'one QP': ONE_ROUND, 'converged': ALL_ROUNDS}, WRIST_GIVEN),
    ('mink', Mink, 'mink', {'one QP': ONE_ROUND, 'converged': ALL_ROUNDS}, WRIST_GIVEN),
    ('pink', Pink, 'pin-pink', {'one QP': ONE_ROUND, 'converged': ALL_ROUNDS}, WRIST_GIVEN),
    ('scipy', Scipy, 'scipy', {'least_squares, bounded': {}}, WRIST_GIVEN),
    ('dex-retargeting', DexRetargeting, 'dex-retargeting',
     {'position optimiser': {'exact': False}, 'the same, exact': {'exact': True}}, (True,)),
    ('ikpy', IKPy, 'ikpy', {'a chain for each digit': {}}, (True,)),
)


def measure(name, kind, method, arguments, given, scene):
    """Return the row of one peer with one method."""
    peer = kind(scene, given, **arguments)
    markers = scene.local if given else scene.markers
    times, poses = [], []
    peer.solve(markers[0])  # kernels may have to be compiled
    end = time.monotonic() + BUDGET
    for row in markers:
        start = time.perf_counter()
        peer.solve(row)
        times.append(time.perf_counter() - start)
        poses.append([np.array(part) for part in peer.pose])
        if time.monotonic() > end and len(times) > UNTIMED:
            break
    median, p99 = np.percentile(times[UNTIMED:], (50, 99)) * 1e3
    counted = slice(UNTIMED, len(times))
    found = [np.array(part[UNTIMED:]) for part in zip(*poses)]
    # With a given wrist the peer's wrist is the true one.
    truth = scene.angles[counted], *(found[1:] if given else (
        scene.rotation[counted], scene.position[counted]))
    miss = np.linalg.norm(scene.places(*found) - markers[counted], axis=-1)
    off = np.linalg.norm(scene.joints(*found) - scene.joints(*truth), axis=-1)
    turn = np.abs(found[0] - truth[0])[:, scene.movable]
    return {'peer': name, 'method': method, 'wrist': 'given' if given else 'solved',
            'median_ms': round(float(median), 4), 'p99_ms': round(float(p99), 4),
            'mean_mm': round(1e3 * float(miss[:, PALM_COUNT if given else 0:].mean()), 4),
            'joints_mm': round(1e3 * float(off.mean()), 4),
            'degrees': round(float(np.degrees(turn.mean())), 4), 'frames': len(times) - UNTIMED}


def main():
    """Measure and print."""
    names = list(dict.fromkeys(name for name, *_ in PEERS))
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--frames', type=int, default=600, help='at most, of each')
    parser.add_argument('--noise', type=float, default=0., help='of the markers [mm]')
    parser.add_argument('--peers', nargs='+', choices=names, default=names)
    add_json_option(parser)
    options = parser.parse_args()

    scene = Scene(options.frames + UNTIMED, 1e-3 * options.noise)
    chosen = [row for row in PEERS if row[0] in options.peers]
    print(environment(**_versions(row[2] for row in chosen)))
    print(f"{'peer':17}{'method':26}{'wrist':8}{'median ms':>10}{'p99 ms':>9}{'mean mm':>9}"
          f"{'joints mm':>11}{'degrees':>9}{'frames':>8}")
    rows = []
    for name, kind, package, methods, wrists in chosen:
        for given in wrists:
            for method, arguments in methods.items():
                try:
                    rows.append(measure(name, kind, method, arguments, given, scene))
                except ImportError as error:
                    print(f'{name}: left out ({error}); pip install {package}')
                    break
                print('{peer:17}{method:26}{wrist:8}{median_ms:10.4f}{p99_ms:9.4f}{mean_mm:9.4f}'
                      '{joints_mm:11.4f}{degrees:9.4f}{frames:8}'.format(**rows[-1]), flush=True)
            else:
                continue
            break
    print('pyroki: left out (not on PyPI)')
    write_rows(options.json, rows)
    return 0


def _versions(packages):
    found = {}
    for package in packages:
        try:
            found[package] = version(package)
        except (PackageNotFoundError, ValueError, TypeError):
            pass  # reported when it is imported; the tracker's own is in the environment
    return found


if __name__ == '__main__':
    sys.exit(main())
