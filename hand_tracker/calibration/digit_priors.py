"""Priors of a digit's fit: proportions, skin, postures.

All spreads are standard deviations over people; where no source stands they are ours.
"""

from typing import NamedTuple

import numpy as np

from ..core.model.hand import (
    COUPLING_PRESETS,
    DIGITS,
    FINGER_BONES_OF_LENGTH,
    FINGERS,
    FLEXION_JOINTS,
    MEAN_LENGTH,
    THUMB_BONES_OF_LENGTH,
    THUMB_COUPLING,
    Hand,
    preset_limits,
)
from ..core.model.kinematics import digit_base
from .digit_chain import (
    BONE_PART,
    COUPLING_PART,
    FIRST_OFFSET,
    LEAN_PART,
    ROOT_PART,
    Chain,
)
from .marker_residuals import PosturePrior, ShapePrior
from .ruler import UNMEASURED, Ruler

# Share of the hand's length by which proportions differ between people [1].
BONE_SPREAD = .08
MEASURED_BONE_SPREAD = .04       # within a finger of a length by a ruler
# Of a knuckle beside the place below its marker, and beside the mean hand's [m].
MARKED_ROOT_SPREAD = (.004, .002, .003)
UNMARKED_ROOT_SPREAD = (.006, .004, .004)
# Of a knuckle whose marker rides on the finger: marker from it along the bone, and spreads [m].
RIDING_OFFSET = .010
RIDING_SPREAD, RIDING_ROOT_SPREAD = (.010, .003, .004), (.010, .005, .004)
THUMB_ROOT_SPREAD = (.008, .008, .008)
FINGER_LEAN_SPREAD, THUMB_LEAN_SPREAD = np.tan(np.radians((6., 20.)))
COUPLING_SPREAD = (.25, np.radians(12.))
THUMB_COUPLING_SPREAD = (.5, np.radians(15.))
# Markers' centres above the joints, dorsal, at `MEAN_LENGTH`: over the knuckle, and over the ends
# of the three bones; from takes [m].
KNUCKLE_HEIGHT = .011
FINGER_HEIGHTS, THUMB_HEIGHTS = (.010, .009, .008), (.011, .009, .008)
OFFSET_SPREAD_AT_JOINT = (.005, .002, .003)
# Behind the end of the bone, as on the nail [m].
TIP_OFFSET = -.003
OFFSET_SPREAD_OF_THUMB = (.005, .004, .004)
# Share of a joint's flexion by which the skin over it turns.
SKIN_SHARE, SKIN_SHARE_SPREAD = .25, .25
FIXED = 1e-5  # spread of what does not vary

FINGER_POSTURE = PosturePrior(
    np.radians((0., 15., 8., 0.)), np.radians((8., 50., 35., 2.)), .8,
    np.radians((-35., -50., 0., -20.)), np.radians((35., 100., 120., 100.)))
THUMB_POSTURE = PosturePrior(
    np.radians((0., 0., 10., 0.)), np.radians((30., 40., 30., 2.)), 0.,
    np.radians((-80., -80., -20., -25.)), np.radians((80., 80., 75., 100.)))
# Abduction of the thumb's MCP: mean, spread, and limits.
MCP_ABDUCTION_POSTURE = np.radians((0., 3., -20., 20.))


class Marked(NamedTuple):
    """Markers of a digit.

    Attributes
    ----------
    names : tuple of str
    links : ndarray of int, shape (m,)
    knuckles : ndarray of bool, shape (m,)
        Whether it is near the root of its link instead of its end.
    worn : ndarray of bool, shape (m,)
        Whether the tracker will get it: then it does not turn with the skin.
    """

    names: tuple[str, ...]
    links: np.ndarray
    knuckles: np.ndarray
    worn: np.ndarray


def digit_chain(hand: Hand, digit: int, links: np.ndarray) -> Chain:
    """Return the chain of a digit with the axes of a hand.

    Parameters
    ----------
    hand : Hand
        Of the right side, with usual axes.
    digit : int
        0 to 4, index finger to thumb.
    links : ndarray of int, shape (m,)
        Of its markers.

    Returns
    -------
    Chain
    """
    return Chain(digit_base(hand, digit)[0], np.asarray(links))


