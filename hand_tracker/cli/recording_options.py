"""Options, progress and interruption of the commands that track recordings."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ..core.errors import HandTrackerError
from ..core.model.hand import BOTH, COUPLING_PRESETS, LIMIT_PRESETS, SIDES, Hand
from ..core.model.layout_presets import LAYOUT_PRESETS
from ..core.model.marker_layout import MARKERS, MarkerLayout
from ..core.tracker import HandTracker
from ..files.bags import Bag, BagError, BagMessage, open_bag
from ..files.hand_file import choose_hand
from ..files.point_recording import HANDEDNESS, UNIT_SPELLINGS, UP_AXES
from ..files.recordings import ReadingOptions, is_bag
from ..messages.labels import InvalidLabel, LabelMap, default_labels, label_maps
from ..parallel import Interruptions, raise_on_interruption
from ..progress import Progress
from ..tracking.monitor import Monitor
from ..tracking.opened_recording import (
    MarkerChoice,
    PointBag,
    named_labels,
    open_recording,
)
from ..tracking.point_labels import LABEL_SOURCES, PointLabels
from ..tracking.recording import (
    USUAL_TOPIC,
    RecordedFrame,
    RecordedHand,
    marker_topic,
    track,
    track_hands,
)

LOG_PERIOD = .25     # [s] of the recording


def add_hand_options(parser: argparse.ArgumentParser, both: bool = False) -> None:
    """Add the options of a command line that `choose_hand` takes: hand, side, limits, coupling.

    Parameters
    ----------
    parser : argparse.ArgumentParser
    both : bool, optional
        Whether the side may be both.
    """
    parser.add_argument('--hand', metavar='FILE', help='hand file (YAML); default: the mean hand')
    parser.add_argument('--side', choices=(*SIDES, BOTH) if both else SIDES,
                        help="default: the hand file's, else right")
    parser.add_argument('--limits', choices=LIMIT_PRESETS,
                        help="default: the hand file's, else paper")
    parser.add_argument('--coupling', choices=tuple(COUPLING_PRESETS),
                        help="of DIP to PIP; default: the hand file's, else natural")


def add_layout_option(parser: argparse.ArgumentParser,
                      otherwise: str = "the hand file's, else paper8") -> None:
    """Add the option of a command line that names another marker layout than the default one."""
    parser.add_argument('--layout', metavar='NAME|FILE',
                        help="markers that are worn: a layout file (YAML), or one of "
                        f"{', '.join(LAYOUT_PRESETS)}; default: {otherwise}")


def _scale(text: str) -> float:
    try:
        scale = float(text)
    except ValueError:
        scale = math.nan
    if not 0. < scale < math.inf:
        raise argparse.ArgumentTypeError(f"'{text}'; expected a positive number")
    return scale


def add_recording_options(parser: argparse.ArgumentParser, several: bool = False,
                          both: bool = False,
                          located: Callable[[str], Any] = Path) -> None:
    """Add to a command line the recording, how to read it and whose hand it shows.

    Parameters
    ----------
    parser : argparse.ArgumentParser
    several : bool, optional
        Whether there may be several: `recordings`.
    both : bool, optional
        Whether both hands of a recording may be asked for.
    located : callable, optional
        Returns where a recording is by the text of the command line.
    """
    name = 'recordings' if several else 'recording'
    count: dict[str, Any] = {'nargs': '+'} if several else {}
    parser.add_argument(name, type=located, metavar='IN', **count,
                        help='recording: rosbag2 (a folder, .mcap or .db3), C3D, TRC, Qualisys '
                        'TSV, OptiTrack or Vicon CSV, BVH, npz')
    add_hand_options(parser, both)
    add_layout_option(parser)
    if both:
        for side in SIDES:
            parser.add_argument(
                f'--{side}-markers', default=f'{side}/0', metavar='NS/ID', help='with --side both: '
                f"namespace and first id of the {side} hand's markers, or that id alone; default: "
                '%(default)s')
    parser.add_argument('--auto-size', action=argparse.BooleanOptionalAction, default=True,
                        help="learn the hand's size from the first seconds, where no hand file "
                        'gives it')
    parser.add_argument('--labels', choices=LABEL_SOURCES, default=LABEL_SOURCES[0],
                        help='source: markers have labels; none: they are points without usable '
                        'ids, and are labelled; default: source')
    add_marker_options(parser)


def add_marker_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of a command line that say how markers are read from a recording.

    Parameters
    ----------
    parser : argparse.ArgumentParser
    """
    parser.add_argument('--topic', help=f'of the markers; default: {USUAL_TOPIC}, else the only '
                        'one with a MarkerArray')
    parser.add_argument('--frame', default='', help='frame of the markers: those in another are '
                        'left out; default: whichever they have')
    parser.add_argument('--label', action='append', default=[], metavar='MARKER=LABEL',
                        help="which marker is which, as index=leds/12; default: ids from 0 on")
    parser.add_argument('--unit-scale', type=_scale, default=1., metavar='S',
                        help='metres per unit of the markers: 0.001 for mm')
    parser.add_argument('--keep-zeros', action='store_true',
                        help='take a marker at exactly (0, 0, 0) for seen, not for lost')
    parser.add_argument('--markers', action='append', default=[], metavar='MARKER=LABEL,...',
                        help='which point of a file is which marker, as index=LFIN: those that '
                        'their labels do not tell')
    add_reading_options(parser)


