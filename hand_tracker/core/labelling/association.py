"""Data association: assign measurements to markers, refuse outliers, correct swapped labels.

Labels are kept until another reading of the frame (`readings`) fits clearly better. A reading
kept against the labels as given has to stay more plausible for a hand than they are
(`plausibility`). Ours; no source.
"""

import math
from typing import NamedTuple

import numpy as np

from ..model.palm_triangle import rigid_palm
from ..model.states import REJECTED, SEEN, SWAPPED
from ..numerics.assignment import number_rows
from ..numerics.jit import jit
from ..numerics.stack_memory import local_floats, local_integers
from ..numerics.vectors import clamp, components, distance, store, subtract, vector
from .plausibility import (
    EXCHANGE_MARGIN,
    EXCHANGES,
    correct_exchange,
    find_exchange,
    label_cost,
)
from .readings import (
    DIGIT_GATE_BEND,
    IMPOSSIBLE,
    MAX_BEND_TIME,
    MAX_ROLL,
    ROLL_SPEED,
    SIDE_DEVIATION,
    Evidence,
    ExpectedMarkers,
    HandBounds,
    Kept,
    Reading,
    best_reading,
    beyond_reach,
    blank_evidence,
    cost_reading,
    expect,
    is_as_expected,
    palm_size,
    record_measurements,
    set_gates,
)

ACCEPTED = SEEN

SIDE_TIME = 1.            # [s] time constant of the learned distances of palm markers; ours
PALM_ORDER_MARGIN = .006  # [m] by which exchanged palm markers must fit the learned better; ours
MIN_SIDE_DEVIATION = .0005  # [m] of such a distance; ours
MAX_SIDE_CHANGE = .5      # of a side: beyond it no palm of a hand nobody calibrated; ours
REFUSED_SPEED = 6.        # [m/s] of a refused marker that counts as the same; ours
REFUSED_STRAY = .006      # [m] besides that; ours
STAYING_STRAY = .014      # [m] in a frame, in the palm's, of a refused marker that stays; ours
GHOST_DISTANCE = .015     # [m] of a palm marker from its prediction: noise is nearer; ours
SEEN_AGAIN_TIME = .012    # [s] time constant in which `unseen_for` decays once seen; ours
RECOVERY_RATE = 4.        # [1] at which `incomplete_for` decays while the palm is complete; ours
ASTRAY_DEVIATIONS = 3.    # [1] of a digit from its prediction, besides what it does in a step; ours
PLAUSIBILITY_TIME = 2.    # [s] time constant of the labellings' comparison; ours


class LabellingOptions(NamedTuple):
    """Options of the association, from `TrackerOptions`.

    Attributes
    ----------
    outlier_gate : float
        Greatest accepted distance from a prediction, in standard deviations [1]; what a hand
        can do in a step is never refused. 0 refuses nothing.
    swap_margin : float
        Labels are exchanged if that fits this many times better [1]; 0 exchanges none.
    patience : float
        Time after which a marker refused in one place is accepted; 0 for never [s].
    """

    outlier_gate: float
    swap_margin: float
    patience: float


class AssociationState(NamedTuple):
    """State of the association, kept from frame to frame.

    Attributes
    ----------
    refused_for : ndarray, shape (8,)
        Time for which each marker has been refused in one place [s].
    refused_at : ndarray, shape (8, 3)
        That place, in the palm's frame [m].
    sides : ndarray, shape (3,)
        Learned distances of palm markers r p, p q and q r; 0 before the first [m].
    side_variances : ndarray, shape (3,)
        Of these distances, over `SIDE_TIME` [m²].
    doubted_for : ndarray, shape (1,)
        Time for which another labelling has been more plausible than the present [s].
    rival : ndarray of int, shape (1,)
        Which of `EXCHANGES` that is, while labels are as given.
    lead : ndarray, shape (28,)
        Plausibility of the present labelling over each of its `EXCHANGES`, the mean over
        `PLAUSIBILITY_TIME`, in variances [1].
    incomplete_for : ndarray, shape (1,)
        Time for which the palm was not complete [s].
    unseen_for : ndarray, shape (8,)
        Time for which each marker was not seen; decays within `SEEN_AGAIN_TIME` [s].
    evidence : Evidence
        Of the frame.
    """

    refused_for: np.ndarray
    refused_at: np.ndarray
    sides: np.ndarray
    side_variances: np.ndarray
    doubted_for: np.ndarray
    rival: np.ndarray
    lead: np.ndarray
    incomplete_for: np.ndarray
    unseen_for: np.ndarray
    evidence: Evidence


