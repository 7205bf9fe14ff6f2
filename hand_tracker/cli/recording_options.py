"""Options, progress and interruption of the commands that track recordings."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ..core.errors import HandTrackerError
from ..core.model.hand import COUPLING_PRESETS, LIMIT_PRESETS, SIDES, Hand
from ..core.model.marker_layout import MARKERS
from ..core.tracker import HandTracker
from ..files.bags import Bag, BagError, BagMessage, open_bag
from ..files.hand_file import choose_hand
from ..messages.labels import DEFAULT_LABELS, InvalidLabel, LabelMap
from ..parallel import Interruptions, raise_on_interruption
from ..progress import Progress
from ..tracking.monitor import Monitor
from ..tracking.recording import USUAL_TOPIC, RecordedFrame, marker_topic, track

LOG_PERIOD = .25     # [s] of the recording


def add_hand_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of a command line that `choose_hand` takes: hand, side, limits, coupling.

    Parameters
    ----------
    parser : argparse.ArgumentParser
    """
    parser.add_argument('--hand', metavar='FILE', help='hand file (YAML); default: the mean hand')
    parser.add_argument('--side', choices=SIDES, help="default: the hand file's, else right")
    parser.add_argument('--limits', choices=tuple(LIMIT_PRESETS),
                        help="default: the hand file's, else paper")
    parser.add_argument('--coupling', choices=tuple(COUPLING_PRESETS),
                        help="of DIP to PIP; default: the hand file's, else natural")


def _scale(text: str) -> float:
    try:
        scale = float(text)
    except ValueError:
        scale = math.nan
    if not 0. < scale < math.inf:
        raise argparse.ArgumentTypeError(f"'{text}'; expected a positive number")
    return scale


def add_recording_options(parser: argparse.ArgumentParser, several: bool = False) -> None:
    """Add to a command line the recording, how to read it and whose hand it shows.

    Parameters
    ----------
    parser : argparse.ArgumentParser
    several : bool, optional
        Whether there may be several: `recordings`.
    """
    name = 'recordings' if several else 'recording'
    count: dict[str, Any] = {'nargs': '+'} if several else {}
    parser.add_argument(name, type=Path, metavar='IN', **count,
                        help='rosbag2 recording: a folder, .mcap or .db3')
    add_hand_options(parser)
    parser.add_argument('--auto-size', action=argparse.BooleanOptionalAction, default=True,
                        help="learn the hand's size from the first seconds, where no hand file "
                        'gives it')
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
                        help="which marker is which, as index=leds/12; default: ids 0 to 7")
    parser.add_argument('--unit-scale', type=_scale, default=1., metavar='S',
                        help='metres per unit of the markers: 0.001 for mm')
    parser.add_argument('--keep-zeros', action='store_true',
                        help='take a marker at exactly (0, 0, 0) for seen, not for lost')


def label_map(texts: Iterable[str]) -> LabelMap:
    """Return the labels of a command line's MARKER=LABEL texts; ids 0 to 7 where none is given."""
    labels = dict(zip(MARKERS, DEFAULT_LABELS))
    for text in texts:
        marker, given, label = text.partition('=')
        if not given or marker not in labels:
            raise InvalidLabel(f"label: '{text}'; expected MARKER=LABEL, the marker being one of "
                               f'{", ".join(MARKERS)}')
        labels[marker] = label
    return LabelMap(list(labels.values()))


class Job:
    """Track one recording: count its frames, and print what the monitor logs."""

    def __init__(self, bag: Bag, topic: str, labels: LabelMap, interrupted: Interruptions,
                 progress: Callable[..., Any]) -> None:
        self.read = self.tracked = 0
        self._bag, self._topic, self._labels = bag, topic, labels
        self._progress = progress(bag.counts[topic], 'frames')
        self._monitor = Monitor(1e-9 * bag.start, topic, labels)
        self._interrupted = interrupted

    def frames(self, tracker: HandTracker, **options: Any) -> Iterator[RecordedFrame]:
        """Yield the tracked frames."""
        messages = self._progress.over(self._monitored())
        for frame in track(messages, tracker, self._labels, monitor=self._monitor,
                           say=self._progress.say, **options):
            self.tracked += 1
            yield frame
        if not self.tracked:
            raise BagError(f'{self._bag.path}: no frame of {self._topic} shows the palm: '
                           f'{self._monitor.why_never_tracked()}')

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
            self._monitor.ended()
            self._report(now)

    def _report(self, now: int) -> None:
        for _, line in self._monitor.log_lines(1e-9 * now, str):
            self._progress.say(f'at {1e-9 * (now - self._bag.start):.2f} s: {line}')


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
    hand, layout = choose_hand(options.hand, options.side, options.limits, options.coupling)
    labels = label_map(options.label)
    with open_bag(options.recording) as bag:
        job = Job(bag, marker_topic(bag, options.topic), labels, interrupted, progress)
        yield hand, job, job.frames(
            HandTracker(hand, layout), frame_id=options.frame, scale=options.unit_scale,
            zero_is_missing=not options.keep_zeros,
            auto_size=options.auto_size and options.hand is None)


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
