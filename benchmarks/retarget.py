"""Compare retargeting to robot hands with dexi-rs, dex-retargeting and mink, in the same run.

    python -m benchmarks.retarget CAPTURE.npz ... [--urdfs FOLDER] [--robots NAME ...] [--json OUT]

Input are captures of hands (see docs/evaluate.md), and simulated pinches, as captured hands hardly
ever bring the tips within 5 mm: each finger meets the thumb at 2 mm and leaves it again. All
methods get the same landmarks in the palm's frame, have no filter, begin each recording anew, go
on from their last solution, and are called from Python; what is timed is the thread's CPU time of
the one call. The peers have one scale for each robot. dexi-rs is set as the configurations that
its users have: DexPilot where there is one, vector else. dex-retargeting has its own files of
both kinds. mink has a task for the place of each tip from the wrist and one for the open hand's
posture, with the costs of its examples of hands, the joints' limits and those that mimic others,
and solves one quadratic programme a frame by DAQP. The last two robots are without peers.

`tip_error_mm` is the mean distance of the robot's tips from the method's own targets.
`pinch_gap_mm` is the mean distance, without sign, of the surfaces of the tip spheres while the
person's tips are within 5 mm, `pinch_share` the share of those frames with 2 mm at most, and
`pinch_frames` their number without those of fingers that the robot's thumb cannot touch in any
position, `out_of_reach_frames`. `tip_frames_mm` is the mean distance of the tips' frames then,
which is what DexPilot brings to zero. `max_step_rad` is the largest change of a joint in a frame,
`lag_ms` the delay of the joint that moves most as an index finger swings by 4 degrees at 10 Hz,
sampled at 120 Hz.
"""

import argparse
import os
import sys
import time
from pathlib import Path

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
# Threads would only wait for each other: the matrices are small.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import numpy as np
from scipy.optimize import least_squares, minimize

from benchmarks.common import add_json_option, environment, write_rows
from benchmarks.retarget_peers import RETARGETING_PEERS, Setup, installed
from hand_tracker.calibration.fit import fit_hand
from hand_tracker.calibration.landmarks import LANDMARKS, landmark_positions
from hand_tracker.calibration.palm_frame import palm_coordinates
from hand_tracker.core.errors import HandTrackerError
from hand_tracker.core.model.hand import FINGERS, JOINTS, Hand, preset_limits
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.evaluation.captures import load_capture
from hand_tracker.package_data import share_directory
from hand_tracker.retargeting.retargeter import Retargeter
from hand_tracker.retargeting.robot_hand import robot_hand
from hand_tracker.retargeting.robot_urdf import load_urdf_tree

PLAIN_FOLDER = share_directory() / 'config' / 'robots'
TOUCH = .005          # [m] of human tips that count as pinching
TOUCHED = .002        # [m] of surfaces that count as touching
MEETING = .002        # [m] of the simulated tips
PINCH_RATE = 120.     # [Hz]
PINCH_TIME = .6       # [s] to close, to hold and to open
REACH_STARTS = 6      # random positions from which a touch is searched for
SWING_HZ, SWING_DEG, SWING_RATE, SWING_TIME = 10., 4., 120., 3.
# File, and the peers' setup.
ROBOTS = {
    'allegro': ('allegro_hand_right', Setup('DexPilot', 'wrist', 1.6)),
    'leap': ('leap_hand_right', Setup('DexPilot', 'base', 1.6)),
    'shadow': ('shadow_hand_right', Setup('DexPilot', 'palm', 1.2)),
    'ability': ('ability_hand_right', Setup('vector', 'base_link', 1.)),
    'inspire': ('inspire_hand_right', Setup('vector', 'base', 1.15)),
    'schunk_svh': ('schunk_svh_hand_right', None),
    'plain': ('plain_hand_right', None),
}


class Recording:
    """Landmarks of a right hand in its palm's frame, and the hand fitted to them."""

    def __init__(self, name, landmarks, rate, hand):
        self.name, self.landmarks, self.rate, self.hand = name, landmarks, rate, hand


def captured(path):
    """Return the recording of a capture, mirrored to a right hand; frames with gaps left out."""
    capture = load_capture(path).right()
    joints = capture.joints[np.isfinite(capture.joints).all(axis=(1, 2))]
    return Recording(capture.name, palm_coordinates(joints), capture.rate,
                     fit_hand(joints, 'right', preset_limits('wide')))


