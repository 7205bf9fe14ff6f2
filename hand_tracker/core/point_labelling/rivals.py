"""Rival labellings of a followed hand: competing hypotheses, taken once better for long enough.

Now and then the hand is labelled anew at its place, and searched elsewhere; a palm that lacks a
marker from the start is completed by free points. Labels that have long been the best take more
evidence to replace than new ones, or those after a cut.
"""

import math

import numpy as np

from ..numerics.assignment import assign_rows
from ..numerics.jit import labelling_jit
from .clutter import Cloud, PointHistory
from .hand_track import (
    ASTRAY_DISTANCE,
    LEAST_FOLLOWED,
    RELABELLING_PERIOD,
    SEARCH_PERIOD,
    HandTrack,
    reset_palm_gaps,
    start_places,
)
from .palm_search import (
    SEARCH_BUDGET,
    Finding,
    blank_candidates,
    blank_finding,
    complete_palms,
    copy_finding,
    label_candidates,
    palm_is_seen,
    refine_palm,
    search_palms,
    to_palm_frame,
    write_cost,
)
from .posture import HIDDEN_COST, count_seen, exchange_labels, label_costs, posture_cost
from .prototypes import LEAST_TYPICAL, Prototype

# As `SEARCH_BUDGET`: of a hand whose labels are in doubt, and of any followed hand; ours.
PRESSING_BUDGET, DOUBT_BUDGET = 60_000, 6_000
# Accumulated cost lead at which a rival labelling is taken: against new labels, and against trusted
# ones. A lead counts once per RIVAL_TIME, in which postures change, and RIVAL_TIMES at most
# [variances, s]; ours.
RIVAL_MARGIN = 6.
TRUSTED_MARGIN = 200.
RIVAL_TIME = .1
RIVAL_TIMES = 4.
CONTRADICTING_LEAD = 15.    # cost lead of a rival above which labels lose trust, in proportion,
GREATEST_HASTE = 3.         # and as many times the time that passes at most; ours
LONGEST_TRUST = 2.          # [s] upper bound of trust; ours
TRUST_TIME = 1.             # [s] without a better rival for full trust; ours
PRESSING_PERIOD = 1. / 60.  # [s] between two relabellings while the labels are in doubt
EARLY_STEP = .4             # [1] of a step by which a period may be shorter: near no usual rate
STILL_SEEN = .75            # share of the seen markers that stay; with fewer, a cut; ours
SHAKEN_TIME = .1            # [s] after a cut in which a rival is taken at once; ours
SHAKEN_MARGIN = 3.          # cost lead that such a rival needs [variances]; ours
UNLIKELY = 1.5              # posture distance over the typical that puts labels in doubt; ours
NEWLY_SEEN_COST = 12.       # of each marker that a rival labels besides
RETURN_MARGIN = 18.         # cost lead of a rival that only labels more markers; ours
# Both fade, see `_novelty`, between these ages of a point and of a marker's lack of a label [s], if
# the marker had one for less than the first before; ours.
LASTING_TIMES = .6, 1.4
KNOWN_TIME = .4             # [s] in which a rival's extra cost for clutter fades; ours


@labelling_jit
def note_cut(prototype: Prototype, track: HandTrack, was_seen: np.ndarray, distance: float,
             come: int) -> None:
    """Reset all trust at a cut: many markers vanish as many points appear, or the posture leaps.

    Parameters
    ----------
    prototype : Prototype
    track : HandTrack
        Of this frame; updated.
    was_seen : ndarray of bool, shape (M,) or more
        Markers that were seen in the last frame.
    distance : float
        Mahalanobis distance there, as in `Finding`.
    come : int
        Number of new clutter points.
    """
    gone, before = 0, 0
    for i in range(len(track.place)):
        before += 1 if was_seen[i] else 0
        gone += 1 if was_seen[i] and track.finding.rows[i] < 0 else 0
    leap = track.finding.distance[0] - distance
    if (min(gone, come) >= max(2., (1. - STILL_SEEN) * before)
            or leap > ASTRAY_DISTANCE * max(prototype.typical, LEAST_TYPICAL)):
        track.shaken_for[0] = SHAKEN_TIME
        track.trusted_for[:] = 0.


