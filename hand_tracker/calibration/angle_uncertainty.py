"""How well the worn markers tell the angles of a fitted hand: by tracking a take with it."""

from collections.abc import Iterator

import numpy as np

from ..core.model.hand import ABDUCTION_JOINTS, DIGITS, FINGERS, FLEXION_JOINTS, Hand
from ..core.model.marker_layout import MarkerLayout
from ..core.model.states import PalmState
from ..core.tracker import HandTracker

TRACKED_RATE = 30.      # [Hz] at least
TRACKED_FRAMES = 600    # of a take: some seconds tell it
FINGER_ANGLES = 'MCP abduction', 'MCP flexion', 'PIP', 'DIP'
THUMB_ANGLES = 'CMC abduction', 'CMC flexion', 'MCP', 'IP'


def angle_uncertainty(hand: Hand, layout: MarkerLayout, frames: np.ndarray,
                      rate: float) -> np.ndarray:
    """Return the standard deviation of each angle while its markers are seen, as tracked.

    Parameters
    ----------
    hand : Hand
    layout : MarkerLayout
    frames : ndarray, shape (T, n, 3)
        Of a take, in the order of the layout, NaN where not seen [m].
    rate : float
        [Hz]

    Returns
    -------
    ndarray, shape (25,)
        Root mean squares over the frames with the palm, NaN without any [rad].
    """
    step = max(1, int(rate // TRACKED_RATE))
    frames = frames[::step]
    # The part in which most markers are seen.
    seen = np.cumsum(np.isfinite(frames).all(axis=2).sum(axis=1))
    first = int(np.argmax(seen[TRACKED_FRAMES:] - seen[:-TRACKED_FRAMES])) + 1 if (
        len(frames) > TRACKED_FRAMES) else 0
    tracker = HandTracker(hand, layout)
    found = []
    for number, frame in enumerate(frames[first:first + TRACKED_FRAMES]):
        state = tracker.update(frame, number * step / rate)
        if state.palm is PalmState.TRACKED:
            found.append(state.deviation)
    return np.sqrt(np.mean(np.square(found), axis=0)) if found else np.full(
        len(hand.limits), np.nan)


def uncertainty_range(deviations: np.ndarray) -> str:
    """Return the least and the greatest standard deviation of `angle_uncertainty` in words."""
    moving = np.degrees(deviations[deviations > 0.])
    return ('its angles are not known, as the palm is not seen' if not len(moving) else
            f'its angles have standard deviations of {moving.min():.0f} to {moving.max():.0f} '
            'degrees')


def uncertainty_lines(deviations: np.ndarray) -> Iterator[str]:
    """Yield the standard deviations of `angle_uncertainty`, a line for each digit, in degrees."""
    if np.isnan(deviations).all():
        return
    yield 'standard deviation of the angles by the worn markers, degrees'
    degrees = np.degrees(deviations)
    for row, digit in enumerate(DIGITS):
        names = FINGER_ANGLES if digit in FINGERS else THUMB_ANGLES
        joints = ABDUCTION_JOINTS[row], *FLEXION_JOINTS[row]
        yield f'{digit:7s}' + ', '.join(
            f'{name} {degrees[joint]:.0f}' for name, joint in zip(names, joints))
