"""The palm's markers: their places in the palm's frame, and the palm's pose in every frame."""

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from ..core.model.hand import (
    FINGERS,
    HAND_BREADTH_RANGE,
    HAND_LENGTH_RANGE,
    MCP_OF_LENGTH,
    MEAN_BREADTH,
    MEAN_LENGTH,
    Hand,
)
from ..core.model.marker_layout import landmark_on_link
from ..core.numerics.rigid_fit import nearest_rotation
from ..core.numerics.sampling import evenly_spaced
from .least_squares import least_squares
from .marker_names import UsualPlace
from .ruler import RULER_SPREAD, UNMEASURED, Ruler
from .takes import InvalidTake

ELSEWHERE = .02     # [m] off its place, beyond which a marker is another one; ours
# [m] that a rigid marker of the palm is off its place at most, else it is elsewhere, or another is;
# on recorded skin 8 in all but single frames. Ours.
OUT_OF_SHAPE = .008
TOLD_SHARE = .01    # of the frames with a marker elsewhere; ours
TEMPLATE_ROUNDS = 6
# Change of distance, from the 10th to the 90th percentile, that a rigid pair may show [m], and that
# beside the three best, whose noise is no less [1].
RIGID_CHANGE, RIGID_RATIO = .006, 1.4
TEMPLATE_FRAMES = 1500      # evenly spaced, of which the template is made
# Height of a marker's centre above wrist and knuckles, and its spread along x, y and z [m]: bone,
# skin and half a marker. Ours, unsourced.
PALM_MARKER_HEIGHT = .011
WRIST_SPREAD = (.008, .006, .005)
KNUCKLE_SPREAD = (.004, .003, .003)
THUMB_BASE_SPREAD = (.012, .012, .012)
# Of a marker somewhere on the back of the hand: its place ahead, as a share of the hand's length.
BACK_OF_LENGTH, BACK_SPREAD = .27, (.03, .03, .005)
BACK_HEIGHT = .013
# Of a marker at the place that its layout usually has it [m].
USUAL_SPREAD = (.015, .012, .006)
BACK_NAMES = ('back', 'dorsum', 'hand', 'metacarp')
# Spreads of the logarithms of people's lengths and breadths, adults of both sexes; ours, unsourced.
LENGTH_SPREAD, BREADTH_SPREAD = .07, .07
MOST_GROWTH = .3


class PalmFit(NamedTuple):
    """The palm's markers in the frame of the hand.

    Attributes
    ----------
    names : tuple of str
    template : ndarray, shape (k, 3)
        Medians of the markers that are not rigid [m].
    rigid : ndarray of bool, shape (k,)
        Markers of constant distances, which define the palm's pose.
    length, breadth : float
        Of the mean hand of best fit to the palm's markers, as for `Hand.scaled` [m].
    usual : dict of str to UsualPlace
        Of markers at no landmark.
    ruler : Ruler
        What was measured of the hand.
    """

    names: tuple[str, ...]
    template: np.ndarray
    rigid: np.ndarray
    length: float
    breadth: float
    usual: dict[str, UsualPlace] = {}
    ruler: Ruler = UNMEASURED

    @property
    def places(self) -> dict[str, np.ndarray]:
        """Place of each marker in the palm's frame, shape (3,) each [m]."""
        return dict(zip(self.names, self.template))

    @property
    def held(self) -> dict[str, np.ndarray]:
        """Place of each rigid marker."""
        return {name: place for name, place, rigid in zip(
            self.names, self.template, self.rigid) if rigid}

    def into_palm(self, names: Sequence[str], points: np.ndarray) -> np.ndarray:
        """Return named markers (n, M, 3) in the palm's frame, by the rigid ones [m].

        Rigid ones that are elsewhere in a frame are left out, the worst first; NaN where fewer
        than three are left.
        """
        held = self._held_columns(names, points)
        while True:
            poses = rigid_poses(held, self.template[self.rigid])
            misses = np.nan_to_num(self._misses(held, *poses))
            frames = np.flatnonzero(misses.max(axis=1) > OUT_OF_SHAPE)
            if not len(frames):
                return to_palm(points, *poses)
            held[frames, misses[frames].argmax(axis=1)] = np.nan

    def misses(self, names: Sequence[str], points: np.ndarray) -> np.ndarray:
        """Return the distances of the rigid markers from their places, by all of them, (n, k) [m].

        Parameters
        ----------
        names, points
            As of `into_palm`.
        """
        held = self._held_columns(names, points)
        return self._misses(held, *rigid_poses(held, self.template[self.rigid]))

    def _held_columns(self, names: Sequence[str], points: np.ndarray) -> np.ndarray:
        return points[:, [list(names).index(name) for name in self.held]]

    def _misses(self, held: np.ndarray, rotation: np.ndarray, position: np.ndarray) -> np.ndarray:
        return np.linalg.norm(
            to_palm(held, rotation, position) - self.template[self.rigid], axis=2)


