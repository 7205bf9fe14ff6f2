"""Checks of takes before a fit: reasons to refuse them, and weaknesses."""

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from ..core.model.hand import DIGITS, FINGERS, OTHER_SIDE
from ..core.model.marker_layout import LANDMARKS_OF_DIGIT
from .hand_faults import KNUCKLE_DISTANCE, UNITS, bend_to_back, unit_of
from .layout_names import layout_hint
from .marker_fit import split_palm
from .palm_template import ELSEWHERE, OUT_OF_SHAPE, TOLD_SHARE, PalmFit
from .takes import Gathered, InvalidTake, MarkerTake, gather
from .worn_markers import PAPER_PALM, worn_names

LEAST_DURATION = 5.              # [s] of all takes together
KNUCKLES = 'index_mcp', 'little_mcp'
PALM_PAIRS = tuple(zip(PAPER_PALM, (*PAPER_PALM[1:], PAPER_PALM[0])))
MOST_CHANGE = .005               # [m] of a palm's distance from take to take, or in one; ours
LEAST_MOTION = .012              # [m] of a finger's marker in the palm, else it does not move
PALM_BEND = .008                 # [m] RMS by which a palm may differ from a rigid one
LEAST_SEEN = .3                  # share of the frames in which the worn markers must be seen
ACROSS = 'beside each other'
ORDER_MARGIN = .005              # [m] of markers in order, which right ones had 7.7 mm of
REACH_PERCENTILE = 95.           # of a marker's distances from the wrist; ours
LEAST_BEND = .03                 # [m] range of a finger's marker over the palm, of one take of many


def check_takes(takes: Sequence[MarkerTake]) -> list[str]:
    """Check takes of one hand before it is fitted.

    Parameters
    ----------
    takes : sequence of MarkerTake

    Returns
    -------
    list of str
        Weaknesses that are no reason to refuse.

    Raises
    ------
    InvalidTake
        With the reason.
    """
    sides = {take.side for take in takes}
    if len(sides) > 1:
        raise InvalidTake(f'{", ".join(take.name for take in takes)}: of both hands; '
                          'expected takes of one')
    named = ', '.join(take.name for take in takes)
    seconds = sum(len(take.points) / take.rate for take in takes)
    if seconds < LEAST_DURATION:
        raise InvalidTake(f'{named}: {seconds:.1f} s long; expected at least '
                          f'{LEAST_DURATION:g} s of a moving hand, best 40 s')
    gathered = gather(takes)
    there = gathered.names
    # A layout says where its markers of the palm are; else the knuckles decide.
    missing = [name for name in KNUCKLES if name not in there and not gathered.usual]
    if missing or len(gathered.of(-1)) < 3:
        raise InvalidTake(f'{named}: it has {", ".join(there) or "no markers of a hand"}; expected '
                          'at least wrist, index_mcp and little_mcp, or a '
                          f'--layout that names them{layout_hint(takes[0].names)}')
    _check_size(named, gathered)
    gathered, palm = split_palm(gathered)
    worn = worn_names(gathered.markers, palm.held)
    missing = [digit for digit, name in zip(DIGITS, worn[3:]) if not name]
    if missing or '' in worn:
        raise InvalidTake(f'{named}: no marker at the end of {", ".join(missing)}; it has '
                          f'{", ".join(there)}')
    out_of_shape = _check_palm(named, gathered, worn, palm)
    local = palm.into_palm(gathered.names, gathered.points)
    side = next(iter(sides))
    if len(takes) > 1:
        ends = np.cumsum([len(take.points) for take in takes])[:-1]
        for take, own in zip(takes, np.split(local, ends)):
            # One in which no finger bends that far shows no side.
            _check_side(take.name, side, gathered, worn, own, LEAST_BEND)
    _check_side(named, side, gathered, worn, local, LEAST_MOTION)
    weak = [*_other_palms(takes), *_check_motion(named, gathered, worn, local)]
    _check_order(named, gathered.names, worn, local)
    others = [f'{name} for {place}' for name, place in zip(worn, PAPER_PALM) if name != place]
    if others and not gathered.usual:   # else all markers are tracked
        weak.append(f'the palm of the hand file has {", ".join(others)}: what is tracked has to '
                    'have these markers, too')
    if out_of_shape > TOLD_SHARE:
        weak.append('markers of the palm are not at their distances in '
                    f'{out_of_shape:.0%} of the frames, where those elsewhere are left out: a '
                    'ghost, or the label of another marker')
    return weak


