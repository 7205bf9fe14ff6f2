"""What `hand_tracker inspect` finds in a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ..calibration.known_layouts import LikelyLayout
from ..calibration.take_checks import LEAST_DURATION
from ..files.point_recording import PointRecording
from ..messages.labels import WITHOUT_LABELS
from .next_command import FITTED_HAND, UNKNOWN_LABEL, UNKNOWN_RECORDING, calibration_command

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


def summary_lines(path: Path, found: dict[str, Any], command: str) -> list[str]:
    """Return the lines of a summary for a reader, with the command to run next."""
    return [*_content_lines(path, found), *_layout_lines(found['layouts']),
            *_next_lines(found, command)]


def _content_lines(path: Path, found: dict[str, Any]) -> list[str]:
    rate = f'{found["rate_hz"]:g} Hz' if found['rate_hz'] else 'unknown rate'
    seconds = f', {found["seconds"]:.1f} s' if found['rate_hz'] else ''
    handed = ', left-handed axes' if found['handed'] == 'left' else ''
    labels = list(filter(None, found['labels']))
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
    return lines


def _layout_lines(layouts: list[dict[str, Any]]) -> list[str]:
    if not layouts:
        return ['no layout of a hand is known by these labels']
    return [*(f'layout {layout["name"]}, {layout["side"]} hand: '
              f'likelihood {layout["likelihood"]:.2f}' for layout in layouts[:LISTED_LAYOUTS]),
            WHAT_LIKELIHOOD_IS]


def _next_lines(found: dict[str, Any], command: str) -> list[str]:
    if not command:
        return ['no point is seen in any frame']
    if f' {UNKNOWN_RECORDING} ' in command:
        return [f"next, with a recording of the hand's markers in place of {UNKNOWN_RECORDING}: "
                f'{command}']
    if UNKNOWN_LABEL in command:
        return [f"next, if a hand's markers are among them, with their labels in place of "
                f'{UNKNOWN_LABEL}: {command}']
    lines = []
    is_take = found['rate_hz'] and found['seconds'] >= LEAST_DURATION
    if is_take and (fitting := calibration_command(command)):
        lines.append(f'first, for the lengths of this hand and where its markers are: {fitting} '
                     f'(then --hand {FITTED_HAND} in place of --layout and --side)')
    if command.endswith(f' --labels {WITHOUT_LABELS}'):
        has_layout, has_labels = ' --layout ' in command, any(found['labels'])
        # The side of numbered points in files is found by `track`.
        if ' --side ' not in command and (found['topic'] or not has_labels or has_layout):
            lines.append('points without labels are searched for a right hand: add --side left '
                         'for a left one, --side both for two')
        if has_layout and has_labels and found['topic']:
            lines.append("where the ids, from 0 on, are in the order of the layout's markers, "
                         f'leave out --labels {WITHOUT_LABELS}')
    return [*lines, f'next: {command}']
