"""Other packages' retargeting, as `benchmarks.retarget` measures it."""

import logging
import sys
from collections.abc import Callable
from importlib import import_module
from importlib.metadata import version
from itertools import combinations
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np

from benchmarks.peers import with_masses
from hand_tracker.calibration.landmarks import LANDMARKS, WRIST
from hand_tracker.retargeting.hand_frame import DEX_AXES

NO_FILTER = 1.          # share of the new position in the low-pass filters
# As in mink's examples of hands: costs of the posture beside 1 for the tips, and damping.
POSTURE_COST, TIP_DAMPING, IK_DAMPING = 1e-2, 1e-3, 1e-3
FIRST_FRAME_STEPS = 100   # quadratic programmes from the open hand


class Setup(NamedTuple):
    """What the peers' users configure for a robot.

    Attributes
    ----------
    kind : str
        Of dexi-rs: DexPilot where its users have that, vector else.
    wrist : str
        Link from which vectors to the tips count.
    scale : float
        Of the person's vectors.
    """

    kind: str
    wrist: str
    scale: float


class Peer:
    """A peer that follows the person's vectors from the wrist to the tips, scaled.

    Parameters
    ----------
    robot : RobotHand
    setup : Setup
    """

    def __init__(self, robot, setup):
        self.robot, self.wrist, self.scale = robot, setup.wrist, setup.scale
        self.tips = [digit.tip_link for digit in robot.anatomy.digits.values()]
        self.rows = [LANDMARKS.index(f'{role}_tip') for role in robot.anatomy.digits]

    def targets(self, landmarks):
        """Return the tips from the wrist in the robot's base, shape (..., digits, 3) [m]."""
        return self.scale * (landmarks[..., self.rows, :] - landmarks[..., :1, :]) @ DEX_AXES

    def missed(self, landmarks, position):
        """Return the mean distance of the tips from their targets [m]."""
        frames = self.robot.model.frames(position)
        wrist, *tips = (self.robot.model.link_pose(link, frames)[1]
                        for link in (self.wrist, *self.tips))
        return np.linalg.norm(tips - wrist - self.targets(landmarks), axis=1).mean()

    def order_among(self, names):
        """Return where the robot's variables are among the peer's joints."""
        return [names.index(name) for name in self.robot.model.variables]


class VectorPeer(Peer):
    """A peer that is built anew to start, and retargets vectors between landmarks."""

    def build_by(self, solver_of):
        self.solver_of = solver_of
        self.start()
        self.order = self.order_among(list(self.solver.joint_names))

    def start(self):
        self.solver = self.solver_of()

    def call(self, vectors):
        return self.solver.retarget(vectors)


class Dexi(VectorPeer):
    """dexi-rs without its filter."""

    def __init__(self, robot, path, setup):
        import dexi_rs
        super().__init__(robot, setup)
        self.method = f'dexi-rs {setup.kind}'
        count = len(self.tips)
        pairs = [(0, i) for i in range(1, count + 1)]
        if setup.kind == 'DexPilot':
            pairs = [(j, i) for i, j in combinations(range(1, count + 1), 2)] + pairs
            links = {'wrist_link_name': self.wrist, 'finger_tip_link_names': self.tips}
        else:
            links = {'target_origin_link_names': [self.wrist] * count,
                     'target_task_link_names': self.tips,
                     'target_link_human_indices': [[WRIST] * count, self.rows]}
        self.pairs = np.array([WRIST, *self.rows])[np.array(pairs)].T
        self.build_by(dexi_rs.RetargetingConfig(
            setup.kind, path.name, urdf_dir=str(path.parent), scaling_factor=self.scale,
            low_pass_alpha=NO_FILTER, **links).build)

    def arguments(self, landmarks, rate):
        origins, ends = (landmarks @ DEX_AXES)[:, self.pairs].swapaxes(0, 1)
        return [(row,) for row in (ends - origins).reshape(len(landmarks), -1).tolist()]


class DexRetargeting(VectorPeer):
    """dex-retargeting without its filter.

    Parameters
    ----------
    robot : RobotHand
    path : Path
        Of the URDF.
    setup : Setup
    kind : str
        Its method's name.
    config : Path
    """

    def __init__(self, robot, path, setup, kind, config):
        import torch
        from dex_retargeting.retargeting_config import RetargetingConfig
        super().__init__(robot, setup)
        torch.set_num_threads(1)  # what more would do is not in the thread's time
        # It warns of every mesh that is not there, and uses none.
        logging.getLogger('dex_retargeting').setLevel(logging.ERROR)
        self.method = f'dex-retargeting {kind}'
        self.build_by(lambda: RetargetingConfig.load_from_file(
            config, {'urdf_path': str(path.resolve()), 'low_pass_alpha': NO_FILTER}).build())

    def arguments(self, landmarks, rate):
        origins, ends = (landmarks @ DEX_AXES)[
            :, self.solver.optimizer.target_link_human_indices].swapaxes(0, 1)
        return [(row,) for row in ends - origins]


