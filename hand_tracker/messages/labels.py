"""Labels of markers: which `ns` and `id` of a MarkerArray is which marker of the hand."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from difflib import SequenceMatcher
from typing import Any

from ..core.errors import HandTrackerError
from ..core.model.marker_layout import MARKERS


def default_labels(names: Sequence[str]) -> tuple[str, ...]:
    """Return the labels of a layout's markers: ids from 0 on."""
    return tuple(str(slot) for slot in range(len(names)))


USUAL_TOPIC = '/markers'             # of the markers
WITHOUT_LABELS = 'none'
LABEL_SOURCES = ('source', WITHOUT_LABELS)   # whether they have labels
DEFAULT_LABELS = default_labels(MARKERS)
ID_RANGE = (-2**31, 2**31 - 1)
SHOWN_LABELS = 30       # in a message


class InvalidLabel(HandTrackerError, ValueError):
    """A label has a form that no marker can answer to, or stands for two markers."""


def shown_labels(labels: Iterable[str], wanted: str = '') -> str:
    """Return the labels that there are, those nearest to a wanted one first, for a message."""
    some = [label for label in labels if label]
    if wanted:
        some.sort(key=lambda label: -SequenceMatcher(None, wanted, label).ratio())
    return (', '.join(some[:SHOWN_LABELS]) or 'it has none') + (
        ', ...' if len(some) > SHOWN_LABELS else '')


class LabelMap:
    """Find the marker of the hand that a marker of a message is.

    Parameters
    ----------
    labels : sequence of str or int
        One for each of the markers: '3' is id 3 in any namespace, 'leds/3' is id 3 in
        namespace 'leds', ``'thumb/*'`` is any id in namespace 'thumb', and '' is a marker
        that is not worn. A namespace may hold slashes. The most precise label wins.
    names : sequence of str, optional
        Of the markers of a layout; `MARKERS` when left out.
    others : sequence of LabelMap, optional
        Of other hands in the same messages; the most precise label of all hands wins.
    not_of : str, optional
        Namespace of which only markers count that a label gives with it: that of the other side,
        where one hand of two is tracked.

    Raises
    ------
    InvalidLabel
        Naming the marker, its label and what is allowed.
    """

    def __init__(self, labels: Sequence[str | int] = DEFAULT_LABELS,
                 names: Sequence[str] = MARKERS, others: Sequence[LabelMap] = (),
                 not_of: str = '') -> None:
        self.names, self.not_of = tuple(names), not_of
        if len(labels) != len(self.names):
            raise InvalidLabel(
                f'labels: {len(labels)} given; expected one for each of {self.names}')
        self._exact: dict[tuple[str, int], int] = {}
        self._any_namespace: dict[int, int] = {}
        self._any_id: dict[str, int] = {}
        texts = []
        for slot, (marker, label) in enumerate(zip(self.names, labels)):
            table, key, text = self._parse(marker, label)
            if table is not None:
                other = table.setdefault(key, slot)
                if other != slot:
                    raise InvalidLabel(
                        f"labels.{marker}: '{text}' is already {self.names[other]}'s")
            texts.append(text)
        self.labels = tuple(texts)
        self._others = tuple(others)
        for label in sorted(filter(None, texts)):
            if any(label in other.labels for other in others):
                raise InvalidLabel(f"labels: '{label}' is a marker of both hands; expected "
                                   'another namespace or other ids for each')

    def _parse(self, marker: str, label: str | int) -> tuple[Any, Any, str]:
        """Return the table a label belongs to, its key there and its text."""
        if isinstance(label, bool) or not isinstance(label, (int, str)):
            raise InvalidLabel(f'labels.{marker}: {label!r} is neither a text nor a number')
        text = str(label).strip()
        if not text:
            return None, None, text
        namespace, slash, last = text.rpartition('/')
        if slash and last == '*':
            return self._any_id, namespace, text
        try:
            number: int | None = int(last)
        except ValueError:
            number = None
        if number is None or not ID_RANGE[0] <= number <= ID_RANGE[1]:
            raise InvalidLabel(
                f"labels.{marker}: '{text}'; expected an id ('3'), namespace/id ('leds/3') "
                "or namespace/* ('thumb/*')")
        if slash:
            return self._exact, (namespace, number), text
        return self._any_namespace, number, text

    def slot(self, namespace: str, number: int) -> int | None:
        """Return the place in `names` of a message's marker; None for markers of others.

        Parameters
        ----------
        namespace : str
        number : int
        """
        rank, slot = self._find(namespace, number)
        if slot is None or any(other._find(namespace, number)[0] < rank for other in self._others):
            return None
        return slot

    def doubled(self, slot: int) -> str:
        """Return in words that several markers of one message have the label of a slot."""
        return (f"several markers of one message answer to the label '{self.labels[slot]}' of "
                f'{self.names[slot]}')

    def is_of_other_hand(self, namespace: str, number: int) -> bool:
        """Return whether a marker without a slot here has a label of another hand."""
        return any(other._find(namespace, number)[1] is not None for other in self._others)

    def _find(self, namespace: str, number: int) -> tuple[int, int | None]:
        """Return the most precise label's rank, the lowest for the most precise, and its slot."""
        slot = self._exact.get((namespace, number))
        if slot is not None:
            return 0, slot
        slot = self._any_namespace.get(number)
        if slot is not None and not (namespace and namespace == self.not_of):
            return 1, slot
        return 2, self._any_id.get(namespace)


