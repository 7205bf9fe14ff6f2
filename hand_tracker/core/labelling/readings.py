"""Readings: candidate labellings of one frame, their cost, and the search for the best.

A reading assigns a row of the input to each marker. The palm is rigid, so its three markers are
gated and costed by their distances from each other, independent of the hand's motion; the
digits' markers are gated and costed in the palm's frame, by their prediction and their reach.
Costs are squared deviations over variances. Ours; no source but where one is named.
"""

import itertools
import math
from typing import NamedTuple

import numpy as np

from ..model.palm_triangle import complete_palm, rigid_palm
from ..numerics.assignment import number_rows
from ..numerics.jit import jit
from ..numerics.stack_memory import local_flags, local_floats, local_integers
from ..numerics.vectors import (
    Vector,
    clamp,
    components,
    distance,
    scale,
    spans_plane,
    store,
    subtract,
    vector,
)
from .plausibility import DISORDER_COST, ORDER_TOLERANCE, TypicalPlaces
from .validity import COORDINATE_LIMIT

# Gates never refuse what a hand can do in a step: BASE + BEND step² / 2 off its even motion.
# Captured hands do 14 mm at 120 Hz (ManipNet, with the jumps of the capture), a simulated
# pianist 35 mm at 30 Hz.
DIGIT_GATE_BASE = .012       # [m] in the palm's frame
DIGIT_GATE_BEND = 120.       # [m/s²]
# Palm markers in the input's frame; ours. A hand that jumps farther as a whole (captured ones do
# 22 mm at 120 Hz, ManipNet) has its digits in place on its palm: see `is_as_expected`.
PALM_GATE_BASE = .01         # [m]
PALM_GATE_BEND = 100.        # [m/s²]
MAX_BEND_TIME = .1           # [s] a longer step widens the gates no further
MIN_PREDICTION_ERROR = .001  # [m]

# Skin over the knuckles: distances of palm markers vary by 3 mm, not by 15 (ours; a camera
# estimate, dexret, has 5.6 mm standard deviation and at most 18).
SIDE_DEVIATION = .003        # [m]
SIDE_GATE = .015             # [m]

# Reach of a digit on a hand that nobody calibrated.
REACH_FACTOR = 1.6           # [1] of the reach by the model
REACH_MARGIN = .012          # [m] beyond that
REACH_DEVIATION = .005       # [m]

REFUSAL_FACTOR = 1.2         # [1] cost of refusing a marker over that at its gate
RELABELLING_COST = 1.        # of each marker that takes another's row
# From its prediction, for a row given to a hidden marker of a digit, and of the palm [m]
TAKEOVER_DISTANCE, PALM_TAKEOVER_DISTANCE = .01, .03
HIDDEN_STRAY_SPEED = .05     # [m/s] of a hidden digit; 5 times that is twice ManipNet's p95
HIDDEN_STRAY_SHARE = .3      # [1] of a hidden digit's own speed, where that is more
RETURN_DEVIATIONS = 3.       # [1] of a side, by which a palm marker that comes back may differ
ROLL_SPEED = .15             # [m/s] of digits, as a palm carried by two markers rolls unseen
MAX_ROLL = .03               # [m]
MIN_WITNESSES = 2            # digits in place that confirm a palm beyond half its gate
RIGID_COST = 3.              # of the sides: readings of the palm below it are tried first
MAX_PALM_READINGS = 16       # that are costed in full: bounds the time
UNFIT_COST = 1e6             # of a row beyond the gate of a marker it is not labelled as
IMPOSSIBLE = 1e9             # cost of a reading that is no hand

DIGIT_PERMUTATIONS = np.array(sorted(
    itertools.permutations(range(5)), key=lambda p: sum(i != j for i, j in enumerate(p))))
PALM_TRIPLES = np.array(sorted(
    itertools.permutations(range(8), 3), key=lambda p: sum(i != j for i, j in enumerate(p))))
PALM_SUBSETS = np.array(sorted(
    itertools.product((True, False), repeat=3), key=lambda k: -sum(k)))

Kept = tuple[bool, bool, bool]  # which palm markers place the palm in a reading


class HandBounds(NamedTuple):
    """Places that a hand allows its markers, in the wrist's frame of a right hand.

    Attributes
    ----------
    roots : ndarray, shape (5, 3)
        First joints of the digits [m].
    reach : ndarray, shape (5,)
        Greatest distance of each digit's marker from its root [m].
    typical : TypicalPlaces
    """

    roots: np.ndarray
    reach: np.ndarray
    typical: TypicalPlaces


