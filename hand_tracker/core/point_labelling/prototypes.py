"""Prototype of a hand: joint normal distribution of all its markers in the palm's frame.

Learned from labelled frames of the wearer, or from natural poses of a hand model. The seen markers
of a finger and of its neighbours predict its hidden ones.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import NamedTuple

import numpy as np

from ..errors import InvalidLayout
from ..model.hand import LEFT_HAND_MIRROR, OTHER_SIDE
from ..numerics.rigid_fit import nearest_rotation
from ..numerics.sampling import evenly_spaced
from .bending import bending, outward_markers

ALIGNMENT_ROUNDS = 6         # of alignment to the mean palm
LEARNED_FRAMES = 3000       # at most, evenly spread
MIN_LEARNED_FRAMES = 20
# Standard deviations added to those of the frames, which never show all postures: of a palm marker,
# of a digit as a whole, and of each of its markers [m]; ours.
DEVIATIONS = .003, .010, .006
WEARER_SIZES = .94, 1.06    # of the palm, relative to the learned one; ours
WEARER_SHAPE = .03          # relative tolerance of the lengths of a palm's sides; ours
MAX_BASES = 6               # triangles of palm markers for the search
MIN_BASE_AREA = 2e-4        # [m²]
MAX_PALM_PAIRS = 6          # for the search where no triangle is seen
MIN_PAIR_GAP = .02          # [m]
TYPICAL_SHARE = .999        # of the learned frames that count as typical
LEAST_TYPICAL = .5          # [1] typical distance, at least, where one tells likely postures; ours
BENDING_SHARE = .03         # share of natural variance from which a digit counts as bending; ours
LINK_DEVIATION = .003       # [m] of a link's length, besides what frames show; ours
BENT_DEVIATION = .006       # [m] added for a digit that frames do not show bending; ours
LONGEST_LINK = .06          # [m] from the palm to a digit's first marker; ours
STEADY_LINK = 3.            # [1] weight of its standard deviation beside its mean; ours
SIDE_DEVIATIONS = 4.        # [1] tolerance of a triangle's sides in the search


class Prototype(NamedTuple):
    """Joint normal distribution of M markers in the palm's frame, as arrays for kernels.

    Attributes
    ----------
    template : ndarray, shape (M, 3)
        Mean place of each marker [m].
    rigid : ndarray, shape (M,)
        Weight of each marker in the rigid fit of the palm; 0 for those of the digits.
    bases : ndarray of int, shape (B, 3)
        Triangles of palm markers.
    sides : ndarray, shape (B, 3)
        Tolerance of the sides 0 1, 1 2 and 2 0 of each, relative to their lengths in a palm of
        its size.
    pairs : ndarray of int, shape (P, 2)
        Pairs of palm markers.
    pair_sides : ndarray, shape (P,)
        Tolerance of the distance of each, likewise.
    precision : ndarray, shape (3 M, 3 M)
        Inverse covariance of all markers together [1/m²].
    constant : float
        Logarithm of the covariance's determinant.
    marginal : ndarray, shape (M, 3, 3)
        Inverse covariance of each marker alone [1/m²].
    marginal_constant : ndarray, shape (M,)
        Logarithms of their determinants.
    sizes : (float, float)
        Least and greatest size of the palm, relative to the template.
    typical : float
        Squared Mahalanobis distance, per coordinate, that typical frames do not exceed.
    links : ndarray of int, shape (L, 2)
        Markers of digits that have several: neighbours, and next but one.
    lengths : ndarray, shape (L, 2)
        Mean distance of each two, and its standard deviation [m].
    between : ndarray of int, shape (L,)
        Marker between the two: the link counts only while it is hidden; -1 for neighbours.
    """

    template: np.ndarray
    rigid: np.ndarray
    bases: np.ndarray
    sides: np.ndarray
    pairs: np.ndarray
    pair_sides: np.ndarray
    precision: np.ndarray
    constant: float
    marginal: np.ndarray
    marginal_constant: np.ndarray
    sizes: tuple[float, float]
    typical: float
    links: np.ndarray
    lengths: np.ndarray
    between: np.ndarray


@dataclass(frozen=True, eq=False)
class HandPrototype:
    """Names of a hand's markers, and the joint distribution of their places.

    Parameters
    ----------
    names : tuple of str
        Of the M markers.
    side : {'right', 'left'}
    statistics : Prototype
        In the palm's frame of that side.
    added_covariance : ndarray, shape (M, M)
        Of each two markers on each axis, added to that of frames, which never show all that a hand
        does [m²].
    """

    names: tuple[str, ...]
    side: str
    statistics: Prototype
    added_covariance: np.ndarray

    def mirrored(self) -> 'HandPrototype':
        """Return the prototype of the mirrored hand, of the other side."""
        one = self.statistics
        count = len(self.names)
        signs = np.tile(LEFT_HAND_MIRROR, count)
        return replace(
            self, side=OTHER_SIDE[self.side], statistics=one._replace(
                template=one.template * LEFT_HAND_MIRROR,
                precision=one.precision * np.outer(signs, signs),
                marginal=one.marginal * np.outer(LEFT_HAND_MIRROR, LEFT_HAND_MIRROR)))

    def mixed_with(self, mean: np.ndarray, covariance: np.ndarray,
                   share: float) -> 'HandPrototype':
        """Return the prototype of these postures and of others, as one normal distribution.

        Shape and typical distance stay: the mixture's distance of a posture is at most that of this
        prototype from the mixture's mean, over 1 - `share`.

        Parameters
        ----------
        mean : ndarray, shape (3 M,)
            Of the other postures, in the palm's frame [m].
        covariance : ndarray, shape (3 M, 3 M)
            Theirs; `added_covariance` is added [m²].
        share : float
            Of the other postures in the mixture.
        """
        one = self.statistics
        off = mean - one.template.ravel()
        precision, constant, marginal, marginal_constant = _densities(
            (1. - share) * np.linalg.inv(one.precision)
            + share * (covariance + np.kron(self.added_covariance, np.eye(3)))
            + share * (1. - share) * np.outer(off, off))
        return replace(self, statistics=one._replace(
            template=one.template + share * off.reshape(-1, 3), precision=precision,
            constant=constant, marginal=marginal, marginal_constant=marginal_constant))


def learn_prototype(names: Sequence[str], frames: np.ndarray, digits: Sequence[int], side: str,
                    deviations: tuple[float, float, float] = DEVIATIONS,
                    sizes: tuple[float, float] = WEARER_SIZES,
                    shape: float = WEARER_SHAPE) -> HandPrototype:
    """Learn the statistics of a hand's markers from labelled frames.

    Parameters
    ----------
    names : sequence of str
        Of the M markers.
    frames : ndarray, shape (T, M, 3)
        Frames with a missing marker are left out [m].
    digits : sequence of int
        Digit that each marker is on; -1 for the palm, which needs at least three.
    side : {'right', 'left'}
        Of the hand that wears them.
    deviations : (float, float, float), optional
        Added to those of the frames: of a palm marker, of a digit, and of each of its markers [m].
    sizes : (float, float), optional
        Least and greatest accepted size of a palm.
    shape : float, optional
        Additional relative tolerance of the lengths of the palm's sides.

    Returns
    -------
    HandPrototype

    Raises
    ------
    InvalidLayout
        If there are too few frames, or no triangle of palm markers.
    """
    whole = np.asarray(frames, dtype=float)
    whole = whole[np.isfinite(whole).all(axis=(1, 2))]
    if len(whole) < MIN_LEARNED_FRAMES:
        raise InvalidLayout(f'{len(whole)} frames with all of the {len(names)} markers; at least '
                            f'{MIN_LEARNED_FRAMES} are needed to learn how to tell them apart')
    whole = whole[evenly_spaced(len(whole), LEARNED_FRAMES)]
    digit = np.array(digits)
    palm = np.flatnonzero(digit < 0).tolist()
    template, local = _aligned(whole, palm)
    rigid = (digit < 0).astype(float)
    bases, tolerances = _bases(template[palm], whole[:, palm], shape)
    pairs, pair_tolerances = _pairs(template[palm], whole[:, palm], shape)
    off = (local - template).reshape(len(local), -1)
    of_palm, of_digit, of_marker = (deviation ** 2 for deviation in deviations)
    added = np.where(np.equal.outer(digit, digit) & (digit >= 0), of_digit, 0.)
    added += np.diag(np.where(digit < 0, of_palm, of_marker))
    shown = off.T @ off / len(off)
    precision, constant, marginal, marginal_constant = _densities(
        shown + np.kron(added, np.eye(3)) + _not_shown(shown, template, digit))
    distances = np.einsum('ni,ij,nj->n', off, precision, off)
    return HandPrototype(tuple(names), side, Prototype(
        template, rigid, np.array(palm)[bases], tolerances, np.array(palm)[pairs],
        pair_tolerances, precision, constant, marginal, marginal_constant, sizes,
        float(np.quantile(distances, TYPICAL_SHARE)) / off.shape[1],
        *_links(local, digit, shape, _lacking(shown, bending(template, digit), digit))),
        added)


def _densities(covariance: np.ndarray) -> tuple[np.ndarray, float, np.ndarray, np.ndarray]:
    """Return what a `Prototype` holds of a covariance (3 M, 3 M) [m²], from `precision` on."""
    alone = np.array([covariance[i:i + 3, i:i + 3] for i in range(0, len(covariance), 3)])
    return (np.linalg.inv(covariance), float(np.linalg.slogdet(covariance)[1]),
            np.linalg.inv(alone), np.linalg.slogdet(alone)[1])


def _links(local: np.ndarray, digit: np.ndarray, shape: float,
           lacking: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return `links`, `lengths` and `between` of a `Prototype`.

    `local`, shape (T, M, 3), are the frames in the palm's frame [m]; `lacking` is by `_lacking`,
    the other parameters are those of `learn_prototype` and `bending`.
    """
    links, between, palm = [], [], np.flatnonzero(digit < 0)
    for number in sorted(set(digit[digit >= 0])):
        if (digit == number).sum() < 2:
            continue
        chain = outward_markers(local, digit, number)[1].tolist()
        gaps = np.linalg.norm(local[:, palm] - local[:, chain[:1]], axis=2)
        mean, deviation = gaps.mean(axis=0), gaps.std(axis=0)
        # The next finger's knuckle may be nearer, but the length of a bone hardly varies.
        near = mean < LONGEST_LINK
        if near.any():
            chain.insert(0, int(palm[np.argmin(
                np.where(near, mean + STEADY_LINK * deviation, np.inf))]))
        links += [*zip(chain, chain[1:]), *zip(chain, chain[2:])]
        between += [-1] * (len(chain) - 1) + chain[1:-1]
    pairs = np.array(links, dtype=np.int64).reshape(-1, 2)
    gaps = np.linalg.norm(local[:, pairs[:, 0]] - local[:, pairs[:, 1]], axis=2)
    mean = gaps.mean(axis=0)
    return pairs, np.stack((mean, np.sqrt(
        gaps.var(axis=0) + LINK_DEVIATION ** 2 + (shape * mean) ** 2
        + (BENT_DEVIATION * lacking[pairs[:, 1]]) ** 2)), axis=1), np.array(between, np.int64)


