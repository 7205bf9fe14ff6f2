"""Track recordings without ROS: the angles of every frame, as a table or as a recording.

Command: ``hand_tracker track IN -o OUT.csv``; `track` is the same as a library. Messages stay
bytes (`codec`): objects of them would cost more than the tracking.
"""

import argparse
import math
import sys
import time
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from ..core.errors import HandTrackerError
from ..core.model.hand import JOINTS, ROOT
from ..core.model.marker_layout import MARKERS
from ..core.numerics.quaternion import quaternion
from ..core.tracker import HandState, HandTracker
from ..files.angle_table import write_angle_table
from ..files.bags import (
    JOINT_STATE,
    MARKER_ARRAY,
    STORAGE,
    TF,
    BagError,
    BagMessage,
    open_bag,
    write_bag,
)
from ..files.hand_file import add_hand_options, choose_hand
from ..messages.cdr import (
    MalformedMessage,
    MarkerReader,
    Stamp,
    joint_state_template,
    transforms_template,
)
from ..messages.labels import DEFAULT_LABELS, InvalidLabel, LabelMap
from ..messages.marker_array import FrameTime
from ..parallel import listen_for_interruption, side_by_side
from ..progress import Progress
from .input_monitor import Watch

USUAL_TOPIC = '/markers'
NAMELESS = 'world'   # frame of markers that have none, as TF needs one
LOOK_EVERY = .25     # [s] of the recording
TABLE = '.csv'
KINDS = (TABLE, *STORAGE)


class TrackedFrame(NamedTuple):
    """One frame of a recording, tracked.

    Attributes
    ----------
    time : int
        When the markers were recorded [ns].
    stamp : int
        Of the markers, else `time` [ns].
    frame_id : str
        The markers' frame.
    state : HandState
    """

    time: int
    stamp: int
    frame_id: str
    state: HandState


def marker_topic(bag, topic=None):
    """Return the topic of a recording that holds the markers.

    Parameters
    ----------
    bag : Bag
    topic : str, optional
        That asked for; else it is '/markers' or the only one of the type.

    Returns
    -------
    str

    Raises
    ------
    BagError
        If there is no such topic, or several and none asked for.
    """
    fitting = [name for name, kind in bag.topics.items() if kind == MARKER_ARRAY]
    there = ', '.join(f'{name} ({kind})' for name, kind in sorted(bag.topics.items()))
    if topic:
        name = topic if topic in bag.topics else '/' + topic.lstrip('/')
        if name not in fitting:
            raise BagError(f'{bag.path}: no topic {topic} of {MARKER_ARRAY}; it has {there}')
        return name
    if not fitting:
        raise BagError(f'{bag.path}: no topic of {MARKER_ARRAY}; it has {there}')
    if len(fitting) > 1 and USUAL_TOPIC not in fitting:
        raise BagError(f'{bag.path}: several topics of {MARKER_ARRAY}; '
                       f'choose one of {", ".join(sorted(fitting))}')
    return fitting[0] if len(fitting) == 1 else USUAL_TOPIC


def track(messages, tracker, labels=None, frame_id='', scale=1., zero_is_missing=True,
          watch=None):
    """Track recorded markers as the tracker node tracks them live.

    As there, messages without any marker of the hand are left out, and so are all before
    the palm was first seen; where time jumps back all begins anew. A frame's time is its
    stamp, or when it was recorded.

    Parameters
    ----------
    messages : iterable of BagMessage
        MarkerArrays, as from `Bag.messages`.
    tracker : HandTracker
    labels : LabelMap, optional
        Ids 0 to 7 when left out.
    frame_id, scale, zero_is_missing
        See `markers_from_message`.
    watch : Watch, optional
        Told what came, by the time of the recording.

    Yields
    ------
    TrackedFrame

    Raises
    ------
    BagError
        If a message is damaged.
    """
    reader = MarkerReader(LabelMap() if labels is None else labels, frame_id, scale,
                          zero_is_missing)
    time = FrameTime()
    for message in messages:
        try:
            frame = reader.read(message.data)
        except MalformedMessage as error:
            raise BagError(f'{message.topic}: the message of {message.time} ns is no whole '
                           f'{message.type} of Humble or later') from error
        if watch is not None:
            watch.received(1e-9 * message.time, frame)
        if frame.stamp is None:
            continue
        state = tracker.update(
            frame.positions, time.of(frame.stamp, 1e-9 * message.time))
        if watch is not None:
            watch.tracked(1e-9 * message.time, state)
            if tracker.restarted:
                watch.restarted()
        if tracker.placed:
            stamp = frame.stamp.sec * 10**9 + frame.stamp.nanosec
            yield TrackedFrame(message.time, stamp or message.time, frame.frame_id or NAMELESS,
                               state)


