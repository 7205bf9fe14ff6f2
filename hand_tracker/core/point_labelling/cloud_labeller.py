"""Labels for points without names: which point is which marker of which hand.

`CloudLabeller` owns the state: one or two hands that are searched, found and followed.
"""

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import permutations
from math import isfinite
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..model.hand import Hand
from ..model.marker_layout import MARKERS, MarkerLayout
from ..numerics.jit import load_kernel
from ..numerics.jit import loaded_or_plain as kernel
from .clutter import PointHistory, continue_clutter, no_clutter, remember_clutter
from .following import ASTRAY_DISTANCE, LEAST_FOLLOWED, follow_hands, relabel
from .hand_track import HandTrack, begin_track, start_places
from .natural_poses import model_prototype
from .pair_search import label_pairs, search_pairs
from .palm_search import (
    Finding,
    blank_candidates,
    blank_finding,
    label_candidates,
    palm_is_seen,
    search_palms,
)
from .prototypes import HandPrototype, Prototype

# Distances of points from markers in a frame's search of a hand: of one that is not found, of one
# whose labels are in doubt, and of one that is followed; ours.
SEARCH_BUDGET, PRESSING_BUDGET, DOUBT_BUDGET = 240_000, 60_000, 6_000
LONGEST_PAUSE = .25          # [s] after which nothing is followed
# Of a hand that is found, relative to the typical one, and of one by a pair of palm markers; ours.
ACCEPTED_DISTANCE, PAIR_DISTANCE = 1.5, .7
# Cost by which another labelling must be better, where it changes labels just given, and where
# these have long been the best; it counts once for each time in which postures change, up to
# some of them [variances, s]; ours.
RIVAL_MARGIN = 6.
TRUSTED_MARGIN = 200.
RIVAL_TIME = .1
RIVAL_TIMES = 4.
TRUST_TIME = 1.             # [s] in which labels that are the best become trusted; ours
RELABELLING_FRAMES = 6      # between two searches for another labelling
SEARCH_FRAMES = 36          # between two searches for another place of the palm
PRESSING_FRAMES = 2         # the same where the present one is in doubt
STILL_SEEN = .75            # of the markers seen before; with fewer the frame may be cut, ours
SHAKEN_TIME = .1            # [s] for which another labelling is then taken at once; ours
SHAKEN_MARGIN = 3.          # by which it must be better, in variances; ours
UNLIKELY = 1.5              # posture, relative to the typical, that puts labels in doubt; ours
NEWLY_SEEN_COST = 12.       # of each marker that another labelling of a followed hand sees more
RETURN_MARGIN = 18.         # by which one must be better that only sees more markers; ours
KNOWN_TIME = .4             # [s] for which a point of no hand is no rival's; ours
MIRROR_MARGIN = 6.            # by which the mirrored hand must not fit better; ours
UNTIMED_STEP = 1. / 120.     # [s]


@dataclass(frozen=True)
class LabellerOptions:
    """Options of the labeller.

    Parameters
    ----------
    patience : float
        Time after which a label that the others contradict is given up, and a hand that is not
        seen is lost [s].
    """

    patience: float = .2


class CloudLabels(NamedTuple):
    """Labels of a frame.

    Attributes
    ----------
    rows : tuple of ndarray of int, shape (M,)
        For each hand the point of each marker, -1 where it is hidden; all -1 where the hand is
        not found.
    found : tuple of bool
        Whether each hand is followed.
    other_side : tuple of bool
        Whether the last search of each found a hand of the other side instead.
    """

    rows: tuple[np.ndarray, ...]
    found: tuple[bool, ...]
    other_side: tuple[bool, ...]


class _Hand:
    """State of one hand: its prototype, track, and what its search has found."""

    def __init__(self, prototype: HandPrototype) -> None:
        self.prototype = prototype
        self.statistics: Prototype = prototype.statistics
        self.mirrored: Prototype = prototype.mirrored().statistics
        self.count = len(prototype.names)
        self.is_other_side = False
        self.by_pairs = False   # whether the search is by pairs of palm markers, not by three
        self.lose()

    def lose(self) -> None:
        """Drop the track; the hand is searched from the next frame on."""
        self.track: HandTrack | None = None
        self.confirmed = False
        self.searched = self.first = 0
        self.shaken_for = 0.
        # The first labels are checked soon.
        self.since_relabelling, self.since_search = RELABELLING_FRAMES, SEARCH_FRAMES


