"""Fuzz the tracker with random input and check every state for validity.

Plausible motion with faults of markers, stamps and measured flexions alternates with invalid input
and live changes of hand, side, layout (of 3 to 60 markers) and options:
`python benchmarks/fuzz.py --frames 1000000 --seed 1`. With `--clouds` the markers of one hand or
two are points without names, ghosts among them, which a labeller names for the trackers.
"""

import argparse
import time
from collections import Counter
from dataclasses import fields

import numpy as np
from scipy.spatial.transform import Rotation

from hand_tracker.core.errors import InvalidLayout
from hand_tracker.core.model.hand import SIDES, Hand, preset_coupling, preset_limits
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.layout_presets import LAYOUT_PRESETS, preset_layout
from hand_tracker.core.model.marker_layout import (
    ALL_LANDMARKS,
    COUNT_RANGE,
    OFFSET_RANGE,
    PALM_LANDMARKS,
    PAPER_PLACES,
    MarkerLayout,
    marker_positions,
)
from hand_tracker.core.model.states import MarkerState
from hand_tracker.core.options import TrackerOptions
from hand_tracker.core.point_labelling.cloud_labeller import CloudLabeller
from hand_tracker.core.point_labelling.natural_poses import (
    ANYBODY,
    FITTED,
    SIZED,
    model_prototype,
)
from hand_tracker.core.tracker import HandTracker

WILD = np.array((0., -0., np.nan, np.inf, -np.inf, 1e30, -1e30, 1e308, 5e-324, 1e-300, 1e3, -1e3,
                 1e-3, .1))
STAMPS = (None, np.nan, np.inf, -np.inf, 0., -1., 1e30, -1e30, 1e308, 1e9, 5e-324)
TOLERANCES = ANYBODY, SIZED, FITTED
TIPS = tuple(place.replace('dip', 'tip') for place in PAPER_PLACES)
CONFIGURE = .003   # share of frames preceded by a change of hand, layout or options
RESET = .0002      # share of frames preceded by a reset
MOST_GHOSTS = 20   # points of no hand in a cloud
GHOST_REACH = .3   # [m] from the origin, on each axis
MILLION = 1_000_000


class InvalidState(AssertionError):
    """The tracker returned an invalid state."""


def random_options(rng):
    """Return options, some of them drawn from their allowed values, bounds included."""
    chosen = {}
    for option in fields(TrackerOptions):
        if rng.random() < .7:
            continue
        allowed = option.metadata
        if isinstance(option.default, bool):
            chosen[option.name] = bool(rng.random() < .5)
        elif 'choices' in allowed:
            chosen[option.name] = str(rng.choice(allowed['choices']))
        else:
            lower, upper = allowed['range']
            # The lower bound is 0, off, for most.
            drawn = (lower, upper, option.default, lower + rng.random() ** 4 * (upper - lower))[
                rng.integers(4)]
            chosen[option.name] = type(option.default)(drawn)
    # Thousands of iterations a frame would be slow and no further test.
    chosen['fabrik_iterations'] = min(chosen.get('fabrik_iterations', 20), 20)
    return TrackerOptions(**chosen)


def random_hand(rng):
    """Return a hand of random size and side, with limits that may lock all joints."""
    limits = preset_limits(str(rng.choice(('paper', 'wide'))))
    if rng.random() < .3:
        limits = limits * rng.random((25, 2))
    if rng.random() < .1:
        limits = np.zeros((25, 2))
    hand = Hand.scaled(rng.uniform(.15, .22), rng.uniform(.07, .1),
                       side=str(rng.choice(('right', 'left'))), limits=limits,
                       coupling=preset_coupling(str(rng.choice(('natural', 'paper')))))
    return hand.with_paper_thumb() if rng.random() < .2 else hand


