"""Data association of a followed hand in a cloud of points: predict, assign, correct.

The palm is predicted at constant velocity, the digits' markers likewise in its frame. Points are
assigned to predicted markers at least cost, once more where the palm fitted to them shows more;
hidden markers move with their conditional mean given the seen ones.
"""

import math

import numpy as np

from ..numerics.assignment import assign_rows
from ..numerics.jit import labelling_jit
from ..numerics.rigid_fit import fit_rigid
from ..numerics.stack_memory import local_floats
from .clutter import Cloud, Clutter, continue_clutter
from .hand_track import (
    ASTRAY_DISTANCE,
    CLUTTER_RANGE,
    LEAST_ARRIVALS,
    LEAST_FOLLOWED,
    MOST_ARRIVALS,
    HandTrack,
    coming_cost,
    place_again,
    predict_hand,
    reset_palm_gaps,
    write_deviations,
)
from .links import exchange_gain
from .pair_search import place_by_all
from .palm_search import (
    blank_finding,
    copy_finding,
    count_seen_palm,
    place_by_palm,
    to_palm_frame,
    write_cost,
)
from .point_costs import match_costs
from .posture import (
    contradiction,
    count_seen,
    exchange_change,
    posture_cost,
    posture_distance,
    reset_matrix,
    tail_cost,
)
from .prototypes import Prototype
from .returns import PalmPoints, begin_return, best_return, give_up, note_arrivals, present_cost
from .rivals import note_cut, review_labels

LEAST_POINT_DEVIATION = .0015     # [m] prediction error of a seen marker, at least; ours
GREATEST_DEVIATION = .012   # [m] the same, at most; ours
DEVIATION_GAIN = .05        # [1] filter gain of a prediction error that falls
OWN_RISE = .3               # [1] the same of one that rises, in the palm's frame; ours
SURE_PALM = 5               # seen palm markers that show the palm's pose beyond doubt; ours
CONTRADICTION = 60.         # gate: squared Mahalanobis distance given the other markers; ours
MEETING_COST = 12.          # cost of an exchange below which two labels are ambiguous; ours
# Evidence for the exchange of two labels: the most that a frame adds, and the threshold; addition
# to it by trust, and the trust that rules out an exchange; ours.
CROSSING_GAIN, CROSSING_MARGIN = 10., 26.
TRUSTED_CROSSING, CROSSING_TRUST = 60., .5    # [variances, s]
JUDGED_TIME = .5            # [s] for which a reappeared marker is judged by its motion; ours
RETURN_DOUBT = 12.          # cost above which it is hidden again: its return is undone; ours
RETURN_LEAD = 4.            # cost lead of another point at which its return is undone; ours
CLUTTER_TIME = 1.           # [s] time constant of the rate of new points
SPEED_GAIN = .6             # [1] filter gain of the palm's linear and angular velocity
WEAK_SPEED_GAIN = .25       # the same while a marker of the palm is hidden
DRIFT_GAIN = .4             # [1] filter gain of a marker's velocity in the palm's frame
DRIFT_TIME = .04            # [s] time constant with which a hidden marker's velocity fades
RELAXATION_TIME = 1.        # [s] in which hidden markers relax to their conditional mean
PALM_GAP_TIME = 1.          # [s] in which the distances of palm markers follow what is seen; ours
WEAK, WEAKER = .1, .05    # fit weights of digit and hidden palm markers under occlusion


