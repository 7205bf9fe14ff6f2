"""Observability: which joints of a hand the markers of a layout show."""

import numpy as np

from .hand import CMC_JOINTS, DIGITS, FLEXION_JOINTS, JOINTS, Hand
from .kinematics import forward, joint_table
from .marker_layout import PALM_LANDMARKS, MarkerLayout, marker_positions

MORE_FLEXION = np.radians(15.)         # [rad] than of the relaxed hand
# [rad] of an angle that nothing shows; of the CMC flexion of fingers.
FREE_DEVIATION, FREE_CMC_DEVIATION = np.radians((30., 10.))
SHOWN_SHARE = .4                      # [1] of these, of an angle that markers show
LOCKED_DEVIATION = 1e-3               # [rad] of an angle whose limits are one
MARKER_DEVIATION_ASSUMED = .0005 # [m] on an axis
POSE_STEP = 1e-4                      # [rad, m] of the differences


def unobserved_joints(hand: Hand, layout: MarkerLayout) -> tuple[str, ...]:
    """Return the names of the joints that stay uncertain though all markers are seen.

    The covariance of wrist and angles at a hand that is a little bent, where nothing but the
    markers determines the angles. Of a palm that is taken for flat no arch is shown.

    Parameters
    ----------
    hand : Hand
    layout : MarkerLayout

    Returns
    -------
    tuple of str
    """
    right = hand.as_right()
    table, mounting = joint_table(right), layout.mounting(right)
    relaxed = right.relaxed()
    relaxed[FLEXION_JOINTS[:, :2]] += MORE_FLEXION

    def places(angles: np.ndarray) -> np.ndarray:
        return marker_positions(mounting, forward(table, angles)).reshape(len(angles), -1)

    count = len(JOINTS)
    step = POSE_STEP * np.eye(count)
    by_angle = (places(relaxed + step) - places(relaxed - step)) / (2. * POSE_STEP)
    markers = places(relaxed[None]).reshape(-1, 3)
    by_turn = np.array([np.cross(axis, markers).ravel() for axis in np.eye(3)])
    by_shift = np.array([np.tile(axis, len(markers)) for axis in np.eye(3)])
    derivatives = np.concatenate((by_angle, by_turn, by_shift))
    precision = derivatives @ derivatives.T / MARKER_DEVIATION_ASSUMED ** 2
    # Of a digit with one marker the last joint follows its coupling, and the thumb's MCP does not
    # abduct.
    alone = [row for row, digit in enumerate(DIGITS) if sum(
        place.startswith(f'{digit}_') and place not in PALM_LANDMARKS
        for place in layout.places) < 2]
    assumed = FLEXION_JOINTS[alone, 2].tolist() + (
        [JOINTS.index('thumb_mcp_abduction')] if DIGITS.index('thumb') in alone else [])
    locked = np.ptp(right.limits, axis=1) == 0.
    held = locked.copy()
    held[assumed] = True
    tie = np.eye(count)
    for row in alone:
        second, last = FLEXION_JOINTS[row, 1:]
        tie[last, second] = -right.coupling[row, 0]
    free = np.full(count, FREE_DEVIATION)
    free[CMC_JOINTS] = FREE_CMC_DEVIATION
    precision[:count, :count] += tie.T @ np.diag(
        np.where(held, LOCKED_DEVIATION, free) ** -2.) @ tie
    precision[count:, count:] += np.eye(6) * 1e-3
    deviation = np.sqrt(np.diag(np.linalg.inv(precision))[:count])
    missing = locked | (deviation > SHOWN_SHARE * free)
    missing[assumed] = True
    return tuple(joint for joint, is_missing in zip(JOINTS, missing) if is_missing)
