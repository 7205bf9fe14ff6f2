"""How far a tracked hand is from the true one, and how calmly it moves.

Every function takes arrays of frames and returns numbers; none knows where they come from.
"""

from typing import NamedTuple

import numpy as np

# Rows of the 21 landmarks: wrist; thumb CMC, MCP, IP, tip; MCP, PIP, DIP, tip of each finger.
JOINT_CLASSES = {
    'mcp': (5, 9, 13, 17), 'pip': (6, 10, 14, 18), 'dip': (7, 11, 15, 19),
    'tip': (8, 12, 16, 20), 'thumb_cmc': (1,), 'thumb_mcp': (2,), 'thumb_ip': (3,),
    'all': tuple(range(1, 21)),  # the thumb's tip too, but not the wrist
}
REST_CUTOFF = 10.  # [Hz] above it a hand at rest has no motion of its own; ours, unsourced


class PoseDistance(NamedTuple):
    """Eq. 11 of the paper, and two readings of it.

    Attributes
    ----------
    squared : ndarray, shape (...)
        Dist² = Σ ‖log(q_jk⁻¹ q_ik)‖² over the joints [rad²].
    distance : ndarray, shape (...)
        Dist, its root [rad].
    degrees : ndarray, shape (...)
        Mean angle of rotation of a joint [degrees].
    """

    squared: np.ndarray
    distance: np.ndarray
    degrees: np.ndarray


def quaternion_distances(first, second):
    """Return ‖log(q1⁻¹ q2)‖ = acos |⟨q1, q2⟩|, half the angle of the rotation between.

    Parameters
    ----------
    first, second : array_like, shape (..., 4)
        Unit quaternions; q and −q are the same rotation.

    Returns
    -------
    ndarray, shape (...)
        0 to π/2 [rad].
    """
    first, second = np.asarray(first, dtype=float), np.asarray(second, dtype=float)
    second = np.where((first * second).sum(axis=-1, keepdims=True) < 0., -second, second)
    # The angle between two vectors of one length: exact where the arc cosine is not.
    return 2. * np.arctan2(np.linalg.norm(first - second, axis=-1),
                           np.linalg.norm(first + second, axis=-1))


def pose_distance(first, second):
    """Return the distance of poses given by the rotations of their joints (Eq. 11).

    Parameters
    ----------
    first, second : array_like, shape (..., k, 4)
        Unit quaternions of the k joints, 25 in the paper.

    Returns
    -------
    PoseDistance
    """
    return _pose_distance(quaternion_distances(first, second))


def angle_distance(first, second):
    """Return the distance of poses given by the angles of hinges (Eq. 11).

    The rotation between two angles of one hinge is their difference, and its logarithm
    half of that: the same as `pose_distance` of the hinges' quaternions.

    Parameters
    ----------
    first, second : array_like, shape (..., k)
        [rad]

    Returns
    -------
    PoseDistance
    """
    turn = np.asarray(first, dtype=float) - np.asarray(second, dtype=float)
    return _pose_distance(.5 * np.abs(np.angle(np.exp(1j * turn))))


def _pose_distance(halves):
    squared = (halves ** 2).sum(axis=-1)
    return PoseDistance(squared, np.sqrt(squared), np.degrees(2. * halves.mean(axis=-1)))


def joint_errors(found, true):
    """Return the distances of joints from their true places, by class of joint.

    Parameters
    ----------
    found, true : array_like, shape (n, 21, 3)
        Landmarks; frames and joints that are not finite are left out [m].

    Returns
    -------
    dict of ndarray, shape (m,)
        For each of `JOINT_CLASSES` [m].
    """
    errors = np.linalg.norm(np.asarray(found) - np.asarray(true), axis=-1)
    classes = {name: errors[:, list(rows)].ravel() for name, rows in JOINT_CLASSES.items()}
    return {name: values[np.isfinite(values)] for name, values in classes.items()}


def rotation_angles(first, second):
    """Return the angle of the rotation between rotations, also near 0 and π exact.

    Parameters
    ----------
    first, second : array_like, shape (..., 3, 3)

    Returns
    -------
    ndarray, shape (...)
        0 to π [rad].
    """
    between = np.swapaxes(first, -1, -2) @ np.asarray(second, dtype=float)
    sine = np.linalg.norm(np.stack((
        between[..., 2, 1] - between[..., 1, 2], between[..., 0, 2] - between[..., 2, 0],
        between[..., 1, 0] - between[..., 0, 1]), axis=-1), axis=-1)
    return np.arctan2(sine, np.trace(between, axis1=-2, axis2=-1) - 1.)


def palm_pose_error(rotation, position, true_rotation, true_position):
    """Return by how much the palm is turned and displaced.

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


def limit_violations(angles, limits, tolerance=0.):
    """Return how often and how far a hand left its limits.

    Parameters
    ----------
    angles : array_like, shape (n, k)
        An angle that is not finite is outside, by nothing [rad].
    limits : array_like, shape (k, 2)
        [rad]
    tolerance : float
        Excess that does not count [rad].

    Returns
    -------
    share : float
        Of the frames with any joint outside.
    largest : float
        Excess [rad].
    """
    angles, limits = np.asarray(angles, dtype=float), np.asarray(limits, dtype=float)
    excess = np.maximum(limits[:, 0] - angles, angles - limits[:, 1])
    outside = ~(excess <= tolerance)  # true for NaN
    return float(outside.any(axis=1).mean()), float(max(np.nanmax(excess, initial=0.), 0.))


def jerk(values, rate):
    """Return the root mean square of the third derivative.

    Parameters
    ----------
    values : array_like, shape (n, ...)
        n of 4 or more.
    rate : float
        [Hz]

    Returns
    -------
    ndarray, shape (...)
        [unit / s³]
    """
    return np.sqrt(np.mean(np.diff(values, 3, axis=0) ** 2, axis=0)) * rate ** 3


def high_frequency_energy(values, rate, cutoff=REST_CUTOFF):
    """Return the mean square of what is faster than a cutoff: the jitter of a hand at rest.

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
        A sine of amplitude a above the cutoff gives a²/2 [unit²].
    """
    values = np.asarray(values, dtype=float)
    n = len(values)
    # A straight line through both ends, so that a drift is not taken for a jump.
    ramp = np.linspace(0., 1., n).reshape((n,) + (1,) * (values.ndim - 1))
    spectrum = np.fft.rfft(values - values[0] - ramp * (values[-1] - values[0]), axis=0)
    power = np.abs(spectrum / n) ** 2
    # The mirrored half of the spectrum counts too, but for the mean and for Nyquist's.
    power[1:(n + 1) // 2] *= 2.
    return power[np.fft.rfftfreq(n, 1. / rate) > cutoff].sum(axis=0)


def availability(errors, tolerance):
    """Return the share of hidden frames in which a place was given that can be used.

    Parameters
    ----------
    errors : array_like
        Distances of predicted from true places, NaN or inf where nothing was predicted [m].
    tolerance : float
        [m]

    Returns
    -------
    float
        NaN if there is no hidden frame.
    """
    errors = np.asarray(errors, dtype=float)
    return float((errors <= tolerance).mean()) if errors.size else np.nan
