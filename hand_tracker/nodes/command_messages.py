"""Messages of a robot's command: templates of bytes where rclpy lays them out so, else objects."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from rclpy.duration import Duration
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from ..messages.builders import joint_state
from ..messages.stamps import Time
from ..messages.templates import (
    Template,
    joint_state_template,
    joint_trajectory_template,
    position_array_template,
)
from .serialization import SAMPLE_STAMP

OUTPUTS = {'joint_state': ('robot/command', JointState),
           'joint_trajectory': ('robot/joint_trajectory', JointTrajectory),
           'position_array': ('robot/position_array', Float64MultiArray)}


class CommandObjects(NamedTuple):
    """Builder of command messages as objects, where they are not `Template` bytes."""

    fill: Callable[[Time, np.ndarray], Any]


def command_template(output: str, names: Sequence[str], period: float,
                     raw: bool) -> Template | CommandObjects:
    """Return the template of a robot's command, of bytes or of objects.

    Parameters
    ----------
    output : str
        One of `OUTPUTS`.
    names : sequence of str
        Of the joints.
    period : float
        From the start of a trajectory to its point [s].
    raw : bool
        Whether messages may be bytes.
    """
    after = Duration(seconds=period)
    templates: dict[str, Callable[[], Template]] = {
        'joint_state': lambda: joint_state_template(names),
        'joint_trajectory': lambda: joint_trajectory_template(names, after.nanoseconds),
        'position_array': lambda: position_array_template(len(names))}
    objects = CommandObjects({
        'joint_state': lambda stamp, position: joint_state(stamp, names, position),
        # No stamp: the controller begins at once.
        'joint_trajectory': lambda _, position: JointTrajectory(
            joint_names=names, points=[JointTrajectoryPoint(
                positions=position.tolist(), time_from_start=after.to_msg())]),
        'position_array': lambda _, position: Float64MultiArray(data=position.tolist()),
    }[output])
    if not raw:
        return objects
    template, kind = templates[output](), OUTPUTS[output][1]
    sample = np.linspace(-1., 1., len(names))
    expected = deserialize_message(serialize_message(objects.fill(SAMPLE_STAMP, sample)), kind)
    given = deserialize_message(template.fill(SAMPLE_STAMP, sample), kind)
    return template if given == expected else objects
