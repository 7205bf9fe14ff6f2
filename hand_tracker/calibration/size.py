"""Size of an unmeasured hand, from the first seconds of its markers.

The palm follows from the distances of its three markers. A finger's length is the one with
which its poses are the most natural: a finger that is too short never reaches its marker, one
that is too long bends in its PIP where its MCP is straight. Ours; no source.
"""

import numpy as np
from numpy.typing import ArrayLike

from ..core.errors import InvalidHand
from ..core.model.hand import (
    FINGERS,
    LEFT_HAND_MIRROR,
    MEAN_LENGTH,
    RELAXED_FINGERS,
    Hand,
    cmc_joints,
)
from ..core.model.marker_layout import PALM_MARKERS, MarkerLayout
from ..core.numerics.sampling import evenly_spaced
from .hand_faults import unit_of
from .least_squares import least_squares
from .palm_template import rigid_poses, to_palm

MIN_SIZE_FRAMES = 20    # with the whole palm seen
SIZE_FRAMES = 100       # that are read, at most
SHEAR_SPREAD = .3       # [1] standard deviation of the palm's shear, and of length minus breadth
PALM_ERROR = .001       # [m] standard deviation of the distances of the palm's markers

# Scales of the fingers' bones relative to the mean hand's [1].
SCALES = np.arange(.75, 1.36, .005)  # that are tried
PALM_SCALE_RANGE = (.85, 1.08)  # of the expected one, the palm's: forearm markers lengthen palms
SCALE_SPREAD = .03              # half width of their Cauchy distribution about the expected one
FINGER_SPREAD = .03             # standard deviation of one finger's about that of all
INDEPENDENT_POSES = 3.          # weight of the poses, which are alike within seconds

# Natural poses: standard deviations of flexion [rad], and of a marker beyond the reach [m].
BEND_SPREAD = np.radians(20.)           # of the PIP's about `NATURAL_BEND` of the MCP's
LIMIT_SPREAD = .1                       # of the PIP's beyond `DEEPEST_BEND`
EXTENSION_SPREAD = .2                   # of the MCP's beyond `DEEPEST_EXTENSION`
MISS_SPREAD = .001
DEEPEST_BEND = np.radians(100.)         # of a PIP
DEEPEST_EXTENSION = np.radians(-20.)    # of an MCP
# Flexion of each finger's PIP by that of its MCP, in the relaxed hand.
NATURAL_BEND = np.array([second / first for first, second in RELAXED_FINGERS])


def fit_size(markers: ArrayLike, hand: Hand, layout: MarkerLayout | None = None) -> Hand | None:
    """Return the mean hand in the size of the wearer's hand.

    Parameters
    ----------
    markers : array_like, shape (T, n, 3)
        Some seconds, in the order of the layout, NaN where not seen [m].
    hand : Hand
        Source of side, limits, coupling and natural flexion.
    layout : MarkerLayout, optional
        Where the markers are worn; the paper's places when left out.

    Returns
    -------
    Hand or None
        None with too few frames of the three principal markers of the palm, with these at one
        landmark, or a palm that is no hand's.
    """
    layout = MarkerLayout() if layout is None else layout
    if len({layout.places[row] for row in layout.principal[:len(PALM_MARKERS)]}) == 1:
        return None  # as on the plate of a glove, whose size is its own
    frames = _principal_markers(np.asarray(markers, dtype=float), layout)
    if hand.side == 'left':
        frames = frames * LEFT_HAND_MIRROR
    whole = frames[np.isfinite(frames[:, :len(PALM_MARKERS)]).all(axis=(1, 2))]
    if len(whole) < MIN_SIZE_FRAMES:
        return None
    whole = whole[evenly_spaced(len(whole), SIZE_FRAMES)]
    try:
        palm = _fit_palm(np.median(_sides(whole[:, :len(PALM_MARKERS)]), axis=0), layout)
        sized = _hand_of(palm, np.ones(len(FINGERS)))
    except InvalidHand:
        return None
    if unit_of(float(np.linalg.norm(sized.finger_mcp[0] - sized.finger_mcp[-1]))) != 'metres':
        return None
    template = layout.principal_mounting(sized).position[:len(PALM_MARKERS)]
    local = to_palm(whole, *rigid_poses(whole[:, :len(PALM_MARKERS)], template))
    scales = _fit_fingers(local[:, len(PALM_MARKERS):-1], sized, layout,
                          float(np.clip(palm[:2].mean(), *PALM_SCALE_RANGE)))
    return _hand_of(palm, scales).replace(
        side=hand.side, limits=hand.limits, coupling=hand.coupling,
        natural_flexion=hand.natural_flexion)


def _principal_markers(markers: np.ndarray, layout: MarkerLayout) -> np.ndarray:
    """Return a layout's markers (..., n, 3) that stand for the paper's eight, (..., 8, 3) [m]."""
    rows = np.array(layout.principal)
    return np.where((rows < 0)[:, None], np.nan, markers[..., rows, :])


def _sides(palm: np.ndarray) -> np.ndarray:
    """Return the distances of the palm's markers (..., 3, 3) from each other, (..., 3) [m]."""
    return np.linalg.norm(palm - np.roll(palm, 1, axis=-2), axis=-1)


