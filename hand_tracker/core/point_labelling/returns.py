"""Cost of a point as a marker that reappears after occlusion, by place and motion.

A digit's marker moves with the hand, near its conditional mean given the seen markers; clutter
rests or keeps its velocity. So points are judged, stretch by stretch of their path, before and
after they are labelled.
"""

import math
from typing import NamedTuple

import numpy as np

from ..numerics.jit import labelling_jit
from ..numerics.stack_memory import local_floats
from .clutter import CLUTTER_DEVIATION, STRETCH, Cloud, PointHistory
from .hand_track import HIDDEN_DEVIATION, LONGEST_HIDDEN, HandTrack
from .links import marker_links_cost
from .posture import SEEN_COST, block_inverse
from .prototypes import Prototype

HIDDEN_FREEDOM = 3.
HIDDEN_TAIL = HIDDEN_FREEDOM + 3.
MISTAKEN_COST = 16.         # of a point that was there while the marker was seen; ours
RETURN_COST = 12.           # of a hidden marker that is seen again
ANYWHERE = .3               # weight of the conditional distribution given the seen markers; ours
# Student's distributions of motion: of a reappeared marker (OWN) relative to its conditional mean,
# and of clutter (STRAY); measured on captures of hands, and ours.
OWN_SPEED = .02             # [m/s]
OWN_SPEED_TIME = .2         # [s] after which its deviation grows with the root of time only
OWN_FREEDOM = 1.
STRAY_SPEED = .15           # [m/s]
STRAY_FREEDOM = 3.
PACE_DEVIATION = .03        # [m/s] of clutter relative to its velocity, where that is known
RESTING_SHARE = .2          # share of clutter at rest; ours
PERSISTENCE = .5            # [s] median time that clutter lasts, and a marker stays hidden; ours
LONGEST_PERSISTENCE = 1.    # [s] of clutter that counts: some stays for hours; ours
MOTION_MEMORY = .5          # share of the motion term kept after a further stretch; ours
MOTION_GAIN = 8.            # most by which a stretch changes the cost; ours


class PalmPoints(NamedTuple):
    """Points of a frame, also in a palm's frame, with their history.

    Attributes
    ----------
    cloud : Cloud
    local : ndarray, shape (n, 3)
        The points in the palm's frame [m].
    history : PointHistory
    first : int
        Index of the hand's first marker among those of all hands.
    """

    cloud: Cloud
    local: np.ndarray
    history: PointHistory
    first: int


class HiddenPlace(NamedTuple):
    """Expected place of a hidden marker in the palm's frame, by its track and by the others.

    Attributes
    ----------
    last : (float, float, float)
        Carried on from its last place [m].
    variance : float
        Of that, on each axis [m²].
    likely : (float, float, float)
        Conditional mean given the seen markers; NaN where unknown [m].
    spread : float
        Variance of that [m²].
    error : float
        Prediction error of the marker [m].
    hidden_for : float
        Duration of the occlusion [s].
    """

    last: tuple[float, float, float]
    variance: float
    likely: tuple[float, float, float]
    spread: float
    error: float
    hidden_for: float


@labelling_jit
def hidden_place(track: HandTrack, i: int) -> HiddenPlace:
    """Return the expected place of a hidden marker, or of one whose return is still in doubt."""
    x, y, z = track.local[i, 0], track.local[i, 1], track.local[i, 2]
    hidden_for = track.hidden_for[i]
    if hidden_for <= 0.:
        hidden_for = track.returns.hidden_for[i]
        x -= track.returns.offset[1, i, 0]
        y -= track.returns.offset[1, i, 1]
        z -= track.returns.offset[1, i, 2]
    return HiddenPlace((x, y, z), _hidden_variance(track.error[i], hidden_for),
                       (track.expected[i, 0], track.expected[i, 1], track.expected[i, 2]),
                       track.spread[i], track.error[i], hidden_for)


@labelling_jit
def _hidden_variance(error: float, hidden_for: float) -> float:
    """Return the variance of a marker's place [m²] after an occlusion of some time [s]."""
    # By its prediction error also in a sure palm: by that in the palm's frame, no label is better.
    return error ** 2 + HIDDEN_DEVIATION ** 2 * min(hidden_for, LONGEST_HIDDEN)