@labelling_jit
def review_labels(prototype: Prototype, track: HandTrack, cloud: Cloud, history: PointHistory,
                  step: float, patience: float) -> bool:
    """Drop contradicted labels, take a better rival labelling; return whether the hand is lost.

    Parameters
    ----------
    prototype : Prototype
    track : HandTrack
        Followed into this frame; updated.
    cloud : Cloud
        Its free points are updated.
    history : PointHistory
    step : float
        Time since the last frame [s].
    patience : float
        Time for which labels, or the hand, may be contradicted [s].
    """
    finding = track.finding
    place = finding.position
    if track.astray_for[0] > patience or not math.isfinite(place[0] + place[1] + place[2]):
        return True
    seen = finding.rows >= 0
    few = count_seen(finding.rows) < max(3., LEAST_FOLLOWED * len(seen))
    for i in range(len(seen)):
        if track.suspected_for[i] > .5 * patience:
            cloud.free[finding.rows[i]] = True
            finding.rows[i] = -1
            track.suspected_for[i] = 0.
            track.hidden_for[i] = step
            reset_palm_gaps(prototype, track, i)
    track.unreviewed_for[0] += step
    track.unsearched_for[0] += step
    track.shaken_for[0] -= step
    unlikely = finding.distance[0] > UNLIKELY * max(prototype.typical, LEAST_TYPICAL)
    track.unlikely_for[0] = track.unlikely_for[0] + step if unlikely else 0.
    pressing = few or unlikely or track.shaken_for[0] > 0.
    due = PRESSING_PERIOD if pressing or track.doubt[0] > 0. else RELABELLING_PERIOD
    if track.unreviewed_for[0] < due - EARLY_STEP * step:
        return False
    # A new track begins as if it was due.
    elapsed = min(track.unreviewed_for[0], track.age[0])
    track.unreviewed_for[0] = 0.
    own = cloud.free.copy()
    mark_points(own, finding.rows, True)
    rival, exchanged = blank_finding(len(seen)), blank_finding(len(seen))
    if not few:
        relabel(prototype, track, cloud.points, own, rival, exchanged)
        if _lacks_palm_marker(prototype, track):
            candidates = blank_candidates()
            complete_palms(prototype, cloud.points, cloud.free, finding.rows, candidates)
            label_candidates(prototype, cloud.points, own, candidates, rival)
    thorough = pressing or track.doubt[0] > RIVAL_MARGIN
    if thorough or track.unsearched_for[0] >= SEARCH_PERIOD - EARLY_STEP * step:
        _search_elsewhere(prototype, track, cloud.points, own, thorough, rival)
    novelty = _novelty(track, rival, cloud, history)
    lead = _lead(rival, finding, novelty, cloud, history)
    other = _lead(exchanged, finding, 0., cloud, history)  # labels no more markers
    if not few and other > lead:
        copy_finding(exchanged, rival)
        lead = other
    _weigh_rival(prototype, track, cloud, rival, lead, RETURN_MARGIN * novelty, seen, pressing,
                 elapsed)
    return False


@labelling_jit
def _search_elsewhere(prototype: Prototype, track: HandTrack, points: np.ndarray,
                      free: np.ndarray, thorough: bool, found: Finding) -> None:
    """Search the hand anew among free points, within a budget; a cheaper one replaces `found`."""
    if not len(points):
        return
    track.unsearched_for[0] = 0.
    budget = (SEARCH_BUDGET if track.shaken_for[0] > 0. else
              PRESSING_BUDGET if thorough else DOUBT_BUDGET)
    candidates = blank_candidates()
    tried = search_palms(prototype, points, free, track.next_corner[0] % len(points), budget,
                         candidates)
    label_candidates(prototype, points, free, candidates, found)
    track.next_corner[0] = (track.next_corner[0] + tried) % len(points)