class ExpectedMarkers(NamedTuple):
    """Predicted markers of a frame, in the frame of the input.

    Attributes
    ----------
    position : ndarray, shape (8, 3)
        [m]
    deviation : ndarray, shape (8,)
        Standard deviation [m].
    speed : ndarray, shape (8,)
        Mean speed of late, of the digits' in the palm's frame [m/s].
    known : ndarray of bool, shape (8,)
        Whether there is a prediction.
    """

    position: np.ndarray
    deviation: np.ndarray
    speed: np.ndarray
    known: np.ndarray


class Evidence(NamedTuple):
    """Measurements and predictions of a frame: what candidate labellings are judged on.

    Attributes
    ----------
    markers : ndarray, shape (8, 3)
        Measured rows [m].
    seen : ndarray of bool, shape (8,)
        Whether each row was measured.
    expected : ndarray, shape (8, 3)
        Predicted markers [m].
    known : ndarray of bool, shape (8,)
        Whether each marker has a usable prediction.
    home : ndarray, shape (8, 3)
        Predicted markers in the palm's frame [m].
    deviation, gate : ndarray, shape (8,)
        Standard deviation of a prediction, and the greatest accepted distance from it [m].
    gaps : ndarray, shape (8, 8)
        Distances between rows; infinite if not seen [m].
    sides, side_variances : ndarray, shape (3,)
        Learned distances of palm markers, and their variances (`AssociationState`) [m, m²].
    gated : ndarray of bool, shape (1,)
        Whether markers may be refused.
    last : ndarray of int, shape (8,)
        Row that each marker was last measured in; its own once it is hidden for long.
    """

    markers: np.ndarray
    seen: np.ndarray
    expected: np.ndarray
    known: np.ndarray
    home: np.ndarray
    deviation: np.ndarray
    gate: np.ndarray
    gaps: np.ndarray
    sides: np.ndarray
    side_variances: np.ndarray
    gated: np.ndarray
    last: np.ndarray


class Reading(NamedTuple):
    """Candidate labelling of a frame.

    Attributes
    ----------
    rows : ndarray of int, shape (8,)
        Row of each marker.
    costs : ndarray, shape (8,)
        Cost of each marker, in variances.
    local : ndarray, shape (8, 3)
        Seen rows in the palm's frame of this reading [m].
    """

    rows: np.ndarray
    costs: np.ndarray
    local: np.ndarray


def unknown_markers() -> ExpectedMarkers:
    """Return `ExpectedMarkers` before the first frame: all unknown."""
    return ExpectedMarkers(np.zeros((8, 3)), np.zeros(8), np.zeros(8), np.zeros(8, dtype=bool))


def blank_evidence() -> Evidence:
    """Return `Evidence` to be filled by `record_measurements` and `expect`."""
    return Evidence(
        markers=np.zeros((8, 3)), seen=np.zeros(8, dtype=bool), expected=np.zeros((8, 3)),
        known=np.zeros(8, dtype=bool), home=np.zeros((8, 3)), deviation=np.ones(8),
        gate=np.ones(8), gaps=np.zeros((8, 8)), sides=np.zeros(3),
        side_variances=np.zeros(3), gated=np.zeros(1, dtype=bool), last=np.arange(8))


@jit
def record_measurements(evidence: Evidence, markers: np.ndarray, seen: np.ndarray,
                        sides: np.ndarray, side_variances: np.ndarray, gated: bool) -> None:
    """Write a frame's measurements and their distances into the evidence.

    Parameters
    ----------
    evidence : Evidence
        Changed.
    markers : ndarray, shape (8, 3)
        [m]
    seen : ndarray of bool, shape (8,)
    sides : ndarray, shape (3,)
        Learned lengths of the palm's sides r p, p q and q r; 0 where unknown [m].
    side_variances : ndarray, shape (3,)
        [m²]
    gated : bool
        See `Evidence`.
    """
    evidence.gated[0] = gated
    for i in range(3):
        evidence.sides[i], evidence.side_variances[i] = sides[i], side_variances[i]
    for i in range(8):
        evidence.seen[i] = seen[i]
        store(evidence.markers, i, vector(markers[i]))
        for j in range(i + 1):
            gap = math.inf
            if i != j and seen[i] and seen[j]:
                gap = distance(vector(markers[i]), vector(markers[j]))
            evidence.gaps[i, j] = gap
            evidence.gaps[j, i] = gap