def pinches():
    """Return a simulated hand whose thumb meets each finger in turn."""
    hand = Hand.scaled(limits=preset_limits('wide'))
    table, rest = joint_table(hand), hand.relaxed()
    steps = np.arange(0., 1., 1. / (PINCH_TIME * PINCH_RATE))
    ease = steps**3 * (10. - 15. * steps + 6. * steps**2)
    shares = np.concatenate((ease, np.ones(len(steps)), ease[::-1]))
    frames = []
    for finger in FINGERS:
        closed = pinching_angles(hand, table, finger)
        frames += [rest + share * (closed - rest) for share in shares]
    landmarks = landmark_positions(hand, forward(table, np.array(frames)),
                                   np.zeros((len(frames), 3)))
    return Recording('pinches (simulated)', landmarks, PINCH_RATE, hand)


def pinching_angles(hand, table, finger):
    """Return the angles nearest the relaxed hand whose thumb and finger tip are `MEETING` apart."""
    rest, tips = hand.relaxed(), [LANDMARKS.index(f'{name}_tip') for name in ('thumb', finger)]
    moving = [i for i, joint in enumerate(JOINTS) if joint.startswith((finger, 'thumb'))
              and hand.limits[i, 1] > hand.limits[i, 0]]

    def angles_of(x):
        angles = rest.copy()
        angles[moving] = x
        return angles

    def residuals(x):
        thumb, other = landmark_positions(hand, forward(table, angles_of(x)))[tips]
        return [*((thumb - other - MEETING * np.array((1., 0., 0.))) * 1e3),
                *(.05 * (x - rest[moving]))]

    lower, upper = hand.limits[moving].T
    found = least_squares(residuals, np.clip(rest[moving], lower, upper), bounds=(lower, upper))
    return angles_of(found.x)


def swing(hand):
    """Return landmarks of an index finger that swings."""
    table = joint_table(hand)
    angles = np.tile(hand.relaxed(), (int(SWING_TIME * SWING_RATE), 1))
    angles[:, JOINTS.index('index_mcp_flexion')] += np.radians(SWING_DEG) * np.sin(
        2. * np.pi * SWING_HZ * np.arange(len(angles)) / SWING_RATE)
    return landmark_positions(hand, forward(table, angles), np.zeros((len(angles), 3)))


class Ours:
    """This package."""

    def __init__(self, robot, hand):
        self.solver = Retargeter(robot, hand)
        self.method, self.order = 'hand_tracker', np.arange(len(self.solver.names))

    def start(self):
        self.solver.reset()

    def arguments(self, landmarks, rate):
        return [(frame, 1. / rate) for frame in np.ascontiguousarray(landmarks)]

    def call(self, frame, dt):
        return self.solver.update(frame, dt)

    def missed(self, landmarks, position):
        """Return the mean distance of the tips from the targets of the last call [m]."""
        tips = self.solver.robot.tip_positions(position)
        return np.linalg.norm(tips - self.solver.solution.target[:len(tips)], axis=1).mean()


def run(solver, recording, robot, within_reach):
    """Return the row of a method on a recording; `within_reach` is from `touchable`."""
    solver.start()
    arguments = solver.arguments(recording.landmarks, recording.rate)
    times, positions, misses = [], [], []
    for landmarks, given in zip(recording.landmarks, arguments):
        start = time.thread_time_ns()
        position = solver.call(*given)
        times.append(time.thread_time_ns() - start)
        positions.append(np.asarray(position)[solver.order])
        misses.append(solver.missed(landmarks, positions[-1]))
    positions = np.array(positions)
    row = {'recording': recording.name, 'rate_hz': recording.rate,
           'median_us': np.median(times[1:]) / 1e3, 'p99_us': np.percentile(times[1:], 99) / 1e3,
           'tip_error_mm': 1e3 * np.mean(misses),
           'max_step_rad': np.abs(np.diff(positions, axis=0)).max()}
    return {**row, **pinch_columns(recording, robot, positions, within_reach)}


def pinch_columns(recording, robot, positions, within_reach):
    """Return how near the robot's tips are while the person's touch."""
    roles = list(robot.anatomy.digits)
    rows = [LANDMARKS.index(f'{role}_tip') for role in roles]
    gaps, frames, out_of_reach = [], [], 0
    for landmarks, position in zip(recording.landmarks, positions):
        apart = np.linalg.norm(landmarks[rows[1:]] - landmarks[rows[0]], axis=1)
        for k in np.flatnonzero(apart < TOUCH) + 1:
            if k not in within_reach:
                out_of_reach += 1
                continue
            gaps.append(abs(surface_gap(robot, position, k)))
            frames.append(frame_distance(robot, position, roles[0], roles[k]))
    none = not gaps
    return {'pinch_gap_mm': None if none else 1e3 * np.mean(gaps),
            'pinch_share': None if none else np.mean(np.array(gaps) <= TOUCHED),
            'pinch_frames': len(gaps), 'out_of_reach_frames': out_of_reach,
            'tip_frames_mm': None if none else 1e3 * np.mean(frames)}


