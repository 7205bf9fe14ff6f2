"""Labeller of anonymous points: assigns them to the markers of one or two hands.

`CloudLabeller` owns the state: hands that are searched, confirmed and followed.
"""

import math
import sys
from collections.abc import Callable, Sequence
from itertools import permutations
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..model.hand import Hand
from ..model.marker_layout import MARKERS, MarkerLayout
from ..numerics.jit import for_types_of, load_kernel
from ..numerics.jit import loaded_or_plain as kernel
from .clutter import Cloud, continue_clutter, new_cloud, no_clutter, no_points, with_slots
from .following import follow_cloud, renew_places
from .hand_track import CLUTTER_RANGE, HandTrack, begin_track, start_places
from .natural_poses import model_prototype
from .pair_search import label_pairs, search_pairs
from .palm_search import (
    SEARCH_BUDGET,
    Finding,
    blank_candidates,
    blank_finding,
    label_candidates,
    palm_is_seen,
    search_palms,
)
from .posture import count_seen
from .prototypes import HandPrototype, Prototype
from .rivals import SHAKEN_TIME
from .side_evidence import OTHER_SIDE_LEAD, SideEvidence
from .wearer_postures import WearerPostures

FARTHEST_POINT = 1e3         # [m] on each axis; points beyond are left out
LONGEST_PAUSE = .25          # [s] gap between frames after which all tracks are dropped
# Gate on a found hand's Mahalanobis distance, relative to the typical: with three palm markers
# seen, and with fewer; ours.
ACCEPTED_DISTANCE, PAIR_DISTANCE = 1.5, .7
# Cost lead of the mirrored hand above which a hand just found, or followed, is rejected; ours.
MIRROR_MARGIN, FOLLOWED_MIRROR_MARGIN = 6., 16.
# Cost lead of a hand just found over the mirrored one above which the verdict that the hand before
# was of the other side is dropped; ours.
CLEAR_SIDE_LEAD = 60.
# Most markers of a hand whose side is checked while it is followed, and with free points; ours.
MOST_CHECKED = 12
# Cost lead by which hands of a joint search replace the present ones; distance of the palms above
# which there is no joint search [m]; ours.
TOGETHER_MARGIN, TOGETHER_GAP = 30., .3
REVIEW_PERIOD = .25         # [s] between two joint searches, up to twice that; ours
FOREIGN_COST = 12.          # of each point that only the mirrored hand has; ours
UNTIMED_STEP = 1. / 120.     # [s]
# [s] after which a hand with an implausible posture, or hardly seen, is lost; a label that the
# other markers contradict is dropped after half of it; ours.
LABEL_PATIENCE = .2


class CloudLabels(NamedTuple):
    """Labels of a frame, for each hand.

    Attributes
    ----------
    rows : tuple of ndarray of int, shape (M,)
        For each hand the point of each marker, -1 where it is hidden; all -1 where the hand is
        not found.
    places : tuple of ndarray, shape (M, 3)
        For each hand where its markers are; not numbers where one is hidden [m].
    found : tuple of bool
        Whether each hand is confirmed and followed.
    other_side : tuple of bool
        Whether the points fit the mirrored hand better: one of the other side.
    """

    rows: tuple[np.ndarray, ...]
    places: tuple[np.ndarray, ...]
    found: tuple[bool, ...]
    other_side: tuple[bool, ...]


def _with_hidden(points: ArrayLike) -> np.ndarray:
    """Return a copy of points (n, 3) with a row of NaN behind: row -1, of hidden markers.

    Raises
    ------
    ValueError
        If the shape is not (n, 3).
    """
    given = np.asarray(points, dtype=float)
    if given.size == 0:
        given = given.reshape(-1, 3)
    if given.ndim != 2 or given.shape[1] != 3:
        raise ValueError(f'points: shape {given.shape}; expected (n, 3)')
    padded = np.empty((len(given) + 1, 3))
    padded[:-1], padded[-1] = given, np.nan
    return padded


