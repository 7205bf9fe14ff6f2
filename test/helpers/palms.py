"""Palms at random: a triangle of markers, moved and with noise."""

import numpy as np
from scipy.spatial.transform import Rotation

from hand_tracker.core.inverse_kinematics.palm import place_palm_by_spheres
from hand_tracker.core.model.palm_triangle import fit_wrist
from hand_tracker.core.numerics.vectors import vector

TEMPLATE = np.array(((0., 0., 0.), (.083, .021, -.003), (.068, -.034, -.006)))


def random_rotation(rng):
    """Return a random rotation, shape (3, 3)."""
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return q * np.linalg.det(q)


def vectors(*arrays):
    return [vector(array) for array in arrays]


def random_palm(rng, noise=0.):
    rotation = Rotation.random(random_state=rng).as_matrix()
    position = rng.normal(size=3)
    return (TEMPLATE + rng.normal(scale=noise, size=(3, 3))) @ rotation.T + position, \
        rotation, position


def placed(markers, by_spheres, roots=None):
    """Return rotation, position and first joints of the digits of a palm by its markers."""
    rotation, position = np.eye(3), np.zeros(3)
    roots = np.zeros((5, 3)) if roots is None else roots
    if by_spheres:
        place_palm_by_spheres(markers, TEMPLATE, rotation, position, roots)
    else:
        fit_wrist(markers, TEMPLATE, rotation, position)
    return rotation, position, roots