@labelling_jit
def place_palm_by(prototype: Prototype, track: HandTrack, points: np.ndarray,
                  rows: np.ndarray) -> None:
    """Fit the palm to its seen markers; with fewer than three, to all markers by weight."""
    count = len(rows)
    seen = count_seen_palm(prototype, rows)
    weights, there = np.zeros(count), np.empty((count, 3))
    rest = np.empty((count, 3))
    size = track.finding.size[0]
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
def settle_palm(prototype: Prototype, track: HandTrack, points: np.ndarray, rows: np.ndarray,
                step: float) -> None:
    """Correct the pose of an occluded palm by the joint distribution of all markers.

    With two palm markers seen, digits that bend and a palm that turns look alike; the joint
    distribution of all markers distinguishes them. Hidden palm markers keep their offset from where
    it places them, fading, as long as the same markers are seen.

    Parameters
    ----------
    prototype : Prototype
    track : HandTrack
        Its palm is placed by `place_palm_by`; updated.
    points : ndarray, shape (n, 3)
        [m]
    rows : ndarray of int, shape (M,)
        Point of each marker, -1 for none.
    step : float
        Time since the last frame [s].
    """
    count, same = len(rows), _same_are_seen(track, rows)
    if count_seen_palm(prototype, rows) >= 3 or count_seen(rows) == 0:
        track.palm_offset[:] = np.nan
        return
    placed = track.finding
    guess = blank_finding(count)
    copy_finding(placed, guess)
    guess.rows[:] = rows
    place_by_all(prototype, points, guess)
    size = guess.size[0]
    weights, there, rest = np.zeros(count), np.zeros((count, 3)), np.zeros((count, 3))
    home = local_floats(3)
    for i in range(count):
        if prototype.rigid[i] <= 0.:
            continue
        known = track.palm_offset[i, 0] == track.palm_offset[i, 0]
        same = same and (known or rows[i] >= 0)
        weights[i] = 1. if rows[i] >= 0 else WEAK
        for k in range(3):
            home[k] = prototype.template[i, k] + (track.palm_offset[i, k] if known else 0.)
            rest[i, k] = placed.size[0] * prototype.template[i, k]
        for k in range(3):
            there[i, k] = points[rows[i], k] if rows[i] >= 0 else guess.position[k] + size * (
                guess.rotation[k, 0] * home[0] + guess.rotation[k, 1] * home[1]
                + guess.rotation[k, 2] * home[2])
    if same:
        fit_rigid(rest, there, weights, placed.rotation, placed.position)
    kept = 1. - min(step / RELAXATION_TIME, 1.)
    for i in range(count):
        if prototype.rigid[i] <= 0. or rows[i] >= 0:
            continue
        for k in range(3):
            there[i, k] = placed.position[k] - guess.position[k]
            for n in range(3):
                there[i, k] += placed.rotation[k, n] * rest[i, n]
        for k in range(3):
            track.palm_offset[i, k] = kept * ((
                guess.rotation[0, k] * there[i, 0] + guess.rotation[1, k] * there[i, 1]
                + guess.rotation[2, k] * there[i, 2]) / size - prototype.template[i, k])


@labelling_jit
def renew_places(prototype: Prototype, points: np.ndarray, track: HandTrack) -> None:
    """Follow a hand on by another prototype: its palm is placed anew, the markers stay.

    Parameters
    ----------
    prototype : Prototype
        Of the same markers.
    points : ndarray, shape (n, 3)
        Of the last frame [m].
    track : HandTrack
        Updated.
    """
    finding = track.finding
    place_again(track)
    if not place_by_palm(prototype, points, finding.rows, finding) and count_seen(finding.rows):
        place_by_all(prototype, points, finding)
    for i in range(len(finding.rows)):
        if track.seen_for[i] < PALM_GAP_TIME:   # its distances are still the former template's
            reset_palm_gaps(prototype, track, i)
    to_palm_frame(track.place, finding.rotation, finding.position, finding.size[0], track.local)
    finding.distance[0] = math.inf      # by the other prototype
    track.expected[:] = track.palm_offset[:] = np.nan
    track.returns.age[:] = math.inf
    track.exchanged[:] = track.doubt[0] = 0.


@labelling_jit
def palm_changes(prototype: Prototype, track: HandTrack, rows: np.ndarray) -> bool:
    """Return whether the set of seen palm markers has changed since the last frame."""
    changed = False
    for i in range(len(rows)):
        changed = changed or (prototype.rigid[i] > 0.
                              and (rows[i] >= 0) != (track.hidden_for[i] <= 0.))
    return changed


