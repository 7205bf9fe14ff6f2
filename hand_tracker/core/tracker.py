"""The tracker: eight markers in, the hand's pose out, frame by frame.

`HandTracker` owns all state and checks what comes in; the sequence is `track_frame`.
"""

from copy import deepcopy
from typing import NamedTuple

import numpy as np

from .filtering.frame_clock import initial_clock
from .filtering.smoothing import noise_levers
from .inverse_kinematics.digit import chains, measure
from .labelling.association import hand_bounds
from .labelling.plausibility import typical_places
from .model.capsules import capsules
from .model.hand import DIGITS, Hand
from .model.kinematics import Pose, forward, joint_table
from .model.marker_layout import (
    MARKERS,
    PALM_MARKERS,
    MarkerLayout,
    marker_positions,
    require_solvable,
)
from .model.states import PALM_STATES, MarkerState, PalmState
from .numerics.jit import another, packed, parts
from .occlusion.transdigital import prior_of
from .options import TrackerOptions
from .pipeline import Model, blank_state, choices, track_frame
from .pose.report import blank_report

__all__ = ['HandState', 'HandTracker', 'MarkerState', 'PalmState', 'TrackerOptions']

MIRROR = np.array((1., -1., 1.))
PALM = len(PALM_MARKERS)


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

    Attributes
    ----------
    restarted : bool
        Whether time jumped back with the last frame, so that all began anew.

    Examples
    --------
    >>> tracker = HandTracker(Hand.scaled(length=0.19, breadth=0.09))
    >>> state = tracker.update(markers)  # markers: (8, 3) [m], NaN where not seen
    """

    def __init__(self, hand=None, layout=None, options=None):
        self._wear(Hand.scaled() if hand is None else hand,
                   MarkerLayout() if layout is None else layout,
                   TrackerOptions() if options is None else options)
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
        self._wear(self.hand if hand is None else hand, self.layout if layout is None else layout,
                   self.options if options is None else options)
        if self.hand.side != side:
            self.reset()
        elif layout is not None:
            # Hidden markers are where the pose has them, in their new places.
            self._state.digits.mean[:, :3] = self._on_right_hand(self._state.angles)

    def _wear(self, hand, layout, options):
        right = hand.replace(side='right')
        mounting = layout.mounting(right)
        require_solvable(mounting)
        self.hand, self.layout, self.options = hand, layout, options
        digits = chains(right, mounting)
        self._right_table, self._right_mounting = joint_table(right), mounting
        self._template = mounting.position[:PALM].copy()
        self._relaxed = right.relaxed()
        self._rest = self._on_right_hand(self._relaxed)

        # Where the kernels read it
        self._choices, _ = packed(choices(options))
        self._digits, _ = packed(digits)
        self._measured_digits, _ = packed(deepcopy(digits))
        self._model, _ = packed(Model(
            self._template, self._rest, noise_levers(self._template, self._rest),
            prior_of(options.link_index_middle, options.link_middle_ring,
                     options.link_ring_little),
            np.array((options.bound_index_middle, options.bound_middle_ring,
                      options.bound_ring_little)),
            hand_bounds(digits, typical_places(right, mounting)),
            capsules(right), joint_table(hand), layout.mounting(hand),
            MIRROR if hand.side == 'left' else np.ones(3)))
        self._blank, _ = packed(self._beginning())

    def _beginning(self):
        return blank_state(
            self._template, self._rest, self._relaxed, self.options.marker_noise)

    def _on_right_hand(self, angles):
        """Return the digits' markers in the wrist's frame of the right hand, shape (5, 3)."""
        return marker_positions(
            self._right_mounting, forward(self._right_table, angles))[PALM:]

    @property
    def placed(self):
        """Whether the palm was seen since all began; before, the pose is none to publish."""
        return bool(self._state.placed[0])

    def reset(self):
        """Return to the state before the first frame."""
        self.restarted = False
        self._clock, _ = packed(initial_clock())
        self._report, _ = packed(blank_report())
        self._kept, self._state = packed(self._beginning())

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
        report = another(self._report)
        self.restarted = bool(track_frame(
            *self.kernel_arguments(distal_flexion)[:-1], report, markers,
            np.nan if time is None else float(time)))
        return self.told(report)

    def kernel_arguments(self, distal_flexion=None):
        """Return what `track_frame` takes before the markers; it stays until `configure`.

        Parameters
        ----------
        distal_flexion : ndarray, shape (5,), optional
            As for `update`.

        Returns
        -------
        tuple of packs
        """
        return (self._model, self._chains_with(distal_flexion), self._choices, self._clock,
                self._blank, self._kept, self._report)

    @staticmethod
    def told(report):
        """Return the `HandState` of a packed `Report`, whose arrays it takes."""
        (palm,), angles, rotation, position, rotations, positions, *known, (iterations,) = (
            parts(report))
        return HandState(PALM_STATES[palm], angles, rotation, position,
                         Pose(rotations, positions), *known, int(iterations))

    def _chains_with(self, distal_flexion):
        if distal_flexion is None:
            return self._digits
        distal_flexion = np.array(distal_flexion, dtype=float)
        if distal_flexion.shape != (len(DIGITS),):
            raise ValueError(f'distal_flexion: shape {distal_flexion.shape}; '
                             f'expected {(len(DIGITS),)}')
        measure(self._digits, distal_flexion, self._measured_digits)
        return self._measured_digits

    def __getstate__(self):
        return {name: value for name, value in self.__dict__.items() if name != '_kept'}

    def __setstate__(self, kept):
        self.__dict__.update(kept)
        # Of a copy, too, the state is what the kernels write into.
        self._kept, self._state = packed(self._state)
