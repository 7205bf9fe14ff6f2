"""The launch file under launch_testing, which sees the exit code of every process."""

import sys
import unittest
from pathlib import Path

import launch_testing
import pytest
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch_testing.actions import ReadyToTest
from launch_testing.asserts import assertExitCodes
from sensor_msgs.msg import JointState

from hand_tracker.core.model.hand import JOINTS
from launch import LaunchDescription

# The command launch_test reads no configuration of pytest.
sys.path.append(str(Path(__file__).resolve().parents[1]))
from helpers.launching import DEMO_RATE, FIRST_START, LACK, LAUNCH, named  # noqa: E402
from helpers.ros_process import watching_node  # noqa: E402

NEEDS = 'launch_testing', 'launch_ros', 'rclpy'


@pytest.mark.launch_test
def generate_test_description():
    if LACK is not None:
        pytest.skip(LACK)
    return LaunchDescription([
        IncludeLaunchDescription(PythonLaunchDescriptionSource(str(LAUNCH))), ReadyToTest()])


class TestRunning(unittest.TestCase):

    def test_joint_states(self):
        with watching_node() as watch:
            states = watch.collect(JointState, 'joint_states')
            watch.spin_until(lambda: len(states) > DEMO_RATE, FIRST_START)
        self.assertEqual(list(states[-1].name), named('right_', JOINTS))


@launch_testing.post_shutdown_test()
class TestEnded(unittest.TestCase):

    def test_exit_codes(self, proc_info):
        assertExitCodes(proc_info)
        self.assertGreaterEqual(len(list(proc_info)), 2)
