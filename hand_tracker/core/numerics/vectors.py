"""Three-vectors and frames as tuples: the algebra every kernel shares.

A vector is a tuple of three floats; a frame is a tuple of its three axes
(x, y, z), the columns of the rotation from the frame to its surroundings.
"""

import math

from .jit import jit


@jit
def vector(array):
    """Return the first three numbers of an array as a vector."""
    return (float(array[0]), float(array[1]), float(array[2]))


@jit
def store(rows, row, v):
    """Write a vector into a row of an array."""
    for k in range(3):
        rows[row, k] = v[k]


@jit
def frame(matrix):
    """Return the columns of a (3, 3) rotation matrix as a frame."""
    return (
        (float(matrix[0, 0]), float(matrix[1, 0]), float(matrix[2, 0])),
        (float(matrix[0, 1]), float(matrix[1, 1]), float(matrix[2, 1])),
        (float(matrix[0, 2]), float(matrix[1, 2]), float(matrix[2, 2])),
    )


@jit
def add(a, b):
    """Return a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@jit
def subtract(a, b):
    """Return a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@jit
def scale(a, s):
    """Return s a."""
    return (s * a[0], s * a[1], s * a[2])


@jit
def dot(a, b):
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@jit
def cross(a, b):
    """Return the vector product."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


@jit
def length(a):
    """Return the Euclidean length."""
    return math.sqrt(dot(a, a))


@jit
def distance(a, b):
    """Return the distance of two points."""
    return length(subtract(a, b))


@jit
def unit(a):
    """Return a / |a|; the zero vector stays zero."""
    size = length(a)
    if size > 0.0:
        return scale(a, 1.0 / size)
    return (0.0, 0.0, 0.0)


@jit
def rotate(axes, v):
    """Return the surroundings' coordinates of `v`, given in the frame `axes`."""
    return (
        axes[0][0] * v[0] + axes[1][0] * v[1] + axes[2][0] * v[2],
        axes[0][1] * v[0] + axes[1][1] * v[1] + axes[2][1] * v[2],
        axes[0][2] * v[0] + axes[1][2] * v[1] + axes[2][2] * v[2],
    )


@jit
def components(axes, v):
    """Return the coordinates in the frame `axes` of `v`, given in its surroundings."""
    return (dot(axes[0], v), dot(axes[1], v), dot(axes[2], v))


@jit
def compose(outer, inner):
    """Return the frame `inner`, given in `outer`, in the surroundings of `outer`."""
    return (rotate(outer, inner[0]), rotate(outer, inner[1]), rotate(outer, inner[2]))


@jit
def inverse(axes):
    """Return the frame of the surroundings in `axes`: the transposed rotation."""
    return (
        (axes[0][0], axes[1][0], axes[2][0]),
        (axes[0][1], axes[1][1], axes[2][1]),
        (axes[0][2], axes[1][2], axes[2][2]),
    )


@jit
def rotate_about(axis, angle, v):
    """Rotate `v` about the unit vector `axis` by `angle` [rad] (Rodrigues)."""
    c = math.cos(angle)
    along = scale(axis, (1.0 - c) * dot(axis, v))
    return add(add(scale(v, c), scale(cross(axis, v), math.sin(angle))), along)


@jit
def clamp(value, lower, upper):
    """Return `value` limited to [lower, upper]."""
    return min(max(value, lower), upper)


@jit
def wrap_angle(angle):
    """Return the angle in [-pi, pi) that equals `angle` modulo a full turn [rad]."""
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))


@jit
def clamp_angle(angle, lower, upper):
    """Return the angle of [lower, upper] nearest to `angle` on the circle [rad]."""
    middle = 0.5 * (lower + upper)
    half = 0.5 * (upper - lower)
    # Clamped twice: the sum's last rounding may step over a limit.
    return clamp(middle + clamp(wrap_angle(angle - middle), -half, half), lower, upper)
