"""Robot hands for tests: our own hand as a robot, small ones, and third-party URDFs by path."""

import numpy as np
import pytest

from hand_tracker.core.model.hand import Hand, preset_limits
from hand_tracker.files.urdf_file import urdf
from hand_tracker.messages.stamps import nanoseconds
from hand_tracker.retargeting.guard_options import GuardOptions
from hand_tracker.retargeting.robot_file import load_robot
from hand_tracker.retargeting.robot_hand import robot_hand
from hand_tracker.retargeting.robot_urdf import load_urdf_tree, read_urdf_tree
from helpers.capture_files import capture_folder

STATE_PERIOD = .005   # [s]
ENGAGED_ANEW = .5     # [s] without a command: the robot has been disengaged between
# A gripper of one variable: two prismatic fingers, the second mimics the first.
GRIPPER = """<robot name="gripper">
<link name="base"/><link name="left"/><link name="right"/><link name="left_tip"/>
<link name="right_tip"/>
<joint name="slide" type="prismatic"><parent link="base"/><child link="left"/>
<axis xyz="0 1 0"/><limit lower="0" upper="0.04" velocity="0.2"/></joint>
<joint name="other" type="prismatic"><parent link="base"/><child link="right"/>
<axis xyz="0 -1 0"/><limit lower="0" upper="0.04" velocity="0.2"/><mimic joint="slide"/></joint>
<joint name="left_end" type="fixed"><parent link="left"/><child link="left_tip"/>
<origin xyz="0 0.006 0.1"/></joint>
<joint name="right_end" type="fixed"><parent link="right"/><child link="right_tip"/>
<origin xyz="0 -0.006 0.1"/></joint>
</robot>"""

# Four-bar fingers as of Robotiq's grippers, without frames at the pads: 80 mm apart when open, and
# meeting at the end of the range.
PARALLEL_GRIPPER = """<robot name="parallel_gripper">
<link name="base"/><link name="left_knuckle"/><link name="right_knuckle"/>
<link name="left_pad_carrier"/><link name="right_pad_carrier"/>
<joint name="drive" type="revolute"><parent link="base"/><child link="left_knuckle"/>
<origin xyz="0.03 0 0.06"/><axis xyz="0 -1 0"/><limit lower="0" upper="0.8"/></joint>
<joint name="right_drive" type="revolute"><parent link="base"/><child link="right_knuckle"/>
<origin xyz="-0.03 0 0.06"/><axis xyz="0 -1 0"/><limit lower="-0.8" upper="0"/>
<mimic joint="drive" multiplier="-1"/></joint>
<joint name="left_end" type="revolute"><parent link="left_knuckle"/><child link="left_pad_carrier"/>
<origin xyz="0.037 0 0.043"/><axis xyz="0 -1 0"/><limit lower="-0.8" upper="0"/>
<mimic joint="drive" multiplier="-1"/></joint>
<joint name="right_end" type="revolute"><parent link="right_knuckle"/>
<child link="right_pad_carrier"/><origin xyz="-0.037 0 0.043"/><axis xyz="0 -1 0"/>
<limit lower="0" upper="0.8"/><mimic joint="drive"/></joint>
</robot>"""


def wide_hand(side='right'):
    """Return the mean hand with the wide limits."""
    return Hand.scaled(side=side, limits=preset_limits('wide'))


def human_robot_file(folder):
    """Write the URDF of our own hand into a folder; return its path, str."""
    path = folder / 'robot.urdf'
    path.write_text(urdf(wide_hand()))
    return str(path)


def human_robot(side='right'):
    """Return our own hand as a robot."""
    return robot_hand(read_urdf_tree(urdf(wide_hand(side))))


def dexi_urdf(name):
    """Return the path of a URDF that dexi-rs brings; the test that asks is skipped without it."""
    dexi = pytest.importorskip(
        'dexi_rs', reason=f'no dexi_rs, which brings {name}.urdf (requirements/peers.in)')
    found = sorted(dexi.asset_path('robots/hands').rglob(f'{name}.urdf'))
    assert len(found) == 1, f'{name}.urdf among the assets of dexi_rs: {found}'
    return found[0]


def third_party_urdf(name):
    """Return the path of a URDF of the captures' folder, else of dexi-rs; as `dexi_urdf` skips."""
    path = capture_folder() / 'robots' / f'{name}.urdf'
    return path if path.exists() else dexi_urdf(name)


def third_party_robot(name):
    """Return a robot of the captures' folder; the test that asks is skipped where it is absent."""
    return robot_hand(load_urdf_tree(third_party_urdf(name)))


class FollowingRobot:
    """A plain robot hand that is where it was told to be, and tells it.

    Parameters
    ----------
    node : rclpy.node.Node
        That watches.
    namespace : str, optional
        Of the node that drives it, with a slash behind.
    """

    def __init__(self, node, namespace=''):
        from sensor_msgs.msg import JointState
        self._node, self._namespace, self._type = node, namespace, JointState
        self.commands = node.collect(JointState, f'{namespace}robot/command')
        # The last one, however many wait: a robot's state is not late.
        node.create_subscription(JointState, f'{namespace}robot/command', self._move, 1)
        self._publisher = node.create_publisher(JointState, f'{namespace}robot/joint_states', 10)
        names = list(load_robot('plain').hand.model.joint_names)
        self._state = JointState(name=names, position=[.1] * len(names))
        node.create_timer(STATE_PERIOD, self._tell)

    def _move(self, command):
        self._state = self._type(name=command.name, position=command.position)

    def _tell(self):
        self._publisher.publish(self._state)

    def engage(self):
        """Engage it until it moves: on a busy machine a hand may be late, which disengages it."""
        from std_srvs.srv import SetBool
        before = len(self.commands)
        self._node.repeat(
            lambda: self._node.call(SetBool, f'{self._namespace}retarget/engage',
                                    SetBool.Request(data=True)),
            lambda: len(self.commands) > before + 20, .2)

    def steps_and_bounds(self, period, stamp_period):
        """Return the largest step of each command from the last one, and what it may be [rad].

        A busy machine may lose commands, whose steps add up; where the robot was engaged anew, none
        may be lost.

        Parameters
        ----------
        period, stamp_period : float
            Between two frames, and between their stamps [s].
        """
        steps = np.abs(np.diff([command.position for command in self.commands], axis=0))
        between = np.diff([nanoseconds(command.header.stamp) for command in self.commands])
        options = GuardOptions()
        periods = np.maximum(1e-9 * between / stamp_period, 1.)
        periods[periods > ENGAGED_ANEW / period] = 1.
        return steps.max(axis=1), options.max_speed * options.max_dt * periods
