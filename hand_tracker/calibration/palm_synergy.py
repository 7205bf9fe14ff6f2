"""Palm synergy: cupping of a person's palm over the flexion of ring and little finger. Ours."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..core.model.hand import FINGERS, FLEXION_JOINTS, PALM_SYNERGY_RANGE, Hand
from .palm_template import rigid_poses, to_palm

CUPPING_FINGERS = 'ring', 'little'
ARCH_NOISE = .02        # [rad] of a CMC joint's flexion, as of 1.5 mm of a knuckle
SYNERGY_SPREAD = .15    # [1] standard deviation of the gains among people
INDEPENDENT_FLEXIONS = 10.  # that the frames of a take count for
LEAST_FIXED = 3         # markers of the palm beside the two knuckles


def fit_palm_synergy(hand: Hand, palm: Mapping[str, np.ndarray],
                     postures: np.ndarray) -> np.ndarray:
    """Fit CMC flexion per MCP flexion of ring and little finger to the markers of the palm.

    Parameters
    ----------
    hand : Hand
        Source of the CMC joints, and of the gains that no marker shows.
    palm : mapping of str to ndarray, shape (n, 3)
        Markers of the palm or its joints on a right hand, in a frame of the palm; knuckles by
        their landmarks [m].
    postures : ndarray, shape (n, 25)
        Angles of the hand in these frames [rad].

    Returns
    -------
    ndarray, shape (4,)
        As `Hand.palm_synergy` [1].
    """
    gains = hand.palm_synergy.copy()
    knuckles = [f'{finger}_mcp' for finger in CUPPING_FINGERS]
    fixed = [name for name in palm if name not in knuckles]
    if len(fixed) < LEAST_FIXED or not len(postures):
        return gains
    # The frame of the palm that does not cup.
    places = np.stack([palm[name] for name in fixed], axis=1)
    with np.errstate(invalid='ignore'):
        poses = rigid_poses(places, np.nanmedian(places, axis=0))
    rows = [FINGERS.index(finger) for finger in CUPPING_FINGERS]
    flexion = np.maximum(postures[:, FLEXION_JOINTS[rows, 0]].mean(axis=1), 0.)
    for row, knuckle in zip(rows, knuckles):
        if knuckle not in palm:
            continue
        x, _, z = (to_palm(palm[knuckle][:, None], *poses)[:, 0] - hand.finger_cmc[row]).T
        arch = -np.arctan2(z, x)
        seen = np.isfinite(arch)
        if seen.sum() < 2:
            continue
        flexed, arch = flexion[seen] - flexion[seen].mean(), arch[seen] - arch[seen].mean()
        known = (ARCH_NOISE / SYNERGY_SPREAD) ** 2
        gains[row] = np.clip(
            (INDEPENDENT_FLEXIONS * (flexed * arch).mean() + known * gains[row])
            / (INDEPENDENT_FLEXIONS * (flexed ** 2).mean() + known), *PALM_SYNERGY_RANGE)
    return gains
