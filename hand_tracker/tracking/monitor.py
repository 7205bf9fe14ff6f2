"""Monitor a stream of tracked frames: the one call a frame in front of logs and diagnostics."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from ..core.model.hand import Hand
from ..core.model.marker_layout import MarkerLayout
from ..core.model.states import PalmState
from ..core.pose.report import mean_residual
from ..core.tracker import HandState
from ..messages.labels import LabelMap
from ..messages.marker_array import MarkerFrame
from ..messages.stamps import Time
from .diagnostics import Diagnostics, Status
from .exchange_check import LabelCheck
from .fit_check import OFF_HAND_DISTANCE
from .input_monitor import InputMonitor, StateRun
from .marker_events import LabelChanges
from .setting_names import PARAMETER_NAMES, SettingNames
from .side_check import SideCheck
from .stream import TrackedFrame

ALIKE_TIME = .05    # [s] for which frames of a recording are monitored together; under `FIT_STEP`


class TrackedFrames(NamedTuple):
    """Consecutive frames that were tracked and published: one, or a batch of the fast path.

    Attributes
    ----------
    frame_count : int
        Frames; more than there are times of where a batch was too long to be logged whole.
    stamp : Time
        Of the last frame, as published.
    state : HandState
        After the last frame.
    received, published : list of float
        On a clock that never jumps [s].
    times : list of float or None
        Times of their stamps; the first is NaN where frames before it are not logged [s].
    runs : list of (float, StateRun or HandState)
        When the first and the last frame of each run was published, and its states.
    markers : MarkerFrame or None
        As read; None where the messages have the signature of the one before.
    on_fast_path : bool
    restarted : bool
        Whether time jumped back.
    """

    frame_count: int
    stamp: Time
    state: HandState
    received: list[float]
    published: list[float]
    times: list[float | None]
    runs: Sequence[tuple[float, StateRun | HandState]]
    markers: MarkerFrame | None
    on_fast_path: bool
    restarted: bool

    @classmethod
    def of(cls, frame: TrackedFrame, published: float) -> TrackedFrames:
        """Return a single frame of the slow path.

        Parameters
        ----------
        frame : TrackedFrame
        published : float
            [s]
        """
        return cls(1, frame.stamp, frame.state, [frame.received], [published], [frame.time],
                   [(published, frame.state)], frame.markers, False, frame.restarted)


class AlikeFrames:
    """Collect consecutive frames of the slow path that differ in nothing that is monitored.

    Each is like the one before in the names of its markers, and in the states of palm and markers,
    and its markers are on the hand.
    """

    def __init__(self) -> None:
        self._last: TrackedFrame | None = None
        self._published: list[float] = []   # of those collected [s]
        self._frames: list[TrackedFrame] = []
        self._residuals: list[float] = []   # [m]

    def add(self, frame: TrackedFrame, published: float) -> bool:
        """Collect a frame; return whether it is like the last one given.

        Parameters
        ----------
        frame : TrackedFrame
        published : float
            [s]
        """
        last, self._last = self._last, frame
        if last is None or not _are_alike(last, frame):
            return False
        residual = mean_residual(frame.state.residuals)
        if not residual <= OFF_HAND_DISTANCE:
            return False
        self._frames.append(frame)
        self._published.append(published)
        self._residuals.append(residual)
        return True

    @property
    def duration(self) -> float:
        """Time over which those collected were published [s]."""
        return self._published[-1] - self._published[0] if self._published else 0.

    def pop(self) -> TrackedFrames | None:
        """Return the collected frames, and begin anew; None where there are none."""
        frames, published, residuals = self._frames, self._published, self._residuals
        if not frames:
            return None
        self._frames, self._published, self._residuals = [], [], []
        stamp, state = frames[-1].stamp, frames[-1].state
        run = StateRun(state.palm, state.marker_states, np.array([np.mean(residuals)]))
        return TrackedFrames(
            len(frames), stamp, state, [frame.received for frame in frames], published,
            [frame.time for frame in frames], [(published[0], run), (published[-1], run)], None,
            False, False)


def _are_alike(last: TrackedFrame, frame: TrackedFrame) -> bool:
    """Return whether a frame differs from the last one in nothing that is monitored."""
    return (not frame.restarted and frame.state.palm is PalmState.TRACKED is last.state.palm
            and frame.state.marker_states.tobytes() == last.state.marker_states.tobytes()
            and frame.stamp != last.stamp
            # All but stamp, positions and points without labels
            and frame.markers.frame_id == last.markers.frame_id
            and frame.markers[3:-1] == last.markers[3:-1])


class Monitor:
    """Monitor the tracking of one hand.

    Parameters
    ----------
    now : float
        Of a clock that never jumps, as in every method [s].
    topic : str
        Where the markers come from.
    labels : LabelMap
    names : SettingNames, optional
        Those of the node's parameters when left out.

    Attributes
    ----------
    names
    label_fault : str or None
        Why the labels of the source are of no use.
    labels_are_right : bool or None
        Whether none look exchanged; None while that is not known.
    """

    def __init__(self, now: float, topic: str, labels: LabelMap,
                 names: SettingNames = PARAMETER_NAMES) -> None:
        self.names = names
        self.label_fault: str | None = None
        self.labels_are_right: bool | None = None
        self._input = InputMonitor(now, topic, labels, names)
        self._diagnostics = Diagnostics(now, self._input)
        self._label_changes = LabelChanges(len(labels.names), labels.not_of)
        self._alike = AlikeFrames()
        self._side_check: SideCheck | None = None
        self._new_side_check: Callable[[], SideCheck] | None = None
        self._exchange_check: LabelCheck | None = None
        self._last: tuple[HandState, float | None] | None = None  # frame, and its time [s]

    def check_side(self, hand: Hand, layout: MarkerLayout) -> None:
        """Check in the frames to come whether the hand is of this side, until it is seen to be."""
        self._new_side_check = partial(SideCheck, hand.side, layout.principal)
        self._side_check = self._new_side_check()

    def pair_with(self, other: Monitor) -> None:
        """Take another monitor for that of the person's other hand, and this for its."""
        self._input.other_hand, other._input.other_hand = other._input, self._input

    def check_exchange(self, check: LabelCheck | None) -> None:
        """Check in the frames to come whether labels of digits are exchanged; None for no check."""
        self._exchange_check = check
        self._forget_exchange()

    def set_labels(self, labels: LabelMap) -> None:
        """Expect other labels from the next message on."""
        if labels.labels != self._input.labels.labels:
            self.label_fault = None
            self._label_changes = LabelChanges(len(labels.names), labels.not_of)
            self._begin_exchange_check()
        self._input.labels = labels

    def forget_fit(self) -> None:
        """Judge the fit of the hand anew: of another one, by other labels or in another unit."""
        self._input.fit.forget()

    @property
    def residual(self) -> float:
        """Mean distance of the last frame's seen markers from the hand, 0 without one [m]."""
        return self._input.fit.residual

    @property
    def is_wrong(self) -> bool:
        """Whether the markers are not the tracked hand's, so that no pose is published."""
        return self._input.is_wrong

    @property
    def needs_each_frame(self) -> bool:
        """Whether each frame is to be seen: to leave it out, or to find labels of no use."""
        return self._input.is_wrong or self._input.events.exchanges_many

    def judge(self, received: float, frame: TrackedFrame | MarkerFrame) -> TrackedFrame | None:
        """Invalidate a result of `Stream.track` if earlier frames show another hand's markers.

        Parameters
        ----------
        received : float
            On a clock that never jumps [s].
        frame : TrackedFrame or MarkerFrame

        Returns
        -------
        TrackedFrame or None
            Not valid where the markers are of another hand; None, and noted, for a message
            without any marker of the hand, which may be of something else.
        """
        if isinstance(frame, TrackedFrame):
            return frame._replace(is_valid=False) if self._input.is_wrong else frame
        self._flush()
        self._input.received(received, frame)
        self.label_fault = self._label_changes.add(frame, received)
        return None

    def add(self, frame: TrackedFrame, published: float) -> None:
        """Note a frame of a recording; those alike are noted together.

        Parameters
        ----------
        frame : TrackedFrame
        published : float
            [s]
        """
        is_alike = not self._input.is_wrong and self._alike.add(frame, published)
        if not is_alike or self._alike.duration >= ALIKE_TIME:
            self._flush()
            self._find_exchanged_labels()  # more often than lines are asked for
        if not is_alike:
            self.update(TrackedFrames.of(frame, published))

    def _flush(self) -> None:
        """Note the frames that are collected."""
        if (frames := self._alike.pop()) is not None:
            self.update(frames)

    def update(self, frames: TrackedFrames) -> bool:
        """Note frames that were tracked and published.

        Parameters
        ----------
        frames : TrackedFrames

        Returns
        -------
        bool
            Whether the status has changed, so that it is to be published before its period is
            over. The tracker node drains frames to here every `REPORT_PERIOD`.
        """
        for received, published, time in zip(frames.received, frames.published, frames.times):
            self._diagnostics.latency.add(published - received, time)
        if frames.markers is None:
            self._input.received_alike(frames.received[-1], frames.stamp)
        else:
            self._input.received(frames.received[-1], frames.markers)
            self.label_fault = self._label_changes.add(frames.markers, frames.received[-1])
        if frames.restarted:
            self._input.restarted()
            self._begin_exchange_check()
        for published, states in frames.runs:
            self._input.tracked(published, states)
        self._last = frames.state, frames.times[-1]
        return self._diagnostics.tracked(
            frames.published[-1], frames.state, frames.frame_count, frames.on_fast_path,
            frames.runs)

    def set_size(self, size: str, learned: str = '') -> None:
        """Note how far the hand's size is learned, as of `Stream.size` and `learned_size`."""
        self._diagnostics.size, self._input.learned_size = size, learned

    def set_labelling(self, awaits_labelling: bool, why_not_found: str) -> None:
        """Note how points are labelled, as of `Stream`."""
        self._input.awaits_labelling = awaits_labelling
        self._input.why_not_found = why_not_found

    def set_calibration(self, values: dict[str, str]) -> None:
        """Note how far a calibration is, as of `LiveCalibration.values`."""
        self._diagnostics.calibration = values

    def left_out(self, count: int) -> None:
        """Count frames that were left out, as newer ones had come before they could be tracked."""
        self._diagnostics.left_out(count)

    def warn_once(self, key: Hashable, text: str) -> None:
        """Log a warning once for each key."""
        self._input.warn_once(key, text)

    def received_unreadable(self, key: Hashable, fault: str) -> None:
        """Note a message that is none of markers, see `InputMonitor.received_unreadable`."""
        self._input.received_unreadable(key, fault)

    def log_lines(self, now: float, publishers: Callable[[], str | None]) -> list[tuple[bool, str]]:
        """Return the lines to log at `now` [s], see `InputMonitor.report`."""
        self._flush()
        self._check_side_of_hand()
        self._find_exchanged_labels()
        return self._input.report(now, publishers)

    def status(self, now: float, publishers: Callable[[], str | None]) -> Status:
        """Return the status for /diagnostics at `now` [s], see `Diagnostics.status`."""
        return self._diagnostics.status(now, publishers)

    def ended(self) -> None:
        """Note the end of the input."""
        self._flush()
        self._input.ended()

    def side_fault(self) -> str | None:
        """Return why a hand is of the other side, or None."""
        return self._input.side_fault()

    def why_never_tracked(self) -> str:
        """Explain why no frame at all was tracked."""
        return self._input.why_never()

    def _check_side_of_hand(self) -> None:
        """Check the side by the last frame, until it is known."""
        if self._side_check is None or self._last is None:
            return
        if self._input.note_side(self._side_check.side, self._side_check.add(*self._last)):
            self._side_check = None

    def _find_exchanged_labels(self) -> None:
        """Check by the last frame which labels of digits are exchanged."""
        check = self._exchange_check
        if check is None or self._last is None or (
                # By usual places the fingers of the other hand look exchanged.
                self._input.is_wrong and check.needs_side):
            return
        rather = check.add(*self._last)
        if rather is None:
            return
        if self.labels_are_right is False and not rather and self._new_side_check is not None:
            # Exchanged labels of the palm looked like a hand of the other side.
            self._side_check, self._input.bends_away_from = self._new_side_check(), None
        self.labels_are_right = not rather
        self._input.exchanged(rather)

    def _begin_exchange_check(self) -> None:
        """Check the labels anew, as if no frame had come yet."""
        if self._exchange_check is not None:
            self._exchange_check.begin()
        self._forget_exchange()

    def _forget_exchange(self) -> None:
        self.labels_are_right = None
        self._input.exchanged({})
