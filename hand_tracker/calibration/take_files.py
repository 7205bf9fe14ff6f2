"""Takes of markers from files: npz, or a recording of points of any format."""

from collections.abc import Mapping
from os import PathLike
from pathlib import Path

import numpy as np

from ..core.errors import HandTrackerError
from ..core.model.hand import OTHER_SIDE, SIDES
from ..core.model.marker_layout import MarkerLayout
from ..files.npz_file import checked_points, named_fields, open_arrays, without_points
from ..files.point_recording import PointRecording
from ..files.recordings import NPZ, ReadingOptions, is_bag, recognised_format
from .hand_axes import (
    HandPoints,
    columns_of,
    hands_of,
    names_other_hand,
    side_likelihood,
    sided_hand,
)
from .hand_markers import choose_markers, labelled_column, marker_points
from .layout_names import layout_hint, layout_named, names_in_layout
from .marker_names import UsualPlace, canonical_name, identify
from .recorded_points import recorded_points
from .takes import InvalidTake, MarkerTake

TAKE_RATE_RANGE = (5., 2000.)  # [Hz]
ASSUMED_RATE = 30.             # [Hz] taken where a file has none
NAMED_AT_LEAST = 8             # markers, for a file to be read


def load_take(path: str | PathLike[str], side: str | None = None,
              by_layout: bool = False, layout: MarkerLayout | None = None,
              frame_rate: float | None = None) -> MarkerTake:
    """Load a take from an npz file, or as `recorded_take` from one of another format.

    Parameters
    ----------
    path : path-like
        With `markers` (T, M, 3) [m] and `marker_names`, or `positions` (T, M, 3) [m] and
        `joints`; `side`, `rate_hz`, and optionally `sequence` (T,), a number for each frame that
        changes where the recording was cut.
    side : {'right', 'left'}, optional
        Instead of the file's.
    by_layout : bool, optional
        Whether markers named as those of `layout` are taken for those.
    layout : MarkerLayout, optional
        When left out, the preset with markers of just these names, if there is one.
    frame_rate : float, optional
        Instead of the file's; `ASSUMED_RATE` where neither says it [Hz].

    Returns
    -------
    MarkerTake
        Markers that are never seen are left out.

    Raises
    ------
    InvalidTake
        With file, fault and expectation.
    """
    path = Path(path)
    if path.exists() and path.suffix != NPZ.suffixes[0] and (
            is_bag(path) or recognised_format(path) is not NPZ):
        return recorded_take(path, side, ReadingOptions(frame_rate=frame_rate))
    with open_arrays(path, InvalidTake) as data:
        fields = {name: data[name] for name in data.files}
    side = side or str(fields.get('side', np.array('right')))
    if side not in SIDES:
        raise InvalidTake(f'{path}: side {side!r}; expected {" or ".join(SIDES)}')
    usual: dict[str, UsualPlace] = {}
    if by_layout and (known := layout_named(
            fields.get('marker_names', ()), layout)) is not None:
        names, usual = names_in_layout(known)
        fields = {**fields, 'marker_names': np.array(names)}
    names, points = _named_points(path, fields)
    rate = frame_rate or _number(path, 'rate_hz', fields.get('rate_hz', np.array(np.nan)))
    sequence = np.asarray(fields.get('sequence', np.zeros(len(points), dtype=int)))
    if sequence.shape != (len(points),):
        raise InvalidTake(f'{path}: sequence of shape {sequence.shape}; expected a number for '
                          f'each of the {len(points)} frames')
    credit = str(fields.get('source', '')), str(fields.get('licence', ''))
    return MarkerTake(path.stem, names, points, side, usable_rate(path, rate, InvalidTake),
                      sequence, 'markers' in fields, credit, usual, rate_notes(path, rate))


