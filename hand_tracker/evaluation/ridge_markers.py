"""Ridge regression of unseen markers from the worn ones: a baseline without any hand."""

from typing import NamedTuple

import numpy as np

from .plain_hand import into_palm, palm_poses

RIDGE_PENALTY = 1e-5  # of standardised features, per frame [1]


class Ridge(NamedTuple):
    """A fitted regression.

    Attributes
    ----------
    template : ndarray, shape (3, 3)
        Worn palm markers in the palm's frame [m].
    middle, scale : ndarray, shape (f,)
        Of the features.
    weights : ndarray, shape (f + 1, 3 k)
        The last row is the constant.
    """

    template: np.ndarray
    middle: np.ndarray
    scale: np.ndarray
    weights: np.ndarray


def fit_ridge(worn: np.ndarray, unseen: np.ndarray) -> Ridge:
    """Fit the regression.

    Parameters
    ----------
    worn : ndarray, shape (n, 8, 3)
        In the order of `MARKERS`, all seen [m].
    unseen : ndarray, shape (n, k, 3)
        [m]

    Returns
    -------
    Ridge
    """
    shape = np.linalg.norm(worn[:, (0, 1, 2)] - worn[:, (1, 2, 0)], axis=2)
    template = worn[int(np.argmin(np.abs(shape - np.median(shape, axis=0)).sum(axis=1))), :3]
    rotation, position = palm_poses(worn[:, :3], template)
    features = _features(into_palm(worn[:, 3:], rotation, position))
    middle, scale = features.mean(axis=0), features.std(axis=0) + 1e-9
    standard = np.column_stack(((features - middle) / scale, np.ones(len(features))))
    penalty = RIDGE_PENALTY * len(standard) * np.eye(standard.shape[1])
    penalty[-1, -1] = 0.
    targets = into_palm(unseen, rotation, position).reshape(len(unseen), -1)
    weights = np.linalg.solve(standard.T @ standard + penalty, standard.T @ targets)
    return Ridge(template, middle, scale, weights)


def ridge_markers(ridge: Ridge, worn: np.ndarray) -> np.ndarray:
    """Return the unseen markers (n, k, 3) of frames of worn ones (n, 8, 3) [m]."""
    rotation, position = palm_poses(worn[:, :3], ridge.template)
    features = _features(into_palm(worn[:, 3:], rotation, position))
    standard = np.column_stack(
        ((features - ridge.middle) / ridge.scale, np.ones(len(features))))
    local = (standard @ ridge.weights).reshape(len(worn), -1, 3)
    return np.einsum('nij,nkj->nki', rotation, local) + position[:, None]


def _features(digits: np.ndarray) -> np.ndarray:
    """Return coordinates of the digits' markers and their squares, shape (n, 30) [m, m²]."""
    flat = digits.reshape(len(digits), -1)
    return np.column_stack((flat, flat ** 2))
