"""Which measurement is which marker: outliers and ghosts refused, swapped labels put right.

The palm is rigid, so its three markers are judged by their distances from each other,
whatever the hand as a whole does; the digits' markers are judged in the palm's frame, by what
is expected of them there and by their reach. Labels are right until another reading of
the frame is clearly better: a reading says which row belongs to which marker. A reading that
is held against the labels given has to go on being more like a hand than they are.
"""

import itertools
import math
from typing import NamedTuple

import numpy as np

from ..inverse_kinematics.palm import rigid_palm
from ..model.states import REJECTED, SEEN, SWAPPED
from ..numerics.jit import jit
from ..numerics.vectors import clamp, components, distance, scale, store, subtract, vector
from ..occlusion.palm_markers import complete_palm
from .plausibility import (
    DISORDER_COST,
    EXCHANGE_MARGIN,
    EXCHANGES,
    ORDER_TOLERANCE,
    TypicalPlaces,
    apply_exchange,
    correct_exchange,
    find_exchange,
    label_cost,
    spans_plane,
)
from .validity import COORDINATE_LIMIT

ACCEPTED = SEEN

# Within a step a marker may stray from even motion by BASE + BEND step² / 2: captured hands do by
# 14 mm at 120 Hz (ManipNet, with the jumps of the capture), a simulated pianist by 35 at 30 Hz.
DIGIT_BASE, DIGIT_BEND = .012, 120.  # [m], [m/s²] in the palm's frame
# Ours, for a hand that is shaken; captured are 22 mm at 120 Hz (ManipNet).
PALM_BASE, PALM_BEND = .015, 100.   # [m], [m/s²] in the surroundings
LONGEST = .1                        # [s] a longer step bends no farther
NOISE = .001                        # [m] least error of what is expected; ours

# Skin over the knuckles: distances of palm markers stray by 3 mm, not by 15 (ours; a camera
# estimate, dexret, has 5.6 mm standard deviation and at most 18).
SIDE_SPREAD, SIDE_GATE = .003, .015  # [m]
SIDE_MEMORY = 1.                     # [s] over which they are learned; ours
OTHER_ORDER = .006   # [m] by which exchanged palm markers fit better what was before; ours
UNLIKE = .5                          # of a side: no palm of a hand that nobody calibrated; ours

REACH_GATE, REACH_BASE = 1.6, .012   # [1], [m] of a hand that nobody calibrated; ours
REACH_SPREAD = .005                  # [m]
DROPPED = 1.2    # [1] times the cost of the gate: refusing a marker costs more than a far one
RELABELLED = 1.  # cost of each marker that takes another's label; ours
TAKEN_OVER = .01   # [m] how near a label must lie that is given to a marker thought hidden; ours
DRIFT, STRAY = 6., .006  # [m/s], [m] of a refused place that is the same; ours
WANDER = .05     # [m/s] by which a hidden digit may stray; 5 times that is twice ManipNet's p95
FOUND = .012     # [s] in which it is forgotten that a marker was not seen; ours
ROLL = .15       # [m/s] by which a palm carried by two markers turns away unseen; ours
ROLL_MOST = .03  # [m]
SETTLING = 4.    # by how much faster that is forgotten when the palm is whole; ours
TRIED = 2.       # [s] over which labels prove themselves more like a hand than others; ours
WITNESSES = 2    # digits in place that vouch for a palm which moved farther than hands do; ours
RIGID = 3.       # cost of a palm that is as rigid as any, in variances; ours
READINGS = 16    # of the palm that are looked into: bounds the time
UNFIT = 1e6      # cost of a label for a row that does not fit it
IMPOSSIBLE = 1e9

PERMUTATIONS = np.array(sorted(
    itertools.permutations(range(5)), key=lambda p: sum(i != j for i, j in enumerate(p))))
TRIPLES = np.array(sorted(
    itertools.permutations(range(8), 3), key=lambda p: sum(i != j for i, j in enumerate(p))))
