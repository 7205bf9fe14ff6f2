"""Fit a person's hand, and where the markers are on it, to takes of markers on the skin.

The palm's markers give its frame. In it each digit is fitted by itself (`digit_fit`); the digits
share the hand's length, which their bones determine together.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ..core.model.hand import (
    DIGITS,
    FINGERS,
    FLEXION_JOINTS,
    HAND_LENGTH_RANGE,
    WEARER_LIMITS,
    Hand,
    average_natural_flexion,
)
from ..core.model.marker_layout import PALM_LANDMARKS, MarkerLayout
from ..core.numerics.sampling import evenly_spaced
from .digit_chain import BONE_PART, ROOT_PART
from .digit_fit import (
    FIRST_NOISE,
    LEAST_WITHIN_REACH,
    MOST_STRAYS,
    DigitFit,
    chosen_problem,
    fit_digit,
    fit_postures,
    posture_starts,
    within_reach,
)
from .digit_priors import Marked, digit_chain, digit_posture, digit_prior
from .fitted_hand import (
    FittedDigit,
    MarkerMount,
    fitted_hand,
    marker_layout,
    mount_markers,
)
from .marker_names import NamedMarker, is_knuckle, riding
from .marker_residuals import DigitProblem
from .natural_flexion import FlexionLine, fit_flexion_line
from .palm_synergy import fit_palm_synergy
from .palm_template import ELSEWHERE, PalmFit, aligned_palm, fit_palm, rigid_poses
from .radii import thinned
from .ruler import RULER_SPREAD
from .takes import WRONG_MARKERS, Gathered, InvalidTake, MarkerTake, gather
from .worn_markers import worn_names

LENGTH_ROUNDS = 2        # fits of all digits, the hand's length estimated anew between them
FIT_STEPS = LENGTH_ROUNDS * len(DIGITS)
PALM_LENGTH_SPREAD = .05  # of the length by the palm, as a logarithm
MOST_LENGTH_STEP = .15
KNOWN_LENGTH_SPREAD = .02  # of a length by the bones, as a logarithm
POSTURE_FRAMES = 300     # evenly spaced, which show the range of motion
# Share of the noise that a worn marker is given in the fit: the tracker meets it, whatever the
# others say. Ours, from captures.
WORN_NOISE_SHARE = .5
MIN_PALM_FRAMES = 30
MIN_WHOLE_FRAMES = 50    # with all markers; else those with some missing show it too


class MarkerFit(NamedTuple):
    """A hand fitted to markers.

    Attributes
    ----------
    hand : Hand
    layout : MarkerLayout
        Of the worn markers.
    markers : tuple of NamedMarker
        Of the takes, with knuckles that move in the palm assigned to their digits.
    worn : tuple of str
        Names of the worn markers in the takes, in the order of `MARKERS`; '' where there is none.
    mounts : dict of str to MarkerMount
        Of all markers of the takes.
    palm : PalmFit
    digits : tuple of DigitFit or None
        None where a digit has no marker.
    flexions : tuple of FlexionLine or None
        None for a digit without a second marker on its bend.
    length, length_deviation : float
        Of the hand, by its palm and bones, and its standard deviation [m].
    postures : ndarray, shape (n, 25)
        Angles of the hand in frames of the takes, evenly spaced [rad].
    local : ndarray, shape (n, M, 3)
        Markers of these frames on the right hand, in the wrist's frame [m].
    """

    hand: Hand
    layout: MarkerLayout
    markers: tuple[NamedMarker, ...]
    worn: tuple[str, ...]
    mounts: dict[str, MarkerMount]
    palm: PalmFit
    digits: tuple[DigitFit | None, ...]
    flexions: tuple[FlexionLine | None, ...]
    length: float
    length_deviation: float
    postures: np.ndarray
    local: np.ndarray


def fit_markers(takes: Sequence[MarkerTake], limits: str = WEARER_LIMITS) -> MarkerFit:
    """Fit a hand and its markers' offsets to takes of markers.

    Parameters
    ----------
    takes : sequence of MarkerTake
        Of one hand with its markers left in place.
    limits : str, optional
        Preset of the joint limits; by default Table 1, widened to the fitted postures.

    Returns
    -------
    MarkerFit

    Raises
    ------
    InvalidTake
        If the palm is not seen.
    """
    gathered = gather(takes)
    return fit_gathered(gathered, takes[0].side, limits)


def fit_gathered(gathered: Gathered, side: str, limits: str = WEARER_LIMITS,
                 done: Callable[[], None] = lambda: None) -> MarkerFit:
    """Fit a hand to gathered markers as `fit_markers`; `done` is called `FIT_STEPS` times."""
    gathered, palm = split_palm(gathered)
    worn, ruler = worn_names(gathered.markers, palm.held), gathered.ruler
    fits: list[DigitFit | None] = [None] * len(DIGITS)
    length = palm.length
    for again in range(LENGTH_ROUNDS):
        if again:
            moved = aligned_palm(palm._replace(length=length), KNOWN_LENGTH_SPREAD)
            fits = [fit and _moved(fit, palm, moved) for fit in fits]
            palm = moved
        local = palm.into_palm(gathered.names, gathered.points)
        mean = Hand.scaled(palm.length, palm.breadth)
        for digit in range(len(DIGITS)):
            problem = _digit_problem(
                mean, digit, gathered, local, worn, length, palm, fits[digit])
            if problem is not None:
                fits[digit] = _fit_again(problem, digit, fits[digit])
            done()
        # Bones of measured fingers are not in proportion to the hand.
        measured = len(FINGERS) if ruler.fingers else 0
        length, deviation = hand_length(
            palm.length, length, fits[measured:],
            RULER_SPREAD if ruler.length else PALM_LENGTH_SPREAD)

    # Frames with all markers of every digit, so that a posture is of one moment.
    whole = np.flatnonzero(np.isfinite(local).all(axis=(1, 2)))
    if len(whole) < MIN_WHOLE_FRAMES:
        whole = np.arange(len(local))
    shown = local[whole[evenly_spaced(len(whole), POSTURE_FRAMES)]]
    digits, shown = _with_postures(fits, gathered, shown, worn)
    hand, postures = fitted_hand(Hand.scaled(length, palm.breadth), digits, side, limits)
    flexions = _flexion_lines(gathered, postures)
    hand = hand.replace(natural_flexion=[average if line is None else line.row for line, average
                                         in zip(flexions, hand.natural_flexion)])
    hand = hand.replace(palm_synergy=fit_palm_synergy(
        hand, {name: shown[:, gathered.names.index(name)] for name in palm.names}, postures))
    if len(postures):
        hand = thinned(hand, np.clip(postures, *hand.limits.T))
    names = [gathered.names[i] for i in gathered.of(-1)]
    mounts = mount_markers(hand, digits, {name: palm.places[name] for name in names})
    noise: dict[str, float] = {}
    for row, (found, fit, line) in enumerate(zip(digits, fits, flexions)):
        # Of the thumb's one marker nothing is gained by doubting it.
        if found is not None and fit is not None and (line is not None or row < len(FINGERS)):
            noise.update(zip(found.names, fit.problem.noise.tolist()))
    layout = marker_layout(hand, worn, mounts, noise)
    return MarkerFit(hand, layout, gathered.markers, worn, mounts, palm,
                     tuple(fits), flexions, length, deviation, postures, shown)


def split_palm(gathered: Gathered) -> tuple[Gathered, PalmFit]:
    """Assign knuckles that move in the palm to their digits; return the markers and the palm.

    Raises
    ------
    InvalidTake
        If the palm is not seen.
    """
    columns = gathered.of(-1)
    seen = np.isfinite(gathered.points[:, columns]).all(axis=2).sum(axis=1)
    if np.count_nonzero(seen >= 3) < MIN_PALM_FRAMES:
        raise InvalidTake(f'three markers of the palm are seen in {np.count_nonzero(seen >= 3)} '
                          f'frames; expected at least {MIN_PALM_FRAMES}, of markers such as wrist, '
                          'index_mcp and little_mcp')
    palm = fit_palm([gathered.markers[i].name for i in columns], gathered.points[:, columns],
                    gathered.usual, gathered.ruler)
    markers = list(gathered.markers)
    for i, rigid in zip(columns, palm.rigid):
        if not rigid:
            markers[i] = riding(markers[i])
    return gathered._replace(markers=tuple(markers)), palm


def hand_length(by_palm: float, length: float, fits: Sequence[DigitFit | None],
                palm_spread: float = PALM_LENGTH_SPREAD) -> tuple[float, float]:
    """Return the hand's length by its palm and by the fitted bones.

    A Gauss-Newton step of the length's logarithm beside all shapes, with the bones' usual lengths
    in proportion to it.

    Parameters
    ----------
    by_palm, length : float
        Length by the palm, and that of the priors of the fits [m].
    fits : sequence of DigitFit or None
    palm_spread : float, optional
        Of the length by the palm, as a logarithm.

    Returns
    -------
    length, deviation : float
        And its standard deviation [m].
    """
    precision = palm_spread ** -2.
    gradient = precision * np.log(by_palm / length)
    for fit in fits:
        if fit is None:
            continue
        prior = fit.problem.prior
        # Of the shape's prior by the length, in precisions.
        pull = np.zeros(len(prior.mean))
        pull[BONE_PART] = prior.mean[BONE_PART] / prior.spread[BONE_PART] ** 2
        gradient += pull @ (fit.shape - prior.mean)
        precision += pull[BONE_PART] @ prior.mean[BONE_PART] - pull @ fit.covariance @ pull
    step = float(np.clip(gradient / precision, -MOST_LENGTH_STEP, MOST_LENGTH_STEP))
    length = float(np.clip(length * np.exp(step), *HAND_LENGTH_RANGE))
    return length, length / np.sqrt(precision)


def _marked(gathered: Gathered, digit: int, worn: tuple[str, ...]) -> Marked:
    """Return the markers of a digit."""
    markers = [gathered.markers[i] for i in gathered.of(digit)]
    return Marked(tuple(marker.name for marker in markers),
                  np.array([marker.link for marker in markers], dtype=int),
                  np.array([is_knuckle(marker) for marker in markers], dtype=bool),
                  np.array([marker.name in worn for marker in markers], dtype=bool))


def _digit_problem(mean: Hand, digit: int, gathered: Gathered, local: np.ndarray,
                   worn: tuple[str, ...], length: float, palm: PalmFit,
                   before: DigitFit | None) -> DigitProblem | None:
    """Return the problem of a digit with its chosen frames; None if it has no marker."""
    columns = gathered.of(digit)
    if not columns:
        return None
    marked = _marked(gathered, digit, worn)
    problem = DigitProblem(
        digit_chain(mean, digit, marked.links), local[:, columns],
        np.full(len(columns), FIRST_NOISE), digit_posture(mean, digit, marked.links),
        digit_prior(mean, digit, marked, length, palm.places.get(f'{DIGITS[digit]}_mcp'),
                    gathered.ruler),
        np.where(marked.worn & (len(columns) > 1), WORN_NOISE_SHARE, 1.), 1.)
    is_placed = any(name in PALM_LANDMARKS for name in palm.names)
    reached = within_reach(problem, is_placed)
    seen, near = (np.isfinite(one.points).all(axis=2).sum(axis=0) for one in (problem, reached))
    for name, before_that, left in zip(marked.names, seen, near):
        if left < LEAST_WITHIN_REACH * before_that:
            raise InvalidTake(f'{name} is farther from the palm than the {DIGITS[digit]} reaches '
                              f'in {1. - left / before_that:.0%} of the frames: {WRONG_MARKERS}')
    chosen = chosen_problem(reached, DIGITS[digit] == 'thumb', before and before.shape)
    return chosen if len(chosen.points) else None


def _moved(fit: DigitFit, before: PalmFit, after: PalmFit) -> DigitFit:
    """Return a fit with its root where another frame of the palm has it."""
    rotation, position = rigid_poses(after.template[None], before.template)
    shape = fit.shape.copy()
    shape[ROOT_PART] = rotation[0] @ shape[ROOT_PART] + position[0]
    return fit._replace(shape=shape)


def _fit_again(problem: DigitProblem, digit: int, before: DigitFit | None) -> DigitFit:
    """Fit a digit, from its last fit where there is one."""
    starts = posture_starts(DIGITS[digit] == 'thumb', problem.posture)
    if before is None:
        return fit_digit(problem, starts)
    return fit_digit(problem._replace(noise=before.problem.noise), starts, before.shape, rounds=2)


def _with_postures(fits: Sequence[DigitFit | None], gathered: Gathered, local: np.ndarray,
                   worn: tuple[str, ...]) -> tuple[list[FittedDigit | None], np.ndarray]:
    """Return the digits with their postures in frames in which all markers are in place.

    And these frames, unless strays are so many that labels are wrong: then all.
    """
    found = []
    has_stray = np.zeros(len(local), dtype=bool)
    for digit, fit in enumerate(fits):
        if fit is None:
            continue
        problem = fit.problem._replace(points=local[:, gathered.of(digit)], weight=1.)
        postures, misses = fit_postures(
            problem, fit.shape, posture_starts(DIGITS[digit] == 'thumb', problem.posture))
        found.append((digit, postures))
        has_stray |= (misses > ELSEWHERE).any(axis=1)
    if np.count_nonzero(has_stray) > MOST_STRAYS * len(local):
        has_stray[:] = False
    digits: list[FittedDigit | None] = [None] * len(fits)
    for digit, postures in found:
        fit = fits[digit]
        assert fit is not None
        digits[digit] = FittedDigit(fit.problem.chain, fit.shape, _marked(
            gathered, digit, worn).names, postures[~has_stray])
    return digits, local[~has_stray]


def _flexion_lines(gathered: Gathered, postures: np.ndarray) -> tuple[FlexionLine | None, ...]:
    """Return the line of each digit's second flexion over the first in postures (n, 25)."""
    return tuple(
        fit_flexion_line(postures[:, FLEXION_JOINTS[digit, 0]],
                         postures[:, FLEXION_JOINTS[digit, 1]], average)
        if sum(not is_knuckle(gathered.markers[i]) for i in gathered.of(digit)) > 1 else None
        for digit, average in enumerate(average_natural_flexion()))