def recorded_take(path: str | PathLike[str], side: str | None = None,
                  reading: ReadingOptions | None = None, layout: MarkerLayout | None = None,
                  names: Mapping[str, str] | None = None) -> MarkerTake:
    """Load a take from a recording of points of any format, by its labels.

    Parameters
    ----------
    path : path-like
    side : {'right', 'left'}, optional
        Of the hand, where the recording may have two; by its labels and shape when left out.
    reading : ReadingOptions, optional
    layout : MarkerLayout, optional
        Whose markers are taken; all whose labels name a place on the hand when left out.
    names : mapping of str to str, optional
        Label of each marker that is not found by itself, by its name in the layout; without a
        layout by one of `MARKERS` or of `ALL_LANDMARKS`.

    Returns
    -------
    MarkerTake

    Raises
    ------
    HandTrackerError
        Naming the file, the fault and what is expected.
    """
    path = Path(path)
    recording = recorded_points(path, reading, layout, wanted=(names or {}).values())
    usual: dict[str, UsualPlace] = {}
    if layout is not None:
        chosen = choose_markers(recording, side, names, layout)
        points, own_side = marker_points(recording, chosen).astype(float), chosen.side
        known, usual = names_in_layout(layout)
    else:
        columns, own_side = _named_columns(recording, side, names or {})
        known = tuple(columns)
        points = recording.points[:, list(columns.values())].astype(float)
    own_side = own_side or recording.side
    notes = rate_notes(path, recording.rate)
    if side is None and names_other_hand(recording, own_side):
        other = OTHER_SIDE[own_side]
        notes += (f'{path}: the {own_side} hand is fitted; labels name a {other} one, too '
                  f'(--side {other})',)
    if side is None and not own_side:
        hand = HandPoints('', dict(zip(known, range(len(known)))))
        likelihood = side_likelihood(recording._replace(points=points), hand)
        side = 'left' if likelihood < .5 else 'right'
    kept = np.isfinite(points).any(axis=(0, 2))
    rate = recording.rate if np.isfinite(recording.rate) else ASSUMED_RATE
    return MarkerTake(
        path.stem, tuple(name for name, keep in zip(known, kept) if keep), points[:, kept],
        side or own_side, float(np.clip(rate, *TAKE_RATE_RANGE)),
        np.zeros(len(points), dtype=int), not recording.is_landmarks, usual=usual,
        notes=notes)


def _named_columns(recording: PointRecording, side: str | None,
                   names: Mapping[str, str]) -> tuple[dict[str, int], str]:
    """Return the columns of a hand's markers by landmark or place, and the side of its labels."""
    hands = hands_of(recording)
    own = sided_hand(hands, side)
    own_side = own.side if own else ''
    columns = columns_of(hands, own_side)
    for marker, label in names.items():
        named = labelled_column(recording, marker, label)
        columns = {name: column for name, column in columns.items() if column != named}
        columns[canonical_name(marker)] = named
    columns = {name: column for (name, column), marker in zip(
        columns.items(), identify(tuple(columns))) if marker}
    if len(columns) < NAMED_AT_LEAST:
        some = ', '.join(label for label in recording.labels if label) or 'nothing'
        raise InvalidTake(f'{recording.name}: its labels are {some}; expected at least '
                          f'{NAMED_AT_LEAST} names such as wrist, index_mcp, index_dip, '
                          'thumb_tip, --markers that say which is which, or a --layout')
    return columns, own_side


def usable_rate(path: Path, rate: float, error: type[HandTrackerError]) -> float:
    """Return a file's rate, `ASSUMED_RATE` for NaN; raise an error out of the range [Hz]."""
    rate = ASSUMED_RATE if np.isnan(rate) else rate
    if not TAKE_RATE_RANGE[0] <= rate <= TAKE_RATE_RANGE[1]:
        raise error(f'{path}: rate_hz {rate:g}; allowed is {TAKE_RATE_RANGE[0]:g} to '
                    f'{TAKE_RATE_RANGE[1]:g} Hz, or NaN where it is not known')
    return rate


def rate_notes(path: Path, rate: float) -> tuple[str, ...]:
    """Return the note on a file whose rate is not known, where it is NaN [Hz]."""
    return (f'{path}: the file does not say its rate: {ASSUMED_RATE:g} Hz is assumed '
            '(--frame-rate)',) if np.isnan(rate) else ()


def _number(path: Path, name: str, value: np.ndarray) -> float:
    """Return the number that an array holds; refuse other arrays."""
    if value.size != 1 or value.dtype.kind not in 'fiu':
        raise InvalidTake(f'{path}: {name} of shape {value.shape}, {value.dtype}; expected a '
                          'number')
    return float(value.item())


def _named_points(path: Path, fields: dict[str, np.ndarray]) -> tuple[tuple[str, ...], np.ndarray]:
    """Return names and places of the markers seen, of the first pair whose names say enough."""
    found: list[str] = []
    unseen: list[str] = []
    for pair, own in named_fields(fields).items():
        points = checked_points(path, fields, pair, len(own), InvalidTake, True).astype(float)
        points[~np.isfinite(points).all(axis=2)] = np.nan
        kept = np.isfinite(points).any(axis=(0, 2))
        unseen += [name for name, keep in zip(own, kept) if not keep]
        names = tuple(name for name, keep in zip(own, kept) if keep)
        known = [marker for marker in identify(names) if marker is not None]
        if len(known) >= NAMED_AT_LEAST:
            return names, points[:, kept]
        found += names
    if unseen and not found:
        raise InvalidTake(f'{path}: none of its markers is ever seen: all places of '
                          f'{", ".join(unseen)} are NaN; expected metres')
    if not found:
        raise without_points(path, fields, InvalidTake)
    raise InvalidTake(f'{path}: its markers are {", ".join(found)}; expected at least '
                      f'{NAMED_AT_LEAST} names such as wrist, index_mcp, index_dip, thumb_tip, '
                      f'--markers that say which is which, or a --layout{layout_hint(found)}'
                      + (f'; never seen are {", ".join(unseen)}' if unseen else ''))