@labelling_jit
def hidden_tail(off: float, variance: float) -> float:
    """Return the Student cost of a squared distance from a hidden marker's expected place [m²]."""
    return HIDDEN_TAIL * math.log1p(off / (HIDDEN_FREEDOM * variance))


@labelling_jit
def note_arrivals(prototype: Prototype, track: HandTrack, seen: PalmPoints) -> None:
    """Update the history of each point as each hidden marker: cost, motion term, offset.

    Also as each reappeared marker that is still judged, as if it were still hidden.

    Parameters
    ----------
    prototype : Prototype
    track : HandTrack
        With the places of hidden markers in this frame.
    seen : PalmPoints
        Their history is updated.
    """
    local, history = seen.local, seen.history
    for i in range(len(track.hidden_for)):
        judged = track.hidden_for[i] <= 0. and track.returns.age[i] < math.inf
        if prototype.rigid[i] > 0. or not (judged or track.hidden_for[i] > 0.):
            continue
        mark, hidden = seen.first + i, hidden_place(track, i)
        for j in range(len(local)):
            slot = seen.cloud.slots[j]
            here = history.age[slot] > 0.
            new = not here or history.cost[slot, mark] == math.inf
            if not new and history.stretch[slot] < STRETCH:
                continue
            if new:
                history.cost[slot, mark] = _place_of_return(
                    hidden, local[j]) + (MISTAKEN_COST if here else 0.)
            else:
                history.motion[slot, mark] = MOTION_MEMORY * (
                    history.motion[slot, mark] + _stretch_cost(hidden, seen, j, mark))
            for k in range(3):
                off = local[j, k] - hidden.last[k]
                history.shift[slot, mark, k] = 0. if new else off - history.offset[slot, mark, k]
                history.offset[slot, mark, k] = off


@labelling_jit
def return_cost(hidden: HiddenPlace, seen: PalmPoints, row: int, mark: int) -> float:
    """Return the cost of a point as a hidden marker, by place and motion.

    Parameters
    ----------
    hidden : HiddenPlace
        Of the marker.
    seen : PalmPoints
    row : int
        Of the point.
    mark : int
        Index of the marker among those of all hands.
    """
    history, slot = seen.history, seen.cloud.slots[row]
    cost = _place_of_return(hidden, seen.local[row])
    if history.age[slot] <= 0.:
        return cost
    if history.cost[slot, mark] == math.inf:
        return cost + MISTAKEN_COST
    return (max(cost, history.cost[slot, mark]) + history.motion[slot, mark]
            + _stretch_cost(hidden, seen, row, mark)
            - persistence_cost(history.age[slot], hidden.hidden_for))


@labelling_jit
def persistence_cost(age: float, hidden_for: float) -> float:
    """Return the cost of a point as clutter that lasts while a marker stays hidden, 0 if unknown.

    Both times are log-logistic, of shape 1. Of a point that was there before the marker vanished
    they say nothing.

    Parameters
    ----------
    age : float
        Of the point [s].
    hidden_for : float
        Of the marker [s].
    """
    if age >= hidden_for:
        return 0.
    lasted = min(age, LONGEST_PERSISTENCE)
    return 2. * (math.log1p(lasted / PERSISTENCE)
                 + math.log((PERSISTENCE + hidden_for) / (PERSISTENCE + hidden_for - lasted)))


@labelling_jit
def _place_of_return(hidden: HiddenPlace, place: np.ndarray) -> float:
    """Return the place term of a hidden marker's cost at a place in the palm's frame, (3,) [m]."""
    off, unlike = 0., 0.
    for k in range(3):
        off += (place[k] - hidden.last[k]) ** 2
        unlike += (place[k] - hidden.likely[k]) ** 2
    return SEEN_COST + RETURN_COST + place_cost(off, hidden.variance, unlike, hidden.spread)


@labelling_jit
def _stretch_cost(hidden: HiddenPlace, seen: PalmPoints, row: int, mark: int) -> float:
    """Return the motion term of a point's cost as a marker, for the present stretch of its path.

    Parameters are those of `return_cost`.
    """
    history, slot = seen.history, seen.cloud.slots[row]
    shift, turned, gone = 0., 0., 0.
    share = history.stretch[slot] / STRETCH
    for k in range(3):
        off = seen.local[row, k] - hidden.last[k] - history.offset[slot, mark, k]
        shift += off * off
        turned += (off - share * history.shift[slot, mark, k]) ** 2
        gone += uneven(seen.cloud.points[row, k] - history.came[slot, k], history.pace[slot, k],
                       history.stretch[slot])
    return motion_cost(history.stretch[slot], hidden.error, gone, min(shift, turned),
                       history.pace[slot, 0] == history.pace[slot, 0])


