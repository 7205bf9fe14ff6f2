"""The tracker node's parameters, and the hand and options that they stand for.

Some are read once, when the node starts: the hand and all that the URDF shares with the
node. The defaults of the others come from that hand; they act from the next frame on.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..core.errors import HandTrackerError
from ..core.model.hand import (
    ANGLE_RANGE,
    COUPLING_PRESETS,
    DIGITS,
    JOINTS,
    LIMIT_PRESETS,
    MEAN_BREADTH,
    MEAN_LENGTH,
    SIDES,
    SLOPE_RANGE,
    UNOBSERVED_JOINTS,
    Hand,
)
from ..core.model.marker_layout import MARKERS, MarkerLayout, require_solvable
from ..core.options import TrackerOptions
from ..files.hand_file import InvalidHandFile, choose_hand
from ..messages.labels import DEFAULT_LABELS, LabelMap
from .parameters import Parameter

AUTO = 'auto'
RELIABILITIES = ('best_effort', 'reliable')
TOPICS = {'markers': ('best_effort', 5), 'joint_states': ('reliable', 10),
          'hand_markers': ('reliable', 5), 'joint_confidence': ('reliable', 10),
          'distal_flexion': ('best_effort', 10)}
DEGREES = float(np.degrees(ANGLE_RANGE))
DECIMALS = 12  # of degrees, so that 85 degrees come back from radians as 85


class InvalidParameter(HandTrackerError, ValueError):
    """A parameter has a value that it does not allow."""


class Settings(NamedTuple):
    """Values of the parameters that may be set at run time; used from the next frame on."""

    hand: Hand
    options: TrackerOptions
    labels: LabelMap
    unit_scale: float
    zero_is_missing: bool
    distal_flexion_timeout: float
    display_rate: float


START = (
    Parameter('hand_file', '', 'Hand file (YAML) with lengths, limits and marker places; '
              'empty for the mean hand'),
    Parameter('side', AUTO, "Side of the hand; auto is the hand file's, else right",
              choices=(AUTO, *SIDES)),
    Parameter('hand_length', MEAN_LENGTH, 'Wrist crease to tip of the middle finger [m]; '
              'for the mean hand only', range=(.10, .26)),
    Parameter('hand_breadth', MEAN_BREADTH, 'Across the knuckles of index and little finger '
              '[m]; for the mean hand only', range=(.04, .14)),
    Parameter('auto_size', True, "Whether the hand's size is learned from the first seconds of "
              'markers, where neither hand_file nor another hand_length or hand_breadth gives it'),
    Parameter('thumb', 'saddle', "Plane of the thumb: the hand's saddle joint, or the paper's "
              'plane through the index MCP', choices=('saddle', 'index_mcp')),
    Parameter('limits.preset', AUTO, "Limits of all joints that have none of their own here; "
              "auto is the hand file's, else paper", choices=(AUTO, *LIMIT_PRESETS)),
    Parameter('coupling.preset', AUTO, 'Intradigital correlation of all digits that have none of '
              "their own here; auto is the hand file's, else natural",
              choices=(AUTO, *COUPLING_PRESETS)),
    Parameter('prefix', AUTO, 'Before all joint and frame names; auto is right_ or left_'),
    Parameter('mocap_frame', '', 'Frame of the markers: those in another are left out; '
              'empty for whichever frame they have'),
    Parameter('wrist_frame', AUTO, "Frame of the wrist; auto is the URDF's root, prefix + wrist"),
    Parameter('broadcast', 'wrist', 'Frames to broadcast on /tf: the wrist alone, when '
              'robot_state_publisher broadcasts the rest, all or none',
              choices=('wrist', 'all', 'none')),
    Parameter('fast_path', True, "Whether regular frames are tracked in the middleware's own "
              'thread, in compiled code alone'),
    Parameter('calibration_file', 'my_hand.yaml', 'Hand file that ~/calibrate writes, from the '
              'folder in which the node was started'),
) + tuple(
    row for topic, (reliability, depth) in TOPICS.items() for row in (
        Parameter(f'qos.{topic}.reliability', reliability, f'Reliability of {topic}',
                  choices=RELIABILITIES),
        Parameter(f'qos.{topic}.depth', depth, f'Messages of {topic} that wait at most',
                  range=(1, 1000))))
# Another hand file is taken by ~/load_hand.
START = tuple(row._replace(read_only=row.name != 'hand_file') for row in START)


def starting_hand(values: Mapping[str, Any]) -> tuple[Hand, MarkerLayout]:
    """Return the hand that the parameters of the start name.

    Parameters
    ----------
    values : dict
        Value of each of `START` by its name.

    Returns
    -------
    hand : Hand
    layout : MarkerLayout

    Raises
    ------
    HandTrackerError
        Naming the parameter or the hand file's field, its value and what is allowed.
    """
    size = {'length': values['hand_length'], 'breadth': values['hand_breadth']}
    path = values['hand_file']
    if path:
        require_no_size(values, path)
    asked = (None if values[name] == AUTO else values[name]
             for name in ('side', 'limits.preset', 'coupling.preset'))
    try:
        hand, layout = choose_hand(path and Path(path).expanduser(), *asked, **size)
    except InvalidHandFile as error:
        raise InvalidParameter(f'hand_file: {error}') from None
    if values['thumb'] == 'index_mcp':
        hand = hand.with_paper_thumb()
    for name in ('prefix', 'mocap_frame', 'wrist_frame'):
        if values[name].startswith('/'):
            raise InvalidParameter(f"{name}: '{values[name]}'; frames of TF begin with no slash")
    if not values['wrist_frame']:
        raise InvalidParameter("wrist_frame: ''; expected a frame or auto")
    return hand, layout


def require_no_size(values: Mapping[str, Any], path: str) -> None:
    """Refuse a hand file where the parameters of the start give the hand's size, too."""
    if not _has_mean_size(values):
        raise InvalidParameter('hand_length, hand_breadth: they scale the mean hand, and '
                               f'hand_file names another: {path}')


