"""Palms at random: a triangle of markers, moved and with noise."""

import numpy as np
from scipy.spatial.transform import Rotation

from hand_tracker.core.numerics.vectors import vector

TEMPLATE = np.array(((0., 0., 0.), (.083, .021, -.003), (.068, -.034, -.006)))


def vectors(*arrays):
    return [vector(array) for array in arrays]


def random_palm(rng, noise=0.):
    rotation = Rotation.random(random_state=rng).as_matrix()
    position = rng.normal(size=3)
    return (TEMPLATE + rng.normal(scale=noise, size=(3, 3))) @ rotation.T + position, \
        rotation, position