def labels_of_hand(labels: Sequence[str | int], markers: str) -> tuple[str, ...]:
    """Return the labels of one hand of several in a message.

    Parameters
    ----------
    labels : sequence of str or int
        As of `LabelMap`, the same for each hand.
    markers : str
        Where the hand's markers are: '8' adds 8 to each id, 'left/0' puts the ids into namespace
        'left', 'left/8' does both.

    Returns
    -------
    tuple of str

    Raises
    ------
    InvalidLabel
        Naming what is not of such a form.
    """
    namespace, slash, first = markers.strip().rpartition('/')
    if not first.isdecimal():
        raise InvalidLabel(f"'{markers}'; expected namespace/id of the hand's first marker "
                           "('left/0'), or its id alone ('8')")
    found = []
    for label in labels:
        own, own_slash, number = str(label).strip().rpartition('/')
        if slash and own_slash:
            raise InvalidLabel(f"labels: '{label}'; expected an id, as the namespace of the hand "
                               f"is '{namespace}'")
        if number.lstrip('-').isdecimal():
            number = str(int(number) + int(first))
        found.append(f'{namespace}/{number}' if slash and number else own + own_slash + number)
    return tuple(found)


def label_maps(labels: Sequence[str | int], markers: Mapping[str, str],
               names: Sequence[str] = MARKERS) -> dict[str, LabelMap]:
    """Return the labels of several hands in a message.

    Parameters
    ----------
    labels : sequence of str or int
        As of `LabelMap`, the same for each hand.
    markers : mapping of str to str
        By the hand's side, where its markers are, as of `labels_of_hand`.
    names : sequence of str, optional
        As of `LabelMap`.

    Returns
    -------
    dict of str to LabelMap
        By side.

    Raises
    ------
    InvalidLabel
        As `labels_of_hand`, naming the side; or if a label is a marker of two hands.
    """
    texts = {}
    for side, place in markers.items():
        try:
            texts[side] = labels_of_hand(labels, place)
        except InvalidLabel as error:
            raise InvalidLabel(f'{side}.markers: {error}') from None
    return maps_of_hands(texts, names)


def maps_of_hands(labels: Mapping[str, Sequence[str]],
                  names: Sequence[str] = MARKERS) -> dict[str, LabelMap]:
    """Return the labels of several hands in a message, each of which knows those of the others.

    Parameters
    ----------
    labels : mapping of str to sequence of str
        By the hand's side, as of `LabelMap`.
    names : sequence of str, optional
        As of `LabelMap`.

    Returns
    -------
    dict of str to LabelMap
        By side.
    """
    return {side: LabelMap(own, names, [
        LabelMap(texts, names) for other, texts in labels.items() if other != side])
        for side, own in labels.items()}
