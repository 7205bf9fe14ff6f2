"""Names of the settings that messages ask for: parameters of the node, or options of a command."""

from __future__ import annotations

import re
from typing import NamedTuple


class SettingNames(NamedTuple):
    """Names of settings, for whoever reads a message.

    Attributes
    ----------
    scale : str
        That of the markers' unit.
    labels : str
        That of all labels.
    label : str
        That of one marker's, which stands for {}.
    side : str
        That of a side, which stands for {}.
    hand : str
        That of the hand file.
    frame : str
        That of the frame of the markers.
    marker : str
        How a marker is told of, by its {label} in the messages and its {name}.
    messages : str
        What the markers come in, before the name of the topic or the file.
    reset : str
        What learns the size of another hand; empty where nothing does.
    mirrored, axes : str
        What mirrors an axis, and what says which one is up; empty where nothing does.
    """

    scale: str
    labels: str
    label: str
    side: str
    hand: str
    frame: str
    marker: str = "'{label}' ({name})"
    messages: str = 'messages on'
    reset: str = ''
    mirrored: str = ''
    axes: str = ''


PARAMETER_NAMES = SettingNames(
    'unit_scale (1 for metres, 0.001 for millimetres)', 'labels.*', 'labels.{}', 'side:={}',
    'hand_file, hand:=', 'mocap_frame', reset='~/reset')
# Of commands, for rosbag2 recordings, and for files of points.
BAG_OPTION_NAMES = SettingNames(
    '--unit-scale (1 for metres, 0.001 for millimetres)', '--label', '--label {}=NAMESPACE/ID',
    '--side {}', '--hand', '--frame')
FILE_OPTION_NAMES = BAG_OPTION_NAMES._replace(
    scale='--units', labels='--markers', label='--markers {}=LABEL', marker='{name}',
    messages='frames of', mirrored='--handed left', axes='--up')
# Options that notes and faults of recordings name, which are parameters of the replay node too.
READING_OPTION = re.compile(r'(?<![\w-])--(?:(partial)|(layout|markers) ([\w-]+(?:=[\w.,]+)?)'
                            r'|(units|up|side|handed|layout|markers|frame-rate|subject)'
                            r'(?: (right|left)\b)?)(?![\w-])')
COMMAND_HINT = re.compile(r' \(hand_tracker [^)]*\)')    # what a command does, not the node


def in_parameters(text: str) -> str:
    """Return a note or fault of a recording with the names of parameters in place of options.

    Parameters
    ----------
    text : str
        Such as 'up is assumed (--up), left-handed axes (--handed left)?'.
    """
    def parameter(match: re.Match[str]) -> str:
        partial, chosen, choice, name, value = match.groups()
        if partial:
            return 'partial:=true'
        name = (chosen or name).replace('-', '_')
        return f'{name}:={choice or value}' if choice or value else name
    return READING_OPTION.sub(parameter, COMMAND_HINT.sub('', text))
