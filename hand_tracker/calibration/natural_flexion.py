"""Fit `Hand.natural_flexion`: how a person's second flexion goes with the first.

A marker always shows its direction from the digit's root, but its reach only away from straight.
So the line is fitted by Bayesian least squares of the second flexion on the direction, with the
average person's line as prior: few postures, or postures alike, leave it there.
Ours; no source.
"""

from typing import NamedTuple

import numpy as np

from ..core.model.hand import (
    NATURAL_OFFSET_RANGE,
    NATURAL_SLOPE_RANGE,
    NATURAL_SPREAD_RANGE,
)
from .digit_fit import INDEPENDENT_POSTURES

# Share of the second flexion in the direction of a marker behind the second bone [1].
DIRECTION_SHARE = .4
# Standard deviations among people of the line over the direction: slope and offset [1, rad].
LINE_SPREAD = .4, np.radians(12.)
AVERAGE_WORTH = 10.  # postures that weigh as much as the average person's spread
FLEXION_ROUNDS = 5   # of the line and the spread about it
# Of the line over the direction, as that over the first flexion has bounds.
STEEPEST_SLOPE = NATURAL_SLOPE_RANGE[1] / (1. + DIRECTION_SHARE * NATURAL_SLOPE_RANGE[1])


class FlexionLine(NamedTuple):
    """A digit's row of `Hand.natural_flexion`, and how well it is known.

    Attributes
    ----------
    row : ndarray, shape (3,)
        Slope, offset and spread [1, rad, rad].
    deviations, before : ndarray, shape (2,)
        Standard deviations of slope and offset, with and without the postures [1, rad].
    """

    row: np.ndarray
    deviations: np.ndarray
    before: np.ndarray


def fit_flexion_line(first: np.ndarray, second: np.ndarray, average: np.ndarray) -> FlexionLine:
    """Return the line of a digit's postures.

    Parameters
    ----------
    first, second : ndarray, shape (n,)
        Flexions [rad].
    average : ndarray, shape (3,)
        Row of an average person [1, rad, rad].

    Returns
    -------
    FlexionLine
    """
    weight = min(1., INDEPENDENT_POSTURES / max(len(first), 1))
    # Over the direction, first + share second, slope, offset and spread are smaller by this.
    smaller = 1. + DIRECTION_SHARE * average[0]
    usual, usual_variance = average[:2] / smaller, (average[2] / smaller) ** 2
    known = np.diag(np.array(LINE_SPREAD) ** -2.)
    directions = np.column_stack((first + DIRECTION_SHARE * second, np.ones(len(first))))
    variance, line, precision = usual_variance, usual, known
    for _ in range(FLEXION_ROUNDS):
        precision = known + weight / variance * directions.T @ directions
        line = np.linalg.solve(precision, known @ usual + weight / variance * directions.T @ second)
        misses = second - directions @ line
        variance = ((AVERAGE_WORTH * usual_variance + weight * misses @ misses)
                    / (AVERAGE_WORTH + weight * len(first)))
    # That of a digit which bends in its second joint alone would be vertical over the first.
    excess = max(line[0] - STEEPEST_SLOPE, 0.)
    if excess > 0.:
        line = line + (-excess, excess * directions[:, 0].mean())
    larger = 1. / (1. - DIRECTION_SHARE * line[0])
    row = np.array([np.clip(value, *bounds) for value, bounds in zip(
        larger * np.append(line, np.sqrt(variance)),
        (NATURAL_SLOPE_RANGE, NATURAL_OFFSET_RANGE, NATURAL_SPREAD_RANGE))])
    return FlexionLine(row, _over_first(line, np.linalg.inv(precision)),
                       _over_first(usual, np.linalg.inv(known)))


def _over_first(line: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Return the deviations (2,) of a line over the first flexion, from one over the direction."""
    larger = 1. / (1. - DIRECTION_SHARE * line[0])
    change = np.array(((larger ** 2, 0.), (DIRECTION_SHARE * line[1] * larger ** 2, larger)))
    return np.sqrt(np.diag(change @ covariance @ change.T))
