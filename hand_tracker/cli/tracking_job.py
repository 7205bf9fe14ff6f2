"""A recording that a command tracks: progress, log lines, interruption."""

from __future__ import annotations

import argparse
import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from itertools import combinations
from typing import Any, Protocol

from ..core.model.hand import Hand
from ..core.model.layout_presets import skin_preset
from ..core.model.states import PalmState
from ..core.tracker import HandTracker
from ..files.bags import Bag, BagError, BagMessage
from ..messages.labels import WITHOUT_LABELS
from ..parallel import Interruptions
from ..progress import Progress
from ..tracking.monitor import Monitor
from ..tracking.opened_recording import open_recording
from ..tracking.point_bag import PointBag
from ..tracking.point_labels import PointLabels, usual_shape_warning
from ..tracking.recording import (
    MarkerReading,
    RecordedFrame,
    RecordedHand,
    marker_topic,
    track_hands,
)
from ..tracking.setting_names import BAG_OPTION_NAMES, FILE_OPTION_NAMES
from ..tracking.stream import LearnedSize
from ..tracking.unobserved_note import unobserved_note
from .recording_options import hand_notes, recorded_hands, recorded_reading

LEARNING_SPAN = 60.  # [s] from the first tracked frame that a size is learned from, at most
LOG_PERIOD = .25     # [s] of the recording
FEW_SHARE = .5       # of the frames, below which the end says in how few the palm is seen
MUCH_LEFT_OUT = .1   # of the frames, above which the end says so, and why
DOES_NOT_FIT = ('it does not fit the markers; one that is fitted to them does (hand_tracker '
                'calibrate, then --hand)')
AT_THE_JOINTS = (
    'no hand file: markers count as at the joints; where they are worn on the skin, PIP is tens of '
    'degrees off until a hand is fitted (hand_tracker calibrate); --layout paper8_skin takes them '
    'for on the back of a usual hand')
PALM_SEEN = (PalmState.TRACKED, PalmState.CARRIED)
WORN_ELSEWHERE = (
    'no hand file: --layout {} has these markers where people wear them, not at the joints; a hand '
    'that is fitted to yours is nearer (hand_tracker calibrate)')
# Returns what shows the progress of a number of pieces of a name.
ProgressMaker = Callable[[int, str], 'ProgressDisplay']


class ProgressDisplay(Protocol):
    """What shows the progress of work: a `Progress` here, a `MessageCollector` in a worker."""

    @property
    def say(self) -> Callable[[str], None]: ...

    @property
    def over(self) -> Callable[[Iterable[Any]], Iterable[Any]]: ...


