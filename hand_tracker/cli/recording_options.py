"""Options of the commands that read recordings, and how such a command ends."""

from __future__ import annotations

import argparse
import math
import re
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ..core.errors import HandTrackerError
from ..core.model.hand import BOTH, COUPLING_PRESETS, LIMIT_PRESETS, OTHER_SIDE, SIDES, Hand
from ..core.model.layout_presets import LAYOUT_NAMES
from ..core.model.marker_layout import MARKERS, MarkerLayout
from ..files.point_recording import HANDEDNESS, UNIT_SPELLINGS, UP_AXES
from ..messages.labels import (
    LABEL_SOURCES,
    USUAL_TOPIC,
    WITHOUT_LABELS,
    InvalidLabel,
    LabelMap,
    default_labels,
    label_maps,
)
from ..parallel import Interruptions, raise_on_interruption

# Readers and tracker are imported where they are used, so that a wrong option is reported at once.
if TYPE_CHECKING:
    from ..files.recordings import ReadingOptions
    from ..tracking.point_bag import PointBag
    from ..tracking.recording import MarkerReading

URL_START = re.compile('[a-z][a-z0-9+.]+:/')
# Of points in files; MarkerArrays are taken as they are.
POINT_OPTIONS = 'up', 'handed', 'frame_rate', 'subject'
ROBOT_SUFFIXES = ('.urdf', '.xml', '.yaml', '.yml')


class WornHand(NamedTuple):
    """A hand in a recording: where its markers are, and their labels.

    Attributes
    ----------
    hand : Hand
    layout : MarkerLayout
    labels : LabelMap
    """

    hand: Hand
    layout: MarkerLayout
    labels: LabelMap


def one_side(text: str) -> str:
    """Parse the side of a command that takes one hand; say what to do for both."""
    if text == BOTH:
        raise argparse.ArgumentTypeError('both: this command takes one hand at a time; expected '
                                         '--side right, and the command again with --side left; '
                                         'hand_tracker track takes both')
    return text


def add_hand_options(parser: argparse.ArgumentParser, both: bool = False) -> None:
    """Add the options of a command line that `choose_hand` takes: hand, side, limits, coupling.

    Parameters
    ----------
    parser : argparse.ArgumentParser
    both : bool, optional
        Whether the side may be both.
    """
    parser.add_argument('--hand', metavar='FILE', help='hand file (YAML); default: the mean hand')
    if both:
        parser.add_argument('--left-hand', metavar='FILE', help='with --side both: hand file of '
                            "the left hand; default: --hand's")
    parser.add_argument('--side', choices=(*SIDES, BOTH) if both else SIDES,
                        type=str if both else one_side,
                        help="default: the hand file's, else right")
    parser.add_argument('--limits', choices=LIMIT_PRESETS,
                        help="default: the hand file's, else paper")
    parser.add_argument('--coupling', choices=tuple(COUPLING_PRESETS),
                        help="of DIP to PIP; default: the hand file's, else natural")


def add_layout_option(parser: argparse.ArgumentParser,
                      otherwise: str = "the hand file's, else paper8") -> None:
    """Add the option of a command line that names another marker layout than the default one."""
    parser.add_argument('--layout', metavar='NAME|FILE',
                        help="markers that are worn: a layout file (YAML), or one of "
                        f"{', '.join(LAYOUT_NAMES)}; default: {otherwise}")


