"""The launch file under test, and what is missing to launch it."""

import os
import shutil
from importlib.util import find_spec
from pathlib import Path

from hand_tracker.launching.launch_plan import LaunchPlan

LAUNCH = Path(__file__).resolve().parents[2] / 'launch' / 'track.launch.py'
DEMO_RATE = 120.   # of the recording [Hz]
FIRST_START = 240.  # [s]: kernels may have to be compiled, and other work run beside
LAUNCH_DEFAULTS = {
    **dict.fromkeys((
        'topic', 'message', 'server', 'subject', 'up', 'latency', 'hand', 'layout', 'left_hand',
        'namespace', 'parameters', 'robot', 'robot_description', 'left_robot',
        'left_robot_description', 'outputs', 'body_frame', 'mount', 'left_body_frame',
        'left_mount', 'keystore'), ''),
    'source': 'recording', 'source_process': 'auto', 'markers': 'markers', 'rate': '1.0',
    'side': 'auto', 'limits': 'auto', 'coupling': 'auto', 'thumb': 'saddle', 'prefix': 'auto',
    'rviz': 'false', 'show_robot': 'auto', 'robot_process': 'own', 'use_sim_time': 'false',
    'respawn': 'auto', 'lifecycle': 'false', 'use_security': 'false'}


def installed(package):
    """Return whether nodes of a package can be started."""
    return any(Path(prefix, 'lib', package).is_dir()
               for prefix in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep))


def lack():
    """Return what is missing to launch, or None."""
    if missing := [name for name in ('launch', 'launch_ros', 'rclpy', 'tf2_msgs')
                   if find_spec(name) is None]:
        return f"not installed: {', '.join(missing)}"
    if shutil.which('ros2') is None:
        return 'there is no ros2 command'
    if not installed('hand_tracker'):
        return 'hand_tracker is not installed by colcon, or its workspace is not sourced'


LACK = lack()


def plan_of(is_installed=True, **given):
    """Return the plan of a launch with these arguments."""
    return LaunchPlan({**LAUNCH_DEFAULTS, **given}, lambda package: is_installed)


def named(prefix, names):
    return [prefix + name for name in names]
