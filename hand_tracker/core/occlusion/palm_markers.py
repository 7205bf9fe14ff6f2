"""Palm markers under occlusion: seen ones filtered, hidden ones predicted.

A hidden palm marker is completed rigidly from the seen ones, moves on by its own fading motion
(inertia), and is corrected by the digits' markers. While palm markers are seen it turns about
these: by how far the digits' markers move as a turn moves them, rather than as the digits usually
move together in the palm, which is learned. While none is, a rigid fit includes the digits'
markers, which stay near their places in the wrist's frame; one that moves apart from the others
weighs less. A palm marker's place in the palm is that where it was last seen with the others: skin
slides, which moves markers off the template by millimetres.
"""

import math

import numpy as np

from ..filtering.tracks import Tracks, predict_track, update_track
from ..model.palm_triangle import Corners, Wrist, complete_palm, palm_places, rigid_palm
from ..model.states import CARRIED, LOST, TRACKED, WAITING
from ..numerics.cholesky import factorise, solve_factorised
from ..numerics.jit import jit
from ..numerics.rigid_fit import step_rigidly
from ..numerics.stack_memory import local_floats
from ..numerics.vectors import (
    Vector,
    add,
    components,
    distance,
    dot,
    frame,
    is_equal,
    length,
    rotate,
    rotate_about,
    scale,
    solve_symmetric,
    store,
    subtract,
    unit,
    vector,
)
from .prediction import Observation, PredictionOptions
from .transdigital import COORDINATES

# Of palm markers in the rigid fit, that of a finger's marker being 1; tuned on captures.
PREDICTED_PALM_WEIGHT = .15
FINGER_SCATTER = .015    # [m] from the fit, at which a finger's weight is half
LOST_BEND_TIME = .08     # [s] in which that residual becomes the finger's own motion
PALM_SHAPE_TIME = .1     # [s] that the palm's shape is averaged over; tuned on captures
PRIOR_TURNING = .44      # [rad²/s] of the palm, beside what is learned of it
OTHER_MOTION = .06       # [1] variance of a digit's marker beside its usual motion, in that of this
MOST_TURNING = 60.       # [rad²/s²] about an axis, that is learned of a frame: more is a jump
LEAST_SPREAD = 1e-6      # [m²]
DIFFERENCE_TIME = 1e-3   # [s] over which the completed markers' velocity is differenced


@jit
def track_palm(observation: Observation, step: float, tracks: Tracks, digits: Tracks, wrist: Wrist,
               shape: np.ndarray, options: PredictionOptions) -> int:
    """Filter the palm's seen markers and predict its hidden ones.

    Parameters
    ----------
    observation : Observation
        Of the eight markers.
    step : float
        Since the last frame [s].
    tracks, digits : Tracks
        Of the palm's markers and of the digits'; changed.
    wrist : Wrist
        Of the last frame.
    shape : ndarray, shape (3, 3)
        Palm markers in the wrist's frame, at first the template; updated [m].
    options : PredictionOptions

    Returns
    -------
    int
        TRACKED, CARRIED, LOST or WAITING, of `PalmState`.
    """
    markers, seen = observation.positions, observation.seen
    count = 0
    for i in range(3):
        if seen[i]:
            count += 1
    if count < 3 and not wrist.placed[0]:
        return WAITING
    if tracks.seen[0] and tracks.seen[1] and tracks.seen[2]:
        # The wrist is fitted to the mean shape as to the template, as its fits are linear in the
        # markers' places: completed by that shape, a hidden marker does not creep.
        axes, origin = frame(wrist.rotation), vector(wrist.position)
        gain = min(step / PALM_SHAPE_TIME, 1.)
        for i in range(3):
            place = components(axes, subtract(vector(tracks.mean[i]), origin))
            for k in range(3):
                shape[i, k] += gain * (place[k] - shape[i, k])
    before = palm_places(shape, wrist)
    if count < 3 and not is_equal(vector(tracks.line[0]), vector(tracks.line[1])):
        # Further markers have placed the hidden ones, too, but for the turn about their line.
        before = (vector(markers[0]), vector(markers[1]), vector(markers[2]))
    for i in range(3):
        if seen[i]:
            update_track(tracks, i, vector(markers[i]), step, observation.noise[i],
                         options.smoothing)
    if count == 3 and options.transdigital_memory > 0.:
        pace, mean = tracks.pace, tracks.mean
        spread, moved = 0., 0.
        for k in range(3):
            place = (mean[0, k] + mean[1, k] + mean[2, k]) / 3.
            drift = (pace[0, k] + pace[1, k] + pace[2, k]) / 3.
            for i in range(3):
                spread += (mean[i, k] - place) ** 2
                moved += (pace[i, k] - drift) ** 2
        # Averaged over all axes, a turn moves points by two thirds of their squared distances.
        rate = .5 * moved / max(spread, LEAST_SPREAD)
        rate = rate if rate < MOST_TURNING else MOST_TURNING    # also where it is NaN
        tracks.turning[0] = (math.exp(-step / options.transdigital_memory) * tracks.turning[0]
                             + step * rate)
    if count < 3:
        seen_palm = (seen[0], seen[1], seen[2])
        completed = complete_palm(_extrapolated(tracks, 0.), before, seen_palm)
        ahead = complete_palm(_extrapolated(tracks, DIFFERENCE_TIME), completed, seen_palm)
        for i in range(3):
            if not seen[i]:
                start = vector(tracks.mean[i])
                velocity = scale(subtract(ahead[i], completed[i]), 1. / DIFFERENCE_TIME)
                predict_track(tracks, i, subtract(completed[i], start), velocity, step,
                              options.inertia)
        hidden_for = min(tracks.hidden_for[0], tracks.hidden_for[1], tracks.hidden_for[2])
        if options.palm_from_fingers and count > 0:
            _turn_with_digits(markers, seen, tracks, digits, shape, count)
        elif options.palm_from_fingers and hidden_for <= options.max_prediction_time:
            _fit_to_fingers(markers, seen, tracks, digits, shape, step)
    for i in range(3):
        tracks.seen[i] = seen[i]
    return TRACKED if count == 3 else CARRIED if count > 0 else LOST