KEPT = np.array(sorted(
    itertools.product((True, False), repeat=3), key=lambda k: -sum(k)))


class HandBounds(NamedTuple):
    """What the hand allows its markers, in the coordinates of a right hand.

    Attributes
    ----------
    roots : ndarray, shape (5, 3)
        First joints of the digits in the wrist's frame [m].
    reach : ndarray, shape (5,)
        Greatest distance of each digit's marker from its root [m].
    usual : Usual
    """

    roots: np.ndarray
    reach: np.ndarray
    usual: TypicalPlaces


class Reading(NamedTuple):
    """What the readings of a frame are judged by.

    Attributes
    ----------
    markers, expected : ndarray, shape (8, 3)
        As for `identify` [m].
    seen, sure : ndarray of bool, shape (8,)
        Rows that are seen, and markers of which it is known where they are expected.
    home : ndarray, shape (8, 3)
        Where markers are expected, in the palm's frame [m].
    sigma, limit : ndarray, shape (8,)
        Standard deviation of that, and the farthest from it that is believed [m].
    gaps : ndarray, shape (8, 8)
        Distances of the rows; infinite of those not seen [m].
    sides : ndarray, shape (3,)
        Of `Memory` [m].
    gated : ndarray of bool, shape (1,)
        Whether anything is refused.
    """

    markers: np.ndarray
    expected: np.ndarray
    seen: np.ndarray
    sure: np.ndarray
    home: np.ndarray
    sigma: np.ndarray
    limit: np.ndarray
    gaps: np.ndarray
    sides: np.ndarray
    gated: np.ndarray


class Memory(NamedTuple):
    """What is kept from frame to frame.

    Attributes
    ----------
    waited : ndarray, shape (8,)
        For how long each marker has been refused in one place [s].
    place : ndarray, shape (8, 3)
        Where it was refused last, in the palm's frame [m].
    sides : ndarray, shape (3,)
        Learned distances of palm markers r p, p q and q r; 0 before the first [m].
    doubt : ndarray, shape (1,)
        For how long another labelling has been more like a hand than the one held [s].
    rival : ndarray of int, shape (1,)
        Which of `EXCHANGES` that is, of labels as given.
    ahead : ndarray, shape (28,)
        By how much more the labelling held has been like a hand than each of its `EXCHANGES`,
        in the mean over `TRIED`, in variances.
    carried : ndarray, shape (1,)
        For how long the palm has not been whole [s].
    unseen : ndarray, shape (8,)
        For how long nothing was seen of each marker; forgotten within `FOUND` [s].
    reading : Reading
        Of one frame.
    """

    waited: np.ndarray
    place: np.ndarray
    sides: np.ndarray
    doubt: np.ndarray
    rival: np.ndarray
    ahead: np.ndarray
    carried: np.ndarray
    unseen: np.ndarray
    reading: Reading


def blank_memory():
    """Return the memory before the first frame."""
    return Memory(waited=np.zeros(8), place=np.zeros((8, 3)), sides=np.zeros(3),
                  doubt=np.zeros(1), rival=np.zeros(1, dtype=np.int64),
                  ahead=np.zeros(len(EXCHANGES)), carried=np.zeros(1), unseen=np.zeros(8),
                  reading=Reading(
                      markers=np.zeros((8, 3)), expected=np.zeros((8, 3)),
                      seen=np.zeros(8, dtype=bool), sure=np.zeros(8, dtype=bool),
                      home=np.zeros((8, 3)), sigma=np.ones(8), limit=np.ones(8),
                      gaps=np.zeros((8, 8)), sides=np.zeros(3),
                      gated=np.zeros(1, dtype=bool)))


def hand_bounds(chains, usual):
    """Return what a hand allows its markers.

    Parameters
    ----------
    chains : Chains
    usual : Usual
        Of the same hand.

    Returns
    -------
    HandBounds
    """
    counted = np.arange(3) < chains.hinges[:, None]
    reach = np.hypot((chains.bones * counted).sum(axis=1), chains.lateral)
    return HandBounds(chains.root.copy(), reach, usual)


