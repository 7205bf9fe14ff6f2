"""Unit and handedness of recorded points, and the side of a hand, found by the hand itself."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..core.model.hand import FINGERS, OTHER_SIDE
from ..core.numerics.sampling import every_few
from ..core.numerics.vectors import unit_vectors
from ..files.point_recording import UNIT_SPELLINGS, Axes, PointRecording, conversion_note
from .cloud_size import cloud_scale
from .hand_labels import PALM_WORDS, hand_labels

# [m] of grown-up hands: index to little knuckle, and wrist to knuckles.
KNUCKLE_BREADTH = .062
PALM_LENGTH = .088
# Points of a finger from its root to its tip.
CHAIN_PLACES = ('mcp', 'pip', 'middle', 'dip', 'tip')
BODY_SIZE = 1.7            # [m] of a grown-up, from head to feet or from hand to hand
SIZE_UNITS = ('m', 'dm', 'cm', 'mm')
CLOUD_UNITS = ('m', 'cm', 'mm', 'in')    # of points that may be of no hand
LIKELIER_UNITS = (*SIZE_UNITS, 'in')
METRIC_SIZE = 2.       # times as large or small as usual, up to which a unit is metric
SAMPLED_FRAMES = 500
SURE = .9                  # likelihood above which axes are taken for mirrored
LEAST_DOUBT = .02          # of a side that every frame shows
LEAST_HAND = 4             # points of a hand that is missed where it is left out
WRONG_SIZE = 2.5           # times as large or small as hands are, that is logged


class HandPoints(NamedTuple):
    """Points of one hand of a recording.

    Attributes
    ----------
    side : str
        As the labels say, empty where they do not.
    columns : mapping of str to int
        Column of each landmark.
    """

    side: str
    columns: Mapping[str, int]


def hands_of(recording: PointRecording) -> list[HandPoints]:
    """Return the hands that a recording's labels name, as `labelled_hands`."""
    return labelled_hands(recording.labels, recording.is_landmarks)


def names_other_hand(recording: PointRecording, side: str) -> bool:
    """Return whether a recording's labels name a hand of the other side; empty is none."""
    return any(side and hand.side == OTHER_SIDE[side] and len(hand.columns) >= LEAST_HAND
               for hand in hands_of(recording))


def labelled_hands(labels: Sequence[str], is_landmarks: bool = False) -> list[HandPoints]:
    """Return the hands that labels name, those with more points first.

    Parameters
    ----------
    labels : sequence of str
    is_landmarks : bool, optional
        Whether these are joint centres, not markers on the skin.

    Returns
    -------
    list of HandPoints
        Points whose label names no side are a hand of side ''; `columns_of` adds them.
    """
    found: dict[str, dict[str, int]] = {}
    for column, label in enumerate(hand_labels(labels, is_landmarks)):
        if label is not None:
            columns = found.setdefault(label.side, {})
            # A joint that a skeleton has in two parts, as THUMB_CMC_FE and _AA, ends in the last.
            if label.name not in columns or (is_landmarks and not label.name.endswith('_tip')):
                columns[label.name] = column
    return sorted((HandPoints(side, columns) for side, columns in found.items()),
                  key=lambda hand: -len(hand.columns))


def columns_of(hands: Sequence[HandPoints], side: str) -> dict[str, int]:
    """Return the columns of the hand of a side, with those of points whose labels name none."""
    by_side = {hand.side: hand.columns for hand in hands}
    return {**by_side.get('', {}), **by_side.get(side, {})}


def sided_hand(hands: Sequence[HandPoints], side: str | None) -> HandPoints | None:
    """Return the first hand whose labels name a side, this one if it is given."""
    return next((hand for hand in hands if hand.side and side in (None, hand.side)), None)


