"""A labelled hand followed from frame to frame in a cloud of points.

Its palm goes on with its speed and turn, its digits with theirs in the palm. Points near the
predicted places keep the labels; hidden markers are expected where the seen ones leave them.
"""

import math
from typing import NamedTuple

import numpy as np

from ..numerics.assignment import assign_rows
from ..numerics.jit import labelling_jit, loaded_or_plain
from ..numerics.rigid_fit import fit_rigid
from .palm_search import COST, DISTANCE, SIZE, Finding, complete_palm, size_cost, to_palm_frame
from .posture import (
    CLUTTER_DENSITY,
    HIDDEN_COST,
    SEEN_COST,
    contradiction,
    hidden_places,
    label_costs,
    posture_distance,
    reset_matrix,
    tail_cost,
)
from .prototypes import Prototype

LEAST_POINT_DEVIATION = .0015     # [m] of a seen marker from its prediction; ours
GREATEST_DEVIATION = .012   # [m] ours
FIRST_DEVIATION = .01       # [m] in the first frames; ours
DEVIATION_GAIN = .05        # at which the deviation follows what predictions err less
UNFORESEEN = 25.            # [m/s²] standard deviation of a marker's acceleration; ours
CONTRADICTION = 60.         # squared deviations of a marker from where the others expect it; ours
# Of the place of a marker that is hidden for t [s]: deviation sqrt(t) [m], with the tails of
# Student's distribution, as fingers rest for long and then move at once; ours.
HIDDEN_DEVIATION = .014
LONGEST_HIDDEN = 5.         # [s] after which it grows no more
HIDDEN_FREEDOM = 3.
HIDDEN_TAIL = HIDDEN_FREEDOM + 3.
VANISHING_COST = 12.        # of a marker that was seen a frame before
RETURN_COST = 12.           # of a hidden marker that is seen again
RIGID_DEVIATION = .004      # [m] of the distance of two palm markers; ours
RIGID_GAIN = 30.            # that such distances take off the cost of a palm marker at most
MEETING_COST = 12.          # below which two labels may as well be exchanged; ours
HINT_GAIN = 4.              # of a point that has the id that the marker had
# Points of no hand go on as they moved: deviation of a predicted one, and of the speed of one that
# has just come; cost of taking one for a marker after it has been there for a time; ours.
CLUTTER_DEVIATION = .002    # [m]
CLUTTER_SPEED = .5          # [m/s]
CLUTTER_COST = 16.
CLUTTER_AGE = .08           # [s]
CLUTTER_TIME = 1.           # [s] over which points that come are counted
CLUTTER_RANGE = .25         # [m] from the palm, in which they are
BIRTHS = .005, .1, 10.       # points that come there in a frame: least, at the start, most; ours
SPEED_GAIN = .6             # at which speed and turn of the palm follow
WEAK_SPEED_GAIN = .25       # the same while a marker of the palm is hidden
DRIFT_GAIN = .4             # at which the speed of a digit's marker in the palm follows
DRIFT_TIME = .04            # [s] in which a hidden marker's speed fades
RELAXATION_TIME = 1.        # [s] in which a hidden marker goes to where the seen ones expect it
ASTRAY_DISTANCE = 4.        # of a posture that is no hand's, relative to the typical one; ours
LEAST_FOLLOWED = .3         # share of a hand's markers below which it is lost
WEAK, WEAKER = .1, .05    # weights of digits' and hidden palm markers where the palm is hidden


class HandTrack(NamedTuple):
    """A hand that is followed.

    Attributes
    ----------
    finding : Finding
        Its labels and its palm.
    place : ndarray, shape (M, 3)
        Predicted place of each marker [m].
    local : ndarray, shape (M, 3)
        Its place in the palm's frame, of the prototype's size [m].
    drift : ndarray, shape (M, 3)
        Speed there [m/s].
    expected : ndarray, shape (M, 3)
        Where the seen markers expected each hidden one in the last frame [m].
    error : ndarray, shape (M,)
        By which predictions err, while the marker is seen [m].
    deviation : ndarray, shape (M,)
        Standard deviation of the prediction [m].
    hidden_for : ndarray, shape (M,)
        [s]
    suspected_for : ndarray, shape (M,)
        Time for which the other markers have contradicted each label [s].
    motion : ndarray, shape (2, 3)
        Velocity of the palm [m/s] and its angular velocity [rad/s].
    trusted_for : ndarray, shape (M,)
        Time for which each label has been the best, and not been given in doubt [s].
    ids : ndarray of int, shape (M,)
        By which the source told the markers' points apart; -1 where it did not.
    numbers : ndarray, shape (4,)
        By how much another labelling has been better [variances]; time for which the posture has
        been no hand's, and since the start [s]; points near the hand that come in a frame.
    """

    finding: Finding
    place: np.ndarray
    local: np.ndarray
    drift: np.ndarray
    expected: np.ndarray
    error: np.ndarray
    deviation: np.ndarray
    hidden_for: np.ndarray
    suspected_for: np.ndarray
    motion: np.ndarray
    trusted_for: np.ndarray
    ids: np.ndarray
    numbers: np.ndarray