@jit
def expect(evidence: Evidence, markers: ExpectedMarkers) -> bool:
    """Write a frame's predictions into the evidence; return whether they place the palm."""
    expected, spread = markers.position, markers.deviation
    for i in range(8):
        known = markers.known[i] and abs(spread[i]) <= COORDINATE_LIMIT
        for k in range(3):
            known = known and abs(expected[i, k]) <= COORDINATE_LIMIT
        evidence.known[i] = known
        store(evidence.expected, i, vector(expected[i]))
    return (evidence.known[0] and evidence.known[1] and evidence.known[2]
            and spans_plane(vector(expected[0]), vector(expected[1]), vector(expected[2])))


@jit
def set_gates(evidence: Evidence, template: np.ndarray, markers: ExpectedMarkers,
              unseen_for: np.ndarray, rolled_for: float, step: float, gate: float) -> None:
    """Write predictions in the palm's frame, their deviations and gates into the evidence.

    Parameters
    ----------
    evidence : Evidence
        Filled by `record_measurements` and `expect`; updated.
    template : ndarray, shape (3, 3)
        Palm markers in the wrist's frame [m].
    markers : ExpectedMarkers
    unseen_for : ndarray, shape (8,)
        Time for which each marker was not seen [s].
    rolled_for : float
        Time in which the palm may have rolled unseen, as it was not complete [s].
    step : float
        Time since the last frame [s].
    gate : float
        In standard deviations [1].
    """
    time = clamp(step, 0.0, MAX_BEND_TIME)
    expected, seen = evidence.expected, evidence.seen
    axes, origin = rigid_palm(
        (vector(expected[0]), vector(expected[1]), vector(expected[2])), template)
    found = roll = _found_roll(evidence, unseen_for, step)
    if seen[0] and seen[1] and seen[2]:
        roll = max(roll, min(ROLL_SPEED * rolled_for, MAX_ROLL))
    for i in range(8):
        deviation = 1.0
        limit = 1.0
        home = (0.0, 0.0, 0.0)
        if evidence.known[i]:
            home = components(axes, subtract(vector(expected[i]), origin))
            if i < 3:
                strayed = found if unseen_for[i] > step else 0.0
            else:
                strayed = roll + unseen_for[i] * max(
                    HIDDEN_STRAY_SPEED, HIDDEN_STRAY_SHARE * markers.speed[i])
            spread = markers.deviation[i]
            deviation = math.sqrt(spread * spread
                                  + MIN_PREDICTION_ERROR * MIN_PREDICTION_ERROR
                                  + strayed * strayed)
            base, bend = (PALM_GATE_BASE, PALM_GATE_BEND) if i < 3 else (
                DIGIT_GATE_BASE, DIGIT_GATE_BEND)
            limit = max(abs(gate) * deviation, base + 0.5 * bend * time * time)
        store(evidence.home, i, home)
        evidence.deviation[i] = deviation
        evidence.gate[i] = limit


@jit
def _found_roll(evidence: Evidence, unseen_for: np.ndarray, step: float) -> float:
    """Return the palm's roll while a marker was hidden: its distance from the prediction [m].

    Zero where the reappeared marker's distances from the others are not the learned ones.
    """
    seen, sides, variances = evidence.seen, evidence.sides, evidence.side_variances
    roll = 0.0
    for i in range(3):
        j = (i + 1) % 3
        if not (seen[i] and seen[j]):
            continue
        off = evidence.gaps[i, j] - sides[i]
        if not (sides[i] > 0.0 and off * off <= RETURN_DEVIATIONS ** 2 * variances[i]):
            return 0.0
        for k in (i, j):
            if unseen_for[k] > step:
                roll = max(roll, distance(
                    vector(evidence.markers[k]), vector(evidence.expected[k])))
    return roll