def _hand_of(palm: np.ndarray, fingers: np.ndarray) -> Hand:
    """Return the mean hand with another size.

    Parameters
    ----------
    palm : ndarray, shape (3,)
        Scale of its length and of its breadth, and its shear to the thumb's side.
    fingers : ndarray, shape (4,)
        Scales of the fingers' proximal and middle bones.
    """
    mean = Hand.scaled()
    along, across, shear = palm
    grown = mean.finger_mcp @ np.array(
        ((along, 0., 0.), (shear, across, 0.), (0., 0., along))).T
    scale = fingers.mean()
    bones = mean.finger_bones * np.column_stack((fingers, fingers, np.full(len(fingers), along)))
    # The wrist's marker may be worn behind the wrist: the thumb is placed from the knuckles.
    middle = FINGERS.index('middle')
    thumb = mean.thumb_cmc * (scale, across, scale)
    thumb[0] += grown[middle, 0] - scale * mean.finger_mcp[middle, 0]
    return mean.replace(
        finger_mcp=grown, finger_bones=bones, thumb_cmc=thumb, thumb_bones=scale * mean.thumb_bones,
        finger_cmc=cmc_joints(grown, MEAN_LENGTH * along), radii=scale * mean.radii,
        palm_radius=across * mean.palm_radius)


def _fit_palm(sides: np.ndarray, layout: MarkerLayout) -> np.ndarray:
    """Return the palm, as of `_hand_of`, whose markers have these distances, shape (3,) [m]."""
    fingers = np.ones(len(FINGERS))

    def distances(palm: np.ndarray) -> np.ndarray:
        return _sides(layout.principal_mounting(
            _hand_of(palm, fingers)).position[:len(PALM_MARKERS)])

    def misses(palm: np.ndarray) -> np.ndarray:
        along, across, shear = palm
        return np.append((distances(palm) - sides) / PALM_ERROR,
                         np.array((along - across, shear)) / SHEAR_SPREAD)

    start = np.array((1., 1., 0.))
    start[:2] *= sides.sum() / distances(start).sum()
    return least_squares(misses, start).x


def _fit_fingers(markers: np.ndarray, hand: Hand, layout: MarkerLayout,
                 usual: float) -> np.ndarray:
    """Return the scales of the fingers' bones for the most natural poses, (4,).

    Parameters
    ----------
    markers : ndarray, shape (T, 4, 3)
        Of the fingers in the wrist's frame, NaN where not seen [m].
    hand : Hand
        With the fitted palm, and the fingers of the mean hand.
    layout : MarkerLayout
    usual : float
        Expected scale [1].
    """
    # Of few hands, but far from those: some palms say nothing of their fingers.
    unusual = np.log1p(((SCALES - usual) / SCALE_SPREAD) ** 2)
    costs = unusual + np.array([_unnaturalness(markers[:, finger], hand, layout, finger)
                                for finger in range(len(FINGERS))])
    # The scale that all fingers share, and each finger's own beside it.
    apart = ((SCALES[:, None] - SCALES) / FINGER_SPREAD) ** 2
    together = costs[:, None, :] + apart
    shared = together.min(axis=2).sum(axis=0).argmin()
    return SCALES[together[:, shared].argmin(axis=1)]


def _unnaturalness(markers: np.ndarray, hand: Hand, layout: MarkerLayout,
                   finger: int) -> np.ndarray:
    """Return the cost of a finger's poses with its bones at each of `SCALES` [1]."""
    row = layout.principal[len(PALM_MARKERS) + finger]
    if row < 0 or not layout.places[row].endswith('_dip'):
        return np.zeros(len(SCALES))  # the last joint's coupling would have to be known
    ahead, _, above = layout.offsets[row]
    arms = markers[np.isfinite(markers).all(axis=1)] - hand.finger_mcp[finger]
    along = np.copysign(np.hypot(arms[:, 0], arms[:, 1]), arms[:, 0])[:, None]
    below = -arms[:, 2:]
    reach, aim = np.hypot(along, below), np.arctan2(below, along)

    mean = Hand.scaled().finger_bones[finger]
    first, second = SCALES * mean[0], SCALES * mean[1] + ahead
    droop = np.arctan2(-above, second)
    second = np.hypot(second, above)
    bend = np.arccos(np.clip(
        (reach ** 2 - first ** 2 - second ** 2) / (2. * first * second), -1., 1.))
    pip = bend - droop
    mcp = aim - np.arctan2(second * np.sin(bend), first + second * np.cos(bend))
    costs = ((pip - NATURAL_BEND[finger] * np.maximum(mcp, 0.)) / BEND_SPREAD) ** 2
    costs += (np.maximum(pip - DEEPEST_BEND, 0.) / LIMIT_SPREAD) ** 2
    costs += (np.maximum(DEEPEST_EXTENSION - mcp, 0.) / EXTENSION_SPREAD) ** 2
    costs += (np.maximum(reach - first - second, 0.) / MISS_SPREAD) ** 2
    if not len(costs):
        return np.zeros(len(SCALES))
    # Robust: linear beyond one standard deviation.
    return INDEPENDENT_POSES * 2. * (np.sqrt(1. + costs) - 1.).mean(axis=0)