DOUBT, ASTRAY, AGE, COMING = range(4)


class Clutter(NamedTuple):
    """Points of a frame that no hand has.

    Attributes
    ----------
    place : ndarray, shape (n, 3)
        [m]
    speed : ndarray, shape (n, 3)
        [m/s]
    age : ndarray, shape (n,)
        Time for which each is there [s].
    """

    place: np.ndarray
    speed: np.ndarray
    age: np.ndarray


def no_clutter() -> Clutter:
    """Return no points."""
    return Clutter(np.empty((0, 3)), np.empty((0, 3)), np.empty(0))


def begin_track(prototype: Prototype, finding: Finding, points: np.ndarray) -> HandTrack:
    """Return the track of a hand that was found among points, shape (n, 3) [m]."""
    count = len(prototype.template)
    track = HandTrack(
        Finding(*(part.copy() for part in finding)), np.zeros((count, 3)),
        prototype.template.copy(), np.zeros((count, 3)), prototype.template.copy(),
        np.full(count, FIRST_DEVIATION),
        np.full(count, FIRST_DEVIATION), np.zeros(count), np.zeros(count), np.zeros((2, 3)),
        np.zeros(count), np.full(count, -1), np.array((0., 0., 0., BIRTHS[1])))
    loaded_or_plain(start_places)(prototype, points, track)
    return track


@labelling_jit
def start_places(prototype: Prototype, points: np.ndarray, track: HandTrack) -> None:
    """Set the markers' places by the present labels; hidden ones are where they are expected."""
    rows = track.finding.rows
    local = np.empty((len(points), 3))
    to_palm_frame(points, track.finding.rotation, track.finding.position,
                  track.finding.numbers[SIZE], local)
    expected = np.empty((len(rows), 3))
    matrix = np.empty((3 * len(rows), 3 * len(rows)))
    reset_matrix(prototype, rows, matrix)
    hidden_places(prototype, local, rows, matrix, expected)
    for i in range(len(rows)):
        for k in range(3):
            track.local[i, k] = local[rows[i], k] if rows[i] >= 0 else expected[i, k]
            track.drift[i, k] = 0.
            track.expected[i, k] = np.nan
        track.hidden_for[i] = 0. if rows[i] >= 0 else 1.
        track.suspected_for[i] = 0.


@labelling_jit
def _turn(rotation: np.ndarray, x: float, y: float, z: float) -> None:
    """Turn a rotation by a rotation vector in the outer frame [rad]."""
    angle = math.sqrt(x * x + y * y + z * z)
    if angle < 1e-9:
        return
    x, y, z = x / angle, y / angle, z / angle
    c, s = math.cos(angle), math.sin(angle)
    for k in range(3):
        a, b, d = rotation[0, k], rotation[1, k], rotation[2, k]
        along = (1. - c) * (x * a + y * b + z * d)
        rotation[0, k] = c * a + s * (y * d - z * b) + along * x
        rotation[1, k] = c * b + s * (z * a - x * d) + along * y
        rotation[2, k] = c * d + s * (x * b - y * a) + along * z


@labelling_jit
def predict_hand(track: HandTrack, step: float) -> None:
    """Predict palm and markers a time step [s] ahead."""
    finding = track.finding
    for k in range(3):
        finding.position[k] += track.motion[0, k] * step
    _turn(finding.rotation, track.motion[1, 0] * step, track.motion[1, 1] * step,
          track.motion[1, 2] * step)
    for i in range(len(track.place)):
        grown = HIDDEN_DEVIATION ** 2 * min(track.hidden_for[i], LONGEST_HIDDEN)
        leap = min(UNFORESEEN * step * step, FIRST_DEVIATION)
        track.deviation[i] = math.sqrt(track.error[i] ** 2 + leap * leap + grown)
        for k in range(3):
            track.local[i, k] += track.drift[i, k] * step
    place_again(track)


