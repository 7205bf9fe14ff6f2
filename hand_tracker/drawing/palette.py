"""Colours of all pictures: the colour-blind-safe palette of Okabe and Ito (2008), and greys."""

from ..core.model.states import MarkerState

ORANGE, SKY_BLUE, BLUISH_GREEN = '#E69F00', '#56B4E9', '#009E73'
BLUE, VERMILLION, REDDISH_PURPLE = '#0072B2', '#D55E00', '#CC79A7'

PAPER_WHITE = '#FFFFFF'   # opaque, so that ink is legible on a dark page too
INK, MUTED, GRID = '#333333', '#6B737B', '#E9ECEF'
LIGHT_GREY, GREY = '#D9D9D9', '#737373'

SKIN_TONE = '#E6B899'
MARKER_COLOURS = {
    MarkerState.SEEN: BLUISH_GREEN, MarkerState.PREDICTED: ORANGE,
    MarkerState.ABSENT: LIGHT_GREY, MarkerState.REJECTED: VERMILLION,
    MarkerState.SWAPPED: SKY_BLUE, MarkerState.STALE: GREY}
# In the order of `DIGITS`
DIGIT_COLOURS = (SKY_BLUE, BLUE, BLUISH_GREEN, REDDISH_PURPLE, ORANGE)


def rgb(colour: str) -> tuple[float, ...]:
    """Return red, green and blue, 0 to 1, of a colour like '#0072B2'."""
    return tuple(int(colour[i:i + 2], 16) / 255. for i in (1, 3, 5))
