"""What `hand_tracker inspect` finds in a recording, and the command to run next."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Iterable
from glob import escape, glob
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from ..calibration.hand_axes import SURE, is_body, likelier_unit, mirrored_hands, side_by_shape
from ..calibration.hand_labels import are_nameless
from ..calibration.hand_markers import UnknownMarkers, choose_markers
from ..calibration.known_layouts import LikelyLayout, first_complete, has_both, likely_layouts
from ..calibration.take_checks import LEAST_DURATION
from ..core.model.hand import BOTH, SIDES
from ..core.model.layout_presets import JOINT_CENTRE_PRESETS, PAPER_LAYOUT, preset_layout
from ..core.model.marker_layout import MARKERS, MarkerLayout
from ..files.point_recording import UNIT_SPELLINGS, PointRecording
from ..files.recordings import BVH, C3D, is_named_as_recording
from ..messages.labels import WITHOUT_LABELS
from ..splicing.spliced_points import is_body_of_markers
from ..tracking.label_check import label_fault
from ..tracking.opened_recording import is_marker_bag
from ..tracking.point_bag import MarkerChoice
from ..tracking.recording import MarkerReading
from .recording_options import POINT_OPTIONS, chosen_labels, reading_options

UNKNOWN_LABEL, UNKNOWN_RECORDING = 'LABEL', 'HAND'  # in the command that is printed
FITTED_HAND = 'my_hand.yaml'
LISTED_LABELS = 40
LISTED_LAYOUTS = 4
WHAT_LIKELIHOOD_IS = ('likelihood: the share of names in common (without names, of frames with as '
                      'many points), times how sure the side is; from 0.9 on good, below compare '
                      'names and side')


def summary(recording: PointRecording, layouts: list[LikelyLayout]) -> dict[str, Any]:
    """Return the contents of a recording as JSON values.

    Parameters
    ----------
    recording : PointRecording
    layouts : list of LikelyLayout

    Returns
    -------
    dict
        `labels`, empty for points without one; `rate_hz`, null where it is unknown; `units` and
        `up` of the file; `frames`; `gaps_pct` of all points and frames together, with those
        `left_out`; `layouts`, the most likely first; and `format`, `handed`, `seconds`,
        `gaps_pct_by_label`, `notes`; of rosbag2 recordings `topic` and `message`, else null.
    """
    even = recording.evenly_spaced()
    gaps = 100. * (1. - even.seen.mean(axis=0))
    times = recording.times() if len(recording.points) else np.zeros(1)
    named = {label: round(float(gap), 3) for label, gap in zip(recording.labels, gaps) if label}
    return {
        'format': recording.format, 'labels': list(recording.labels),
        'rate_hz': round(recording.rate, 6) if np.isfinite(recording.rate) else None,
        'units': recording.axes.units, 'up': recording.axes.up,
        'handed': recording.axes.handed, 'frames': len(recording.points),
        'left_out': recording.left_out,
        'seconds': round(float(times[-1] - times[0]), 3),
        'gaps_pct': round(float(gaps.mean()), 3) if len(gaps) else 0.,
        'gaps_pct_by_label': named, 'layouts': [layout._asdict() for layout in layouts],
        'topic': recording.origin and recording.origin.topic,
        'message': recording.origin and recording.origin.type,
        'notes': list(recording.notes)}


def next_command(path: Path, recording: PointRecording, layouts: list[LikelyLayout],
                 options: argparse.Namespace) -> str:
    """Return the command that tracks a recording, with what its labels leave open.

    Parameters
    ----------
    path : Path
    recording : PointRecording
    layouts : list of LikelyLayout
    options : argparse.Namespace
        Of the command line.

    Returns
    -------
    str
        Empty where no point is seen.
    """
    if not np.isfinite(recording.points).any():
        return ''
    words = ['hand_tracker', 'track', str(path), '-o', _output(path, '_angles.csv')]
    of_points = [f'--{name.replace("_", "-")}={getattr(options, name)}'
                 for name in POINT_OPTIONS if getattr(options, name)]
    words += of_points
    words += ['--keep-zeros'] * options.keep_zeros + ['--partial'] * options.partial
    words += ['--topic', options.topic] if options.topic else []
    given = chosen_labels(options.markers)
    likeliest = None if given else first_complete(layouts)
    layout = preset_layout(likeliest.name) if likeliest is not None else None
    has_ids = is_marker_bag(path, MarkerChoice(
        reading_options(options), names=given, layout=layout))
    if has_ids and of_points:
        # Tracked as they are, message by message: as points they have those axes and times.
        return shlex.join(['hand_tracker', 'convert', str(path), _output(path, '_points.npz'),
                           *of_points])
    if not (has_ids or options.handed) and any(mirrored_hands(recording)):
        words.append('--handed=left')
    if unit := options.units or likelier_unit(recording):
        words.append(f'--unit-scale={UNIT_SPELLINGS[unit][0]:g}' if has_ids else f'--units={unit}')
    # Where nothing has a name, as many points as a layout has markers may be these.
    other = layouts[0].name if layouts else PAPER_LAYOUT
    sides = {one.side for one in layouts if one.name == other} & set(SIDES)
    by_shape = BOTH if len(sides) > 1 else next(iter(sides), '')
    without_labels = [*['--layout', other] * (
        other != PAPER_LAYOUT and not given and likeliest is None
        and are_nameless(recording.labels)),
        *['--side', by_shape] * bool(by_shape), '--labels', WITHOUT_LABELS]
    is_both = likeliest is not None and has_both(recording, layouts, likeliest.name)
    if has_ids and is_both:
        return shlex.join([*words, '--side', BOTH])
    if has_ids and '--layout' not in without_labels and label_fault(
            path, options.topic, MarkerReading(partial=options.partial), MarkerLayout()) is None:
        is_left = likeliest is not None and likeliest.side == 'left'
        return shlex.join([*words, *['--side', 'left'] * is_left])
    if has_ids or not any(recording.labels):
        return shlex.join([*words, *without_labels])
    if likeliest is not None:
        side = BOTH if is_both else likeliest.side
        words += ['--layout', likeliest.name] * (likeliest.name != PAPER_LAYOUT)
        words += ['--side', side] * (side in (*SIDES, BOTH))
        return shlex.join(words)
    if not given and are_nameless(recording.labels):
        return shlex.join([*words, *without_labels])
    spliced = ['hand_tracker', 'splice', str(path), UNKNOWN_RECORDING, '-o']
    if not given and recording.format == BVH.name and is_body(recording):
        return shlex.join([*spliced, _output(path, f'_hands{BVH.suffixes[0]}')])
    try:
        chosen = choose_markers(recording, names=given)
        side = chosen.side
        if given and not (side or recording.side):
            by_shape, likelihood = side_by_shape(recording, chosen.columns_of(given))
            side = by_shape if likelihood > SURE else ''    # `track` tells of a doubt
        words += ['--side', side] if side else []
    except UnknownMarkers as error:
        if not given and is_body_of_markers(recording):
            return shlex.join([*spliced, _output(path, f'_hands{C3D.suffixes[0]}')])
        by_number = '' if given or layouts else _layout_by_number(recording)
        words += ['--layout', by_number] if by_number else []
        given |= dict.fromkeys(
            preset_layout(by_number).names if by_number else error.missing, UNKNOWN_LABEL)
    if given:
        words += ['--markers', ','.join(f'{marker}={label}' for marker, label in given.items())]
    return shlex.join(words)


def _layout_by_number(recording: PointRecording) -> str:
    """Return the preset of more than eight markers of which the labelled points may be a hand."""
    labelled = [column for column, label in enumerate(recording.labels) if label]
    likely = likely_layouts(recording._replace(
        labels=('',) * len(labelled), points=recording.points[:, labelled]))
    return next((one.name for one in likely if one.name not in JOINT_CENTRE_PRESETS
                 and len(preset_layout(one.name).names) > len(MARKERS)), '')


def _output(path: Path, end: str) -> str:
    """Return the name of an output in the present folder, another one for each recording.

    Recordings of a folder that differ by their suffix alone keep it. Folders are named where
    another one has a recording of the same name, or where its output is already there.
    """
    stem = path.name.partition('.')[0]
    name = path.name.replace('.', '_') if len(_alike(path.parent.iterdir(), stem)) > 1 else stem
    here, folder = Path.cwd(), path.parent.resolve()
    if folder == here:
        return name + end
    folders = folder.relative_to(here).parts if folder.is_relative_to(here) else ()
    places = ('*/' * depth + f'{escape(stem)}*' for depth in {0, len(folders)} if folders)
    found = _alike(map(Path, chain.from_iterable(map(glob, places))), stem)
    if any(one.parent.resolve() != folder for one in found) or Path(name + end).exists():
        name = '_'.join((*(folders or (folder.name,)), name))
    return name + end


def _alike(paths: Iterable[Path], stem: str) -> list[Path]:
    """Return the recordings among paths whose names begin with the same stem."""
    return [one for one in paths
            if one.name.partition('.')[0] == stem and is_named_as_recording(one)]


def _calibration_command(command: str) -> str:
    """Return the calibration command for the recording and layout of a tracking command.

    Parameters
    ----------
    command : str
        Of `next_command`.

    Returns
    -------
    str
        Empty where that has no layout, or no labels to fit it by.
    """
    words = shlex.split(command)
    if '--layout' not in words or '--labels' in words:
        return ''
    words[1], words[words.index('-o') + 1] = 'calibrate', FITTED_HAND
    # A hand file of one hand serves the other, too.
    words = [SIDES[0] if word == BOTH else word for word in words]
    return shlex.join(words)


def summary_lines(path: Path, found: dict[str, Any], command: str) -> list[str]:
    rate = f'{found["rate_hz"]:g} Hz' if found['rate_hz'] else 'unknown rate'
    seconds = f', {found["seconds"]:.1f} s' if found['rate_hz'] else ''
    handed = ', left-handed axes' if found['handed'] == 'left' else ''
    labels = [label for label in found['labels'] if label]
    messages = f' with {found["message"]} on {found["topic"]}' if found['topic'] else ''
    lines = [f'{path}: {found["format"]}{messages}, {found["frames"]} frames, {rate}{seconds}; in '
             f'{found["units"]}, {found["up"]} up{handed}',
             f'points: {len(labels)} with a label, {len(found["labels"]) - len(labels)} without; '
             f'{found["gaps_pct"]:g} % missing']
    for label in labels[:LISTED_LABELS]:
        gap = found['gaps_pct_by_label'][label]
        lines.append(f'  {label}' + (f'  ({gap:g} % missing)' if gap else ''))
    if len(labels) > LISTED_LABELS:
        lines.append(f'  ... and {len(labels) - LISTED_LABELS} more (--json has all)')
    lines += [f'note: {note}' for note in found['notes']]
    if found['left_out']:
        lines.append(f'note: {found["left_out"]} frames between the others were left out, as the '
                     'times say')
    for layout in found['layouts'][:LISTED_LAYOUTS]:
        lines.append(f'layout {layout["name"]}, {layout["side"]} hand: '
                     f'likelihood {layout["likelihood"]:.2f}')
    if found['layouts']:
        lines.append(WHAT_LIKELIHOOD_IS)
    else:
        lines.append('no layout of a hand is known by these labels')
    if f' {UNKNOWN_RECORDING} ' in command:
        return [*lines, f"next, with a recording of the hand's markers in place of "
                f'{UNKNOWN_RECORDING}: {command}']
    if UNKNOWN_LABEL in command:
        return [*lines, f"next, if a hand's markers are among them, with their labels in place of "
                f'{UNKNOWN_LABEL}: {command}']
    is_take = found['rate_hz'] and found['seconds'] >= LEAST_DURATION
    if is_take and (fitting := _calibration_command(command)):
        lines.append(f'first, for the lengths of this hand and where its markers are: {fitting} '
                     f'(then --hand {FITTED_HAND} in place of --layout and --side)')
    if command.endswith(f' --labels {WITHOUT_LABELS}'):
        # The side of numbered points in files is found by `track`.
        if ' --side ' not in command and (
                found['topic'] or not labels or ' --layout ' in command):
            lines.append('points without labels are searched for a right hand: add --side left '
                         'for a left one, --side both for two')
        if ' --layout ' in command and labels and found['topic']:
            lines.append("where the ids, from 0 on, are in the order of the layout's markers, "
                         f'leave out --labels {WITHOUT_LABELS}')
    return [*lines, f'next: {command}' if command else 'no point is seen in any frame']