@labelling_jit
def place_again(track: HandTrack) -> None:
    """Write the places of the markers in the frame of the points."""
    finding = track.finding
    size, rotation = finding.numbers[SIZE], finding.rotation
    for i in range(len(track.place)):
        for k in range(3):
            track.place[i, k] = finding.position[k] + size * (
                rotation[k, 0] * track.local[i, 0] + rotation[k, 1] * track.local[i, 1]
                + rotation[k, 2] * track.local[i, 2])


@labelling_jit
def continue_clutter(clutter: Clutter, points: np.ndarray, step: float, before: np.ndarray,
                     cost: np.ndarray) -> None:
    """Find which points go on from those that no hand had in the last frame.

    Parameters
    ----------
    clutter : Clutter
        Of the last frame.
    points : ndarray, shape (n, 3)
        [m]
    step : float
        Time since then [s].
    before : ndarray of int, shape (n,)
        Row of each point in `clutter`, -1 for those that have just come; replaced.
    cost : ndarray, shape (n,)
        Of taking it for a marker, relative to `CLUTTER_DENSITY`; `-inf` where it has just come.
    """
    before[:] = -1
    cost[:] = -math.inf
    leap = min(UNFORESEEN * step * step, FIRST_DEVIATION)
    for c in range(len(clutter.age)):
        new = CLUTTER_SPEED * step if clutter.age[c] <= 0. else 0.
        variance = CLUTTER_DEVIATION ** 2 + leap * leap + new * new
        peak = -SEEN_COST - 3. * math.log(variance)
        nearest, least = -1, 16. * variance
        for j in range(len(points)):
            off = 0.
            for k in range(3):
                off += (points[j, k] - clutter.place[c, k] - step * clutter.speed[c, k]) ** 2
            if off < least:
                nearest, least = j, off
        if nearest >= 0:
            value = min(peak - least / variance, CLUTTER_COST)
            value *= min((clutter.age[c] + step) / CLUTTER_AGE, 1.)
            if value > cost[nearest]:
                before[nearest], cost[nearest] = c, value


@labelling_jit
def remember_clutter(clutter: Clutter, points: np.ndarray, free: np.ndarray, before: np.ndarray,
                     step: float) -> Clutter:
    """Return the points that no hand has.

    Parameters
    ----------
    clutter : Clutter
        Of the last frame.
    points : ndarray, shape (n, 3)
        [m]
    free : ndarray of bool, shape (n,)
        Those that no hand has.
    before : ndarray of int, shape (n,)
        By `continue_clutter`.
    step : float
        Time since then [s].
    """
    count = 0
    for j in range(len(points)):
        count += 1 if free[j] else 0
    found = Clutter(np.empty((count, 3)), np.zeros((count, 3)), np.zeros(count))
    n = 0
    for j in range(len(points)):
        if not free[j]:
            continue
        c = before[j]
        for k in range(3):
            found.place[n, k] = points[j, k]
            if c >= 0 and step > 0.:
                speed = (points[j, k] - clutter.place[c, k]) / step
                found.speed[n, k] = speed if clutter.age[c] <= 0. else (
                    .5 * (speed + clutter.speed[c, k]))
        if c >= 0:
            found.age[n] = clutter.age[c] + step
        n += 1
    return found


@labelling_jit
def match_costs(prototype: Prototype, track: HandTrack, points: np.ndarray, ids: np.ndarray,
                clutter: np.ndarray, cost: np.ndarray) -> None:
    """Write the cost of each point as each marker beyond that of no point, (M, n).

    Parameters
    ----------
    prototype : Prototype
    track : HandTrack
        Predicted.
    points : ndarray, shape (n, 3)
        [m]
    ids : ndarray of int, shape (n,)
        By which the source tells them apart; negative where it does not.
    clutter : ndarray, shape (n,)
        By `continue_clutter`.
    cost : ndarray, shape (M, n)
        Replaced; infinite where the marker cannot be.
    """
    come = 2. * math.log(track.numbers[COMING] / (8. * CLUTTER_RANGE ** 3 * CLUTTER_DENSITY))
    for i in range(len(cost)):
        hidden = track.hidden_for[i] > 0.
        variance = track.deviation[i] ** 2
        base = SEEN_COST + 3. * math.log(variance) + (RETURN_COST if hidden else -VANISHING_COST)
        for j in range(len(points)):
            off = ((points[j, 0] - track.place[i, 0]) ** 2
                   + (points[j, 1] - track.place[i, 1]) ** 2
                   + (points[j, 2] - track.place[i, 2]) ** 2)
            tail = off / variance
            if hidden:
                tail = HIDDEN_TAIL * math.log1p(off / (HIDDEN_FREEDOM * variance))
            value = base + tail + max(come, clutter[j])
            if ids[j] >= 0 and ids[j] == track.ids[i]:
                value -= HINT_GAIN
            # Another cost of the palm's rigidity is to be expected at best.
            if hidden and prototype.rigid[i] > 0. and value < RIGID_GAIN:
                value += rigid_cost(prototype, track, i, points[j])
            cost[i, j] = value if value < 0. else math.inf


