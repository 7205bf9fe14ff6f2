"""Simulated robot driver of the demo: answers commands with joint states that reach them at once.

It engages the retarget node by its service once there is a hand. Its commands are drawn beside the
hand.
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
from rclpy.node import Node
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool

from ..calibration.landmarks import landmark_positions
from ..core.errors import HandTrackerError
from ..core.model.hand import Hand
from ..core.model.kinematics import forward, joint_table
from ..drawing.images import spread_rows
from ..drawing.robot_picture import RobotPose, save_robot_animation, save_robot_picture
from ..messages.stamps import nanoseconds
from ..nodes.topic_publishers import UNPUBLISHED
from ..retargeting.robot_file import LoadedRobot
from .robot_poses import robot_pose

ROBOT_STATES_PERIOD = .02  # [s]
ENGAGE_EVERY = .25         # [s]
ROBOT_GIF_RATE = 10.       # [Hz]
DRAWN_POSES = 6


class DrivenRobot:
    """Robot that follows the commands of a retarget node.

    Parameters
    ----------
    node : rclpy.node.Node
    loaded : LoadedRobot
    """

    def __init__(self, node: Node, loaded: LoadedRobot) -> None:
        self.loaded = loaded
        self._model = loaded.hand.model
        self._position = self._model.joint_positions(loaded.hand.rest)
        # Of the variables, by stamp [ns]: that of the frame of the hand that is answered.
        self.commands: dict[int, np.ndarray] = {}
        self._asked = self._command_time = 0.
        self._refusals: list[str] = []  # why the retarget node did not engage, each reason once
        self.knows_tracker = False      # whether the retarget node has met the tracker
        self._states = node.create_publisher(JointState, 'robot/joint_states', 10)
        self._engage = node.create_client(SetBool, 'retarget/engage')
        node.create_subscription(JointState, 'robot/command', self._on_command, 100)
        node.create_timer(ROBOT_STATES_PERIOD, self._publish_joint_states)

    @property
    def is_ready(self) -> bool:
        """Whether the retarget node is there."""
        return self._engage.service_is_ready()

    def _on_command(self, message: JointState) -> None:
        self._command_time = time.monotonic()
        at = dict(zip(message.name, message.position))
        self._position = np.array([at.get(name, before) for name, before in zip(
            self._model.joint_names, self._position)])
        # Not each is commanded, as those of an arm are not.
        self.commands[nanoseconds(message.header.stamp)] = self._model.variable_positions(
            self._position)

    def _publish_joint_states(self) -> None:
        self._states.publish(JointState(
            name=self._model.joint_names, position=self._position.tolist()))
        now = time.monotonic()
        # Again where it was disengaged, as on a machine that is too busy.
        if self.is_ready and now - max(self._asked, self._command_time) > ENGAGE_EVERY:
            self._asked = now
            answer = self._engage.call_async(SetBool.Request(data=True))
            answer.add_done_callback(self._on_answer)

    def _on_answer(self, answer: Future) -> None:
        response = answer.result()
        self.knows_tracker = UNPUBLISHED not in response.message
        if not response.success and response.message not in self._refusals:
            self._refusals.append(response.message)

    def save(self, output: Path, hand: Hand, stamps: np.ndarray, angles: np.ndarray) -> None:
        """Draw what it was commanded beside what the hand did: `robot.gif` and `robot.png`.

        Parameters
        ----------
        output : Path
        hand : Hand
            The person's.
        stamps : ndarray of int, shape (n,)
            Of the frames of the hand [ns].
        angles : ndarray, shape (n, 25)
            [rad]

        Raises
        ------
        HandTrackerError
            If no command came, or only after the recording.
        """
        if len(self.commands) < 2:
            why = '; '.join(self._refusals) or 'the retarget node did not answer'
            raise HandTrackerError(f'the robot got no command: {why}')
        rows = np.array([row for row, stamp in enumerate(stamps.tolist())
                         if stamp in self.commands], dtype=int)
        if len(rows) < 2:
            raise HandTrackerError('the robot was engaged only as the recording ended; expected a '
                                   'longer one, or a smaller --rate')
        table, robot = joint_table(hand), self.loaded.hand

        def pose(row: int) -> RobotPose:
            stamp = int(stamps[row])
            return robot_pose(f'{1e-9 * (stamp - stamps[0]):.1f} s', landmark_positions(
                hand, forward(table, angles[row])), robot, self.commands[stamp])

        answered = stamps[rows]
        times = np.arange(answered[0], answered[-1], round(1e9 / ROBOT_GIF_RATE))
        save_robot_animation(
            output / 'robot.gif', robot.name,
            [pose(row) for row in rows[np.searchsorted(answered, times)]], ROBOT_GIF_RATE)
        save_robot_picture(output / 'robot.png', robot.name,
                           [pose(rows[i]) for i in spread_rows(len(rows), DRAWN_POSES)])
        print(f'  {output / "robot.gif"}, {output / "robot.png"}: {robot.name} beside the hand, '
              f'{len(self.commands)} commands; in the browser with --view')