@jit
def cost_reading(evidence: Evidence, bounds: HandBounds, kept: Kept, relabel: bool, bar: float,
                 reading: Reading) -> float:
    """Cost a reading: place the palm by its palm rows, then assign the others to the digits.

    Parameters
    ----------
    evidence : Evidence
    bounds : HandBounds
    kept : tuple of three bool
        Palm markers that place the palm.
    relabel : bool
        Whether the digits may exchange their rows.
    bar : float
        Cost of the palm at which the digits are not looked at [1].
    reading : Reading
        Its rows are read; those of the digits are replaced if they are exchanged. Its costs
        and places are replaced.

    Returns
    -------
    float
        Cost; IMPOSSIBLE or more if the palm is not rigid, or reaches the bar alone.
    """
    markers, seen, expected = evidence.markers, evidence.seen, evidence.expected
    deviation, gate = evidence.deviation, evidence.gate
    rows, costs, local = reading.rows, reading.costs, reading.local
    total = _rigid_cost(evidence.gaps, evidence.sides, rows, kept)
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
    template = bounds.typical.template
    axes, origin = rigid_palm((r, p, q), template)
    for i in range(8):
        if seen[i]:
            store(local, i, components(axes, subtract(vector(markers[i]), origin)))
    for i in range(3):
        cost = 0.0
        if seen[rows[i]]:
            highest = (gate[i] / deviation[i]) ** 2
            cost = REFUSAL_FACTOR * highest
            if kept[i]:
                off = distance(vector(markers[rows[i]]), vector(expected[i]))
                cost = min((off / deviation[i]) ** 2, highest)
                if rows[i] != i and not seen[i] and off > PALM_TAKEOVER_DISTANCE:
                    cost = UNFIT_COST
        costs[i] = cost
        total += cost + (RELABELLING_COST if rows[i] != i else 0.0)

    if total >= bar:
        return IMPOSSIBLE
    size = palm_size(evidence.gaps, evidence.sides, template, rows, kept)
    return total + _assign_digits(evidence, bounds, relabel, size, reading)


@jit
def _assign_digits(evidence: Evidence, bounds: HandBounds, relabel: bool, size: float,
                   reading: Reading) -> float:
    """Assign the rows of a reading's digits at least cost; return that cost."""
    seen = evidence.seen
    rows, costs, local = reading.rows, reading.costs, reading.local
    table = local_floats((5, 5))
    for i in range(5):
        for j in range(5):
            if relabel or i == j:
                table[i, j] = _digit_cost(evidence, bounds, local, i, rows[3 + j], size)
    crossed = local_floats((5, 5))
    for i in range(5):
        for j in range(5):
            if (relabel or j == i + 1) and seen[rows[3 + i]] and seen[rows[3 + j]] and (
                    local[rows[3 + i], 1] < local[rows[3 + j], 1] - ORDER_TOLERANCE):
                crossed[i, j] = DISORDER_COST
    best = 0
    least = np.inf
    for n in range(len(DIGIT_PERMUTATIONS) if relabel else 1):
        cost = 0.0
        for i in range(5):
            j = DIGIT_PERMUTATIONS[n, i]
            cost += table[i, j] + (RELABELLING_COST if rows[3 + j] != 3 + i else 0.0)
        for i in range(3):
            cost += crossed[DIGIT_PERMUTATIONS[n, i], DIGIT_PERMUTATIONS[n, i + 1]]
        if cost < least:
            least = cost
            best = n
    given = local_integers(5)
    for i in range(5):
        given[i] = rows[3 + i]
    for i in range(5):
        rows[3 + i] = given[DIGIT_PERMUTATIONS[best, i]]
        costs[3 + i] = table[i, DIGIT_PERMUTATIONS[best, i]]
    for i in range(3):
        cost = 0.5 * crossed[DIGIT_PERMUTATIONS[best, i], DIGIT_PERMUTATIONS[best, i + 1]]
        costs[3 + i] += cost
        costs[4 + i] += cost
    return least


@jit
def _rigid_cost(gaps: np.ndarray, sides: np.ndarray, rows: np.ndarray, kept: Kept) -> float:
    """Return the cost of the kept palm markers' distances; IMPOSSIBLE beyond `SIDE_GATE`."""
    cost = 0.0
    for i in range(3):
        j = (i + 1) % 3
        if kept[i] and kept[j] and sides[i] > 0.0:
            off = abs(gaps[rows[i], rows[j]] - sides[i])
            cost += (off / SIDE_DEVIATION) ** 2 if off <= SIDE_GATE else IMPOSSIBLE
    return cost