@labelling_jit
def rigid_cost(prototype: Prototype, track: HandTrack, marker: int, point: np.ndarray) -> float:
    """Return what the distances from the seen palm markers change in a palm marker's cost."""
    total, count = 0., 0
    size = track.finding.numbers[SIZE]
    for i in range(len(prototype.rigid)):
        if i == marker or prototype.rigid[i] <= 0. or track.hidden_for[i] > 0.:
            continue
        rest, here = 0., 0.
        for k in range(3):
            rest += (prototype.template[i, k] - prototype.template[marker, k]) ** 2
            here += (track.place[i, k] - point[k]) ** 2
        gap = math.sqrt(here) - size * math.sqrt(rest)
        variance = RIGID_DEVIATION ** 2 + track.deviation[i] ** 2
        # Each distance fixes one coordinate, of three.
        if count < 3:
            total += math.log(variance / max(track.deviation[marker] ** 2, variance))
        total += gap * gap / variance
        count += 1
    return total


@labelling_jit
def place_palm_by(prototype: Prototype, track: HandTrack, points: np.ndarray,
                  rows: np.ndarray) -> None:
    """Place the palm by the points of its markers, and by the others where these are hidden."""
    count = len(rows)
    seen = 0
    for i in range(count):
        seen += 1 if rows[i] >= 0 and prototype.rigid[i] > 0. else 0
    weights, there = np.zeros(count), np.empty((count, 3))
    rest = np.empty((count, 3))
    size = track.finding.numbers[SIZE]
    for i in range(count):
        rigid = prototype.rigid[i] > 0.
        if rows[i] >= 0:
            weights[i] = 1. if rigid else WEAK
        else:
            weights[i] = WEAKER if rigid else 0.
        if seen >= 3 and (not rigid or rows[i] < 0):
            weights[i] = 0.
        for k in range(3):
            there[i, k] = points[rows[i], k] if rows[i] >= 0 else track.place[i, k]
            rest[i, k] = size * (prototype.template[i, k] if rigid and rows[i] >= 0
                                 else track.local[i, k])
    fit_rigid(rest, there, weights, track.finding.rotation, track.finding.position)


@labelling_jit
def palm_changes(prototype: Prototype, track: HandTrack, rows: np.ndarray) -> bool:
    """Return whether other markers of the palm are seen than in the last frame."""
    changed = False
    for i in range(len(rows)):
        changed = changed or (prototype.rigid[i] > 0.
                              and (rows[i] >= 0) != (track.hidden_for[i] <= 0.))
    return changed


