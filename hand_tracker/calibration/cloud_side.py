"""Side of the hands among points without names, by their shape in single frames."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..core.model.hand import BOTH, SIDES, Hand
from ..core.model.marker_layout import MARKERS, MarkerLayout
from ..core.numerics.sampling import evenly_spaced, every_few
from ..core.point_labelling.cloud_labeller import CloudLabeller
from ..core.point_labelling.natural_poses import model_prototype
from .cloud_size import SAMPLED_CLOUDS

SEARCHED_CLOUDS = 7      # frames at most, of those with as many points as usual; ours
EMPTY_CLOUDS = 2         # frames without a hand after which no more are searched; ours
CLOUD_BUDGET = 20_000    # distances of points from markers that a search takes; ours
FRAME_LEAD = 20.         # by which a frame may count for one of the hypotheses, at most; ours
DECISIVE_LEAD = 30.      # of all frames together, after which no more are searched; ours
SECOND_HAND_COST = 40.   # by which two hands must fit better than one; ours
SURE_SIDE = .8           # share of the probability from which a side is named; ours


def likely_side(clouds: np.ndarray) -> tuple[str, float]:
    """Return whether points are of a right hand, a left one or both, and how often of any.

    Parameters
    ----------
    clouds : ndarray, shape (T, n, 3)
        See `side_likelihoods`.

    Returns
    -------
    side : {'right', 'left', 'both', ''}
        Empty where that is uncertain.
    share : float
        Of the searched frames that show a hand [1].
    """
    likelihoods = side_likelihoods(clouds)
    share = sum(likelihoods.values())
    return next((side for side, one in likelihoods.items() if one > SURE_SIDE * share), ''), share


def side_likelihoods(clouds: np.ndarray) -> dict[str, float]:
    """Return the probability that points are of a right hand, of a left one, or of both.

    Parameters
    ----------
    clouds : ndarray, shape (T, n, 3)
        With the paper's markers; NaN where a point is missing [m].

    Returns
    -------
    dict of str to float
        By 'right', 'left' and 'both'; together the share of searched frames that show a hand.
    """
    right = model_prototype(Hand.scaled(), MarkerLayout(), MARKERS)
    left = right.mirrored()
    labellers = {SIDES[0]: CloudLabeller([right]), SIDES[1]: CloudLabeller([left]),
                 BOTH: CloudLabeller([right, left])}
    clouds = every_few(clouds, SAMPLED_CLOUDS)
    counts = np.isfinite(clouds).all(axis=2).sum(axis=1)
    usual = np.flatnonzero(counts >= np.median(counts)) if len(counts) else counts
    frames = clouds[usual[evenly_spaced(len(usual), SEARCHED_CLOUDS)]]
    leads: list[np.ndarray] = []
    searched = 0
    for searched, frame in enumerate(frames, start=1):
        costs = _frame_costs(frame[np.isfinite(frame).all(axis=1)].astype(float), labellers)
        # Too many points to be searched leave NaN.
        if costs.min() < 0.:
            leads.append(np.minimum(costs - costs.min(), FRAME_LEAD))
        best, second = np.sort(np.sum(leads, axis=0))[:2] if leads else (0., 0.)
        if second - best >= DECISIVE_LEAD or searched - len(leads) >= EMPTY_CLOUDS:
            break
    if not leads:
        return dict.fromkeys(labellers, 0.)
    # Frames of one take are no independent observations: the usual one counts.
    odds = np.exp(-.5 * np.mean(leads, axis=0))
    share = len(leads) / searched
    return dict(zip(labellers, (share * odds / odds.sum()).tolist()))


def _frame_costs(cloud: np.ndarray, labellers: Mapping[str, CloudLabeller]) -> np.ndarray:
    """Return the cost of each hypothesis in a frame, (n, 3) [m]: 0 of no hand, NaN of too many."""
    costs = np.zeros(len(labellers))
    # Degenerate points, of which plain Python warns, are no hand.
    with np.errstate(divide='ignore', invalid='ignore', over='ignore'):
        for row, side in enumerate(SIDES):
            costs[row] = labellers[side].frame_cost(cloud, CLOUD_BUDGET)
        # Two hands at least look like one of each side.
        if costs[:len(SIDES)].max() < 0.:
            costs[-1] = labellers[BOTH].frame_cost(cloud, CLOUD_BUDGET)
            costs[-1] += SECOND_HAND_COST
    return costs