def random_layout(rng):
    """Return the paper's markers, with or without offsets, a preset, or markers anywhere."""
    kind = rng.random()
    if kind < .3:
        return preset_layout(str(rng.choice(tuple(LAYOUT_PRESETS))))
    if kind < .5:
        places = [*rng.choice(PALM_LANDMARKS, 3),
                  *rng.choice(ALL_LANDMARKS, rng.integers(COUNT_RANGE[1] - 2))]
        offsets = np.clip(rng.normal(scale=.01, size=(len(places), 3)), -OFFSET_RANGE, OFFSET_RANGE)
        return MarkerLayout(places, offsets, names=[f'marker {i}' for i in range(len(places))])
    offsets = rng.normal(scale=.003, size=(8, 3)) if rng.random() < .5 else np.zeros((8, 3))
    return MarkerLayout(PAPER_PLACES if rng.random() < .7 else TIPS, offsets=offsets)


class Motion:
    """Markers of a hand with random sinusoidal motion of wrist and joints.

    Parameters
    ----------
    rng : Generator
    """

    def __init__(self, rng):
        self.rng = rng
        self.set_hand(Hand.scaled(), MarkerLayout())
        self.phase = rng.uniform(0., 6.3, 31)

    def set_hand(self, hand, layout):
        """Set the simulated hand and marker layout."""
        self.table, self.mounting = joint_table(hand), layout.mounting(hand)
        self.middle, self.half = hand.limits.mean(axis=1), .5 * np.ptp(hand.limits, axis=1)

    def next(self, step):
        """Return the markers after a time step [s], shape (n, 3) [m]."""
        self.phase += self.rates * step
        wave = np.sin(self.phase)
        rotation = Rotation.from_rotvec(wave[25:28]).as_matrix()
        position = .3 * wave[28:]
        pose = forward(self.table, self.middle + self.half * wave[:25], rotation, position)
        return marker_positions(self.mounting, pose, rotation, position)

    def draw_rates(self):
        """Draw new angular frequencies of the motion."""
        self.rates = self.rng.uniform(0., 1., 31) * self.rng.choice((0., 1., 5., 30.))


def nonsense(rng, markers):
    """Return an invalid or implausible frame of markers."""
    kind, count = rng.integers(6), len(markers)
    if kind == 0:
        return rng.choice(WILD, (count, 3))
    if kind == 1:
        return np.where(rng.random((count, 3)) < .3, rng.choice(WILD, (count, 3)), markers)
    if kind == 2:
        return rng.normal(scale=10. ** rng.uniform(-12., 4.), size=(count, 3))
    if kind == 3:
        return np.tile(rng.choice((markers[0], np.zeros(3), np.full(3, np.nan))), (count, 1))
    if kind == 4:
        return markers * 10. ** rng.uniform(-6., 4.)
    return markers[rng.integers(count, size=count)]


