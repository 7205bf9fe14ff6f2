"""The tracker: positions of markers in, angles and pose of the hand out, frame by frame.

`HandTracker` validates the input and owns all state; the method is `pipeline.track_frame`.
"""

from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .filtering.frame_clock import FrameClock, initial_clock
from .filtering.noise_estimate import noise_levers
from .inverse_kinematics.digit import Chains, digit_chains, override_coupling, reach
from .labelling.plausibility import typical_places
from .labelling.readings import HandBounds
from .model.capsules import hand_capsules
from .model.hand import DIGITS, LEFT_HAND_MIRROR, Hand, has_size_of
from .model.kinematics import Pose, forward, joint_table
from .model.marker_layout import (
    MARKERS,
    PALM_MARKERS,
    MarkerLayout,
    marker_positions,
    require_solvable,
)
from .model.marker_rows import layout_rows, marker_rows, shows_arch
from .model.observability import unobserved_joints
from .model.states import PALM_STATES, MarkerState, PalmState
from .numerics.jit import COMPILED, Kernel, for_types_of, load_kernel, loaded_or_plain
from .numerics.packs import Pack, empty_packs, packed, parts
from .occlusion.transdigital import DigitPrior, prior_correlation
from .options import KernelOptions, TrackerOptions, kernel_options
from .pipeline import track_frame
from .pose.report import LISTED_RESIDUAL, LISTED_TIME, Report, blank_report, listed_count
from .records import Model, State, blank_state

__all__ = ['HandState', 'HandTracker', 'MarkerState', 'PalmState', 'TrackerOptions']

PALM_COUNT = len(PALM_MARKERS)
REPORTS_AT_ONCE = 8  # in a block of 50 kB, which lives as long as one of its states


class HandState(NamedTuple):
    """Tracked hand of one frame.

    Attributes
    ----------
    palm : PalmState
    angles : ndarray, shape (25,)
        In the order of `JOINTS` [rad].
    wrist_rotation : ndarray, shape (3, 3)
        From the wrist's frame to the markers' frame.
    wrist_position : ndarray, shape (3,)
        In the markers' frame [m].
    pose : Pose
        The 25 links in the markers' frame: forward kinematics of the above.
    markers : ndarray, shape (n, 3)
        Positions used, measured or predicted, in the order of the layout [m].
    marker_states : ndarray of int, shape (n,)
        `MarkerState` of each marker.
    hidden_for : ndarray, shape (n,)
        Time since each marker was seen, 0 for seen ones [s].
    deviation : ndarray, shape (25,)
        Standard deviation of each angle; 0 of a locked joint [rad].
    residuals : ndarray, shape (n,)
        Distance of each seen marker from its place on the pose, NaN for hidden ones [m].
    iterations : int
        Of FABRIK, over all digits; the repetitions of the first frame do not count.
    """

    palm: PalmState
    angles: np.ndarray
    wrist_rotation: np.ndarray
    wrist_position: np.ndarray
    pose: Pose
    markers: np.ndarray
    marker_states: np.ndarray
    hidden_for: np.ndarray
    deviation: np.ndarray
    residuals: np.ndarray
    iterations: int