@labelling_jit
def _same_are_seen(track: HandTrack, rows: np.ndarray) -> bool:
    """Return whether the set of seen markers is that of the last frame."""
    same = True
    for i in range(len(rows)):
        same = same and (rows[i] >= 0) == (track.hidden_for[i] <= 0.)
    return same


@labelling_jit
def correct_hand(prototype: Prototype, track: HandTrack, seen: PalmPoints, rows: np.ndarray,
                 last: np.ndarray, step: float) -> None:
    """Correct a hand's track by the points assigned to its markers.

    Parameters
    ----------
    prototype : Prototype
    track : HandTrack
        Predicted; its palm is placed by `place_palm_by`.
    seen : PalmPoints
        Updated: points in the palm's frame, and the history of points whose return is undone.
    rows : ndarray of int, shape (M,)
        Point of each marker, -1 for none.
    last : ndarray, shape (4, 3)
        Rotation and position of the palm in the last frame.
    step : float
        Time since then [s].
    """
    finding, count = track.finding, len(rows)
    # The jump of a roughly placed palm that is seen again is no motion.
    replaced = palm_changes(prototype, track, rows)
    sure = not replaced and count_seen_palm(prototype, rows) >= SURE_PALM
    if step > 0. and not replaced:
        _follow_motion(prototype, track, rows, last, step)
    local = seen.local
    to_palm_frame(seen.cloud.points, finding.rotation, finding.position, finding.size[0], local)
    if replaced:
        # Predicted markers keep their places in the frame of the points.
        to_palm_frame(track.place, finding.rotation, finding.position, finding.size[0],
                      track.local)
    note_arrivals(prototype, track, seen)
    finding.rows[:] = rows
    matrix = np.empty((3 * count, 3 * count))
    constant, hidden = reset_matrix(prototype, rows, matrix)
    residual, gradient = np.empty(3 * count), np.empty(3 * count)
    distance = posture_distance(matrix, prototype.template, local, rows, residual, gradient)
    write_cost(prototype, local, finding, posture_cost(constant, distance, count - hidden, hidden),
               distance)
    same = _same_are_seen(track, rows)
    given_up = np.zeros(count, dtype=np.bool_)
    for i in range(count):
        if rows[i] < 0:
            _carry_hidden(prototype, track, i, matrix, gradient, same, step)
            continue
        if track.hidden_for[i] > 0.:
            begin_return(track, i, seen, rows[i])
        elif track.returns.age[i] < math.inf:
            given_up[i] = _judge_return(
                prototype, track, i, seen, rows[i], matrix, gradient, same, step)
        _correct_marker(track, i, seen, rows[i], replaced, sure, step)
        contradicted = contradiction(
            matrix, gradient, i, distance, count - hidden) > CONTRADICTION
        track.suspected_for[i] = track.suspected_for[i] + step if contradicted else 0.
    for i in range(count):
        if given_up[i] and track.returns.age[i] < math.inf:
            give_up(track, i, seen, rows[i])
    _exchange_by_links(prototype, track, seen, matrix, gradient, distance, count - hidden)
    _measure_palm(prototype, track, step)
    # A rare pose still counts as a hand's while it costs less than clutter.
    astray = (finding.distance[0] > ASTRAY_DISTANCE * max(prototype.typical, 1.)
              and finding.cost[0] > 0.
              or count - hidden < max(3., LEAST_FOLLOWED * count))
    track.astray_for[0] = track.astray_for[0] + step if astray else 0.
    track.age[0] += step


