"""A recording that a command tracks: progress, log lines, interruption."""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Protocol

from ..core.model.hand import Hand
from ..core.model.marker_layout import MarkerLayout
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
from .recording_options import recorded_hands, recorded_reading

LOG_PERIOD = .25     # [s] of the recording
FEW_SHARE = .5       # of the frames, below which the end says in how few the palm is seen
WITHOUT_HAND_FILE = (
    'no hand file: markers count as at the joints; where they are worn on the skin, PIP is tens of '
    'degrees off until a hand is fitted (hand_tracker calibrate)')
PALM_SEEN = (PalmState.TRACKED, PalmState.CARRIED)
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
    layout : MarkerLayout

    Attributes
    ----------
    layout : MarkerLayout
    read, tracked, held : int
        Number of messages read, of those with a tracked hand, and of these without any palm.
    """

    def __init__(self, bag: Bag, topic: str, interrupted: Interruptions,
                 progress: ProgressMaker, layout: MarkerLayout) -> None:
        self.layout = layout
        self.read = self.tracked = self.held = 0
        self._bag, self._topic, self._interrupted = bag, topic, interrupted
        self._progress = progress(bag.counts[topic], 'frames')
        self._monitors: dict[str, Monitor] = {}  # by hand
        self._trackers: dict[str, HandTracker] = {}
        self._has_labels = True
        self._palms: Counter[str] = Counter()    # frames that show the palm, by hand
        self._misfits: Counter[str] = Counter()  # and in which the markers are of no such hand

    @property
    def hand(self) -> Hand:
        """The hand with which the last frame was tracked: its size may have been learned."""
        hand, *_ = self.hands.values()
        return hand

    @property
    def hands(self) -> dict[str, Hand]:
        """The hands with which the last frame was tracked, by their names."""
        assert self._trackers, 'no frame was asked for yet'
        return {name: tracker.hand for name, tracker in self._trackers.items()}

    @property
    def needs_hand_file(self) -> bool:
        """Whether the markers count as at the joints, though they are on the skin."""
        is_landmarks = isinstance(self._bag, PointBag) and self._bag.is_landmarks
        return not self.layout.offsets.any() and not is_landmarks

    def say(self, note: str) -> None:
        """Print a note on the recording."""
        self._progress.say(f'{self._bag.path}: {note}')

    def frames(self, tracker: HandTracker, reading: MarkerReading,
               auto_size: bool) -> Iterator[RecordedFrame]:
        """Yield the tracked frames of one hand, see `tracking.recording.track`."""
        for frames in self.frames_of_hands({'': (tracker, reading)}, auto_size):
            yield frames['']

    def frames_of_hands(self, hands: Mapping[str, tuple[HandTracker, MarkerReading]],
                        auto_size: bool) -> Iterator[dict[str, RecordedFrame]]:
        """Yield the tracked frames of several hands, by their names."""
        self._trackers = {name: tracker for name, (tracker, _) in hands.items()}
        point_labels = PointLabels()
        names, source = BAG_OPTION_NAMES, self._topic
        if isinstance(self._bag, PointBag):
            names, source = FILE_OPTION_NAMES, self._bag.path.name
        self._has_labels = all(reading.has_labels for _, reading in hands.values())
        recorded = {}
        for name, (tracker, reading) in hands.items():
            monitor = Monitor(1e-9 * self._bag.start, source, reading.labels, names)
            self._monitors[name] = monitor
            recorded[name] = RecordedHand(tracker, reading, monitor, auto_size, point_labels)
            if not reading.has_labels and (
                    warning := usual_shape_warning(tracker.hand, tracker.layout)):
                self.say(_whose(name) + warning)
        messages = self._progress.over(self._monitored())
        for frames in track_hands(messages, recorded, self._progress.say):
            self.tracked += 1
            shown = [name for name, frame in frames.items() if frame.state.palm in PALM_SEEN]
            self._palms.update(shown)
            self.held += not shown
            yield frames
        self._require_tracked()
        for name, (_, reading) in hands.items():
            self._warn_of_few(name, reading.has_labels, names.labels)

    def _warn_of_few(self, name: str, has_labels: bool, labels: str) -> None:
        """Say in how few frames a hand was seen, and which option may cure it."""
        if self._palms[name] >= FEW_SHARE * self.read:
            return
        if self._misfits[name] > self.read - self._palms[name] - self._misfits[name]:
            self.say(f'{_whose(name)}in {self._misfits[name]} of {self.read} frames the hand is '
                     'left out, as it does not fit the markers; one that is fitted to them does '
                     '(hand_tracker calibrate, then --hand)')
            return
        cure = (f'other labels than meant ({labels}), or labels of no use '
                f'(--labels {WITHOUT_LABELS})' if has_labels else 'another layout (--layout)')
        self.say(f'{_whose(name)}only {self._palms[name]} of {self.read} frames show the palm; in '
                 'the others the hand is left out, or keeps its last pose. Are its markers hidden '
                 f'there? Else: {cure}')

    def _require_tracked(self) -> None:
        for name, monitor in self._monitors.items():
            if (fault := monitor.side_fault()) is not None:
                raise BagError(f'{self._bag.path}: {_whose(name)}{fault}')
        if not self._palms:
            why = '; '.join(_whose(name) + monitor.why_never_tracked()
                            for name, monitor in self._monitors.items())
            other = '' if self._has_labels else (
                '; is it a hand of the other side (--side), or of another layout (--layout)?')
            which = '' if isinstance(self._bag, PointBag) else f' of {self._topic}'
            raise BagError(f'{self._bag.path}: no frame{which} shows the palm: {why}{other}')

    def _monitored(self) -> Iterator[BagMessage]:
        due = self._bag.start
        now = None
        for message in self._bag.messages([self._topic]):
            if self._interrupted:
                raise self._interrupted[0]
            self.read += 1
            now = message.time
            yield message
            for name, monitor in self._monitors.items():
                if monitor.is_wrong:
                    self._misfits[name] += 1
            if now >= due:
                due = now + int(1e9 * LOG_PERIOD)
                self._report(now)
        if now is not None:
            for monitor in self._monitors.values():
                monitor.ended()
            self._report(now)

    def _report(self, now: int) -> None:
        for name, monitor in self._monitors.items():
            for _, line in monitor.log_lines(1e-9 * now, str):
                self._progress.say(
                    f'at {1e-9 * (now - self._bag.start):.2f} s: {_whose(name)}{line}')


def _whose(name: str) -> str:
    return f'{name} hand: ' if name else ''


@contextmanager
def tracked_recording(
        options: argparse.Namespace, interrupted: Interruptions,
        progress: ProgressMaker = Progress,
) -> Iterator[tuple[Hand, TrackingJob, Iterator[RecordedFrame]]]:
    """Track the recording that a command line asks for.

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
    hand : Hand
    job : TrackingJob
    frames : iterator of RecordedFrame
    """
    with _opened_job(options, interrupted, progress) as (job, hands):
        (_, (tracker, reading)), = hands.items()
        yield tracker.hand, job, job.frames(tracker, reading, _learns_size(options))


@contextmanager
def tracked_hands(
        options: argparse.Namespace, interrupted: Interruptions,
        progress: ProgressMaker = Progress,
) -> Iterator[tuple[TrackingJob, Iterator[dict[str, RecordedFrame]]]]:
    """Track both hands in the recording that a command line asks for.

    Parameters
    ----------
    options, interrupted, progress
        See `tracked_recording`.

    Yields
    ------
    job : TrackingJob
    frames : iterator of dict of str to RecordedFrame
        By side.
    """
    with _opened_job(options, interrupted, progress) as (job, hands):
        yield job, job.frames_of_hands(hands, _learns_size(options))


@contextmanager
def _opened_job(options: argparse.Namespace, interrupted: Interruptions, progress: ProgressMaker
                ) -> Iterator[tuple[TrackingJob, dict[str, tuple[HandTracker, MarkerReading]]]]:
    """Open the recording, and yield the hands by their sides."""
    worn, recording = recorded_hands(options)
    hands = {one.hand.side: (HandTracker(one.hand, one.layout),
                             recorded_reading(options, recording, one.labels)) for one in worn}
    with open_recording(recording, partial=options.partial) as bag:
        job = TrackingJob(bag, marker_topic(bag, options.topic), interrupted, progress,
                          worn[0].layout)
        for note in bag.notes:
            job.say(note)
        if options.hand is None and job.needs_hand_file:
            job.say(WITHOUT_HAND_FILE)
        yield job, hands


def _learns_size(options: argparse.Namespace) -> bool:
    return options.auto_size and options.hand is None