@labelling_jit
def uneven(moved: float, pace: float, time: float) -> float:
    """Return a coordinate's squared displacement [m²], relative to motion at its pace if known."""
    return (moved - pace * time) ** 2 if pace == pace else moved * moved


@labelling_jit
def place_cost(off: float, variance: float, unlike: float, spread: float) -> float:
    """Return the cost of a hidden marker's place by a mixture: near its last, or by the others.

    Parameters
    ----------
    off, variance : float
        Squared distance from the place carried on from its last one, and its variance [m²].
    unlike, spread : float
        The same of the conditional mean given the other markers; NaN where unknown [m²].
    """
    by_last = 3. * math.log(variance) + hidden_tail(off, variance)
    if not (unlike >= 0. and spread > 0.):
        return by_last
    by_others = 3. * math.log(spread) + unlike / spread
    least = min(by_last, by_others)
    return least - 2. * math.log((1. - ANYWHERE) * math.exp(.5 * (least - by_last))
                                 + ANYWHERE * math.exp(.5 * (least - by_others)))


@labelling_jit
def motion_cost(age: float, error: float, gone: float, shift: float, paced: bool) -> float:
    """Return the motion term of a reappeared point's cost as a hidden marker.

    Markers stay near their conditional mean; clutter rests, or keeps its velocity.

    Parameters
    ----------
    age : float
        Length of the stretch of its path [s].
    error : float
        Prediction error of the marker [m].
    gone, shift : float
        Squared displacement over the stretch, and squared change of the offset from the expected
        place in the palm's frame [m²].
    paced : bool
        Whether the first is relative to motion at its pace, see `uneven`.
    """
    grown = (OWN_SPEED * age) ** 2 / (1. + age / OWN_SPEED_TIME)
    own = error * error + grown
    resting = CLUTTER_DEVIATION ** 2 + grown
    going = CLUTTER_DEVIATION ** 2 + ((PACE_DEVIATION if paced else STRAY_SPEED) * age) ** 2
    as_marker = 3. * math.log(own) + (OWN_FREEDOM + 3.) * math.log1p(
        shift / (OWN_FREEDOM * own))
    rest = 0. if paced else RESTING_SHARE
    as_clutter = (rest * math.exp(-.5 * gone / resting) / resting ** 1.5
                  + (1. - rest) / (going * (1. + gone / (STRAY_FREEDOM * going)) ** (
                      STRAY_FREEDOM / 3. + 1.)) ** 1.5)
    return min(max(as_marker + 2. * math.log(as_clutter), -MOTION_GAIN), MOTION_GAIN)


@labelling_jit
def begin_return(track: HandTrack, i: int, seen: PalmPoints, row: int) -> None:
    """Begin to judge a marker's return, with the history of its point `row`."""
    returns, history, mark = track.returns, seen.history, seen.first + i
    slot = seen.cloud.slots[row]
    returns.cost[i] = history.cost[slot, mark]
    returns.age[i] = history.age[slot] if returns.cost[i] < math.inf else math.inf
    returns.hidden_for[i] = track.hidden_for[i]
    returns.stretch[i] = history.stretch[slot]
    returns.motion[i] = history.motion[slot, mark]
    for k in range(3):
        returns.came[i, k] = history.came[slot, k]
        returns.pace[i, k] = history.pace[slot, k]
        returns.shift[i, k] = history.shift[slot, mark, k]
        returns.offset[0, i, k] = history.offset[slot, mark, k]
        returns.offset[1, i, k] = seen.local[row, k] - track.local[i, k]
        track.expected[i, k] = np.nan