def _not_shown(shown: np.ndarray, template: np.ndarray, digit: np.ndarray) -> np.ndarray:
    """Return the covariance of natural bending, for digits that the frames do not show bending.

    Parameters
    ----------
    shown : ndarray, shape (3 M, 3 M)
        Covariance of the frames [m²].
    template : ndarray, shape (M, 3)
        Mean places [m].
    digit : ndarray of int, shape (M,)
        Digit of each marker, -1 for the palm.

    Returns
    -------
    ndarray, shape (3 M, 3 M)
        [m²]
    """
    natural = bending(template, digit)
    lacking = np.repeat(_lacking(shown, natural, digit), 3)
    return natural * np.sqrt(np.outer(lacking, lacking))


def _lacking(shown: np.ndarray, natural: np.ndarray, digit: np.ndarray) -> np.ndarray:
    """Return the share of natural bending missing in the frames, for each marker's digit, (M,)."""
    lacking = np.zeros(len(digit))
    coordinate = np.repeat(digit, 3)
    for number in set(digit[digit >= 0]):
        mine = np.ix_(coordinate == number, coordinate == number)
        share = np.trace(shown[mine]) / np.trace(natural[mine])
        lacking[digit == number] = max(1. - share / BENDING_SHARE, 0.)
    return lacking