def initial_association() -> AssociationState:
    """Return the `AssociationState` before the first frame."""
    return AssociationState(
        refused_for=np.zeros(8), refused_at=np.zeros((8, 3)), sides=np.zeros(3),
        side_variances=np.full(3, SIDE_DEVIATION ** 2),
        doubted_for=np.zeros(1), rival=np.zeros(1, dtype=np.int64),
        lead=np.zeros(len(EXCHANGES)), incomplete_for=np.zeros(1), unseen_for=np.zeros(8),
        evidence=blank_evidence())


@jit
def associate(markers: np.ndarray, seen: np.ndarray, expected: ExpectedMarkers, step: float,
              bounds: HandBounds, state: AssociationState, options: LabellingOptions,
              verdict: np.ndarray) -> None:
    """Assign each measurement to its marker, and refuse outliers.

    Parameters
    ----------
    markers : ndarray, shape (8, 3)
        Measurements by their labels, reordered [m].
    seen : ndarray of bool, shape (8,)
        Reordered too; cleared where refused.
    expected : ExpectedMarkers
        Not used unless all three palm markers are known.
    step : float
        Time since the last frame [s].
    bounds : HandBounds
    state : AssociationState
        Updated.
    options : LabellingOptions
    verdict : ndarray of int, shape (8,)
        ACCEPTED, REJECTED or SWAPPED of each marker, replaced.
    """
    gate, margin, patience = options.outlier_gate, options.swap_margin, options.patience
    verdict[:] = ACCEPTED
    if gate <= 0.0 and margin <= 0.0:
        return
    evidence, template = state.evidence, bounds.typical.template
    record_measurements(evidence, markers, seen, state.sides, state.side_variances, gate > 0.0)
    rows = local_integers(8)
    number_rows(rows)
    if _begins_anew(state, template, patience) or not expect(evidence, expected):
        if margin > 0.0:
            correct_exchange(evidence.markers, evidence.seen, bounds.typical, rows)
        _begin(evidence, bounds, state, rows, verdict)
        _reorder(evidence, rows, markers, seen, verdict)
        return

    rolled_for = state.incomplete_for[0]
    if rolled_for > 0.0 and _stays_refused(evidence, template, state, step):
        rolled_for = 0.0
    set_gates(evidence, template, expected, state.unseen_for, rolled_for, step, gate)
    reading = Reading(rows, local_floats(8), local_floats((8, 3)))
    kept = (seen[0], seen[1], seen[2])
    total = cost_reading(evidence, bounds, kept, False, np.inf, reading)
    if total >= IMPOSSIBLE or not is_as_expected(evidence, bounds, reading.local):
        total, kept = best_reading(evidence, bounds, margin, total, reading)
    if total >= IMPOSSIBLE:
        # No reading fits: the check of the palm reports why.
        for i in range(8):
            state.refused_for[i] = 0.0
        return
    _conclude(evidence, bounds, kept, reading, state, step, patience, verdict)
    if margin > 0.0:
        _compare_rival(evidence, bounds, state, rows, step)
    _reorder(evidence, rows, markers, seen, verdict)


@jit
def _begins_anew(state: AssociationState, template: np.ndarray, patience: float) -> bool:
    """Return whether to accept the frame without history: labels or palm were long in doubt."""
    gaps = state.evidence.gaps
    slipped = False
    for i in range(3):
        slipped = slipped or state.refused_for[i] >= patience
    # A palm refused for long is accepted only if it has the shape of one.
    slipped = slipped and not _is_in_another_order(gaps, state.sides, template) and (
        _has_learned_shape(gaps, state.sides) or _has_template_shape(gaps, template))
    return patience > 0.0 and (slipped or state.doubted_for[0] >= patience)


@jit
def _stays_refused(evidence: Evidence, template: np.ndarray, state: AssociationState,
                   step: float) -> bool:
    """Return whether a refused palm marker, not hidden before, stays where it was refused.

    It is a ghost: that the palm may have rolled unseen does not excuse its place.
    """
    expected = evidence.expected
    axes, origin = rigid_palm(
        (vector(expected[0]), vector(expected[1]), vector(expected[2])), template)
    for i in range(3):
        marker = vector(evidence.markers[i])
        if (evidence.seen[i] and state.refused_for[i] > 0.0 and state.unseen_for[i] <= step
                and distance(marker, vector(expected[i])) > GHOST_DISTANCE
                and distance(components(axes, subtract(marker, origin)),
                             vector(state.refused_at[i])) <= STAYING_STRAY):
            return True
    return False


