"""Prompts of a live calibration, and the share of each shown so far by the eight markers.

Each prompt has a measure, one number a frame, that grows as the hand does what is asked. It
counts what the measure has reached in `LASTING_FRAMES` frames, so that a marker out of its place
for an instant shows nothing, and hidden markers cost only their frames. The measures are of the
markers in the palm alone: reach and direction of each digit from its root. A finger's flexion here
is the angle of that direction below the palm, 0 straight ahead, 90 degrees at right angles to it.

- open hand: every finger flexed by less than 25 degrees.
- fist: every finger flexed by more than 70 degrees.
- spread: between straight fingers, index and little finger turned apart and together by 16 degrees.
- each finger: flexed by 30 degrees more than the others on the average, and by a bend that takes
  7 % more off its reach than off theirs.
- thumb to each finger: its marker is near that finger's, clearly nearer than any other's.
- thumb circles: its marker has gone some way in each of eight directions.

Of the four fingers three have to be seen for open hand and fist, two others for one alone. The
rules are ours, unsourced; simulated motions are tested.
"""

import math
from typing import NamedTuple

import numpy as np

from ..core.model.hand import FINGERS, LEFT_HAND_MIRROR, Hand
from ..core.model.marker_layout import PALM_MARKERS

LASTING_FRAMES = 5      # [frames] of `TAKE_RATE` in which something is to be seen
REACH_FRAMES = 15       # [frames] of a finger's longest reach
MOST_COORDINATE = 1e3   # [m] of a marker, else it is no place
ROOT_DEPTH = .012      # [m] of the joints below the markers of the knuckles, on the skin
SEEN_FINGERS = 3        # for a shape of the hand
SEEN_OTHERS = 2         # beside one that moves alone
STRAIGHT = 35.          # [degrees] of flexion at most, of fingers that are spread
# Measure of nothing and of all that is asked.
OPEN_FLEXION = (60., 25.)      # [degrees]
FIST_FLEXION = (20., 70.)      # [degrees]
SPREAD_RANGE = (2., 16.)       # [degrees]
ALONE_FLEXION = (5., 30.)      # [degrees] more than the others
ALONE_BEND = (.02, .07)       # of its longest reach, more than the others
TOUCH_DISTANCE = (1.1, .75)    # of the distance of the knuckles of index and little finger
NEARER = .25                   # of that distance, than to any other finger
# A circle: the way of the thumb's marker in each of `HEADINGS` directions, counted in steps; both
# relative to the distance of the knuckles.
HEADINGS = 8
CIRCLE_STEP = .06
HEADING_WAY = .3
LONG_GAP = 6    # [frames] of a hidden marker, behind which its way begins anew
# Across which the thumb circles: from its root, ahead, to the thumb's side and palmar.
THUMB_VIEW = np.array((.7, .5, -.5)) / np.sqrt(.99)


class Prompt(NamedTuple):
    """Movement to ask a person for.

    Attributes
    ----------
    name : str
    text : str
    """

    name: str
    text: str


PROMPTS = (
    Prompt('open hand', 'open the hand, fingers straight'),
    Prompt('fist', 'make a fist'),
    Prompt('spread', 'spread the straight fingers, and close them again'),
    *(Prompt(f'{finger} finger', f'bend the {finger} finger alone, in its knuckle and in its '
             'middle joint') for finger in FINGERS),
    *(Prompt(f'thumb to {finger}', f'bring the thumb to the tip of the {finger} finger')
      for finger in FINGERS),
    Prompt('thumb circles', 'circle with the thumb, wide, two times'),
)


def shown_shares(markers: np.ndarray, side: str) -> np.ndarray:
    """Return the share of each of `PROMPTS` that the markers have shown.

    Parameters
    ----------
    markers : ndarray, shape (T, 8, 3)
        In the order of `MARKERS`, at `TAKE_RATE`, NaN where not seen [m].
    side : {'right', 'left'}

    Returns
    -------
    ndarray, shape (12,)
        From 0 to 1, all of it.
    """
    with np.errstate(invalid='ignore'):
        markers = np.where(np.abs(markers) < MOST_COORDINATE, markers, np.nan)
        if side == 'left':
            markers = markers * LEFT_HAND_MIRROR
        corners, ends = in_palm(markers)
        known = np.isfinite(corners).all(axis=(1, 2))
        if np.count_nonzero(known) < LASTING_FRAMES:
            return np.zeros(len(PROMPTS))
        corners = np.median(corners[known], axis=0)
        arms = ends[:, :-1] - _knuckles(corners)
        breadth = float(np.linalg.norm(corners[1] - corners[2]))
        shares = np.concatenate((_shapes(arms), _alone(arms), _touches(ends / breadth),
                                 [_circles(ends[:, -1] / breadth)]))
    return np.nan_to_num(shares)