def _has_mean_size(values: Mapping[str, Any]) -> bool:
    return (values['hand_length'], values['hand_breadth']) == (MEAN_LENGTH, MEAN_BREADTH)


def another_hand(values: Mapping[str, Any], path: str, side: str) -> tuple[Hand, MarkerLayout]:
    """Return the hand of a file, to be tracked in place of the one of the start.

    Parameters
    ----------
    values : dict
        As for `starting_hand`.
    path : str
        Hand file.
    side : {'right', 'left'}
        That is tracked, as names and frames tell it.

    Returns
    -------
    hand : Hand
    layout : MarkerLayout

    Raises
    ------
    HandTrackerError
        As `starting_hand`; or if the hand is of the other side, or cannot be tracked.
    """
    if not path:
        raise InvalidParameter("hand_file: ''; expected a hand file to load")
    hand, layout = starting_hand({**values, 'hand_file': path})
    if hand.side != side:
        raise InvalidParameter(f'hand_file: {path}: of a {hand.side} hand; expected a {side} one, '
                               'as joints and frames are named')
    require_solvable(layout.mounting(hand.replace(side='right')))
    return hand, layout


def learns_size(values: Mapping[str, Any]) -> bool:
    """Return whether the parameters of the start leave the hand's size to be learned."""
    return (values['auto_size'] and not values['hand_file'] and _has_mean_size(values)
            and values['thumb'] == 'saddle')


def live_table(hand: Hand) -> tuple[Parameter, ...]:
    """Return the parameters that act from the next frame on.

    Parameters
    ----------
    hand : Hand
        Of whom the limits and couplings are the defaults.

    Returns
    -------
    tuple of Parameter
    """
    rows = []
    for joint, limits in zip(JOINTS, np.round(np.degrees(hand.limits), DECIMALS).tolist()):
        for bound, default in zip(('lower', 'upper'), limits):
            rows.append(Parameter(
                f'limits.{joint}.{bound}_deg', default,
                f'{bound.capitalize()} limit of {joint} [degrees]'
                + ('; does nothing yet: eight markers do not show this joint, it stays at zero'
                   if joint in UNOBSERVED_JOINTS else ''), (-DEGREES, DEGREES)))
    for digit, (slope, offset) in zip(DIGITS, hand.coupling.tolist()):
        rule = 'IP = slope MCP + offset' if digit == 'thumb' else 'DIP = slope PIP + offset'
        rows.append(Parameter(f'coupling.{digit}.slope', slope,
                              f'Intradigital correlation of the {digit}, {rule}', SLOPE_RANGE))
        rows.append(Parameter(
            f'coupling.{digit}.offset_deg', round(float(np.degrees(offset)), DECIMALS),
            f'Intradigital correlation of the {digit}, {rule} [degrees]', (-90., 90.)))
    for option in fields(TrackerOptions):
        about = option.metadata
        unit = f" [{about['unit']}]" if 'unit' in about else ''
        rows.append(Parameter(option.name, option.default, about['description'] + unit,
                              about.get('range'), about.get('choices', ())))
    for marker, label in zip(MARKERS, DEFAULT_LABELS):
        rows.append(Parameter(
            f'labels.{marker}', label, f"Which marker of the messages is the {marker} marker: id "
            "('3'), namespace/id ('leds/3'), namespace/* ('thumb/*'), empty if not worn",
            any_type=True))
    rows.append(Parameter('unit_scale', 1., 'Metres per unit of the markers: 0.001 for mm',
                          (1e-6, 1e3)))
    rows.append(Parameter('zero_is_missing', True,
                          'Whether a marker at exactly (0, 0, 0) is a lost one'))
    rows.append(Parameter('distal_flexion_timeout', .5, 'How long a measured flexion of a last '
                          'joint counts, from its receipt [s]', (.01, 60.)))
    rows.append(Parameter('display_rate', 60., 'Rate of hand_markers at most [Hz]', (1., 1e3)))
    return tuple(rows)


def live_settings(hand: Hand, values: Mapping[str, Any]) -> Settings:
    """Return the settings that the values of the run-time parameters stand for.
    Parameters
    ----------
    hand : Hand
    values : dict
        Value of each of `live_table` by its name.

    Returns
    -------
    Settings

    Raises
    ------
    HandTrackerError
        Naming the parameter, its value and what is allowed.
    """
    limits = [[values[f'limits.{joint}.{bound}_deg'] for bound in ('lower', 'upper')]
              for joint in JOINTS]
    coupling = [(values[f'coupling.{digit}.slope'],
                 np.radians(values[f'coupling.{digit}.offset_deg'])) for digit in DIGITS]
    return Settings(
        hand.replace(limits=np.radians(limits), coupling=coupling),
        TrackerOptions(**{option.name: values[option.name] for option in fields(TrackerOptions)}),
        LabelMap([values[f'labels.{marker}'] for marker in MARKERS]),
        values['unit_scale'], values['zero_is_missing'], values['distal_flexion_timeout'],
        values['display_rate'])
