"""Numbers of rows: what is stored of many errors, and means over rows."""

import numpy as np

DECIMALS = 4  # of stored millimetres


def spread(errors):
    """Return mean and 95th percentile of errors [m] in millimetres; NaN for no errors.

    Parameters
    ----------
    errors : ndarray

    Returns
    -------
    dict
        With `mean_mm` and `p95_mm`.
    """
    if not errors.size:
        return {'mean_mm': np.nan, 'p95_mm': np.nan}
    return {'mean_mm': round(1e3 * float(errors.mean()), DECIMALS),
            'p95_mm': round(1e3 * float(np.percentile(errors, 95.)), DECIMALS)}


def mean_of(rows):
    """Return a row with the plain means of `mean_mm` and `p95_mm` over rows that have them."""
    known = [row for row in rows if row is not None and row['mean_mm'] is not None]
    if not known:
        return None
    return {key: sum(row[key] for row in known) / len(known) for key in ('mean_mm', 'p95_mm')}