def _lead(rival: Finding, present: Finding, known: np.ndarray) -> float:
    """Return by how much a rival costs less than the present labels of a followed hand.

    Markers that are hidden are expected to stay so.
    """
    new = [*{*rival.rows.tolist()} - {*present.rows.tolist(), -1}]
    more = np.count_nonzero(rival.rows >= 0) - np.count_nonzero(present.rows >= 0)
    return float(present.cost[0] - rival.cost[0] - NEWLY_SEEN_COST * max(more, 0)
                 - known[new].sum())


def _trust(track: HandTrack, rival: Finding) -> float:
    """Return for how long a followed hand's labels have excluded another labelling [s].

    That is the longest time of all points that it gives to another marker, or to none.
    """
    owners = {row: i for i, row in enumerate(track.finding.rows.tolist()) if row >= 0}
    takers = {row: i for i, row in enumerate(rival.rows.tolist()) if row >= 0}
    return max((track.trusted_for[i, takers.get(row, i)] for row, i in owners.items()
                if takers.get(row) != i), default=0.)


def _search_points(prototype: Prototype, points: np.ndarray, free: np.ndarray, first: int,
                   palms: int, found: Finding, by_pairs: bool) -> int:
    """Search a hand from a point on, by three or by two markers of its palm.

    `found` is replaced by what is better; returned is how many first corners were tried.
    """
    candidates = blank_candidates()
    search, label = (search_pairs, label_pairs) if by_pairs else (search_palms, label_candidates)
    tried = kernel(search)(prototype, points, free, first, palms, candidates)
    kernel(label)(prototype, points, free, candidates, found)
    return tried


def _is_typical(prototype: Prototype, finding: Finding) -> bool:
    """Return whether a hand that was found is like those that were learned."""
    limit = ACCEPTED_DISTANCE if palm_is_seen(prototype, finding.rows) else PAIR_DISTANCE
    return bool(finding.distance[0] <= limit * max(prototype.typical, 1.))


