"""The tracker: eight markers in, the hand's pose out, frame by frame.

`HandTracker` owns all state. One update is the paper's sequence: missing markers are
completed, the palm is placed, every digit is solved within its limits, and the pose is
the forward kinematics of the 25 angles.
"""

import enum
from typing import NamedTuple

import numpy as np

from .capsules import capsules, place_capsules
from .clock import Clock
from .contact import GAP, carry, separate
from .digit import chains, solve_digits, with_measured
from .digit_markers import follow_digits
from .hand import DIGITS, JOINTS, Hand
from .identity import blank_memory, hand_bounds, identify
from .interdependence import keep_near_neighbours, no_habits, prior_of
from .kinematics import Pose, forward, joint_table
from .layout import (
    MARKERS, PALM_MARKERS, MarkerLayout, marker_positions, require_solvable)
from .noise import learn_noise, unknown_noise
from .occlusion import reject_frozen, visible
from .options import TrackerOptions
from .palm import PalmState, palm_fault, place_palm
from .palm_markers import check_palm, expected_markers, follow_palm
from .reentry import ease
from .smoothing import levers, noise_on_palm
from .tracks import forget_motion, no_tracks, spread

MIRROR = np.array((1., -1., 1.))
PALM = len(PALM_MARKERS)
SETTLE = 150        # times that the first frame is solved
RELEASE = .05       # [s] in which digits that touched go back to where their markers are
LEAST_PARTED = 1e-6  # [rad]
SEEN_MOBILITY = .1  # of a seen digit among those that touch, against a hidden one's 1
UNSURE = .01  # [m] standard deviation of a marker at which confidence is a third
DIGIT_OF_JOINT = np.array([DIGITS.index(joint.split('_')[0]) for joint in JOINTS])


class MarkerState(enum.IntEnum):
    """What is known of a marker."""

    SEEN = 0
    PREDICTED = 1  # hidden
    ABSENT = 2     # not seen since the start: at its place on the hand at rest
    REJECTED = 3   # seen where it cannot be, and predicted instead
    SWAPPED = 4    # seen under another marker's label, and put right
    STALE = 5      # hidden for longer than a prediction holds


class HandState(NamedTuple):
    """The hand after a frame.

    Attributes
    ----------
    palm : PalmState
    angles : ndarray, shape (25,)
        In the order of `JOINTS` [rad].
    wrist_rotation : ndarray, shape (3, 3)
        From the wrist's frame to that of the markers.
    wrist_position : ndarray, shape (3,)
        [m]
    pose : Pose
        The 25 links in the frame of the markers: forward kinematics of the above.
    markers : ndarray, shape (8, 3)
        The positions used, seen or predicted [m].
    marker_states : ndarray of int, shape (8,)
        `MarkerState` of each marker.
    hidden_for : ndarray, shape (8,)
        Since when each marker is not seen, 0 where it is [s].
    confidence : ndarray, shape (25,)
        Of each angle, from 1, measured now, to 0, unknown.
    residuals : ndarray, shape (8,)
        Distance of each seen marker from its place on the pose, NaN when not seen [m].
    iterations : int
        Of FABRIK, over all digits.
    """

    palm: PalmState
    angles: np.ndarray
    wrist_rotation: np.ndarray
    wrist_position: np.ndarray
    pose: Pose
    markers: np.ndarray
    marker_states: np.ndarray
    hidden_for: np.ndarray
    confidence: np.ndarray
    residuals: np.ndarray
    iterations: int