def side_likelihood(recording: PointRecording, hand: HandPoints) -> float:
    """Return the probability of a right hand by its shape, .5 where that is undecided.

    Fingers bend to the palm, so that back, fingers and thumb's side are those of a right hand or
    of its mirror image.

    Parameters
    ----------
    recording : PointRecording
    hand : HandPoints

    Returns
    -------
    float
        0 to 1.
    """
    points = _sampled(recording, hand)
    base = next((place for place in CHAIN_PLACES
                 if f'index_{place}' in points and f'little_{place}' in points), None)
    if base is None:
        return .5
    index, little = points[f'index_{base}'], points[f'little_{base}']
    lateral = index - little
    dorsal, distal = np.zeros_like(lateral), np.zeros_like(lateral)
    beyond = CHAIN_PLACES[CHAIN_PLACES.index(base) + 1:]
    for place in beyond:
        if f'index_{place}' in points and f'little_{place}' in points:
            outer = points[f'index_{place}'] - points[f'little_{place}']
            alike = np.einsum('ti,ti->t', outer, lateral)
            if np.count_nonzero(alike < 0.) > np.count_nonzero(alike > 0.):
                return .5   # exchanged labels, of knuckles say, mirror a hand
    for finger in FINGERS:
        chain = [points[name] for name in (f'{finger}_{place}' for place in CHAIN_PLACES)
                 if name in points]
        if len(chain) > 1:
            distal += np.nan_to_num(unit_vectors(chain[1] - chain[0]))
        for a, b, c in zip(chain, chain[1:], chain[2:]):
            dorsal += np.nan_to_num(b - (a + c) / 2.)
    palm = [point for name, point in points.items() if name.startswith(PALM_WORDS)]
    if 'wrist' in points or palm:
        middle = (index + little) / 2.
        along = middle - (points['wrist'] if 'wrist' in points else np.mean(palm, axis=0))
        distal = np.nan_to_num(unit_vectors(along))
        normal = unit_vectors(np.cross(along, lateral))
        for name, point in points.items():
            if name.endswith(beyond):
                height = np.einsum('ti,ti->t', point - middle, normal)
                dorsal -= np.nan_to_num(height[:, None] * normal)
    heights = np.einsum('ti,ti->t', np.cross(distal, lateral), dorsal)
    clear = heights[np.isfinite(heights) & (heights != 0.)]
    if not len(clear):
        return .5
    weights = np.abs(clear)
    return float(np.clip(weights[clear > 0.].sum() / weights.sum(), LEAST_DOUBT, 1. - LEAST_DOUBT))


def side_by_shape(recording: PointRecording, named: Mapping[str, int]) -> tuple[str, float]:
    """Return the likelier side of a hand by its shape.

    Parameters
    ----------
    recording : PointRecording
    named : mapping of str to int
        Column of each landmark that the labels do not tell.

    Returns
    -------
    side : str
        Empty where both are as likely.
    likelihood : float
        Of that side; of one above `SURE` there is no doubt.
    """
    unsided = columns_of(hands_of(recording), '')
    right = side_likelihood(recording, HandPoints('', {**unsided, **named}))
    return 'right' if right > .5 else 'left' if right < .5 else '', max(right, 1. - right)


def _hand_scale(recording: PointRecording, hand: HandPoints) -> float | None:
    """Return the size of a hand relative to the mean adult's; None if not observable [1]."""
    points = _sampled(recording, hand)
    sizes = []
    if 'index_mcp' in points and 'little_mcp' in points:
        sizes.append((points['index_mcp'] - points['little_mcp'], KNUCKLE_BREADTH))
    if 'wrist' in points:
        sizes += [(points[name] - points['wrist'], PALM_LENGTH)
                  for name in ('index_mcp', 'middle_mcp', 'ring_mcp') if name in points]
    ratios = []
    for vectors, usual in sizes:
        lengths = np.linalg.norm(vectors, axis=1)
        lengths = lengths[np.isfinite(lengths) & (lengths > 0.)]
        if len(lengths):
            ratios.append(float(np.median(lengths)) / usual)
    return float(np.median(ratios)) if ratios else None


def is_body(recording: PointRecording) -> bool:
    """Return whether a skeleton has wrists, and most of its joints are none of hands."""
    hands = hands_of(recording)
    return (any('wrist' in hand.columns for hand in hands)
            and 2 * sum(len(hand.columns) for hand in hands) < len(recording.labels))


def with_recognised_axes(recording: PointRecording, body_size: float | None = None,
                         is_scaled: bool = False) -> PointRecording:
    """Return a recording with unit and handedness by its hands, where its file names none.

    Parameters
    ----------
    recording : PointRecording
        Its points are changed.
    body_size : float, optional
        Of the whole body that it is of, which tells the unit instead, in the file's unit.
    is_scaled : bool, optional
        See `ReadingOptions`.

    Returns
    -------
    PointRecording
        With notes on what was recognised, or on what does not fit.
    """
    notes, axes = recording.notes, recording.axes
    scale, reason = _first_scale(recording), (
        f'as the hand is {KNUCKLE_BREADTH * 1e3:.0f} mm wide then, more or less')
    if body_size:
        scale = body_size * axes.scale / BODY_SIZE
        reason = f'as the body is {BODY_SIZE:g} m long then, more or less'
    if scale is not None and not recording.said.units:
        unit = likely_unit(scale / axes.scale)
        assumed = conversion_note(axes, recording.said)
        if unit != axes.units:
            _scale_points(recording, UNIT_SPELLINGS[unit][0] / axes.scale)
            axes = axes._replace(units=unit)
        notes = (*(note for note in notes if note != assumed),
                 conversion_note(axes, recording.said, reason))
    elif is_scaled:
        pass    # multiplied, they may well be of a hand's size
    elif scale is None and (spread := cloud_scale(recording)) and (
            unit := _likelier_unit_of_cloud(axes, spread)):
        notes += (f'the points are {float(f"{spread:.2g}"):g} times as far apart as the markers of '
                  f'a hand: is the file in {unit}, not in {axes.units}? (--units {unit})',)
    elif scale is not None and (unit := _likelier_unit(axes, scale)):
        times = float(f'{scale:.2g}')
        what = 'body' if body_size else 'hand'
        notes += (f'the {what} is {times:g} times as large as {what}s are: is the file in {unit}, '
                  f'not in {axes.units}? (--units {unit})',)
    for side in mirrored_hands(recording):
        if recording.format == 'BVH' and not recording.said.handed:
            for rows in recording.blocks():
                rows[..., 0] *= -1.
            axes = axes._replace(handed='left')
            notes += (f'left-handed axes, as the {side} hand is the image of one in a mirror '
                      '(--handed)',)
            break
        notes += (f'the {side} hand has the shape of the other one: other side, or left-handed '
                  'axes (--handed left)?',)
    return recording._replace(axes=axes, notes=notes)


