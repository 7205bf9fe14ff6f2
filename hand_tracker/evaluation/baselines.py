"""Three plain ways to say where a hidden marker is; they share no code with the tracker.

Each is given the markers in the palm's frame up to now, of which the hidden ones have no
place in the window, and returns the places of those.
"""

import numpy as np

from .plain_hand import into_palm, unit

LEARNED_FROM = 10.     # [s] before the window
VELOCITY_OVER = .025   # [s] before the window
DAMPING_TIME = .1      # [s]
RIDGE = .005           # [m] spread below which a coordinate of a neighbour tells little


def hold_last(local, start, hidden, rate):
    """Return hidden markers held where they were in the palm's frame.

    Parameters
    ----------
    local : ndarray, shape (T, 8, 3)
        Markers in the palm's frame, up to the window's last frame [m].
    start : int
        The window's first frame, at least 1.
    hidden : sequence of int
        Rows whose places from `start` on are not read.
    rate : float
        [Hz]

    Returns
    -------
    ndarray, shape (T - start, len(hidden), 3)
        [m]
    """
    del rate
    return np.repeat(local[start - 1:start, hidden], len(local) - start, axis=0)


def damped_velocity(local, start, hidden, rate):
    """Return hidden markers carried on by their last velocity, which fades.

    Parameters and returns as for `hold_last`.
    """
    back = min(max(1, round(VELOCITY_OVER * rate)), start - 1)
    last = local[start - 1, hidden]
    velocity = (last - local[start - 1 - back, hidden]) * (rate / back) if back else 0. * last
    velocity = np.where(np.isfinite(velocity), velocity, 0.)
    times = np.arange(1, len(local) - start + 1) / rate
    return last + velocity * (DAMPING_TIME * (1. - np.exp(-times / DAMPING_TIME)))[:, None, None]


def linear_from_neighbours(local, start, hidden, rate):
    """Return hidden markers as affine functions of those seen, learned on the last seconds.

    Parameters and returns as for `hold_last`. Ridge regression about the mean; the last
    residual is carried on. The digits' markers are the neighbours, and the palm's too where
    a marker of the palm is hidden.
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
    # With the last residual carried on, the means drop out.
    now = local[start:, neighbours].reshape(len(local) - start, -1)
    return ((now - known[-1]) @ factors + wanted[-1]).reshape(-1, len(hidden), 3)


BASELINES = {'hold_last': hold_last, 'damped_velocity': damped_velocity,
             'linear_from_neighbours': linear_from_neighbours}


def carried_poses(markers, hidden, template, rotation, position):
    """Return the poses of a palm of which one marker is hidden.

    From frame to frame the palm turns by the smallest rotation that lays the line through
    its two visible markers right. A frame that lacks one of these has no pose.

    Parameters
    ----------
    markers : ndarray, shape (n, 3, 3)
        Those of the palm; the hidden one is not read [m].
    hidden : int
        Row of the hidden one.
    template : ndarray, shape (3, 3)
        The markers in the palm's frame [m].
    rotation : ndarray, shape (3, 3)
        Before the first frame.
    position : ndarray, shape (3,)
        [m]

    Returns
    -------
    rotation : ndarray, shape (n, 3, 3)
    position : ndarray, shape (n, 3)
        [m]
    """
    a, b = (row for row in range(3) if row != hidden)
    along, middle = template[b] - template[a], .5 * (template[a] + template[b])
    lines = unit(markers[:, b] - markers[:, a])
    rotations = np.full((len(markers), 3, 3), np.nan)
    for frame in np.flatnonzero(np.isfinite(lines).all(axis=1)):
        line = lines[frame]
        before = unit(rotation @ along)
        axis = np.cross(before, line)
        x, y, z = axis
        cross = np.array(((0., -z, y), (z, 0., -x), (-y, x, 0.)))
        rotation = (np.eye(3) + cross + cross @ cross / (1. + before @ line)) @ rotation
        rotations[frame] = rotation
    return rotations, .5 * (markers[:, a] + markers[:, b]) - rotations @ middle


def predictions(markers, poses, start, length, hidden, rate, template):
    """Return where each of `BASELINES` has the hidden markers.

    Parameters
    ----------
    markers : ndarray, shape (T, 8, 3)
        Hidden rows are not read from `start` on, nor is anything after the window [m].
    poses : tuple of ndarray, shape (T, 3, 3) and (T, 3)
        `palm_poses` of `markers`; from `start` on not read where a palm marker is hidden.
    start, length : int
        Of the window [frames].
    hidden : sequence of int
        Rows; at most one of the palm's three.
    rate : float
        [Hz]
    template : ndarray, shape (3, 3)
        The palm's markers in its frame [m].

    Returns
    -------
    dict of ndarray, shape (length, len(hidden), 3)
        In the frame of `markers` [m].
    """
    oldest = max(0, start - round(LEARNED_FROM * rate))
    part = slice(oldest, start + length)
    points = np.array(markers[part])
    rotation, position = (np.array(array[part]) for array in poses)
    begin = start - oldest
    points[begin:, hidden] = np.nan
    for row in hidden:
        if row < 3:
            rotation[begin:], position[begin:] = carried_poses(
                points[begin:, :3], row, template, rotation[begin - 1], position[begin - 1])
    local = into_palm(points, rotation, position)
    return {name: np.einsum('nij,nkj->nki', rotation[begin:], baseline(
        local, begin, hidden, rate)) + position[begin:, None]
        for name, baseline in BASELINES.items()}
