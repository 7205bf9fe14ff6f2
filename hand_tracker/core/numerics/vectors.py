"""Algebra of three-vectors and frames as tuples, shared by every kernel.

A `Vector` is a tuple of three floats. A `Frame` is a tuple of its unit axes (x, y, z) in the
parent's coordinates: the columns of the rotation from the frame to its parent. Vectors may have any
unit, and results have that which follows from it.
"""

import math

import numpy as np

from .jit import jit

TINY_LENGTH = 1e-12  # [any unit] up to which an array's vector has no direction

Vector = tuple[float, float, float]
Frame = tuple[Vector, Vector, Vector]


@jit
def vector(array: np.ndarray | Vector) -> Vector:
    """Return the first three numbers of an array, shape (>= 3,), as a `Vector`."""
    return (float(array[0]), float(array[1]), float(array[2]))


@jit
def store(rows: np.ndarray, row: int, v: Vector) -> None:
    """Write `v` into the first three columns of row `row` of `rows`, shape (n, >= 3)."""
    for k in range(3):
        rows[row, k] = v[k]


@jit
def frame(matrix: np.ndarray) -> Frame:
    """Return the columns of a rotation matrix, shape (3, 3), as a `Frame`."""
    return (
        (float(matrix[0, 0]), float(matrix[1, 0]), float(matrix[2, 0])),
        (float(matrix[0, 1]), float(matrix[1, 1]), float(matrix[2, 1])),
        (float(matrix[0, 2]), float(matrix[1, 2]), float(matrix[2, 2])),
    )


@jit
def column(matrix: np.ndarray, number: int) -> Vector:
    """Return a column of a matrix (3, 3): an axis of a frame that is a rotation."""
    return matrix[0, number], matrix[1, number], matrix[2, number]


@jit
def store_pose(rotation: np.ndarray, position: np.ndarray, axes: Frame, origin: Vector) -> None:
    """Write axes as the columns of a matrix, shape (3, 3), and an origin, shape (3,)."""
    for i in range(3):
        position[i] = origin[i]
        for k in range(3):
            rotation[i, k] = axes[k][i]


@jit
def add(a: Vector, b: Vector) -> Vector:
    """Return a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@jit
def subtract(a: Vector, b: Vector) -> Vector:
    """Return a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@jit
def scale(a: Vector, s: float) -> Vector:
    """Return s a."""
    return (s * a[0], s * a[1], s * a[2])


@jit
def dot(a: Vector, b: Vector) -> float:
    """Return the scalar product a · b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@jit
def cross(a: Vector, b: Vector) -> Vector:
    """Return the vector product a × b."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


@jit
def length(a: Vector) -> float:
    """Return the Euclidean norm |a|."""
    return math.sqrt(dot(a, a))


@jit
def distance(a: Vector, b: Vector) -> float:
    """Return the Euclidean distance |a - b|."""
    return length(subtract(a, b))


@jit
def is_equal(a: np.ndarray | Vector, b: np.ndarray | Vector) -> bool:
    """Return whether three coordinates, shape (3,), are equal bit for bit."""
    return a[0] == b[0] and a[1] == b[1] and a[2] == b[2]


@jit
def triangle_normal(a: Vector, b: Vector, c: Vector) -> Vector:
    """Return the normal of a triangle, anticlockwise from its tip, of twice its area [m²]."""
    return cross(subtract(b, a), subtract(c, a))


@jit
def triangle_area(corners: np.ndarray) -> float:
    """Return the area of a triangle [m²], its corners as rows, shape (3, 3) [m]."""
    return 0.5 * length(triangle_normal(
        vector(corners[0]), vector(corners[1]), vector(corners[2])))


@jit
def spans_plane(r: Vector, p: Vector, q: Vector) -> bool:
    """Return whether three points are neither collinear nor coincident; False for NaN."""
    a = subtract(p, r)
    b = subtract(q, r)
    normal = cross(a, b)
    return dot(normal, normal) > 1e-3 * dot(a, a) * dot(b, b) > 1e-20


@jit
def unit(a: Vector) -> Vector:
    """Return a / |a|; the zero vector stays zero."""
    size = length(a)
    if size > 0.0:
        return scale(a, 1.0 / size)
    return (0.0, 0.0, 0.0)


