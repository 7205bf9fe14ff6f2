"""The command that `hand_tracker inspect` names as the next one for a recording."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Iterable
from glob import escape, glob
from itertools import chain
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..calibration.hand_axes import SURE, is_body, likelier_unit, mirrored_hands, side_by_shape
from ..calibration.hand_labels import are_nameless
from ..calibration.hand_markers import UnknownMarkers, choose_markers
from ..calibration.known_layouts import LikelyLayout, first_complete, has_both, likely_layouts
from ..core.model.hand import BOTH, SIDES
from ..core.model.layout_presets import JOINT_CENTRE_PRESETS, PAPER_LAYOUT, preset_layout
from ..core.model.marker_layout import MARKERS, MarkerLayout
from ..files.point_recording import UNIT_SPELLINGS, PointRecording
from ..files.recordings import BVH, C3D, FileFormat, is_named_as_recording
from ..messages.labels import WITHOUT_LABELS
from ..splicing.spliced_points import is_body_of_markers
from ..tracking.label_check import label_fault
from ..tracking.opened_recording import is_marker_bag
from ..tracking.point_bag import MarkerChoice
from ..tracking.recording import MarkerReading
from .recording_options import POINT_OPTIONS, chosen_labels, reading_options

UNKNOWN_LABEL, UNKNOWN_RECORDING = 'LABEL', 'HAND'  # in the command that is printed
FITTED_HAND = 'my_hand.yaml'


class _Findings(NamedTuple):
    """What is known of a recording.

    Attributes
    ----------
    path : Path
    recording : PointRecording
    layouts : list of LikelyLayout
        The most likely first.
    likeliest : LikelyLayout or None
        The first with all its markers, None where the command line names markers.
    given : dict
        Label of each marker that the command line names.
    """

    path: Path
    recording: PointRecording
    layouts: list[LikelyLayout]
    likeliest: LikelyLayout | None
    given: dict[str, str]

    @property
    def is_both(self) -> bool:
        return self.likeliest is not None and has_both(
            self.recording, self.layouts, self.likeliest.name)

    @property
    def is_nameless(self) -> bool:
        """Whether labels tell no layout, and are numbers at most."""
        return (self.likeliest is None and not self.given
                and are_nameless(self.recording.labels))


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
    given = chosen_labels(options.markers)
    likeliest = None if given else first_complete(layouts)
    found = _Findings(path, recording, layouts, likeliest, given)
    has_ids = is_marker_bag(path, MarkerChoice(
        reading_options(options), names=given,
        layout=preset_layout(likeliest.name) if likeliest is not None else None))
    of_points = [f'--{name.replace("_", "-")}={getattr(options, name)}'
                 for name in POINT_OPTIONS if getattr(options, name)]
    if has_ids and of_points:
        # Tracked as they are, message by message: as points they have those axes and times.
        return shlex.join(['hand_tracker', 'convert', str(path), _output(path, '_points.npz'),
                           *of_points])
    track = ['hand_tracker', 'track', str(path), '-o', _output(path, '_angles.csv'), *of_points,
             *_reading_words(recording, options, has_ids)]
    if has_ids:
        return shlex.join([*track, *_words_by_ids(found, options)])
    if not any(recording.labels) or found.is_nameless:
        return shlex.join([*track, *_words_without_labels(found)])
    if likeliest is not None:
        return shlex.join([*track, *_words_of_layout(likeliest, found.is_both)])
    return _command_by_labels(found, track)


def calibration_command(command: str) -> str:
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


def _reading_words(recording: PointRecording, options: argparse.Namespace,
                   has_ids: bool) -> list[str]:
    """Return the options by which points are read, and those that axes and unit want."""
    words = ['--keep-zeros'] * options.keep_zeros + ['--partial'] * options.partial
    words += ['--topic', options.topic] if options.topic else []
    if not (has_ids or options.handed) and any(mirrored_hands(recording)):
        words.append('--handed=left')
    if unit := options.units or likelier_unit(recording):
        words.append(f'--unit-scale={UNIT_SPELLINGS[unit][0]:g}' if has_ids else f'--units={unit}')
    return words


def _words_by_ids(found: _Findings, options: argparse.Namespace) -> list[str]:
    """Return the options for messages whose ids may be the markers'."""
    if found.is_both:
        return ['--side', BOTH]
    without_labels = _words_without_labels(found)
    if '--layout' not in without_labels and label_fault(
            found.path, options.topic, MarkerReading(partial=options.partial),
            MarkerLayout()) is None:
        is_left = found.likeliest is not None and found.likeliest.side == 'left'
        return ['--side', 'left'] * is_left
    return without_labels


def _words_without_labels(found: _Findings) -> list[str]:
    """Return the options that label points by themselves: as many as a layout has may be it."""
    layout = found.layouts[0].name if found.layouts else PAPER_LAYOUT
    sides = {one.side for one in found.layouts if one.name == layout} & set(SIDES)
    side = BOTH if len(sides) > 1 else next(iter(sides), '')
    return [*['--layout', layout] * (layout != PAPER_LAYOUT and found.is_nameless),
            *['--side', side] * bool(side), '--labels', WITHOUT_LABELS]


def _words_of_layout(layout: LikelyLayout, is_both: bool) -> list[str]:
    """Return the options that name a layout and its hands."""
    side = BOTH if is_both else layout.side
    return [*['--layout', layout.name] * (layout.name != PAPER_LAYOUT),
            *['--side', side] * (side in (*SIDES, BOTH))]


def _command_by_labels(found: _Findings, track: list[str]) -> str:
    """Return the command that names each marker's label, those unknown left for the reader.

    For a body without a hand it is the one that puts tracked hands on it.
    """
    recording, given = found.recording, dict(found.given)
    side = layout = ''
    if not given and recording.format == BVH.name and is_body(recording):
        return _splice_command(found.path, BVH)
    try:
        chosen = choose_markers(recording, names=given)
        side = chosen.side
        if given and not (side or recording.side):
            by_shape, likelihood = side_by_shape(recording, chosen.columns_of(given))
            side = by_shape if likelihood > SURE else ''    # `track` tells of a doubt
    except UnknownMarkers as error:
        if not given and is_body_of_markers(recording):
            return _splice_command(found.path, C3D)
        layout = '' if given or found.layouts else _layout_by_number(recording)
        given |= dict.fromkeys(
            preset_layout(layout).names if layout else error.missing, UNKNOWN_LABEL)
    named = ','.join(f'{marker}={label}' for marker, label in given.items())
    return shlex.join([*track, *['--side', side] * bool(side), *['--layout', layout] * bool(layout),
                       *['--markers', named] * bool(named)])


def _splice_command(path: Path, form: FileFormat) -> str:
    """Return the command that puts tracked hands on a recorded body, in a format."""
    return shlex.join(['hand_tracker', 'splice', str(path), UNKNOWN_RECORDING,
                       '-o', _output(path, f'_hands{form.suffixes[0]}')])


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