def _column(gathered: Gathered, name: str) -> int:
    return gathered.names.index(name)


def _check_size(named: str, gathered: Gathered) -> None:
    """Refuse markers in another unit than metres."""
    points = gathered.points
    if not set(KNUCKLES) <= set(gathered.names):
        return
    distance = float(np.nanmedian(np.linalg.norm(
        points[:, _column(gathered, KNUCKLES[0])] - points[:, _column(gathered, KNUCKLES[1])],
        axis=1)))
    if not np.isfinite(distance):
        raise InvalidTake(f'{named}: index and little knuckle are never seen together')
    unit = unit_of(distance)
    if unit not in ('', 'metres'):
        raise InvalidTake(f'{named}: the knuckles of index and little finger are {distance:.3g} '
                          f'apart: {unit}, it seems; expected metres (--unit-scale {UNITS[unit]}, '
                          'or that times the one given)')
    if not unit:
        raise InvalidTake(f'{named}: the knuckles of index and little finger are {distance:.3g} m '
                          f'apart; expected {KNUCKLE_DISTANCE[0]:g} to {KNUCKLE_DISTANCE[1]:g} m: '
                          'wrong labels, or another unit; markers of another layout are read by '
                          '--layout')


def _check_palm(named: str, gathered: Gathered, worn: tuple[str, ...], palm: PalmFit) -> float:
    """Refuse a palm of varying distances; return the share of the frames with others."""
    corners = [_column(gathered, name) for name in worn[:3]]
    seen = np.isfinite(gathered.points[:, corners]).all(axis=(1, 2))
    if seen.mean() < LEAST_SEEN:
        raise InvalidTake(f'{named}: {", ".join(worn[:3])} are seen together in {seen.mean():.0%} '
                          f'of the frames; expected at least {LEAST_SEEN:.0%}')
    misses = palm.misses(gathered.names, gathered.points)
    # Strays of single frames are left out.
    bend = np.sqrt(np.nanmean(np.minimum(misses, ELSEWHERE) ** 2, axis=0))
    if np.nanmax(bend) > PALM_BEND:
        moving = int(np.nanargmax(bend))
        raise InvalidTake(
            f'{named}: the palm is not rigid: {list(palm.held)[moving]} moves in it by '
            f'{1e3 * np.sqrt(np.nanmean(misses[:, moving] ** 2)):.0f} mm; expected less than '
            f'{1e3 * PALM_BEND:g}: wrong labels, or a marker that came off')
    return float(np.mean(np.nan_to_num(misses).max(axis=1) > OUT_OF_SHAPE))


def _other_palms(takes: Sequence[MarkerTake]) -> Iterator[str]:
    """Yield a line on each take whose palm has other distances than before."""
    first, usual = takes[0].name, _palm_distances(takes[0])
    for take in takes[1:]:
        if change := _changed_distance(usual, _palm_distances(take), first):
            yield f'{take.name}: {change}: another person, or markers put on anew?'
    for take in takes:
        halves = np.array_split(np.arange(len(take.points)), 2)
        before, after = (_palm_distances(take.part(half)) for half in halves)
        if change := _changed_distance(before, after, 'its first half'):
            yield f'{take.name}: in its second half {change}: did a marker slip?'


def _changed_distance(before: np.ndarray, after: np.ndarray, where: str) -> str:
    """Describe which distance of `PALM_PAIRS` has changed most [m]; empty where by too little."""
    change = np.nan_to_num(np.abs(after - before))
    worst = int(change.argmax())
    return '' if change[worst] <= MOST_CHANGE else (
        f'{" and ".join(PALM_PAIRS[worst])} are {1e3 * after[worst]:.0f} mm apart, '
        f'{1e3 * before[worst]:.0f} in {where}')


def _palm_distances(take: MarkerTake) -> np.ndarray:
    """Return the median distance of each of `PALM_PAIRS`, NaN where it is never seen [m]."""
    points = take.columns(PAPER_PALM)
    sides = np.linalg.norm(points - np.roll(points, -1, axis=1), axis=2)
    return np.array([np.median(side[np.isfinite(side)]) if np.isfinite(side).any() else np.nan
                     for side in sides.T])


