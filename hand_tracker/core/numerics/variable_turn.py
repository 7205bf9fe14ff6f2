"""Motion of the variable turn model on one axis, and its derivatives by the turn rate.

A point that turns at a constant rate ω moves on every axis by a linear map L of position, velocity
and acceleration: X. R. Li and V. P. Jilkov, "Survey of maneuvering target tracking. Part I", IEEE
Trans. Aerospace and Electronic Systems 39 (2003).
"""

from functools import partial

from .jit import jit

AxisState = tuple[float, float, float]  # position, velocity and acceleration on an axis
# L, or a derivative of it, on every axis: ((a, b, c), (0, d, b), (0, e, d)).
Turn = tuple[float, float, float, float, float]


@jit
def turn_matrices(rate: float, step: float) -> tuple[Turn, Turn, Turn]:
    """Return the matrix L of a turn, and its first and second derivative by the squared rate.

    Parameters
    ----------
    rate : float
        Squared turn rate [rad²/s²].
    step : float
        [s]
    """
    # Stumpff functions c_k = Σ (−x)^n / (k + 2n)! of the squared angle x, c₀ the cosine: series,
    # exact to rounding up to 1 rad. Derivatives are (k c_{k+2} − c_{k+1}) / 2.
    square = step * step
    x = rate * square
    c6 = 1. / 720. - x * (1. / 40320. - x * (1. / 3628800. - x * (
        1. / 479001600. - x * (1. / 87178291200. - x * (
            1. / 20922789888000. - x / 6402373705728000.)))))
    c5 = 1. / 120. - x * (1. / 5040. - x * (1. / 362880. - x * (
        1. / 39916800. - x * (1. / 6227020800. - x * (
            1. / 1307674368000. - x / 355687428096000.)))))
    c4 = 1. / 24. - x * c6
    c3 = 1. / 6. - x * c5
    c2 = .5 - x * c4
    c1 = 1. - x * c3
    c0 = 1. - x * c2
    slope = .5 * (c3 - c2)
    return (
        (1., c1 * step, c2 * square, c0, -rate * c1 * step),
        (0., slope * step * square, (c4 - .5 * c3) * square ** 2, -.5 * c1 * square,
         -.5 * (c1 + c0) * step),
        (0., .25 * (3. * (c5 - c4) + c3) * step * square ** 2,
         .25 * (8. * c6 - 5. * c5 + c4) * square ** 3, -.5 * slope * square ** 2,
         -.5 * (slope - .5 * c1) * step * square),
    )


# Inlined, as tuples are passed through memory.
@partial(jit, forceinline=True)
def turned(turn: Turn, axis: AxisState) -> AxisState:
    """Return the product of L, or a derivative of it, with the state on an axis."""
    return (turn[0] * axis[0] + turn[1] * axis[1] + turn[2] * axis[2],
            turn[3] * axis[1] + turn[1] * axis[2],
            turn[4] * axis[1] + turn[3] * axis[2])