@labelling_jit
def correct_hand(prototype: Prototype, track: HandTrack, points: np.ndarray, rows: np.ndarray,
                 last: np.ndarray, step: float) -> None:
    """Update a hand by the points that its markers got.

    Parameters
    ----------
    prototype : Prototype
    track : HandTrack
        Predicted; its palm is placed by `place_palm_by`.
    points : ndarray, shape (n, 3)
        [m]
    rows : ndarray of int, shape (M,)
        Point of each marker, -1 for none.
    last : ndarray, shape (4, 3)
        Rotation and position of the palm in the last frame.
    step : float
        Time since then [s].
    """
    finding, count = track.finding, len(rows)
    first = track.numbers[AGE] <= 0.
    whole = True
    for i in range(count):
        whole = whole and (rows[i] >= 0 or prototype.rigid[i] <= 0.)
    gain = 1. if first else SPEED_GAIN if whole else WEAK_SPEED_GAIN
    # Where a palm that was roughly placed comes back, it has not moved there.
    replaced = palm_changes(prototype, track, rows)
    if step > 0. and not replaced:
        spin = _rotation_vector(last, finding.rotation)
        for k in range(3):
            speed = (finding.position[k] - last[3, k]) / step
            track.motion[0, k] += gain * (speed - track.motion[0, k])
            track.motion[1, k] += gain * (spin[k] / step - track.motion[1, k])
    local = np.empty((len(points), 3))
    to_palm_frame(points, finding.rotation, finding.position, finding.numbers[SIZE], local)
    if replaced:
        # What was predicted stays where it was.
        to_palm_frame(track.place, finding.rotation, finding.position, finding.numbers[SIZE],
                      track.local)
    matrix = np.empty((3 * count, 3 * count))
    constant, hidden = reset_matrix(prototype, rows, matrix)
    residual, gradient = np.empty(3 * count), np.empty(3 * count)
    distance = posture_distance(matrix, prototype.template, local, rows, residual, gradient)
    seen = count - hidden
    finding.numbers[COST] = (constant + tail_cost(distance, 3 * seen) + hidden * HIDDEN_COST
                             + size_cost(prototype, finding.numbers[SIZE]))
    finding.numbers[DISTANCE] = distance / (3. * max(seen, 1))
    same = True  # markers seen as in the last frame
    for i in range(count):
        same = same and (rows[i] >= 0) == (track.hidden_for[i] <= 0.)
    relaxed = min(step / RELAXATION_TIME, 1.)
    for i in range(count):
        finding.rows[i] = rows[i]
        if rows[i] < 0:
            track.hidden_for[i] += step
            for k in range(3):
                expected = prototype.template[i, k] - gradient[3 * i + k]
                before = track.expected[i, k]
                # It takes part in the moves of the others, and in the end is where they expect it.
                if same and before == before:
                    track.local[i, k] += expected - before
                track.expected[i, k] = expected
                track.drift[i, k] *= math.exp(-step / DRIFT_TIME)
                track.local[i, k] += relaxed * (expected - track.local[i, k])
            track.suspected_for[i] = 0.
            continue
        known = track.hidden_for[i] <= 0.
        off = 0.
        for k in range(3):
            if known:
                off += (points[rows[i], k] - track.place[i, k]) ** 2
                if step > 0. and not replaced:
                    track.drift[i, k] += DRIFT_GAIN * (
                        local[rows[i], k] - track.local[i, k]) / step
            else:
                track.drift[i, k] = 0.
            track.local[i, k] = local[rows[i], k]
            track.expected[i, k] = np.nan
        if known and not first:
            error = min(max(math.sqrt(off), LEAST_POINT_DEVIATION), GREATEST_DEVIATION)
            rate = 1. if error > track.error[i] else DEVIATION_GAIN
            track.error[i] += rate * (error - track.error[i])
        track.hidden_for[i] = 0.
        if contradiction(matrix, gradient, i, distance, seen) > CONTRADICTION:
            track.suspected_for[i] += step
        else:
            track.suspected_for[i] = 0.
    astray = (finding.numbers[DISTANCE] > ASTRAY_DISTANCE * max(prototype.typical, 1.)
              or seen < max(3., LEAST_FOLLOWED * count))
    track.numbers[ASTRAY] = track.numbers[ASTRAY] + step if astray else 0.
    track.numbers[AGE] += step


@labelling_jit
def _rotation_vector(before: np.ndarray, after: np.ndarray) -> tuple[float, float, float]:
    """Return the rotation vector from one rotation (3, 3) to another, in the outer frame [rad]."""
    d = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                d[i, j] += after[i, k] * before[j, k]
    x, y, z = .5 * (d[2, 1] - d[1, 2]), .5 * (d[0, 2] - d[2, 0]), .5 * (d[1, 0] - d[0, 1])
    sine = math.sqrt(x * x + y * y + z * z)
    angle = math.atan2(sine, .5 * (d[0, 0] + d[1, 1] + d[2, 2] - 1.))
    share = angle / sine if sine > 1e-9 else 1.
    return share * x, share * y, share * z


@labelling_jit
def relabel(prototype: Prototype, track: HandTrack, points: np.ndarray, free: np.ndarray,
            rival: Finding) -> float:
    """Label the hand anew at its present place, without history.

    Parameters
    ----------
    prototype : Prototype
    track : HandTrack
    points : ndarray, shape (n, 3)
        [m]
    free : ndarray of bool, shape (n,)
        Points that are of no other hand.
    rival : Finding
        Replaced.

    Returns
    -------
    float
        By how much the rival costs less than the present labels.
    """
    rival.rotation[:] = track.finding.rotation
    rival.position[:] = track.finding.position
    rival.numbers[:] = track.finding.numbers
    local = np.empty((len(points), 3))
    cost = np.empty((len(rival.rows), len(points)))
    to_palm_frame(points, rival.rotation, rival.position, rival.numbers[SIZE], local)
    label_costs(prototype, local, free, cost)
    assign_rows(cost, HIDDEN_COST, rival.rows)
    complete_palm(prototype, points, free, rival)
    return track.finding.numbers[COST] - rival.numbers[COST]


