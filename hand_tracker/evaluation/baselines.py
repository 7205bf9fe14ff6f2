"""Three baseline predictors of hidden markers; they share no code with the tracker.

Each takes the markers in the palm's frame, the hidden ones missing in the window, and returns the
positions of the hidden ones.
"""

from collections.abc import Callable, Sequence

import numpy as np

from ..core.numerics.vectors import unit_vectors
from .plain_hand import into_palm

LEARNED_FROM = 10.     # [s] before the window
VELOCITY_OVER = .025   # [s] before the window
DAMPING_TIME = .1      # [s] time constant
RIDGE = .005           # [m] standard deviation of a neighbour's coordinate that halves its weight


def hold_last(local: np.ndarray, start: int, hidden: Sequence[int], rate: float) -> np.ndarray:
    """Predict that hidden markers stay at their last positions in the palm's frame.

    Parameters
    ----------
    local : ndarray, shape (T, 8, 3)
        Markers in the palm's frame, up to the window's last frame [m].
    start : int
        First frame of the window, at least 1.
    hidden : sequence of int
        Rows of the hidden markers, not read from `start` on.
    rate : float
        [Hz]

    Returns
    -------
    ndarray, shape (T - start, len(hidden), 3)
        [m]
    """
    del rate
    return np.repeat(local[start - 1:start, hidden], len(local) - start, axis=0)


def damped_velocity(local: np.ndarray, start: int, hidden: Sequence[int],
                    rate: float) -> np.ndarray:
    """Predict hidden markers from their last velocity, exponentially damped.

    Parameters and returns as for `hold_last`.
    """
    back = min(max(1, round(VELOCITY_OVER * rate)), start - 1)
    last = local[start - 1, hidden]
    velocity = (last - local[start - 1 - back, hidden]) * (rate / back) if back else 0. * last
    velocity = np.where(np.isfinite(velocity), velocity, 0.)
    times = np.arange(1, len(local) - start + 1) / rate
    return last + velocity * (DAMPING_TIME * (1. - np.exp(-times / DAMPING_TIME)))[:, None, None]


def linear_from_neighbours(local: np.ndarray, start: int, hidden: Sequence[int],
                           rate: float) -> np.ndarray:
    """Predict hidden markers by ridge regression on the visible ones over the last seconds.

    Parameters and returns as for `hold_last`. The last residual is kept. The regressors are the
    digits' markers, and the palm's too where a palm marker is hidden.
    """
    first = 0 if min(hidden) < 3 else 3
    neighbours = [row for row in range(first, local.shape[1]) if row not in hidden]
    past = local[max(0, start - round(LEARNED_FROM * rate)):start]
    past = past[np.isfinite(past).all(axis=(1, 2))]
    known = past[:, neighbours].reshape(len(past), -1)
    wanted = past[:, hidden].reshape(len(past), -1)
    centred = known - known.mean(axis=0)
    factors = np.linalg.solve(
        centred.T @ centred + len(past) * RIDGE ** 2 * np.eye(centred.shape[1]),
        centred.T @ (wanted - wanted.mean(axis=0)))
    # With the last residual kept, the means cancel.
    now = local[start:, neighbours].reshape(len(local) - start, -1)
    return ((now - known[-1]) @ factors + wanted[-1]).reshape(-1, len(hidden), 3)


Predictor = Callable[[np.ndarray, int, Sequence[int], float], np.ndarray]
BASELINES: dict[str, Predictor] = {
    'hold_last': hold_last, 'damped_velocity': damped_velocity,
    'linear_from_neighbours': linear_from_neighbours}


def carried_poses(markers: np.ndarray, hidden: int, template: np.ndarray, rotation: np.ndarray
                  ) -> tuple[np.ndarray, np.ndarray]:
    """Return the poses of a palm with one hidden marker.

    From frame to frame the palm turns by the smallest rotation that aligns the line through its
    two visible markers. Frames without both have no pose.

    Parameters
    ----------
    markers : ndarray, shape (n, 3, 3)
        Palm markers; the hidden one is not read [m].
    hidden : int
        Row of the hidden marker.
    template : ndarray, shape (3, 3)
        Palm markers in the palm's frame [m].
    rotation : ndarray, shape (3, 3)
        Palm frame to world, before the first frame.

    Returns
    -------
    rotation : ndarray, shape (n, 3, 3)
    position : ndarray, shape (n, 3)
        [m]
    """
    a, b = (row for row in range(3) if row != hidden)
    along, middle = template[b] - template[a], .5 * (template[a] + template[b])
    lines = unit_vectors(markers[:, b] - markers[:, a])
    rotations = np.full((len(markers), 3, 3), np.nan)
    for frame in np.flatnonzero(np.isfinite(lines).all(axis=1)):
        line = lines[frame]
        before = unit_vectors(rotation @ along)
        axis = np.cross(before, line)
        x, y, z = axis
        cross = np.array(((0., -z, y), (z, 0., -x), (-y, x, 0.)))
        rotation = (np.eye(3) + cross + cross @ cross / (1. + before @ line)) @ rotation
        rotations[frame] = rotation
    return rotations, .5 * (markers[:, a] + markers[:, b]) - rotations @ middle


def predictions(markers: np.ndarray, poses: tuple[np.ndarray, np.ndarray], window: slice,
                hidden: Sequence[int], rate: float, template: np.ndarray
                ) -> dict[str, np.ndarray]:
    """Return the hidden markers in a window as each of `BASELINES` predicts them.

    Parameters
    ----------
    markers : ndarray, shape (T, 8, 3)
        Hidden rows are not read in the window, nor any frames after it [m].
    poses : tuple of ndarray, shape (T, 3, 3) and (T, 3)
        `palm_poses` of `markers`; not read in the window if a palm marker is hidden.
    window : slice
        Of frames.
    hidden : sequence of int
        Rows of the hidden markers; at most one of the palm's three.
    rate : float
        [Hz]
    template : ndarray, shape (3, 3)
        Palm markers in the palm's frame [m].

    Returns
    -------
    dict of ndarray, shape (length, len(hidden), 3)
        In the frame of `markers` [m].
    """
    oldest = max(0, window.start - round(LEARNED_FROM * rate))
    part = slice(oldest, window.stop)
    points = np.array(markers[part])
    rotation, position = (np.array(array[part]) for array in poses)
    begin = window.start - oldest
    points[begin:, hidden] = np.nan
    for row in hidden:
        if row < 3:
            rotation[begin:], position[begin:] = carried_poses(
                points[begin:, :3], row, template, rotation[begin - 1])
    local = into_palm(points, rotation, position)
    return {name: np.einsum('nij,nkj->nki', rotation[begin:], baseline(
        local, begin, hidden, rate)) + position[begin:, None]
        for name, baseline in BASELINES.items()}
