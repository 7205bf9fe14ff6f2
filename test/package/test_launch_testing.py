"""The launch file under launch_testing, which sees the exit code of every process."""

import unittest

import pytest
from test_launch import FIRST_START, LACK, LAUNCH, RATE, named

from hand_tracker.core.model.hand import JOINTS

if LACK is not None:
    pytest.skip(LACK, allow_module_level=True)

launch_testing = pytest.importorskip('launch_testing')

from helpers.ros_process import watching_node  # noqa: E402
from launch.actions import IncludeLaunchDescription  # noqa: E402
from launch.launch_description_sources import PythonLaunchDescriptionSource  # noqa: E402
from launch_testing.actions import ReadyToTest  # noqa: E402
from launch_testing.asserts import assertExitCodes  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402

from launch import LaunchDescription  # noqa: E402


@pytest.mark.launch_test
def generate_test_description():
    return LaunchDescription([
        IncludeLaunchDescription(PythonLaunchDescriptionSource(str(LAUNCH))), ReadyToTest()])


class TestRunning(unittest.TestCase):

    def test_joint_states(self):
        with watching_node() as watch:
            states = watch.collect(JointState, 'joint_states')
            watch.spin_until(lambda: len(states) > RATE, FIRST_START)
        self.assertEqual(list(states[-1].name), named('right_', JOINTS))


@launch_testing.post_shutdown_test()
class TestEnded(unittest.TestCase):

    def test_exit_codes(self, proc_info):
        assertExitCodes(proc_info)
        self.assertGreaterEqual(len(list(proc_info)), 2)
