"""Open a recording of any format for tracking: message by message, or its points by their names."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import combinations
from os import PathLike
from pathlib import Path

from ..core.model.hand import BOTH, SIDES
from ..core.model.marker_layout import MARKERS
from ..files.bag_points import marker_names, point_topics, sampled_labels
from ..files.bags import Bag, open_bag
from ..files.recordings import is_bag
from ..messages.labels import InvalidLabel
from ..messages.marker_array import MARKER_ARRAY
from ..messages.marker_ids import MarkerIds, no_warning
from .point_bag import MarkerChoice, PointBag

LEAST_NAMED = 4        # markers of a hand, where namespaces are taken for their names: palm, digit
SAMPLED_MESSAGES = 50  # of a recording, in which they are looked for


def named_labels(text: str, names: Sequence[str] = MARKERS,
                 side: str | None = None) -> dict[str, str]:
    """Return the label of each marker that a text such as 'index=LFIN,thumb=LTHM' names.

    Parameters
    ----------
    text : str
        May be empty.
    names : sequence of str, optional
        Of the layout's markers.
    side : {'right', 'left', 'both'}, optional
        Of both hands markers have the side before their names: 'left_index'.

    Returns
    -------
    dict of str to str

    Raises
    ------
    InvalidLabel
        Naming what is no MARKER=LABEL, or the two markers of one label.
    """
    found: dict[str, str] = {}
    sided = [f'{one}_{name}' for one in SIDES for name in names] if side == BOTH else ()
    for one in filter(None, (part.strip() for part in text.split(','))):
        marker, given, label = one.partition('=')
        if not given or marker.strip() not in (*names, *sided):
            raise InvalidLabel(f"markers: '{one}'; expected MARKER=LABEL, the marker being one "
                               f'of {", ".join(names)}')
        found[marker.strip()] = label.strip()
    for first, second in combinations(found, 2):
        if found[first] == found[second]:
            raise InvalidLabel(f"markers: '{found[first]}' for both {first} and {second}; expected "
                               'a label of its own for each')
    return found


def is_marker_bag(path: str | PathLike[str], choice: MarkerChoice | None = None,
                  has_ids: bool = False) -> bool:
    """Return whether a recording is a rosbag2 one that is read as it is, message by message.

    So are MarkerArrays, but where their namespaces name a hand's markers, and other ones than
    their ids do.

    Parameters
    ----------
    path : path-like
    choice : MarkerChoice, optional
    has_ids : bool, optional
        Whether ids or namespaces of the markers are given: then all MarkerArrays are.

    Raises
    ------
    BagError
        If it cannot be read.
    """
    if not is_bag(path):
        return False
    choice = choice or MarkerChoice()
    with open_bag(path, choice.reading.partial) as bag:
        topics = point_topics(bag, choice.reading.topic) or point_topics(bag)
        if topics and not any(bag.topics[topic] == MARKER_ARRAY for topic in topics):
            return False
        labels = sampled_labels(bag, topics[0], SAMPLED_MESSAGES) if len(topics) == 1 else []
    names = marker_names(labels)
    return has_ids or not any(names) or not _are_names(names, labels, choice)


def _are_names(names: Sequence[str], labels: Sequence[str], choice: MarkerChoice) -> bool:
    """Return whether names are those of a hand's markers, and ids say less."""
    if choice.names and set(choice.names.values()) <= set(names):
        return True
    # Here, as the calibration imports scipy.
    from ..calibration.hand_axes import labelled_hands
    from ..calibration.layout_labels import labelled_layout, point_names

    if choice.layout is not None and choice.layout.names != MARKERS:
        return len(labelled_layout(point_names(names), choice.layout).found) >= LEAST_NAMED
    ids = dict(zip(names, (int(label.rpartition('/')[2]) for label in labels)))
    sent = MarkerIds(no_warning)
    sent.add(list(filter(None, names)))
    # Of a source that gives the markers the tracker's own ids.
    if set(range(len(MARKERS))) <= {id for (_, id), name in zip(sent.labels(), sent.rows)
                                    if id == ids[name]}:
        return False
    return any(len(hand.columns) >= LEAST_NAMED for hand in labelled_hands(names))


@contextmanager
def open_recording(path: str | PathLike[str] | PointBag,
                   choice: MarkerChoice | None = None, partial: bool = False) -> Iterator[Bag]:
    """Open a recording of any format for reading messages of markers.

    Parameters
    ----------
    path : path-like or PointBag
        A rosbag2 recording, or a file that `read_recording` reads; a `PointBag` is yielded as
        it is.
    choice : MarkerChoice, optional
        Of the points that stand for the markers where it is no `is_marker_bag`; messages of a
        rosbag2 recording are read as they are where left out.
    partial : bool, optional
        As in `open_bag`, without a choice.

    Yields
    ------
    Bag
        A `PointBag` for a file of points, and for a rosbag2 recording that is no `is_marker_bag`.

    Raises
    ------
    HandTrackerError
    """
    if isinstance(path, PointBag):
        yield path
    elif choice is None or is_marker_bag(path, choice):
        with open_bag(path, choice.reading.partial if choice else partial) as bag:
            yield bag
    else:
        yield PointBag(Path(path), choice)