def mirrored_hands(recording: PointRecording) -> Iterator[str]:
    """Yield the sides of the hands that are named as of one side, and have the other's shape."""
    for hand in _larger_hands(recording):
        side = hand.side or _side_of_name(recording.name)
        likelihood = side_likelihood(recording, hand)
        if side and (likelihood if side == 'left' else 1. - likelihood) >= SURE:
            yield side


def likelier_unit(recording: PointRecording) -> str:
    """Return the unit that gives the first hand a human size; empty if it has one already.

    Points without names are taken for those of a hand.
    """
    if scale := _first_scale(recording):
        return _likelier_unit(recording.axes, scale)
    spread = cloud_scale(recording)
    return '' if spread is None else _likelier_unit_of_cloud(recording.axes, spread)


def likely_unit(times: float) -> str:
    """Return the unit of what is so many times as large as usual, read in metres: mostly metric."""
    metric = nearest_unit(times, SIZE_UNITS)
    is_of_size = 1. / METRIC_SIZE <= times * UNIT_SPELLINGS[metric][0] <= METRIC_SIZE
    return metric if is_of_size else nearest_unit(times, LIKELIER_UNITS)


def nearest_unit(times: float, units: Iterable[str]) -> str:
    """Return the unit that makes what is so many times as large, read in metres, most usual."""
    return min(units, key=lambda name: abs(np.log(times * UNIT_SPELLINGS[name][0])))


def _likelier_unit_of_cloud(axes: Axes, scale: float) -> str:
    unit = _likelier_unit(axes, scale, CLOUD_UNITS)
    # Else the points may be of no hand.
    return unit if unit and _is_of_size(scale, axes, unit) else ''


def _likelier_unit(axes: Axes, scale: float, units: Sequence[str] = LIKELIER_UNITS) -> str:
    unit = nearest_unit(scale / axes.scale, units)
    return '' if _is_of_size(scale, axes, axes.units or 'm') or unit == axes.units else unit


def _is_of_size(scale: float, axes: Axes, unit: str) -> bool:
    """Return whether a hand has the size of hands, read in a unit."""
    return 1. / WRONG_SIZE < scale * UNIT_SPELLINGS[unit][0] / axes.scale < WRONG_SIZE


def _larger_hands(recording: PointRecording) -> list[HandPoints]:
    return [hand for hand in hands_of(recording) if len(hand.columns) > 2]


def _first_scale(recording: PointRecording) -> float | None:
    """Return the size of the first hand of which it is observable, see `_hand_scale`."""
    scales = (_hand_scale(recording, hand) for hand in _larger_hands(recording))
    return next(filter(None, scales), None)


def _scale_points(recording: PointRecording, factor: float) -> None:
    for rows in recording.blocks():
        rows *= recording.points.dtype.type(factor)


def _side_of_name(name: str) -> str:
    """Return the side that a file's name says, empty where it says none or both."""
    words = set(re.findall(r'right|left', name.lower()))
    return words.pop() if len(words) == 1 else ''


def _sampled(recording: PointRecording, hand: HandPoints) -> dict[str, np.ndarray]:
    """Return each landmark in some frames, shape (t, 3), the wrist as the mean of its markers."""
    some = every_few(recording.points, SAMPLED_FRAMES)
    points = {name: some[:, column].astype(float)
              for name, column in hand.columns.items()}
    wrists = [places for name, places in points.items() if 'wrist' in name]
    if wrists and 'wrist' not in points:
        points['wrist'] = np.mean(wrists, axis=0)
    return points
