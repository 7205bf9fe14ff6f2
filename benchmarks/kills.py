"""Kill nodes at random instants and start them anew: who comes back, how soon, who notices.

    python -m benchmarks.kills [--count 200] [--seed 1] [--json OUT]

A simulated driver, a tracker and a robot's node run beside a replay with a tracker of its own and a
viewer. One of driver, tracker, replay, viewer and a minimal node in rclpy, as a yardstick, which
answers the driver, is chosen at random, sent SIGKILL at a random instant and started anew at once.
A row each: how often, the time from the start to the first answer (of the viewer: to its page), and
the longest pause in the answers of the chain that lost nothing. The robot is engaged anew after
each; its commands may step by what its guard allows, and by nothing more. The exit code is 1 where
one does, or where a node does not come back.
"""

import argparse
import random
import signal
import sys
import time
from contextlib import ExitStack
from pathlib import Path

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
sys.path.append(str(Path(__file__).resolve().parent.parent / 'test'))

import numpy as np

from benchmarks.common import RATE, add_json_option, environment, write_rows
from benchmarks.round_trip import FIRST_ANSWER_TIME

LONGEST_WAIT = 1.       # [s] before a kill
DRIVEN, PLAYED, ECHOED = CHAINS = 'driven', 'played', 'echoed'
# Module and arguments, arguments of ROS, and chain of each; the viewer, which is of none, shows the
# driven one.
KILLED_NODES = {
    'driver': ('hand_tracker.entry simulate', f'-p rate:={RATE}', DRIVEN),
    'tracker': ('hand_tracker.entry tracker', '', DRIVEN),
    'replay': ('hand_tracker.entry replay', '-p loop:=true', PLAYED),
    'viewer': ('hand_tracker.entry viewer --port 0', f'-p tracker:=/{DRIVEN}/hand_tracker', None),
    'rclpy_echo': ('benchmarks.round_trip --echo', f'-r markers:=/{DRIVEN}/markers', ECHOED)}
BESIDE = {'retarget': ('hand_tracker.entry retarget', '-p robot:=plain', DRIVEN),
          'tracker of the replay': ('hand_tracker.entry tracker', '', PLAYED)}
SHOWN = 'The hand is at'


class Answers:
    """When the answers of a chain came, and the longest pause between two."""

    def __init__(self, node, chain):
        from sensor_msgs.msg import JointState
        self.last = self.longest = 0.
        self.count = 0
        node.create_subscription(JointState, f'/{chain}/joint_states', self._take, 100, raw=True)

    def _take(self, _):
        now = time.monotonic()
        if self.count:
            self.longest = max(self.longest, now - self.last)
        self.last = now
        self.count += 1

    def begin(self):
        """Drop the pauses so far."""
        self.longest, self.last, self.count = 0., time.monotonic(), 1


class Rig:
    """All processes, and a node that watches them."""

    def __init__(self, stack):
        from helpers.robots import FollowingRobot
        from helpers.ros_process import watching_node
        self._stack = stack
        self.node = stack.enter_context(watching_node('kills'))
        self.answers = {chain: Answers(self.node, chain) for chain in CHAINS}
        self.robot = FollowingRobot(self.node, f'/{DRIVEN}/')
        self.started = []      # name and process of each that was ever started
        self.processes = {name: self.start(name) for name in (*KILLED_NODES, *BESIDE)}

    def start(self, name):
        """Start a node; return its process."""
        from helpers.ros_process import Process
        command, words, chain = {**KILLED_NODES, **BESIDE}[name]
        process = self._stack.enter_context(Process([
            sys.executable, '-m', *command.split(), '--ros-args',
            '-r', f'__ns:=/{chain or "shown"}', *words.split()]))
        self.started.append((name, process))
        return process

    def works(self, name):
        """Return whether a node does what it is for, since `Answers.begin`."""
        chain = KILLED_NODES[name][2]
        if chain is None:
            return SHOWN in self.processes[name].output
        return self.answers[chain].count > 5

    def wait_for(self, name):
        """Wait until a node works; return how long it took from now [s], NaN if it does not."""
        began = time.monotonic()
        while not self.works(name):
            if time.monotonic() - began > FIRST_ANSWER_TIME or self.processes[name].ended:
                return float('nan')
            self.node.spin_for(.01)
        return time.monotonic() - began


def kill(rig, name):
    """Kill a node and start it anew; return seconds to its return and the others' pause."""
    process = rig.processes[name]
    rig.node.spin_for(random.uniform(0., LONGEST_WAIT))
    process.send_signal(signal.SIGKILL)
    process.wait()
    # What it had sent is on its way yet.
    rig.node.spin_for(.05)
    for one in rig.answers.values():
        one.begin()
    rig.processes[name] = rig.start(name)
    seconds = rig.wait_for(name)
    # Without a driver nothing is echoed either.
    others = {DRIVEN, PLAYED} - {KILLED_NODES[name][2]}
    return seconds, max(rig.answers[chain].longest for chain in others)


def main():
    """Kill, print and judge."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--count', type=int, default=200, help='kills in all')
    parser.add_argument('--seed', type=int, default=1)
    add_json_option(parser)
    options = parser.parse_args()
    random.seed(options.seed)
    print(environment())
    found = {name: [] for name in KILLED_NODES}
    with ExitStack() as stack:
        rig = Rig(stack)
        for name in KILLED_NODES:
            if not np.isfinite(rig.wait_for(name)):
                raise SystemExit(f'{name} does not work:\n{rig.processes[name].output}')
        for _ in range(options.count):
            rig.robot.engage()
            name = random.choice(list(KILLED_NODES))
            found[name].append(kill(rig, name))
            if not np.isfinite(found[name][-1][0]):
                print(f'{name} did not come back:\n{rig.processes[name].output}')
                break
        else:
            rig.robot.engage()
        steps, allowed = rig.robot.steps_and_bounds(1. / RATE, 1. / RATE)
        tracebacks = [name for name, process in rig.started if 'Traceback' in process.output]
    rows = []
    for name, times in found.items():
        seconds, pauses = np.array(times).reshape(-1, 2).T
        if not len(seconds):
            continue
        median, p95, longest = np.percentile(seconds, (50, 95, 100))
        rows.append({'process': name, 'kills': len(seconds),
                     'came_back': int(np.isfinite(seconds).sum()), 'median_s': round(median, 2),
                     'p95_s': round(p95, 2), 'longest_s': round(longest, 2),
                     'longest_pause_of_others_s': round(float(pauses.max()), 3)})
        print('{process:10} {came_back} of {kills} came back: {median_s} s, p95 {p95_s}, longest '
              '{longest_s}; longest pause of the others {longest_pause_of_others_s} s'.format(
                  **rows[-1]))
    over = int((steps > allowed).sum())
    rows.append({'process': 'robot', 'commands': len(steps) + 1, 'steps_over_the_bound': over,
                 'largest_step_rad': round(float(steps.max(initial=0.)), 4)})
    print('robot: {commands} commands, {steps_over_the_bound} steps over the bound, the largest '
          '{largest_step_rad} rad'.format(**rows[-1]))
    if tracebacks:
        print(f'tracebacks of {", ".join(tracebacks)}')
    write_rows(options.json, rows)
    return int(bool(over or tracebacks or any(
        row['came_back'] < row['kills'] for row in rows[:-1])))


if __name__ == '__main__':
    sys.exit(main())
