"""Rigid fit of weighted points: in closed form, or by small steps."""

import math

import numpy as np

from .jit import jit
from .stack_memory import local_floats
from .vectors import (
    add,
    cross,
    dot,
    length,
    rotate_about,
    scale,
    solve_symmetric,
    store,
    subtract,
    unit,
    vector,
)

NEWTON_STEPS = 20   # at most; two to five suffice
# The product of the largest eigenvalue's distances from the others over its cube, below which it is
# nearly a double one, as points near a line make it: there the rotation is less exact than 1e-10.
LEAST_DISTANCES = .001
JACOBI_SWEEPS = 12  # at most; three to five suffice for a symmetric matrix of four rows


def nearest_rotation(matrices: np.ndarray) -> np.ndarray:
    """Return the rotations nearest to matrices, both of shape (..., 3, 3).

    By their singular values: Kabsch (A solution for the best rotation to relate two sets of
    vectors, 1976).
    """
    left, _, right = np.linalg.svd(matrices)
    left[..., 2] *= np.linalg.det(left @ right)[..., None]
    return left @ right


@jit
def fit_rigid(template: np.ndarray, points: np.ndarray, weights: np.ndarray,
              rotation: np.ndarray, position: np.ndarray) -> float:
    """Fit a rotation and a translation that lay a template on points.

    Minimises Σ w |R t + o - x|², and takes the ratio of the sizes apart. By the largest eigenvalue
    of Horn's matrix (Closed-form solution of absolute orientation using unit quaternions, 1987),
    with the rotation of Markley (Attitude determination using vector observations: a fast optimal
    matrix algorithm, 1993); near a line of points by its eigenvector.

    Parameters
    ----------
    template, points : ndarray, shape (n, 3)
        Corresponding places [m].
    weights : ndarray, shape (n,)
        Not negative; points of weight 0 are not read.
    rotation : ndarray, shape (3, 3)
        From the template's frame to that of the points, replaced.
    position : ndarray, shape (3,)
        Origin of the template's frame, replaced [m].

    Returns
    -------
    float
        Size of the points over the template's, by their root mean squares about the centres; 0
        where nothing is determined, and then nothing is replaced.
    """
    total = 0.
    here = local_floats(3)
    there = local_floats(3)
    for i in range(len(weights)):
        if weights[i] > 0.:
            total += weights[i]
            for k in range(3):
                there[k] += weights[i] * template[i, k]
                here[k] += weights[i] * points[i, k]
    if total <= 0.:
        return 0.
    for k in range(3):
        there[k] /= total
        here[k] /= total
    moment = local_floats((3, 3))
    spread = local_floats(2)
    for i in range(len(weights)):
        if weights[i] > 0.:
            for j in range(3):
                a = template[i, j] - there[j]
                spread[0] += weights[i] * a * a
                spread[1] += weights[i] * (points[i, j] - here[j]) ** 2
                for k in range(3):
                    moment[j, k] += weights[i] * a * (points[i, k] - here[k])
    if not (spread[0] > 0. and spread[1] > 0.):
        return 0.
    size = math.sqrt(spread[1] / spread[0])
    if not _write_rotation(moment, math.sqrt(spread[0] * spread[1]), rotation):
        w, x, y, z = _largest_eigenvector(moment)
        rotation[0, 0] = w * w + x * x - y * y - z * z
        rotation[1, 1] = w * w - x * x + y * y - z * z
        rotation[2, 2] = w * w - x * x - y * y + z * z
        rotation[0, 1], rotation[1, 0] = 2. * (x * y - w * z), 2. * (x * y + w * z)
        rotation[0, 2], rotation[2, 0] = 2. * (x * z + w * y), 2. * (x * z - w * y)
        rotation[1, 2], rotation[2, 1] = 2. * (y * z - w * x), 2. * (y * z + w * x)
    for k in range(3):
        position[k] = here[k] - (rotation[k, 0] * there[0] + rotation[k, 1] * there[1]
                                 + rotation[k, 2] * there[2])
    return size


@jit
def _write_rotation(moment: np.ndarray, bound: float, rotation: np.ndarray) -> bool:
    """Write the rotation that fits a moment best; return whether it is exact to 1e-10.

    Parameters
    ----------
    moment : ndarray, shape (3, 3)
        Σ w t xᵀ about the centres [m²].
    bound : float
        No less than the largest eigenvalue of Horn's matrix, from where Newton's method falls to
        it [m²].
    rotation : ndarray, shape (3, 3)
        Replaced where it is exact.
    """
    cofactors, squares = local_floats((3, 3)), local_floats((3, 3))
    square, cofactor_square, determinant = 0., 0., 0.
    for j in range(3):
        for k in range(3):
            a, b, c, d = (j + 1) % 3, (j + 2) % 3, (k + 1) % 3, (k + 2) % 3
            cofactors[j, k] = moment[a, c] * moment[b, d] - moment[a, d] * moment[b, c]
            square += moment[j, k] * moment[j, k]
            cofactor_square += cofactors[j, k] * cofactors[j, k]
            squares[j, k] = (moment[j, 0] * moment[k, 0] + moment[j, 1] * moment[k, 1]
                             + moment[j, 2] * moment[k, 2])
        determinant += moment[0, j] * cofactors[0, j]
    value = bound
    for _ in range(NEWTON_STEPS):
        excess = value * value - square
        slope = 4. * value * excess - 8. * determinant  # in the end that product
        if not slope > LEAST_DISTANCES * value ** 3:
            return False
        step = (excess * excess - 8. * value * determinant - 4. * cofactor_square) / slope
        value -= step
        if not step > 1e-15 * value:
            break
    half = .5 * (value * value - square)
    scaled = half * value - determinant
    for j in range(3):
        for k in range(3):
            cubed = (squares[j, 0] * moment[0, k] + squares[j, 1] * moment[1, k]
                     + squares[j, 2] * moment[2, k])
            rotation[k, j] = ((half + square) * moment[j, k] + value * cofactors[j, k]
                              - cubed) / scaled
    return True