class HandTracker:
    """Track one hand by its markers.

    Parameters
    ----------
    hand : Hand, optional
        The mean right hand when left out.
    layout : MarkerLayout, optional
        The paper's eight markers when left out.
    options : TrackerOptions, optional

    Attributes
    ----------
    hand : Hand
        With limits that let the palm cup, where the layout shows that or the option asks for it.
    layout : MarkerLayout
    options : TrackerOptions
    restarted : bool
        Whether time jumped back with the last frame, so that tracking began anew.

    Raises
    ------
    InvalidLayout
        If the hand cannot be solved from the layout.
    TypeError
        If an argument is of another kind, such as the name of a layout.

    Examples
    --------
    >>> tracker = HandTracker(Hand.scaled(length=0.19, breadth=0.09))
    >>> state = tracker.update(markers)  # markers: (8, 3) [m], NaN where not seen
    """

    hand: Hand
    layout: MarkerLayout
    options: TrackerOptions
    restarted: bool
    _clock: Pack[FrameClock]
    _state: State
    _reports: list[Pack[Report]]
    _track_frame: Callable[..., bool] | None  # chosen by the first frame

    def __init__(self, hand: Hand | None = None, layout: MarkerLayout | None = None,
                 options: TrackerOptions | None = None) -> None:
        self._as_record = COMPILED
        self._track_frame = None
        self._set_hand(Hand.scaled() if hand is None else hand,
                       MarkerLayout() if layout is None else layout,
                       TrackerOptions() if options is None else options)
        self.reset()

    def configure(self, hand: Hand | None = None, layout: MarkerLayout | None = None,
                  options: TrackerOptions | None = None) -> None:
        """Replace hand, layout or options from the next frame on.

        The pose is kept, unless the side of the hand changes: then tracking begins anew. To a hand
        of another size, or markers in other places, the angles of seen digits go over at the rate
        of a re-entry.

        Parameters
        ----------
        hand : Hand, optional
        layout : MarkerLayout, optional
        options : TrackerOptions, optional

        Raises
        ------
        InvalidLayout
            If the hand cannot be solved from the layout.
        """
        former, worn = self.hand, self._marker_places
        self._set_hand(self.hand if hand is None else hand,
                       self.layout if layout is None else layout,
                       self.options if options is None else options)
        # Of the former hand's capsules, and of markers from its places.
        self._state.are_placed[:] = False
        self._state.palm.misfit[:] = self._state.digits.misfit[:] = 0.
        has_moved = not np.array_equal(self._marker_places, worn)
        if has_moved:
            # What was seen of the skin was seen from other places.
            self._state.palm_shape[:] = self._template
            self._state.rows.skin_shift[:] = self._state.rows.skin_shift_share[:] = 0.
            self._state.rows.misfit[:] = 1.
        if self.hand.side != former.side:
            self.reset()
        elif not has_size_of(former, self.hand):
            self.blend_in()
        elif layout is not None:
            # The tracks of the digits move to the new markers of the present pose.
            self._state.digits.mean[:, :3] = self._digit_markers(self._state.angles)
            if has_moved:
                self.blend_in()

    def blend_in(self) -> None:
        """Blend the angles of the next frame in, at the rate of a re-entry at most.

        Called before each frame for as long as a digit may need to find its bend on another hand.
        """
        # As if the digits came back.
        self._state.digits.seen[:] = self._state.rows.is_measured[:] = False
        self._state.rows.away_for[:] = np.inf
        self._state.average.consecutive[:] = 0
        self._state.pace.measured_for[:], self._state.pace.velocity[:] = np.inf, 0.

    def _set_hand(self, hand: Hand, layout: MarkerLayout, options: TrackerOptions) -> None:
        """Derive and pack all that depends on hand, layout and options alone."""
        for value, kind, example in (
                (hand, Hand, 'Hand.scaled(), or hand, layout = load_hand(FILE)'),
                (layout, MarkerLayout, "MarkerLayout(), or preset_layout('kyutech23')"),
                (options, TrackerOptions, 'TrackerOptions()')):
            if not isinstance(value, kind):
                raise TypeError(f'{value!r}; expected a {kind.__name__}, such as {example}')
        if shows_arch(layout, options.palm_arch):
            hand = hand.with_open_palm()
        right = hand.as_right()
        mounting = layout.principal_mounting(right)
        require_solvable(mounting)
        self.hand, self.layout, self.options = hand, layout, options
        rows = layout_rows(layout)
        # Rows of the layout in those of the kernels, where they are not the same.
        self._rows = None if layout.names == MARKERS else np.maximum(rows, 0)
        self._lacking = np.flatnonzero(rows < 0)
        self._listed = listed_count(layout)
        chains = digit_chains(right, mounting)
        self._right_table, self._right_mounting = joint_table(right), mounting
        self._template = mounting.position[:PALM_COUNT].copy()
        self._relaxed = right.relaxed()
        self._rest = self._digit_markers(self._relaxed)

        self._options, _ = self._packed(kernel_options(options))
        self._chains, _ = self._packed(chains)
        self._measured_chains, _ = self._packed(deepcopy(chains))
        rows_on_hand = marker_rows(right, layout, options.palm_arch)
        self._marker_places = rows_on_hand.end + rows_on_hand.offset    # on their links
        self._model, _ = self._packed(Model(
            self._template,
            DigitPrior(self._rest, prior_correlation(
                options.link_index_middle, options.link_middle_ring, options.link_ring_little)),
            noise_levers(self._template, self._rest),
            np.array((options.bound_index_middle, options.bound_middle_ring,
                      options.bound_ring_little)),
            HandBounds(chains.root.copy(), reach(chains), typical_places(right, mounting)),
            hand_capsules(right), joint_table(hand), layout.principal_mounting(hand),
            rows_on_hand,
            LEFT_HAND_MIRROR if hand.side == 'left' else np.ones(3)))
        self._blank, _ = self._packed(self._blank_state())

    def _packed(self, values: Any) -> tuple[Any, Any]:
        return packed(values, self._as_record)

    def load_kernels(self, folder: Path | None = None) -> None:
        """Load the compiled kernels of `update` from disk; any thread may call this.

        Parameters
        ----------
        folder : Path, optional
            Cache folder; the user's when left out.

        Raises
        ------
        KernelsUnavailable
            If they are not on disk.
        """
        packs = tuple(packed(deepcopy(pack[0]), as_record=True)[0]
                      for pack in self.kernel_arguments())
        load_kernel(track_frame, (*packs, np.zeros((len(MARKERS), 3)), 0.), folder)
        chains = packs[1]
        load_kernel(override_coupling, (chains, np.zeros(len(DIGITS)), chains), folder)

    def use_loaded_kernels(self) -> None:
        """Go on with the kernels that `load_kernels` has loaded; call it between two frames."""
        clock, state = self._clock[0], self._state
        self._as_record = True
        self._track_frame = None
        self._set_hand(self.hand, self.layout, self.options)
        self._clock, _ = self._packed(clock)
        self._report, _ = self._packed(blank_report())
        self._reports = []
        self._state_pack, self._state = self._packed(state)

    @property
    def is_compiled(self) -> bool:
        """Whether compiled kernels track."""
        return self._as_record

    def _kernel(self, kernel: Kernel) -> Kernel:
        return loaded_or_plain(kernel) if self._as_record else kernel

    def _blank_state(self) -> State:
        """Return the state before the first frame."""
        return blank_state(
            self._template, self._rest, self._relaxed, self.options.marker_noise)

    def _digit_markers(self, angles: np.ndarray) -> np.ndarray:
        """Return the digits' markers in the right hand's wrist frame, shape (5, 3) [m]."""
        return marker_positions(
            self._right_mounting, forward(self._right_table, angles))[PALM_COUNT:]

    def unobserved_joints(self) -> tuple[str, ...]:
        """Return the names of the joints that the layout does not show.

        Those follow another joint, or stay where they are at rest.

        Returns
        -------
        tuple of str
        """
        return unobserved_joints(self.hand, self.layout)

    @property
    def placed(self) -> bool:
        """Whether the palm has been seen; before, the pose is not a measured one."""
        return bool(self._state.wrist.placed[0])

    def reset(self) -> None:
        """Return to the state before the first frame."""
        self.restarted = False
        self._clock, _ = self._packed(initial_clock())
        self._report, _ = self._packed(blank_report())
        self._reports = []
        self._state_pack, self._state = self._packed(self._blank_state())

    def update(self, markers: ArrayLike, time: float | None = None,
               distal_flexion: ArrayLike | None = None) -> HandState:
        """Track the next frame.

        Parameters
        ----------
        markers : array_like, shape (n, 3)
            In the order of the layout, that is of `MARKERS` unless it names others [m]; a row
            with a number that is not finite, or beyond a kilometre, is not seen.
        time : float, optional
            Of the frame, on any clock; tracking begins anew when it jumps back. When left out
            frames are taken as evenly spaced, at the rate so far or 120 Hz [s].
        distal_flexion : array_like, shape (5,), optional
            Measured flexion of the last joint of each digit, which replaces its coupling; NaN
            where none is measured [rad].

        Returns
        -------
        HandState
            Always finite and within the limits; before the palm is first seen its `palm` is
            WAITING and its pose the relaxed hand at the origin.

        Raises
        ------
        ValueError
            If a shape is another.
        """
        frame = np.array(markers, dtype=float, order='C')
        if frame.shape != (len(self.layout.names), 3):
            raise ValueError(f'markers: shape {frame.shape}; expected '
                             f'{(len(self.layout.names), 3)}')
        if self._rows is not None:
            frame = frame.take(self._rows, axis=0)
            if len(self._lacking):
                frame[self._lacking] = np.nan
        if not self._reports:
            self._reports = empty_packs(self._report, REPORTS_AT_ONCE)
        report = self._reports.pop()
        arguments = (*self.kernel_arguments(distal_flexion)[:-1], report, frame,
                     np.nan if time is None else float(time))
        if self._track_frame is None:
            self._track_frame = for_types_of(self._kernel(track_frame), arguments)
        self.restarted = bool(self._track_frame(*arguments))
        return self.state_from_report(report, self._listed)

    def kernel_arguments(self, distal_flexion: ArrayLike | None = None) -> tuple[
            Pack[Model], Pack[Chains], Pack[KernelOptions], Pack[FrameClock], Pack[State],
            Pack[State], Pack[Report]]:
        """Return the arguments of `track_frame` up to the report, valid until `configure`.

        Parameters
        ----------
        distal_flexion : array_like, shape (5,), optional
            As for `update`.

        Returns
        -------
        tuple of packs
            Model, Chains, KernelOptions, FrameClock, blank State, State and Report.
        """
        chains = self._chains if distal_flexion is None else self._chains_with(distal_flexion)
        return (self._model, chains, self._options, self._clock, self._blank, self._state_pack,
                self._report)

    @staticmethod
    def state_from_report(report: Pack[Report], listed: int) -> HandState:
        """Return the `HandState` of a packed `Report`; they share their arrays.

        `listed` is the layout's `listed_count`.
        """
        (palm, angles, rotation, position, rotations, positions, markers, states, hidden_for,
         deviation, residuals, iterations, rows, kinds) = parts(report)
        if listed:
            rows, states = rows[:listed], kinds[:listed]
            markers, hidden_for, residuals = (
                rows[:, :3], rows[:, LISTED_TIME], rows[:, LISTED_RESIDUAL])
        # Unpacked, an array of one number would cost as much as the rest.
        return HandState(PALM_STATES[palm[0]], angles, rotation, position,
                         Pose(rotations, positions), markers, states, hidden_for, deviation,
                         residuals, int(iterations[0]))

    def _chains_with(self, distal_flexion: ArrayLike) -> Pack[Chains]:
        """Return the packed chains, with measured last joints in place of their couplings."""
        flexion = np.array(distal_flexion, dtype=float)
        if flexion.shape != (len(DIGITS),):
            raise ValueError(
                f'distal_flexion: shape {flexion.shape}; expected {(len(DIGITS),)}')
        self._kernel(override_coupling)(self._chains, flexion, self._measured_chains)
        return self._measured_chains

    def __getstate__(self) -> dict[str, Any]:
        """Return the attributes but the kernel, and the state's pack, which `_state` views."""
        return {name: value for name, value in self.__dict__.items()
                if name not in ('_state_pack', '_track_frame')}

    def __setstate__(self, attributes: dict[str, Any]) -> None:
        """Restore the attributes; pack the state anew, so that `_state` has views of the pack."""
        self.__dict__.update(attributes)
        self._track_frame = None
        self._state_pack, self._state = self._packed(self._state)