@labelling_jit
def _exchange_by_links(prototype: Prototype, track: HandTrack, seen: PalmPoints,
                       matrix: np.ndarray, gradient: np.ndarray, distance: float,
                       judged: int) -> None:
    """Exchange two digit labels once their links and the posture have favoured it long enough.

    A frame in which a return was undone is no evidence: `distance` still includes that marker.

    Parameters
    ----------
    prototype : Prototype
    track : HandTrack
    seen : PalmPoints
    matrix, gradient
        As for `posture_distance`.
    distance : float
        Squared Mahalanobis distance of the markers that were seen.
    judged : int
        Their number, including undone returns.
    """
    finding = track.finding
    rows = finding.rows
    if not len(prototype.links):
        return
    whole = count_seen(rows) == judged
    present = tail_cost(distance, 3 * judged)
    first, second, most, saved, farther = -1, -1, 0., 0., 0.
    for i in range(len(rows)):
        for j in range(i):
            trust = track.trusted_for[i, j] / CROSSING_TRUST
            # Palm labels stay: the palm is placed by them.
            if (rows[i] < 0 or rows[j] < 0 or prototype.rigid[i] > 0. or prototype.rigid[j] > 0.
                    or trust >= 1.):
                track.exchanged[i, j] = 0.
                continue
            if not whole:
                continue
            change = exchange_change(matrix, gradient, seen.local, rows, i, j)
            gain = exchange_gain(prototype, seen.local, rows, i, j) + present - tail_cost(
                max(distance + change, 0.), 3 * judged)
            track.exchanged[i, j] = max(track.exchanged[i, j] + min(gain, CROSSING_GAIN), 0.)
            lead = track.exchanged[i, j] - CROSSING_MARGIN - TRUSTED_CROSSING * trust
            if lead > most:
                first, second, most, saved, farther = i, j, lead, gain, change
    if first < 0:
        return
    rows[first], rows[second] = rows[second], rows[first]
    finding.cost[0] -= saved
    finding.distance[0] = max(distance + farther, 0.) / (3. * judged)
    track.exchanged[first] = track.exchanged[second] = 0.
    track.exchanged[:, first] = track.exchanged[:, second] = 0.
    track.trusted_for[first, second] = track.trusted_for[second, first] = 0.
    for i in (first, second):
        track.returns.age[i] = math.inf
        track.suspected_for[i] = 0.
        for k in range(3):
            track.local[i, k] = seen.local[rows[i], k]
            track.expected[i, k] = np.nan
    for k in range(3):
        drift = track.drift[first, k]
        track.drift[first, k] = track.drift[second, k]
        track.drift[second, k] = drift


@labelling_jit
def _measure_palm(prototype: Prototype, track: HandTrack, step: float) -> None:
    """Filter the distances of seen palm markers over a time step [s]: no template fits exactly."""
    gain = min(step / PALM_GAP_TIME, 1.)
    for i in range(len(prototype.rigid)):
        if prototype.rigid[i] <= 0. or track.finding.rows[i] < 0:
            continue
        for j in range(i):
            if prototype.rigid[j] <= 0. or track.finding.rows[j] < 0:
                continue
            off = 0.
            for k in range(3):
                off += (track.local[i, k] - track.local[j, k]) ** 2
            gap = track.palm_gaps[i, j] + gain * (
                track.finding.size[0] * math.sqrt(off) - track.palm_gaps[i, j])
            track.palm_gaps[i, j] = track.palm_gaps[j, i] = gap


@labelling_jit
def _follow_motion(prototype: Prototype, track: HandTrack, rows: np.ndarray, last: np.ndarray,
                   step: float) -> None:
    """Filter the palm's linear and angular velocity; parameters are those of `correct_hand`."""
    whole = True
    for i in range(len(rows)):
        whole = whole and (rows[i] >= 0 or prototype.rigid[i] <= 0.)
    gain = 1. if track.age[0] <= 0. else SPEED_GAIN if whole else WEAK_SPEED_GAIN
    spin = _rotation_vector(last, track.finding.rotation)
    for k in range(3):
        speed = (track.finding.position[k] - last[3, k]) / step
        track.motion[0, k] += gain * (speed - track.motion[0, k])
        track.motion[1, k] += gain * (spin[k] / step - track.motion[1, k])


