"""The tracker: eight markers in, the hand's pose out, frame by frame.

`HandTracker` owns all state. One update is the paper's sequence: missing markers are
completed, the palm is placed, every digit is solved within its limits, and the pose is
the forward kinematics of the 25 angles.
"""

import enum
from dataclasses import dataclass, field, fields
from typing import NamedTuple

import numpy as np

from .clock import Clock
from .digit import chains, solve_digits
from .errors import InvalidOption
from .hand import DIGITS, JOINTS, Hand
from .kinematics import Pose, forward, joint_table
from .layout import (
    MARKERS, PALM_MARKERS, MarkerLayout, marker_positions, require_solvable)
from .occlusion import complete_palm, hold_digits, reject_frozen, visible
from .palm import PalmState, palm_fault, place_palm

MIRROR = np.array((1., -1., 1.))
PALM = len(PALM_MARKERS)
FADING = .5  # [s]
DIGIT_JOINTS = [[i for i, joint in enumerate(JOINTS) if joint.startswith(digit)]
                for digit in DIGITS]


class MarkerState(enum.IntEnum):
    """What is known of a marker."""

    SEEN = 0
    PREDICTED = 1  # hidden
    ABSENT = 2     # not seen since the start: at its place on the hand at rest
    REJECTED = 3   # seen where it cannot be, and predicted instead
    SWAPPED = 4    # seen under another marker's label, and put right
    STALE = 5      # hidden for longer than a prediction holds


def _option(default, description, **limits):
    return field(default=default, metadata={'description': description, **limits})