@jit
def identify(markers, seen, expected, spread, known, step, bounds, memory, gate, margin,
             patience, verdict):
    """Give each measurement to its marker, and refuse those that are none.

    Parameters
    ----------
    markers : ndarray, shape (8, 3)
        Measurements by their labels, put in order [m].
    seen : ndarray of bool, shape (8,)
        Put in order too; cleared where refused.
    expected : ndarray, shape (8, 3)
        Where each marker is predicted [m].
    spread : ndarray, shape (8,)
        Standard deviation of the prediction [m].
    known : ndarray of bool, shape (8,)
        Whether there is a prediction; without all three of the palm none counts.
    step : float
        Since the previous frame [s].
    bounds : HandBounds
    memory : Memory
        Replaced.
    gate : float
        Of a measurement, in standard deviations; what a hand can do between two frames
        is never refused. 0 refuses nothing.
    margin : float
        Labels are exchanged when that fits this many times better; 0 exchanges none.
    patience : float
        After how long what is refused in one place is believed, 0 is never [s].
    verdict : ndarray of int, shape (8,)
        ACCEPTED, REJECTED or SWAPPED of each marker, replaced.
    """
    verdict[:] = ACCEPTED
    if gate <= 0.0 and margin <= 0.0:
        return
    reading, template = memory.reading, bounds.usual.template
    _measure(reading, markers, seen, memory.sides, gate > 0.0)
    slipped = False
    for i in range(3):
        slipped = slipped or memory.waited[i] >= patience
    # What persists and makes no palm is still none.
    slipped = slipped and not _in_another_order(reading.gaps, memory.sides) and (
        _like_before(reading.gaps, memory.sides) or _like_hand(reading.gaps, template))
    anew = patience > 0.0 and (slipped or memory.doubt[0] >= patience)
    rows = np.arange(8)
    if anew or not _expect(reading, expected, spread, known):
        if margin > 0.0:
            correct_exchange(reading.markers, reading.seen, bounds.usual, rows)
        _begin(reading, bounds, memory, rows, verdict)
        _put_in_order(reading, rows, markers, seen, verdict)
        return

    _settle_limits(reading, memory, spread, template, step, gate)
    costs = np.zeros(8)
    local = np.zeros((8, 3))
    kept = (seen[0], seen[1], seen[2])
    total = _read(reading, bounds, kept, 0.0, np.inf, rows, costs, local)
    if total >= IMPOSSIBLE or not _as_expected(reading, bounds, local):
        total, kept = _best_reading(reading, bounds, margin, total, rows, costs, local)
    if total >= IMPOSSIBLE:
        # Nothing fits: whoever places the palm says what is wrong with it.
        for i in range(8):
            memory.waited[i] = 0.0
        return
    _conclude(reading, bounds, kept, rows, local, memory, step, patience, verdict)
    if margin > 0.0:
        _doubt(reading, bounds, memory, rows, step)
    _put_in_order(reading, rows, markers, seen, verdict)


@jit
def _put_in_order(reading, rows, markers, seen, verdict):
    """Write measurements by their markers."""
    for i in range(8):
        store(markers, i, vector(reading.markers[rows[i]]))
        seen[i] = reading.seen[rows[i]] and verdict[i] != REJECTED


@jit
def _begin(reading, bounds, memory, rows, verdict):
    """Believe the frame as it is read, and remember it."""
    memory.doubt[0] = 0.0
    memory.ahead[:] = 0.0
    for i in range(8):
        memory.waited[i] = 0.0
        if rows[i] != i and reading.seen[rows[i]]:
            verdict[i] = SWAPPED
    gaps = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            gaps[i, j] = reading.gaps[rows[i], rows[j]]
    plausible = _like_hand(gaps, bounds.usual.template)
    for i in range(3):
        memory.sides[i] = gaps[i, (i + 1) % 3] if plausible else 0.0