@labelling_jit
def _carry_hidden(prototype: Prototype, track: HandTrack, i: int, matrix: np.ndarray,
                  gradient: np.ndarray, same: bool, step: float) -> None:
    """Move a hidden marker with its conditional mean given the seen ones; write its variance.

    Parameters
    ----------
    prototype : Prototype
    track : HandTrack
    i : int
        Of the marker.
    matrix, gradient
        As for `posture_distance`.
    same : bool
        Whether the same markers are seen as in the last frame.
    step : float
        Time since then [s].
    """
    relaxed = min(step / RELAXATION_TIME, 1.)
    track.hidden_for[i] += step
    spread = 0.
    for k in range(3):
        expected = prototype.template[i, k] - gradient[3 * i + k]
        before = track.expected[i, k]
        # It moves with its conditional mean, and relaxes to it.
        if same and before == before:
            track.local[i, k] += expected - before
        track.expected[i, k] = expected
        spread -= matrix[3 * i + k, 3 * i + k] / 3.  # swept: minus the conditional covariance
        track.drift[i, k] *= math.exp(-step / DRIFT_TIME)
        track.local[i, k] += relaxed * (expected - track.local[i, k])
    track.spread[i] = spread
    track.suspected_for[i] = 0.


@labelling_jit
def _judge_return(prototype: Prototype, track: HandTrack, i: int, seen: PalmPoints, row: int,
                  matrix: np.ndarray, gradient: np.ndarray, same: bool, step: float) -> bool:
    """Return whether to undo a marker's return: its point is unlikely, or another likelier.

    Parameters are those of `returns.present_cost`.
    """
    come = coming_cost(track)
    present = come + present_cost(prototype, track, i, seen, row, matrix, gradient, same, step)
    other = come + best_return(prototype, track, i, seen)
    if track.returns.age[i] > JUDGED_TIME:
        track.returns.age[i] = math.inf
    return present > RETURN_DOUBT or other < min(present - RETURN_LEAD, 0.)


@labelling_jit
def _correct_marker(track: HandTrack, i: int, seen: PalmPoints, row: int, replaced: bool,
                    sure: bool, step: float) -> None:
    """Correct position, velocity and prediction errors of a seen marker by its point.

    Parameters
    ----------
    track : HandTrack
    i : int
        Of the marker.
    seen : PalmPoints
    row : int
        Of its point.
    replaced : bool
        Whether the set of seen palm markers has changed.
    sure : bool
        Whether the error in the palm's frame is known.
    step : float
        Time since then [s].
    """
    known = track.hidden_for[i] <= 0.
    off, own = 0., 0.
    for k in range(3):
        if known:
            off += (seen.cloud.points[row, k] - track.predicted[i, k]) ** 2
            own += (track.finding.size[0] * (seen.local[row, k] - track.local[i, k])) ** 2
            if step > 0. and not replaced:
                track.drift[i, k] += DRIFT_GAIN * (seen.local[row, k] - track.local[i, k]) / step
        else:
            track.drift[i, k] = 0.
        track.local[i, k] = seen.local[row, k]
        if track.returns.age[i] == math.inf:
            track.expected[i, k] = np.nan
    if known and track.age[0] > 0.:
        track.error[i] = _filtered_error(track.error[i], off, 1.)
        if sure:
            track.own_error[i] = _filtered_error(track.own_error[i], own / 3., OWN_RISE)
    track.hidden_for[i] = 0.


@labelling_jit
def _filtered_error(error: float, square: float, rise: float) -> float:
    """Filter a prediction error [m] by the square of the present one, with a gain if it rises."""
    present = min(max(math.sqrt(square), LEAST_POINT_DEVIATION), GREATEST_DEVIATION)
    return error + (rise if present > error else DEVIATION_GAIN) * (present - error)


