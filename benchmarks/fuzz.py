"""Fuzz the tracker with random input and check every state for validity.

Plausible motion with faults of markers, stamps and measured flexions alternates with invalid input
and live changes of hand, layout and options:
`python benchmarks/fuzz.py --frames 1000000 --seed 1`.
"""

import argparse
import time
from collections import Counter
from dataclasses import fields

import numpy as np
from scipy.spatial.transform import Rotation

from hand_tracker.core.errors import InvalidLayout
from hand_tracker.core.model.hand import Hand, preset_coupling, preset_limits
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.marker_layout import PAPER_PLACES, MarkerLayout, marker_positions
from hand_tracker.core.model.states import MarkerState
from hand_tracker.core.options import TrackerOptions
from hand_tracker.core.tracker import HandTracker

WILD = np.array((0., -0., np.nan, np.inf, -np.inf, 1e30, -1e30, 1e308, 5e-324, 1e-300, 1e3, -1e3,
                 1e-3, .1))
STAMPS = (None, np.nan, np.inf, -np.inf, 0., -1., 1e30, -1e30, 1e308, 1e9, 5e-324)
TIPS = tuple(place.replace('dip', 'tip') for place in PAPER_PLACES)
CONFIGURE = .003   # share of frames preceded by a change of hand, layout or options
RESET = .0002      # share of frames preceded by a reset
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
    """Return markers on joints or tips, with or without offsets."""
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
        """Return the markers after a time step [s], shape (8, 3) [m]."""
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
    kind = rng.integers(6)
    if kind == 0:
        return rng.choice(WILD, (8, 3))
    if kind == 1:
        return np.where(rng.random((8, 3)) < .3, rng.choice(WILD, (8, 3)), markers)
    if kind == 2:
        return rng.normal(scale=10. ** rng.uniform(-12., 4.), size=(8, 3))
    if kind == 3:
        return np.tile(rng.choice((markers[0], np.zeros(3), np.full(3, np.nan))), (8, 1))
    if kind == 4:
        return markers * 10. ** rng.uniform(-6., 4.)
    return markers[rng.integers(8, size=8)]


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
        self.frozen = np.zeros((8, 3))

    def _begin(self):
        """Draw the properties of the next stretch of frames."""
        rng = self.rng
        self.left = int(rng.integers(1, 240))
        self.motion.draw_rates()
        self.step = float(rng.choice((1e-9, 1e-3, 1 / 480, 1 / 120, 1 / 120, 1 / 30, .3, 2.)))
        self.stamped = str(rng.choice(('even', 'even', 'jitter', 'none', 'repeated', 'backwards',
                                       'gaps', 'any')))
        # Half of the stretches are like a good recording, so that the filters settle.
        calm = rng.random() < .5
        self.noise = 10. ** rng.uniform(-6., -3. if calm else -1.5)
        self.hidden = rng.random(8) < rng.choice((0., .1, .3, .9))
        self.flicker = 0. if calm else float(rng.choice((0., .02, .5)))
        self.order = rng.permutation(8) if rng.random() < .1 else np.arange(8)
        self.stuck = rng.random(8) < (0. if calm else .1)
        self.copied = -1 if calm else int(rng.integers(-8, 8))
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
        markers += self.place + rng.normal(scale=self.noise, size=(8, 3))
        if self.copied >= 0:
            markers[self.copied] = markers[rng.integers(8)]
            did['duplicates'] += 1
        if self.stuck.any():
            markers[self.stuck] = self.frozen[self.stuck]
            did['frozen'] += 1
        self.frozen = markers.copy()
        if rng.random() < self.wild:
            markers = nonsense(rng, markers)
            did['nonsense'] += 1
        markers = markers[self.order]
        did['permuted'] += bool((self.order != np.arange(8)).any())
        gone = self.hidden | (rng.random(8) < self.flicker)
        markers[gone] = np.nan
        did['with hidden markers'] += bool(gone.any())
        did['frames'] += 1
        return markers, self._stamp(), self._flexion()

    def disturb(self, tracker):
        """Reset or reconfigure the running tracker, at random."""
        rng = self.rng
        if rng.random() < RESET:
            tracker.reset()
            self.did['resets'] += 1
        if rng.random() >= CONFIGURE:
            return
        kind = str(rng.choice(('hand', 'layout', 'options', 'all')))
        try:
            tracker.configure(
                hand=random_hand(rng) if kind in ('hand', 'all') else None,
                layout=random_layout(rng) if kind in ('layout', 'all') else None,
                options=random_options(rng) if kind in ('options', 'all') else None)
        except InvalidLayout:
            # A refused configuration leaves the tracker unchanged.
            self.did['layouts refused'] += 1
            return
        self.did[f'configured {kind}'] += 1
        # Mostly the simulated hand is the tracker's hand model.
        if rng.random() < .8:
            self.motion.set_hand(tracker.hand, tracker.layout)


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
                state.hidden_for, state.confidence, state.residuals[seen]))),
            ('angles within limits', ((limits[:, 0] <= state.angles)
                                      & (state.angles <= limits[:, 1])).all()),
            ('rotations orthonormal', abs(square - np.eye(3)).max() <= 1e-6),
            ('rotations right-handed', (np.linalg.det(turns) > 0.).all()),
            ('confidence from 0 to 1', ((0. <= state.confidence)
                                        & (state.confidence <= 1.)).all()),
            ('hidden_for not negative', (state.hidden_for >= 0.).all()),
            ('residuals of seen markers', not (np.isin(state.marker_states, (
                MarkerState.SEEN, MarkerState.SWAPPED)) ^ seen).any()),
            ('a known palm state', 0 <= state.palm <= 7)):
        if not good:
            raise InvalidState(f'violated: {what}')


def fuzz(frames, seed):
    """Track random frames and check each state.

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
        try:
            # Underflow to 0 is intended.
            with np.errstate(all='raise', under='ignore'):
                state = tracker.update(markers, stamp, flexion)
            spent = time.perf_counter() - begun
            check(state, tracker.hand.limits)
        except Exception as error:
            raise InvalidState(f'seed {seed}, frame {number}, time {stamp}, flexion {flexion}, '
                            f'{tracker.options}, markers\n{markers}\n{error!r}') from error
        total += spent
        # The first frames include compiling.
        slowest = max(slowest, spent if number > 1000 else 0.)
        source.did[f'palm {state.palm.name}'] += 1
        for value, count in zip(*np.unique(state.marker_states, return_counts=True)):
            source.did[f'marker {MarkerState(value).name}'] += int(count)
    return source.did, slowest, total / max(frames, 1)


def main():
    """Run the fuzz test and print the counts."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--frames', type=int, default=MILLION)
    parser.add_argument('--seed', type=int, default=1)
    arguments = parser.parse_args()
    did, slowest, mean = fuzz(arguments.frames, arguments.seed)
    for what in sorted(did):
        print(f'{what:28s} {did[what]:12,d}')
    print(f'nothing failed; an update took {1e3 * mean:.3f} ms, at most {1e3 * slowest:.1f} ms')


if __name__ == '__main__':
    main()