def _check_motion(named: str, gathered: Gathered, worn: tuple[str, ...],
                  local: np.ndarray) -> list[str]:
    """Return the digits without motion; refuse still hands."""
    ends = local[:, [_column(gathered, name) for name in worn[3:]]]
    middle = np.nanmedian(ends, axis=0)
    spread = np.nanpercentile(np.linalg.norm(ends - middle, axis=2), 95., axis=0)
    if not (spread > LEAST_MOTION).any():
        raise InvalidTake(f'{named}: the hand does not move: no finger by more than '
                          f'{1e3 * np.nanmax(spread):.0f} mm in the palm; expected each finger '
                          'bent and straightened, and the thumb moved about')
    return [f'the {digit}{"" if digit == "thumb" else " finger"} hardly moves: what its markers '
            'could tell is taken from other hands'
            for digit, moved in zip(DIGITS, spread) if not moved > LEAST_MOTION]


def _check_order(named: str, names: list[str], worn: tuple[str, ...], local: np.ndarray) -> None:
    """Refuse markers whose order across the fingers, or along a digit, contradicts their labels.

    Along a digit alone only where two labels, exchanged, put all in order: a digit that is bent
    throughout ends nearer to the wrist than it reaches.

    Parameters
    ----------
    named, worn, local
        As of `_check_side`.
    names : list of str
        Of the markers.
    """
    seen = np.isfinite(local).all(axis=2).any(axis=0)
    names, local = [name for name, is_seen in zip(names, seen) if is_seen], local[:, seen]
    across = -np.nanmedian(local[..., 1], axis=0)
    # The farthest frames count, of stretched digits.
    reach = np.nanpercentile(np.linalg.norm(local, axis=2), REACH_PERCENTILE, axis=0)
    rows = [(across, row, ACROSS) for row in (
        worn[3:3 + len(FINGERS)], *([f'{finger}_{joint}' for finger in FINGERS]
                                    for joint in ('mcp', 'pip', 'dip', 'tip')))]
    rows += [(reach, (f'{digit}_{"cmc" if digit == "thumb" else "mcp"}', *places),
              'along the digit') for digit, places in LANDMARKS_OF_DIGIT.items()]
    pairs = [(values, pair, where) for values, row, where in rows
             for pair in combinations([name for name in row if name in names], 2)]

    def gaps(named_so: list[str]) -> list[tuple[float, tuple[str, str], str]]:
        """Return each pair's gap in order, the pair, and where."""
        return [(float(np.diff(values[[named_so.index(name) for name in pair]])[0]), pair, where)
                for values, pair, where in pairs]

    faults = [found for found in gaps(names) if not found[0] > 0.]
    if not faults:
        return

    def least_if_exchanged(two: tuple[str, str]) -> float:
        return min(gaps([{two[0]: two[1], two[1]: two[0]}.get(name, name) for name in names]))[0]

    _, pair, where = min(faults)
    placed = sorted({name for _, of_pair, _ in pairs for name in of_pair})
    likeliest = (pair if least_if_exchanged(pair) > ORDER_MARGIN else
                 max(combinations(placed, 2), key=least_if_exchanged))
    cause = f', {" and ".join(likeliest)} exchanged, it seems'
    if not least_if_exchanged(likeliest) > ORDER_MARGIN:
        cause, faults = '', [found for found in faults if found[2] == ACROSS]
        if not faults:
            return
        _, pair, where = min(faults)
    raise InvalidTake(f'{named}: {" and ".join(pair)} lie in the wrong order {where}: wrong labels'
                      f'{cause}; expected each marker with its own (--markers, --label)')


def _check_side(named: str, side: str, gathered: Gathered, worn: tuple[str, ...],
                local: np.ndarray, least: float) -> None:
    """Refuse fingers that bend to the back of the hand, as those of the other side seem to.

    Parameters
    ----------
    named : str
        Of the take, or of all.
    side : str
        Of the hand.
    gathered : Gathered
    worn : tuple of str
        The markers of the palm, and of each digit's end.
    local : ndarray, shape (frames, markers, 3)
        Of the take, in the palm's frame [m].
    least : float
        Range across the palm from which on a finger's marker counts [m].
    """
    across_palm = KNUCKLES if set(KNUCKLES) <= set(gathered.names) else worn[1:3]
    roots = local[:, [_column(gathered, name) for name in across_palm], 2]
    heights = local[:, [_column(gathered, name) for name in worn[3:3 + len(FINGERS)]], 2]
    if bend_to_back(heights, roots, least):
        other = OTHER_SIDE[side]
        raise InvalidTake(f'{named}: the fingers bend to the back of a {side} hand; expected '
                          f'a take of a {side} hand: this is a {other} one (--side {other}), '
                          f'two of {", ".join(worn[:3])} are exchanged, or an axis is mirrored '
                          '(--handed left)')