@jit
def _measure(reading, markers, seen, sides, gated):
    """Take a frame into the reading."""
    reading.gated[0] = gated
    for i in range(3):
        reading.sides[i] = sides[i]
    for i in range(8):
        reading.seen[i] = seen[i]
        store(reading.markers, i, vector(markers[i]))
        for j in range(i + 1):
            gap = math.inf
            if i != j and seen[i] and seen[j]:
                gap = distance(vector(markers[i]), vector(markers[j]))
            reading.gaps[i, j] = gap
            reading.gaps[j, i] = gap


@jit
def _expect(reading, expected, spread, known):
    """Take what is expected into the reading; return whether that places the palm."""
    for i in range(8):
        sure = known[i] and abs(spread[i]) <= COORDINATE_LIMIT
        for k in range(3):
            sure = sure and abs(expected[i, k]) <= COORDINATE_LIMIT
        reading.sure[i] = sure
        store(reading.expected, i, vector(expected[i]))
    return (reading.sure[0] and reading.sure[1] and reading.sure[2]
            and spans_plane(vector(expected[0]), vector(expected[1]), vector(expected[2])))


@jit
def _settle_limits(reading, memory, spread, template, step, gate):
    """Find where markers are expected in the palm's frame, and how far off they may be."""
    time = clamp(step, 0.0, LONGEST)
    expected, seen = reading.expected, reading.seen
    axes, origin = _fit(expected, template)
    roll = 0.0
    if seen[0] and seen[1] and seen[2]:
        roll = min(ROLL * memory.carried[0], ROLL_MOST)
    for i in range(8):
        sigma = 1.0
        limit = 1.0
        home = (0.0, 0.0, 0.0)
        if reading.sure[i]:
            home = components(axes, subtract(vector(expected[i]), origin))
            strayed = roll + WANDER * memory.unseen[i] if i >= 3 else 0.0
            sigma = math.sqrt(spread[i] * spread[i] + NOISE * NOISE + strayed * strayed)
            base, bend = (PALM_BASE, PALM_BEND) if i < 3 else (DIGIT_BASE, DIGIT_BEND)
            limit = max(abs(gate) * sigma, base + 0.5 * bend * time * time)
        store(reading.home, i, home)
        reading.sigma[i] = sigma
        reading.limit[i] = limit


@jit
def _fit(points, template):
    return rigid_palm(vector(points[0]), vector(points[1]), vector(points[2]),
                      vector(template[0]), vector(template[1]), vector(template[2]))


@jit
def _rigid_cost(gaps, sides, rows, kept):
    """Return what the distances of the kept palm markers cost; IMPOSSIBLE beyond their gate."""
    cost = 0.0
    for i in range(3):
        j = (i + 1) % 3
        if kept[i] and kept[j] and sides[i] > 0.0:
            off = abs(gaps[rows[i], rows[j]] - sides[i])
            cost += (off / SIDE_SPREAD) ** 2 if off <= SIDE_GATE else IMPOSSIBLE
    return cost


@jit
def _like_before(gaps, sides):
    """Return whether the palm as labelled resembles that of before."""
    like = sides[0] > 0.0
    for i in range(3):
        # False for the infinite gaps of hidden markers
        like = like and abs(gaps[i, (i + 1) % 3] - sides[i]) <= UNLIKE * sides[i]
    return like


@jit
def _in_another_order(gaps, sides):
    """Return whether the palm's labels exchanged would fit better what it was before."""
    least = math.inf
    given = math.inf
    for a in range(3):
        for b in range(3):
            if a != b:
                c = 3 - a - b
                off = (abs(gaps[a, b] - sides[0]) + abs(gaps[b, c] - sides[1])
                       + abs(gaps[c, a] - sides[2]))
                least = min(least, off)
                if a == 0 and b == 1:
                    given = off
    return least < given - OTHER_ORDER


