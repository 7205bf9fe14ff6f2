"""The robot of `demo --grasp`: simulated in MuJoCo, with a ball in its palm.

Its joint states are those of the simulation; its commands come over the same topics as a real
robot's. It is judged by where the ball is.
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
from rclpy.node import Node
from sensor_msgs.msg import JointState

from ..core.errors import HandTrackerError
from ..core.model.hand import Hand
from ..drawing.grasp_picture import GraspMoment, PlacedShape, save_grasp_picture
from ..drawing.palette import ORANGE, rgb
from ..messages.stamps import nanoseconds
from ..retargeting.robot_file import LoadedRobot
from ..simulation.ball_grasp import (
    BALL_RADIUS,
    CLOSED_AT,
    FREE_FROM,
    LOST_FROM,
    OPENS_AT,
    TURN_TIME,
    TURNED_AT,
    BallGrasp,
    turn_at,
)
from .demo_robot import DrivenRobot

# Of the recording [s], in words.
DRAWN_MOMENTS = {
    CLOSED_AT - 2.: 'in the open palm', CLOSED_AT: 'grasped', CLOSED_AT + .5 * TURN_TIME: 'turned',
    TURNED_AT + .2: 'upside down', OPENS_AT - .1: f'held for {OPENS_AT - TURNED_AT:.0f} s'}


class GraspTrack:
    """Recorded path of the ball and of the joints.

    Attributes
    ----------
    times : list of float
        Of the recording [s].
    balls, joints : list of ndarray, shape (3,) and (m,)
        In the palm's frame [m]; of all movable joints [rad].
    """

    def __init__(self) -> None:
        self.times: list[float] = []
        self.balls: list[np.ndarray] = []
        self.joints: list[np.ndarray] = []

    def row(self, at: float) -> int:
        """Return the row of the first moment from a time on [s]; the last one after the end."""
        return min(int(np.searchsorted(self.times, at)), len(self.times) - 1)

    def moved(self) -> float:
        """Return the ball's movement in the hand while that was closed [m]."""
        held = np.array(self.balls)[self.row(CLOSED_AT):self.row(OPENS_AT)]
        return float(np.linalg.norm(held - held[0], axis=1).max())

    def fell(self) -> float:
        """Return the ball's movement after the hand opened [m]."""
        return float(np.linalg.norm(self.balls[-1] - self.balls[self.row(OPENS_AT)]))


class GraspingRobot(DrivenRobot):
    """Simulated robot that holds a ball.

    Parameters
    ----------
    node : rclpy.node.Node
    loaded : LoadedRobot
        The plain hand, whose palm the ball is placed in.

    Raises
    ------
    PhysicsUnavailable
    """

    def __init__(self, node: Node, loaded: LoadedRobot) -> None:
        self._physics = BallGrasp(loaded)
        self.track = GraspTrack()
        self._start: int | None = None  # stamp of the recording's first frame [ns]
        super().__init__(node, loaded)
        self._commanded = [self._model.joint_names.index(name) for name in loaded.order]
        node.create_subscription(JointState, 'joint_states', self._on_hand, 100)

    def _on_hand(self, message: JointState) -> None:
        if self._start is None:
            self._start = nanoseconds(message.header.stamp)

    def _on_command(self, message: JointState) -> None:
        self._advance()
        super()._on_command(message)
        self._physics.command(self._position[self._commanded])

    def _publish_joint_states(self) -> None:
        self._advance()
        commanded, self._position = self._position, self._physics.joints
        super()._publish_joint_states()
        self._position = commanded

    def _advance(self) -> None:
        if self._start is None:
            return
        # The replay stamps each frame with the time at which it is due.
        self._physics.advance(1e-9 * (time.time_ns() - self._start))
        self.track.times.append(self._physics.time)
        self.track.balls.append(self._physics.ball)
        self.track.joints.append(self._physics.joints)

    def save(self, output: Path, hand: Hand, stamps: np.ndarray, angles: np.ndarray) -> None:
        """Draw also the grasp, `grasp.png`; raise HandTrackerError where the ball was dropped."""
        super().save(output, hand, stamps, angles)
        if not self.track.times or self.track.times[-1] <= OPENS_AT:
            raise HandTrackerError('the recording ended before the hand opened')
        moments = [self._moment(at, title) for at, title in DRAWN_MOMENTS.items()]
        save_grasp_picture(output / 'grasp.png', moments)
        moved = self.track.moved()
        outcome = (f'the ball moved by {1e3 * moved:.1f} mm in the closed hand, '
                   f'{OPENS_AT - TURNED_AT:.1f} s of it upside down')
        if moved > LOST_FROM:
            raise HandTrackerError(f'the ball was dropped: {outcome}')
        if self.track.fell() < FREE_FROM:
            raise HandTrackerError('the ball did not fall when the hand opened')
        print(f'  {output / "grasp.png"}: {outcome}; it fell once the hand opened')

    def _moment(self, at: float, title: str) -> GraspMoment:
        """Return the shapes of the simulation to draw at a time, up along z."""
        row = self.track.row(at)
        model, joints = self._model, self.track.joints[row]
        frames = model.frames(model.variable_positions(joints))
        turned = turn_at(self.track.times[row]) - np.pi
        c, s = np.cos(turned), np.sin(turned)
        world = np.array(((1., 0., 0.), (0., c, -s), (0., s, c)))
        shapes = []
        for shape in model.shapes:
            rotation, position = model.link_pose(shape.link, frames)
            shapes.append(PlacedShape(
                shape.kind, shape.size, world @ rotation @ shape.rotation,
                world @ (position + rotation @ shape.translation), shape.colour))
        ball = PlacedShape('sphere', (BALL_RADIUS,), world, world @ self.track.balls[row],
                           rgb(ORANGE))
        return GraspMoment(title, [*shapes, ball])