class CloudLabeller:
    """Label points that have no names, or names that change.

    Parameters
    ----------
    prototypes : sequence of HandPrototype
        Of the hands to find, each once.
    options : LabellerOptions, optional

    Examples
    --------
    >>> labeller = CloudLabeller([prototype])
    >>> labels = labeller.update(points)  # points: (n, 3) [m], in any order
    >>> index = labels.rows[0][prototype.names.index('index')]
    """

    def __init__(self, prototypes: Sequence[HandPrototype],
                 options: LabellerOptions | None = None) -> None:
        self.options = LabellerOptions() if options is None else options
        self._hands = [_Hand(prototype) for prototype in prototypes]
        self._time: float | None = None
        counts = [hand.count for hand in self._hands]
        self._firsts = np.cumsum([0, *counts[:-1]])
        self._clutter = no_clutter(sum(counts))

    @property
    def prototypes(self) -> tuple[HandPrototype, ...]:
        """The hands' prototypes."""
        return tuple(hand.prototype for hand in self._hands)

    def reset(self) -> None:
        """Drop all hands."""
        self._time = None
        for hand in self._hands:
            hand.lose()

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
            By which the source distinguishes points, as a hint; negative where it does not.

        Returns
        -------
        CloudLabels

        Raises
        ------
        ValueError
            If a shape is another.
        """
        cloud = np.array(points, dtype=float)
        if cloud.size == 0:
            cloud = cloud.reshape(-1, 3)
        if cloud.ndim != 2 or cloud.shape[1] != 3:
            raise ValueError(f'points: shape {cloud.shape}; expected (n, 3)')
        names = np.full(len(cloud), -1) if ids is None else np.asarray(ids, dtype=np.int64)
        if names.shape != (len(cloud),):
            raise ValueError(f'ids: shape {names.shape}; expected {(len(cloud),)}')
        step = self._step(time)
        finite = np.flatnonzero(np.abs(cloud).max(axis=1, initial=0.) < 1e3)
        cloud, names = np.ascontiguousarray(cloud[finite]), names[finite]
        free = np.ones(len(cloud), dtype=bool)
        before, history = self._follow(cloud, names, free, step)
        self._search(cloud, free)
        found = [(hand.track.finding.rows, hand.track.finding.rows >= 0)
                 if hand.track is not None else None for hand in self._hands]
        for labels in filter(None, found):
            free[labels[0][labels[1]]] = False
        self._clutter = kernel(remember_clutter)(
            self._clutter, cloud, free, before, history, step)
        # Rows of all points, those that were left out among them.
        rows = tuple(np.where(labels[1], finite[labels[0]], -1)
                     if labels is not None and hand.confirmed and len(finite)
                     else np.full(hand.count, -1) for hand, labels in zip(self._hands, found))
        return CloudLabels(rows, tuple(hand.confirmed for hand in self._hands),
                           tuple(hand.is_other_side for hand in self._hands))

    def _step(self, time: float | None) -> float:
        """Return the time since the last frame; lose all where it is no step."""
        if time is None:
            return UNTIMED_STEP
        step = UNTIMED_STEP if self._time is None else time - self._time
        self._time = time
        if not 0. <= step <= LONGEST_PAUSE:
            for hand in self._hands:
                hand.lose()
            return UNTIMED_STEP
        return step or UNTIMED_STEP  # stamps that stand still give no step

    def _follow(self, points: np.ndarray, ids: np.ndarray, free: np.ndarray,
                step: float) -> tuple[np.ndarray, PointHistory]:
        """Follow the found hands; return the row in the clutter and the history of each point."""
        before, clutter = np.empty(len(points), dtype=np.int64), np.empty(len(points))
        history = kernel(continue_clutter)(self._clutter, points, step, before, clutter)
        firsts = [first for first, hand in zip(self._firsts, self._hands) if hand.track is not None]
        hands = [hand for hand in self._hands if hand.track is not None]
        if not hands:
            return before, history
        was = [(hand.track.hidden_for <= 0., hand.track.finding.distance[0])
               for hand in hands if hand.track is not None]
        kernel(follow_hands)(tuple(hand.statistics for hand in hands),
                     tuple(hand.track for hand in hands if hand.track is not None),
                     points, ids, clutter, history, np.array(firsts), step, free)
        come = np.count_nonzero(free & (clutter == -np.inf))
        for hand, (seen, distance) in zip(hands, was):
            assert hand.track is not None
            # Where the frame is cut, many go and as many come, or the posture leaps.
            gone = np.count_nonzero(seen & (hand.track.finding.rows < 0))
            leap = hand.track.finding.distance[0] - distance
            if (min(gone, come) >= max(2., (1. - STILL_SEEN) * np.count_nonzero(seen))
                    or leap > ASTRAY_DISTANCE * max(hand.statistics.typical, .5)):
                hand.shaken_for = SHAKEN_TIME
                hand.track.trusted_for[:] = 0.
            self._check(hand, points, free, step, clutter, history)
        return before, history

    def _check(self, hand: _Hand, points: np.ndarray, free: np.ndarray, step: float,
               clutter: np.ndarray, history: PointHistory) -> None:
        """Give up labels and hands that are contradicted; take a better labelling."""
        track = hand.track
        assert track is not None
        finding, patience = track.finding, self.options.patience
        seen = finding.rows >= 0
        few = np.count_nonzero(seen) < max(3., LEAST_FOLLOWED * hand.count)
        if track.astray_for[0] > patience or not isfinite(sum(finding.position.tolist())):
            hand.lose()
            return
        for i in (track.suspected_for > .5 * patience).nonzero()[0]:
            free[finding.rows[i]] = True
            finding.rows[i] = -1
            track.suspected_for[i] = 0.
            track.hidden_for[i] = step
        hand.since_relabelling += 1
        hand.since_search += 1
        unlikely = finding.distance[0] > UNLIKELY * max(hand.statistics.typical, .5)
        hand.shaken_for -= step
        shaken = hand.shaken_for > 0.
        pressing = few or unlikely or shaken
        if hand.since_relabelling < (PRESSING_FRAMES if pressing or track.doubt[0] > 0.
                                     else RELABELLING_FRAMES):
            return
        elapsed = hand.since_relabelling * step
        hand.since_relabelling = 0
        own = free.copy()
        own[finding.rows[finding.rows >= 0]] = True
        rival, exchanged = blank_finding(hand.count), blank_finding(hand.count)
        if not few:
            kernel(relabel)(hand.statistics, track, points, own, rival, exchanged)
        if len(points) and (pressing or hand.since_search >= SEARCH_FRAMES):
            hand.since_search = 0
            tried = self._find(hand, points, own, hand.first, rival,
                               SEARCH_BUDGET if shaken else
                               PRESSING_BUDGET if pressing else DOUBT_BUDGET)
            hand.first = (hand.first + tried) % len(points)
        # What it costs a rival to take points of no hand, less and less as they stay.
        known = np.maximum(clutter, 0.) * np.maximum(
            1. - history.age[:] / KNOWN_TIME, 0.)
        lead = _lead(rival, finding, known)
        if not few and _lead(exchanged, finding, known) > lead:
            rival, lead = exchanged, _lead(exchanged, finding, known)
        changed = (rival.rows != finding.rows) & seen
        # A palm is roughly placed by less than three markers: its cost alone says little.
        poor = (not palm_is_seen(hand.statistics, finding.rows)
                and (rival.rows >= 0).sum() <= seen.sum()
                and changed[hand.statistics.rigid > 0.].any())
        # Whether markers of a likely hand come back is better judged by how the points move.
        returns_alone = not (pressing or changed.any()) and lead < RETURN_MARGIN
        if (returns_alone or np.array_equal(rival.rows, finding.rows) or not lead > 0. or poor
                or rival.distance[0] > UNLIKELY * max(hand.statistics.typical, 1.)):
            track.doubt[0] = max(track.doubt[0] - RIVAL_MARGIN * elapsed / RIVAL_TIME, 0.)
            if not changed.any() or lead < 0.:
                track.trusted_for[seen] += elapsed
            return
        trust = min(_trust(track, rival) / TRUST_TIME, 1.)
        margin = SHAKEN_MARGIN if shaken else RIVAL_MARGIN + (TRUSTED_MARGIN - RIVAL_MARGIN) * trust
        track.doubt[0] = min(track.doubt[0] + lead * elapsed / RIVAL_TIME, RIVAL_TIMES * lead)
        if track.doubt[0] >= margin or (shaken and lead >= margin):
            free[finding.rows[finding.rows >= 0]] = True
            for part, new in zip(finding, rival):
                part[...] = new
            free[rival.rows[rival.rows >= 0]] = False
            kernel(start_places)(hand.statistics, points, track)
            track.doubt[0] = hand.shaken_for = 0.
            track.trusted_for[changed] = track.trusted_for[:, changed] = 0.

    def _search(self, points: np.ndarray, free: np.ndarray) -> None:
        """Search the hands that are not found, as far as a frame has time for it."""
        missing = [hand for hand in self._hands if not hand.confirmed]
        if not missing or len(points) < 3:
            return
        for hand in missing:
            own = free.copy()
            if hand.track is not None:
                own[hand.track.finding.rows[hand.track.finding.rows >= 0]] = True
            found = blank_finding(hand.count)
            tried = self._find(hand, points, own, hand.first, found, by_pairs=hand.by_pairs)
            hand.first = (hand.first + tried) % len(points)
            hand.searched += tried
            if found.cost[0] < (
                    hand.track.finding.cost[0] if hand.track is not None else np.inf):
                hand.track = begin_track(hand.statistics, found, points)
        for hand in missing:
            if hand.searched >= len(points):
                hand.searched = 0
                self._settle(hand, points)
                # Pairs next, where no three markers of the palm have placed it.
                hand.by_pairs = not (hand.confirmed or hand.by_pairs)

    def _find(self, hand: _Hand, points: np.ndarray, free: np.ndarray, first: int,
              found: Finding, budget: int | None = SEARCH_BUDGET, by_pairs: bool = False) -> int:
        """Search a hand, as far as a frame has time for it; all points where `budget` is None.

        `found` is replaced by what is better; returned is how many first corners were tried.
        """
        palms = sys.maxsize if budget is None else budget // (hand.count * len(points))
        return _search_points(hand.statistics, points, free, first, max(palms, 1), found, by_pairs)

    def _settle(self, hand: _Hand, points: np.ndarray) -> None:
        """Confirm what a whole search has found, or drop it."""
        if hand.track is None:
            return
        finding = hand.track.finding
        mine = finding.rows[finding.rows >= 0]
        rivals = [other for other in self._hands if other is not hand
                  and other.track is not None
                  and np.isin(other.track.finding.rows, mine).any()
                  and (other.confirmed
                       or other.track.finding.cost[0] < finding.cost[0])]
        whole = palm_is_seen(hand.statistics, finding.rows)
        lead = self._mirrored_lead(hand, points, mine, not whole)
        hand.is_other_side = lead > MIRROR_MARGIN
        # Two markers of the palm leave its side to the digits: these must decide it.
        if (rivals or lead > (MIRROR_MARGIN if whole else -MIRROR_MARGIN)
                or not _is_typical(hand.statistics, finding)):
            hand.lose()
            return
        hand.confirmed = True

    def _mirrored_lead(self, hand: _Hand, points: np.ndarray, mine: np.ndarray,
                       by_pairs: bool) -> float:
        """Return by how much a found hand's points cost less as a hand of the other side."""
        assert hand.track is not None
        own = np.zeros(len(points), dtype=bool)
        own[mine] = True
        found = blank_finding(hand.count)
        _search_points(hand.mirrored, points, own, 0, sys.maxsize, found, by_pairs)
        return float(hand.track.finding.cost[0] - found.cost[0])

    def label_frame(self, points: ArrayLike) -> CloudLabels:
        """Label the points of a single frame, without history and in as long as it takes.

        Parameters
        ----------
        points : array_like, shape (n, 3)
            In any order [m].

        Returns
        -------
        CloudLabels
        """
        cloud = np.ascontiguousarray(np.array(points, dtype=float))
        best: list[Finding] = []
        least = np.inf
        for order in permutations(range(len(self._hands))):
            free = np.isfinite(cloud).all(axis=1)
            found = [blank_finding(hand.count) for hand in self._hands]
            # Pairs where no three markers of the palm have placed it, by the points that are left.
            for by_pairs in (False, True):
                for i in order:
                    if found[i].cost[0] == np.inf:
                        found[i] = self._found_alone(self._hands[i], cloud, free, by_pairs)
                        free[found[i].rows[found[i].rows >= 0]] = False
            total = sum(min(one.cost[0], 0.) for one in found)
            if total < least:
                least, best = total, found
        return CloudLabels(tuple(one.rows for one in best),
                           tuple(bool(one.cost[0] < np.inf) for one in best),
                           tuple(False for _ in best))

    def _found_alone(self, hand: _Hand, points: np.ndarray, free: np.ndarray,
                     by_pairs: bool) -> Finding:
        """Return a hand in a single frame; blank where nothing is like it."""
        found = blank_finding(hand.count)
        self._find(hand, points, free, 0, found, None, by_pairs)
        return found if _is_typical(hand.statistics, found) else blank_finding(hand.count)


