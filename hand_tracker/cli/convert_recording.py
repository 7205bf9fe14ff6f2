"""Convert a recording of points to another format, or to a skeleton by tracking the hand."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from ..calibration.hand_labels import labels_as_markers
from ..calibration.recorded_points import recorded_points
from ..files.bags import STORAGE
from ..files.hand_file import choose_hand
from ..files.point_recording import PointRecording, RecordingError
from ..files.recordings import FORMATS, NPZ, WRITTEN_SUFFIXES, FileFormat, write_recording
from ..files.written_kinds import SKELETON_KINDS
from ..messages.labels import WITHOUT_LABELS
from ..output_files import require_suffix
from ..parallel import Interruptions
from .recording_options import label_map, reading_options
from .track_recordings import refuse_to_replace, track_file


def convert_recording(options: argparse.Namespace, interrupted: Interruptions) -> str:
    """Convert the recording of a command line; return the closing line."""
    output = options.output
    refuse_to_replace(options.recording, output)
    form = _output_format(output, options.format)
    if form is None and output.suffix.lower() in SKELETON_KINDS:
        # A skeleton is what the tracker finds in the points.
        return str(track_file(options, interrupted))
    recording = _points(options)
    _tell_losses(recording, options)
    recording = _relabelled(recording, options)
    written = write_recording(output, recording, form)
    return (f'{output}: {len(recording.points)} frames of {len(recording.labels)} points, as '
            f'{written}')


def _output_format(output: Path, name: str | None) -> FileFormat | None:
    """Return the format of a name, None where the output's suffix tells it."""
    kinds = *WRITTEN_SUFFIXES, *SKELETON_KINDS
    if not name:
        require_suffix(output, kinds, f'{", ".join(kinds)}, or --format')
        return None
    form = next(one for one in FORMATS
                if one.write and one.name.lower().replace(' ', '-') == name)
    suffix = output.suffix.lower()
    if suffix in kinds and suffix not in form.suffixes:
        raise RecordingError(f'{output}: the suffix is that of another format than {name}; '
                             f'expected {" or ".join(form.suffixes)}')
    return form


def _points(options: argparse.Namespace) -> PointRecording:
    """Return the recording of a command line, scaled."""
    layout = by_label = None
    if options.hand or options.layout or options.label:
        _, layout = choose_hand(options.hand, options.side, layout=options.layout)
        by_label = label_map(options.label, layout.names) if options.label else None
    recording = recorded_points(options.recording, reading_options(options), layout, by_label)
    recording.points[:] *= options.unit_scale
    return recording


def _tell_losses(recording: PointRecording, options: argparse.Namespace) -> None:
    """Print a recording's notes, and what of it the output cannot hold; refuse an empty one."""
    output, suffix = options.output, options.output.suffix.lower()
    notes = list(recording.notes)
    if suffix not in STORAGE and recording.left_out:
        notes.append(f'{recording.left_out} frames between the others were left out, as the times '
                     'say: written as missing')
    for note in notes:
        print(f'{options.recording}: {note}', file=sys.stderr)
    if not len(recording.points):
        raise RecordingError(f'{options.recording}: no frames to convert')
    unseen = [label for label, seen in zip(recording.labels, recording.seen.T)
              if label and not seen.any()] if suffix in STORAGE else []
    if unseen:
        print(f'{output}: {", ".join(unseen)} is never seen, and left out: messages hold what is '
              'seen', file=sys.stderr)
    at_origin = [label or 'a point' for label, points in zip(
        recording.labels, recording.points.swapaxes(0, 1)) if (points == 0.).all(axis=1).any()]
    if at_origin and not (recording.is_landmarks and suffix in NPZ.suffixes):
        print(f'{output}: {", ".join(at_origin)} is at (0, 0, 0) in some frames, which reads as '
              'missing but with --keep-zeros', file=sys.stderr)


def _relabelled(recording: PointRecording, options: argparse.Namespace) -> PointRecording:
    """Return a recording with the labels that are written, said where they differ."""
    if options.labels == WITHOUT_LABELS:
        return recording._replace(labels=('',) * len(recording.labels))
    if not recording.is_landmarks or options.output.suffix.lower() in NPZ.suffixes:
        return recording
    # Other formats do not say that the points are joint centres.
    labels = labels_as_markers(recording.labels)
    renamed = [f'{old} as {new}' for old, new in zip(recording.labels, labels) if old != new]
    if renamed:
        print(f'{options.output}: written {", ".join(renamed)}', file=sys.stderr)
    return recording._replace(labels=labels)
