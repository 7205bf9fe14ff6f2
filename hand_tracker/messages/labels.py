"""Labels of markers: which `ns` and `id` of a MarkerArray is which marker of the hand."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..core.errors import HandTrackerError
from ..core.model.marker_layout import MARKERS

DEFAULT_LABELS = tuple(str(slot) for slot in range(len(MARKERS)))
ID_RANGE = (-2**31, 2**31 - 1)


class InvalidLabel(HandTrackerError, ValueError):
    """A label has a form that no marker can answer to, or stands for two markers."""


class LabelMap:
    """Find the marker of the hand that a marker of a message is.

    Parameters
    ----------
    labels : sequence of str or int
        One for each of `MARKERS`: '3' is id 3 in any namespace, 'leds/3' is id 3 in
        namespace 'leds', ``'thumb/*'`` is any id in namespace 'thumb', and '' is a marker
        that is not worn. A namespace may hold slashes. The most precise label wins.

    Raises
    ------
    InvalidLabel
        Naming the marker, its label and what is allowed.
    """

    def __init__(self, labels: Sequence[str | int] = DEFAULT_LABELS) -> None:
        if len(labels) != len(MARKERS):
            raise InvalidLabel(f'labels: {len(labels)} given; expected one for each of {MARKERS}')
        self._exact: dict[tuple[str, int], int] = {}
        self._any_namespace: dict[int, int] = {}
        self._any_id: dict[str, int] = {}
        texts = []
        for slot, (marker, label) in enumerate(zip(MARKERS, labels)):
            table, key, text = self._parse(marker, label)
            if table is not None:
                other = table.setdefault(key, slot)
                if other != slot:
                    raise InvalidLabel(f"labels.{marker}: '{text}' is already {MARKERS[other]}'s")
            texts.append(text)
        self.labels = tuple(texts)

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
        """Return the place in `MARKERS` of a message's marker, None when it is no marker of ours.

        Parameters
        ----------
        namespace : str
        number : int
        """
        slot = self._exact.get((namespace, number))
        if slot is None:
            slot = self._any_namespace.get(number)
        if slot is None:
            slot = self._any_id.get(namespace)
        return slot