@jit
def _like_hand(gaps, template):
    """Return whether the palm as labelled resembles that of the hand."""
    like = True
    for i in range(3):
        j = (i + 1) % 3
        side = distance(vector(template[i]), vector(template[j]))
        like = like and abs(gaps[i, j] - side) <= UNLIKE * side
    return like


@jit
def _read(reading, bounds, kept, margin, bar, rows, costs, local):
    """Read a frame: place the palm by some rows, give the rest to the digits.

    Parameters
    ----------
    reading : Reading
    bounds : HandBounds
    kept : tuple of three bool
        Which palm markers place the palm.
    margin : float
        Above 0 digits may exchange their rows.
    bar : float
        Of no interest is a reading that costs as much.
    rows : ndarray of int, shape (8,)
        Row of each marker; those of the digits are replaced when they may be exchanged.
    costs : ndarray, shape (8,)
        What each marker costs, in variances, replaced.
    local : ndarray, shape (8, 3)
        All rows that are seen, in the palm's frame, replaced [m].

    Returns
    -------
    float
        What the reading costs; IMPOSSIBLE or more when the palm is not rigid in it, or
        the palm alone reaches the bar.
    """
    markers, seen, expected = reading.markers, reading.seen, reading.expected
    sigma, limit, gaps, sides = reading.sigma, reading.limit, reading.gaps, reading.sides
    total = _rigid_cost(gaps, sides, rows, kept)
    if total >= IMPOSSIBLE:
        return total
    r = vector(markers[rows[0]])
    p = vector(markers[rows[1]])
    q = vector(markers[rows[2]])
    if not (kept[0] and kept[1] and kept[2]):
        before = (vector(expected[0]), vector(expected[1]), vector(expected[2]))
        if kept[0] or kept[1] or kept[2]:
            r, p, q = complete_palm((r, p, q), before, kept)
        else:
            r, p, q = before
    if not spans_plane(r, p, q):
        return IMPOSSIBLE
    template = bounds.usual.template
    axes, origin = rigid_palm(
        r, p, q, vector(template[0]), vector(template[1]), vector(template[2]))
    for i in range(8):
        if seen[i]:
            store(local, i, components(axes, subtract(vector(markers[i]), origin)))
    for i in range(3):
        cost = 0.0
        if seen[rows[i]]:
            most = (limit[i] / sigma[i]) ** 2
            cost = DROPPED * most
            if kept[i]:
                off = distance(vector(markers[rows[i]]), vector(expected[i]))
                cost = min((off / sigma[i]) ** 2, most)
        costs[i] = cost
        total += cost + (RELABELLED if rows[i] != i else 0.0)

    if total >= bar:
        return IMPOSSIBLE
    size = _size(gaps, sides, template, rows, kept)
    table = np.empty((5, 5))
    for i in range(5):
        for j in range(5):
            table[i, j] = _digit_cost(reading, bounds, local, i, rows[3 + j], size)
    crossed = np.zeros((5, 5))
    for i in range(5):
        for j in range(5):
            if seen[rows[3 + i]] and seen[rows[3 + j]] and (
                    local[rows[3 + i], 1] < local[rows[3 + j], 1] - ORDER_TOLERANCE):
                crossed[i, j] = DISORDER_COST
    best = 0
    least = np.inf
    for n in range(len(PERMUTATIONS) if margin > 0.0 else 1):
        cost = 0.0
        for i in range(5):
            j = PERMUTATIONS[n, i]
            cost += table[i, j] + (RELABELLED if rows[3 + j] != 3 + i else 0.0)
        for i in range(3):
            cost += crossed[PERMUTATIONS[n, i], PERMUTATIONS[n, i + 1]]
        if cost < least:
            least = cost
            best = n
    given = np.empty(5, dtype=np.int64)
    for i in range(5):
        given[i] = rows[3 + i]
    for i in range(5):
        rows[3 + i] = given[PERMUTATIONS[best, i]]
        costs[3 + i] = table[i, PERMUTATIONS[best, i]]
    for i in range(3):
        cost = 0.5 * crossed[PERMUTATIONS[best, i], PERMUTATIONS[best, i + 1]]
        costs[3 + i] += cost
        costs[4 + i] += cost
    return total + least


