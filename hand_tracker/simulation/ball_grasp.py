"""A robot hand grasps a ball, in MuJoCo: gravity, contact and friction decide whether it stays.

The palm is fixed, and gravity turns about it instead: at first the palm is up and the ball lies in
it; then the hand is turned over. Nothing but contact holds the ball.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..core.errors import HandTrackerError
from ..core.model.hand import Hand
from ..core.model.kinematics import forward, joint_table
from ..core.model.marker_layout import MarkerLayout, marker_positions
from ..retargeting.robot_file import LoadedRobot
from .gestures import GRASPS, LETTER_SHAPES, grasp_shape, shape_angles
from .motion import SI_OF_SWAY, Keyframe, Sway, motion_through
from .motions import WRIST_CENTRE
from .packaged_recordings import (
    RECORDING_DECIMALS,
    RECORDING_NOISE,
    RECORDING_RATE,
    RECORDING_SEED,
    RECORDING_START_NS,
    SimulatedRecording,
)

# The person's: an open hand, time to close it, to hold it, and to open it again [s].
OPEN_TIME, CLOSING_TIME, HELD_TIME, OPENING_TIME, EMPTY_TIME = 4., 1., 6., .6, 1.4
GRASP_SIZE = .5             # of the object that the person's hand closes about, 0 to 1
# Of the recording [s]: when the hand is closed, when it opens, and when it has been turned over.
CLOSED_AT = OPEN_TIME + CLOSING_TIME + .5
OPENS_AT = OPEN_TIME + CLOSING_TIME + HELD_TIME
TURN_TIME = 1.5
TURNED_AT = CLOSED_AT + TURN_TIME
GRAVITY = 9.81              # [m/s²]
BALL_RADIUS, BALL_MASS = .03, .05   # [m], [kg]
BALL_PLACE = np.array((.1, 0., -.043))  # [m] in the plain hand's palm: on its palmar face
FRICTION = 1., .01, .001    # sliding [1], torsional and rolling [m], of rubber on a dry ball
CONTACT_DIMENSIONS = 6      # with torsional and rolling friction
PHYSICS_STEP = .001         # [s]
# Of the actuators: [N m/rad], [N m s/rad], [N m]; inertia of their rotors [kg m²].
STIFFNESS, DAMPING, TORQUE, ARMATURE = 3., .05, 1., 1e-4
LOST_FROM = .04             # [m] by which a ball that is held may move in the hand
FREE_FROM = .2              # [m] by which a ball has moved that fell


class PhysicsUnavailable(HandTrackerError):
    """MuJoCo is not installed."""


def grasp_recording(hand: Hand) -> SimulatedRecording:
    """Return the markers of a hand that closes about a ball, holds it and opens again.

    Parameters
    ----------
    hand : Hand
    """
    still = Sway(1., WRIST_CENTRE * SI_OF_SWAY, np.zeros((1, 6)), np.zeros((1, 6)))
    cupped, closed, spread = (shape_angles(shape, hand) for shape in (
        GRASPS['power'][0], grasp_shape('power', GRASP_SIZE), LETTER_SHAPES['5']))
    motion = motion_through([
        Keyframe(cupped, 0., OPEN_TIME), Keyframe(closed, CLOSING_TIME, HELD_TIME),
        Keyframe(spread, OPENING_TIME, EMPTY_TIME)], still)
    frames = np.arange(int(motion.duration * RECORDING_RATE) + 1)
    angles, rotation, position = motion.sample(frames / RECORDING_RATE)
    pose = forward(joint_table(hand), angles, rotation, position)
    markers = marker_positions(MarkerLayout().mounting(hand), pose, rotation, position)
    noise = np.random.RandomState(RECORDING_SEED).normal(0., RECORDING_NOISE, markers.shape)
    stamps = RECORDING_START_NS + np.round(frames * (1e9 / RECORDING_RATE)).astype(np.int64)
    return SimulatedRecording(stamps, np.round(markers + noise, RECORDING_DECIMALS), angles)


def gravity_at(time: float) -> np.ndarray:
    """Return gravity in the palm's frame, shape (3,), at a time since the recording began [s]."""
    turned = turn_at(time)
    return GRAVITY * np.array((0., np.sin(turned), np.cos(turned)))


def turn_at(time: float) -> float:
    """Return by how much the hand has been turned at a time of the recording [rad]."""
    return float(np.pi * np.clip((time - CLOSED_AT) / TURN_TIME, 0., 1.))


class BallGrasp:
    """The plain robot hand, and a ball in its palm.

    Parameters
    ----------
    loaded : LoadedRobot

    Attributes
    ----------
    time : float
        Since the recording began [s].

    Raises
    ------
    PhysicsUnavailable
    """

    def __init__(self, loaded: LoadedRobot) -> None:
        try:
            import mujoco
        except ImportError as error:
            raise PhysicsUnavailable(f'{error}; pip install mujoco') from None
        self._step = mujoco.mj_step
        names = loaded.order
        spec = mujoco.MjSpec.from_file(loaded.urdf)
        spec.option.timestep = PHYSICS_STEP
        # Without these a ball that is held slips slowly.
        spec.option.cone, spec.option.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, 10.
        for joint in spec.joints:
            joint.armature = ARMATURE
        # The hand's shapes overlap at its joints: they touch the ball alone.
        for shape in spec.geoms:
            shape.contype, shape.conaffinity = 1, 2
            shape.condim, shape.friction = CONTACT_DIMENSIONS, FRICTION
        for name in names:
            actuator = spec.add_actuator(name=name, target=name,
                                         trntype=mujoco.mjtTrn.mjTRN_JOINT)
            actuator.set_to_position(STIFFNESS, DAMPING)
            actuator.forcerange = -TORQUE, TORQUE
        ball = spec.worldbody.add_body(name='ball', pos=BALL_PLACE)
        ball.add_freejoint()
        ball.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=(BALL_RADIUS, 0., 0.),
                      mass=BALL_MASS, contype=2, conaffinity=1, condim=CONTACT_DIMENSIONS,
                      friction=FRICTION)
        self._model: Any = spec.compile()
        self._data: Any = mujoco.MjData(self._model)
        movable = loaded.hand.model.joint_names
        self._joints = [self._model.joint(name).qposadr[0] for name in movable]
        body = self._model.body('ball').id
        self._ball = int(self._model.jnt_qposadr[self._model.body_jntadr[body]])
        self._data.qpos[self._joints] = loaded.hand.model.joint_positions(loaded.hand.rest)
        self._commanded = [movable.index(name) for name in names]
        self._data.ctrl[:] = self.joints[self._commanded]
        self.time = 0.

    @property
    def joints(self) -> np.ndarray:
        """Positions of all movable joints, in the order of the model, shape (m,) [rad]."""
        return self._data.qpos[self._joints].copy()

    @property
    def ball(self) -> np.ndarray:
        """Centre of the ball in the palm's frame, shape (3,) [m]."""
        return self._data.qpos[self._ball:self._ball + 3].copy()

    def command(self, positions: np.ndarray) -> None:
        """Command the actuated joints.

        Parameters
        ----------
        positions : ndarray, shape (n,)
            In the robot file's order [rad].
        """
        self._data.ctrl[:] = positions

    def advance(self, time: float) -> None:
        """Step the physics to a time since the recording began [s]."""
        while self.time < time:
            self._model.opt.gravity[:] = gravity_at(self.time)
            self._step(self._model, self._data)
            self.time += PHYSICS_STEP