def add_reading_options(parser: argparse.ArgumentParser) -> None:
    """Add to a command line how a file of points is read, where it is not as recognised.

    Parameters
    ----------
    parser : argparse.ArgumentParser
    """
    parser.add_argument('--units', choices=tuple(UNIT_SPELLINGS),
                        help='unit of a file of points; default: as the file says')
    # Joined by =, as one that begins with a minus looks like an option.
    parser.add_argument('--up', choices=UP_AXES, help='upward axis of a file of points, as z or '
                        '--up=-y; default: as the file says, else as its format has it')
    parser.add_argument('--handed', choices=HANDEDNESS,
                        help="handedness of a file's axes; default: as the hand in it tells")
    parser.add_argument('--partial', action='store_true',
                        help='read a file that is cut as far as it goes')


def reading_options(options: argparse.Namespace) -> ReadingOptions:
    """Return how the command line wants a file of points to be read."""
    return ReadingOptions(options.units, options.up, options.handed,
                          not getattr(options, 'keep_zeros', False), options.partial)


def chosen_labels(texts: Iterable[str], names: Sequence[str] = MARKERS) -> dict[str, str]:
    """Return the label of each marker that a command line's MARKER=LABEL,... texts name."""
    return named_labels(','.join(texts), names)


def label_map(texts: Iterable[str], names: Sequence[str] = MARKERS) -> LabelMap:
    """Return the labels of a command line's MARKER=LABEL texts; ids from 0 where none is given."""
    return LabelMap(_label_texts(texts, names), names)


def _label_texts(texts: Iterable[str], names: Sequence[str] = MARKERS) -> list[str]:
    labels = dict(zip(names, default_labels(names)))
    for text in texts:
        marker, given, label = text.partition('=')
        if not given or marker not in labels:
            raise InvalidLabel(f"label: '{text}'; expected MARKER=LABEL, the marker being one of "
                               f'{", ".join(names)}')
        labels[marker] = label
    return list(labels.values())