@jit
def _largest_eigenvector(moment: np.ndarray) -> tuple[float, float, float, float]:
    """Return the quaternion of the largest eigenvalue of Horn's matrix, by Jacobi rotations."""
    s = moment
    a = local_floats((4, 4))
    a[0, 0] = s[0, 0] + s[1, 1] + s[2, 2]
    a[1, 1] = s[0, 0] - s[1, 1] - s[2, 2]
    a[2, 2] = -s[0, 0] + s[1, 1] - s[2, 2]
    a[3, 3] = -s[0, 0] - s[1, 1] + s[2, 2]
    a[0, 1] = a[1, 0] = s[1, 2] - s[2, 1]
    a[0, 2] = a[2, 0] = s[2, 0] - s[0, 2]
    a[0, 3] = a[3, 0] = s[0, 1] - s[1, 0]
    a[1, 2] = a[2, 1] = s[0, 1] + s[1, 0]
    a[1, 3] = a[3, 1] = s[2, 0] + s[0, 2]
    a[2, 3] = a[3, 2] = s[1, 2] + s[2, 1]
    vectors = local_floats((4, 4))
    for i in range(4):
        vectors[i, i] = 1.
    scale = 0.
    for i in range(4):
        scale += abs(a[i, i])
    for _ in range(JACOBI_SWEEPS):
        off = 0.
        for p in range(3):
            for q in range(p + 1, 4):
                off += abs(a[p, q])
        if off <= 1e-15 * scale:
            break
        for p in range(3):
            for q in range(p + 1, 4):
                if a[p, q] == 0.:
                    continue
                theta = .5 * (a[q, q] - a[p, p]) / a[p, q]
                t = (1. if theta >= 0. else -1.) / (abs(theta) + math.sqrt(theta * theta + 1.))
                c = 1. / math.sqrt(t * t + 1.)
                d = t * c
                for k in range(4):
                    a[k, p], a[k, q] = c * a[k, p] - d * a[k, q], d * a[k, p] + c * a[k, q]
                for k in range(4):
                    a[p, k], a[q, k] = c * a[p, k] - d * a[q, k], d * a[p, k] + c * a[q, k]
                for k in range(4):
                    vectors[k, p], vectors[k, q] = (c * vectors[k, p] - d * vectors[k, q],
                                                    d * vectors[k, p] + c * vectors[k, q])
    best = 0
    for i in range(1, 4):
        if a[i, i] > a[best, best]:
            best = i
    size = math.sqrt(vectors[0, best] ** 2 + vectors[1, best] ** 2
                     + vectors[2, best] ** 2 + vectors[3, best] ** 2)
    return (vectors[0, best] / size, vectors[1, best] / size,
            vectors[2, best] / size, vectors[3, best] / size)


@jit
def step_rigidly(points: np.ndarray, aims: np.ndarray, weights: np.ndarray) -> None:
    """Move points rigidly towards their aims by one linearised least-squares step.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Replaced [m].
    aims : ndarray, shape (n, 3)
        [m]
    weights : ndarray, shape (n,)
    """
    total = 0.
    center = (0., 0., 0.)
    shift = (0., 0., 0.)
    for i in range(len(weights)):
        point = vector(points[i])
        total += weights[i]
        center = add(center, scale(point, weights[i]))
        shift = add(shift, scale(subtract(vector(aims[i]), point), weights[i]))
    center = scale(center, 1. / total)
    shift = scale(shift, 1. / total)

    # The small rotation that balances the moments of the residuals
    inertia = local_floats((3, 3))
    moment = (0., 0., 0.)
    for i in range(len(weights)):
        point = vector(points[i])
        arm = subtract(point, center)
        moment = add(moment, scale(cross(arm, subtract(vector(aims[i]), point)), weights[i]))
        for k in range(3):
            inertia[k, k] += weights[i] * dot(arm, arm)
            for j in range(3):
                inertia[k, j] -= weights[i] * arm[k] * arm[j]
    turned = solve_symmetric(vector(inertia[0]), vector(inertia[1]), vector(inertia[2]), moment)
    axis, angle = unit(turned), length(turned)
    for i in range(len(weights)):
        arm = subtract(vector(points[i]), center)
        store(points, i, add(rotate_about(axis, angle, arm), add(shift, center)))