def kernel_calls() -> tuple[tuple[Callable[..., Any], tuple[tuple[Any, ...], ...]], ...]:
    """Return each kernel of a labeller with arguments like those of its calls.

    `follow_hands` has those of one hand and of two.
    """
    prototype = model_prototype(Hand.scaled(), MarkerLayout(), MARKERS).statistics
    count = len(prototype.template)
    points, free = prototype.template.copy(), np.ones(count, dtype=bool)
    rows, costs = np.full(count, -1), np.zeros(count)
    found, clutter, candidates = blank_finding(count), no_clutter(count), blank_candidates()
    track = begin_track(prototype, found, points)
    history = kernel(continue_clutter)(clutter, points, UNTIMED_STEP, rows, costs)
    return (
        (start_places, ((prototype, points, track),)),
        (continue_clutter, ((clutter, points, UNTIMED_STEP, rows, costs),)),
        (follow_hands, tuple(((prototype,) * hands, (track,) * hands, points, rows, costs,
                              history, rows, UNTIMED_STEP, free) for hands in (1, 2))),
        (remember_clutter, ((clutter, points, free, rows, history, UNTIMED_STEP),)),
        (relabel, ((prototype, track, points, free, found, found),)),
        (search_palms, ((prototype, points, free, 0, 1, candidates),)),
        (label_candidates, ((prototype, points, free, candidates, found),)),
        (search_pairs, ((prototype, points, free, 0, 1, candidates),)),
        (label_pairs, ((prototype, points, free, candidates, found),)),
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