class Job:
    """Track one recording: count its frames, and print what the monitor logs."""

    def __init__(self, bag: Bag, topic: str, labels: LabelMap, interrupted: Interruptions,
                 progress: Callable[..., Any], layout: MarkerLayout) -> None:
        self.layout = layout
        self.read = self.tracked = 0
        self._bag, self._topic, self._labels = bag, topic, labels
        self._progress = progress(bag.counts[topic], 'frames')
        self._monitor = Monitor(1e-9 * bag.start, topic, labels)
        self._monitors = {'': self._monitor}  # by what their lines begin with
        self._interrupted = interrupted
        self._tracker: HandTracker | None = None

    @property
    def hand(self) -> Hand:
        """The hand with which the last frame was tracked: its size may have been learned."""
        assert self._tracker is not None, 'no frame was asked for yet'
        return self._tracker.hand

    def say(self, note: str) -> None:
        """Print a note on the recording."""
        self._progress.say(f'{self._bag.path}: {note}')

    def frames(self, tracker: HandTracker, **options: Any) -> Iterator[RecordedFrame]:
        """Yield the tracked frames."""
        self._tracker = tracker
        messages = self._progress.over(self._monitored())
        for frame in track(messages, tracker, self._labels, monitor=self._monitor,
                           say=self._progress.say, **options):
            self.tracked += 1
            yield frame
        self._require_tracked()

    def frames_of_hands(self, hands: Mapping[str, tuple[HandTracker, LabelMap]],
                        **options: Any) -> Iterator[dict[str, RecordedFrame]]:
        """Yield the tracked frames of several hands, by their names."""
        monitors = {name: Monitor(1e-9 * self._bag.start, self._topic, labels)
                    for name, (_, labels) in hands.items()}
        self._monitors = {f'{name} hand: ': monitor for name, monitor in monitors.items()}
        point_labels = PointLabels()
        recorded = {name: RecordedHand(tracker, labels, monitor=monitors[name],
                                       point_labels=point_labels, **options)
                    for name, (tracker, labels) in hands.items()}
        messages = self._progress.over(self._monitored())
        for frames in track_hands(messages, recorded, self._progress.say):
            self.tracked += 1
            yield frames
        self._require_tracked()

    def _require_tracked(self) -> None:
        for name, monitor in self._monitors.items():
            if (fault := monitor.side_fault()) is not None:
                raise BagError(f'{self._bag.path}: {name}{fault}')
        if not self.tracked:
            why = '; '.join(name + monitor.why_never_tracked()
                            for name, monitor in self._monitors.items())
            raise BagError(f'{self._bag.path}: no frame of {self._topic} shows the palm: {why}')

    def _monitored(self) -> Iterator[BagMessage]:
        due = self._bag.start
        now = None
        for message in self._bag.messages([self._topic]):
            if self._interrupted:
                raise self._interrupted[0]
            self.read += 1
            now = message.time
            yield message
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
                self._progress.say(f'at {1e-9 * (now - self._bag.start):.2f} s: {name}{line}')


def recorded_hand(options: argparse.Namespace
                  ) -> tuple[Hand, MarkerLayout, Path | PointBag]:
    """Return the hand of a command line, where its markers are, and the recording.

    Without a hand file a file of points says where its markers are, and of which side they are.

    Parameters
    ----------
    options : argparse.Namespace
        With all that `add_recording_options` adds.

    Returns
    -------
    hand : Hand
    layout : MarkerLayout
    recording : Path or PointBag
        For `open_recording`; a path of rosbag2 recordings.
    """
    hand, layout = choose_hand(
        options.hand, options.side, options.limits, options.coupling, options.layout)
    if is_bag(options.recording):
        return hand, layout, options.recording
    points = PointBag(options.recording, MarkerChoice(
        reading_options(options), hand.side if options.hand else options.side,
        chosen_labels(options.markers, layout.names),
        layout if options.hand or options.layout else None,
        vars(options).get('labels') != 'none'))    # not every command has that option
    if points.side and points.side != hand.side:
        hand, _ = choose_hand(
            options.hand, points.side, options.limits, options.coupling, options.layout)
    return hand, points.layout, points


def recorded_labels(options: argparse.Namespace, recording: Path | PointBag,
                    layout: MarkerLayout) -> LabelMap:
    """Return the labels of a recording's messages, which a file of points has by itself."""
    if isinstance(recording, PointBag):
        return recording.labels
    return label_map([*options.label, *equated(options.markers, layout.names)], layout.names)