class _Hand:
    """State of one hand: prototype, track, and progress of its search."""

    def __init__(self, prototype: HandPrototype, first_marker: int) -> None:
        self.first_marker = first_marker    # among those of all hands
        self.count = len(prototype.names)
        self.side = SideEvidence(prototype.statistics, prototype.mirrored().statistics)
        self.by_pairs = False   # search by pairs of palm markers, not triangles
        self._begin(prototype)
        self.lose()

    def _begin(self, prototype: HandPrototype) -> None:
        """Label by a prototype, with no postures learned."""
        self.postures = WearerPostures(prototype)
        self._label_by(prototype)

    def replace_prototype(self, prototype: HandPrototype, points: np.ndarray) -> None:
        """Go on with another prototype of the same markers, from the points of the last frame."""
        # Learned postures are in the frame of the former template.
        self._begin(prototype)
        if not self.confirmed:
            self.lose()
        elif self.track is not None:
            kernel(renew_places)(self.statistics, points, self.track)

    def _label_by(self, prototype: HandPrototype) -> None:
        self.prototype = prototype
        self.statistics: Prototype = prototype.statistics
        self.mirrored: Prototype = prototype.mirrored().statistics
        self.side.judge_by(self.statistics, self.mirrored)

    def learn_posture(self, step: float) -> None:
        """Learn from the posture in a frame, a time step [s] after the last one."""
        if self.track is None or not self.confirmed or self.side.lead > 0.:
            return
        mixed = self.postures.add(self.track, self.prototype, step)
        if mixed is not None:
            # The palm hardly changes: places and evidence stay.
            self._label_by(mixed)
            self.track.expected[:] = np.nan     # was by the former prototype

    def forget_postures(self) -> None:
        """Search on without the wearer's postures; the track is dropped."""
        self._begin(self.postures.prototype)
        self.lose()

    def lose(self) -> None:
        """Drop the track; the hand is searched from the next frame on."""
        self.side.lose()
        self.track: HandTrack | None = None
        self.confirmed = False
        self.searched = self.first = 0


def _search_points(prototype: Prototype, points: np.ndarray, free: np.ndarray, first: int,
                   budget: int, found: Finding, by_pairs: bool) -> int:
    """Search a hand by triangles or pairs of palm markers, from point `first` on, within a budget.

    A cheaper labelling replaces `found`; returns the number of first corners tried.
    """
    candidates = blank_candidates()
    search, label = (search_pairs, label_pairs) if by_pairs else (search_palms, label_candidates)
    tried = kernel(search)(prototype, points, free, first, budget, candidates)
    kernel(label)(prototype, points, free, candidates, found)
    return tried


def _labelled_as(prototype: Prototype, track: HandTrack, points: np.ndarray, by_pairs: bool,
                 free: np.ndarray | None) -> Finding:
    """Label the points of a track, and the free ones, (n,), anew by a prototype."""
    rows = track.finding.rows
    own = np.zeros(len(points), dtype=bool) if free is None else free.copy()
    own[rows[rows >= 0]] = True
    found = blank_finding(len(rows))
    _search_points(prototype, points, own, 0, sys.maxsize, found, by_pairs)
    return found


def _is_typical(prototype: Prototype, finding: Finding) -> bool:
    """Return whether a found hand's Mahalanobis distance is within the gate of a typical hand."""
    limit = ACCEPTED_DISTANCE if palm_is_seen(prototype, finding.rows) else PAIR_DISTANCE
    return bool(finding.distance[0] <= limit * max(prototype.typical, 1.))


def _total_cost(found: Sequence[Finding]) -> float:
    """Return the cost of hands together, of which one that is not found costs nothing."""
    return float(sum(min(one.cost[0], 0.) for one in found))


