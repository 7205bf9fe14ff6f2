"""Covariance of markers under digit flexion, for digits that no frame has shown bending."""

import numpy as np

from ..model.hand import DIGITS
from ..numerics.vectors import unit_vectors

BEND_SHARES = np.linspace(-1., 1., 5)
# Largest flexion, either way, at a digit's first joint and at each further one: of fingers, and of
# the thumb, which also abducts by as much; ours.
FINGER_BEND = .9, .8        # [rad]
THUMB_BEND = .5, .5         # [rad]
LONGEST_BONE = .07          # [m] from a digit's first joint to its first marker, at most; ours
STRETCHED_SHARE = .95       # quantile of a marker's distance that orders a digit's; ours


def bending(template: np.ndarray, digit: np.ndarray) -> np.ndarray:
    """Return the second moments of marker displacements as each digit bends independently.

    Fingers flex about the axis across the palm, at their first joint and at each marker but the
    last; thumbs about both axes across them. The first joint is assumed at the nearest palm marker,
    or `LONGEST_BONE` on the way there. The dorsal side of the palm is not known: digits bend both
    ways.

    Parameters
    ----------
    template : ndarray, shape (M, 3)
        Mean places [m].
    digit : ndarray of int, shape (M,)
        Digit that each marker is on; -1 for the palm.

    Returns
    -------
    ndarray, shape (3 M, 3 M)
        [m²]
    """
    palm = template[digit < 0]
    normal = np.linalg.svd(palm - palm.mean(axis=0))[2][2]
    thumb = DIGITS.index('thumb')
    moments = np.zeros((template.size, template.size))
    fingers = (digit >= 0) & (digit != thumb)
    along = template[fingers].mean(axis=0) - palm.mean(axis=0) if fingers.any() else None
    for number in sorted(set(digit[digit >= 0])):
        knuckle, mine = outward_markers(template[None], digit, number)
        # Palm markers may be far behind the knuckles.
        back = template[knuckle] - template[mine[0]]
        gap = np.linalg.norm(template[mine] - template[knuckle], axis=1).min()
        base = template[mine[0]] + min(1., LONGEST_BONE / gap) * back
        chain = np.concatenate((base[None], template[mine]))
        out = along if number != thumb and along is not None else chain[-1] - base
        across = unit_vectors(np.cross(normal, out))
        axes = (across, unit_vectors(np.cross(out, across))) if number == thumb else (across,)
        bends = THUMB_BEND if number == thumb else FINGER_BEND
        rows = (3 * mine[:, None] + np.arange(3)).ravel()
        for axis in axes:
            moves = np.array([(_bent(chain, axis, first * bends[0], other * bends[1])
                               - chain)[1:].ravel()
                              for first in BEND_SHARES for other in BEND_SHARES])
            moments[np.ix_(rows, rows)] += moves.T @ moves / len(moves)
    return moments


def outward_markers(frames: np.ndarray, digit: np.ndarray, number: int) -> tuple[int, np.ndarray]:
    """Return the palm marker nearest to a digit, and the digit's markers from proximal to distal.

    They are ordered by the distance from there that `STRETCHED_SHARE` of the frames do not exceed,
    as the tip of a bent finger is near the palm.

    Parameters
    ----------
    frames : ndarray, shape (T, M, 3)
        [m]
    digit : ndarray of int, shape (M,)
        Digit that each marker is on; -1 for the palm.
    number : int
        Of the digit.
    """
    palm, mine = np.flatnonzero(digit < 0), np.flatnonzero(digit == number)
    gaps = np.linalg.norm(frames[:, mine, None] - frames[:, None, palm], axis=3)    # (T, k, P)
    nearest = int(np.argmin(gaps.mean(axis=0).min(axis=0)))
    reach = np.quantile(gaps[:, :, nearest], STRETCHED_SHARE, axis=0)
    return int(palm[nearest]), mine[np.argsort(reach)]


def _bent(chain: np.ndarray, axis: np.ndarray, first: float, other: float) -> np.ndarray:
    """Return a chain of points bent about an axis: by `first` at its base, `other` further out.

    `chain` and the result are (n, 3) [m]; angles are in [rad].
    """
    places = chain.copy()
    for i in range(1, len(chain)):
        angle = first + (i - 1) * other
        link = chain[i] - chain[i - 1]
        places[i] = places[i - 1] + (
            link * np.cos(angle) + np.cross(axis, link) * np.sin(angle)
            + axis * (axis @ link) * (1. - np.cos(angle)))
    return places