@jit
def _extrapolated(tracks: Tracks, ahead: float) -> Corners:
    """Return the three places extrapolated by a time [s], three vectors [m]."""
    mean, pace = tracks.mean, tracks.pace
    return (add(vector(mean[0]), scale(vector(pace[0]), ahead)),
            add(vector(mean[1]), scale(vector(pace[1]), ahead)),
            add(vector(mean[2]), scale(vector(pace[2]), ahead)))


@jit
def _turn_with_digits(markers: np.ndarray, seen: np.ndarray, tracks: Tracks, digits: Tracks,
                      shape: np.ndarray, count: int) -> None:
    """Turn hidden palm markers about the seen ones, one or two, by generalised least squares.

    A digit's marker moves in the palm by a turn, and by its own motion of covariance
    `own_motion`; how much the palm turns on its own is learned, too.
    """
    axes, origin = rigid_palm(
        (vector(tracks.mean[0]), vector(tracks.mean[1]), vector(tracks.mean[2])), shape)
    pivot, end = vector(tracks.line[0]), vector(tracks.line[1])
    is_held = not is_equal(pivot, end)
    if not is_held:
        pivot = vector(tracks.mean[0 if seen[0] else 1 if seen[1] else 2])
        end = vector(tracks.mean[2 if seen[2] else 1])
    center = components(axes, subtract(pivot, origin))
    line = unit(components(axes, subtract(end, pivot)))
    moves, weighted = local_floats(COORDINATES), local_floats(COORDINATES)
    levers = local_floats((3, COORDINATES))     # [m] moves by a turn about each axis
    covariance = local_floats((COORDINATES, COORDINATES))
    factor = local_floats((COORDINATES, COORDINATES))
    other = 0.
    for i in range(COORDINATES):
        other += OTHER_MOTION / COORDINATES * digits.own_motion[i, i]
    for digit in range(5):
        if not (seen[3 + digit] and digits.seen[digit]):
            for i in range(3 * digit, 3 * digit + 3):
                covariance[i, i] = 1.
            continue
        place, first = vector(digits.mean[digit]), 3 * digit
        arm = subtract(place, center)
        move = subtract(components(axes, subtract(vector(markers[3 + digit]), origin)), place)
        for k in range(3):
            moves[first + k] = move[k]
            levers[k, first + (k + 1) % 3] = -arm[(k + 2) % 3]
            levers[k, first + (k + 2) % 3] = arm[(k + 1) % 3]
            for j in range(first + k + 1):
                if seen[3 + j // 3] and digits.seen[j // 3]:
                    covariance[first + k, j] = digits.own_motion[first + k, j]
            covariance[first + k, first + k] += other
    if not factorise(covariance, COORDINATES, 0., factor):
        return
    matrix, pull = local_floats((3, 3)), local_floats(3)
    precision = 1. / (tracks.turning[0] + PRIOR_TURNING)
    for k in range(3):
        solve_factorised(factor, levers[k], COORDINATES, weighted)
        matrix[k, k] = precision
        for i in range(COORDINATES):
            pull[k] += weighted[i] * moves[i]
            for j in range(3):
                matrix[k, j] += weighted[i] * levers[j, i]
    a, b, c = vector(matrix[0]), vector(matrix[1]), vector(matrix[2])
    if is_held or count == 2:
        square = dot(line, (dot(line, a), dot(line, b), dot(line, c)))
        turn = scale(line, dot(line, vector(pull)) / max(square, precision))
    else:
        turn = solve_symmetric(a, b, c, vector(pull))
    turn = rotate(axes, turn)
    axis, angle = unit(turn), length(turn)
    for i in range(3):
        # One that counts as seen may be off the line.
        if is_held or not seen[i]:
            arm = subtract(vector(tracks.mean[i]), pivot)
            store(tracks.mean, i, add(pivot, rotate_about(axis, angle, arm)))


@jit
def _fit_to_fingers(markers: np.ndarray, seen: np.ndarray, tracks: Tracks, digits: Tracks,
                    shape: np.ndarray, step: float) -> None:
    """Move palm markers, all hidden, to their places in a rigid fit that includes the fingers.

    What the fit leaves of a finger's motion becomes its own: else fingers that move in the palm
    would drag it along.
    """
    if tracks.seen[0] or tracks.seen[1] or tracks.seen[2]:
        digits.strayed[:] = 0.
    axes, origin = rigid_palm(
        (vector(tracks.mean[0]), vector(tracks.mean[1]), vector(tracks.mean[2])), shape)
    points = local_floats((8, 3))
    aims = local_floats((8, 3))
    weights = local_floats(8)
    for i in range(3):
        weights[i] = PREDICTED_PALM_WEIGHT
        store(points, i, vector(tracks.mean[i]))
        store(aims, i, vector(tracks.mean[i]))
    for i in range(3, 8):
        # While the palm is lost no digit is tracked: each keeps its last place in the palm.
        if seen[i] and (digits.seen[i - 3] or digits.known[i - 3]):
            place = add(vector(digits.mean[i - 3]), vector(digits.strayed[i - 3]))
            expected = add(origin, rotate(axes, place))
            weights[i] = 1.
            store(points, i, expected)
            store(aims, i, vector(markers[i]))
    step_rigidly(points, aims, weights)
    for i in range(3, 8):
        if weights[i] > 0.:
            off = distance(vector(points[i]), vector(aims[i])) / FINGER_SCATTER
            weights[i] = 1. / (1. + off * off)
    step_rigidly(points, aims, weights)
    axes, _ = rigid_palm((vector(points[0]), vector(points[1]), vector(points[2])), shape)
    share = 1. - math.exp(-max(step, 0.) / LOST_BEND_TIME)
    for i in range(3, 8):
        if weights[i] > 0.:
            left = components(axes, subtract(vector(aims[i]), vector(points[i])))
            for k in range(3):
                digits.strayed[i - 3, k] += share * left[k]
    for i in range(3):
        store(tracks.mean, i, vector(points[i]))


@jit
def expected_markers(palm: Tracks, digits: Tracks, template: np.ndarray, step: float,
                     expected: np.ndarray) -> None:
    """Extrapolate all eight markers by a step at constant velocity.

    Parameters
    ----------
    palm, digits : Tracks
    template : ndarray, shape (3, 3)
        Palm markers in the wrist's frame [m].
    step : float
        [s]
    expected : ndarray, shape (8, 3)
        Replaced [m].
    """
    places = (_extrapolate(palm, 0, step), _extrapolate(palm, 1, step), _extrapolate(palm, 2, step))
    axes, origin = rigid_palm(places, template)
    for i in range(8):
        store(expected, i, places[i] if i < 3 else add(
            origin, rotate(axes, _extrapolate(digits, i - 3, step))))


@jit
def _extrapolate(tracks: Tracks, row: int, step: float) -> Vector:
    """Return a marker extrapolated by a step [m]."""
    mean = tracks.mean[row]
    # The filter's velocity does not lag; that of a hidden marker is its mean pace.
    velocity = vector(mean[3:]) if tracks.seen[row] else vector(tracks.pace[row])
    return add(vector(mean), scale(velocity, step))