@dataclass(frozen=True)
class TrackerOptions:
    """Choices of method; each field's metadata has its description and what it allows.

    Raises
    ------
    InvalidOption
        Naming the option, its value and what is allowed.
    """

    palm_method: str = _option(
        'rigid', 'Palm from its three markers: rigid fit, or the spheres and plane of the paper',
        choices=('rigid', 'spheres'))
    finger_ik: str = _option(
        'closed_form', 'Flexion of the digits: closed form, or constrained FABRIK as in the paper',
        choices=('closed_form', 'fabrik'))
    fabrik_tolerance: float = _option(
        1e-5, 'Distance from the marker at which FABRIK stops', unit='m', range=(1e-9, 1e-2))
    fabrik_iterations: int = _option(
        200, 'Iterations after which FABRIK stops, per digit and frame', range=(1, 10000))
    palm_stretch: float = _option(
        1.5, 'Palm markers farther apart than this times their distance on the hand are refused',
        range=(1.05, 10.))
    palm_shrink: float = _option(
        0.3, 'Palm markers nearer than this times their distance on the hand are refused',
        range=(0.01, 0.95))
    palm_flatness: float = _option(
        0.2, 'Palm triangles with less than this times the area on the hand count as collinear',
        range=(0.01, 0.95))

    frozen_frames: int = _option(
        10, 'Frames after which a marker that repeats its place to the last bit, while the palm '
        'moves, counts as lost; 0 is never', range=(0, 100000))

    def __post_init__(self):
        for option in fields(self):
            value, allowed = getattr(self, option.name), option.metadata
            if 'choices' in allowed:
                if value not in allowed['choices']:
                    raise InvalidOption(
                        f'{option.name}: {value!r} is not one of {", ".join(allowed["choices"])}')
                continue
            lower, upper = allowed['range']
            kinds = int if isinstance(option.default, int) else (int, float)
            if isinstance(value, bool) or not isinstance(value, kinds) \
                    or not lower <= value <= upper:
                whole = 'a whole number from ' if kinds is int else ''
                raise InvalidOption(
                    f'{option.name}: {value!r}; allowed is {whole}{lower:g} to {upper:g}')


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
        self.options = TrackerOptions() if options is None else options
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
        self.options = self.options if options is None else options
        if self.hand.side != side:
            self.reset()
        elif layout is not None:
            # Held markers are where the pose has them, in their new places.
            self._local = self._on_right_hand(self._angles)

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
        self._table = joint_table(hand)
        self._mounting = layout.mounting(hand)

    def _on_right_hand(self, angles):
        """Return the digits' markers in the wrist's frame of the right hand, shape (5, 3)."""
        return marker_positions(
            self._right_mounting, forward(self._right_table, angles))[PALM:]

    def reset(self):
        """Return to the state before the first frame."""
        self._clock = Clock()
        self._hidden_for = np.zeros(len(MARKERS))
        self._placed = False
        self._angles = np.zeros(len(JOINTS))
        self._rotation = np.eye(3)
        self._position = np.zeros(3)
        self._local = self._rest.copy()
        self._known = np.zeros(len(self._local), dtype=bool)
        self._last = np.full((len(MARKERS), 3), np.nan)
        self._still = np.zeros(len(MARKERS), dtype=np.int64)

    def update(self, markers, time=None):
        """Return the hand for the next frame of markers.

        Parameters
        ----------
        markers : array_like, shape (8, 3)
            In the order of `MARKERS` [m]; a row with a number that is not finite, or
            farther than a kilometre, is not seen.
        time : float, optional
            Of the frame, on any clock; when it jumps back all begins anew. When left out
            frames are taken to come evenly, at the rate so far or 120 Hz [s].

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
        step, _, restarted = self._clock.step(time)
        if restarted:
            self.reset()
        if self._left:
            markers *= MIRROR
        seen = np.empty(len(MARKERS), dtype=bool)
        options = self.options

        # 1 occlusion: what is no measurement, and hidden palm markers carried by those seen
        visible(markers, seen)
        reject_frozen(markers, seen, self._last, self._still, options.frozen_frames)
        palm = complete_palm(
            markers, seen, self._template, self._rotation, self._position, self._placed)
        if palm <= PalmState.CARRIED:
            fault = palm_fault(markers[:PALM], self._template, options.palm_stretch,
                               options.palm_shrink, options.palm_flatness)
            palm = fault or palm

        iterations = 0
        if palm <= PalmState.CARRIED:
            # 2 palm: the wrist's pose and the first joint of every digit
            self._placed = True
            roots = self._chains.root.copy()
            place_palm(markers[:PALM], self._template, options.palm_method == 'spheres',
                       self._rotation, self._position, roots)
            # 1 occlusion: hidden markers of digits are held in the palm's frame
            hold_digits(markers[PALM:], seen[PALM:], self._rotation, self._position,
                        self._rest, self._local, self._known)
            # 3 fingers, 4 thumb: planes, flexion within limits, intradigital correlation
            iterations = solve_digits(
                self._chains, roots, self._local, self._angles, options.finger_ik == 'fabrik',
                options.fabrik_tolerance, options.fabrik_iterations)
        # 5 angles: the pose is their forward kinematics
        self._hidden_for = np.where(seen, 0., self._hidden_for + step)
        return self._state(PalmState(palm), markers, seen, iterations)

    def _state(self, palm, markers, seen, iterations):
        np.clip(self._angles, self._chains.lower, self._chains.upper, out=self._angles)
        rotation, position = self._rotation.copy(), self._position.copy()
        held = np.vstack((self._template, self._local)) @ rotation.T + position
        used = np.where(seen[:, None], markers, held)
        known = np.append([self._placed] * PALM, self._known)
        states = np.where(seen, MarkerState.SEEN,
                          np.where(known, MarkerState.PREDICTED, MarkerState.ABSENT))
        if self._left:
            rotation *= MIRROR[:, None] * MIRROR
            position *= MIRROR
            used *= MIRROR
        pose = forward(self._table, self._angles, rotation, position)
        places = marker_positions(self._mounting, pose, rotation, position)
        residuals = np.where(seen, np.linalg.norm(places - used, axis=1), np.nan)
        return HandState(palm, self._angles.copy(), rotation, position, pose, used, states,
                         self._hidden_for.copy(), self._confidence(), residuals,
                         int(iterations))

    def _confidence(self):
        hidden_for = self._hidden_for[PALM:].copy()
        hidden_for[~self._known] = np.inf
        confidence = np.ones(len(JOINTS))
        for digit, faded in enumerate(np.exp(-hidden_for / FADING)):
            confidence[DIGIT_JOINTS[digit]] = faded
        return confidence