def _aligned(frames: np.ndarray, palm: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """Align frames rigidly by the palm; return mean places (M, 3), aligned frames (T, M, 3) [m]."""
    template = frames[0] - frames[0, palm].mean(axis=0)
    local = frames
    for _ in range(ALIGNMENT_ROUNDS):
        rest = template[palm]
        centre = frames[:, palm].mean(axis=1, keepdims=True)
        moment = np.einsum('ki,nkj->nij', rest - rest.mean(axis=0), frames[:, palm] - centre)
        rotation = nearest_rotation(moment)
        local = np.einsum('nij,nkj->nki', rotation, frames - centre) + rest.mean(axis=0)
        template = local.mean(axis=0)
    return template, local


def _bases(palm: np.ndarray, frames: np.ndarray,
           shape: float) -> tuple[np.ndarray, np.ndarray]:
    """Choose triangles of palm markers, the largest first, that share few corners.

    Parameters
    ----------
    palm : ndarray, shape (P, 3)
        Mean places [m].
    frames : ndarray, shape (T, P, 3)
        [m]
    shape : float
        Relative tolerance of the sides, besides their variation in the frames.

    Returns
    -------
    bases : ndarray of int, shape (B, 3)
    tolerances : ndarray, shape (B, 3)
        Of the sides, relative to their lengths.
    """
    triangles = np.array(list(combinations(range(len(palm)), 3)))
    if not len(triangles):
        raise InvalidLayout(f'{len(palm)} markers on the palm; at least three are needed to find '
                            'a hand among points without names')
    a, b, c = (palm[triangles[:, i]] for i in range(3))
    area = .5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    chosen = _large_and_apart(triangles, area, MIN_BASE_AREA, MAX_BASES)
    if not chosen:
        raise InvalidLayout('the markers of the palm lie on one line, or too near each other; a '
                            f'triangle of at least {1e4 * MIN_BASE_AREA:g} cm² is needed to find '
                            'a hand among points without names')
    found = triangles[chosen]
    return found, np.array([[_tolerance(frames, one[i], one[(i + 1) % 3], shape)
                             for i in range(3)] for one in found])


def _pairs(palm: np.ndarray, frames: np.ndarray, shape: float) -> tuple[np.ndarray, np.ndarray]:
    """Choose pairs of palm markers as `_bases` does triangles, (P, 2); return tolerances, (P,)."""
    pairs = np.array(list(combinations(range(len(palm)), 2)))
    gaps = np.linalg.norm(palm[pairs[:, 0]] - palm[pairs[:, 1]], axis=1)
    found = pairs[_large_and_apart(pairs, gaps, MIN_PAIR_GAP, MAX_PALM_PAIRS)]
    return found, np.array([_tolerance(frames, one[0], one[1], shape) for one in found])


def _large_and_apart(corners: np.ndarray, extent: np.ndarray, least: float,
                     most: int) -> list[int]:
    """Choose rows of corners (n, k) with a large extent (n,), that share few corners."""
    left = extent.copy()
    chosen: list[int] = []
    uses = np.zeros(corners.max() + 1)
    while len(chosen) < most and (left >= least).any():
        # Corners used before count less: any marker may be occluded.
        best = int(np.argmax(left / (1. + uses[corners].sum(axis=1))))
        chosen.append(best)
        uses[corners[best]] += 1.
        left[best] = 0.
    return chosen


def _tolerance(frames: np.ndarray, one: int, other: int, shape: float) -> float:
    """Return the tolerance of the distance of two markers, relative to its mean."""
    gap = np.linalg.norm(frames[:, one] - frames[:, other], axis=1)
    return min(shape + SIDE_DEVIATIONS * float(gap.std() / gap.mean()), .4)