def unit_vectors(vectors: np.ndarray) -> np.ndarray:
    """Return the vectors of an array at length 1; shorter than that only below `TINY_LENGTH`.

    Parameters
    ----------
    vectors : ndarray, shape (..., n)
        [any unit]

    Returns
    -------
    ndarray, shape (..., n)
        [1]
    """
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), TINY_LENGTH)


@jit
def rotate(axes: Frame, v: Vector) -> Vector:
    """Return `v`, given in the frame `axes`, in the parent's coordinates: R v."""
    return (
        axes[0][0] * v[0] + axes[1][0] * v[1] + axes[2][0] * v[2],
        axes[0][1] * v[0] + axes[1][1] * v[1] + axes[2][1] * v[2],
        axes[0][2] * v[0] + axes[1][2] * v[1] + axes[2][2] * v[2],
    )


@jit
def components(axes: Frame, v: Vector) -> Vector:
    """Return `v`, given in the parent's coordinates, in the frame `axes`: Rᵀ v."""
    return (dot(axes[0], v), dot(axes[1], v), dot(axes[2], v))


@jit
def compose(outer: Frame, inner: Frame) -> Frame:
    """Return the frame `inner`, given in `outer`, in the parent of `outer`: the product R_o R_i."""
    return (rotate(outer, inner[0]), rotate(outer, inner[1]), rotate(outer, inner[2]))


@jit
def inverse(axes: Frame) -> Frame:
    """Return the parent's axes in the frame `axes`: the transposed rotation Rᵀ."""
    return (
        (axes[0][0], axes[1][0], axes[2][0]),
        (axes[0][1], axes[1][1], axes[2][1]),
        (axes[0][2], axes[1][2], axes[2][2]),
    )


@jit
def rotate_about(axis: Vector, angle: float, v: Vector) -> Vector:
    """Rotate `v` about the unit vector `axis` by `angle` [rad] (Rodrigues' formula)."""
    c = math.cos(angle)
    along = scale(axis, (1.0 - c) * dot(axis, v))
    return add(add(scale(v, c), scale(cross(axis, v), math.sin(angle))), along)


@jit
def rotate_about_y(v: Vector, angle: float) -> Vector:
    """Rotate `v` about the y axis by `angle` [rad]: flexion, which lowers what is distal."""
    c, s = math.cos(angle), math.sin(angle)
    return (c * v[0] + s * v[2], v[1], c * v[2] - s * v[0])


@jit
def solve_symmetric(a: Vector, b: Vector, c: Vector, m: Vector) -> Vector:
    """Solve [a b c] x = m for a symmetric positive matrix by Cramer's rule; 0 when singular."""
    volume = dot(a, cross(b, c))
    if not volume > 0.:
        return (0., 0., 0.)
    return scale((dot(m, cross(b, c)), dot(a, cross(m, c)), dot(a, cross(b, m))), 1. / volume)


@jit
def clamp(value: float, lower: float, upper: float) -> float:
    """Return `value` limited to the interval [lower, upper]."""
    return min(max(value, lower), upper)


@jit
def off_way(moved: Vector, ahead: Vector) -> float:
    """Return how far a motion is off the way from none to `ahead` [m]."""
    square = dot(ahead, ahead)
    along = clamp(dot(moved, ahead) / square, 0., 1.) if square > 0. else 0.
    return distance(moved, scale(ahead, along))


@jit
def deviation_within(variance: float, prior: float, lost: float) -> float:
    """Return the posterior standard deviation of an observation and a prior, fading to the prior.

    Parameters
    ----------
    variance : float
        Of the observation [unit²].
    prior : float
        Standard deviation without one [unit].
    lost : float
        Share by which the variance has faded from the posterior to the prior one [1].
    """
    usual = prior * prior
    known = variance * usual / (variance + usual)
    return math.sqrt(known + lost * (usual - known))


@jit
def wrap_angle(angle: float) -> float:
    """Return `angle` wrapped to [-pi, pi) [rad]."""
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))


@jit
def clamp_angle(angle: float, lower: float, upper: float) -> float:
    """Return the angle of [lower, upper] nearest to `angle` on the circle [rad]."""
    middle = 0.5 * (lower + upper)
    half = 0.5 * (upper - lower)
    # Clamped twice: the sum's last rounding may step over a limit.
    return clamp(middle + clamp(wrap_angle(angle - middle), -half, half), lower, upper)