def save(path, frames, prefix, wrist=False):
    """Write tracked frames, one by one; the file appears when it is whole.

    Parameters
    ----------
    path : path-like
        A table (`.csv`), its time beginning with the first frame; or a recording (`.mcap`,
        `.db3`) of `/joint_states` with the stamps of the markers.
    frames : iterable of TrackedFrame
    prefix : str
        Of the joints' names and the wrist's frame, as 'right_'.
    wrist : bool, optional
        Whether to write the wrist's pose too: as columns, or as `/tf`.

    Raises
    ------
    HandTrackerError
        If the path has another extension, or cannot be written to.
    """
    path = Path(path)
    joints = [prefix + joint for joint in JOINTS]
    if path.suffix == TABLE:
        write_angle_table(path, joints, _rows(frames, wrist), wrist)
    else:
        write_bag(path, _messages(frames, joints, prefix + ROOT if wrist else None))


def _rows(frames, wrist):
    first = None
    for _, stamp, _, state in frames:
        first = stamp if first is None else first
        yield 1e-9 * (stamp - first), state.angles, _pose(state) if wrist else ()


def _messages(frames, joints, wrist):
    joint_states, transforms = joint_state_template(joints), {}
    for recorded, stamp, frame_id, state in frames:
        stamp = Stamp(*divmod(stamp, 10**9))
        yield BagMessage('/joint_states', JOINT_STATE, recorded,
                         joint_states.fill(stamp, state.angles))
        if wrist is not None:
            if frame_id not in transforms:
                transforms = {frame_id: transforms_template([(frame_id, wrist)])}
            yield BagMessage('/tf', TF, recorded, transforms[frame_id].fill(stamp, _pose(state)))


def _pose(state):
    return (*state.wrist_position.tolist(), *quaternion(state.wrist_rotation.tolist()))


class Job:
    """Tracking one recording: what the command counts and says meanwhile."""

    def __init__(self, bag, topic, labels, interrupted, progress):
        self.read = self.tracked = 0
        self._bag, self._topic, self._labels = bag, topic, labels
        self._progress = progress(bag.counts[topic], 'frames')
        self._watch = Watch(1e-9 * bag.start, topic, labels)
        self._interrupted = interrupted

    def frames(self, tracker, **options):
        """Yield the tracked frames."""
        messages = self._progress.over(self._looked_at())
        for frame in track(messages, tracker, self._labels, watch=self._watch, **options):
            self.tracked += 1
            yield frame
        if not self.tracked:
            raise BagError(f'{self._bag.path}: no frame of {self._topic} shows the palm: '
                           f'{self._watch.why_never()}')

    def _looked_at(self):
        due = self._bag.start
        now = None
        for message in self._bag.messages([self._topic]):
            if self._interrupted:
                raise self._interrupted[0]
            self.read += 1
            now = message.time
            yield message
            if now >= due:
                due = now + int(1e9 * LOOK_EVERY)
                self._report(now)
        if now is not None:
            self._watch.ended()
            self._report(now)

    def _report(self, now):
        for _, line in self._watch.report(1e-9 * now, str):
            self._progress.say(f'at {1e-9 * (now - self._bag.start):.2f} s: {line}')


def label_map(texts):
    """Return the labels of a command line's MARKER=LABEL texts; ids 0 to 7 where none is given."""
    labels = dict(zip(MARKERS, DEFAULT_LABELS))
    for text in texts:
        marker, given, label = text.partition('=')
        if not given or marker not in labels:
            raise InvalidLabel(f"label: '{text}'; expected MARKER=LABEL, the marker being one of "
                               f'{", ".join(MARKERS)}')
        labels[marker] = label
    return LabelMap(list(labels.values()))


def _refuse_to_replace(recording, output):
    sources = recording.iterdir() if recording.is_dir() else (recording,)
    there = output.exists() and recording.exists()
    if output.is_dir() or there and any(map(output.samefile, sources)):
        raise BagError(f'{output}: would replace the recording or a folder; '
                       'expected another name for the output')


