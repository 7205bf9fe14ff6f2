"""The tracker node's parameters, and the hand and options that they stand for.

Some are read once, when the node starts: the hand and all that the URDF shares with the
node. The defaults of the others come from that hand; they act from the next frame on.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..adapters.marker_messages import DEFAULT_MESSAGE, MARKER_MESSAGES
from ..core.errors import HandTrackerError
from ..core.model.hand import (
    ANGLE_RANGE,
    BOTH,
    COUPLING_OFFSET_RANGE,
    COUPLING_PRESETS,
    DIGITS,
    HAND_BREADTH_RANGE,
    HAND_LENGTH_RANGE,
    JOINTS,
    LIMIT_PRESETS,
    MEAN_BREADTH,
    MEAN_LENGTH,
    OTHER_SIDE,
    RESTING_JOINTS,
    SIDES,
    SLOPE_RANGE,
    WEARER_LIMITS,
    Hand,
)
from ..core.model.marker_layout import MARKERS, MarkerLayout, require_solvable
from ..core.model.marker_rows import shows_arch
from ..core.options import TrackerOptions
from ..files.hand_file import InvalidHandFile, choose_hand, worn_layout
from ..messages.labels import LABEL_SOURCES, LabelMap, default_labels, label_maps
from .parameters import Parameter, option_parameters, options_of

AUTO = 'auto'
RELIABILITIES = ('best_effort', 'reliable')
TOPICS = {'markers': ('best_effort', 5), 'joint_states': ('reliable', 10),
          'hand_markers': ('reliable', 5), 'labelled_markers': ('reliable', 5),
          'joint_confidence': ('reliable', 10),
          'distal_flexion': ('best_effort', 10)}
DEGREES = float(np.degrees(ANGLE_RANGE))
DECIMALS = 12  # of degrees, so that 85 degrees come back from radians as 85


class InvalidParameter(HandTrackerError, ValueError):
    """A parameter has a value that it does not allow."""


class Settings(NamedTuple):
    """Values of the parameters that may be set at run time; used from the next frame on.

    Attributes
    ----------
    hand : Hand
    options : TrackerOptions
    labels : LabelMap
    unit_scale : float
        Metres per unit of the markers.
    zero_is_missing : bool
        Whether a marker at exactly (0, 0, 0) is lost.
    distal_flexion_timeout : float
        Age at which measured distal flexion no longer counts [s].
    display_rate : float
        Of the markers for RViz [Hz].
    """

    hand: Hand
    options: TrackerOptions
    labels: LabelMap
    unit_scale: float
    zero_is_missing: bool
    distal_flexion_timeout: float
    display_rate: float


FIRST_PUBLISHER = 'first'  # of several publishers
_START_ROWS = (
    Parameter('hand_file', '', 'Hand file (YAML) with lengths, limits and marker places; '
              'empty for the mean hand'),
    Parameter('layout', '', "Markers that are worn: a preset's name (docs/layouts.md) or a layout "
              "file (YAML); empty for the hand file's, else the paper's eight"),
    Parameter('side', AUTO, "Side of the hand, or both hands; auto is the hand file's, else right",
              choices=(AUTO, *SIDES, BOTH)),
    Parameter('hand_length', MEAN_LENGTH, 'Wrist crease to tip of the middle finger [m]; '
              'for the mean hand only', range=HAND_LENGTH_RANGE),
    Parameter('hand_breadth', MEAN_BREADTH, 'Across the knuckles of index and little finger '
              '[m]; for the mean hand only', range=HAND_BREADTH_RANGE),
    Parameter('auto_size', True, "Whether the hand's size is learned from the first seconds of "
              'markers, where neither hand_file nor another hand_length or hand_breadth gives it'),
    Parameter('thumb', 'saddle', "Plane of the thumb: the hand's saddle joint, or the paper's "
              'plane through the index MCP', choices=('saddle', 'index_mcp')),
    Parameter('limits.preset', AUTO, "Limits of all joints that have none of their own here: "
              "the paper's Table 1, wider ones, or the wearer's, Table 1 widened to what the "
              "hand file's calibration has seen; auto is the hand file's, else paper",
              choices=(AUTO, *LIMIT_PRESETS)),
    Parameter('coupling.preset', AUTO, 'Intradigital correlation of all digits that have none of '
              "their own here; auto is the hand file's, else natural",
              choices=(AUTO, *COUPLING_PRESETS)),
    Parameter('prefix', AUTO, 'Before all joint and frame names; auto is right_ or left_'),
    Parameter('mocap_frame', '', 'Frame of the markers: those in another are left out; '
              'empty for whichever frame they have'),
    Parameter('wrist_frame', AUTO, "Frame of the wrist; auto is the URDF's root, prefix + wrist"),
    Parameter('on_body', False, "Whether the hand hangs on a body by the node mount: then the "
              "wrist's frame is that node's, and the tracked wrist is another frame, whose "
              "name ends in _tracked"),
    Parameter('broadcast', 'wrist', 'Frames to broadcast on /tf: the wrist alone, when '
              'robot_state_publisher broadcasts the rest, all or none',
              choices=('wrist', 'all', 'none')),
    # Of parameters as a file's nested keys none may have the name of a section of others.
    Parameter('labels.from', LABEL_SOURCES[0], 'source: markers have the labels of labels.*; '
              'none: they are points without usable ids, and are labelled by the shape of the hand',
              choices=LABEL_SOURCES, short_name='labels'),
    Parameter('marker_message', DEFAULT_MESSAGE, 'Messages on the topic markers: MarkerArrays, '
              'Markers or RigidBodies of mocap4r2, landmarks as a PoseArray, a NamedPoseArray or a '
              'MarkerArray of so many, or a PointCloud2',
              choices=tuple(MARKER_MESSAGES)),
    Parameter('fast_path', True, "Whether regular frames are tracked in the middleware's own "
              'thread, in compiled code alone'),
    Parameter('publishers', FIRST_PUBLISHER, 'Which of several publishers of markers on one topic '
              'are tracked: the first one, until it is silent for a second, or all; without the '
              'fast path all are', choices=(FIRST_PUBLISHER, 'all')),
    Parameter('calibration_file', 'my_hand.yaml', 'Hand file that ~/calibrate writes, from the '
              'folder in which the node was started'),
) + tuple(
    row for topic, (reliability, depth) in TOPICS.items() for row in (
        Parameter(f'qos.{topic}.reliability', reliability, f'Reliability of {topic}',
                  choices=RELIABILITIES),
        Parameter(f'qos.{topic}.depth', depth, f'Messages of {topic} that wait at most',
                  range=(1, 1000))))
# Another hand file is taken by ~/load_hand.
START = tuple(row._replace(read_only=row.name != 'hand_file') for row in _START_ROWS)
# Of both hands at once
SHARED, SEPARATE = 'shared', 'separate'
START_OF_BOTH = (
    Parameter('marker_topics', SHARED, 'Whether the markers of both hands come in the messages of '
              'one topic, markers, or of one each, right/markers and left/markers',
              choices=(SHARED, SEPARATE), read_only=True),
    Parameter('joint_state_topics', SHARED, 'Whether the joint states of both hands, and their '
              'deviations, go out in one message, or on a topic each, as right/joint_states',
              choices=(SHARED, SEPARATE), read_only=True))


def start_of_hand(side: str) -> tuple[Parameter, ...]:
    """Return the parameters of the start that each of both hands has for its own.

    Parameters
    ----------
    side : {'right', 'left'}

    Returns
    -------
    tuple of Parameter
    """
    return (Parameter(f'{side}.hand_file', '', f'Hand file (YAML) of the {side} hand; empty for '
                      'that of both hands, hand_file'),
            Parameter(f'{side}.calibration_file', f'my_{side}_hand.yaml',
                      f'Hand file that ~/{side}/calibrate writes', read_only=True))


def values_of_hand(start: Mapping[str, Any], side: str) -> dict[str, Any]:
    """Return the parameters of the start as one of both hands alone would have them.

    Parameters
    ----------
    start : mapping of str to object
        Value of each of `START` and of `start_of_hand`.
    side : {'right', 'left'}

    Returns
    -------
    dict

    Raises
    ------
    InvalidParameter
        Where a name is given that both hands would have.
    """
    for name in ('prefix', 'wrist_frame'):
        if start[name] != AUTO:
            raise InvalidParameter(f"{name}: '{start[name]}'; expected {AUTO} for both hands, "
                                   'whose names begin with right_ and left_')
    return {**start, 'side': side, 'hand_file': start[f'{side}.hand_file'] or start['hand_file'],
            'calibration_file': start[f'{side}.calibration_file']}


def names_of_both(start: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the names of the markers that each of both hands wears.

    Parameters
    ----------
    start : mapping of str to object
        As of `values_of_hand`.

    Returns
    -------
    tuple of str

    Raises
    ------
    HandTrackerError
        As `values_of_hand` and `starting_hand`; or if the hands wear different markers.
    """
    of_hands = [values_of_hand(start, side) for side in SIDES]
    right, left = (tuple(starting_hand(values)[1].names) for values in of_hands)
    if right != left:
        files = ' and '.join(f"'{values['hand_file']}'" for values in of_hands)
        raise InvalidParameter(f'hand_file: {files} have {len(right)} and {len(left)} markers; '
                               'expected the same for both hands, whose labels are the same')
    return right


