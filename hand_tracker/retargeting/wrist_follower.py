"""Pose and twist of a robot's wrist that follow the person's wrist, with a clutch. No ROS.

The robot's wrist is moved by as much as the person's since both were engaged: by the same turn,
and by the same way, scaled. While the clutch is held the robot's wrist stays, and the person's may
go elsewhere; from its release on the robot's goes on from where it is. So it does after a jump, a
pause, or a change of the frame in which the person's wrist is given.

Its speed rises by the acceleration at most, and falls so as it arrives; it stops at once where the
clutch, a lost hand or a goal behind it ends the way.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..core.checked_options import check, number_option
from ..core.errors import HandTrackerError

if TYPE_CHECKING:  # where it is needed, as most robots' wrists do not follow, and scipy takes long
    from scipy.spatial.transform import Rotation


class InvalidWristOption(HandTrackerError, ValueError):
    """An option of the wrist has a value outside its range."""


@dataclass(frozen=True)
class WristOptions:
    """Options of `WristFollower`.

    Raises
    ------
    InvalidWristOption
        Naming the option, its value and what is allowed.
    """

    scale: float = number_option(
        1., .01, 10., '', "Robot's metres per metre of the person's wrist")
    yaw_deg: float = number_option(
        0., -360., 360., 'degrees', "About the vertical, from the markers' frame to that of the "
        "robot's base")
    max_speed: float = number_option(
        .25, .001, 5., 'm/s', "Of the robot's wrist")
    max_turn_rate: float = number_option(
        1., .01, 20., 'rad/s', "Of the robot's wrist")
    max_acceleration: float = number_option(
        2., .01, 100., 'm/s²', "With which the robot's wrist speeds up, and slows down as it "
        'arrives')
    max_turn_acceleration: float = number_option(
        8., .01, 500., 'rad/s²', "With which the robot's wrist speeds up, and slows down as it "
        'arrives')
    max_jump: float = number_option(
        .1, .001, 10., 'm', "Of the person's wrist from one frame to the next; after a larger one "
        'the robot goes on from where it is')
    max_turn_jump: float = number_option(
        .5, .01, 3.15, 'rad', "Of the turn of the person's wrist from one frame to the next; after "
        'a larger one the robot goes on from where it is; 3.15 lets all pass')
    max_dt: float = number_option(
        .05, .001, 1., 's', 'Time since the last command that counts at most')
    timeout: float = number_option(
        .15, .01, 10., 's', "Age of the last pose of the person's wrist from which the robot's "
        'stays')

    def __post_init__(self) -> None:
        check(self, InvalidWristOption, 'wrist.')


class WristPose(NamedTuple):
    """A pose.

    Attributes
    ----------
    position : ndarray, shape (3,)
        [m]
    rotation : Rotation
    """

    position: np.ndarray
    rotation: Rotation


class WristCommand(NamedTuple):
    """Pose and twist command for the robot's wrist, in the frame of its base.

    Attributes
    ----------
    pose : WristPose
    linear, angular : ndarray, shape (3,)
        Velocity with which it goes there [m/s] and [rad/s].
    """

    pose: WristPose
    linear: np.ndarray
    angular: np.ndarray


def wrist_pose_of(position: ArrayLike, quaternion: ArrayLike) -> WristPose | None:
    """Return a pose of a position [m] and a quaternion (x, y, z, w); None where it is none."""
    from scipy.spatial.transform import Rotation

    place, turn = np.array(position, dtype=float), np.array(quaternion, dtype=float)
    norm = float(np.linalg.norm(turn))
    if place.shape != (3,) or turn.shape != (4,) or not np.isfinite(place).all() or (
            not math.isfinite(norm)) or norm < 1e-6:
        return None
    return WristPose(place, Rotation.from_quat(turn))


class WristFollower:
    """Move a robot's wrist as the person moves theirs.

    Times come from a clock that never jumps [s].

    Parameters
    ----------
    options : WristOptions, optional

    Attributes
    ----------
    refused_jumps : int
        Times that the person's wrist jumped.
    """

    def __init__(self, options: WristOptions | None = None) -> None:
        from scipy.spatial.transform import Rotation

        self.options = options or WristOptions()
        self.refused_jumps = 0
        self._axes = Rotation.from_euler('z', self.options.yaw_deg, degrees=True)
        self._person: WristPose | None = None
        self._person_time, self._person_frame = -math.inf, ''
        self._is_clutched = False
        # Poses that belong together: of the person and of the robot.
        self._reference: tuple[WristPose, WristPose] | None = None
        self._sent: WristPose | None = None
        self._time = -math.inf
        self._velocity = self._turn_rate = np.zeros(3)

    @property
    def is_engaged(self) -> bool:
        """Whether commands are made."""
        return self._sent is not None

    def observe(self, pose: WristPose | None, now: float, frame: str = '') -> None:
        """Take the pose of the person's wrist.

        Parameters
        ----------
        pose : WristPose or None
            In the markers' frame; None is left out.
        now : float
            [s]
        frame : str
            Name of that frame; poses in two frames tell nothing of a movement.
        """
        if pose is None or not math.isfinite(now):
            return
        if self._person is not None:
            has_jumped = frame == self._person_frame and self._is_jump(self._person, pose)
            self.refused_jumps += int(has_jumped)
            if has_jumped or frame != self._person_frame or (
                    now - self._person_time > self.options.timeout):
                self._reference = None
        self._person, self._person_time, self._person_frame = pose, now, frame

    def _is_jump(self, before: WristPose, after: WristPose) -> bool:
        """Return whether the person's wrist went or turned too far in a frame."""
        way = float(np.linalg.norm(after.position - before.position))
        turn = float((after.rotation * before.rotation.inv()).magnitude())
        return way > self.options.max_jump or turn > self.options.max_turn_jump

    def missing(self, robot: WristPose | None, now: float) -> str:
        """Return which pose is missing to follow, or nothing.

        Parameters
        ----------
        robot : WristPose or None
            Where the robot's wrist is, in the frame of its base.
        now : float
            [s]
        """
        if robot is None:
            return "the pose of the robot's wrist is missing"
        if self._person is None or now - self._person_time > self.options.timeout:
            return "the pose of the person's wrist is missing"
        return ''

    def engage(self, robot: WristPose | None, now: float) -> str:
        """Let the robot's wrist follow from where it is; return why not, or nothing.

        Parameters are those of `missing`.
        """
        if missing := self.missing(robot, now):
            return missing
        assert robot is not None and self._person is not None
        self._sent, self._time, self._reference = robot, now, (self._person, robot)
        self._velocity = self._turn_rate = np.zeros(3)
        return ''

    def disengage(self) -> WristCommand | None:
        """Make no more commands; return the last one, at rest, or None where there was none."""
        sent, self._sent = self._sent, None
        return sent and WristCommand(sent, np.zeros(3), np.zeros(3))

    def clutch(self, is_held: bool) -> None:
        """Hold the clutch, so that the robot's wrist stays, or release it."""
        if is_held != self._is_clutched:
            self._is_clutched, self._reference = is_held, None

    def command(self, now: float) -> WristCommand | None:
        """Return the command to send now; None where nothing is to be sent.

        Parameters
        ----------
        now : float
            [s]
        """
        if self._sent is None or not math.isfinite(now):
            return None
        step = min(max(now - self._time, 0.), self.options.max_dt)
        self._time = max(now, self._time)
        is_lost = now - self._person_time > self.options.timeout
        if self._person is None or is_lost or self._is_clutched or step <= 0.:
            if is_lost:
                self._reference = None
            self._velocity = self._turn_rate = np.zeros(3)
            return WristCommand(self._sent, self._velocity, self._turn_rate)
        if self._reference is None:
            self._reference = self._person, self._sent
        person, robot = self._reference
        way = self.options.scale * self._axes.apply(self._person.position - person.position)
        turn = self._axes * self._person.rotation * person.rotation.inv() * self._axes.inv()
        self._velocity = _next_velocity(
            self._velocity, robot.position + way - self._sent.position, step,
            self.options.max_speed, self.options.max_acceleration)
        rest = turn * robot.rotation * self._sent.rotation.inv()
        self._turn_rate = _next_velocity(
            self._turn_rate, rest.as_rotvec(), step,
            self.options.max_turn_rate, self.options.max_turn_acceleration)
        self._sent = WristPose(
            self._sent.position + step * self._velocity,
            type(turn).from_rotvec(step * self._turn_rate) * self._sent.rotation)
        return WristCommand(self._sent, self._velocity, self._turn_rate)