@jit
def palm_size(gaps: np.ndarray, sides: np.ndarray, template: np.ndarray, rows: np.ndarray,
              kept: Kept) -> float:
    """Return the palm's perimeter, learned or measured, over the template's [1]; 1 if unknown.

    Parameters
    ----------
    gaps : ndarray, shape (8, 8)
        Distances of the measured markers [m].
    sides : ndarray, shape (3,)
        Learned lengths of the palm's sides; 0 where unknown [m].
    template : ndarray, shape (3, 3)
        r, p and q in the wrist's frame [m].
    rows : ndarray of int, shape (8,)
        Row of each marker.
    kept : tuple of three bool
        Whether each of the palm's rows is measured and believed.
    """
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
def beyond_reach(bounds: HandBounds, place: Vector, digit: int, size: float) -> float:
    """Return the distance of a place in the palm's frame beyond a digit's reach [m].

    `size` is the palm's, relative to the hand's [1].
    """
    root = scale(vector(bounds.roots[digit]), size)
    return distance(place, root) - REACH_FACTOR * size * bounds.reach[digit] - REACH_MARGIN


@jit
def _digit_cost(evidence: Evidence, bounds: HandBounds, local: np.ndarray, digit: int, row: int,
                size: float) -> float:
    """Return the cost of assigning a row to a digit, in variances."""
    seen, known, home = evidence.seen, evidence.known, evidence.home
    deviation, gate = evidence.deviation, evidence.gate
    label = 3 + digit
    highest = (gate[label] / deviation[label]) ** 2 if known[label] else (
        REACH_MARGIN / REACH_DEVIATION) ** 2
    if not seen[row]:
        # A marker does not lose its row as it vanishes, unless the row was wrong anyway.
        last = evidence.last[label]
        if row != last and seen[last] and known[label] and distance(
                vector(local[last]), vector(home[label])) <= gate[label]:
            return REFUSAL_FACTOR * highest
        return 0.0
    place = vector(local[row])
    beyond = beyond_reach(bounds, place, digit, size)
    if not known[label]:
        return min((beyond / REACH_DEVIATION) ** 2, highest) if beyond > 0.0 else 0.0
    off = distance(place, vector(home[label]))
    limit = gate[label]
    if row != label and not seen[label]:
        limit = min(limit, TAKEOVER_DISTANCE)
    if beyond <= 0.0 and off <= limit:
        return (off / deviation[label]) ** 2
    # Labels are exchanged for a better fit, not to get rid of an outlier.
    return highest if row == label else UNFIT_COST


@jit
def is_as_expected(evidence: Evidence, bounds: HandBounds, local: np.ndarray) -> bool:
    """Return whether the labels as given are beyond doubt, so that no reading is searched.

    Every digit is within its reach and gate, and at most half as far from its prediction as
    that is from any other marker's; the palm is within half its gate, or digits confirm it.
    `local` are the markers in the palm's frame, shape (8, 3) [m].
    """
    markers, seen, expected = evidence.markers, evidence.seen, evidence.expected
    known, home, gate = evidence.known, evidence.home, evidence.gate
    rows = local_integers(8)
    number_rows(rows)
    size = palm_size(evidence.gaps, evidence.sides, bounds.typical.template, rows,
                     (seen[0] > 0, seen[1] > 0, seen[2] > 0))
    witnesses = 0
    for i in range(3, 8):
        if not seen[i]:
            continue
        place = vector(local[i])
        if beyond_reach(bounds, place, i - 3, size) > 0.0:
            return False
        if not known[i]:
            continue
        off = distance(place, vector(home[i]))
        if off > gate[i]:
            return False
        for j in range(8):
            if j != i and known[j] and 2.0 * off > distance(vector(home[i]), vector(home[j])):
                return False
        witnesses += 1
    if witnesses < MIN_WITNESSES or not (seen[0] and seen[1] and seen[2]):
        for i in range(3):
            if seen[i] and distance(vector(markers[i]), vector(expected[i])) > 0.5 * gate[i]:
                return False
    return True


@jit
def best_reading(evidence: Evidence, bounds: HandBounds, margin: float, total: float,
                 reading: Reading) -> tuple[float, Kept]:
    """Search the best reading of a frame whose labels are in doubt.

    Parameters
    ----------
    evidence : Evidence
    bounds : HandBounds
    margin : float
        Factor by which the deviations must fall for labels to be exchanged [1]; 0 for never.
    total : float
        Cost of the labels as given [1].
    reading : Reading
        The labels as given, replaced by the best reading.

    Returns
    -------
    total : float
        Cost of the best reading.
    kept : tuple of three bool
        Palm markers that place the palm.
    """
    seen = evidence.seen
    kept = (seen[0] > 0, seen[1] > 0, seen[2] > 0)
    if evidence.gated[0]:
        total, kept = _refuse_palm_markers(evidence, bounds, total, reading)
    chosen = kept
    if margin > 0.0:
        found = Reading(local_integers(8), local_floats(8), reading.local)
        least, palm = _relabel(evidence, bounds, kept, total, reading, found)
        if least < total and _is_clearly_better(found, reading, total >= IMPOSSIBLE, margin):
            chosen = palm
            _copy_labels(found, reading)
    # Place the rows by the reading chosen
    return cost_reading(evidence, bounds, chosen, False, np.inf, reading), chosen