class HandTracker:
    """Track one hand.

    Parameters
    ----------
    hand : Hand, optional
        The mean right hand when left out.
    layout : MarkerLayout, optional
        The paper's eight markers when left out.
    options : TrackerOptions, optional

    Examples
    --------
    >>> tracker = HandTracker(Hand.scaled(length=0.19, breadth=0.09))
    >>> state = tracker.update(markers)  # markers: (8, 3) [m], NaN where not seen
    """

    def __init__(self, hand=None, layout=None, options=None):
        self._choose(TrackerOptions() if options is None else options)
        self._wear(Hand.scaled() if hand is None else hand,
                   MarkerLayout() if layout is None else layout)
        self.reset()

    def configure(self, hand=None, layout=None, options=None):
        """Replace hand, layout or options from the next frame on.

        The pose is kept, unless the hand is of the other side: then all begins anew.

        Parameters
        ----------
        hand : Hand, optional
        layout : MarkerLayout, optional
        options : TrackerOptions, optional

        Raises
        ------
        InvalidLayout
            If nothing can be solved from the layout on the hand.
        """
        side = self.hand.side
        self._wear(self.hand if hand is None else hand, self.layout if layout is None else layout)
        if options is not None:
            self._choose(options)
        if self.hand.side != side:
            self.reset()
        elif layout is not None:
            # Hidden markers are where the pose has them, in their new places.
            self._digits.mean[:, :3] = self._on_right_hand(self._angles)

    def _choose(self, options):
        self.options = options
        self._prior = prior_of(options.link_index_middle, options.link_middle_ring,
                               options.link_ring_little)
        self._bounds = np.array((options.bound_index_middle, options.bound_middle_ring,
                                 options.bound_ring_little))

    def _wear(self, hand, layout):
        # The method is worked out for a right hand; a left one is mirrored at the door.
        right = hand.replace(side='right')
        mounting = layout.mounting(right)
        require_solvable(mounting)
        self.hand, self.layout = hand, layout
        self._left = hand.side == 'left'
        self._chains = chains(right, mounting)
        self._right_table, self._right_mounting = joint_table(right), mounting
        self._template = mounting.position[:PALM].copy()
        self._rest = self._on_right_hand(np.zeros(len(JOINTS)))
        self._levers = levers(self._template, self._rest)
        self._hand_bounds = hand_bounds(self._template, self._chains)
        self._capsules = capsules(right)
        self._table = joint_table(hand)
        self._mounting = layout.mounting(hand)

    def _on_right_hand(self, angles):
        """Return the digits' markers in the wrist's frame of the right hand, shape (5, 3)."""
        return marker_positions(
            self._right_mounting, forward(self._right_table, angles))[PALM:]

    def reset(self):
        """Return to the state before the first frame."""
        self._clock = Clock()
        self._forget()

    def _forget(self):
        self._placed = False
        self._rotation = np.eye(3)
        self._position = np.zeros(3)
        self._palm = no_tracks(self._template)
        self._digits = no_tracks(self._rest)
        self._habits, self._shares = no_habits(), np.zeros((len(self._prior),) * 2)
        self._angles = np.zeros(len(JOINTS))
        self._eased, self._offset = np.zeros(len(JOINTS)), np.zeros(len(JOINTS))
        self._published = np.zeros(len(JOINTS))
        self._parted = np.zeros(len(JOINTS))
        self._apart = np.zeros(3)
        self._pushed = np.zeros(self._rest.shape)
        self._noise = unknown_noise(len(MARKERS), self.options.marker_noise)
        self._memory, self._verdict = blank_memory(), np.zeros(len(MARKERS), dtype=np.int64)
        self._expected = np.zeros((len(MARKERS), 3))
        self._last = np.full((len(MARKERS), 3), np.nan)
        self._still = np.zeros(len(MARKERS), dtype=np.int64)

    def update(self, markers, time=None, distal_flexion=None):
        """Return the hand for the next frame of markers.

        Parameters
        ----------
        markers : array_like, shape (8, 3)
            In the order of `MARKERS` [m]; a row with a number that is not finite, or
            farther than a kilometre, is not seen.
        time : float, optional
            Of the frame, on any clock; when it jumps back all begins anew. When left out
            frames are taken to come evenly, at the rate so far or 120 Hz [s].
        distal_flexion : array_like, shape (5,), optional
            Measured flexion of the last joint of each digit, in place of its coupling; NaN
            where none is [rad].

        Returns
        -------
        HandState
            Always finite and within the limits; before the palm was first seen its
            `palm` is WAITING and the pose is that of rest at the origin.

        Raises
        ------
        ValueError
            If the shape is another.
        """
        markers = np.array(markers, dtype=float)
        if markers.shape != (len(MARKERS), 3):
            raise ValueError(f'markers: shape {markers.shape}; expected {(len(MARKERS), 3)}')
        if self._left:
            markers *= MIRROR
        step, paused, restarted = self._clock.step(time)
        if restarted:
            self._forget()
        if paused:
            forget_motion(self._palm)
            forget_motion(self._digits)
        options = self.options
        palm, digits = self._palm, self._digits
        knew = np.append(palm.seen, digits.seen)
        seen = np.empty(len(MARKERS), dtype=bool)

        # 1 occlusion: what is no measurement
        visible(markers, seen)
        reject_frozen(markers, seen, self._last, self._still, options.frozen_frames)
        expected_markers(palm, digits, self._template, step, self._expected)
        identify(markers, seen, self._expected, np.append(spread(palm), spread(digits)),
                 np.append(palm.known, digits.known), step, self._hand_bounds, self._memory,
                 options.outlier_gate, options.swap_margin, options.patience, self._verdict)
        learn_noise(self._noise, markers, seen, step, options.marker_noise)
        noise = self._noise.deviation
        fault = check_palm(markers, seen, self._template, self._rotation, self._position,
                           self._placed, options.palm_stretch, options.palm_shrink,
                           options.palm_flatness)
        # 1 occlusion, 2 palm: its markers, hidden ones predicted; the wrist's pose
        state = follow_palm(
            markers, seen, palm, digits, self._rotation, self._position, self._template,
            self._placed, step, noise, options.smoothing, options.inertia,
            options.palm_from_fingers, options.max_prediction_time)
        iterations = 0
        if state != PalmState.WAITING:
            first, self._placed = not self._placed, True
            roots = self._chains.root.copy()
            place_palm(palm.mean[:, :3], self._template, options.palm_method == 'spheres',
                       self._rotation, self._position, roots)
            # 1 occlusion: the digits' markers in the palm's frame, hidden ones predicted
            follow_digits(
                markers[PALM:], seen[PALM:], digits, self._rotation, self._position,
                self._rest, self._habits, self._prior, self._shares,
                self._pushed, step, self._noise_of_digits(), options.smoothing, options.inertia,
                options.transdigital_memory, state == PalmState.TRACKED,
                options.max_prediction_time,
                options.relax_time if options.stale == 'relax' else 0.)
            # 3 fingers, 4 thumb: planes, flexion within limits, intradigital correlation
            chains = self._chains_with(distal_flexion)
            # A fist at the first frame has no history: it settles.
            for _ in range(SETTLE if first else 0):
                solve_digits(chains, roots, digits.mean[:, :3], self._angles, False, 0., 0)
            iterations = solve_digits(
                chains, roots, digits.mean[:, :3], self._angles,
                options.finger_ik == 'fabrik', options.fabrik_tolerance,
                options.fabrik_iterations)
            lower, upper = chains.lower, chains.upper
            keep_near_neighbours(
                self._angles, seen[PALM:], self._bounds, self._apart, lower, upper)
            if first:
                self._eased[:] = self._angles
            changed = (seen != knew) & (not first)
            ease(self._angles, self._eased, self._offset,
                 changed[PALM:] | changed[:PALM].any(), step, options.reentry_rate,
                 lower, upper)
            # 1 rigidity, friction: digits touch, and carry hidden ones
            before, self._published = self._published, self._eased.copy()
            self._touch(before, chains, seen[PALM:], step)
        # 5 angles: the pose is their forward kinematics
        return self._state(PalmState(fault or state), markers, seen, iterations)

    def _noise_of_digits(self):
        return np.array([noise_on_palm(noise, self._palm.covariance, lever)
                         for noise, lever in zip(self._noise.deviation[PALM:], self._levers)])

    def _chains_with(self, distal_flexion):
        if distal_flexion is None:
            return self._chains
        return with_measured(self._chains, np.asarray(distal_flexion, dtype=float))

    def _touch(self, before, chains, seen, step):
        options, angles = self.options, self._published
        if options.rigidity:
            # They part as they did in the last frame: no contact flickers.
            angles += self._parted * np.exp(-step / RELEASE)
            np.clip(angles, chains.lower, chains.upper, out=angles)
            separate(self._capsules, angles, chains.lower, chains.upper,
                     chains.coupling[:, 0].copy(), np.where(seen, SEEN_MOBILITY, 1.),
                     options.penetration)
            self._parted = angles - self._eased
            self._parted[np.abs(self._parted) < LEAST_PARTED] = 0.
        self._pushed[:] = 0.
        if options.friction > 0. and not seen.all():
            ends = np.empty((2, len(self._capsules.link), 2, 3))
            place_capsules(self._capsules, before, ends[0])
            place_capsules(self._capsules, angles, ends[1])
            carry(self._capsules, ends[0], ends[1], ~seen, GAP, options.friction, self._pushed)

    def _state(self, palm, markers, seen, iterations):
        angles = np.clip(self._published, self._chains.lower, self._chains.upper)
        rotation, position = self._rotation.copy(), self._position.copy()
        predicted = np.vstack((
            self._palm.mean[:, :3], self._digits.mean[:, :3] @ rotation.T + position))
        used = np.where(seen[:, None], markers, predicted)
        hidden_for = np.append(self._palm.hidden_for, self._digits.hidden_for)
        known = np.append(self._palm.known, self._digits.known)
        states = np.where(seen, MarkerState.SEEN, np.where(
            ~known, MarkerState.ABSENT, np.where(
                hidden_for > self.options.max_prediction_time, MarkerState.STALE,
                MarkerState.PREDICTED)))
        # What was put right may still be none of this palm.
        told = (self._verdict == MarkerState.REJECTED) | (self._verdict > 0) & seen
        states = np.where(told, self._verdict, states)
        if self._left:
            rotation *= MIRROR[:, None] * MIRROR
            position *= MIRROR
            used *= MIRROR
        pose = forward(self._table, angles, rotation, position)
        places = marker_positions(self._mounting, pose, rotation, position)
        residuals = np.where(seen, np.linalg.norm(places - used, axis=1), np.nan)
        return HandState(palm, angles, rotation, position, pose, used, states, hidden_for,
                         self._confidence(), residuals, int(iterations))

    def _confidence(self):
        palm, digits = self._palm, self._digits
        variance = spread(digits) ** 2 + (spread(palm) ** 2).max()
        of_digits = np.where(digits.known & self._placed, np.exp(-variance / UNSURE ** 2), 0.)
        return of_digits[DIGIT_OF_JOINT]
