"""Running nodes: a process always ends, also where its way out hangs."""

import sys

import pytest
from helpers.ros_process import Process

NEEDS = 'rclpy',
pytestmark = pytest.mark.ros

HANGS_AT_ITS_END = '''
from threading import Event
from rclpy.node import Node
from hand_tracker.nodes import runner

class Hanging(Node):
    def __init__(self):
        super().__init__('hanging')
        self.create_timer(.01, self.say)

    def say(self):
        print('spins', flush=True)

    def destroy_node(self):
        print('hangs', flush=True)
        Event().wait()

runner.END_TIMEOUT = .5
raise SystemExit(runner.run(Hanging))
'''


def test_a_process_whose_end_hangs_is_ended_with_a_traceback():
    with Process([sys.executable, '-c', HANGS_AT_ITS_END]) as process:
        process.wait_for_line('spins')
        assert process.interrupt() == 1
        assert 'hangs' in process.output
        assert 'in destroy_node' in process.output
