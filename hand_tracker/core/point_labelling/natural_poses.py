"""Model prototype of an unrecorded hand: its markers in natural poses of the hand model."""

from typing import NamedTuple

import numpy as np

from ..model.hand import ABDUCTION_JOINTS, DIGITS, FLEXION_JOINTS, LINKS, Hand, preset_limits
from ..model.kinematics import forward, joint_table
from ..model.marker_layout import MarkerLayout, marker_positions
from .prototypes import HandPrototype, learn_prototype

POSES = 1500
COMMON_CURL = .7            # share of a finger's flexion common to all fingers; ours
THUMB_CURL = .5             # largest flexion of the thumb before scatter, of its range; ours
CURL_SCATTER = .12          # scatter of the first flexion, of its range; twice for the second; ours
ABDUCTION_SCATTER = (10.,) * 4 + (27.5,)  # [degrees] standard deviation of each digit's; ours
LARGEST_SCATTER = 2.        # [1] standard deviations at which abduction is clipped


class HandTolerances(NamedTuple):
    """How far markers of a hand may be off those of its model; parameters of `learn_prototype`.

    Attributes
    ----------
    deviations : (float, float, float)
        Of a palm marker, of a digit, and of each of its markers [m].
    sizes : (float, float)
        Least and greatest size of a palm, relative to the model's.
    shape : float
        Relative tolerance of the lengths of the palm's sides.
    """

    deviations: tuple[float, float, float]
    sizes: tuple[float, float]
    shape: float


# Ours. Markers are put on anew for each take, and rulers err.
ANYBODY = HandTolerances((.006, .012, .006), (.7, 1.45), .15)
SIZED = HandTolerances((.006, .012, .006), (.9, 1.1), .08)
FITTED = HandTolerances((.004, .008, .004), (.9, 1.1), .08)


def tolerances_of(hand: Hand) -> HandTolerances:
    """Return how well a hand is known: a fit alone finds its range of motion."""
    if hand.range_of_motion.any():
        return FITTED
    mean = Hand.scaled(side=hand.side)
    is_mean = (np.array_equal(hand.finger_bones, mean.finger_bones)
               and np.array_equal(hand.finger_mcp, mean.finger_mcp))
    return ANYBODY if is_mean else SIZED


def natural_poses(hand: Hand, count: int = POSES) -> np.ndarray:
    """Draw random poses with correlated flexion of the fingers, the same ones at each call.

    Parameters
    ----------
    hand : Hand
    count : int, optional

    Returns
    -------
    ndarray, shape (count, 25)
        Angles within the 'wide' limits [rad].
    """
    random = np.random.RandomState(1)
    limits = preset_limits('wide')
    lower, upper = limits.T
    angles = np.zeros((count, len(lower)))
    common = random.uniform(size=(count, 1))
    curl = np.clip(COMMON_CURL * common + (1. - COMMON_CURL) * random.uniform(size=(count, 5)),
                   0., 1.)
    # The thumb flexes independently, and hardly ever beyond the middle of the palm.
    curl[:, -1] = THUMB_CURL * random.uniform(size=count)
    for i, joints in enumerate((FLEXION_JOINTS[:, 0], FLEXION_JOINTS[:, 1])):
        bend = np.clip(curl + CURL_SCATTER * (1. + i) * random.normal(size=curl.shape), 0., 1.)
        # From half the hyperextension on: hands are rarely bent back as far as they go.
        start = .5 * lower[joints]
        angles[:, joints] = start + bend * (upper[joints] - start)
    spread = np.radians(ABDUCTION_SCATTER) * np.clip(
        random.normal(size=(count, 5)), -LARGEST_SCATTER, LARGEST_SCATTER)
    middle = .5 * (lower + upper)[ABDUCTION_JOINTS]
    angles[:, ABDUCTION_JOINTS] = np.where(np.arange(5) == 4, middle, 0.) + spread
    return hand.coupled(angles, limits)


def model_prototype(hand: Hand, layout: MarkerLayout, names: tuple[str, ...],
                    tolerances: HandTolerances = ANYBODY) -> HandPrototype:
    """Return the prototype of a hand by its model in natural poses.

    Parameters
    ----------
    hand : Hand
    layout : MarkerLayout
    names : tuple of str
        Of the layout's markers.
    tolerances : HandTolerances, optional
        `SIZED` for a hand of the wearer's size, `FITTED` for one fitted to the wearer's markers.

    Returns
    -------
    HandPrototype

    Raises
    ------
    InvalidLayout
        If the palm has no triangle of markers.
    """
    right = hand.as_right()
    mounting = layout.mounting(right)
    places = marker_positions(mounting, forward(joint_table(right), natural_poses(right)))
    found = learn_prototype(names, places, marker_digits(mounting.link), 'right', *tolerances)
    return found if hand.side == 'right' else found.mirrored()


def marker_digits(links: np.ndarray) -> list[int]:
    """Return the digit of the markers on links, -1 for those on the palm."""
    digits = []
    for link in links:
        digit, _, bone = ('wrist' if link < 0 else LINKS[link]).partition('_')
        on_palm = digit not in DIGITS or (bone == 'metacarpal' and digit != 'thumb')
        digits.append(-1 if on_palm else DIGITS.index(digit))
    return digits