def _count_common(finding: Finding, rows: np.ndarray) -> int:
    """Return how many of the points `rows` are labelled as a hand's."""
    return int(np.isin(finding.rows[finding.rows >= 0], rows).sum())


def _near(points: np.ndarray, finding: Finding) -> np.ndarray:
    """Return which points, (n, 3) [m], are within `CLUTTER_RANGE` of a hand's palm, (n,)."""
    return np.abs(points - finding.position).max(axis=1) < CLUTTER_RANGE


class CloudLabeller:
    """Label anonymous points, or points with changing ids, frame by frame.

    Parameters
    ----------
    prototypes : sequence of HandPrototype
        One for each hand to find.

    Examples
    --------
    >>> labeller = CloudLabeller([prototype])
    >>> labels = labeller.update(points)  # points: (n, 3) [m], in any order
    >>> index = labels.rows[0][prototype.names.index('index')]
    """

    def __init__(self, prototypes: Sequence[HandPrototype]) -> None:
        self._time: float | None = None
        self._hands: list[_Hand] = []
        count = 0
        for prototype in prototypes:
            self._hands.append(_Hand(prototype, count))
            count += self._hands[-1].count
        self._clutter = no_clutter(count)
        self._last = no_points()
        self._last_step = UNTIMED_STEP
        self._since_joint_search = 0.    # [s]
        self._has_reviewed = False  # in this frame: a review takes longer than all else
        self._follow_cloud: dict[tuple[Callable[..., None], int], Callable[..., None]] = {}

    @property
    def prototypes(self) -> tuple[HandPrototype, ...]:
        """The hands' prototypes, without the wearer's postures."""
        return tuple(hand.postures.prototype for hand in self._hands)

    def replace_prototype(self, index: int, prototype: HandPrototype) -> None:
        """Replace a hand's prototype, such as by one of its size; a followed hand keeps its labels.

        Parameters
        ----------
        index : int
            Of the hand.
        prototype : HandPrototype
            Of the same markers.

        Raises
        ------
        ValueError
            If the markers or the side are others.
        """
        hand = self._hands[index]
        if (prototype.names, prototype.side) != (hand.prototype.names, hand.prototype.side):
            raise ValueError(f'prototype: of {prototype.side} markers {prototype.names}; expected '
                             f'{hand.prototype.side} {hand.prototype.names}')
        hand.replace_prototype(prototype, self._last.points)

    def reset(self) -> None:
        """Drop all tracks, the evidence on the hands' sides, and the wearer's postures."""
        self._time = None
        for hand in self._hands:
            hand.side.forget()
            hand.forget_postures()

    def update(self, points: ArrayLike, time: float | None = None,
               ids: ArrayLike | None = None) -> CloudLabels:
        """Label the points of the next frame.

        Parameters
        ----------
        points : array_like, shape (n, 3)
            In any order [m]; rows with a number that is not finite are left out.
        time : float, optional
            Of the frame; when left out frames are taken as evenly spaced at 120 Hz [s].
        ids : array_like of int, shape (n,), optional
            Point ids of the source, used as a hint; negative for none.

        Returns
        -------
        CloudLabels

        Raises
        ------
        ValueError
            If a shape is not as above.
        """
        all_points = _with_hidden(points)
        cloud = all_points[:-1]
        names = np.full(len(cloud), -1) if ids is None else np.array(ids, dtype=np.int64)
        if names.shape != (len(cloud),):
            raise ValueError(f'ids: shape {names.shape}; expected {(len(cloud),)}')
        kept = None
        if not np.vdot(cloud, cloud) < FARTHEST_POINT ** 2:  # False for NaN
            kept = np.flatnonzero(np.abs(cloud).max(axis=1) < FARTHEST_POINT)
            cloud, names = cloud[kept], names[kept]
        frame = new_cloud(cloud, names)
        step = self._step(time)
        self._since_joint_search += step
        self._has_reviewed = False
        for hand in self._hands:
            hand.side.elapse(step)
        self._follow(frame, step)
        self._search(frame)
        self._review_together(frame)
        for hand in self._hands:
            hand.learn_posture(step)
        self._last, self._last_step = frame, step
        rows = [hand.track.finding.rows.copy() if hand.track is not None and hand.confirmed
                else np.full(hand.count, -1) for hand in self._hands]
        if kept is not None and len(kept):
            rows = [np.where(own >= 0, kept[own], -1) for own in rows]
        return CloudLabels(tuple(rows), tuple([all_points.take(own, axis=0) for own in rows]),
                           tuple([hand.confirmed for hand in self._hands]),
                           tuple([hand.side.is_other_side for hand in self._hands]))

    def _step(self, time: float | None) -> float:
        """Return the time since the last frame; drop all tracks after a pause or a jump back."""
        if time is None:
            return UNTIMED_STEP
        step = UNTIMED_STEP if self._time is None else float(time) - self._time
        self._time = float(time)
        if not 0. <= step <= LONGEST_PAUSE:
            for hand in self._hands:
                if step < 0.:   # as where a recording begins anew
                    hand.forget_postures()
                else:
                    hand.lose()
            return UNTIMED_STEP
        return step or UNTIMED_STEP  # repeated stamps give no step

    def _follow(self, frame: Cloud, step: float) -> None:
        """Follow clutter and hands into a frame; drop hands that are lost or of the other side."""
        if len(frame.points) > len(self._clutter.used):
            self._clutter = with_slots(self._clutter, 2 * len(frame.points))
        hands = [hand for hand in self._hands if hand.track is not None]
        if not hands:
            kernel(continue_clutter)(self._clutter, self._last, self._last_step, frame, step)
            return
        tracks = tuple([hand.track for hand in hands if hand.track is not None])
        lost = np.zeros(len(hands), dtype=bool)
        arguments = (
            tuple([hand.statistics for hand in hands]), tracks, self._clutter, self._last, frame,
            np.array([hand.first_marker for hand in hands]), (self._last_step, step),
            LABEL_PATIENCE, lost)
        # The argument types depend on the number of hands alone.
        which = kernel(follow_cloud), len(hands)
        if which not in self._follow_cloud:
            self._follow_cloud[which] = for_types_of(which[0], arguments)
        self._follow_cloud[which](*arguments)
        for hand, track, is_lost in zip(hands, tracks, lost.tolist()):
            if track.shaken_for[0] > SHAKEN_TIME - 1.5 * step:
                hand.side.lose()    # after a cut this may be another hand
            if is_lost or self._is_of_other_side(hand, track, frame, step):
                hand.lose()

    def _is_of_other_side(self, hand: _Hand, track: HandTrack, frame: Cloud,
                          step: float) -> bool:
        """Return whether a followed hand's points fit the mirrored hand: it is of the other side.

        Checked once in one or two `SIDE_PERIOD`, once a cut is overcome, and while its posture
        stays unlikely.
        """
        is_over = -step < track.shaken_for[0] <= 0.
        in_doubt = is_over or track.unlikely_for[0] > LABEL_PATIENCE
        # With many markers a search takes longer than a frame, and shows the side at once.
        is_due = hand.count <= MOST_CHECKED and hand.side.is_due(self._has_reviewed)
        if not hand.confirmed or not (in_doubt or is_due):
            return False
        self._has_reviewed = True
        if is_due:
            by_pairs = not palm_is_seen(hand.statistics, track.finding.rows)
            self._note_side(hand, frame, *self._mirrored_lead(hand, frame.points, by_pairs))
        if in_doubt:
            track.unlikely_for[0] = 0.
            if self._mirrored_lead(hand, frame.points, False)[0] > FOLLOWED_MIRROR_MARGIN:
                return True
        return hand.side.is_other_side

    def _search(self, frame: Cloud) -> None:
        """Search the unconfirmed hands, within the budget of a frame."""
        missing = [hand for hand in self._hands if not hand.confirmed]
        points = frame.points
        if not missing or len(points) < 3:
            return
        for hand in missing:
            # All but points of confirmed hands: an unconfirmed one may have this hand's points.
            own = np.ones(len(points), dtype=bool)
            for other in self._hands:
                if other is not hand and other.track is not None and other.confirmed:
                    own[other.track.finding.rows[other.track.finding.rows >= 0]] = False
            found = blank_finding(hand.count)
            tried = _search_points(hand.statistics, points, own, hand.first, SEARCH_BUDGET, found,
                                   hand.by_pairs)
            hand.first = (hand.first + tried) % len(points)
            hand.searched += tried
            if found.cost[0] < (
                    hand.track.finding.cost[0] if hand.track is not None else np.inf):
                hand.track = begin_track(hand.statistics, found, points)
        for hand in missing:
            if hand.searched >= len(points):
                hand.searched = 0
                self._settle(hand, frame)
                # By triangles and by pairs of palm markers in turn, until it is confirmed.
                hand.by_pairs = not (hand.confirmed or hand.by_pairs)
        for hand in missing:
            if hand.track is not None:
                rows = hand.track.finding.rows
                frame.free[rows[rows >= 0]] = False

    def _settle(self, hand: _Hand, frame: Cloud) -> None:
        """Confirm the hand that a complete search has found, or drop it."""
        if hand.track is None:
            return
        finding = hand.track.finding
        rivals = [other for other in self._hands if other is not hand
                  and other.track is not None
                  and np.isin(other.track.finding.rows, finding.rows[finding.rows >= 0]).any()]
        if rivals:
            self._since_joint_search = np.inf   # the first found may have points of the other
        believable = self._is_believable(hand, frame)
        if not believable or any(
                other.confirmed or (other.track is not None
                                    and other.track.finding.cost[0] < finding.cost[0]
                                    and self._is_believable(other, frame))
                for other in rivals):
            hand.lose()
            return
        hand.confirmed = True
        for other in rivals:
            other.lose()

    def _is_believable(self, hand: _Hand, frame: Cloud) -> bool:
        """Return whether a found hand has a plausible posture, and fits its own side better."""
        assert hand.track is not None
        finding = hand.track.finding
        if not _is_typical(hand.statistics, finding):
            return False
        whole = palm_is_seen(hand.statistics, finding.rows)
        lead, found = self._mirrored_lead(hand, frame.points, not whole)
        if hand.side.is_due():
            self._note_side(hand, frame, lead, found)
        if hand.side.is_other_side and whole and lead < -CLEAR_SIDE_LEAD:
            hand.side.forget()  # of the hand before
        # Two palm markers do not show the side: the digits must favour it clearly.
        return (lead <= (MIRROR_MARGIN if whole else -MIRROR_MARGIN)
                and not hand.side.is_other_side)

    def _review_together(self, frame: Cloud) -> None:
        """Search all hands jointly; replace the present ones if the joint result costs far less.

        Of hands found one by one, the first may have points of the other.
        """
        due_after = 2. * REVIEW_PERIOD if self._has_reviewed else REVIEW_PERIOD
        if len(self._hands) < 2 or self._since_joint_search < due_after:
            return
        present = [(hand.track.finding, hand.side.lead) for hand in self._hands
                   if hand.track is not None and hand.confirmed]
        places = [finding.position.tolist() for finding, _ in present]
        if not present or (len(present) == len(self._hands) and math.dist(
                map(min, *places), map(max, *places)) > TOGETHER_GAP):
            return
        self._since_joint_search = 0.
        points = frame.points
        near = np.any([_near(points, finding) for finding, _ in present], axis=0)
        found = self._found_together(points, near, SEARCH_BUDGET)
        # The stronger the evidence on the sides, the harder the present hands are to replace.
        least = sum(finding.cost[0] + min(lead + OTHER_SIDE_LEAD, 0.) for finding, lead in present)
        if found is None or not (
                _total_cost(found) < least - TOGETHER_MARGIN):
            return
        for hand in self._hands:
            hand.lose()
        frame.free[:] = True
        for hand, one in zip(self._hands, found):
            if one.cost[0] < np.inf:
                hand.track, hand.confirmed = begin_track(hand.statistics, one, points), True
                frame.free[one.rows[one.rows >= 0]] = False

    def _note_side(self, hand: _Hand, frame: Cloud, lead: float, found: Finding) -> None:
        """Add to a hand's side evidence the cost lead of the mirrored hand on its points.

        The mirrored hand may take free points nearby, but must share more than half of the points.

        Parameters
        ----------
        hand : _Hand
        frame : Cloud
        lead, found
            Of `_mirrored_lead`, by its own points.
        """
        assert hand.track is not None
        self._has_reviewed = True
        rows = hand.track.finding.rows
        mine = rows[rows >= 0]
        free = frame.free & _near(frame.points, hand.track.finding)
        by_pairs = not palm_is_seen(hand.statistics, rows)
        if free.any() and hand.count <= MOST_CHECKED:
            other, wider = self._mirrored_lead(hand, frame.points, by_pairs, free)
            other -= FOREIGN_COST * (count_seen(wider.rows) - _count_common(wider, mine))
            if 2 * _count_common(wider, mine) > len(mine) and other > lead:
                lead, found = other, wider
        if lead > 0.:
            # Wrong labels say little of the side: compare with the hand labelled anew.
            anew = _labelled_as(hand.statistics, hand.track, frame.points, by_pairs, free)
            if 2 * _count_common(anew, mine) > len(mine):
                lead -= max(hand.track.finding.cost[0] - anew.cost[0], 0.)
        hand.side.add(lead, hand.track, found, frame.points, hand.confirmed)

    def _mirrored_lead(self, hand: _Hand, points: np.ndarray, by_pairs: bool,
                       free: np.ndarray | None = None) -> tuple[float, Finding]:
        """Return the cost lead of the mirrored hand on a found hand's points, and its labelling.

        The mirrored hand may take `free` points, too.
        """
        assert hand.track is not None
        found = _labelled_as(hand.mirrored, hand.track, points, by_pairs, free)
        return float(hand.track.finding.cost[0] - found.cost[0]), found

    def label_frame(self, points: ArrayLike, budget: int = sys.maxsize) -> CloudLabels:
        """Label the points of a single frame, without history but for learned postures.

        Parameters
        ----------
        points : array_like, shape (n, 3)
            In any order [m].
        budget : int, optional
            Distances of points from markers that each search may take; beyond, no hand is found.

        Returns
        -------
        CloudLabels
        """
        all_points = _with_hidden(points)
        cloud = all_points[:-1]
        best = self._found_together(cloud, np.isfinite(cloud).all(axis=1), budget)
        if best is None:
            best = [blank_finding(hand.count) for hand in self._hands]
        return CloudLabels(tuple(one.rows for one in best),
                           tuple(all_points[one.rows] for one in best),
                           tuple(bool(one.cost[0] < np.inf) for one in best),
                           tuple(False for _ in best))

    def frame_cost(self, points: ArrayLike, budget: int) -> float | None:
        """Return the cost of the hands in a single frame, below 0 where any is found [variances].

        Parameters
        ----------
        points : array_like, shape (n, 3)
            In any order [m].
        budget : int
            Distances of points from markers that each search may take.

        Returns
        -------
        float or None
            None beyond the budget.
        """
        cloud = _with_hidden(points)[:-1]
        found = self._found_together(cloud, np.isfinite(cloud).all(axis=1), budget)
        return None if found is None else _total_cost(found)

    def _found_together(self, points: np.ndarray, free: np.ndarray,
                        budget: int) -> list[Finding] | None:
        """Search all hands jointly in a frame, at the least total cost; None beyond a budget.

        A hand that is not found is a `blank_finding`.
        """
        best: list[Finding] = []
        least = np.inf
        searched: dict[tuple[int, bool], tuple[np.ndarray, Finding]] = {}

        def search(i: int, by_pairs: bool, left: np.ndarray) -> Finding | None:
            if (before := searched.get((i, by_pairs))) is not None:
                among, found = before
                # In practice, as it was the best among more points and took none of the others.
                if (found.cost[0] < np.inf and not (left & ~among).any()
                        and left[found.rows[found.rows >= 0]].all()):
                    return found
            found = blank_finding(self._hands[i].count)
            if _search_points(self._hands[i].statistics, points, left, 0, budget, found,
                              by_pairs) < len(points):
                return None
            searched.setdefault((i, by_pairs), (left.copy(), found))
            return found

        # Each among all points first: what is found there serves the orders after.
        for i in range(len(self._hands)):
            if search(i, False, free) is None:
                return None
        for order in permutations(range(len(self._hands))):
            left = free.copy()
            found = [blank_finding(hand.count) for hand in self._hands]
            # Pairs of palm markers where triangles found no hand, among the points left.
            for by_pairs in (False, True):
                for i in order:
                    if found[i].cost[0] < np.inf:
                        continue
                    alone = search(i, by_pairs, left)
                    if alone is None:
                        return None
                    if _is_typical(self._hands[i].statistics, alone):
                        found[i] = alone
                        left[alone.rows[alone.rows >= 0]] = False
            total = _total_cost(found)
            if total < least:
                least, best = total, found
        return best