def digit_posture(hand: Hand, digit: int, links: np.ndarray) -> PosturePrior:
    """Return the prior of a digit's angles; flexions count from the x axis of its base.

    Parameters
    ----------
    hand : Hand
    digit : int
        0 to 4, index finger to thumb.
    links : ndarray of int, shape (m,)
        Of its markers: those before and behind the thumb's MCP together show its abduction.

    Returns
    -------
    PosturePrior
    """
    if DIGITS[digit] in FINGERS:
        return FINGER_POSTURE
    lower, upper = THUMB_POSTURE.lower.copy(), THUMB_POSTURE.upper.copy()
    if len(links) == 1:
        # One marker does not tell the flexions apart: none leaves the usual range without need.
        lower[1:], upper[1:] = preset_limits('paper')[FLEXION_JOINTS[digit]].T
    tilt = digit_base(hand, digit)[2]
    shift = np.array((0., tilt, 0., 0.))
    mean, spread, lower, upper = (THUMB_POSTURE.mean + shift, THUMB_POSTURE.spread,
                                  lower + shift, upper + shift)
    if (links == 0).any() and (links > 0).any():
        mean, spread, lower, upper = (np.append(usual, aside) for usual, aside in zip(
            (mean, spread, lower, upper), MCP_ABDUCTION_POSTURE))
    return PosturePrior(mean, spread, THUMB_POSTURE.ratio, lower, upper)


def digit_prior(hand: Hand, digit: int, marked: Marked, length: float,
                knuckle: np.ndarray | None, ruler: Ruler = UNMEASURED) -> ShapePrior:
    """Return the usual shape of a digit.

    Parameters
    ----------
    hand : Hand
        The mean hand in the size of the palm.
    digit : int
        0 to 4, index finger to thumb.
    marked : Marked
    length : float
        Length of the hand; bones are shares of it [m].
    knuckle : ndarray, shape (3,), optional
        Place of the marker over the digit's root, in the palm's frame; one that rides on the
        digit, its median [m].
    ruler : Ruler, optional

    Returns
    -------
    ShapePrior
    """
    is_thumb = DIGITS[digit] not in FINGERS
    size = FIRST_OFFSET + 4 * len(marked.links)
    mean, spread = np.zeros(size), np.zeros(size)
    heights = ruler.raised + np.multiply(
        THUMB_HEIGHTS if is_thumb else FINGER_HEIGHTS, length / MEAN_LENGTH)
    if is_thumb:
        mean[ROOT_PART], spread[ROOT_PART] = hand.thumb_cmc, THUMB_ROOT_SPREAD
    elif knuckle is None:
        mean[ROOT_PART], spread[ROOT_PART] = hand.finger_mcp[digit], UNMARKED_ROOT_SPREAD
    else:
        rides = marked.knuckles.any()
        mean[ROOT_PART] = knuckle - (
            RIDING_OFFSET if rides else 0., 0., KNUCKLE_HEIGHT + ruler.raised)
        spread[ROOT_PART] = RIDING_ROOT_SPREAD if rides else MARKED_ROOT_SPREAD
    spread[LEAN_PART] = THUMB_LEAN_SPREAD if is_thumb else FINGER_LEAN_SPREAD
    mean[BONE_PART] = np.multiply(
        THUMB_BONES_OF_LENGTH if is_thumb else FINGER_BONES_OF_LENGTH[digit], length)
    spread[BONE_PART] = BONE_SPREAD * mean[BONE_PART]
    if ruler.fingers and not is_thumb:
        mean[BONE_PART] *= ruler.fingers[digit] / mean[BONE_PART].sum()
        spread[BONE_PART] = MEASURED_BONE_SPREAD * mean[BONE_PART]
    mean[COUPLING_PART] = THUMB_COUPLING if is_thumb else COUPLING_PRESETS['natural']
    spread[COUPLING_PART] = THUMB_COUPLING_SPREAD if is_thumb else COUPLING_SPREAD
    last = 2
    for i, link in enumerate(marked.links):
        first, share = FIRST_OFFSET + 3 * i, FIRST_OFFSET + 3 * len(marked.links) + i
        mean[first:first + 3] = (TIP_OFFSET if link == last else 0., 0.,
                                 heights[link])
        spread[first:first + 3] = OFFSET_SPREAD_OF_THUMB if is_thumb else OFFSET_SPREAD_AT_JOINT
        if marked.knuckles[i]:
            mean[first] = RIDING_OFFSET - mean[BONE_PART][0]
            spread[first:first + 3] = RIDING_SPREAD
        turns = link < last and not marked.worn[i] and not marked.knuckles[i]
        mean[share] = SKIN_SHARE if turns else 0.
        spread[share] = SKIN_SHARE_SPREAD if turns else FIXED
    return ShapePrior(mean, spread)
