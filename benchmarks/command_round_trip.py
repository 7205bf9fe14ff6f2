"""Measure the way from markers to a robot's command over DDS, beside the C echo's round trip.

    python -m benchmarks.command_round_trip [--rates 120 480] [--robot plain] [--json OUT]

Markers are published, and at 100 Hz the joint states of the robot; a tracker node and a retarget
node, in one process and each in one of its own, with their defaults, answer with the command of the
robot. In turns with them, in the same run, the tracker alone answers with joint states, and a
minimal echo in C answers each MarkerArray. Processor time is that of all processes of a row
together.
"""

import argparse
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import numpy as np

from benchmarks.common import (
    add_json_option,
    add_timing_options,
    end,
    environ,
    environment,
    write_rows,
)
from benchmarks.round_trip import (
    BOUTS,
    FIRST_ANSWER_TIME,
    WARM,
    Driver,
    compiled_echo,
    cpu_time,
    isolate,
    messages,
)
from hand_tracker.retargeting.robot_file import load_robot

ONE_PROCESS, TWO_PROCESSES = 'one_process', 'two_processes'
TRACKER_ALONE, C_ECHO = 'tracker', 'c_echo'
DRIVING = ONE_PROCESS, TWO_PROCESSES
ENGAGE_RATE = 100.  # [Hz] of markers meanwhile
ROBOT_RATE = 100.   # [Hz] of its joint states


def start(stack, folder, robot, urdf):
    """Start all nodes; return their processes by namespace."""
    def begin(command, namespace, *parameters):
        process = stack.enter_context(subprocess.Popen(
            [*map(str, command), '--ros-args', '-r', f'__ns:=/{namespace}',
             *(word for parameter in parameters for word in ('-p', parameter))],
            stderr=subprocess.DEVNULL, env=environ()))
        stack.callback(end, process)
        return process

    def node(name):
        return [sys.executable, '-m', f'hand_tracker.nodes.{name}_node']

    tracking = 'side:=right', 'auto_size:=false'
    driving = f'robot:={robot}', *([f'robot_description:={urdf}'] if urdf else [])
    processes = {
        ONE_PROCESS: [begin(node('teleoperate'), ONE_PROCESS, *tracking, *driving)],
        TWO_PROCESSES: [begin(node('tracker'), TWO_PROCESSES, *tracking),
                        begin(node('retarget'), TWO_PROCESSES, *driving)],
        TRACKER_ALONE: [begin(node('tracker'), TRACKER_ALONE, *tracking)]}
    if echo := compiled_echo(folder):
        processes[C_ECHO] = [begin(echo[1], C_ECHO)]
    else:
        print('c_echo: not there, it needs a C compiler and the headers of rcl')
    return processes


def tell_where_robot_is(node, robot):
    """Publish the joint states of a robot at rest to the nodes that drive it."""
    from rclpy.qos import QoSProfile
    from sensor_msgs.msg import JointState
    model = robot.model
    state = JointState(name=list(model.joint_names),
                       position=model.joint_positions(robot.rest).tolist())
    publishers = [node.create_publisher(JointState, f'/{name}/robot/joint_states', QoSProfile(
        depth=1)) for name in DRIVING]

    def tell():
        for publisher in publishers:
            publisher.publish(state)

    node.create_timer(1. / ROBOT_RATE, tell)


def engage(driver, name, frames):
    """Send markers and ask until the robot of a row is engaged."""
    from std_srvs.srv import SetBool
    client = driver.node.create_client(SetBool, f'/{name}/retarget/engage')
    asked, until = None, time.monotonic() + FIRST_ANSWER_TIME
    while asked is None or not (asked.done() and asked.result().success):
        if time.monotonic() > until:
            raise SystemExit('the robot is not engaged')
        if client.service_is_ready() and (asked is None or asked.done()):
            asked = client.call_async(SetBool.Request(data=True))
        # Without a pause: a hand that is lost does not engage.
        driver.send([name], frames, ENGAGE_RATE)
        driver.spin_until(time.perf_counter_ns() + round(1e9 / ENGAGE_RATE))


def main():
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add_timing_options(parser, [120., 480.])
    parser.add_argument('--robot', default='plain', help='preset or robot file')
    parser.add_argument('--urdf', default='', help="the robot's, for a preset")
    add_json_option(parser)
    options = parser.parse_args()
    isolate()
    print(environment())
    rows = []
    with TemporaryDirectory() as folder, ExitStack() as stack:
        processes = start(stack, folder, options.robot, options.urdf)
        frames = {rate: [messages(('right',), rate)] for rate in options.rates}
        driver = Driver(processes, dict.fromkeys(DRIVING, 'robot/command'))
        tell_where_robot_is(driver.node, load_robot(options.robot, options.urdf).hand)
        for name in processes:
            if name not in DRIVING and driver.wait_for(
                    name, processes[name][0], frames[options.rates[0]][0]) is None:
                raise SystemExit(f'{name} does not answer')
        for rate in options.rates:
            found = {name: ([], [], 0, 0.) for name in processes}
            for _ in range(BOUTS):
                for name, (trips, sent, used, seconds) in found.items():
                    if name in DRIVING:
                        # In the pause of the other turns the hand was lost.
                        engage(driver, name, frames[rate])
                    driver.measure([name], frames[rate], rate, WARM)
                    before, began = sum(map(cpu_time, processes[name])), time.monotonic()
                    (answered,), count = driver.measure(
                        [name], frames[rate], rate, options.seconds / BOUTS)
                    trips.extend(answered)
                    sent.append(count)
                    found[name] = (trips, sent, used + sum(
                        map(cpu_time, processes[name])) - before,
                        seconds + time.monotonic() - began)
            rows += [row_of(name, rate, *measured) for name, measured in found.items()]
            for row in rows[-len(found):]:
                print('{node:14} {rate_hz:5g} Hz  median {median_us:6.0f} µs  p99 {p99_us:6.0f} µs'
                      '  CPU {cpu_percent:5.1f} %  unanswered {unanswered_percent:.2f} %'.format(
                          **row), flush=True)
    write_rows(options.json, rows)
    return 0


def row_of(name, rate, trips, sent, used, seconds):
    """Return the row of a measurement."""
    median, p99 = np.percentile(trips, (50, 99)) * 1e-3 if trips else (np.nan, np.nan)
    return {'node': name, 'rate_hz': rate, 'median_us': round(float(median), 1),
            'p99_us': round(float(p99), 1), 'cpu_percent': round(100. * used / seconds, 1),
            'unanswered_percent': round(100. * (1. - len(trips) / sum(sent)), 3)}


if __name__ == '__main__':
    sys.exit(main())
