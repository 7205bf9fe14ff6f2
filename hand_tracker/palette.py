"""The colours of pictures: the colour-blind-safe palette of Okabe and Ito (2008), and greys."""

from .core.report import MarkerState

ORANGE, SKY_BLUE, BLUISH_GREEN = '#E69F00', '#56B4E9', '#009E73'
BLUE, VERMILLION, REDDISH_PURPLE = '#0072B2', '#D55E00', '#CC79A7'

PAPER = '#FFFFFF'   # opaque, so that ink is legible on a dark page too
INK, MUTED, GRID = '#333333', '#6B737B', '#E9ECEF'

ANGLE = BLUE
MARKER_COLOURS = {
    MarkerState.SEEN: BLUISH_GREEN, MarkerState.PREDICTED: ORANGE,
    MarkerState.ABSENT: '#D9D9D9', MarkerState.REJECTED: VERMILLION,
    MarkerState.SWAPPED: SKY_BLUE, MarkerState.STALE: '#737373'}
# In the order of `DIGITS`
DIGIT_COLOURS = (SKY_BLUE, BLUE, BLUISH_GREEN, REDDISH_PURPLE, ORANGE)