def surface_gap(robot, position, k):
    """Return the distance of the surfaces of the thumb's and another digit's sphere [m]."""
    tips, radii = robot.tip_positions(position), [one.radius for one in robot.spheres.values()]
    return np.linalg.norm(tips[k] - tips[0]) - radii[0] - radii[k]


def touchable(robot):
    """Return the digits that the thumb can touch in some position, as rows of the digits."""
    lower, upper = robot.model.lower, robot.model.upper
    random, bounds = np.random.default_rng(0), list(zip(lower, upper))

    def nearest(k):
        return min(abs(surface_gap(robot, minimize(
            lambda x: 1e6 * surface_gap(robot, x, k)**2, random.uniform(lower, upper),
            bounds=bounds, method='L-BFGS-B').x, k)) for _ in range(REACH_STARTS))

    return {k for k in range(1, len(robot.anatomy.digits)) if nearest(k) <= TOUCHED}


def frame_distance(robot, position, first, second):
    """Return the distance of the tip frames of two digits [m]."""
    frames = robot.model.frames(position)
    places = []
    for role in (first, second):
        digit = robot.anatomy.digits[role]
        places.append(frames[1][digit.joints[-1]] + frames[0][digit.joints[-1]] @ digit.tip)
    return np.linalg.norm(places[0] - places[1])


def lag(solver, hand):
    """Return the delay of the joint that moves most as an index finger swings [ms]."""
    solver.start()
    frames = swing(hand)
    positions = np.array([solver.call(*given) for given in solver.arguments(frames, SWING_RATE)])
    settled = positions[len(positions) // 3:]
    t = np.arange(len(positions))[len(positions) // 3:] / SWING_RATE
    wave = np.exp(-2j * np.pi * SWING_HZ * t)
    amplitudes = (settled - settled.mean(axis=0)).T @ wave
    strongest = amplitudes[np.abs(amplitudes).argmax()]
    # sin has the phase -90°; a joint may turn the other way.
    phase = np.angle(strongest * 1j)
    late = -((phase + np.pi / 2) % np.pi - np.pi / 2)
    return 1e3 * late / (2. * np.pi * SWING_HZ)


def default_urdfs():
    """Return the folder of the URDFs that dexi-rs brings."""
    try:
        import dexi_rs
    except ImportError:
        sys.exit('without dexi-rs, which brings URDFs, give --urdfs FOLDER')
    return dexi_rs.asset_path('robots/hands')


def main():
    """Run the benchmark."""
    parser = argparse.ArgumentParser(
        description=__doc__.split('\n', 1)[0],
        epilog='Install the peers by: pip install -r requirements/peers.in.')
    parser.add_argument('captures', nargs='*', type=Path, metavar='CAPTURE.npz')
    parser.add_argument('--urdfs', type=Path, metavar='FOLDER',
                        help='with the URDFs of the robots, also below; those of dexi-rs if absent')
    parser.add_argument('--robots', nargs='+', choices=ROBOTS, default=list(ROBOTS))
    parser.add_argument('--peers', nargs='*', choices=RETARGETING_PEERS,
                        default=list(RETARGETING_PEERS))
    parser.add_argument('--frames', type=int, default=4000, help='of each recording at most')
    add_json_option(parser)
    options = parser.parse_args()
    try:
        recordings = [*(captured(path) for path in options.captures), pinches()]
    except HandTrackerError as error:
        sys.exit(f'{parser.prog}: {error}')
    peers = installed(options.peers)
    print(environment(**peers))
    rows = []
    for name in options.robots:
        stem, setup = ROBOTS[name]
        file = f'{stem}.urdf'
        folder = PLAIN_FOLDER if name == 'plain' else options.urdfs or default_urdfs()
        path = next(iter(sorted(folder.rglob(file))), None)
        if path is None:
            print(f'{name}: no {file}: left out', file=sys.stderr)
            continue
        robot = robot_hand(load_urdf_tree(path))
        within_reach = touchable(robot)
        others = [solver for peer in peers if setup
                  for solver in RETARGETING_PEERS[peer].solvers(name, robot, path, setup)]
        for recording in recordings:
            recording.landmarks = recording.landmarks[:options.frames]
            for solver in (Ours(robot, recording.hand), *others):
                row = {'robot': name, 'method': solver.method,
                       **run(solver, recording, robot, within_reach),
                       'lag_ms': lag(solver, recording.hand)}
                rows.append({key: round(value, 3) if isinstance(value, float) else value
                             for key, value in row.items()})
                print_row(rows[-1])
    write_rows(options.json, rows)


def print_row(row):
    """Print a row as a line."""
    numbers = (f'{name} {value:.4g}' for name, value in row.items()
               if isinstance(value, (int, float)) and name != 'rate_hz')
    print(f"{row['robot']:8s} {row['method']:24s} {row['recording']:26s} {'  '.join(numbers)}",
          flush=True)


if __name__ == '__main__':
    main()