class TrackingJob:
    """Track one recording: count its frames, and print what the monitors log.

    Parameters
    ----------
    bag : Bag
    topic : str
        Of the markers.
    interrupted : list
        Not empty when an interruption came; see `run_command`.
    progress : callable
        Returns a `Progress` or what stands in for it.
    hands : mapping of str to (HandTracker, MarkerReading)
        By their sides.
    learns_size : bool
        Whether the size of the hands is learned, before the first frame is tracked.

    Attributes
    ----------
    layout : MarkerLayout
        Of the hands.
    read, tracked, held : int
        Number of messages read, of those with a tracked hand, and of these without any palm.
    late : float
        Time from the beginning of the recording to the first tracked frame [s].
    """

    def __init__(self, bag: Bag, topic: str, interrupted: Interruptions,
                 progress: ProgressMaker,
                 hands: Mapping[str, tuple[HandTracker, MarkerReading]],
                 learns_size: bool) -> None:
        (tracker, _), *_ = hands.values()
        self.layout = tracker.layout
        self.read = self.tracked = self.held = 0
        self.late = 0.
        self._bag, self._topic, self._interrupted = bag, topic, interrupted
        self._progress = progress(bag.counts[topic], 'frames')
        self._hands, self._learns_size = hands, learns_size
        self._monitors: dict[str, Monitor] = {}  # by side
        self._palms: Counter[str] = Counter()    # frames that show the palm, by side
        self._residuals, self._judged = 0., 0
        self._misfits: Counter[str] = Counter()  # and in which the markers are of no such hand

    def hands(self) -> dict[str, Hand]:
        """Return the hands of the last frame by their sides: their size may have been learned."""
        return {side: tracker.hand for side, (tracker, _) in self._hands.items()}

    @property
    def zero(self) -> int | None:
        """Time at which the clock of a file of points is 0 [ns]."""
        return self._bag.zero

    @property
    def residual(self) -> float:
        """Mean distance of the seen markers from the hands, over the tracked frames [m]."""
        return self._residuals / max(self._judged, 1)

    @property
    def without_hand_file(self) -> str:
        """What to say without a hand file, of markers that people wear elsewhere; else empty."""
        if isinstance(self._bag, PointBag) and self._bag.is_landmarks:
            return ''
        if not self.layout.offsets.any():
            return AT_THE_JOINTS
        skin = skin_preset(self.layout)
        return skin and WORN_ELSEWHERE.format(skin)

    def say(self, note: str) -> None:
        """Print a note on the recording."""
        self._progress.say(f'{self._bag.path}: {note}')

    def frames(self) -> Iterator[dict[str, RecordedFrame]]:
        """Yield the tracked frames, of each message those of the hands by their sides."""
        sizes = self._learned_sizes() if self._learns_size else {}
        point_labels = PointLabels()
        names, source = BAG_OPTION_NAMES, self._topic
        if isinstance(self._bag, PointBag):
            names, source = FILE_OPTION_NAMES, self._bag.path.name
        recorded = {}
        for side, (tracker, reading) in self._hands.items():
            monitor = Monitor(1e-9 * self._bag.start, source, reading.labels, names)
            self._monitors[side] = monitor
            if not reading.has_labels and (
                    warning := usual_shape_warning(tracker.hand, tracker.layout)):
                self.say(self._whose(side) + warning)
            if note := unobserved_note(tracker):
                self.say(self._whose(side) + note)
            recorded[side] = RecordedHand(
                tracker, reading, monitor, self._learns_size, point_labels, sizes.get(side))
        for one, other in combinations(self._monitors.values(), 2):
            one.pair_with(other)
        messages = self._progress.over(self._monitored())
        for frames in track_hands(messages, recorded, self._progress.say):
            if not self.tracked:
                self.late = 1e-9 * (next(iter(frames.values())).time - self._bag.start)
            self.tracked += 1
            for side in frames:
                if residual := self._monitors[side].residual:
                    self._residuals += residual
                    self._judged += 1
            shown = [side for side, frame in frames.items() if frame.state.palm in PALM_SEEN]
            self._palms.update(shown)
            self.held += not shown
            yield frames
        self._require_tracked()
        few = {side: self._palms[side] < FEW_SHARE * self.read for side in self._hands}
        for side, (_, reading) in self._hands.items():
            if few[side]:
                self._warn_of_few(side, reading.has_labels, names.labels)
        if not any(few.values()):
            self._warn_of_left_out()

    def _learned_sizes(self) -> dict[str, LearnedSize | None]:
        """Return the sizes that the recording tells, so that all its frames are tracked by them."""
        point_labels = PointLabels()
        hands = {side: RecordedHand(
            HandTracker(tracker.hand, tracker.layout), reading,
            # It judges the labels; its lines come with the frames that are written.
            Monitor(1e-9 * self._bag.start, self._topic, reading.labels), True, point_labels)
            for side, (tracker, reading) in self._hands.items()}
        until = math.inf
        for message in self._messages():
            tracked = [hand.track(message) for hand in hands.values()]
            if any(tracked):
                until = min(until, message.time + 1e9 * LEARNING_SPAN)
            if message.time > until or not any(hand.learns_size for hand in hands.values()):
                break
        return {side: hand.found_size for side, hand in hands.items()}

    def _messages(self) -> Iterator[BagMessage]:
        for message in self._bag.messages([self._topic]):
            if self._interrupted:
                raise self._interrupted[0]
            yield message

    def _warn_of_left_out(self) -> None:
        """Say how much of the recording is left out, and the main reason, if it is much."""
        left_out = self.read - self.tracked
        if left_out <= MUCH_LEFT_OUT * self.read:
            return
        is_misfit = 2 * sum(self._misfits.values()) > left_out
        self.say(f'{left_out} of {self.read} frames ({left_out / self.read:.0%}) are left out: '
                 + (f'the hand is there, but {DOES_NOT_FIT}' if is_misfit else
                    'no hand is found in most of these; are its markers hidden there, or other '
                    'labels than meant?'))

    def _warn_of_few(self, side: str, has_labels: bool, labels: str) -> None:
        """Say in how few frames a hand was seen, and which option may cure it."""
        whose = self._whose(side)
        if self._misfits[side] > self.read - self._palms[side] - self._misfits[side]:
            self.say(f'{whose}in {self._misfits[side]} of {self.read} frames the hand is '
                     f'left out, as {DOES_NOT_FIT}')
            return
        cure = (f'other labels than meant ({labels}), or labels of no use '
                f'(--labels {WITHOUT_LABELS})' if has_labels else 'another layout (--layout)')
        self.say(f'{whose}only {self._palms[side]} of {self.read} frames show the palm; in '
                 'the others the hand is left out, or keeps its last pose. Are its markers hidden '
                 f'there? Else: {cure}')

    def _require_tracked(self) -> None:
        for side, monitor in self._monitors.items():
            if (fault := monitor.side_fault()) is not None:
                raise BagError(f'{self._bag.path}: {self._whose(side)}{fault}')
        if not self._palms:
            why = '; '.join(self._whose(side) + monitor.why_never_tracked()
                            for side, monitor in self._monitors.items())
            has_labels = all(reading.has_labels for _, reading in self._hands.values())
            other = '' if has_labels else (
                '; is it a hand of the other side (--side), or of another layout (--layout)?')
            which = '' if isinstance(self._bag, PointBag) else f' of {self._topic}'
            raise BagError(f'{self._bag.path}: no frame{which} shows the palm: {why}{other}')

    def _monitored(self) -> Iterator[BagMessage]:
        due = self._bag.start
        now = None
        for message in self._messages():
            self.read += 1
            now = message.time
            yield message
            for side, monitor in self._monitors.items():
                if monitor.is_wrong:
                    self._misfits[side] += 1
            if now >= due:
                due = now + int(1e9 * LOG_PERIOD)
                self._report(now)
        if now is not None:
            for monitor in self._monitors.values():
                monitor.ended()
            self._report(now)

    def _report(self, now: int) -> None:
        for side, monitor in self._monitors.items():
            for _, line in monitor.log_lines(1e-9 * now, str):
                since = self._bag.start if self.zero is None else self.zero
                self._progress.say(
                    f'at {1e-9 * (now - since):.2f} s: {self._whose(side)}{line}')

    def _whose(self, side: str) -> str:
        return f'{side} hand: ' if len(self._hands) > 1 else ''


@contextmanager
def tracking_job(options: argparse.Namespace, interrupted: Interruptions,
                 progress: ProgressMaker = Progress) -> Iterator[TrackingJob]:
    """Open the recording that a command line asks for, to track its hand or both.

    Parameters
    ----------
    options : argparse.Namespace
        With all that `add_recording_options` adds.
    interrupted : list
        Not empty when an interruption came; see `run_command`.
    progress : callable
        Returns a `Progress` or what stands in for it.

    Yields
    ------
    TrackingJob
    """
    worn, recording = recorded_hands(options)
    hands = {one.hand.side: (HandTracker(one.hand, one.layout),
                             recorded_reading(options, recording, one.labels)) for one in worn}
    with open_recording(recording, partial=options.partial) as bag:
        job = TrackingJob(bag, marker_topic(bag, options.topic), interrupted, progress, hands,
                          options.auto_size and options.hand is None)
        for note in (*bag.notes, *hand_notes(options, worn)):
            job.say(note)
        if options.hand is None and job.without_hand_file:
            job.say(job.without_hand_file)
        yield job