def rigid_set(points: np.ndarray) -> np.ndarray:
    """Return the mask of the rigid markers, by their distances to each other, shape (k,).

    The three that keep them best, and all that keep theirs to those about as well.

    Parameters
    ----------
    points : ndarray, shape (n, k, 3)
        NaN where missing [m].

    Returns
    -------
    ndarray of bool, shape (k,)

    Raises
    ------
    InvalidTake
        If no three are ever seen together.
    """
    count = points.shape[1]
    _, distances = _sampled(points)
    together = np.isfinite(distances).any(axis=0)
    low, high = np.nanpercentile(np.where(together, distances, 0.), (10., 90.), axis=0)
    change = np.where(together, high - low, np.inf)
    best = min(combinations(range(count), 3), key=lambda three: max(
        change[i, j] for i, j in combinations(three, 2)))
    usual = max(change[i, j] for i, j in combinations(best, 2))
    if not np.isfinite(usual):
        raise InvalidTake('no three markers of the palm are ever seen together; expected takes '
                          'with the same markers on the palm')
    allowed = max(RIGID_CHANGE, RIGID_RATIO * usual)
    return np.array([all(change[i, j] <= allowed for j in best) for i in range(count)])


def _sampled(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return evenly spaced frames, and the markers' distances to each other (m, k, k) [m]."""
    points = points[evenly_spaced(len(points), TEMPLATE_FRAMES)]
    return points, np.linalg.norm(points[:, :, None] - points[:, None], axis=3)


def rigid_poses(points: np.ndarray, template: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Fit a template rigidly to markers, frame by frame.

    Parameters
    ----------
    points : ndarray, shape (n, k, 3)
        NaN where missing [m].
    template : ndarray, shape (k, 3)
        [m]

    Returns
    -------
    rotation : ndarray, shape (n, 3, 3)
        From the template's frame to the markers' frame; NaN with fewer than three seen.
    position : ndarray, shape (n, 3)
        [m]
    """
    seen = np.isfinite(points).all(axis=2)
    enough = seen.sum(axis=1) >= 3
    weight = (seen / np.maximum(seen.sum(axis=1, keepdims=True), 1))[..., None]
    known = np.where(seen[..., None], points, 0.)
    center = (weight * known).sum(axis=1)
    middle = (weight * template).sum(axis=1)
    correlation = np.swapaxes(weight * (known - center[:, None]), 1, 2) @ (
        template - middle[:, None])
    rotation = nearest_rotation(correlation)
    rotation[~enough] = np.nan
    return rotation, center - (rotation @ middle[..., None])[..., 0]


def to_palm(points: np.ndarray, rotation: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Transform points (n, k, 3) into the palm's frame [m]."""
    return (points - position[:, None]) @ rotation


def _rigid_template(points: np.ndarray) -> np.ndarray:
    """Return the places (k, 3) of markers in a frame of their own, medians over the frames.

    Parameters
    ----------
    points : ndarray, shape (n, k, 3)
        NaN where missing [m].

    Returns
    -------
    ndarray, shape (k, 3)
        [m]
    """
    points, distances = _sampled(points)
    usual = np.nanmedian(distances, axis=0)
    # The first template is the frame nearest to the usual distances.
    missing = np.isnan(distances).sum(axis=(1, 2))
    strange = np.nansum(np.abs(distances - usual), axis=(1, 2)) + missing
    template = points[int(np.argmin(strange))]
    for _ in range(TEMPLATE_ROUNDS):
        template = np.nanmedian(to_palm(points, *rigid_poses(points, template)), axis=0)
    return template


def fit_palm(names: Sequence[str], points: np.ndarray,
             usual: dict[str, UsualPlace] | None = None, ruler: Ruler = UNMEASURED) -> PalmFit:
    """Return the palm's markers in the frame of the mean hand of best fit.

    Parameters
    ----------
    names : sequence of str
        Of the palm's markers, as 'index_mcp'; those at no landmark follow.
    points : ndarray, shape (n, k, 3)
        Of a right hand [m].
    usual : dict of str to UsualPlace, optional
        Of markers at no landmark.
    ruler : Ruler, optional

    Returns
    -------
    PalmFit

    Raises
    ------
    InvalidTake
        If some markers are never seen with the others.
    """
    rigid = rigid_set(points)
    template = np.empty((len(names), 3))
    template[rigid] = _rigid_template(points[:, rigid])
    others = to_palm(points[:, ~rigid], *rigid_poses(points[:, rigid], template[rigid]))
    is_placed = rigid.copy()
    is_placed[~rigid] = np.isfinite(others).all(axis=2).any(axis=0)
    if not is_placed.all():
        lost, held = ([name for name, is_so in zip(names, mask) if is_so]
                      for mask in (~is_placed, rigid))
        raise InvalidTake(f'{", ".join(lost)} of the palm: never seen with three of '
                          f'{", ".join(held)}; expected takes with the same markers on the palm')
    template[~rigid] = np.nanmedian(others, axis=0)
    return aligned_palm(
        PalmFit(tuple(names), template, rigid, ruler.length or MEAN_LENGTH, MEAN_BREADTH,
                usual or {}, ruler), RULER_SPREAD if ruler.length else LENGTH_SPREAD)


def aligned_palm(palm: PalmFit, length_spread: float = LENGTH_SPREAD) -> PalmFit:
    """Return the palm moved to the frame of the mean hand of best fit.

    Parameters
    ----------
    palm : PalmFit
        With the usual length of the hand.
    length_spread : float, optional
        Standard deviation of the length's logarithm.

    Returns
    -------
    PalmFit
    """
    # Here, as nodes import this module, and scipy's rotations take long to import.
    from scipy.spatial.transform import Rotation

    anchored = [i for i, name in enumerate(palm.names) if _spread(palm, name) is not None]
    spreads = np.array([_spread(palm, palm.names[i]) for i in anchored])

    breadth, breadth_spread = ((palm.ruler.breadth, RULER_SPREAD) if palm.ruler.breadth
                               else (MEAN_BREADTH, BREADTH_SPREAD))

    def placed(x: np.ndarray) -> np.ndarray:
        return palm.template @ Rotation.from_rotvec(x[:3]).as_matrix().T + x[3:6]

    def sized(x: np.ndarray) -> tuple[float, float]:
        grown = np.exp(np.clip((x[6], x[7]), -MOST_GROWTH, MOST_GROWTH))
        return (float(np.clip(palm.length * grown[0], *HAND_LENGTH_RANGE)),
                float(np.clip(breadth * grown[1], *HAND_BREADTH_RANGE)))

    def residuals(x: np.ndarray) -> np.ndarray:
        hand = Hand.scaled(*sized(x))
        anchors = np.array([_anchor(palm, hand, palm.names[i]) for i in anchored])
        misses = (placed(x)[anchored] - anchors) / spreads
        return np.append(misses.ravel(), (x[6] / length_spread, x[7] / breadth_spread))

    mean = Hand.scaled()
    anchors = np.array([_anchor(palm, mean, palm.names[i]) for i in anchored])
    rotation, position = rigid_poses(anchors[None], palm.template[anchored])
    start = np.concatenate((
        Rotation.from_matrix(rotation[0]).as_rotvec(), position[0], np.zeros(2)))
    found = least_squares(residuals, start).x
    return PalmFit(palm.names, placed(found), palm.rigid, *sized(found), palm.usual,
                   palm.ruler)


def _spread(palm: PalmFit, name: str) -> tuple[float, float, float] | None:
    """Return a marker's distance from its usual place; None of one at no landmark [m]."""
    if name in palm.usual:
        return USUAL_SPREAD
    if name == 'wrist':
        return WRIST_SPREAD
    if name == 'thumb_cmc':
        return THUMB_BASE_SPREAD
    if name.startswith(BACK_NAMES):
        return BACK_SPREAD
    return KNUCKLE_SPREAD if name.endswith('_mcp') else None


def _anchor(palm: PalmFit, hand: Hand, name: str) -> np.ndarray:
    """Return the usual place of a palm marker on a hand, shape (3,) [m]."""
    if name in palm.usual:
        landmark, offset = palm.usual[name]
        return landmark_on_link(hand, landmark)[1] + offset
    above = np.array((0., 0., PALM_MARKER_HEIGHT + palm.ruler.raised))
    if name == 'wrist':
        return above
    if name == 'thumb_cmc':
        return hand.resting_thumb_cmc() + above
    if name.startswith(BACK_NAMES):
        length = hand.finger_mcp[1, 0] / MCP_OF_LENGTH[1]
        return np.array((BACK_OF_LENGTH * length, 0., BACK_HEIGHT + palm.ruler.raised))
    return hand.finger_mcp[FINGERS.index(name.removesuffix('_mcp'))] + above