class Fuzz:
    """An endless, seeded stream of frames.

    Parameters
    ----------
    seed : int

    Attributes
    ----------
    did : Counter
        Number of frames by kind of input and of resulting state.
    """

    def __init__(self, seed):
        self.rng = np.random.default_rng(seed)
        self.motion = Motion(self.rng)
        self.did = Counter()
        self.left = 0
        self.time = 0.

    def set_hand(self, hand, layout):
        """Simulate another hand, or other markers, from the next stretch of frames on."""
        self.motion.set_hand(hand, layout)
        self.left = 0

    def _begin(self):
        """Draw the properties of the next stretch of frames."""
        rng, count = self.rng, len(self.motion.mounting.link)
        self.left = int(rng.integers(1, 240))
        self.motion.draw_rates()
        self.step = float(rng.choice((1e-9, 1e-3, 1 / 480, 1 / 120, 1 / 120, 1 / 30, .3, 2.)))
        self.stamped = str(rng.choice(('even', 'even', 'jitter', 'none', 'repeated', 'backwards',
                                       'gaps', 'any')))
        # Half of the stretches are like a good recording, so that the filters settle.
        calm = rng.random() < .5
        self.noise = 10. ** rng.uniform(-6., -3. if calm else -1.5)
        self.hidden = rng.random(count) < rng.choice((0., .1, .3, .9))
        self.flicker = 0. if calm else float(rng.choice((0., .02, .5)))
        self.order = rng.permutation(count) if rng.random() < .1 else np.arange(count)
        self.stuck = rng.random(count) < (0. if calm else .1)
        self.frozen = np.zeros((count, 3))
        self.copied = -1 if calm else int(rng.integers(-count, count))
        self.teleport = 0. if calm else float(rng.choice((0., .01, .1)))
        self.wild = 0. if calm else float(rng.choice((0., .01, .3, 1.)))
        self.measured = str(rng.choice(('none', 'none', 'some', 'wild')))
        self.place = np.zeros(3)

    def _stamp(self):
        rng, kind = self.rng, self.stamped
        self.did[f'stamps {kind}'] += 1
        self.time += self.step
        if kind == 'jitter':
            return self.time + self.step * rng.normal()
        if kind == 'none':
            return None
        if kind == 'repeated' and rng.random() < .5:
            self.time -= self.step
        if kind == 'backwards' and rng.random() < .02:
            self.time -= 10. ** rng.uniform(-3., 3.)
        if kind == 'gaps' and rng.random() < .05:
            self.time += 10. ** rng.uniform(-2., 5.)
        if kind == 'any' and rng.random() < .3:
            return STAMPS[rng.integers(len(STAMPS))]
        return self.time

    def _flexion(self):
        rng = self.rng
        if self.measured == 'none':
            return None
        self.did[f'distal flexion {self.measured}'] += 1
        values = rng.uniform(-1., 2., 5) if self.measured == 'some' else rng.choice(WILD, 5)
        return np.where(rng.random(5) < .3, np.nan, values)

    def frame(self):
        """Return markers, time and measured distal flexion of the next frame."""
        rng, did = self.rng, self.did
        if self.left == 0:
            self._begin()
            did['stretches'] += 1
        self.left -= 1
        markers = self.motion.next(self.step)
        if rng.random() < self.teleport:
            self.place = rng.normal(scale=10. ** rng.uniform(-2., 3.), size=3)
            did['teleports'] += 1
        count = len(markers)
        markers += self.place + rng.normal(scale=self.noise, size=(count, 3))
        if self.copied >= 0:
            markers[self.copied] = markers[rng.integers(count)]
            did['duplicates'] += 1
        if self.stuck.any():
            markers[self.stuck] = self.frozen[self.stuck]
            did['frozen'] += 1
        self.frozen = markers.copy()
        if rng.random() < self.wild:
            markers = nonsense(rng, markers)
            did['nonsense'] += 1
        markers = markers[self.order]
        did['permuted'] += bool((self.order != np.arange(count)).any())
        gone = self.hidden | (rng.random(count) < self.flicker)
        markers[gone] = np.nan
        did['with hidden markers'] += bool(gone.any())
        did['frames'] += 1
        return markers, self._stamp(), self._flexion()

    def disturb(self, tracker):
        """Reset or reconfigure the running tracker, at random; return whether its hand changed."""
        rng = self.rng
        if rng.random() < RESET:
            tracker.reset()
            self.did['resets'] += 1
        if rng.random() >= CONFIGURE:
            return False
        kind = str(rng.choice(('hand', 'layout', 'options', 'all')))
        try:
            tracker.configure(
                hand=random_hand(rng) if kind in ('hand', 'all') else None,
                layout=random_layout(rng) if kind in ('layout', 'all') else None,
                options=random_options(rng) if kind in ('options', 'all') else None)
        except InvalidLayout:
            # A refused configuration leaves the tracker unchanged.
            self.did['layouts refused'] += 1
            return False
        self.did[f'configured {kind}'] += 1
        # Mostly the simulated hand is the tracker's hand model.
        self.set_hand(tracker.hand if rng.random() < .8 else random_hand(rng), tracker.layout)
        return kind != 'options'


