"""Marker layouts in YAML: in a hand file, as a file of its own, or a preset by name.

A layout file has the key `markers`: a list of markers, each with `name`, the `link` that it rides
on or the `place` that it is at, and optionally `offset_mm`, `deviation_mm` and `skin_share`; or the
paper's eight, by name. `docs/layouts.md` has examples.
"""

from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from ..core.model.layout_presets import LAYOUT_NAMES, preset_layout
from ..core.model.marker_layout import (
    ALL_LANDMARKS,
    DEVIATION_RANGE,
    LANDMARK_OF_LINK,
    MARKERS,
    OFFSET_RANGE,
    PAPER_PLACES,
    SKIN_SHARE_RANGE,
    MarkerLayout,
)
from ..output_files import write_whole_text
from .plain_yaml import yaml_text
from .yaml_fields import (
    LAYOUT_EXAMPLE,
    InvalidHandFile,
    Quantity,
    choice,
    mapping,
    number,
    read_yaml,
)

MARKER_OFFSET = Quantity('mm', 3, -1000. * OFFSET_RANGE, 1000. * OFFSET_RANGE)
MARKER_DEVIATION = Quantity('mm', 0, *(1000. * v for v in DEVIATION_RANGE))
MARKER_SKIN_SHARE = Quantity('', 0, *SKIN_SHARE_RANGE)
MARKER_QUANTITIES = {'offset_mm': MARKER_OFFSET, 'deviation_mm': MARKER_DEVIATION,
                     'skin_share': MARKER_SKIN_SHARE}


def load_layout(path: str | PathLike[str]) -> MarkerLayout:
    """Read a layout file.

    Parameters
    ----------
    path : str or path-like

    Returns
    -------
    MarkerLayout

    Raises
    ------
    InvalidHandFile
        Naming the file, the field by its dotted path, its value and what is allowed.
    """
    def parse(tree: Any) -> MarkerLayout:
        tree = mapping('', tree, ('markers',))
        if 'markers' not in tree:
            raise InvalidHandFile('markers: missing; expected a list of markers')
        return layout_of_tree(tree['markers'])

    return read_yaml(path, parse, LAYOUT_EXAMPLE)


def layout_text(layout: MarkerLayout) -> str:
    """Return the text of a layout file: a list, in which markers may be renamed and added."""
    return yaml_text('A marker layout for hand_tracker, in millimetres: docs/layouts.md says what '
                     'is what.', {'markers': _rows_of(layout)})


def save_layout(path: str | PathLike[str], layout: MarkerLayout) -> None:
    """Write a layout file; `load_layout` returns the same layout."""
    write_whole_text(Path(path), layout_text(layout))


def choose_layout(text: str) -> MarkerLayout:
    """Return the layout of a preset's name or of a layout file.

    Parameters
    ----------
    text : str
        One of `LAYOUT_NAMES`, or a path.

    Returns
    -------
    MarkerLayout

    Raises
    ------
    InvalidHandFile
        If it is neither.
    """
    if text in LAYOUT_NAMES:
        return preset_layout(text)
    path = Path(text).expanduser()
    if not path.exists():
        raise InvalidHandFile(f"layout: '{text}' is no file, and no preset; presets are "
                              f'{", ".join(LAYOUT_NAMES)}')
    return load_layout(path)


def layout_of_tree(markers: Any) -> MarkerLayout:
    """Return the layout of a file's `markers`: a preset's name, a list, or the eight by name."""
    if isinstance(markers, str):
        return preset_layout(choice('markers', markers, LAYOUT_NAMES))
    if isinstance(markers, list):
        return _listed(markers)
    given = mapping('markers', markers, MARKERS)
    places, values = list(PAPER_PLACES), _no_values(len(MARKERS))
    for marker, fields in given.items():
        where, row = f'markers.{marker}', MARKERS.index(marker)
        fields = mapping(where, fields, ('place', *MARKER_QUANTITIES))
        places[row] = fields.get('place', places[row])
        _read_values(where, fields, values, row)
    return MarkerLayout(tuple(places), values['offset_mm'], values['deviation_mm'],
                        skin_shares=values['skin_share'])


def tree_of_layout(layout: MarkerLayout) -> Any:
    """Return a layout as it stands under `markers` in a hand file."""
    rows = _rows_of(layout)
    return {row.pop('name'): row for row in rows} if layout.names == MARKERS else rows


def _rows_of(layout: MarkerLayout) -> list[dict[str, Any]]:
    """Return the markers of a layout as a list; deviations and skin shares where there are any."""
    def row(number: int) -> dict[str, Any]:
        found = {'name': layout.names[number], 'place': layout.places[number],
                 'offset_mm': MARKER_OFFSET.from_si(layout.offsets[number])}
        if layout.deviations[number]:
            found['deviation_mm'] = MARKER_DEVIATION.from_si(layout.deviations[number])
        if layout.skin_shares[number]:
            found['skin_share'] = MARKER_SKIN_SHARE.from_si(layout.skin_shares[number])
        return found

    return [row(number) for number in range(len(layout.names))]


def _listed(markers: list[Any]) -> MarkerLayout:
    """Return the layout of a list of markers."""
    names, places, values = [], [], _no_values(len(markers))
    for row, fields in enumerate(markers):
        where = f'markers[{row}]'
        fields = mapping(where, fields, ('name', 'link', 'place', *MARKER_QUANTITIES))
        if not isinstance(fields.get('name'), (str, int)):
            raise InvalidHandFile(f'{where}.name: {fields.get("name")!r}; expected a text')
        if ('link' in fields) == ('place' in fields):
            raise InvalidHandFile(f'{where}: expected either link or place')
        names.append(str(fields['name']))
        places.append(
            LANDMARK_OF_LINK[choice(f'{where}.link', fields['link'], LANDMARK_OF_LINK)]
            if 'link' in fields else choice(f'{where}.place', fields['place'], ALL_LANDMARKS))
        _read_values(where, fields, values, row)
    return MarkerLayout(places, values['offset_mm'], values['deviation_mm'], names,
                        values['skin_share'])


def _no_values(count: int) -> dict[str, np.ndarray]:
    """Return zeros for the quantities of so many markers."""
    return {key: np.zeros((count, quantity.size) if quantity.size else count)
            for key, quantity in MARKER_QUANTITIES.items()}


def _read_values(where: str, fields: dict[str, Any], values: dict[str, np.ndarray],
                 row: int) -> None:
    """Read a marker's quantities into their row."""
    for key, quantity in MARKER_QUANTITIES.items():
        if key in fields:
            values[key][row] = number(f'{where}.{key}', fields[key], quantity)
