"""`hand_tracker convert`: write a recording in another format."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..files.written_kinds import SKELETON_KINDS, WRITTEN_FORMATS
from ..messages.labels import WITHOUT_LABELS
from ..parallel import Interruptions
from ..progress import Progress
from .recording_options import (
    add_recording_options,
    label_map,
    reading_options,
    run_command,
)
from .reporting import CommandParser, reporting
from .track import add_motion_options, settle_motion_options


def _convert(options: argparse.Namespace, interrupted: Interruptions,
             progress: Callable[..., Any] = Progress) -> str:
    """Convert the recording of a command line; return the closing line."""
    settle_motion_options(options, f'.{options.format}' if options.format
                          else options.output.suffix.lower())
    # Here, so that a wrong option is reported at once.
    from ..calibration.hand_labels import labels_as_markers
    from ..calibration.recorded_points import recorded_points
    from ..files.bags import STORAGE
    from ..files.hand_file import choose_hand
    from ..files.point_recording import RecordingError
    from ..files.recordings import FORMATS, NPZ, WRITTEN_SUFFIXES, write_recording
    from ..output_files import require_suffix
    from .track_recordings import refuse_to_replace, track_file

    written_as = {one.name.lower().replace(' ', '-'): one for one in FORMATS if one.write}
    output, suffix = options.output, options.output.suffix.lower()
    refuse_to_replace(options.recording, output)
    kinds = *WRITTEN_SUFFIXES, *SKELETON_KINDS
    if not options.format:
        require_suffix(output, kinds, f'{", ".join(kinds)}, or --format')
    if suffix in SKELETON_KINDS and not options.format:
        # A skeleton is what the tracker finds in the points.
        return str(track_file(options, interrupted, progress))
    form = written_as[options.format] if options.format else None
    if form is not None and suffix not in form.suffixes and suffix in kinds:
        raise RecordingError(f'{output}: the suffix is that of another format than '
                             f'{options.format}; expected {" or ".join(form.suffixes)}')
    layout = by_label = None
    if options.hand or options.layout or options.label:
        _, layout = choose_hand(options.hand, options.side, layout=options.layout)
        by_label = label_map(options.label, layout.names) if options.label else None
    recording = recorded_points(options.recording, reading_options(options), layout, by_label)
    recording.points[:] *= options.unit_scale
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
    if options.labels == WITHOUT_LABELS:
        recording = recording._replace(labels=('',) * len(recording.labels))
    elif recording.is_landmarks and suffix not in NPZ.suffixes:
        # Other formats do not say that the points are joint centres.
        labels = labels_as_markers(recording.labels)
        renamed = [f'{old} as {new}' for old, new in zip(recording.labels, labels) if old != new]
        if renamed:
            print(f'{output}: written {", ".join(renamed)}', file=sys.stderr)
        recording = recording._replace(labels=labels)
    written = write_recording(output, recording, form)
    return (f'{output}: {len(recording.points)} frames of {len(recording.labels)} points, as '
            f'{written}')


@reporting
def main(arguments: list[str] | None = None) -> int:
    """Write a recording in another format, known by the suffix of OUT.

    Points are written as .c3d, .trc, .tsv (Qualisys), .csv (OptiTrack), .npz, .mcap or .db3, with
    --labels none without their labels; a skeleton (.bvh) and one with skin (.glb) by tracking the
    hand.
    """
    parser = CommandParser(prog='hand_tracker convert', description=main.__doc__)
    add_recording_options(parser)
    parser.add_argument('output', type=Path, metavar='OUT')
    parser.add_argument('--format', choices=WRITTEN_FORMATS,
                        help='of OUT, where its suffix does not tell')
    add_motion_options(parser)
    options = parser.parse_args(arguments)
    return run_command(_convert, options)


if __name__ == '__main__':
    sys.exit(main())