class CloudFuzz:
    """An endless, seeded stream of points without names: of one hand or both, and of no hand.

    Parameters
    ----------
    seed : int
    trackers : sequence of HandTracker
        Of the hands in the cloud.

    Attributes
    ----------
    hands : list of Fuzz
        The markers of each hand.
    """

    def __init__(self, seed, trackers):
        self.rng = np.random.default_rng((seed, len(trackers)))
        self.trackers = trackers
        self.hands = [Fuzz((seed, hand)) for hand in range(len(trackers))]
        for hand, tracker in zip(self.hands, trackers):
            hand.set_hand(tracker.hand, tracker.layout)
        self._new_labeller()

    def _new_labeller(self):
        """Begin anew to label, by the trackers' hands as they are now."""
        prototypes = []
        for hand, tracker in zip(self.hands, self.trackers):
            try:
                prototypes.append(model_prototype(
                    tracker.hand, tracker.layout, tracker.layout.names,
                    TOLERANCES[self.rng.integers(len(TOLERANCES))]))
            except InvalidLayout:
                # Its palm has no triangle large enough to be found by.
                hand.did['prototypes refused'] += 1
                tracker.configure(layout=MarkerLayout())
                hand.set_hand(tracker.hand, tracker.layout)
                prototypes.append(model_prototype(
                    tracker.hand, tracker.layout, tracker.layout.names))
        self.labeller = CloudLabeller(prototypes)

    def frame(self):
        """Return the markers of each hand by their labels, (n, 3) [m], and the frame's time."""
        rng = self.rng
        changed = [hand.disturb(tracker) for hand, tracker in zip(self.hands, self.trackers)]
        if any(changed):
            self._new_labeller()
        made = [hand.frame() for hand in self.hands]
        ghosts = rng.uniform(-GHOST_REACH, GHOST_REACH, (rng.integers(MOST_GHOSTS + 1), 3))
        points = np.concatenate([*(markers for markers, _, _ in made), ghosts])
        points = points[rng.permutation(len(points))]
        ids = rng.integers(-1, len(points), len(points)) if rng.random() < .3 else None
        time = made[0][1]
        labels = self.labeller.update(points, time, ids)
        check_labels(labels, points)
        # The last row is that of markers without a label.
        named = np.concatenate((points, np.full((1, 3), np.nan)))
        for hand, found in zip(self.hands, labels.found):
            hand.did['hand found' if found else 'hand not found'] += 1
        return [named[rows] for rows in labels.rows], time


def check_labels(labels, points):
    """Check that labels are on points of a frame, (n, 3), each on one of its own.

    Raises
    ------
    InvalidState
        Naming the violated condition.
    """
    rows = np.concatenate(labels.rows)
    given = rows[rows >= 0]
    for what, good in (
            ('labels on points', ((rows >= -1) & (rows < len(points))).all()),
            ('a label on each point at most', len(np.unique(given)) == len(given)),
            ('labelled points finite', np.isfinite(points[given]).all()),
            ('no labels of hands not found', all(
                found or (mine < 0).all() for found, mine in zip(labels.found, labels.rows)))):
        if not good:
            raise InvalidState(f'violated: {what}')


def check(state, limits):
    """Check that a state is valid to be published.

    Parameters
    ----------
    state : HandState
    limits : ndarray, shape (25, 2)
        [rad]

    Raises
    ------
    InvalidState
        Naming the violated condition.
    """
    seen = np.isfinite(state.residuals)
    turns = np.concatenate((state.wrist_rotation[None], state.pose.rotation))
    square = np.einsum('nij,nkj->nik', turns, turns)
    for what, good in (
            ('numbers finite', all(np.isfinite(part).all() for part in (
                state.angles, state.wrist_position, state.pose.position, turns, state.markers,
                state.hidden_for, state.deviation, state.residuals[seen]))),
            ('angles within limits', ((limits[:, 0] <= state.angles)
                                      & (state.angles <= limits[:, 1])).all()),
            ('rotations orthonormal', abs(square - np.eye(3)).max() <= 1e-6),
            ('rotations right-handed', (np.linalg.det(turns) > 0.).all()),
            ('deviations within the ranges of the angles', (
                (0. <= state.deviation)
                & (state.deviation <= 1.02 * np.ptp(limits, axis=1) + 1e-9)).all()),
            ('hidden_for not negative', (state.hidden_for >= 0.).all()),
            ('residuals of seen markers', not (np.isin(state.marker_states, (
                MarkerState.SEEN, MarkerState.SWAPPED)) ^ seen).any()),
            ('a known palm state', 0 <= state.palm <= 7)):
        if not good:
            raise InvalidState(f'violated: {what}')


