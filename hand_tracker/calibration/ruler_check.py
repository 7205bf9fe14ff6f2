"""Whether what a ruler says agrees with the markers of the takes."""

from collections.abc import Iterator

import numpy as np

from ..core.model.hand import FINGERS
from .digit_chain import BONE_PART
from .marker_fit import fit_gathered
from .ruler import RULER_SPREAD, Ruler
from .takes import Gathered, InvalidTake

BREADTH_DEVIATION = .008    # [m] of the breadth by the markers, of which eight tell little; ours
MOST_DEVIATIONS = 2.5       # between ruler and markers; ours


def ruler_doubts(gathered: Gathered, side: str) -> list[str]:
    """Return a line on each length by the ruler that markers contradict.

    Parameters
    ----------
    gathered : Gathered
        With the ruler. The hand is fitted without its lengths, which takes seconds, if there are
        any.
    side : {'right', 'left'}
    """
    ruler = gathered.ruler
    if ruler == Ruler(marker_height=ruler.marker_height):
        return []
    return [f'{name} is {1e3 * measured:.0f} mm by the ruler, but {1e3 * found:.0f} mm by the '
            f'markers alone (standard deviation {1e3 * deviation:.0f} mm): is it measured right, '
            'and are the markers where their labels say?'
            for name, measured, found, deviation in _compared(gathered, side)
            if abs(measured - found) > MOST_DEVIATIONS * np.hypot(
                deviation, RULER_SPREAD * measured)]


def _compared(gathered: Gathered, side: str) -> Iterator[tuple[str, float, float, float]]:
    """Yield each measured length: its name, by the ruler and by markers, deviation [m]."""
    ruler = gathered.ruler
    try:
        fit = fit_gathered(gathered._replace(ruler=Ruler(marker_height=ruler.marker_height)), side)
    except InvalidTake:     # what the ruler says is needed
        return
    if ruler.length:
        yield "the hand's length", ruler.length, fit.length, fit.length_deviation
    if ruler.breadth:
        yield "the hand's breadth", ruler.breadth, fit.palm.breadth, BREADTH_DEVIATION
    for finger, measured, digit, bones in zip(
            FINGERS, ruler.fingers or (), fit.digits, fit.hand.finger_bones):
        if digit is not None:
            yield (f"the {finger} finger's length", measured, float(bones.sum()),
                   float(np.sqrt(digit.covariance[BONE_PART, BONE_PART].sum())))
