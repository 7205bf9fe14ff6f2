"""Digits' markers under occlusion: seen ones filtered, hidden ones predicted.

A hidden marker moves on by its own fading motion (inertia), by the digits that usually move
with it (transdigital correlation) and by what pushes it (contact), all in the wrist's frame.
"""

import math

import numpy as np

from ..filtering.tracks import Tracks, predict_track, update_track
from ..model.palm_triangle import Wrist
from ..numerics.jit import jit
from ..numerics.stack_memory import local_flags, local_floats
from ..numerics.vectors import Vector, add, components, dot, frame, length, scale, subtract, vector
from .prediction import Observation, PredictionOptions
from .transdigital import DigitPrior, Transdigital, learn, regress_hidden

FIRST_RELAX_TIME = 1e-9  # [s] relax time in the first frame: digits never seen start relaxed


@jit
def track_digits(observation: Observation, step: float, tracks: Tracks, wrist: Wrist,
                 transdigital: Transdigital, prior: DigitPrior, pushes: np.ndarray,
                 options: PredictionOptions, learning: bool) -> None:
    """Filter the digits' seen markers and predict their hidden ones.

    Parameters
    ----------
    observation : Observation
        Of the five markers, in the markers' frame [m].
    step : float
        Since the last frame [s].
    tracks : Tracks
        In the wrist's frame; changed.
    wrist : Wrist
        Of this frame.
    transdigital : Transdigital
        Its statistics are updated while all digits are seen, its coefficients replaced when
        other digits are hidden than before.
    prior : DigitPrior
    pushes : ndarray, shape (5, 3)
        Displacement of each hidden marker by contact [m].
    options : PredictionOptions
    learning : bool
        Whether the palm is certain enough to learn from.
    """
    seen = observation.seen
    coefficients = transdigital.coefficients
    memory, longest = options.transdigital_memory, options.max_prediction_time
    relax_time = options.relax_time if wrist.placed[0] else FIRST_RELAX_TIME
    before = local_floats((5, 3))
    moves = local_floats((5, 3))
    pace = local_floats((5, 3))
    steady = local_flags(5)
    hidden = local_flags(5)
    axes = frame(wrist.rotation)
    origin = vector(wrist.position)
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
            regress_hidden(transdigital.statistics, prior.correlation, before, hidden, coefficients)
        else:
            coefficients[:] = 0.
    learned = learning and memory > 0.
    for i in range(5):
        if seen[i]:
            learned = learned and steady[i]
            local = components(axes, subtract(vector(observation.positions[i]), origin))
            update_track(tracks, i, local, step, observation.noise[i], options.smoothing)
            for k in range(3):
                moves[i, k] = tracks.mean[i, k] - before[i, k]
        elif tracks.known[i] and tracks.hidden_for[i] <= longest:
            learned = False
    for i in range(5):
        if not seen[i]:
            move = _predicted_move(coefficients, i, moves, steady)
            predict_track(tracks, i, _at_least(move, vector(pushes[i])),
                  _predicted_move(coefficients, i, pace, steady), step, options.inertia)
            if relax_time > 0. and not (tracks.known[i] and tracks.hidden_for[i] <= longest):
                _relax(tracks, i, seen, transdigital, prior.rest,
                       1. - math.exp(-step / relax_time))
        tracks.seen[i] = seen[i]
    if learned:
        learn(transdigital.statistics, tracks.mean, tracks.pace, step, memory)


@jit
def _at_least(move: Vector, push: Vector) -> Vector:
    """Return a move extended along a push to at least the push's length [m]."""
    size = length(push)
    if size == 0.:
        return move
    direction = scale(push, 1. / size)
    return add(move, scale(direction, max(size - dot(move, direction), 0.)))


@jit
def _relax(tracks: Tracks, digit: int, seen: np.ndarray, transdigital: Transdigital,
           rest: np.ndarray, share: float) -> None:
    """Move a digit a share of the way to its mean place, given the seen digits' deviations."""
    statistics = transdigital.statistics
    # A marker never seen has no statistics: use its rest position.
    weight = statistics.weight[0] if tracks.known[digit] else 0.
    mean = local_floats((5, 3))
    deviation = local_floats((5, 3))
    for i in range(5):
        for k in range(3):
            mean[i, k] = rest[i, k]
            if weight > 0.:
                mean[i, k] = (statistics.first[3 * i + k] + rest[i, k]) / (weight + 1.)
            deviation[i, k] = tracks.mean[i, k] - mean[i, k]
    expected = _predicted_move(transdigital.coefficients, digit, deviation, seen)
    for k in range(3):
        tracks.mean[digit, k] += share * (mean[digit, k] + expected[k] - tracks.mean[digit, k])


@jit
def _predicted_move(coefficients: np.ndarray, digit: int, moves: np.ndarray,
                    regressors: np.ndarray) -> Vector:
    """Return a digit's move (or velocity) predicted by those of the digits in `regressors`."""
    total = (0., 0., 0.)
    for j in range(5):
        if regressors[j]:
            for k in range(3):
                column = 3 * j + k
                move = moves[j, k]
                total = (total[0] + coefficients[3 * digit, column] * move,
                         total[1] + coefficients[3 * digit + 1, column] * move,
                         total[2] + coefficients[3 * digit + 2, column] * move)
    return total