@jit
def _size(gaps, sides, template, rows, kept):
    """Return the palm's size, as a share of the template's."""
    around = 0.0
    rest = 0.0
    for i in range(3):
        j = (i + 1) % 3
        rest += distance(vector(template[i]), vector(template[j]))
        if sides[i] > 0.0:
            around += sides[i]
        elif kept[i] and kept[j]:
            around += gaps[rows[i], rows[j]]
        else:
            return 1.0
    return around / rest


@jit
def _beyond(bounds, place, digit, size):
    """Return by how much a place in the palm's frame is out of a digit's reach [m]."""
    root = scale(vector(bounds.roots[digit]), size)
    return distance(place, root) - REACH_GATE * size * bounds.reach[digit] - REACH_BASE


@jit
def _digit_cost(reading, bounds, local, digit, row, size):
    """Return what it costs that a row is a digit's marker, in variances."""
    seen, sure, home = reading.seen, reading.sure, reading.home
    sigma, limit = reading.sigma, reading.limit
    label = 3 + digit
    most = (limit[label] / sigma[label]) ** 2 if sure[label] else (
        REACH_BASE / REACH_SPREAD) ** 2
    if not seen[row]:
        # A marker does not give its row away and vanish, unless the row was wrong anyway.
        if row != label and seen[label] and sure[label] and distance(
                vector(local[label]), vector(home[label])) <= limit[label]:
            return DROPPED * most
        return 0.0
    place = vector(local[row])
    beyond = _beyond(bounds, place, digit, size)
    if not sure[label]:
        return min((beyond / REACH_SPREAD) ** 2, most) if beyond > 0.0 else 0.0
    off = distance(place, vector(home[label]))
    farthest = limit[label]
    if row != label and not seen[label]:
        farthest = min(farthest, TAKEN_OVER)
    if beyond <= 0.0 and off <= farthest:
        return (off / sigma[label]) ** 2
    # Labels are exchanged for what fits, not to get rid of an outlier.
    return most if row == label else UNFIT


@jit
def _as_expected(reading, bounds, local):
    """Return whether every label is right beyond doubt: nearer to its own than to any other."""
    markers, seen, expected = reading.markers, reading.seen, reading.expected
    sure, home, limit = reading.sure, reading.home, reading.limit
    size = _size(reading.gaps, reading.sides, bounds.usual.template, np.arange(8),
                 (seen[0] > 0, seen[1] > 0, seen[2] > 0))
    witnesses = 0
    for i in range(3, 8):
        if not seen[i]:
            continue
        place = vector(local[i])
        if _beyond(bounds, place, i - 3, size) > 0.0:
            return False
        if not sure[i]:
            continue
        off = distance(place, vector(home[i]))
        if off > limit[i]:
            return False
        for j in range(8):
            if j != i and sure[j] and 2.0 * off > distance(vector(home[i]), vector(home[j])):
                return False
        witnesses += 1
    if witnesses < WITNESSES or not (seen[0] and seen[1] and seen[2]):
        for i in range(3):
            if seen[i] and distance(vector(markers[i]), vector(expected[i])) > 0.5 * limit[i]:
                return False
    return True


