"""Takes of markers on the skin of a simulated hand."""

import numpy as np

from hand_tracker.calibration.fitted_hand import MarkerMount, place_mounted
from hand_tracker.calibration.takes import MarkerTake
from hand_tracker.core.model.hand import DIGITS, FINGERS, LINKS
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.marker_layout import marker_positions
from hand_tracker.simulation.motions import motion_named

SKIN_OFFSET = .008  # [m] dorsal
WORN = ('wrist', 'index_mcp', 'little_mcp', 'index_dip', 'middle_dip', 'ring_dip', 'little_dip',
        'thumb_tip')
EVERY_JOINT = (*WORN[:3], 'middle_mcp', 'ring_mcp',
               *(f'{finger}_{joint}' for finger in FINGERS for joint in ('pip', 'dip', 'tip')),
               'thumb_mcp', 'thumb_ip', 'thumb_tip')
THUMB_BONES = {'mcp': 'metacarpal', 'ip': 'proximal', 'tip': 'distal'}
FINGER_BONES = {'pip': 'proximal', 'dip': 'middle', 'tip': 'distal'}


def skin_mount(hand, name):
    """Return where a marker is on the skin of a hand, dorsal of its landmark."""
    digit, _, joint = name.partition('_')
    offset = np.array((0., 0., SKIN_OFFSET))
    if name == 'wrist':
        return MarkerMount(-1, np.zeros(3), offset, 0., -1)
    if joint == 'mcp' and digit in FINGERS:
        return MarkerMount(
            -1, np.zeros(3), hand.finger_mcp[FINGERS.index(digit)] + offset, 0., -1)
    bones = hand.thumb_bones if digit == 'thumb' else hand.finger_bones[DIGITS.index(digit)]
    links = THUMB_BONES if digit == 'thumb' else FINGER_BONES
    length = bones[list(links).index(joint)]
    return MarkerMount(
        LINKS.index(f'{digit}_{links[joint]}'), np.array((length, 0., 0.)), offset, 0., -1)


def simulated_take(hand, names, seconds=16., rate=30., noise=.0003, seed=1,
                   motions=('spelling', 'power_grasp', 'precision_grasp', 'piano')):
    """Return a take of a hand in motions of the library, and its angles (T, 25) [rad]."""
    parts = []
    for motion in motions:
        moving = motion_named(motion, hand, seed, seconds / len(motions))
        parts.append(moving.sample(np.arange(0., seconds / len(motions), 1. / rate)))
    angles, rotation, position = map(np.concatenate, zip(*parts))
    points = place_mounted(
        hand, [skin_mount(hand, name) for name in names], angles, rotation, position)
    points = points + noise * np.random.default_rng(seed).standard_normal(points.shape)
    return MarkerTake('simulated', tuple(names), points, hand.side, rate,
                      np.zeros(len(points), dtype=int)), angles


def worn_markers(hand, layout, angles):
    """Return the eight markers (T, 8, 3) of a hand that stays in its place [m]."""
    rotation, position = np.tile(np.eye(3), (len(angles), 1, 1)), np.zeros((len(angles), 3))
    return marker_positions(layout.mounting(hand), forward(
        joint_table(hand), angles, rotation, position), rotation, position)
