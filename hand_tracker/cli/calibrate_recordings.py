"""Takes of the command `hand_tracker calibrate`, read from its recordings, and their fit."""

from __future__ import annotations

import argparse
import sys
from functools import partial
from itertools import chain
from pathlib import Path

import numpy as np

from ..calibration.calibrate_takes import calibrate_takes
from ..calibration.layout_names import names_in_layout, worn_preset
from ..calibration.ruler import USUAL_MARKER_HEIGHT, Ruler
from ..calibration.take_files import load_take, recorded_take
from ..calibration.takes import InvalidTake, MarkerTake
from ..core.model.marker_layout import ALL_LANDMARKS, MARKERS, PAPER_PLACES, MarkerLayout
from ..files.bag_points import sampled_labels
from ..files.bags import EXPECTED, STORAGE, open_bag
from ..files.layout_file import choose_layout
from ..messages.cdr import MarkerReader
from ..messages.labels import shown_labels
from ..parallel import Interruptions
from ..tracking.compile_kernels import prepare_kernels
from ..tracking.opened_recording import SAMPLED_MESSAGES, is_marker_bag
from ..tracking.point_bag import MarkerChoice
from ..tracking.recording import marker_topic
from ..tracking.stream import FrameTime
from .recording_options import (
    chosen_labels,
    equated,
    label_map,
    metres_per_unit,
    reading_options,
    recordings_of,
    refuse_file_options,
    refuse_labels_of_points,
)

TAKE_SUFFIX = '.npz'
DOUBLED_SHARE = .1      # of the frames in which markers have a label together, at most


def _take_of_bag(path: Path, options: argparse.Namespace,
                 layout: MarkerLayout | None = None) -> MarkerTake:
    """Return a take of the worn markers from a rosbag2 recording.

    Parameters
    ----------
    path : Path
    options : argparse.Namespace
        Of the command line.
    layout : MarkerLayout, optional
        The paper's eight markers when left out.

    Returns
    -------
    MarkerTake

    Raises
    ------
    InvalidTake
        If the file is no recording, has too few frames, or markers that their labels do not tell
        apart.
    """
    worn = MARKERS if layout is None else layout.names
    labels = label_map([*options.label, *equated(options.markers, worn)], worn, options.side)
    reader = MarkerReader(
        labels, options.frame, metres_per_unit(options), not options.keep_zeros)
    if not path.is_dir() and (path.suffix.lower() not in STORAGE or not path.exists()):
        fault = (f'unknown extension {path.suffix!r}' if path.exists()
                 else 'no such file or folder')
        raise InvalidTake(f'{path}: {fault}; {EXPECTED}, or a {TAKE_SUFFIX} file')
    frames, times, clock, has_other_hand = [], [], FrameTime(), False
    doubled: list[int] = []     # a label's slot for each such frame
    with open_bag(path, options.partial) as bag:
        for note in bag.notes:
            print(f'{path}: {note}', file=sys.stderr)
        topic = marker_topic(bag, options.topic)
        for message in bag.messages([topic]):
            frame = reader.read(message.data)
            doubled += frame.doubled[:1]
            has_other_hand |= labels.not_of in {space for space, _ in frame.unknown}
            time = None if frame.stamp is None else clock.of(frame.stamp, 1e-9 * message.time)
            if time is not None:
                frames.append(frame.positions.copy())
                times.append(time)
    if doubled:
        fault = (f'{path}: in {len(doubled)} of {len(frames)} frames '
                 f'{labels.doubled(doubled[0])}')
        if len(doubled) > DOUBLED_SHARE * len(frames):
            raise InvalidTake(f'{fault}, as those of two hands do; expected one hand, in namespace '
                              'right or left (--side), or one marker (--label '
                              f'{worn[doubled[0]]}=NAMESPACE/ID, and so on)')
        print(f'{fault}; the last one counts', file=sys.stderr)
    if labels.not_of and has_other_hand:
        print(f"{path}: markers of namespace '{labels.not_of}' are left out, as the "
              f"{labels.not_of} hand's (--side {labels.not_of})", file=sys.stderr)
    if len(frames) < 2:
        raise InvalidTake(f'{path}: {len(frames)} messages with markers of the hand; '
                          'expected a take of some 40 s')
    steps = np.diff(times)
    rate = 1. / max(float(np.median(steps[steps > 0.])) if (steps > 0.).any() else 1., 1e-4)
    points = np.array(frames, dtype=float)
    names, usual = names_in_layout(layout or MarkerLayout([
        place.replace('dip', options.fingers or 'dip') for place in PAPER_PLACES]))
    seen = np.isfinite(points).all(axis=2).any(axis=0)
    for text in options.label:
        slot = worn.index(text.partition('=')[0])
        if (label := labels.labels[slot]) and seen.any() and not seen[slot]:
            with open_bag(path, options.partial) as bag:
                found = sampled_labels(bag, topic, SAMPLED_MESSAGES)
            raise InvalidTake(f"{path}: {worn[slot]} is never seen, with the label '{label}'; "
                              f'expected one of {shown_labels(found, label)}')
    if not seen.any():
        raise InvalidTake(f'{path}: none of the markers is ever seen in {len(points)} messages: '
                          'all are absent, NaN or at zero; expected its markers (--label, '
                          '--layout)')
    return MarkerTake(path.stem, tuple(name for name, there in zip(names, seen) if there),
                      points[:, seen], options.side or 'right', rate,
                      np.zeros(len(points), dtype=int), usual=usual)


def calibrate(options: argparse.Namespace, _: Interruptions) -> str:
    """Fit a hand to the takes of a command line; return the closing line."""
    takes = []
    ruler = Ruler(options.hand_length, options.hand_breadth, options.finger_lengths,
                  USUAL_MARKER_HEIGHT if options.marker_height is None else options.marker_height)
    layout = choose_layout(options.layout) if options.layout else None
    nameable = (*MARKERS, *ALL_LANDMARKS) if layout is None else layout.names
    choice = MarkerChoice(reading_options(options), options.side,
                          chosen_labels(options.markers, nameable), layout)
    for path in chain.from_iterable(map(recordings_of, options.takes)):
        if is_marker_bag(path, choice, bool(options.label)):
            refuse_file_options(options, path)
            takes.append(_take_of_bag(path, options, layout))
            continue
        refuse_labels_of_points(options, path)
        scale = options.unit_scale
        if path.suffix.lower() == TAKE_SUFFIX and layout is None and not options.markers:
            take = load_take(path, options.side, frame_rate=options.frame_rate)
            scale = metres_per_unit(options)    # it is read as metres
        else:
            take = recorded_take(path, options.side, choice.reading, layout, choice.names)
        for note in take.notes:
            print(note, file=sys.stderr)
        takes.append(take._replace(points=scale * take.points))
    if layout is None and len(takes[0].names) > len(MARKERS) and (
            preset := worn_preset(takes[0].names)):
        print(f'note: these {len(takes[0].names)} markers are those of --layout {preset}: with it '
              f'the hand file has the places of all, and not of {len(MARKERS)} alone',
              file=sys.stderr)
    return calibrate_takes(takes, options.output, options.limits, options.picture, layout, ruler,
                           partial(prepare_kernels, partial(print, file=sys.stderr)))