@labelling_jit
def _rotation_vector(before: np.ndarray, after: np.ndarray) -> tuple[float, float, float]:
    """Return the rotation vector from one rotation (3, 3) to another, in the outer frame [rad]."""
    d = local_floats((3, 3))
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
def doubt_labels(track: HandTrack, cost: np.ndarray, rows: np.ndarray) -> None:
    """Reset the trust in pairs of labels that may be exchanged, of near or hidden markers."""
    for i in range(len(rows)):
        hidden = rows[i] < 0 or track.hidden_for[i] > 0.
        if hidden:
            track.trusted_for[i, i] = 0.
        for j in range(len(rows)):
            if j == i:
                continue
            # The new point of i may be that of j, which may have had a wrong one all the while.
            if hidden:
                trusted = 0. if rows[j] < 0 or track.hidden_for[j] > 0. else min(
                    track.trusted_for[i, j], track.trusted_for[j, j])
                track.trusted_for[i, j] = track.trusted_for[j, i] = trusted
            if rows[i] < 0:
                continue
            # Cost if marker j had the point of i, and i that of j or none.
            other = cost[j, rows[i]]
            present = cost[i, rows[i]]
            if rows[j] >= 0:
                other += min(cost[i, rows[j]], 0.)
                present += cost[j, rows[j]]
            if other - present < MEETING_COST:
                track.trusted_for[i, j] = track.trusted_for[j, i] = 0.


@labelling_jit
def _match_again(prototype: Prototype, track: HandTrack, points: np.ndarray, rows: np.ndarray,
                 was_seen: np.ndarray, step: float) -> bool:
    """Fit the palm to its new points, to match once more; return whether that was done.

    Where `SURE_PALM` markers show the palm's motion, all are then expected within their errors in
    its frame. Fewer follow any wrong point: only where digit markers vanish, and within the errors
    that are left by the fitted palm. The first M of `rows` and `was_seen` are the hand's markers.
    """
    mine = rows[:len(track.place)]
    sure = count_seen_palm(prototype, mine) >= SURE_PALM
    if palm_changes(prototype, track, mine) or not (sure or _vanish(was_seen, mine)):
        return False
    place_palm_by(prototype, track, points, mine)
    place_again(track)
    if sure:
        write_deviations(prototype, track, track.own_error, step)
    else:
        track.predicted[:] = track.place
    return True


@labelling_jit
def _vanish(was_seen: np.ndarray, rows: np.ndarray) -> bool:
    """Return whether a marker seen in the last frame has no point now."""
    vanish = False
    for i in range(len(rows)):
        vanish = vanish or (was_seen[i] and rows[i] < 0)
    return vanish


@labelling_jit
def _correct(prototype: Prototype, track: HandTrack, seen: PalmPoints, cost: np.ndarray,
             rows: np.ndarray, last: np.ndarray, step: float) -> None:
    """Correct a hand by its assigned points: trust in labels, palm, markers, times, ids.

    Parameters
    ----------
    prototype : Prototype
    track : HandTrack
        Predicted; updated.
    seen : PalmPoints
        Its points that the hand keeps are no longer free.
    cost : ndarray, shape (H, n)
        Of the markers of all hands, by `match_costs`.
    rows : ndarray of int, shape (H,)
        Point of each of these, -1 for none.
    last : ndarray, shape (4, 3)
        Rotation and position of the palm in the last frame.
    step : float
        Time since then [s].
    """
    cloud, end = seen.cloud, seen.first + len(track.place)
    mine = rows[seen.first:end]
    doubt_labels(track, cost[seen.first:end], mine)
    place_palm_by(prototype, track, cloud.points, mine)
    settle_palm(prototype, track, cloud.points, mine, step)
    correct_hand(prototype, track, seen, mine, last, step)
    for i in range(len(mine)):
        row = track.finding.rows[i]
        if row >= 0:
            number = cloud.ids[row]
            track.id_kept_for[i] = track.id_kept_for[i] + step if number == track.ids[i] else 0.
            track.ids[i] = number
            track.seen_for[i] += step
            cloud.free[row] = False


