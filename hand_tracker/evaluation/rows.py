"""Rows of evaluations: statistics of errors, and means over rows."""

from collections.abc import Iterable
from typing import Any

import numpy as np

Row = dict[str, Any]  # of numbers and strings

MILLIMETRE_DECIMALS = 4  # of stored millimetres
DEGREE_DECIMALS = 4      # of stored root mean squares


def error_statistics(errors: np.ndarray) -> Row:
    """Return mean and 95th percentile of errors in millimetres; NaN if there are none.

    Parameters
    ----------
    errors : ndarray
        [m]

    Returns
    -------
    dict
        With `mean_mm` and `p95_mm`.
    """
    if not errors.size:
        return {'mean_mm': np.nan, 'p95_mm': np.nan}
    return {'mean_mm': round(1e3 * float(errors.mean()), MILLIMETRE_DECIMALS),
            'p95_mm': round(1e3 * float(np.percentile(errors, 95.)), MILLIMETRE_DECIMALS)}


def root_mean_square_deg(angles: np.ndarray) -> float:
    """Return the root mean square of angles [rad], rounded [degrees]."""
    return round(float(np.sqrt(np.mean(np.degrees(angles) ** 2))), DEGREE_DECIMALS)


def mean_of(rows: Iterable[Row | None]) -> Row | None:
    """Return the means of `mean_mm` and `p95_mm` over the rows that have them; None if none has."""
    known = [row for row in rows if row is not None and row['mean_mm'] is not None]
    if not known:
        return None
    return {key: sum(row[key] for row in known) / len(known) for key in ('mean_mm', 'p95_mm')}