@labelling_jit
def mark_points(free: np.ndarray, rows: np.ndarray, is_free: bool) -> None:
    """Mark the points of a hand's markers, (M,), as free or not, among all points, (n,)."""
    for row in rows:
        if row >= 0:
            free[row] = is_free


@labelling_jit
def _lead(rival: Finding, present: Finding, novelty: float, cloud: Cloud,
          history: PointHistory) -> float:
    """Return the cost lead of a rival labelling over the present one of a followed hand.

    A rival pays for each marker it labels besides, by its `_novelty`, and for clutter, less and
    less as that ages.
    """
    more = max(count_seen(rival.rows) - count_seen(present.rows), 0)
    lead = present.cost[0] - rival.cost[0] - NEWLY_SEEN_COST * novelty * more
    for row in rival.rows:
        if row >= 0 and not _has_point(present.rows, row):
            lead -= max(cloud.cost[row], 0.) * max(
                1. - history.age[cloud.slots[row]] / KNOWN_TIME, 0.)
    return lead


@labelling_jit
def _lacking_for(track: HandTrack, i: int) -> float:
    """Return for how long [s] a marker has had no label; 0 for one that had it for long before."""
    if track.finding.rows[i] >= 0 or track.seen_for[i] >= LASTING_TIMES[0]:
        return 0.
    return min(track.hidden_for[i], track.age[0] - track.seen_for[i])


@labelling_jit
def _lacks_palm_marker(prototype: Prototype, track: HandTrack) -> bool:
    """Return whether a marker of the palm lacks its label, and hardly had one before."""
    lacks = False
    for i in range(len(prototype.rigid)):
        lacks = lacks or (prototype.rigid[i] > 0. and _lacking_for(track, i) > 0.)
    return lacks


@labelling_jit
def _novelty(track: HandTrack, rival: Finding, cloud: Cloud, history: PointHistory) -> float:
    """Return how new, 1 to 0, the points and markers are that a rival labels besides.

    Markers that had their labels for long are new: their return is judged by motion, see `returns`.
    Of others a stray point may have had the label from the first frame.
    """
    newest, rows = LASTING_TIMES[1], track.finding.rows
    for i in range(len(rows)):
        row = rival.rows[i]
        if row >= 0 and rows[i] < 0:
            newest = min(newest, _lacking_for(track, i))
        if row >= 0 and not _has_point(rows, row):
            newest = min(newest, history.age[cloud.slots[row]])
    return min((LASTING_TIMES[1] - newest) / (LASTING_TIMES[1] - LASTING_TIMES[0]), 1.)


@labelling_jit
def _has_point(rows: np.ndarray, row: int) -> bool:
    """Return whether point `row` is among those of some markers."""
    has = False
    for other in rows:
        has = has or other == row
    return has


@labelling_jit
def _trust(track: HandTrack, rival: Finding, contradicted: float) -> float:
    """Return the trust in the labels that a rival labelling changes, the longest time of all [s].

    A label counts if the rival gives its point to another marker, or to none; `contradicted` [s] is
    first subtracted from its trust.
    """
    longest = 0.
    for i in range(len(rival.rows)):
        row, taker = track.finding.rows[i], i
        if row < 0 or rival.rows[i] == row:
            continue
        for n in range(len(rival.rows)):
            if rival.rows[n] == row:
                taker = n
        track.trusted_for[i, taker] = max(track.trusted_for[i, taker] - contradicted, 0.)
        longest = max(longest, track.trusted_for[i, taker])
    return longest


