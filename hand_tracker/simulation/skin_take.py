"""Takes of markers on the skin of a simulated hand, more than will be worn, for a calibration."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from ..calibration.fitted_hand import MarkerMount, place_mounted
from ..calibration.takes import MarkerTake
from ..core.model.hand import DIGITS, FINGERS, LINKS, Hand
from ..core.model.marker_layout import PAPER_PLACES
from .motions import motion_named
from .visibility import LED_RADIUS

EVERY_JOINT = (*PAPER_PLACES[:3], 'middle_mcp', 'ring_mcp',
               *(f'{finger}_{joint}' for finger in FINGERS for joint in ('pip', 'dip', 'tip')),
               'thumb_mcp', 'thumb_ip', 'thumb_tip')
# Bones that end at the joints, from a digit's root.
THUMB_BONE_ENDS = {'mcp': 'metacarpal', 'ip': 'proximal', 'tip': 'distal'}
FINGER_BONE_ENDS = {'pip': 'proximal', 'dip': 'middle', 'tip': 'distal'}


def skin_mount(hand: Hand, name: str, height: float | None = None) -> MarkerMount:
    """Return the position of a marker on the skin of a hand, dorsal of its landmark.

    Parameters
    ----------
    hand : Hand
    name : str
        One of `EVERY_JOINT`.
    height : float, optional
        Above the landmark; that of an LED on the hand's capsule when left out [m].

    Returns
    -------
    MarkerMount
    """
    digit, _, joint = name.partition('_')
    if name == 'wrist' or joint == 'mcp' and digit in FINGERS:
        root = np.zeros(3) if name == 'wrist' else hand.finger_mcp[FINGERS.index(digit)]
        above = hand.palm_radius + LED_RADIUS if height is None else height
        return MarkerMount(-1, np.zeros(3), root + (0., 0., above), 0.)
    row = DIGITS.index(digit)
    ends = THUMB_BONE_ENDS if digit == 'thumb' else FINGER_BONE_ENDS
    bone = list(ends).index(joint)
    above = hand.radii[row, bone] + LED_RADIUS if height is None else height
    return MarkerMount(LINKS.index(f'{digit}_{ends[joint]}'), hand.bone_ends()[row, bone],
                       np.array((0., 0., above)), 0.)


def skin_take(hand: Hand, names: Sequence[str], motions: Sequence[str], seconds: float,
              rate: float = 30., noise: float = .0003, seed: int = 1,
              height: float | None = None) -> tuple[MarkerTake, np.ndarray]:
    """Return a take of a simulated hand in motions of the library, one after another.

    Parameters
    ----------
    hand : Hand
    names : sequence of str
        Markers, of `EVERY_JOINT`.
    motions : sequence of str
        Of `MOTIONS`.
    seconds : float
        Of all of them together [s].
    rate : float, optional
        [Hz]
    noise : float, optional
        Standard deviation of each coordinate [m].
    seed : int, optional
        Of motions and noise.
    height : float, optional
        As for `skin_mount` [m].

    Returns
    -------
    take : MarkerTake
    angles : ndarray, shape (T, 25)
        True joint angles [rad].
    """
    share = seconds / len(motions)
    parts = [motion_named(motion, hand, seed, share).sample(np.arange(0., share, 1. / rate))
             for motion in motions]
    angles, rotation, position = map(np.concatenate, zip(*parts))
    mounts = map(partial(skin_mount, hand, height=height), names)
    points = place_mounted(hand, list(mounts), angles, rotation, position)
    points = points + noise * np.random.default_rng(seed).standard_normal(points.shape)
    return MarkerTake('simulated', tuple(names), points, hand.side, rate,
                      np.zeros(len(points), dtype=int)), angles