def equated(texts: Iterable[str], names: Sequence[str]) -> list[str]:
    """Return MARKER=LABEL,... texts with one marker each."""
    return [f'{marker}={label}' for marker, label in chosen_labels(texts, names).items()]


def recorded_hands(options: argparse.Namespace
                   ) -> dict[str, tuple[Hand, MarkerLayout, LabelMap]]:
    """Return both hands of a command line, by side: hand, layout and labels in its recording.

    Parameters
    ----------
    options : argparse.Namespace
        With all that `add_recording_options` adds for both hands.

    Returns
    -------
    dict of str to tuple of Hand, MarkerLayout and LabelMap
    """
    require_bag_of_both(options.recording)
    chosen = {side: choose_hand(
        options.hand, side, options.limits, options.coupling, options.layout) for side in SIDES}
    names = chosen[SIDES[0]][1].names
    labels = label_maps(
        _label_texts([*options.label, *equated(options.markers, names)], names),
        {side: getattr(options, f'{side}_markers') for side in SIDES}, names)
    return {side: (*chosen[side], labels[side]) for side in SIDES}


def require_bag_of_both(recording: Path) -> None:
    """Refuse files of points where both hands are tracked."""
    if not is_bag(recording):
        raise BagError(f'--side both: {recording}: a file of points is tracked for one hand; '
                       'expected a rosbag2 recording, or --side right or left')


@contextmanager
def tracked_recording(
        options: argparse.Namespace, interrupted: Interruptions,
        progress: Callable[..., Any] = Progress,
) -> Iterator[tuple[Hand, Job, Iterator[RecordedFrame]]]:
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
    job : Job
    frames : iterator of RecordedFrame
    """
    hand, layout, recording = recorded_hand(options)
    labels = recorded_labels(options, recording, layout)
    with open_recording(recording) as bag:
        job = Job(bag, marker_topic(bag, options.topic), labels, interrupted, progress, layout)
        for note in recording.notes if isinstance(recording, PointBag) else ():
            job.say(note)
        yield hand, job, job.frames(
            HandTracker(hand, layout), frame_id=options.frame, scale=options.unit_scale,
            zero_is_missing=not options.keep_zeros,
            auto_size=options.auto_size and options.hand is None,
            has_labels=options.labels != 'none')


@contextmanager
def tracked_hands(
        options: argparse.Namespace, interrupted: Interruptions,
        progress: Callable[..., Any] = Progress,
) -> Iterator[tuple[Job, Iterator[dict[str, RecordedFrame]]]]:
    """Track both hands in the recording that a command line asks for.

    Parameters
    ----------
    options, interrupted, progress
        See `tracked_recording`.

    Yields
    ------
    job : Job
    frames : iterator of dict of str to RecordedFrame
        By side.
    """
    chosen = recorded_hands(options)
    _, layout, first = chosen[SIDES[0]]
    hands = {side: (HandTracker(hand, worn), labels)
             for side, (hand, worn, labels) in chosen.items()}
    with open_bag(options.recording) as bag:
        job = Job(bag, marker_topic(bag, options.topic), first, interrupted, progress, layout)
        yield job, job.frames_of_hands(
            hands, frame_id=options.frame, scale=options.unit_scale,
            zero_is_missing=not options.keep_zeros,
            auto_size=options.auto_size and options.hand is None,
            has_labels=options.labels != 'none')


def run_command(name: str, work: Callable[[argparse.Namespace, Interruptions], str],
                options: argparse.Namespace) -> int:
    """Run a command that reads a recording; return its exit code.

    Parameters
    ----------
    name : str
        As in messages.
    work : callable
        Takes the options and a list that is no longer empty when an interruption came;
        returns what to say at the end.
    options : argparse.Namespace

    Returns
    -------
    int
    """
    try:
        print(work(options, raise_on_interruption()))
    except (HandTrackerError, OSError) as error:
        print(f'{name}: {error}', file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print(f'{name}: interrupted; no unfinished file is left', file=sys.stderr)
        return 130
    return 0
