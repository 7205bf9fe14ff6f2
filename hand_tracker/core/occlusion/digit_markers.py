"""The digits' markers through occlusion: inertia, and the digits that move with them."""

import math

import numpy as np

from ..filtering.tracks import predict_track, update_track
from ..numerics.jit import jit
from ..numerics.vectors import add, components, dot, frame, length, scale, subtract, vector
from .transdigital import learn, shares_of

# From captures.
HORIZON = .3           # [s] over which a velocity counts as a move
FLOOR = .003           # [m] moves of neighbours that are smaller tell little
PRIOR_SPREAD = .03     # [m] moves for which the prior stands


@jit
def follow_digits(markers, seen, tracks, rotation, position, rest, habits, prior, shares,
                  pushed, step, noise, smooth, fading, memory, learning, longest, relaxing):
    """Bring the digits' tracks to this frame.

    Parameters
    ----------
    markers : ndarray, shape (5, 3)
        [m]
    seen : ndarray of bool, shape (5,)
    tracks : Tracks
        Changed.
    rotation, position : ndarray, shape (3, 3) and (3,)
        Pose of the wrist [m].
    rest : ndarray, shape (5, 3)
        Places of a relaxed hand, in the wrist's frame [m].
    habits : Habits
        Changed.
    prior : ndarray, shape (15, 15)
        `prior_of`.
    shares : ndarray, shape (15, 15)
        Of moves of the seen that the hidden take; changed when others are hidden.
    pushed : ndarray, shape (5, 3)
        By how much what touches a digit carries it, if it is hidden [m].
    noise : ndarray, shape (5,)
        Of each marker on the palm, standard deviation on an axis [m].
    step, smooth, fading
        See `update_track` and `predict_track`.
    memory : float
        Of the habits [s]; 0: there is no transdigital correlation.
    learning : bool
        Whether the palm is certain enough to learn from.
    longest : float
        Time for which a prediction holds [s].
    relaxing : float
        Time in which one that no longer does goes two thirds of the way to what is usual
        with its neighbours; 0 holds it [s].
    """
    before = np.empty((5, 3))
    moves = np.zeros((5, 3))
    pace = np.empty((5, 3))
    steady = np.empty(5, dtype=np.bool_)
    hidden = np.empty(5, dtype=np.bool_)
    axes = frame(rotation)
    origin = vector(position)
    changed = False
    for i in range(5):
        changed = changed or seen[i] != tracks.seen[i]
        steady[i] = seen[i] and tracks.seen[i]
        hidden[i] = not seen[i]
        for k in range(3):
            before[i, k] = tracks.mean[i, k]
            pace[i, k] = tracks.pace[i, k]
    if changed:
        if memory > 0.:
            shares_of(habits, prior, PRIOR_SPREAD, before, hidden, HORIZON, FLOOR, shares)
        else:
            shares[:] = 0.
    learned = learning and memory > 0.
    for i in range(5):
        if seen[i]:
            learned = learned and steady[i]
            update_track(tracks, i, components(axes, subtract(vector(markers[i]), origin)),
                         step, noise[i], smooth)
            for k in range(3):
                moves[i, k] = tracks.mean[i, k] - before[i, k]
        elif tracks.known[i] and tracks.hidden_for[i] <= longest:
            learned = False
    for i in range(5):
        if not seen[i]:
            move = _share(shares, i, moves, steady)
            predict_track(tracks, i, _pushed_on(move, vector(pushed[i])),
                          _share(shares, i, pace, steady), step, fading)
            if relaxing > 0. and not (tracks.known[i] and tracks.hidden_for[i] <= longest):
                _relax(tracks, i, seen, habits, rest, shares, 1. - math.exp(-step / relaxing))
        tracks.seen[i] = seen[i]
    if learned:
        learn(habits, tracks.mean, tracks.pace, step, memory)


@jit
def _pushed_on(move, push):
    """Return a move that goes at least as far as it is pushed."""
    size = length(push)
    if size == 0.:
        return move
    direction = scale(push, 1. / size)
    return add(move, scale(direction, max(size - dot(move, direction), 0.)))


@jit
def _relax(tracks, digit, seen, habits, rest, shares, part):
    """Take a digit part of the way to its usual place with its neighbours as they are."""
    # Of one that was never seen nothing was learned but what it was taken for.
    weight = habits.weight[0] if tracks.known[digit] else 0.
    usual = np.empty((5, 3))
    away = np.empty((5, 3))
    for i in range(5):
        for k in range(3):
            usual[i, k] = rest[i, k]
            if weight > 0.:
                usual[i, k] = (habits.first[3 * i + k] + rest[i, k]) / (weight + 1.)
            away[i, k] = tracks.mean[i, k] - usual[i, k]
    natural = _share(shares, digit, away, seen)
    for k in range(3):
        tracks.mean[digit, k] += part * (usual[digit, k] + natural[k] - tracks.mean[digit, k])


@jit
def _share(shares, digit, moves, steady):
    """Return a digit's share of the moves of those seen now and before."""
    total = (0., 0., 0.)
    for j in range(5):
        if steady[j]:
            for k in range(3):
                column = 3 * j + k
                move = moves[j, k]
                total = (total[0] + shares[3 * digit, column] * move,
                         total[1] + shares[3 * digit + 1, column] * move,
                         total[2] + shares[3 * digit + 2, column] * move)
    return total