def kernel_calls() -> tuple[tuple[Callable[..., Any], tuple[tuple[Any, ...], ...]], ...]:
    """Return each kernel of a labeller with sample arguments, to compile or load it.

    `follow_cloud` has those of one hand and of two.
    """
    prototype = model_prototype(Hand.scaled(), MarkerLayout(), MARKERS).statistics
    count = len(prototype.template)
    points, free = prototype.template.copy(), np.ones(count, dtype=bool)
    found, clutter, candidates = blank_finding(count), no_clutter(count), blank_candidates()
    track, cloud = begin_track(prototype, found, points), new_cloud(points, np.full(count, -1))
    last = no_points()
    return (
        (start_places, ((prototype, points, track),)),
        (renew_places, ((prototype, points, track),)),
        (continue_clutter, ((clutter, last, UNTIMED_STEP, cloud, UNTIMED_STEP),)),
        (follow_cloud, tuple(((prototype,) * hands, (track,) * hands, clutter, last, cloud,
                              np.zeros(hands, dtype=np.int64), (UNTIMED_STEP,) * 2, 1.,
                              np.zeros(hands, dtype=bool)) for hands in (1, 2))),
        (search_palms, ((prototype, points, free, 0, 1, candidates),)),
        (label_candidates, ((prototype, points, free, candidates, found),)),
        (search_pairs, ((prototype, points, free, 0, 1, candidates),)),
        (label_pairs, ((prototype, points, free, candidates, found),)),
        (palm_is_seen, ((prototype, found.rows),)),
        (count_seen, ((found.rows,),)),
    )


def compile_kernels() -> None:
    """Compile the kernels of a labeller of one hand or two."""
    for each, calls in kernel_calls():
        for arguments in calls:
            each(*arguments)


def load_kernels(folder: Path | None = None) -> None:
    """Load the compiled kernels of labellers from disk; any thread may call this.

    Parameters
    ----------
    folder : Path, optional
        Cache folder; the user's when left out.

    Raises
    ------
    KernelsUnavailable
        If they are not on disk.
    """
    for each, (arguments, *others) in kernel_calls():
        load_kernel(each, arguments, folder, others)
