"""A robot's wrist that moves as the person's while the robot hand follows theirs."""

from __future__ import annotations

import math

from ..messages.stamps import UNSTAMPED, stands_still
from .wrist_follower import WristCommand, WristFollower, WristOptions, WristPose, wrist_pose_of


class WristTeleoperation:
    """Whether the robot's wrist follows, and how.

    Times come from a clock that never jumps [s].

    Parameters
    ----------
    options : WristOptions
    base_frame : str
        Name of the frame of the robot's base.
    sends_poses : bool
        Whether poses are sent, which begin where the robot's wrist is; twists begin anywhere.
    robot_timeout : float
        Age of the pose of the robot's wrist from which it is not known [s].

    Attributes
    ----------
    fault : str
        Why the arm stays though the fingers are engaged; else empty.
    is_clutched : bool
        Whether the person holds the clutch.
    """

    def __init__(self, options: WristOptions, base_frame: str, sends_poses: bool,
                 robot_timeout: float) -> None:
        self.fault, self.is_clutched = '', False
        self._follower = WristFollower(options)
        self._base_frame, self._sends_poses = base_frame, sends_poses
        self._robot_timeout = robot_timeout
        self._robot: WristPose | None = None
        self._robot_time, self._robot_stamp, self._frame_fault = -math.inf, UNSTAMPED, ''

    def observe(self, pose: WristPose | None, now: float, frame: str) -> None:
        """Take the pose of the person's wrist; parameters are those of `WristFollower.observe`."""
        self._follower.observe(pose, now, frame)

    def observe_robot(self, pose: WristPose | None, now: float, frame: str, stamp: int) -> str:
        """Take the pose of the robot's wrist; return why it is left out by its frame, or nothing.

        Parameters
        ----------
        pose : WristPose or None
            None is left out.
        now : float
            Time of receipt [s].
        frame : str
            Name of its frame; empty counts as that of the base.
        stamp : int
            Of the message [ns]; one with the stamp of the last is no new one.
        """
        self._frame_fault = '' if frame in ('', self._base_frame) else (
            f"robot/wrist_pose: frame_id '{frame}'; expected wrist.base_frame, "
            f"'{self._base_frame}'")
        if not self._frame_fault:
            is_repeated = stands_still(stamp, self._robot_stamp)
            self._robot_stamp = stamp
            if pose is not None and not is_repeated:
                self._robot, self._robot_time = pose, now
        return self._frame_fault

    def _is_robot_old(self, now: float) -> bool:
        return now - self._robot_time > self._robot_timeout

    def _start(self, now: float) -> WristPose | None:
        """Return the pose of the robot's wrist; for twists alone any pose will do."""
        if not self._is_robot_old(now):
            return self._robot
        return None if self._sends_poses else wrist_pose_of((0., 0., 0.), (0., 0., 0., 1.))

    def engage(self, now: float) -> None:
        """Let the robot's wrist follow from where it is; write why not into `fault`."""
        if self._follower.is_engaged:
            return
        start = self._start(now)
        missing = self._follower.engage(start, now)
        if start is None and self._frame_fault:
            missing = self._frame_fault
        self.fault = missing and (
            f'the arm stays where it is: {missing}; once that is mended, engage anew')

    def disengage(self) -> WristCommand | None:
        """Let the arm stay where it is; return the last command, at rest, or None without one."""
        self.fault = ''
        return self._follower.disengage()

    def ended(self, now: float) -> str:
        """Return why the robot must be disengaged, as its arm may start anew elsewhere, or nothing.

        Parameters
        ----------
        now : float
            [s]
        """
        if not (self._follower.is_engaged and self._sends_poses and self._is_robot_old(now)):
            return ''
        fault = f': {self._frame_fault}' if self._frame_fault else ''
        return f"the pose of the robot's wrist ended{fault}"

    def command(self, now: float, is_following: bool) -> WristCommand | None:
        """Return the command to send now; None where nothing is to be sent.

        Parameters
        ----------
        now : float
            [s]
        is_following : bool
            Whether the fingers follow; while they do not the wrist stays.
        """
        self._follower.clutch(self.is_clutched or not is_following)
        return self._follower.command(now)

    def status(self, now: float) -> str:
        """Return which pose the arm lacks, engaged or not, or that it is held; else 'ok'."""
        return (self._frame_fault or self.fault or self._follower.missing(self._start(now), now)
                or ('held by the clutch' if self.is_clutched else 'ok'))