@jit
def _best_reading(reading, bounds, margin, total, rows, costs, local):
    """Choose the reading of a frame in which not all is as expected.

    Parameters
    ----------
    reading, bounds, rows, costs, local
        As for `_read`; those of the labels as given come in, those chosen go out.
    margin : float
        As for `identify`.
    total : float
        What the labels as given cost.

    Returns
    -------
    total : float
        What the reading costs.
    kept : tuple of three bool
        Which palm markers place the palm.
    """
    seen = reading.seen
    # Labels as given, with palm markers refused
    kept = (seen[0] > 0, seen[1] > 0, seen[2] > 0)
    whole = (KEPT[0, 0], KEPT[0, 1], KEPT[0, 2])
    if reading.gated[0]:
        trial = np.arange(8)
        trial_costs = np.zeros(8)
        for n in range(1, len(KEPT)):
            some = (KEPT[n, 0], KEPT[n, 1], KEPT[n, 2])
            if not ((seen[0] or not some[0]) and (seen[1] or not some[1])
                    and (seen[2] or not some[2])):
                continue
            cost = _read(reading, bounds, some, 0.0, total, trial, trial_costs, local)
            if cost < total:
                total = cost
                kept = some
                for i in range(8):
                    costs[i] = trial_costs[i]
    chosen = kept
    if margin > 0.0:
        found = np.full((2, 8), -1)
        found_costs = np.zeros((2, 8))
        least = np.inf
        # The digits exchange their rows
        if total < IMPOSSIBLE:
            for i in range(8):
                found[0, i] = rows[i]
            least = _read(
                reading, bounds, kept, margin, np.inf, found[0], found_costs[0], local)
        # The palm's rows are others: only where they make a rigid palm
        count = 0
        triple = np.empty(3, dtype=np.int64)
        for n in range(2 * len(TRIPLES)):
            for i in range(3):
                triple[i] = TRIPLES[n % len(TRIPLES), i]
            own = triple[0] == 0 and triple[1] == 1 and triple[2] == 2
            if own or not (seen[triple[0]] and seen[triple[1]] and seen[triple[2]]):
                continue
            rigid = _rigid_cost(reading.gaps, reading.sides, triple, whole)
            # The better ones come first, should they be too many.
            if rigid >= IMPOSSIBLE or (rigid < RIGID) != (n < len(TRIPLES)):
                continue
            _rest(triple, found[1])
            cost = _read(reading, bounds, whole, margin, least, found[1], found_costs[1], local)
            count += 1 if cost < IMPOSSIBLE else 0
            if cost < least:
                least = cost
                chosen = whole
                for i in range(8):
                    found[0, i] = found[1, i]
                    found_costs[0, i] = found_costs[1, i]
            if count == READINGS:
                break
        if least < total and _clearly(rows, costs, found[0], found_costs[0],
                                      total >= IMPOSSIBLE, margin):
            for i in range(8):
                rows[i] = found[0, i]
                costs[i] = found_costs[0, i]
        else:
            chosen = kept
    # The palm's frame of the last reading tried is another.
    return _read(reading, bounds, chosen, 0.0, np.inf, rows, costs, local), chosen


@jit
def _rest(triple, rows):
    """Give the palm the rows of `triple`, and the digits their own, or those left."""
    used = np.zeros(8, dtype=np.bool_)
    for i in range(3):
        rows[i] = triple[i]
        used[triple[i]] = True
    for i in range(3, 8):
        rows[i] = -1
        if not used[i]:
            rows[i] = i
            used[i] = True
    free = 0
    for i in range(3, 8):
        if rows[i] < 0:
            while used[free]:
                free += 1
            rows[i] = free
            used[free] = True


@jit
def _clearly(rows, costs, other_rows, other_costs, impossible, margin):
    """Return whether another reading is better by the margin, in what differs."""
    if impossible:
        return True
    given = 0.0
    other = 0.0
    moved = 0
    for i in range(8):
        common = 0.0
        if rows[i] == other_rows[i]:
            common = min(costs[i], other_costs[i])
        else:
            moved += 1
        given += costs[i] - common
        other += other_costs[i] - common
    return moved > 0 and (other + moved) * margin * margin <= given + moved