class Mink(Peer):
    """mink: one quadratic programme a frame, by DAQP, as its examples do a control cycle."""

    def __init__(self, robot, path, setup):
        import mink
        import mujoco
        super().__init__(robot, setup)
        self.method, self.mink = 'mink', mink
        urdf = with_masses(ElementTree.parse(path).getroot())
        model = mujoco.MjModel.from_xml_string(ElementTree.tostring(urdf, encoding='unicode'))
        self.configuration = mink.Configuration(model)
        names = [model.joint(i).name for i in range(model.njnt)]
        self.order = self.order_among(names)
        joints, position = robot.model.joints, robot.model.open_position()
        self.axes = robot.model.link_pose(self.wrist, robot.model.frames(position))[0]
        self.open = np.empty(model.nq)
        self.open[[names.index(name) for name in robot.model.joint_names]] = (
            joints.multiplier * position[joints.variable] + joints.offset)
        # Targets keep the turns of the open hand's tips, as in mink's examples: turns that are far
        # off bend the error of the place, although they cost nothing.
        self.configuration.update(self.open)
        self.turns = [self.configuration.get_transform(tip, 'body', self.wrist, 'body').rotation()
                      for tip in self.tips]
        posture = mink.PostureTask(model, POSTURE_COST)
        posture.set_target(self.open)
        self.tip_tasks = [mink.RelativeFrameTask(tip, 'body', self.wrist, 'body', 1., 0.,
                                                 lm_damping=TIP_DAMPING) for tip in self.tips]
        self.tasks = [posture, *self.tip_tasks]
        self.limits = [mink.ConfigurationLimit(model)]
        # MuJoCo takes joints that mimic others as equalities.
        self.equalities = [mink.EqualityConstraintTask(model, 1.)] if model.neq else None

    def start(self):
        self.configuration.update(self.open)
        self.steps = FIRST_FRAME_STEPS

    def arguments(self, landmarks, rate):
        pose = self.mink.SE3.from_rotation_and_translation
        return [([pose(turn, place) for turn, place in zip(self.turns, places)], 1. / rate)
                for places in self.targets(landmarks) @ self.axes]

    def call(self, poses, dt):
        for task, pose in zip(self.tip_tasks, poses):
            task.set_target(pose)
        for _ in range(self.steps):
            change = self.mink.solve_ik(
                self.configuration, self.tasks, dt, 'daqp', IK_DAMPING, limits=self.limits,
                constraints=self.equalities)
            self.configuration.integrate_inplace(change, dt)
        self.steps = 1
        return self.configuration.q.copy()


def dex_retargeting_solvers(name, robot, path, setup):
    """Return the solvers of the files that dex-retargeting brings for a right hand."""
    from dex_retargeting import constants
    return [DexRetargeting(robot, path, setup, kind, constants.get_default_config_path(
        constants.RobotName[name], constants.RetargetingType[kind.lower()],
        constants.HandType.right)) for kind in ('DexPilot', 'vector')]


class Package(NamedTuple):
    """A peer's package.

    Attributes
    ----------
    module : str
        That imports all it needs.
    solvers : callable
        Returns its solvers of a robot's name, hand, path and setup.
    """

    module: str
    solvers: Callable


RETARGETING_PEERS = {
    'dexi-rs': Package('dexi_rs', lambda name, robot, path, setup: [Dexi(robot, path, setup)]),
    'dex-retargeting': Package('dex_retargeting.optimizer', dex_retargeting_solvers),
    'mink': Package('mink', lambda name, robot, path, setup: [Mink(robot, path, setup)]),
}


def installed(names):
    """Return the versions of peers, by name; those that cannot be imported are said, and left out.

    Parameters
    ----------
    names : iterable of str
        In `RETARGETING_PEERS`.
    """
    found = {}
    for name in names:
        try:
            import_module(RETARGETING_PEERS[name].module)
            found[name] = version(name)
        except ImportError as error:
            print(f'{name}: left out ({error}); pip install -r requirements/peers.in',
                  file=sys.stderr)
    return found