@labelling_jit
def _weigh_rival(prototype: Prototype, track: HandTrack, cloud: Cloud, rival: Finding, lead: float,
                 return_margin: float, seen: np.ndarray, pressing: bool, elapsed: float) -> None:
    """Accumulate the cost lead of a rival labelling, and take it above the margin.

    Parameters
    ----------
    prototype, track, cloud
        As for `review_labels`.
    rival : Finding
    lead : float
        Its cost lead.
    return_margin : float
        Least lead where it only labels more markers.
    seen : ndarray of bool, shape (M,)
        Markers with a point before any label was dropped.
    pressing : bool
        Whether the present labels are in doubt.
    elapsed : float
        Time since the last relabelling [s].
    """
    finding, count = track.finding, len(seen)
    changed = np.zeros(count, dtype=np.bool_)
    same, any_changed, palm_changed = True, False, False
    for i in range(count):
        same = same and rival.rows[i] == finding.rows[i]
        changed[i] = seen[i] and rival.rows[i] != finding.rows[i]
        any_changed = any_changed or changed[i]
        palm_changed = palm_changed or (changed[i] and prototype.rigid[i] > 0.)
    # With less than three palm markers the pose is rough: cost alone says little.
    poor = (palm_changed and not palm_is_seen(prototype, finding.rows)
            and count_seen(rival.rows) <= np.sum(seen))
    # Returns of markers to a likely hand are better judged by motion: see `returns`.
    returns_alone = not (pressing or any_changed) and lead < return_margin
    if (returns_alone or same or poor or not lead > 0.
            or rival.distance[0] > UNLIKELY * max(prototype.typical, 1.)):
        track.doubt[0] = max(track.doubt[0] - RIVAL_MARGIN * elapsed / RIVAL_TIME, 0.)
        if not any_changed or lead < 0.:
            for i in range(count):
                if seen[i]:
                    track.trusted_for[i] = np.minimum(track.trusted_for[i] + elapsed,
                                                      LONGEST_TRUST)
        return
    shaken = track.shaken_for[0] > 0.
    haste = min(lead / CONTRADICTING_LEAD, GREATEST_HASTE)
    contradicted = elapsed * haste if haste > 1. else 0.
    trust = min(_trust(track, rival, contradicted) / TRUST_TIME, 1.)
    margin = SHAKEN_MARGIN if shaken else RIVAL_MARGIN + (TRUSTED_MARGIN - RIVAL_MARGIN) * trust
    track.doubt[0] = min(track.doubt[0] + lead * elapsed / RIVAL_TIME, RIVAL_TIMES * lead)
    if not (track.doubt[0] >= margin or (shaken and lead >= margin)):
        return
    mark_points(cloud.free, finding.rows, True)
    copy_finding(rival, finding)
    mark_points(cloud.free, finding.rows, False)
    track.doubt[0], track.shaken_for[0] = 0., min(track.shaken_for[0], 0.)
    for i in range(count):
        if changed[i]:
            track.seen_for[i] = track.trusted_for[i] = 0.
            track.trusted_for[:, i] = 0.
    start_places(prototype, cloud.points, track)


@labelling_jit
def relabel(prototype: Prototype, track: HandTrack, points: np.ndarray, free: np.ndarray,
            anew: Finding, exchanged: Finding) -> None:
    """Label the hand at its present place: anew, without history, and by exchanging labels alone.

    Parameters
    ----------
    prototype : Prototype
    track : HandTrack
    points : ndarray, shape (n, 3)
        [m]
    free : ndarray of bool, shape (n,)
        Points of no other hand.
    anew, exchanged : Finding
        Replaced; `exchanged` keeps the labelled points, and their number.
    """
    count = len(anew.rows)
    copy_finding(track.finding, anew)
    copy_finding(track.finding, exchanged)
    local = np.empty((len(points), 3))
    cost = np.empty((count, len(points)))
    to_palm_frame(points, anew.rotation, anew.position, anew.size[0], local)
    matrix = np.empty((3 * count, 3 * count))
    constant, hidden, distance = exchange_labels(
        prototype, local, np.zeros(len(points), dtype=np.bool_), exchanged.rows, matrix,
        np.empty(3 * count), np.empty(3 * count))
    write_cost(prototype, local, exchanged,
               posture_cost(constant, distance, count - hidden, hidden), distance)
    label_costs(prototype, local, free, cost)
    assign_rows(cost, HIDDEN_COST, anew.rows)
    refine_palm(prototype, points, free, anew)