def _next_velocity(velocity: np.ndarray, rest: np.ndarray, step: float, most: float,
                   acceleration: float) -> np.ndarray:
    """Return the velocity of the next step to a goal, within limits of speed and acceleration.

    Parameters
    ----------
    velocity : ndarray, shape (3,)
        Of the last step [m/s or rad/s].
    rest : ndarray, shape (3,)
        Remaining way to the goal [m or rad].
    step : float
        [s]
    most, acceleration : float
        Limits of the speed [m/s or rad/s], and of the acceleration [m/s² or rad/s²].
    """
    left = float(np.linalg.norm(rest))
    if left <= 0.:
        return np.zeros(3)
    # From which steps of equal deceleration end at the goal: v² / 2a + v step / 2 = left.
    gain = acceleration * step
    arriving = math.sqrt(.25 * gain**2 + 2. * acceleration * left) - .5 * gain
    wanted = rest * (min(most, arriving, left / step) / left)
    # The velocity's part towards the goal is kept; the rest of it ends at once.
    speed = float(velocity @ velocity)
    kept = velocity * min(max(float(velocity @ wanted) / speed, 0.), 1.) if speed > 0. else velocity
    return kept + _shortened(wanted - kept, gain)


def _shortened(vector: np.ndarray, most: float) -> np.ndarray:
    """Return a vector shortened to a length at most."""
    length = float(np.linalg.norm(vector))
    return vector * (most / length) if length > most else vector