def with_defaults(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return values of parameters, and the defaults of those of `START` that are left out."""
    return {**{row.name: row.default for row in START}, **values}


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
    if values['layout']:
        layout = worn_layout(values['layout'], layout)
        hand = hand.with_open_palm() if shows_arch(layout) else hand
    if values['thumb'] == 'index_mcp':
        hand = hand.with_paper_thumb()
    for name in ('prefix', 'mocap_frame', 'wrist_frame'):
        if values[name].startswith('/'):
            raise InvalidParameter(f"{name}: '{values[name]}'; frames of TF begin with no slash")
    if not values['wrist_frame']:
        raise InvalidParameter("wrist_frame: ''; expected a frame or auto")
    return hand, layout


def calibration_limits(values: Mapping[str, Any]) -> str:
    """Return the preset of the joint limits of a calibration; auto is the wearer's."""
    preset = str(values['limits.preset'])
    return WEARER_LIMITS if preset == AUTO else preset


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
        That is tracked, by names and frames.

    Returns
    -------
    hand : Hand
    layout : MarkerLayout

    Raises
    ------
    HandTrackerError
        As `starting_hand`; or if the hand is of the other side, or cannot be tracked.
    """
    hand, layout = starting_hand({**values, 'hand_file': path})
    if hand.side != side:
        raise InvalidParameter(f'hand_file: {path}: of a {hand.side} hand; expected a {side} one, '
                               'as joints and frames are named')
    require_solvable(layout.principal_mounting(hand.as_right()))
    return hand, layout


def learns_size(values: Mapping[str, Any]) -> bool:
    """Return whether the parameters of the start leave the hand's size to be learned."""
    return (values['auto_size'] and not values['hand_file'] and _has_mean_size(values)
            and values['thumb'] == 'saddle')


def hand_table(hand: Hand, scope: str = '') -> tuple[Parameter, ...]:
    """Return the parameters that act from the next frame on and have the hand's own defaults.

    Parameters
    ----------
    hand : Hand
        Of whom the limits and couplings are the defaults.
    scope : str, optional
        Before each name: 'right.' or 'left.' where both hands are tracked.

    Returns
    -------
    tuple of Parameter
    """
    rows = []
    for joint, limits in zip(JOINTS, np.round(np.degrees(hand.limits), DECIMALS).tolist()):
        for bound, default in zip(('lower', 'upper'), limits):
            rows.append(Parameter(
                f'{scope}limits.{joint}.{bound}_deg', default,
                f'{bound.capitalize()} limit of {joint} [degrees]'
                + ('; does nothing where the layout does not show this joint: it stays '
                   + ('as the hand file has it' if joint.startswith('thumb') else 'at zero')
                   if joint in RESTING_JOINTS else ''), (-DEGREES, DEGREES)))
    for digit, (slope, offset) in zip(DIGITS, hand.coupling.tolist()):
        rule = 'IP = slope MCP + offset' if digit == 'thumb' else 'DIP = slope PIP + offset'
        rows.append(Parameter(f'{scope}coupling.{digit}.slope', slope,
                              f'Intradigital correlation of the {digit}, {rule}', SLOPE_RANGE))
        rows.append(Parameter(
            f'{scope}coupling.{digit}.offset_deg', round(float(np.degrees(offset)), DECIMALS),
            f'Intradigital correlation of the {digit}, {rule} [degrees]',
            (math.degrees(COUPLING_OFFSET_RANGE[0]), math.degrees(COUPLING_OFFSET_RANGE[1]))))
    return tuple(rows)


def common_table() -> tuple[Parameter, ...]:
    """Return the parameters that act from the next frame on and are the same for every hand."""
    return (
        *option_parameters(TrackerOptions),
        Parameter('unit_scale', 1., 'Metres per unit of the markers: 0.001 for mm', (1e-6, 1e3)),
        Parameter('zero_is_missing', True, 'Whether a marker at exactly (0, 0, 0) is a lost one'),
        Parameter('distal_flexion_timeout', .5, 'How long a measured flexion of a last joint '
                  'counts, from its receipt [s]', (.01, 60.)),
        Parameter('display_rate', 60., 'Rate of hand_markers at most [Hz]', (1., 1e3)))


def labels_table(names: Sequence[str] = MARKERS) -> tuple[Parameter, ...]:
    """Return the parameters that assign labels to markers; they act from the next frame on.

    Parameters
    ----------
    names : sequence of str, optional
        Of the layout's markers.

    Returns
    -------
    tuple of Parameter
    """
    return tuple(Parameter(
        f'labels.{marker}', label, f"Which marker of the messages is the {marker} marker: id "
        "('3'), namespace/id ('leds/3'), namespace/* ('thumb/*'), empty if not worn",
        any_type=True) for marker, label in zip(names, default_labels(names)))


def live_table(hand: Hand) -> tuple[Parameter, ...]:
    """Return the parameters that act from the next frame on where one hand is tracked.

    Parameters
    ----------
    hand : Hand
        Of whom the limits and couplings are the defaults.

    Returns
    -------
    tuple of Parameter
    """
    return hand_table(hand) + common_table() + labels_table(MARKERS)


def markers_parameter(side: str, topics: str) -> Parameter:
    """Return the parameter that distinguishes one hand's markers from the other's.

    Parameters
    ----------
    side : {'right', 'left'}
    topics : {'shared', 'separate'}
        Of the markers.

    Returns
    -------
    Parameter
    """
    return Parameter(f'{side}.markers', f'{side}/0' if topics == SHARED else '0',
                     f"Which markers of the messages are the {side} hand's: 'leds/8' adds 8 to the "
                     "ids of the labels and puts them into namespace leds, '8' only adds",
                     any_type=True)


def live_settings(hand: Hand, values: Mapping[str, Any], names: Sequence[str] = MARKERS,
                  scope: str = '', labels: LabelMap | None = None) -> Settings:
    """Return the settings that the values of the run-time parameters stand for.

    Parameters
    ----------
    hand : Hand
    values : dict
        Value of each of `hand_table`, `common_table` and `labels_table` by its name.
    names : sequence of str, optional
        Of the layout's markers.
    scope : str, optional
        As of `hand_table`.
    labels : LabelMap, optional
        Of this hand of both; where left out, that of the parameters.

    Returns
    -------
    Settings

    Raises
    ------
    HandTrackerError
        Naming the parameter, its value and what is allowed.
    """
    limits = [[values[f'{scope}limits.{joint}.{bound}_deg'] for bound in ('lower', 'upper')]
              for joint in JOINTS]
    coupling = [(values[f'{scope}coupling.{digit}.slope'],
                 np.radians(values[f'{scope}coupling.{digit}.offset_deg'])) for digit in DIGITS]
    return Settings(
        hand.replace(limits=np.radians(limits), coupling=coupling),
        options_of(TrackerOptions, values),
        LabelMap(_label_values(values, names), names, not_of=OTHER_SIDE[hand.side])
        if labels is None else labels,
        values['unit_scale'], values['zero_is_missing'], values['distal_flexion_timeout'],
        values['display_rate'])


def tracks_alike(former: Settings, settings: Settings) -> bool:
    """Return whether a hand of the same bones is tracked in the same way by both settings.

    Parameters
    ----------
    former, settings : Settings
    """
    return (settings.options == former.options
            and np.array_equal(settings.hand.limits, former.hand.limits)
            and np.array_equal(settings.hand.coupling, former.hand.coupling))


def _label_values(values: Mapping[str, Any], names: Sequence[str]) -> list[Any]:
    """Return the value of each marker's label, in the order of the names."""
    return [values[f'labels.{marker}'] for marker in names]


def labels_of_both(values: Mapping[str, Any], topics: str,
                   names: Sequence[str] = MARKERS) -> dict[str, LabelMap]:
    """Return the labels of both hands.

    Parameters
    ----------
    values : dict
        Value of each of `labels_table` and `markers_parameter` by its name.
    topics : {'shared', 'separate'}
        Of the markers.
    names : sequence of str, optional
        Of the layout's markers.

    Returns
    -------
    dict of str to LabelMap
        By side.

    Raises
    ------
    HandTrackerError
        Naming the parameter, its value and what is allowed.
    """
    labels = _label_values(values, names)
    places = {side: str(values[f'{side}.markers']) for side in SIDES}
    if topics == SHARED:
        return label_maps(labels, places, names)
    # What is on the other hand's topic is no marker of this message.
    return {side: label_maps(labels, {side: place}, names)[side]
            for side, place in places.items()}