def fuzz(frames, seed):
    """Track random frames of labelled markers and check each state.

    Parameters
    ----------
    frames, seed : int

    Returns
    -------
    did : Counter
    slowest, mean : float
        Time of an update [s].

    Raises
    ------
    InvalidState
        For an invalid state or an exception of the tracker, with the frame that caused it.
    """
    source = Fuzz(seed)
    tracker = HandTracker()
    total = slowest = 0.
    for number in range(frames):
        source.disturb(tracker)
        markers, stamp, flexion = source.frame()
        begun = time.perf_counter()
        state = track(tracker, markers, stamp, flexion, f'seed {seed}, frame {number}')
        spent = time.perf_counter() - begun
        total += spent
        # The first frames include compiling.
        slowest = max(slowest, spent if number > 1000 else 0.)
        count_states(source.did, state)
    return source.did, slowest, total / max(frames, 1)


def fuzz_clouds(frames, seed):
    """Label and track random clouds of points, of one hand and of two; check labels and states.

    Parameters and results are those of `fuzz`; half of the frames are of one hand.
    """
    did = Counter()
    total = slowest = 0.
    for hands in (1, 2):
        trackers = [HandTracker(Hand.scaled(side=side)) for side in SIDES[:hands]]
        source = CloudFuzz(seed, trackers)
        for number in range(frames // 2):
            where = f'seed {seed}, {hands} hands, frame {number}'
            begun = time.perf_counter()
            try:
                named, stamp = source.frame()
            except Exception as error:
                raise InvalidState(f'{where}: {error!r}') from error
            spent = time.perf_counter() - begun
            total += spent
            slowest = max(slowest, spent if number > 1000 else 0.)
            for hand, tracker, markers in zip(source.hands, trackers, named):
                count_states(hand.did, track(tracker, markers, stamp, None, where))
        for hand in source.hands:
            did.update(hand.did)
    return did, slowest, total / max(frames, 1)


def track(tracker, markers, stamp, flexion, where):
    """Track a frame, shape (n, 3) [m], and return its state; `InvalidState` names `where`."""
    try:
        # Underflow to 0 is intended.
        with np.errstate(all='raise', under='ignore'):
            state = tracker.update(markers, stamp, flexion)
        check(state, tracker.hand.limits)
    except Exception as error:
        raise InvalidState(f'{where}, time {stamp}, flexion {flexion}, {tracker.options}, '
                           f'markers\n{markers}\n{error!r}') from error
    return state


def count_states(did, state):
    """Count the states of palm and markers of a frame."""
    did[f'palm {state.palm.name}'] += 1
    for value, count in zip(*np.unique(state.marker_states, return_counts=True)):
        did[f'marker {MarkerState(value).name}'] += int(count)


def main():
    """Run the fuzz test and print the counts."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--frames', type=int, default=MILLION)
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--clouds', action='store_true', help='of points without names')
    arguments = parser.parse_args()
    did, slowest, mean = (fuzz_clouds if arguments.clouds else fuzz)(
        arguments.frames, arguments.seed)
    for what in sorted(did):
        print(f'{what:28s} {did[what]:12,d}')
    print(f'nothing failed; an update took {1e3 * mean:.3f} ms, at most {1e3 * slowest:.1f} ms')


if __name__ == '__main__':
    main()
