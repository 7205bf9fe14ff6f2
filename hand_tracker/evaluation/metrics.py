"""Error and smoothness metrics of tracked hands, as pure functions of arrays of frames."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

# Rows of the 21 landmarks: wrist; thumb CMC, MCP, IP, tip; MCP, PIP, DIP, tip of each finger.
JOINT_CLASSES = {
    'mcp': (5, 9, 13, 17), 'pip': (6, 10, 14, 18), 'dip': (7, 11, 15, 19),
    'tip': (8, 12, 16, 20), 'thumb_cmc': (1,), 'thumb_mcp': (2,), 'thumb_ip': (3,),
    'all': tuple(range(1, 21)),  # without the wrist, with the tip of the thumb
}
REST_CUTOFF = 10.  # [Hz] a hand at rest has no motion above it; ours, unsourced


class PoseDistance(NamedTuple):
    """Pose distance of Eq. 11 of the paper, its root and its mean per joint.

    Attributes
    ----------
    squared : ndarray, shape (...)
        Dist² = Σ ‖log(q_jk⁻¹ q_ik)‖² over the joints [rad²].
    distance : ndarray, shape (...)
        Dist [rad].
    degrees : ndarray, shape (...)
        Mean rotation angle of a joint [degrees].
    """

    squared: np.ndarray
    distance: np.ndarray
    degrees: np.ndarray


def angle_distance(first: ArrayLike, second: ArrayLike) -> PoseDistance:
    """Return the distance of poses given as angles of revolute joints (Eq. 11).

    Equals that of the joints' quaternions: the logarithm of a relative rotation is half the
    difference of the angles.

    Parameters
    ----------
    first, second : array_like, shape (..., k)
        [rad]

    Returns
    -------
    PoseDistance
    """
    turn = np.asarray(first, dtype=float) - np.asarray(second, dtype=float)
    halves = .5 * np.abs(np.angle(np.exp(1j * turn)))
    squared = (halves ** 2).sum(axis=-1)
    return PoseDistance(squared, np.sqrt(squared), np.degrees(2. * halves.mean(axis=-1)))


def joint_errors(found: ArrayLike, true: ArrayLike) -> dict[str, np.ndarray]:
    """Return the position errors of joints by class of joint.

    Parameters
    ----------
    found, true : array_like, shape (n, 21, 3)
        In the order of `LANDMARKS`; joints that are not finite are left out [m].

    Returns
    -------
    dict of ndarray, shape (m,)
        By the names of `JOINT_CLASSES` [m].
    """
    errors = np.linalg.norm(np.asarray(found) - np.asarray(true), axis=-1)
    classes = {name: errors[:, list(rows)].ravel() for name, rows in JOINT_CLASSES.items()}
    return {name: values[np.isfinite(values)] for name, values in classes.items()}


def rotation_angles(first: ArrayLike, second: ArrayLike) -> np.ndarray:
    """Return the angle of the relative rotation, accurate also near 0 and π.

    Parameters
    ----------
    first, second : array_like, shape (..., 3, 3)

    Returns
    -------
    ndarray, shape (...)
        0 to π [rad].
    """
    between = np.swapaxes(np.asarray(first), -1, -2) @ np.asarray(second, dtype=float)
    sine = np.linalg.norm(np.stack((
        between[..., 2, 1] - between[..., 1, 2], between[..., 0, 2] - between[..., 2, 0],
        between[..., 1, 0] - between[..., 0, 1]), axis=-1), axis=-1)
    return np.arctan2(sine, np.trace(between, axis1=-2, axis2=-1) - 1.)


def palm_pose_error(rotation: ArrayLike, position: ArrayLike, true_rotation: ArrayLike,
                    true_position: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Return the orientation and position errors of the palm.

    Parameters
    ----------
    rotation, true_rotation : array_like, shape (..., 3, 3)
    position, true_position : array_like, shape (..., 3)
        Of the wrist [m].

    Returns
    -------
    angle : ndarray, shape (...)
        [rad]
    distance : ndarray, shape (...)
        [m]
    """
    return (rotation_angles(rotation, true_rotation),
            np.linalg.norm(np.asarray(position) - np.asarray(true_position), axis=-1))


def limit_violations(angles: ArrayLike, limits: ArrayLike,
                     tolerance: float = 0.) -> tuple[float, float]:
    """Return the share of frames beyond the joint limits and the largest excess.

    Parameters
    ----------
    angles : array_like, shape (n, k)
        An angle that is not finite is outside, with no excess [rad].
    limits : array_like, shape (k, 2)
        [rad]
    tolerance : float
        Excess that does not count [rad].

    Returns
    -------
    share : float
        Of frames with any joint outside [1].
    largest : float
        Largest excess [rad].
    """
    found, bounds = np.asarray(angles, dtype=float), np.asarray(limits, dtype=float)
    excess = np.maximum(bounds[:, 0] - found, found - bounds[:, 1])
    outside = ~(excess <= tolerance)  # true for NaN
    return float(outside.any(axis=1).mean()), float(max(np.nanmax(excess, initial=0.), 0.))


def jerk(values: ArrayLike, rate: float) -> np.ndarray:
    """Return the root mean square jerk, the third derivative over time.

    Parameters
    ----------
    values : array_like, shape (n, ...)
        n is at least 4.
    rate : float
        [Hz]

    Returns
    -------
    ndarray, shape (...)
        [unit / s³]
    """
    return np.sqrt(np.mean(np.diff(np.asarray(values), 3, axis=0) ** 2, axis=0)) * rate ** 3


def high_frequency_energy(values: ArrayLike, rate: float,
                          cutoff: float = REST_CUTOFF) -> np.ndarray:
    """Return the mean square of signal components above a cutoff: jitter of a hand at rest.

    Parameters
    ----------
    values : array_like, shape (n, ...)
    rate : float
        [Hz]
    cutoff : float
        [Hz]

    Returns
    -------
    ndarray, shape (...)
        a²/2 for a sine of amplitude a above the cutoff [unit²].
    """
    signal = np.asarray(values, dtype=float)
    n = len(signal)
    # Without the line through both ends: a drift would appear as a step at the ends.
    ramp = np.linspace(0., 1., n).reshape((n,) + (1,) * (signal.ndim - 1))
    spectrum = np.fft.rfft(signal - signal[0] - ramp * (signal[-1] - signal[0]), axis=0)
    power = np.abs(spectrum / n) ** 2
    # The negative frequencies count too; mean and Nyquist frequency have none.
    power[1:(n + 1) // 2] *= 2.
    return power[np.fft.rfftfreq(n, 1. / rate) > cutoff].sum(axis=0)


def availability(errors: ArrayLike, tolerance: float) -> float:
    """Return the share of predictions of hidden markers within a tolerance.

    Parameters
    ----------
    errors : array_like
        Errors of the predicted positions, NaN or inf without a prediction [m].
    tolerance : float
        [m]

    Returns
    -------
    float
        NaN if there are no errors.
    """
    found = np.asarray(errors, dtype=float)
    return float((found <= tolerance).mean()) if found.size else np.nan