@labelling_jit
def present_cost(prototype: Prototype, track: HandTrack, i: int, seen: PalmPoints, row: int,
                 matrix: np.ndarray, gradient: np.ndarray, same: bool, step: float) -> float:
    """Return the cost of a reappeared marker's point, by its place and its motion since.

    Parameters
    ----------
    prototype : Prototype
    track : HandTrack
        Of the last frame; its evidence on the marker's return is updated.
    i : int
        Of the marker.
    seen : PalmPoints
    row : int
        Of its point.
    matrix, gradient
        As for `posture_distance`.
    same : bool
        Whether the same markers are seen as in the last frame.
    step : float
        Time since the last frame [s].
    """
    returns, local, points = track.returns, seen.local, seen.cloud.points
    returns.age[i] += step
    returns.stretch[i] += step
    covariance = local_floats((3, 3))
    a = 3 * i
    block_inverse(matrix[a:a + 3, a:a + 3], 1., covariance)
    off, unlike, shift, turned, gone = 0., 0., 0., 0., 0.
    share = returns.stretch[i] / STRETCH
    track.spread[i] = (covariance[0, 0] + covariance[1, 1] + covariance[2, 2]) / 3.
    for k in range(3):
        expected = local[row, k]
        for n in range(3):
            expected -= covariance[k, n] * gradient[a + n]
        before = track.expected[i, k]
        returns.offset[1, i, k] += local[row, k] - track.local[i, k] + track.drift[i, k] * step
        if same and before == before:
            returns.offset[1, i, k] -= expected - before
        track.expected[i, k] = expected
        off += returns.offset[1, i, k] ** 2
        unlike += (local[row, k] - expected) ** 2
        change = returns.offset[1, i, k] - returns.offset[0, i, k]
        shift += change * change
        turned += (change - share * returns.shift[i, k]) ** 2
        gone += uneven(points[row, k] - returns.came[i, k], returns.pace[i, k],
                       returns.stretch[i])
    motion = returns.motion[i] + motion_cost(
        returns.stretch[i], track.error[i], gone, min(shift, turned),
        returns.pace[i, 0] == returns.pace[i, 0])
    if returns.stretch[i] >= STRETCH:
        returns.motion[i] = MOTION_MEMORY * motion
        for k in range(3):
            returns.pace[i, k] = (points[row, k] - returns.came[i, k]) / returns.stretch[i]
            returns.came[i, k] = points[row, k]
            returns.shift[i, k] = returns.offset[1, i, k] - returns.offset[0, i, k]
            returns.offset[0, i, k] = returns.offset[1, i, k]
        returns.stretch[i] = 0.
    cost = SEEN_COST + RETURN_COST + place_cost(
        off, _hidden_variance(track.error[i], returns.hidden_for[i]), unlike, track.spread[i])
    return (max(cost, returns.cost[i]) + motion + marker_links_cost(
        prototype, track.local, track.hidden_for, i, local[row])
        - persistence_cost(returns.age[i], returns.hidden_for[i]))


@labelling_jit
def best_return(prototype: Prototype, track: HandTrack, i: int, seen: PalmPoints) -> float:
    """Return the least cost of an unassigned point as the reappeared marker."""
    least, history, hidden = math.inf, seen.history, hidden_place(track, i)
    for j in range(len(seen.cloud.points)):
        slot = seen.cloud.slots[j]
        if not history.taken[slot] and history.cost[slot, seen.first + i] < math.inf:
            least = min(least, return_cost(
                hidden, seen, j, seen.first + i) + marker_links_cost(
                prototype, track.local, track.hidden_for, i, seen.local[j]))
    return least


@labelling_jit
def give_up(track: HandTrack, i: int, seen: PalmPoints, row: int) -> None:
    """Undo a marker's return: it is hidden again, and its point counts as clutter."""
    returns, history, mark = track.returns, seen.history, seen.first + i
    slot = seen.cloud.slots[row]
    track.finding.rows[i] = -1
    track.hidden_for[i] = returns.hidden_for[i]
    track.suspected_for[i] = 0.
    history.age[slot] = returns.age[i]
    history.stretch[slot] = returns.stretch[i]
    history.motion[slot, mark] = returns.motion[i]
    history.cost[slot, :] = math.inf
    history.cost[slot, mark] = returns.cost[i]
    for k in range(3):
        history.came[slot, k] = returns.came[i, k]
        history.pace[slot, k] = returns.pace[i, k]
        history.shift[slot, mark, k] = returns.shift[i, k]
        history.offset[slot, mark, k] = returns.offset[0, i, k]
        track.local[i, k] -= returns.offset[1, i, k]
        track.drift[i, k] = 0.
        track.expected[i, k] = np.nan
    returns.age[i] = math.inf