@jit
def _conclude(reading, bounds, kept, rows, local, memory, step, patience, verdict):
    """Refuse what is beyond its gate, and remember."""
    seen, sure, home, limit = reading.seen, reading.sure, reading.home, reading.limit
    gaps, sides = reading.gaps, memory.sides
    size = _size(gaps, sides, bounds.usual.template, rows, kept)
    if kept[0] and kept[1] and kept[2]:
        share = min(max(step, 0.0) / SIDE_MEMORY, 1.0)
        for i in range(3):
            gap = gaps[rows[i], rows[(i + 1) % 3]]
            sides[i] += (share if sides[i] > 0.0 else 1.0) * (gap - sides[i])
        memory.carried[0] = max(memory.carried[0] - SETTLING * max(step, 0.0), 0.0)
    else:
        memory.carried[0] = min(memory.carried[0] + max(step, 0.0), ROLL_MOST / ROLL)

    believed = not _most_astray(reading, rows, local)
    for i in range(8):
        row = rows[i]
        if not seen[row]:
            memory.unseen[i] += max(step, 0.0)
            continue
        if row != i:
            verdict[i] = SWAPPED
        reachable = i < 3 or _beyond(bounds, vector(local[row]), i - 3, size) <= 0.0
        wrong = not reachable
        if i < 3:
            wrong = not kept[i]
        elif sure[i] and believed:
            wrong = wrong or distance(vector(local[row]), vector(home[i])) > limit[i]
        if not (wrong and reading.gated[0]):
            memory.waited[i] = 0.0
            memory.unseen[i] *= math.exp(-max(step, 0.0) / FOUND)
            continue
        moved = distance(vector(local[row]), vector(memory.place[i]))
        if memory.waited[i] > 0.0 and not moved <= STRAY + DRIFT * step:
            memory.waited[i] = 0.0
        memory.waited[i] += max(step, 0.0)
        store(memory.place, i, vector(local[row]))
        if i >= 3 and reachable and 0.0 < patience <= memory.waited[i]:
            memory.waited[i] = 0.0
            memory.unseen[i] *= math.exp(-max(step, 0.0) / FOUND)
            continue
        verdict[i] = REJECTED


@jit
def _doubt(reading, bounds, memory, rows, step):
    """Note for how long another labelling has been more like a hand than the one held.

    The rival of exchanged labels are those given, which need not be better now, if the ones
    held were not so before; the rivals of labels as given are their exchanges, one after the
    other, which have to be so clearly.
    """
    seen, ahead = reading.seen, memory.ahead
    rival = np.arange(8)
    own = True
    for i in range(8):
        own = own and (rows[i] == i or not seen[rows[i]])
    n = memory.rival[0] if own else find_exchange(rows)
    if own:
        apply_exchange(rival, n)
    held = label_cost(reading.markers, seen, rows, bounds.usual)
    better = held - label_cost(reading.markers, seen, rival, bounds.usual)
    if not abs(better) < math.inf:
        return
    if n >= 0:
        # Rivals of labels as given have their turn one frame in so many.
        share = step * (len(EXCHANGES) if own and memory.doubt[0] == 0.0 else 1) / TRIED
        tried = seen[EXCHANGES[n, 0]] and seen[EXCHANGES[n, 1]]
        ahead[n] -= clamp(share, 0.0, 1.0) * ((better if tried else 0.0) + ahead[n])
    if better >= EXCHANGE_MARGIN if own else better >= 0.0 and (n < 0 or ahead[n] <= 0.0):
        memory.doubt[0] += max(step, 0.0)
    else:
        memory.doubt[0] = max(memory.doubt[0] - max(step, 0.0), 0.0)
        if memory.doubt[0] == 0.0:
            memory.rival[0] = (memory.rival[0] + 1) % len(EXCHANGES)


@jit
def _most_astray(reading, rows, local):
    """Return whether most digits are beyond their gate: no fault of theirs."""
    seen, sure, home, limit = reading.seen, reading.sure, reading.home, reading.limit
    astray = 0
    for i in range(3, 8):
        if seen[rows[i]] and sure[i]:
            off = distance(vector(local[rows[i]]), vector(home[i]))
            astray += 1 if off > limit[i] else -1
    return astray > 0
