"""Check that landmarks are in the wrist's frame; name the axes of one that is turned."""

from __future__ import annotations

from itertools import permutations, product

import numpy as np

from ..calibration.landmarks import INDEX_MCP, LITTLE_MCP, MIDDLE_MCP, WRIST
from ..core.errors import HandTrackerError
from ..core.model.hand import OTHER_SIDE

MOST_TURNED_DEG = 40.   # of a frame that is still taken as it is
HAND_DIRECTIONS = ('distal', 'proximal'), ('radial', 'ulnar'), ('dorsal', 'palmar')
# dex-retargeting's axes x, y, z of a right hand in ours: out of the palm, to the thumb, distal.
DEX_AXES = np.array(((0., 0., 1.), (0., 1., 0.), (-1., 0., 0.)))


class TurnedHandFrame(HandTrackerError, ValueError):
    """Landmarks are in a frame other than the wrist's."""


def palm_axes(landmarks: np.ndarray, side: str) -> np.ndarray:
    """Return the palm's axes in the frame of its landmarks, columns x distal, y, z dorsal.

    Parameters
    ----------
    landmarks : ndarray, shape (21, 3)
        [m]
    side : {'right', 'left'}
    """
    wrist = landmarks[WRIST]
    x = landmarks[MIDDLE_MCP] - wrist
    across = landmarks[INDEX_MCP] - landmarks[LITTLE_MCP]
    z = np.cross(x, across) * (1. if side == 'right' else -1.)
    x, z = x / np.linalg.norm(x), z / np.linalg.norm(z)
    return np.column_stack((x, np.cross(z, x), z))


def turn_deg(axes: np.ndarray) -> float:
    """Return the angle of a rotation, shape (3, 3) [degrees]."""
    return float(np.degrees(np.arccos(np.clip(.5 * (np.trace(axes) - 1.), -1., 1.))))


def axes_in_words(axes: np.ndarray, side: str) -> str:
    """Return the directions of a frame's x, y and z in a hand, in words.

    Parameters
    ----------
    axes : ndarray, shape (3, 3)
        Columns: the hand's x distal, y and z dorsal in that frame.
    side : {'right', 'left'}
    """
    across = axes * (1., 1. if side == 'right' else -1., 1.)
    best = max(((order, signs) for order in permutations(range(3))
                for signs in product((1., -1.), repeat=3)),
               key=lambda one: sum(one[1][k] * across[k, one[0][k]] for k in range(3)))
    return ', '.join(f'{name} {HAND_DIRECTIONS[best[0][k]][0 if best[1][k] > 0. else 1]}'
                     for k, name in enumerate('xyz'))


def require_wrist_frame(landmarks: np.ndarray, side: str) -> None:
    """Raise where landmarks are not in the frame of the wrist.

    Parameters
    ----------
    landmarks : ndarray, shape (21, 3)
        NaN where not known; then nothing is checked [m].
    side : {'right', 'left'}

    Raises
    ------
    TurnedHandFrame
        Naming where their axes point, and where they ought to.
    """
    rows = landmarks[[WRIST, INDEX_MCP, MIDDLE_MCP, LITTLE_MCP]]
    if not np.isfinite(rows).all() or np.ptp(rows, axis=0).max() == 0.:
        return
    with np.errstate(invalid='ignore'):
        axes = palm_axes(landmarks, side)
    if not np.isfinite(axes).all() or turn_deg(axes) <= MOST_TURNED_DEG:
        return
    hint, other = '', OTHER_SIDE[side]
    if turn_deg(axes @ DEX_AXES) < MOST_TURNED_DEG:
        hint = " (dex-retargeting's frame)"
    elif turn_deg(palm_axes(landmarks, other)) < MOST_TURNED_DEG:
        hint = ' (a hand of the other side)'
    raise TurnedHandFrame(
        f'landmarks: their frame is turned by {turn_deg(axes):.0f} degrees: its axes are '
        f'{axes_in_words(axes, side)}{hint}; expected the frame of the wrist, '
        f'{axes_in_words(np.eye(3), side)}')