@jit
def _reorder(evidence: Evidence, rows: np.ndarray, markers: np.ndarray, seen: np.ndarray,
             verdict: np.ndarray) -> None:
    """Write the measurements in the order of the markers; clear `seen` where refused."""
    for i in range(8):
        store(markers, i, vector(evidence.markers[rows[i]]))
        seen[i] = evidence.seen[rows[i]] and verdict[i] != REJECTED


@jit
def _begin(evidence: Evidence, bounds: HandBounds, state: AssociationState, rows: np.ndarray,
           verdict: np.ndarray) -> None:
    """Accept a frame without history, and initialise the state by it."""
    state.doubted_for[0] = 0.0
    state.lead[:] = 0.0
    for i in range(8):
        state.refused_for[i] = 0.0
        evidence.last[i] = rows[i]
        if rows[i] != i and evidence.seen[rows[i]]:
            verdict[i] = SWAPPED
    gaps = local_floats((3, 3))
    for i in range(3):
        for j in range(3):
            gaps[i, j] = evidence.gaps[rows[i], rows[j]]
    plausible = _has_template_shape(gaps, bounds.typical.template)
    for i in range(3):
        state.sides[i] = gaps[i, (i + 1) % 3] if plausible else 0.0


@jit
def _has_learned_shape(gaps: np.ndarray, sides: np.ndarray) -> bool:
    """Return whether the sides of the palm as labelled are close to the learned ones."""
    close = sides[0] > 0.0
    for i in range(3):
        # False for the infinite gaps of hidden markers
        close = close and abs(gaps[i, (i + 1) % 3] - sides[i]) <= MAX_SIDE_CHANGE * sides[i]
    return close


@jit
def _has_template_shape(gaps: np.ndarray, template: np.ndarray) -> bool:
    """Return whether the sides of the palm as labelled are close to the template's."""
    close = True
    for i in range(3):
        side = _template_side(template, i)
        close = close and abs(gaps[i, (i + 1) % 3] - side) <= MAX_SIDE_CHANGE * side
    return close


@jit
def _template_side(template: np.ndarray, i: int) -> float:
    """Return the distance of a palm marker from the next on the hand [m]."""
    return distance(vector(template[i]), vector(template[(i + 1) % 3]))


@jit
def _is_in_another_order(gaps: np.ndarray, sides: np.ndarray, template: np.ndarray) -> bool:
    """Return whether the palm's labels exchanged would fit the learned sides better.

    Unless by the template they would fit worse: then the sides were learned by wrong labels.
    """
    least = math.inf
    first, second = 0, 1
    for a in range(3):
        for b in range(3):
            if a != b:
                off = _off_sides(gaps, sides, a, b)
                if off < least:
                    least, first, second = off, a, b
    usual = local_floats(3)
    for i in range(3):
        usual[i] = _template_side(template, i)
    return (least < _off_sides(gaps, sides, 0, 1) - PALM_ORDER_MARGIN
            and _off_sides(gaps, usual, first, second)
            <= _off_sides(gaps, usual, 0, 1) + PALM_ORDER_MARGIN)


@jit
def _off_sides(gaps: np.ndarray, sides: np.ndarray, a: int, b: int) -> float:
    """Return by how much a palm whose markers r and p are `a` and `b` is off its sides [m]."""
    c = 3 - a - b
    return abs(gaps[a, b] - sides[0]) + abs(gaps[b, c] - sides[1]) + abs(gaps[c, a] - sides[2])


@jit
def _conclude(evidence: Evidence, bounds: HandBounds, kept: Kept, reading: Reading,
              state: AssociationState, step: float, patience: float,
              verdict: np.ndarray) -> None:
    """Refuse the measurements beyond their gates, and update the state by the reading."""
    seen, known, home, gate = evidence.seen, evidence.known, evidence.home, evidence.gate
    rows, local = reading.rows, reading.local
    size = palm_size(evidence.gaps, state.sides, bounds.typical.template, rows, kept)
    _learn_palm(evidence.gaps, kept, rows, state, step)
    believed = not _most_are_astray(evidence, reading, step)
    kept_time = math.exp(-max(step, 0.0) / SEEN_AGAIN_TIME)
    for i in range(8):
        row = rows[i]
        if not seen[row]:
            state.unseen_for[i] += max(step, 0.0)
            if 0.0 < patience < state.unseen_for[i]:
                evidence.last[i] = i
            continue
        evidence.last[i] = row
        if row != i:
            verdict[i] = SWAPPED
        reachable = i < 3 or beyond_reach(bounds, vector(local[row]), i - 3, size) <= 0.0
        wrong = not reachable
        if i < 3:
            wrong = not kept[i]
        elif known[i] and believed:
            wrong = wrong or distance(vector(local[row]), vector(home[i])) > gate[i]
        if not (wrong and evidence.gated[0]):
            state.refused_for[i] = 0.0
            state.unseen_for[i] *= kept_time
            continue
        moved = distance(vector(local[row]), vector(state.refused_at[i]))
        if state.refused_for[i] > 0.0 and not moved <= REFUSED_STRAY + REFUSED_SPEED * step:
            state.refused_for[i] = 0.0
        state.refused_for[i] += max(step, 0.0)
        store(state.refused_at, i, vector(local[row]))
        if i >= 3 and reachable and 0.0 < patience <= state.refused_for[i]:
            state.refused_for[i] = 0.0
            state.unseen_for[i] *= kept_time
            continue
        verdict[i] = REJECTED