def in_palm(markers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return markers of a right hand in the frame of the palm's triangle.

    Its origin is the wrist's marker, x points between the knuckles, z dorsal.

    Parameters
    ----------
    markers : ndarray, shape (T, 8, 3)
        [m]

    Returns
    -------
    corners : ndarray, shape (T, 3, 3)
        The palm's markers; NaN where one of them is not seen [m].
    ends : ndarray, shape (T, 5, 3)
        The digits' [m].
    """
    wrist, index, little = np.moveaxis(markers[:, :len(PALM_MARKERS)], 1, 0)
    x = .5 * (index + little) - wrist
    z = np.cross(little - wrist, index - wrist)
    axes = np.stack((x, np.cross(z, x), z), axis=1)
    axes /= np.linalg.norm(axes, axis=2, keepdims=True)  # (T, 3, 3)
    local = (markers - wrist[:, None]) @ np.swapaxes(axes, 1, 2)
    return local[:, :len(PALM_MARKERS)], local[:, len(PALM_MARKERS):]


def _knuckles(corners: np.ndarray) -> np.ndarray:
    """Return the fingers' roots under the palm's markers (3, 3), by the mean hand, (4, 3) [m]."""
    mcp = Hand.scaled().finger_mcp[:, :2]
    shares = mcp @ np.linalg.inv(mcp[[0, -1]])  # (4, 2) of the markers of index and little finger
    return shares @ corners[1:] - (0., 0., ROOT_DEPTH)


def _lasting(values: np.ndarray, frames: int = LASTING_FRAMES) -> np.ndarray:
    """Return the level reached by values (T, ...) in some frames; -inf if in fewer."""
    values = np.where(np.isfinite(values), values, -np.inf)
    if len(values) < frames:
        return np.full(values.shape[1:], -np.inf)
    return np.partition(values, -frames, axis=0)[-frames]


def _share(reached: np.ndarray, goal: tuple[float, float]) -> np.ndarray:
    """Return the share of the asked range that a measure has covered, from 0 to 1."""
    nothing, everything = goal
    return np.clip((reached - nothing) / (everything - nothing), 0., 1.)


def _flexion(arms: np.ndarray) -> np.ndarray:
    """Return the flexion of fingers with arms (T, 4, 3), from -90 to 270 [degrees]."""
    turned = np.degrees(np.arctan2(-arms[..., 2], arms[..., 0]))
    return np.where(turned < -90., turned + 360., turned)


def _shapes(arms: np.ndarray) -> np.ndarray:
    """Return the shares of open hand, fist and spread fingers with arms (T, 4, 3), (3,)."""
    flexion = _flexion(arms)
    seen = np.isfinite(flexion)
    enough = seen.sum(axis=1) >= SEEN_FINGERS
    most = np.where(enough, np.where(seen, flexion, -np.inf).max(axis=1), np.nan)
    least = np.where(enough, np.where(seen, flexion, np.inf).min(axis=1), np.nan)
    aside = np.degrees(np.arctan2(arms[..., 1], arms[..., 0]))
    apart = np.where(most < STRAIGHT, aside[:, 0] - aside[:, -1], np.nan)
    nothing, everything = OPEN_FLEXION
    return np.array((
        _share(_lasting(-most), (-nothing, -everything)),
        _share(_lasting(least), FIST_FLEXION),
        _share(_lasting(apart) + _lasting(-apart), SPREAD_RANGE)))


def _alone(arms: np.ndarray) -> np.ndarray:
    """Return the share by which each finger moved alone (4,), of fingers with arms (T, 4, 3)."""
    reach = np.linalg.norm(arms, axis=2)
    longest = _lasting(reach, REACH_FRAMES)
    flexed = _share(_lasting(_beyond_others(_flexion(arms))), ALONE_FLEXION)
    bent = _share(_lasting(_beyond_others(1. - reach / longest)), ALONE_BEND)
    return .5 * (flexed + bent)


def _beyond_others(values: np.ndarray) -> np.ndarray:
    """Return by how much each finger's value exceeds the mean of the others', (T, 4)."""
    seen = np.isfinite(values)
    known = np.where(seen, values, 0.)
    others = seen.sum(axis=1, keepdims=True) - seen
    mean = (known.sum(axis=1, keepdims=True) - known) / np.maximum(others, 1)
    return np.where(others >= SEEN_OTHERS, values - mean, np.nan)


def _touches(ends: np.ndarray) -> np.ndarray:
    """Return the share of the thumb at each finger, of markers (T, 5, 3) in palms, (4,)."""
    distance = np.linalg.norm(ends[:, :-1] - ends[:, -1:], axis=2)  # (T, 4)
    far = np.where(np.isfinite(distance), distance, np.inf)
    ordered = np.sort(far, axis=1)
    other = np.where(far == ordered[:, :1], ordered[:, 1:2], ordered[:, :1])
    touching = np.where(other - distance > NEARER, distance, np.nan)
    nothing, everything = TOUCH_DISTANCE
    return _share(_lasting(-touching), (-nothing, -everything))


def _circles(ends: np.ndarray) -> float:
    """Return the share of circles of a thumb's marker (T, 3), in palms."""
    aside = np.cross(THUMB_VIEW, (1., 0., 0.))
    aside /= np.linalg.norm(aside)
    seen = ends @ np.stack((aside, np.cross(aside, THUMB_VIEW)), axis=1)  # (T, 2)
    frames = np.flatnonzero(np.isfinite(seen[:, 0]))
    way = np.zeros(HEADINGS)
    before, last = -LONG_GAP, (0., 0.)
    for frame, place in zip(frames.tolist(), seen[frames].tolist()):
        right, up = place[0] - last[0], place[1] - last[1]
        step = math.hypot(right, up)
        if frame - before >= LONG_GAP:
            last = place
        elif step >= CIRCLE_STEP:
            turn = math.atan2(up, right) / (2. * math.pi)
            way[math.floor(HEADINGS * turn) % HEADINGS] += step
            last = place
        before = frame
    return float(np.clip(way / HEADING_WAY, 0., 1.).mean())
