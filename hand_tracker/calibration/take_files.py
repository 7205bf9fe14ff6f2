"""Takes of markers from npz files."""

import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from ..core.errors import HandTrackerError
from ..core.model.hand import SIDES
from .marker_names import identify
from .takes import InvalidTake, MarkerTake

TAKE_RATE_RANGE = (5., 2000.)  # [Hz]
UNKNOWN_RATE = 30.             # [Hz] taken where a file has none
# Pairs of fields that hold markers and their names; the first pair whose names say enough is read.
MARKER_FIELDS = (('markers', 'marker_names'), ('positions', 'joints'))
NAMED_AT_LEAST = 8             # markers, for a file to be read


@contextmanager
def open_arrays(path: Path, refusal: type[HandTrackerError]) -> Iterator[Any]:
    """Open an npz file, and refuse one that cannot be read.

    Parameters
    ----------
    path : Path
    refusal : type of HandTrackerError
        Raised where the file, or an array that is read of it, is not what numpy.savez writes.

    Yields
    ------
    NpzFile
    """
    try:
        with np.load(path, allow_pickle=False) as data:
            yield data
    # A file with a bare array is no context manager: TypeError, AttributeError before Python 3.11.
    except (OSError, ValueError, TypeError, AttributeError, EOFError, zipfile.BadZipFile) as error:
        reason = getattr(error, 'strerror', None)
        raise refusal(f'{path}: no npz file that can be read'
                      + (f' ({reason})' if reason else '')
                      + '; expected plain arrays, as numpy.savez writes them') from None


def load_take(path: str | PathLike[str], side: str | None = None) -> MarkerTake:
    """Load a take from an npz file.

    Parameters
    ----------
    path : path-like
        With `markers` (T, M, 3) [m] and `marker_names`, or `positions` (T, M, 3) [m] and
        `joints`; `side`, `rate_hz`, and optionally `sequence` (T,), a number for each frame that
        changes where the recording was cut.
    side : {'right', 'left'}, optional
        Instead of the file's.

    Returns
    -------
    MarkerTake
        Markers that are never seen are left out.

    Raises
    ------
    InvalidTake
        Naming the file, the fault and what is expected.
    """
    path = Path(path)
    with open_arrays(path, InvalidTake) as data:
        fields = {name: data[name] for name in data.files}
    side = side or str(fields.get('side', np.array('right')))
    if side not in SIDES:
        raise InvalidTake(f'{path}: side {side!r}; expected {" or ".join(SIDES)}')
    names, points = _named_points(path, fields)
    rate = float(fields['rate_hz']) if 'rate_hz' in fields else np.nan
    rate = UNKNOWN_RATE if np.isnan(rate) else rate
    if not TAKE_RATE_RANGE[0] <= rate <= TAKE_RATE_RANGE[1]:
        raise InvalidTake(f'{path}: rate_hz {rate:g}; allowed is {TAKE_RATE_RANGE[0]:g} to '
                          f'{TAKE_RATE_RANGE[1]:g} Hz, or NaN where it is not known')
    sequence = np.asarray(fields.get('sequence', np.zeros(len(points), dtype=int)))
    if sequence.shape != (len(points),):
        raise InvalidTake(f'{path}: sequence of shape {sequence.shape}; expected a number for '
                          f'each of the {len(points)} frames')
    credit = str(fields.get('source', '')), str(fields.get('licence', ''))
    return MarkerTake(path.stem, names, points, side, rate, sequence, 'markers' in fields, credit)


def save_take(path: str | PathLike[str], take: MarkerTake) -> None:
    """Write a take that `load_take` reads.

    Parameters
    ----------
    path : path-like
    take : MarkerTake
    """
    np.savez(path, markers=take.points, marker_names=np.array(take.names), side=take.side,
             rate_hz=take.rate, sequence=take.sequence)


def _named_points(path: Path, fields: dict[str, np.ndarray]) -> tuple[tuple[str, ...], np.ndarray]:
    """Return names and places of the markers that are ever seen."""
    found: list[str] = []
    for places, labels in MARKER_FIELDS:
        if places not in fields or labels not in fields:
            continue
        names = tuple(str(name) for name in np.atleast_1d(fields[labels]))
        points = fields[places]
        if (points.ndim != 3 or points.shape[1:] != (len(names), 3)
                or points.dtype.kind not in 'fiu'):
            raise InvalidTake(f'{path}: {places} of shape {points.shape}, {points.dtype}; '
                              f'expected numbers (T, {len(names)}, 3), as {labels} names '
                              f'{len(names)}')
        points = points.astype(float)
        points[~np.isfinite(points).all(axis=2)] = np.nan
        kept = np.isfinite(points).any(axis=(0, 2))
        names = tuple(name for name, keep in zip(names, kept) if keep)
        known = [marker for marker in identify(names) if marker is not None]
        if len(known) >= NAMED_AT_LEAST:
            return names, points[:, kept]
        found += names
    if not found:
        raise InvalidTake(f'{path}: it has {", ".join(fields) or "nothing"}; expected markers and '
                          'marker_names, or positions and joints')
    raise InvalidTake(f'{path}: its markers are {", ".join(found)}; expected at least '
                      f'{NAMED_AT_LEAST} names such as wrist, index_mcp, index_dip, thumb_tip')