@labelling_jit
def _count_arrivals(track: HandTrack, cloud: Cloud, step: float) -> int:
    """Update the rate of new clutter near a hand; return the number of new clutter points."""
    coming, come = 0., 0
    for j in range(len(cloud.points)):
        near = cloud.free[j] and cloud.cost[j] == -math.inf
        come += 1 if near else 0
        for k in range(3):
            near = near and abs(
                cloud.points[j, k] - track.finding.position[k]) < CLUTTER_RANGE
        coming += 1. if near else 0.
    track.arrivals[0] += min(step / CLUTTER_TIME, 1.) * (coming - track.arrivals[0])
    track.arrivals[0] = min(max(track.arrivals[0], LEAST_ARRIVALS), MOST_ARRIVALS)
    return come


@labelling_jit
def _predict(prototype: Prototype, track: HandTrack, first: int, step: float,
             was_seen: np.ndarray, last: np.ndarray) -> float:
    """Predict a hand; write last frame's seen markers and palm; return its Mahalanobis distance."""
    for i in range(len(track.hidden_for)):
        was_seen[first + i] = track.hidden_for[i] <= 0.
    last[:3] = track.finding.rotation
    last[3] = track.finding.position
    predict_hand(prototype, track, step)
    return track.finding.distance[0]


@labelling_jit
def follow_cloud(prototypes: tuple[Prototype, ...], tracks: tuple[HandTrack, ...],
                 clutter: Clutter, last: Cloud, cloud: Cloud, firsts: np.ndarray,
                 steps: tuple[float, float], patience: float, lost: np.ndarray) -> None:
    """Follow hands and clutter into the next frame by data association; review the labels.

    Parameters
    ----------
    prototypes : tuple of Prototype
    tracks : tuple of HandTrack
    clutter : Clutter
    last, cloud : Cloud
        The last frame, and this one; `free` is updated.
    firsts : ndarray of int
        Index of each hand's first marker among those of all hands.
    steps : (float, float)
        Time to the last frame from the one before, and to this one [s].
    patience : float
        Time for which labels, or a hand, may be contradicted [s].
    lost : ndarray of bool
        Whether each hand is lost; replaced.
    """
    step, history, points, hands = steps[1], clutter.history, cloud.points, len(tracks)
    continue_clutter(clutter, last, steps[0], cloud, step)
    total = history.cost.shape[1]
    was_seen, distance = np.zeros(total, dtype=np.bool_), np.empty(hands)
    palms = np.empty((hands, 4, 3))
    rows, cost = np.full(total, -1), np.full((total, len(points)), math.inf)
    local = np.empty((len(points), 3))
    for turn in range(2):
        # One loop for each step: each access to a track in the tuple costs.
        for hand in range(hands):
            prototype, track, first = prototypes[hand], tracks[hand], firsts[hand]
            if turn == 0:
                distance[hand] = _predict(prototype, track, first, step, was_seen, palms[hand])
            match_costs(prototype, track, PalmPoints(cloud, local, history, first), cost)
        assign_rows(cost, 0., rows)
        if turn > 0:
            break
        # A fast motion moves markers far: match them once more, from the palm fitted anew.
        again = False
        for hand in range(hands):
            placed = _match_again(prototypes[hand], tracks[hand], points, rows[firsts[hand]:],
                                  was_seen[firsts[hand]:], step)
            again = again or placed
        if not again:
            break
    for row in rows:
        if row >= 0:
            history.taken[cloud.slots[row]] = True
    for hand in range(hands):
        _correct(prototypes[hand], tracks[hand], PalmPoints(
            cloud, local, history, firsts[hand]), cost, rows, palms[hand], step)
    for hand in range(hands):
        come = _count_arrivals(tracks[hand], cloud, step)
        note_cut(prototypes[hand], tracks[hand], was_seen[firsts[hand]:], distance[hand], come)
    for hand in range(hands):
        lost[hand] = review_labels(
            prototypes[hand], tracks[hand], cloud, history, step, patience)