@labelling_jit
def _doubt_labels(track: HandTrack, cost: np.ndarray, rows: np.ndarray) -> None:
    """Trust no labels that others might have as well: markers that meet, or come back."""
    for i in range(len(rows)):
        if rows[i] < 0 or track.hidden_for[i] > 0.:
            track.trusted_for[i] = 0.
        if rows[i] < 0:
            continue
        for j in range(len(rows)):
            if j == i:
                continue
            # Cost if marker j had the point of i, and i that of j or none.
            other = cost[j, rows[i]]
            present = cost[i, rows[i]]
            if rows[j] >= 0:
                other += min(cost[i, rows[j]], 0.)
                present += cost[j, rows[j]]
            if other - present < MEETING_COST:
                track.trusted_for[i] = 0.
                if rows[j] >= 0:
                    track.trusted_for[j] = 0.


@labelling_jit
def follow_hands(prototypes: tuple[Prototype, ...], tracks: tuple[HandTrack, ...],
                 points: np.ndarray, ids: np.ndarray, clutter: np.ndarray, step: float,
                 free: np.ndarray) -> None:
    """Follow hands into the next frame.

    Parameters
    ----------
    prototypes : tuple of Prototype
    tracks : tuple of HandTrack
    points : ndarray, shape (n, 3)
        [m]
    ids : ndarray of int, shape (n,)
        By which the source tells them apart; negative where it does not.
    clutter : ndarray, shape (n,)
        By `continue_clutter`.
    step : float
        Time since the last frame [s].
    free : ndarray of bool, shape (n,)
        Points that no hand has; updated.
    """
    total = 0
    for hand in range(len(tracks)):
        total += len(tracks[hand].place)
    last = np.empty((len(tracks), 4, 3))
    for hand in range(len(tracks)):
        last[hand, :3] = tracks[hand].finding.rotation
        last[hand, 3] = tracks[hand].finding.position
        predict_hand(tracks[hand], step)
    cost = np.empty((total, len(points)))
    rows = np.empty(total, dtype=np.int64)
    for turn in range(2):
        first = 0
        for hand in range(len(tracks)):
            end = first + len(tracks[hand].place)
            match_costs(prototypes[hand], tracks[hand], points, ids, clutter, cost[first:end])
            first = end
        assign_rows(cost, 0., rows)
        if turn > 0:
            break
        again = False
        first = 0
        for hand in range(len(tracks)):
            track = tracks[hand]
            end = first + len(track.place)
            vanished = False
            for i in range(len(track.place)):
                vanished = vanished or (rows[first + i] < 0 and track.hidden_for[i] <= 0.)
            if vanished and not palm_changes(prototypes[hand], track, rows[first:end]):
                # Once more from where the palm is now: a fast turn moves digits far.
                place_palm_by(prototypes[hand], track, points, rows[first:end])
                place_again(track)
                again = True
            first = end
        if not again:
            break
    first = 0
    for hand in range(len(tracks)):
        track = tracks[hand]
        mine = rows[first:first + len(track.place)]
        _doubt_labels(track, cost[first:first + len(track.place)], mine)
        place_palm_by(prototypes[hand], track, points, mine)
        correct_hand(prototypes[hand], track, points, mine, last[hand], step)
        for i in range(len(mine)):
            if mine[i] >= 0:
                track.ids[i] = ids[mine[i]]
                free[mine[i]] = False
        first += len(track.place)
    for hand in range(len(tracks)):
        track = tracks[hand]
        coming = 0.
        for j in range(len(points)):
            near = free[j] and clutter[j] == -math.inf
            for k in range(3):
                near = near and abs(points[j, k] - track.finding.position[k]) < CLUTTER_RANGE
            coming += 1. if near else 0.
        track.numbers[COMING] += min(step / CLUTTER_TIME, 1.) * (coming - track.numbers[COMING])
        track.numbers[COMING] = min(max(track.numbers[COMING], BIRTHS[0]), BIRTHS[2])
