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


@pytest.mark.parametrize('node', ['tracker', 'simulate'])
def test_arguments_as_of_a_launch_file_are_refused_with_how_a_node_takes_them(node):
    with Process([sys.executable, '-m', 'hand_tracker.entry', node, 'side:=left']) as process:
        process.wait_for_line("'side:=left': no arguments of ROS; expected parameters as "
                              '--ros-args -p side:=left')
        assert process.wait() == 1


def test_a_parameter_without_its_flag_is_refused_with_how_it_is_given():
    module = 'hand_tracker.nodes.tracker_node'
    with Process([sys.executable, '-m', module, '--ros-args', 'side:=left']) as process:
        process.wait_for_line("'side:=left': no arguments of ROS; expected parameters as "
                              '--ros-args -p side:=left')
        assert process.wait() == 1


def test_words_that_ros_does_not_know_are_refused():
    module = 'hand_tracker.nodes.tracker_node'
    with Process([sys.executable, '-m', module, '--side', 'left', '--ros-args']) as process:
        process.wait_for_line("'--side left': no arguments of ROS; expected parameters as --ros-a")
        assert process.wait() == 1


FAULT_BESIDE_A_LOOP = '''
from threading import Event
from rclpy.node import Node
from hand_tracker.nodes import all_node, runner

class Faulty(Node):
    def __init__(self):
        super().__init__('faulty')
        self.create_timer(.01, self.fail)

    def fail(self):
        raise {error}

class Leading(Node):
    def __init__(self):
        super().__init__('leading')

    def play(self):
        {loop}

raise SystemExit(runner.run_together(dict(leading=Leading, faulty=Faulty), all_node.serve))
'''


@pytest.mark.parametrize('loop', ['runner.spin(self)', 'Event().wait()'])
@pytest.mark.parametrize('error, is_the_users', [
    ('ValueError("it broke")', False), ('runner.InvalidArguments("it broke")', True)])
def test_a_fault_beside_a_loop_ends_all_with_its_reason(loop, error, is_the_users):
    script = FAULT_BESIDE_A_LOOP.format(error=error, loop=loop)
    with Process([sys.executable, '-c', script]) as process:
        assert process.wait() == 1, process.output
    assert 'it broke' in process.output
    assert ('Traceback' not in process.output) == is_the_users
    assert 'KeyboardInterrupt' not in process.output


INTERRUPTED_WORK = '''
from contextlib import closing
from itertools import count
from threading import Event
from rclpy.node import Node
from hand_tracker.nodes import runner
from hand_tracker.tracking.playback import read_ahead

def work(node):
    ended = Event()

    def count_up():
        with closing(read_ahead(count(), 4)) as numbers:
            for number in numbers:
                if number == 1000:
                    print('works', flush=True)
                if ended.is_set():
                    print('stopped', flush=True)
                    return

    runner.work_in_thread(count_up, ended.set)

raise SystemExit(runner.run(lambda: Node('working'), work))
'''


def test_an_interrupt_tells_what_works_in_a_thread_to_stop():
    with Process([sys.executable, '-c', INTERRUPTED_WORK]) as process:
        process.wait_for_line('works')
        assert process.interrupt() == 0, process.output
        assert 'stopped' in process.output and 'Traceback' not in process.output


def test_what_is_raised_in_a_thread_is_raised_where_it_is_waited_for():
    from hand_tracker.nodes.runner import work_in_thread

    def work():
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        work_in_thread(work, print)
