"""A simulated body in motion, with the hand that another system saw at the same time."""

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from hand_tracker.core.model.hand import Hand
from hand_tracker.files.bvh_file import (
    CHANNELS,
    BvhJoint,
    BvhMotion,
    joint_poses,
    rotation_channels,
)
from hand_tracker.files.point_recording import ROTATIONS
from hand_tracker.files.skeleton_motion import HandAngles, t_pose_turn

# Root, spine, then of each side shoulder, upper arm, forearm and hand, as programs name them.
BODY_NAMES = {
    'humanik': ('Hips', 'Spine', '{}Shoulder', '{}Arm', '{}ForeArm', '{}Hand'),
    'mixamo': ('mixamorig:Hips', 'mixamorig:Spine', 'mixamorig:{}Shoulder', 'mixamorig:{}Arm',
               'mixamorig:{}ForeArm', 'mixamorig:{}Hand'),
    'xsens': ('Hips', 'Chest', '{}Collar', '{}Shoulder', '{}Elbow', '{}Wrist'),
    'rokoko': ('Hips', 'Spine1', '{}Shoulder', '{}Arm', '{}ForeArm', '{}Hand'),
    'optitrack': ('Anna_Hip', 'Anna_Ab', 'Anna_{}Shoulder', 'Anna_{}UArm', 'Anna_{}FArm',
                  'Anna_{}Hand')}
ARM = (.05, .15, .29, .26)          # [m] of the bones in front of each joint of an arm
LEVER = np.array((.02, -.01, .015))  # [m] from the body's wrist to where the hand's markers sit


class SimulatedBody:
    """A body whose joints turn at random, smoothly.

    Parameters
    ----------
    naming : str
        Of `BODY_NAMES`.
    seconds : float
    seed : int
    """

    def __init__(self, naming='humanik', seconds=12., seed=0):
        rng = np.random.default_rng(seed)
        root, spine, *arm = BODY_NAMES[naming]
        joints = [BvhJoint(root, -1, (0., 0., 0.), CHANNELS),
                  BvhJoint(spine, 0, (0., 45., 0.), rotation_channels('ZXY'))]
        self.wrists = {}
        for side in ('left', 'right'):
            word = side[0].upper() if naming == 'optitrack' else side.title()
            sign, parent = (100., 1) if side == 'left' else (-100., 1)
            for name, length in zip(arm, ARM, strict=True):
                joints.append(BvhJoint(name.format(word), parent, (sign * length, 0., 0.),
                                       rotation_channels('YXZ')))
                parent = len(joints) - 1
            self.wrists[side] = parent
            # A finger of the body's own, which the tracked ones replace.
            joints.append(BvhJoint(f'{arm[-1].format(word)}Index1', parent, (.09 * sign, 0., 0.),
                                   rotation_channels('YXZ')))
            joints.append(BvhJoint('', parent + 1, (.03 * sign, 0., 0.), ()))
        self.joints = tuple(joints)
        count = sum(len(joint.channels) for joint in joints)
        knots = np.arange(-8., seconds + 8., .4)
        self._values = CubicSpline(knots, rng.normal(0., 20., (len(knots), count)))
        self.seconds = seconds

    def motion(self, rate, noise=0., seed=1):
        """Return what the body's system recorded, with noise of the angles [degrees]."""
        times = np.arange(round(self.seconds * rate)) / rate
        values = self._values(times)
        values += noise * np.random.default_rng(seed).normal(size=values.shape)
        return BvhMotion(self.joints, values, 1. / rate)

    def hand(self, side, times, clock, noise=0., seed=2):
        """Return the hand on the body's wrist as another system tracked it in its own world.

        Parameters
        ----------
        side : str
        times : ndarray, shape (T,)
            Of the hand's frames, in its own time [s].
        clock : callable
            Time of the body by that of the hand.
        noise : float
            Of the wrist's place [m].
        """
        rng = np.random.default_rng(seed)
        places, turns = joint_poses(self.joints, self._values(clock(times)))
        turn = turns[self.wrists[side]]
        place = .01 * places[:, self.wrists[side]] + turn @ LEVER
        self.world, self.mount = (Rotation.from_rotvec(vector).as_matrix()
                                  for vector in ((0., .7, 0.), (.1, -.2, .15)))
        place = place @ self.world.T + rng.normal(0., noise, place.shape)
        hand = Hand.scaled(side=side)
        slow = CubicSpline(np.linspace(times[0], times[-1], 8), rng.uniform(
            .6 * hand.limits[:, 0], .6 * hand.limits[:, 1], (8, 25)))(times)
        to_y_up = np.array(ROTATIONS['y'], dtype=float).T
        wrist = to_y_up.T @ self.world @ turn @ self.mount @ t_pose_turn(side)
        return HandAngles(hand, np.clip(slow, *hand.limits.T), place @ to_y_up,
                          wrist, np.asarray(times))


def swayed(recording, seed=4):
    """Return a recording of points whose whole hand moves by decimetres besides."""
    times = np.arange(len(recording.points)) / recording.rate
    knots = np.arange(-1., times[-1] + 1., .4)
    sway = CubicSpline(knots, np.random.default_rng(seed).normal(0., .1, (len(knots), 3)))(times)
    return recording._replace(points=recording.points + sway[:, None].astype(np.float32))


def body_that_carries(wrist, rate=120.):
    """Return a body of three joints whose right wrist goes along a path, (T, 3) [m], z up.

    Where the path has NaN the wrist goes straight on.
    """
    frames = np.arange(len(wrist))
    seen = np.isfinite(wrist).all(axis=1)
    wrist = np.stack([np.interp(frames, frames[seen], axis[seen]) for axis in wrist.T], axis=1)
    joints = (BvhJoint('Hips', -1, (0., 0., 0.), CHANNELS),
              BvhJoint('RightForeArm', 0, (-100., 50., 0.), rotation_channels('ZXY')),
              BvhJoint('RightHand', 1, (-26., 0., 0.), rotation_channels('ZXY')))
    values = np.zeros((len(wrist), 12))
    values[:, :3] = 100. * wrist @ np.array(ROTATIONS['y'], dtype=float)
    return BvhMotion(joints, values, 1. / rate)