def _positive(text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not 0. < number < math.inf:
        raise argparse.ArgumentTypeError(f"'{text}'; expected a positive number")
    return number


def add_recording_options(parser: argparse.ArgumentParser, several: bool = False,
                          both: bool = False,
                          located: Callable[[str], Any] = Path) -> None:
    """Add to a command line the recording, how to read it and whose hand it shows.

    Parameters
    ----------
    parser : argparse.ArgumentParser
    several : bool, optional
        Whether there may be several: `recordings`.
    both : bool, optional
        Whether both hands of a recording may be asked for.
    located : callable, optional
        Returns where a recording is by the text of the command line.
    """
    name = 'recordings' if several else 'recording'
    count: dict[str, Any] = {'nargs': '+'} if several else {}
    parser.add_argument(name, type=located, metavar='IN', **count,
                        help='recording: rosbag2 (a folder, .mcap or .db3), C3D, TRC, Qualisys '
                        'TSV, OptiTrack or Vicon CSV, BVH, npz')
    add_hand_options(parser, both)
    add_layout_option(parser)
    if both:
        for side in SIDES:
            parser.add_argument(
                f'--{side}-markers', default=f'{side}/0', metavar='NS/ID', help='with --side both: '
                f"namespace and first id of the {side} hand's markers, or that id alone; default: "
                '%(default)s')
    parser.add_argument('--auto-size', action=argparse.BooleanOptionalAction, default=True,
                        help="learn the hand's size before it is tracked, where no hand file "
                        'gives it')
    add_labels_option(parser)
    add_marker_options(parser)


def add_labels_option(parser: argparse.ArgumentParser) -> None:
    """Add the option of a command line that says whether markers have labels."""
    parser.add_argument('--labels', choices=LABEL_SOURCES, default=LABEL_SOURCES[0],
                        help='source: markers have labels, but in a file without any; none: they '
                        'are points without usable ids, and are labelled; default: source')


def add_marker_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of a command line that say how markers are read from a recording.

    Parameters
    ----------
    parser : argparse.ArgumentParser
    """
    add_topic_option(parser)
    parser.add_argument('--frame', default='', help='frame of the markers: those in another are '
                        'left out; default: whichever they have')
    parser.add_argument('--label', action='append', default=[], metavar='MARKER=LABEL',
                        help="which marker is which, as index=leds/12; default: ids from 0 on")
    parser.add_argument('--unit-scale', type=_positive, default=1., metavar='S',
                        help='metres per unit of the markers: 0.001 for mm')
    add_zeros_option(parser)
    parser.add_argument('--markers', action='append', default=[], metavar='MARKER=LABEL,...',
                        help='which point of a file is which marker, as index=LFIN (with --side '
                        'both, where a command has it, right_index=RFIN): those that their labels '
                        'do not tell')
    add_reading_options(parser)


def add_zeros_option(parser: argparse.ArgumentParser) -> None:
    """Add the option of a command line that says whether a marker at the origin is seen."""
    parser.add_argument('--keep-zeros', action='store_true',
                        help='take a marker at exactly (0, 0, 0) for seen, not for lost')


def add_topic_option(parser: argparse.ArgumentParser) -> None:
    """Add the option of a command line that says which topic of a rosbag2 recording is read."""
    parser.add_argument('--topic', help=f'of the markers in a rosbag2 recording; default: '
                        f'{USUAL_TOPIC}, else the only one with MarkerArrays, else with points')


def add_frame_rate_option(parser: argparse.ArgumentParser) -> None:
    """Add the option of a command line that says how many frames a second a file has."""
    parser.add_argument('--frame-rate', type=_positive, metavar='HZ',
                        help='of a file of points; default: as the file says')


def add_reading_options(parser: argparse.ArgumentParser) -> None:
    """Add to a command line how a file of points is read, where it is not as recognised.

    Parameters
    ----------
    parser : argparse.ArgumentParser
    """
    parser.add_argument('--units', choices=tuple(UNIT_SPELLINGS),
                        help='unit of the points; default: as the file says, of MarkerArrays m')
    # Joined by =, as one that begins with a minus looks like an option.
    parser.add_argument('--up', choices=UP_AXES, help='upward axis of a file of points, as z or '
                        '--up=-y; default: as the file says, else as its format has it')
    parser.add_argument('--handed', choices=HANDEDNESS,
                        help="handedness of a file's axes; default: as the hand in it tells")
    add_frame_rate_option(parser)
    parser.add_argument('--subject', metavar='NAME', help="whose points of a file are read, where "
                        "labels are such as 'NAME:RIndexTip'; default: all")
    parser.add_argument('--partial', action='store_true',
                        help='read a file that is cut as far as it goes')


def reading_options(options: argparse.Namespace) -> ReadingOptions:
    """Return the options of the command line for reading recorded points."""
    from ..files.recordings import ReadingOptions

    return ReadingOptions(options.units, options.up, options.handed,
                          not getattr(options, 'keep_zeros', False), options.partial,
                          getattr(options, 'topic', None), options.frame_rate, options.subject,
                          is_scaled=getattr(options, 'unit_scale', 1.) != 1.)


def refuse_file_options(options: argparse.Namespace, path: Path) -> None:
    """Refuse options that have no effect on MarkerArrays, which are read message by message.

    Raises
    ------
    HandTrackerError
        Naming the option and the recording.
    """
    _refuse(options, path, POINT_OPTIONS, 'files of points only: MarkerArrays are taken as they '
            'are, z up, right-handed, by their stamps')


def refuse_labels_of_points(options: argparse.Namespace, path: Path) -> None:
    """Refuse options that say which markers MarkerArrays have, where a file names its points.

    Raises
    ------
    HandTrackerError
        Naming the option and the recording.
    """
    _refuse(options, path, ('label', 'fingers'), 'MarkerArrays only: points of a file are named by '
            '--markers MARKER=LABEL,...')


def _refuse(options: argparse.Namespace, path: Path, names: Iterable[str], expected: str) -> None:
    """Raise HandTrackerError with the first of some options that is given, and what it is for."""
    for name in names:
        value = getattr(options, name, None)    # not every command has all
        if value is not None and value != []:
            first = value[0] if isinstance(value, list) else value
            raise HandTrackerError(
                f"{path}: --{name.replace('_', '-')}: {first}; expected for {expected}")


def metres_per_unit(options: argparse.Namespace) -> float:
    """Return the metres of a unit of the markers in MarkerArrays, which name none."""
    given = vars(options)    # not every command has all
    units = given.get('units')
    return float(given.get('unit_scale', 1.) * (UNIT_SPELLINGS[units][0] if units else 1.))


def chosen_labels(texts: Iterable[str], names: Sequence[str] = MARKERS,
                  side: str | None = None) -> dict[str, str]:
    """Return the label of each marker that a command line's MARKER=LABEL,... texts name."""
    from ..tracking.opened_recording import named_labels

    return named_labels(','.join(texts), names, side)


def label_map(texts: Iterable[str], names: Sequence[str] = MARKERS,
              side: str | None = None) -> LabelMap:
    """Return the labels of a command line's MARKER=LABEL texts; ids from 0 where none is given.

    Markers in the namespace of the other side than a given one count only by such a text.
    """
    return LabelMap(_label_texts(texts, names), names, not_of='' if side is None else
                    OTHER_SIDE[side])


def _label_texts(texts: Iterable[str], names: Sequence[str] = MARKERS) -> list[str]:
    labels = dict(zip(names, default_labels(names)))
    for text in texts:
        marker, given, label = text.partition('=')
        if not given or marker not in labels:
            raise InvalidLabel(f"label: '{text}'; expected MARKER=LABEL, the marker being one of "
                               f'{", ".join(names)}')
        labels[marker] = label
    return list(labels.values())


def recorded_hands(options: argparse.Namespace) -> tuple[list[WornHand], Path | PointBag]:
    """Return the hand of a command line, or both, and the recording.

    Without a hand file recorded points, but for MarkerArrays, say where their markers are, and of
    which side they are.

    Parameters
    ----------
    options : argparse.Namespace
        With all that `add_recording_options` adds.

    Returns
    -------
    hands : list of WornHand
        The right and the left one where the side is both.
    recording : Path or PointBag
        For `open_recording`; a path where `is_marker_bag`.
    """
    from ..files.hand_file import choose_hand
    from ..tracking.opened_recording import is_marker_bag
    from ..tracking.point_bag import MarkerChoice, PointBag

    given = vars(options)    # not every command has all
    sides = SIDES if options.side == BOTH else (options.side,)
    chosen = [choose_hand(_hand_file(options, side), side, options.limits, options.coupling,
                          options.layout) for side in sides]
    hand, layout = chosen[0]
    if any(other.names != layout.names for _, other in chosen):
        raise HandTrackerError(f'--left-hand: {options.left_hand}: other markers than those of '
                               f'{options.hand}; expected the same on both hands')
    choice = MarkerChoice(
        reading_options(options), hand.side if options.hand and options.side != BOTH
        else options.side, chosen_labels(options.markers, layout.names, options.side),
        layout if options.hand or options.layout else None,
        False if options.labels == WITHOUT_LABELS else None, finds_side=True,
        may_be_both='left_hand' in given)
    if is_marker_bag(options.recording, choice, bool(given.get('label'))):
        refuse_file_options(options, options.recording)
        texts = [*given.get('label', ()), *equated(options.markers, layout.names)]
        labels = [label_map(texts, layout.names, hand.side)] if len(sides) == 1 else label_maps(
            _label_texts(texts, layout.names),
            {side: given.get(f'{side}_markers', f'{side}/0') for side in SIDES},
            layout.names).values()
        return [WornHand(*one, own) for one, own in zip(chosen, labels)], options.recording
    refuse_labels_of_points(options, options.recording)
    points = PointBag(options.recording, choice)
    hands = []
    for (hand, own), worn in zip(chosen, points.hands):
        if worn.side not in ('', hand.side):
            hand, _ = choose_hand(
                options.hand, worn.side, options.limits, options.coupling, options.layout)
        hands.append(WornHand(
            hand, own if given.get('left_hand') else worn.layout, worn.labels))
    return hands, points


def _hand_file(options: argparse.Namespace, side: str | None) -> str | None:
    """Return the hand file of the hand of a side, which is None where it is not chosen."""
    left = getattr(options, 'left_hand', None)
    if left is None:
        return options.hand and str(options.hand)
    if options.side != BOTH or not options.hand:
        raise HandTrackerError(f'--left-hand: {left}; expected with --side both, and --hand for '
                               'the right hand')
    return str(left if side == 'left' else options.hand)


def hand_notes(options: argparse.Namespace, hands: Sequence[WornHand]) -> list[str]:
    """Return the notes to print on hands: how they differ from their files, and unknown range."""
    from ..files.hand_file import file_notes, unknown_range_note

    # Without a side it is the file's own.
    notes = [note for one in hands if (path := _hand_file(options, one.hand.side))
             for note in file_notes(path, options.side and one.hand.side, options.layout)]
    notes += filter(None, (unknown_range_note(options.limits, one.hand) for one in hands))
    return list(dict.fromkeys(notes))


def recorded_notes(recording: Path | PointBag) -> tuple[str, ...]:
    """Return the notes to print on a recording, see `recorded_hands`."""
    from ..tracking.opened_recording import open_recording

    # One that is cut was refused before, unless that was asked for.
    with open_recording(recording, partial=True) as bag:
        return bag.notes


def recorded_reading(options: argparse.Namespace, recording: Path | PointBag,
                     labels: LabelMap) -> MarkerReading:
    """Return how one hand's markers are read from a recording's messages.

    Parameters
    ----------
    options : argparse.Namespace
    recording, labels
        See `recorded_hands`.
    """
    from ..tracking.point_bag import PointBag
    from ..tracking.recording import MarkerReading

    given = vars(options)    # not every command has all
    reading = MarkerReading(labels, given.get('frame', ''), metres_per_unit(options),
                            not given.get('keep_zeros'), options.labels != WITHOUT_LABELS,
                            given.get('partial', False))
    if isinstance(recording, PointBag):
        # Missing points were left out, and units applied, as the file was read.
        return reading._replace(scale=given.get('unit_scale', 1.), zero_is_missing=False,
                                has_labels=recording.has_labels)
    return reading


def equated(texts: Iterable[str], names: Sequence[str]) -> list[str]:
    """Return MARKER=LABEL,... texts with one marker each."""
    return [f'{marker}={label}' for marker, label in chosen_labels(texts, names).items()]


def recordings_of(path: Path) -> list[Path]:
    """Return the recording at a path, or those in a folder; print which of its folders have more.

    Raises
    ------
    RecordingError
        As by `recordings_at`.
    """
    from ..files.recordings import recordings_at

    found, left_out = recordings_at(path)
    if left_out:
        print(f'{path}: recordings in its folders ({", ".join(left_out)}) are left out',
              file=sys.stderr)
    return found


def require_inputs(options: argparse.Namespace) -> None:
    """Refuse files of a command line that are not there, before all that reads them is imported.

    Parameters
    ----------
    options : argparse.Namespace
        Of which recordings, hand files, and robots' files are looked at, where they are paths.

    Raises
    ------
    HandTrackerError
    """
    given = vars(options)
    several = given.get('recordings') or ()
    recordings = [given.get('recording'), given.get('body'), *(
        path for name in ('takes', 'files', 'fit') for path in given.get(name) or ())]
    # Of many `recordings` one that is missing does not stop the rest; URLs are looked up later.
    if len(several) == 1 or given.get('body'):
        recordings += [path for path in several if isinstance(path, Path)]
    # Of a robot there are also names of presets, package:// paths and XML.
    robots = [given[name] for name in ('robot', 'robot_description', 'urdf') if given.get(name)]
    files = [given.get('hand'), given.get('left_hand'), *(
        text for text in robots if Path(text).suffix.lower() in ROBOT_SUFFIXES
        and not text.startswith(('package://', '<', '~')))]
    for paths, fault in ((recordings, 'no such file or folder'),
                         (files, 'No such file or directory')):
        for path in paths:
            if path and isinstance(path, (str, Path)) and not Path(path).exists():
                # A path has one slash where the URL had two.
                if paths is recordings and URL_START.match(str(path)):
                    fault = 'is elsewhere; hand_tracker track alone reads URLs: copy it here first'
                raise HandTrackerError(f'{path}: {fault}')


def run_command(work: Callable[[argparse.Namespace, Interruptions], str],
                options: argparse.Namespace) -> int:
    """Run a command that reads a recording; return its exit code.

    Parameters
    ----------
    work : callable
        Takes the options and a list that is no longer empty when an interruption came;
        returns what to say at the end.
    options : argparse.Namespace

    Returns
    -------
    int
    """
    require_inputs(options)
    print(work(options, raise_on_interruption()))
    return 0
