"""Report of a fit: residuals of markers, deviations of parameters, unobserved movements."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ..core.model.hand import DIGITS
from ..core.model.marker_layout import MARKERS
from ..core.numerics.sampling import evenly_spaced
from .digit_chain import (
    BONE_PART,
    COUPLING_PART,
    FIRST_OFFSET,
    LEAN_PART,
    ROOT_PART,
)
from .digit_fit import DigitFit, fit_postures, posture_starts
from .marker_fit import FIT_STEPS, MarkerFit, fit_gathered
from .natural_flexion import FlexionLine
from .palm_template import ELSEWHERE, TOLD_SHARE, PalmFit
from .takes import WRONG_MARKERS, Gathered, InvalidTake

OBSERVED_SHARE = .7      # of the spread known before; with a larger deviation nothing was observed
OBSERVED_DEVIATION = .002  # [m] of a length; with a larger one it is not known either
FRAME_DEVIATION = .003     # [m] of the wrist's frame, by the heights of the palm's markers
HELD_OUT_BLOCK = 1.      # [s] of the parts of a take that are not fitted
HELD_OUT_EVERY = 5       # block of a take
HELD_OUT_FRAMES = 200    # judged, evenly spaced
# [m] that markers are off the hand in frames that were not fitted, in the mean over all; ours.
WELL_FITTED, ROUGHLY_FITTED = .0025, .005
EACH_WELL_FITTED = .005  # [m] that one of them is, of a hand that fits well; ours
FEW_STRAYS = .05         # share of the frames with a marker elsewhere that do not count; ours
MOST_MISS = .01          # [m] beyond which it is another marker than its label says; ours
BONE_NAMES = {'finger': ('proximal phalanx', 'middle phalanx', 'distal phalanx'),
              'thumb': ('metacarpal', 'proximal phalanx', 'distal phalanx')}
AXIS_NAMES = ('along the bone', 'to the thumb\'s side', 'dorsal')
METRES, RADIANS, PLAIN_NUMBER = 'mm', 'degrees', ''


class FittedParameter(NamedTuple):
    """A fitted parameter.

    Attributes
    ----------
    digit, name, kind : str
        `kind` is that of several names.
    value, deviation, before : float
        Value, its standard deviation, and that before the take, in the unit.
    unit : {'mm', 'degrees', ''}
    observed : bool
        Whether the take determined it.
    advice : str
        Movement to observe it.
    """

    digit: str
    name: str
    kind: str
    value: float
    deviation: float
    before: float
    unit: str
    observed: bool
    advice: str


class MarkerResidual(NamedTuple):
    """Distances of a marker from its place on the fitted hand.

    Attributes
    ----------
    marker : str
    fitted, held_out : float
        Means over fitted frames, and over frames that another fit did not see, without those
        with the marker elsewhere where these are few; NaN where there are none [m].
    elsewhere : float
        Share of these frames in which it is more than `ELSEWHERE` off.
    """

    marker: str
    fitted: float
    held_out: float
    elsewhere: float = 0.

    @property
    def miss(self) -> float:
        """That of the frames not fitted, else that of the fitted ones [m]."""
        return self.held_out if np.isfinite(self.held_out) else self.fitted


class FitReport(NamedTuple):
    """Report of a fit.

    Attributes
    ----------
    residuals : list of MarkerResidual
    parameters : list of FittedParameter
    """

    residuals: list[MarkerResidual]
    parameters: list[FittedParameter]

    def lines(self) -> list[str]:
        """Return the report as lines of text, without the single parameters."""
        found = ['marker          distance from its place on the fitted hand, mm',
                 '                fitted  not fitted']
        for residual in self.residuals:
            found.append(f'{residual.marker:16s}{_millimetres(residual.fitted):>6s}'
                         f'{_millimetres(residual.held_out):>12s}')
        found += [f'{one.marker} is more than {1e3 * ELSEWHERE:.0f} mm off in '
                  f'{one.elsewhere:.0%} of the frames: a ghost, or the label of another marker'
                  for one in self.residuals if one.elsewhere > TOLD_SHARE]
        unobserved = self.unobserved()
        return found + ['', *unobserved] if unobserved else found

    def table(self) -> list[str]:
        """Return the parameters as lines of text."""
        found = [f'{"parameter":44s}{"value":>8s}{"sd":>7s}{"before":>7s}']
        for one in self.parameters:
            scale = f'{one.value:8.2f}{one.deviation:7.2f}{one.before:7.2f} {one.unit}'
            found.append(f'{one.digit + " " + one.name:44s}{scale:32s}'
                         f'{"" if one.observed else "not observed"}'.rstrip())
        return found

    def verdict(self) -> str:
        """Return the verdict: fit to the frames left out, and share of parameters observed."""
        judged = [one.held_out for one in self.residuals if np.isfinite(one.held_out)]
        observed = sum(one.observed for one in self.parameters)
        usual = ('as expected with eight markers: ' if len(self.residuals) <= len(MARKERS)
                 and observed < len(self.parameters) else '')
        share = (f'{usual}{observed} of {len(self.parameters)} parameters are known by the takes, '
                 'the others are as on other hands of this size')
        if not judged:
            return f'the takes are too short to judge the fit; {share}'
        miss = float(np.mean(judged))
        most = float(np.nanmax([one.miss for one in self.residuals]))
        fits = ('well' if miss <= WELL_FITTED and most <= EACH_WELL_FITTED else
                'roughly' if miss <= ROUGHLY_FITTED and most <= MOST_MISS else 'badly')
        worst = '' if most <= EACH_WELL_FITTED else ', ' + self._worst(EACH_WELL_FITTED)
        cure = f' ({WRONG_MARKERS})' if fits == 'badly' else ''
        return (f'the hand fits {fits}: frames that were not fitted are {1e3 * miss:.1f} mm off it '
                f'in the mean{worst}{cure}; {share}')

    def require_fitted(self, named: str) -> None:
        """Refuse a fit to which a marker cannot belong.

        Parameters
        ----------
        named : str
            The takes.

        Raises
        ------
        InvalidTake
            Naming the markers.
        """
        if any(one.miss > MOST_MISS for one in self.residuals):
            raise InvalidTake(f'{named}: {self._worst(MOST_MISS)} off the hand that fits best, in '
                              f'the mean; expected {1e3 * MOST_MISS:.0f} mm at most: '
                              f'{WRONG_MARKERS}')

    def _worst(self, least: float) -> str:
        """Return the markers with a miss above the least [m], the worst first, in words."""
        worst = sorted((one for one in self.residuals if one.miss > least),
                       key=lambda one: -one.miss)
        return ', '.join(f'{one.marker} {1e3 * one.miss:.1f} mm' for one in worst)

    def unobserved(self) -> list[str]:
        """Return what the takes do not show, by kind and digit, and what would show it."""
        kinds: dict[tuple[str, str], list[str]] = {}   # by advice and digit
        for one in self.parameters:
            if not one.observed:
                of_digit = kinds.setdefault((one.advice, one.digit), [])
                if one.kind not in of_digit:
                    of_digit.append(one.kind)
        digits: dict[tuple[str, str], list[str]] = {}  # by advice and kinds
        for (advice, digit), names in kinds.items():
            digits.setdefault((advice, ', '.join(names)), []).append(digit)
        return ['as on other hands, wholly or in part, and what would show it:', *(
            f'  {", ".join(who)}: {what}; {advice}'
            for (advice, what), who in digits.items())] if digits else []


def report_fit(fit: MarkerFit, gathered: Gathered, rate: float,
               done: Callable[[], None] = lambda: None) -> FitReport:
    """Return the report of a fit; a second one, to most of the takes, is judged on the rest.

    Parameters
    ----------
    fit : MarkerFit
    gathered : Gathered
        The takes of the fit.
    rate : float
        [Hz]
    done : callable, optional
        Called after each of `FIT_STEPS` parts of the work.

    Returns
    -------
    FitReport
    """
    block = max(1, round(HELD_OUT_BLOCK * rate))
    held = np.arange(len(gathered.points)) // block % HELD_OUT_EVERY == HELD_OUT_EVERY - 1
    unseen: dict[str, np.ndarray] = {}   # by the other fit
    if held.any():
        most = fit_gathered(gathered._replace(points=gathered.points[~held]), fit.hand.side,
                            done=done)
        rest = gathered.points[held]
        rest = rest[evenly_spaced(len(rest), HELD_OUT_FRAMES)]
        unseen = marker_distances(most, gathered._replace(points=rest))
    else:
        for _ in range(FIT_STEPS):
            done()
    chosen = gathered.points[evenly_spaced(len(gathered.points), HELD_OUT_FRAMES)]
    fitted = marker_distances(fit, gathered._replace(points=chosen))
    gathered = gathered._replace(markers=fit.markers)
    return FitReport(
        [_residual(name, distances, unseen.get(name, np.empty(0)))
         for name, distances in fitted.items()],
        [parameter for digit, one in enumerate(fit.digits) if one is not None
         for parameter in (*_parameters(digit, one, gathered, fit.palm),
                           *_flexion_parameters(digit, fit.flexions[digit]))])


def _residual(marker: str, fitted: np.ndarray, held_out: np.ndarray) -> MarkerResidual:
    seen = np.concatenate((fitted, held_out))
    elsewhere = np.count_nonzero(seen > ELSEWHERE) / max(np.isfinite(seen).sum(), 1)
    if elsewhere <= FEW_STRAYS:
        # They are told of, and are not the hand's.
        fitted, held_out = (one[~(one > ELSEWHERE)] for one in (fitted, held_out))
    return MarkerResidual(marker, _mean(fitted), _mean(held_out), float(elsewhere))


def marker_misses(fit: MarkerFit, gathered: Gathered) -> dict[str, float]:
    """Return the mean distance of each marker from its place, as `marker_distances` [m]."""
    return {name: _mean(found) for name, found in marker_distances(fit, gathered).items()}


def marker_distances(fit: MarkerFit, gathered: Gathered) -> dict[str, np.ndarray]:
    """Return the distances of each marker from its place, postures by all markers, (n,) [m]."""
    gathered = gathered._replace(markers=fit.markers)
    local = fit.palm.into_palm(gathered.names, gathered.points)
    found = {gathered.names[i]: np.linalg.norm(
        local[:, i] - fit.palm.places[gathered.names[i]], axis=1) for i in gathered.of(-1)}
    for digit, one in enumerate(fit.digits):
        if one is None:
            continue
        columns = gathered.of(digit)
        problem = one.problem._replace(points=local[:, columns], weight=1.)
        starts = posture_starts(DIGITS[digit] == 'thumb', problem.posture)
        _, misses = fit_postures(problem, one.shape, starts)
        found.update((gathered.markers[i].name, misses[:, k])
                     for k, i in enumerate(columns))
    return found


def _parameters(digit: int, fit: DigitFit, gathered: Gathered,
                palm: PalmFit) -> list[FittedParameter]:
    """Return the parameters of a digit."""
    name = DIGITS[digit]
    kind = 'thumb' if name == 'thumb' else 'finger'
    markers = [gathered.markers[i] for i in gathered.of(digit)]
    alone = ('move the thumb to every finger and in circles' if kind == 'thumb' else
             'bend each finger alone, in its knuckle and in its middle joint')
    worn_only = len(markers) == 1
    more = f'{alone}, with more markers on it' if worn_only else alone
    spread = ('circle with the thumb' if kind == 'thumb'
              else 'spread the fingers while they are straight and while they are bent')
    has_tip = any(marker.link == 2 for marker in markers)
    tip = more if has_tip else 'this needs a marker at the tip, or a ruler'
    root = 'CMC' if kind == 'thumb' else 'MCP'
    axes = 'ahead', 'to the thumb\'s side', 'dorsal'
    knuckle = palm.places.get(f'{name}_{root.lower()}')
    entries: list[tuple[int, str, str, str, str]] = [
        (ROOT_PART.start + k, f'{root} {axis} of ' + (
            'the wrist' if knuckle is None else 'its marker'), f'place of the {root}', METRES, more)
        for k, axis in enumerate(axes)]
    entries += [(LEAN_PART.start + k, f'abduction axis leaning {axis}', 'lean of the abduction '
                 'axis', RADIANS, spread) for k, axis in enumerate(('ahead', 'aside'))]
    entries += [(BONE_PART.start + k, bone, 'last bone' if k == 2 else 'bones', METRES,
                 tip if k == 2 else more) for k, bone in enumerate(BONE_NAMES[kind])]
    last = 'IP' if kind == 'thumb' else 'DIP'
    coupling = f'coupling of the {last}'
    entries += [(COUPLING_PART.start, f'{last} coupling slope', coupling, PLAIN_NUMBER, tip),
                (COUPLING_PART.start + 1, f'{last} coupling offset', coupling, RADIANS, tip)]
    for i, marker in enumerate(markers):
        place = marker.name.removeprefix(f'{name}_').upper().replace('TIP', 'tip')
        entries += [(FIRST_OFFSET + 3 * i + k, f'{place} offset {axis}', 'offset of the marker'
                     if worn_only else 'offsets of markers', METRES, more)
                    for k, axis in enumerate(AXIS_NAMES)]
    found = []
    for row, label, what, unit, advice in entries:
        factor = {METRES: 1e3, RADIANS: 180. / np.pi, PLAIN_NUMBER: 1.}[unit]
        deviation, before = fit.deviations[row], fit.problem.prior.spread[row]
        if row < ROOT_PART.stop and knuckle is None:
            # The wrist's frame is as uncertain as the places of its markers.
            deviation, before = np.hypot((deviation, before), FRAME_DEVIATION)
        value = fit.shape[row]
        if row < ROOT_PART.stop and knuckle is not None:
            value = value - knuckle[row]
        found.append(FittedParameter(
            name, label, what, float(factor * value), float(factor * deviation),
            float(factor * before), unit, bool(
                deviation <= OBSERVED_SHARE * before
                and (unit != METRES or deviation <= OBSERVED_DEVIATION)), advice))
    return found


def _flexion_parameters(digit: int, line: FlexionLine | None) -> list[FittedParameter]:
    """Return slope and offset of a digit's second flexion over the first."""
    if line is None:
        return []
    names = 'MCP beside CMC' if DIGITS[digit] == 'thumb' else 'PIP beside MCP'
    return [FittedParameter(
        DIGITS[digit], f'{names}, {name}', names, float(factor * value), float(factor * deviation),
        float(factor * before), unit, bool(deviation <= OBSERVED_SHARE * before),
        'move it as you do at work') for name, unit, factor, value, deviation, before in zip(
            ('slope', 'offset'), (PLAIN_NUMBER, RADIANS), (1., 180. / np.pi), line.row,
            line.deviations, line.before)]


def _mean(values: np.ndarray) -> float:
    """Return the mean of the finite numbers; NaN if there are none."""
    values = values[np.isfinite(values)]
    return float(values.mean()) if len(values) else float('nan')


def _millimetres(value: float) -> str:
    return '–' if np.isnan(value) else f'{1e3 * value:.2f}'


def average_rate(rates: Sequence[float]) -> float:
    """Return the rate of takes together [Hz]."""
    return float(np.mean(rates))