@jit
def _refuse_palm_markers(evidence: Evidence, bounds: HandBounds, total: float,
                         reading: Reading) -> tuple[float, Kept]:
    """Search the palm markers to refuse, with labels as given; return cost and those kept.

    Parameters and returns as for `best_reading`.
    """
    seen = evidence.seen
    kept = (seen[0] > 0, seen[1] > 0, seen[2] > 0)
    trial = Reading(local_integers(8), local_floats(8), reading.local)
    number_rows(trial.rows)
    for n in range(1, len(PALM_SUBSETS)):
        some = (PALM_SUBSETS[n, 0], PALM_SUBSETS[n, 1], PALM_SUBSETS[n, 2])
        if not ((seen[0] or not some[0]) and (seen[1] or not some[1])
                and (seen[2] or not some[2])):
            continue
        cost = cost_reading(evidence, bounds, some, False, total, trial)
        if cost < total:
            total = cost
            kept = some
            for i in range(8):
                reading.costs[i] = trial.costs[i]
    return total, kept


@jit
def _relabel(evidence: Evidence, bounds: HandBounds, kept: Kept, total: float,
             reading: Reading, found: Reading) -> tuple[float, Kept]:
    """Search the best reading with other labels; return its cost and the palm markers kept.

    Parameters
    ----------
    evidence : Evidence
    bounds : HandBounds
    kept, total, reading
        Best reading with labels as given: palm markers kept, cost and rows.
    found : Reading
        Replaced by the best reading.
    """
    seen = evidence.seen
    whole = (PALM_SUBSETS[0, 0], PALM_SUBSETS[0, 1], PALM_SUBSETS[0, 2])
    chosen = kept
    least = np.inf
    # The digits exchange their rows
    if total < IMPOSSIBLE:
        for i in range(8):
            found.rows[i] = reading.rows[i]
        least = cost_reading(evidence, bounds, kept, True, np.inf, found)
    # The palm takes other rows: only those that make a rigid palm
    trial = Reading(local_integers(8), local_floats(8), reading.local)
    count = 0
    triple = local_integers(3)
    for n in range(2 * len(PALM_TRIPLES)):
        for i in range(3):
            triple[i] = PALM_TRIPLES[n % len(PALM_TRIPLES), i]
        own = triple[0] == 0 and triple[1] == 1 and triple[2] == 2
        if own or not (seen[triple[0]] and seen[triple[1]] and seen[triple[2]]):
            continue
        rigid = _rigid_cost(evidence.gaps, evidence.sides, triple, whole)
        # The most rigid first, as their number is limited
        if rigid >= IMPOSSIBLE or (rigid < RIGID_COST) != (n < len(PALM_TRIPLES)):
            continue
        _fill_rows(triple, trial.rows)
        cost = cost_reading(evidence, bounds, whole, True, least, trial)
        count += 1 if cost < IMPOSSIBLE else 0
        if cost < least:
            least = cost
            chosen = whole
            _copy_labels(trial, found)
        if count == MAX_PALM_READINGS:
            break
    return least, chosen


@jit
def _copy_labels(source: Reading, target: Reading) -> None:
    """Copy rows and costs of a reading to another."""
    for i in range(8):
        target.rows[i] = source.rows[i]
        target.costs[i] = source.costs[i]


@jit
def _fill_rows(triple: np.ndarray, rows: np.ndarray) -> None:
    """Write `triple` as the palm's rows, and for each digit its own row or one that is left."""
    used = local_flags(8)
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
def _is_clearly_better(other: Reading, reading: Reading, impossible: bool,
                       margin: float) -> bool:
    """Return whether another reading fits `margin` times better, in the markers that differ."""
    if impossible:
        return True
    given_cost = 0.0
    other_cost = 0.0
    moved = 0
    for i in range(8):
        common = 0.0
        if reading.rows[i] == other.rows[i]:
            common = min(reading.costs[i], other.costs[i])
        else:
            moved += 1
        given_cost += reading.costs[i] - common
        other_cost += other.costs[i] - common
    return moved > 0 and (other_cost + moved) * margin * margin <= given_cost + moved