@jit
def _learn_palm(gaps: np.ndarray, kept: Kept, rows: np.ndarray, state: AssociationState,
                step: float) -> None:
    """Update the learned sides of a complete palm, and the time for which it is incomplete."""
    sides = state.sides
    if kept[0] and kept[1] and kept[2]:
        gain = min(max(step, 0.0) / SIDE_TIME, 1.0)
        for i in range(3):
            off = gaps[rows[i], rows[(i + 1) % 3]] - sides[i]
            if sides[i] > 0.0:
                variance = state.side_variances[i]
                state.side_variances[i] = max(
                    variance + gain * (off * off - variance), MIN_SIDE_DEVIATION ** 2)
            sides[i] += (gain if sides[i] > 0.0 else 1.0) * off
        state.incomplete_for[0] = max(
            state.incomplete_for[0] - RECOVERY_RATE * max(step, 0.0), 0.0)
    else:
        state.incomplete_for[0] = min(
            state.incomplete_for[0] + max(step, 0.0), MAX_ROLL / ROLL_SPEED)


@jit
def _most_are_astray(evidence: Evidence, reading: Reading, step: float) -> bool:
    """Return whether most digits are where they cannot have moved to in a step.

    Then the palm is wrong, or the frame does not follow the last one, as where a take was cut:
    predictions say nothing of a single digit.
    """
    seen, known, home, deviation = evidence.seen, evidence.known, evidence.home, evidence.deviation
    rows, local = reading.rows, reading.local
    time = clamp(step, 0.0, MAX_BEND_TIME)
    astray = 0
    for i in range(3, 8):
        if seen[rows[i]] and known[i]:
            off = distance(vector(local[rows[i]]), vector(home[i]))
            farthest = ASTRAY_DEVIATIONS * deviation[i] + 0.5 * DIGIT_GATE_BEND * time * time
            astray += 1 if off > farthest else -1
    return astray > 0


@jit
def _compare_rival(evidence: Evidence, bounds: HandBounds, state: AssociationState,
                   rows: np.ndarray, step: float) -> None:
    """Update the time for which a rival labelling has been more plausible than the present.

    For exchanged labels the rival is the labels as given, which need not be better now if the
    present ones were not so before. For labels as given the rivals are their exchanges, one
    after the other, which must be clearly better.
    """
    seen, lead = evidence.seen, state.lead
    rival = local_integers(8)
    number_rows(rival)
    own = True
    for i in range(8):
        own = own and (rows[i] == i or not seen[rows[i]])
    n = state.rival[0] if own else find_exchange(rows)
    if own:
        one, other = EXCHANGES[n]
        rival[one], rival[other] = other, one
    present = label_cost(evidence.markers, seen, rows, bounds.typical)
    better = present - label_cost(evidence.markers, seen, rival, bounds.typical)
    if not abs(better) < math.inf:
        return
    if n >= 0:
        # Rivals of labels as given are compared once in as many frames as there are.
        share = step * (
            len(EXCHANGES) if own and state.doubted_for[0] == 0.0 else 1) / PLAUSIBILITY_TIME
        comparable = seen[EXCHANGES[n, 0]] and seen[EXCHANGES[n, 1]]
        lead[n] -= clamp(share, 0.0, 1.0) * ((better if comparable else 0.0) + lead[n])
    if better >= EXCHANGE_MARGIN if own else better >= 0.0 and (n < 0 or lead[n] <= 0.0):
        state.doubted_for[0] += max(step, 0.0)
    else:
        state.doubted_for[0] = max(state.doubted_for[0] - max(step, 0.0), 0.0)
        if state.doubted_for[0] == 0.0:
            state.rival[0] = (state.rival[0] + 1) % len(EXCHANGES)