@contextmanager
def tracked_recording(options, interrupted, progress=Progress):
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
    frames : iterator of TrackedFrame
    """
    hand, layout = choose_hand(options.hand, options.side, options.limits, options.coupling)
    labels = label_map(options.label)
    with open_bag(options.recording) as bag:
        job = Job(bag, marker_topic(bag, options.topic), labels, interrupted, progress)
        yield hand, job, job.frames(
            HandTracker(hand, layout), frame_id=options.frame, scale=options.unit_scale,
            zero_is_missing=not options.keep_zeros)


def _track_file(options, interrupted, progress=Progress):
    """Do what the command line asks for; return what to say at the end."""
    output = options.output
    if output.suffix not in KINDS:
        raise BagError(f'{output}: unknown extension {output.suffix!r}; '
                       f'expected {", ".join(KINDS)}')
    start = time.monotonic()
    _refuse_to_replace(options.recording, output)
    with tracked_recording(options, interrupted, progress) as (hand, job, frames):
        save(output, frames, f'{hand.side}_', options.wrist)
    elapsed = time.monotonic() - start
    return (f'{output}: {job.tracked} of {job.read} frames tracked, '
            f'{job.read / elapsed:.0f} a second')


def _track_into_folder(options, interrupted):
    """Track several recordings, a file for each; return what to say at the end."""
    tasks = [argparse.Namespace(**{
        **vars(options), 'recording': recording,
        'output': options.output / f'{_name(recording)}.{options.format or TABLE[1:]}'})
        for recording in options.recordings]
    if options.output.suffix in KINDS:
        raise BagError(f'{options.output}: several recordings, or --format, fill a folder; '
                       f'expected a name without {options.output.suffix}')
    outputs = [task.output for task in tasks]
    for output in outputs:
        if outputs.count(output) > 1:
            raise BagError(f'{output}: several recordings have this name; '
                           'expected different names, or a command for each')
    options.output.mkdir(parents=True, exist_ok=True)
    count, tracked = len(tasks), 0
    progress = Progress(count, 'recordings')
    results = side_by_side(_track_file, tasks, options.jobs)
    for task, (is_tracked, lines) in zip(tasks, progress.over(results)):
        tracked += is_tracked
        for line in lines:
            named = line.startswith(str(task.recording))
            progress.say(line if named else f'{task.recording.name}: {line}')
    if tracked < count:
        raise BagError(f'{options.output}: only {tracked} of {count} recordings tracked')
    return f'{options.output}: {count} recordings tracked'


def _name(recording):
    # A folder's name may have dots.
    recording = recording.resolve()
    return recording.stem if recording.suffix in STORAGE else recording.name


def _jobs(text):
    if not text.isdecimal() or not int(text):
        raise argparse.ArgumentTypeError(f"'{text}'; expected a number from 1 on")
    return int(text)


def _scale(text):
    try:
        scale = float(text)
    except ValueError:
        scale = math.nan
    if not 0. < scale < math.inf:
        raise argparse.ArgumentTypeError(f"'{text}'; expected a positive number")
    return scale


def add_recording_options(parser, several=False):
    """Add to a command line the recording, how to read it and whose hand it shows.

    Parameters
    ----------
    parser : argparse.ArgumentParser
    several : bool, optional
        Whether there may be several: `recordings`.
    """
    name, count = ('recordings', {'nargs': '+'}) if several else ('recording', {})
    parser.add_argument(name, type=Path, metavar='IN', **count,
                        help='rosbag2 recording: a folder, .mcap or .db3')
    add_hand_options(parser)
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


def _parse(args):
    parser = argparse.ArgumentParser(prog='hand_tracker track', description=main.__doc__)
    add_recording_options(parser, several=True)
    parser.add_argument('-o', '--output', type=Path, required=True, metavar='OUT',
                        help='table (.csv) or recording of /joint_states (.mcap, .db3); '
                        'for several recordings the folder of such')
    parser.add_argument('--format', choices=[kind[1:] for kind in KINDS],
                        help='of the files in a folder OUT, for one recording too; default: csv')
    parser.add_argument('--jobs', type=_jobs, default=1, metavar='N',
                        help='processes for several recordings; default: 1')
    parser.add_argument('--wrist', action='store_true', help="write the wrist's pose too: as "
                        'columns of the table, or as /tf')
    return parser.parse_args(args)


def run_command(name, work, options):
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
        print(work(options, listen_for_interruption()))
    except (HandTrackerError, OSError) as error:
        print(f'{name}: {error}', file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print(f'{name}: interrupted; no unfinished file is left', file=sys.stderr)
        return 130
    return 0


def main(args=None):
    """Track recordings without ROS, and write the angles of every frame."""
    options = _parse(args)
    if len(options.recordings) > 1 or options.format:
        return run_command('hand_tracker track', _track_into_folder, options)
    options.recording, = options.recordings
    return run_command('hand_tracker track', _track_file, options)


if __name__ == '__main__':
    sys.exit(main())
