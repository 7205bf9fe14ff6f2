"""Measure hours of both hands under faults: memory, latency of each minute, lost frames, crashes.

    python -m benchmarks.soak [--hours 2] [--rate 480] [--listener-life 45] [--json OUT]

A tracker of both hands gets simulated markers with occlusion, exchanged labels, reflections,
drop-outs and frozen markers, while listeners come, go and are killed, parameters are set, some of
them not allowed, and the stamps jump. A second tracker follows a recording in a loop, which jumps
back at each lap. Markers and joint states are reliable and queued, so that the middleware loses
nothing: a frame without an answer is lost. The exit code is 1 where a bound is exceeded; growth
and latency are judged from `JUDGED_FROM` minutes on, as minutes of warming up show nothing.
"""

import argparse
import gc
import random
import subprocess
import sys
import time
from contextlib import ExitStack, suppress
from itertools import cycle
from pathlib import Path
from tempfile import TemporaryDirectory

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import numpy as np
import psutil

from benchmarks.common import (
    MARK,
    add_json_option,
    environ,
    environment,
    put_stamps,
    stamp_places,
    write_rows,
)
from benchmarks.round_trip import FIRST_ANSWER_TIME, FIRST_STAMP, HANDS, isolate

SOAK_LAP = 20.         # [s] of motion, sent forwards and backwards
LEFT_ABSENT_SHARE = .05  # share of a lap in which the left hand is not in the messages
SOAK_SEED = 16
FAULTS = {'swaps': .5, 'ghosts': .5, 'dropouts': 1., 'frozen': .2}  # [1/s] of each hand
SECOND, MINUTE = 1., 60.  # [s]
PARAMETERS_EVERY = 5.  # [s]
JUMP_EVERY = 20.       # [s]
LISTENER_TURN = 2.     # [s] in which it listens, and in which it does not
LISTENER_LIFE = 45.    # [s] until it is killed and another one comes, where no other is asked for
OVERDUE_TIME = 5.      # [s] after which a frame without an answer is lost
STOP_TIME = 30.        # [s] to end
QUEUE = 1000           # messages: two seconds
STAMP_JUMPS = -10., 3600., -3600., 'stray'  # [s], or one frame's stamp alone
PARAMETER_CHANGES = (  # of any kind; the last two are refused
    {'smoothing': False}, {'smoothing': True, 'swap_margin': 3.}, {'swap_margin': 2.},
    {'right.limits.index_pip_flexion.upper_deg': 60.},
    {'right.limits.index_pip_flexion.upper_deg': 110., 'prediction': 'vtm_ukf'},
    {'prediction': 'fading', 'display_rate': 5.}, {'display_rate': 60.},
    {'finger_ik': 'magic'}, {'unit_scale': 0.})

EDGE = 10              # first and last minutes that are compared, at most a third of all
JUDGED_FROM = 30       # minutes
MOST_SLOPE = 1.        # [MB/h] of resident memory
MOST_P99 = 1.2         # of the last minutes over that of the first
MOST_LINES = 150       # of the log in a minute: what the limits of both hands' lines add up to
MOST_FILES = 8         # descriptors more than after the first minute


def listen():
    """Listen to all that a tracker publishes, on and off, until killed."""
    import rclpy
    from rclpy.node import Node
    from sensor_msgs.msg import JointState
    from visualization_msgs.msg import MarkerArray

    rclpy.init()
    node = Node('listener')
    topics = [('joint_states', JointState), ('joint_confidence', JointState),
              ('right/hand_markers', MarkerArray), ('left/hand_markers', MarkerArray)]
    while True:
        subscriptions = [node.create_subscription(kind, f'/soak/{topic}', lambda data: None, 10,
                                                  raw=True) for topic, kind in topics]
        until = time.monotonic() + LISTENER_TURN
        while time.monotonic() < until:
            rclpy.spin_once(node, timeout_sec=.1)
        for subscription in subscriptions:
            node.destroy_subscription(subscription)
        time.sleep(LISTENER_TURN)


def simulated_messages(rate, folder):
    """Return messages of both hands under faults, and the hand file that a tracker gets.

    Returns
    -------
    messages : list of (bytearray, list of int, bool)
        Serialized MarkerArray, offsets of its stamps, whether it has both palms.
    path : Path
    """
    from builtin_interfaces.msg import Time
    from rclpy.serialization import serialize_message
    from visualization_msgs.msg import Marker, MarkerArray

    from hand_tracker.core.model.hand import Hand
    from hand_tracker.core.model.marker_layout import MARKERS, PALM_MARKERS
    from hand_tracker.files.hand_file import save_hand
    from hand_tracker.simulation.faults import Faults
    from hand_tracker.simulation.packaged_recordings import LEFT_HAND_OFFSET
    from hand_tracker.simulation.simulator import Simulation
    from hand_tracker.simulation.visibility import skin_layout

    hand = Hand.scaled()
    path = Path(folder, 'hand.yaml')
    save_hand(path, hand, skin_layout(hand))
    right, left = (Simulation(
        'demo', Hand.scaled(side=side), rate=rate, seed=SOAK_SEED + number, duration=SOAK_LAP,
        faults=Faults(**FAULTS)).recording().markers[:round(SOAK_LAP * rate)]
        for number, side in enumerate(HANDS))
    left = left + LEFT_HAND_OFFSET
    # In the second half lost markers are absent, in the first NaN.
    half = len(right) // 2
    left[half:half + round(LEFT_ABSENT_SHARE * len(left))] = np.nan
    mark = Time(sec=MARK, nanosec=MARK)
    markers = [Marker(ns=side, id=number, type=Marker.SPHERE)
               for side in HANDS for number in range(len(MARKERS))]
    for marker in markers:
        marker.header.frame_id, marker.header.stamp = 'mocap', mark
    found = []
    for frame, positions in enumerate(np.concatenate((right, left), axis=1)):
        seen = np.isfinite(positions[:, 0])
        for marker, position in zip(markers, positions.tolist()):
            at = marker.pose.position
            at.x, at.y, at.z = position
        data = bytearray(serialize_message(MarkerArray(markers=[
            marker for marker, is_seen in zip(markers, seen) if is_seen or frame < half])))
        palms = seen.reshape(len(HANDS), -1)[:, :len(PALM_MARKERS)]
        found.append((data, stamp_places(data), bool(palms.all())))
    return found, path


class Watched:
    """A process whose memory, files and log are watched.

    Parameters
    ----------
    command : sequence of str
    log : Path
        Where its output goes.
    """

    def __init__(self, command, log):
        self._log = log
        with log.open('wb') as file:
            self.process = subprocess.Popen(
                list(map(str, command)), stdout=file, stderr=subprocess.STDOUT, env=environ())
        self._status = psutil.Process(self.process.pid)
        self._read = 0
        self.has_crashed = False
        self.resident, self.files = [], []

    def sample(self):
        """Note its memory [MB] and its open files, and whether it goes on."""
        self.has_crashed = self.has_crashed or self.process.poll() is not None
        if not self.has_crashed:
            self.resident.append(self._status.memory_info().rss / 1e6)
            self.files.append(self._status.num_fds())

    def new_lines(self):
        """Return how many lines it has logged since the last call."""
        with self._log.open('rb') as file:
            file.seek(self._read)
            new = file.read()
        self._read += len(new)
        self.has_crashed = self.has_crashed or b'Traceback' in new
        return new.count(b'\n')

    def stop(self):
        """End it; an error at its end is a crash."""
        if self.process.poll() is None:
            self.process.terminate()
            try:
                self.has_crashed = self.process.wait(STOP_TIME) != 0 or self.has_crashed
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.has_crashed = True

    def slope(self, first):
        """Return the growth of its memory from a sample on [MB/h]."""
        resident = self.resident[first:]
        if len(resident) < 2:
            return float('nan')
        return float(np.polyfit(np.arange(len(resident)) * SECOND / 3600., resident, 1)[0])

    @property
    def log(self):
        """All that it has logged."""
        return self._log.read_text(encoding='utf-8', errors='replace')


class Driver:
    """Publisher of the markers that knows which frames were answered, and when."""

    def __init__(self):
        import rclpy
        from diagnostic_msgs.msg import DiagnosticArray
        from rcl_interfaces.srv import SetParametersAtomically
        from rclpy.node import Node
        from sensor_msgs.msg import JointState
        from visualization_msgs.msg import MarkerArray

        rclpy.init()
        self.node = Node('soak')
        self._publisher = self.node.create_publisher(MarkerArray, '/soak/markers', QUEUE)
        self.node.create_subscription(
            JointState, '/soak/joint_states', self._answered, QUEUE, raw=True)
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._diagnosed, 100)
        self._client = self.node.create_client(
            SetParametersAtomically, '/soak/hand_tracker/set_parameters_atomically')
        self._clock = FIRST_STAMP * 10**9
        self._waiting = {}       # when each frame without an answer was sent [ns], by its stamp
        self.trips = []          # [ns]
        self.sent = self.lost = self.parameters_set = self.parameters_refused = 0
        self.diagnostics = {}    # values of the last status, by hand
        self._calls = []

    def _answered(self, data):
        now = time.perf_counter_ns()
        sent = self._waiting.pop(data[4:12], None)
        if sent is not None:
            self.trips.append(now - sent)

    def _diagnosed(self, message):
        for status in message.status:
            if status.hardware_id == '/soak/markers':
                self.diagnostics[status.name] = {
                    value.key: value.value for value in status.values}

    def send(self, data, places, rate, jump=None):
        """Send a frame; `jump` is by how much its stamp jumps [s], or 'stray'."""
        self._clock += round(1e9 / rate)
        clock = self._clock
        if jump == 'stray':
            clock -= 5 * 10**9 + 1
        elif jump is not None:
            # No stamp comes twice: /tf has each once, and answers are distinguished by it.
            clock = self._clock = self._clock + round(1e9 * jump) + random.randrange(10**6)
        stamp = put_stamps(data, places, clock)
        message = bytes(data)
        self._waiting[stamp] = time.perf_counter_ns()
        self._publisher.publish(message)
        self.sent += 1

    def set(self, values):
        """Ask for parameters, without waiting."""
        from rclpy.parameter import Parameter
        request = self._client.srv_type.Request(parameters=[
            Parameter(name, value=value).to_parameter_msg() for name, value in values.items()])
        self._calls.append(self._client.call_async(request))

    def end_second(self):
        """Count what was set, and frames whose answer is overdue."""
        done = [call for call in self._calls if call.done()]
        self._calls = [call for call in self._calls if not call.done()]
        for call in done:
            is_set = call.result().result.successful
            self.parameters_set += is_set
            self.parameters_refused += not is_set
        overdue = time.perf_counter_ns() - round(1e9 * OVERDUE_TIME)
        # In the order in which they were sent.
        while self._waiting:
            stamp = next(iter(self._waiting))
            if self._waiting[stamp] > overdue:
                return
            del self._waiting[stamp]
            self.lost += 1

    def drop_first(self):
        """Drop the frames of the start, for which nothing waits."""
        self._waiting.clear()
        self.trips.clear()
        self.sent = self.lost = 0


def start(stack, folder, hand_file):
    """Start both trackers and the replay; return them by name."""
    reliable = ['-p', 'qos.markers.reliability:=reliable', '-p', f'qos.markers.depth:={QUEUE}',
                '-p', f'qos.joint_states.depth:={QUEUE}']
    tracker = [sys.executable, '-m', 'hand_tracker.nodes.tracker_node', '--ros-args',
               '-p', 'side:=both']
    commands = {
        'tracker': [*tracker, '-r', '__ns:=/soak', '-p', f'hand_file:={hand_file}', *reliable],
        'tracker of a bag': [*tracker, '-r', '__ns:=/bag', '-p', 'use_sim_time:=true'],
        'replay': [sys.executable, '-m', 'hand_tracker.nodes.replay_node', '--ros-args', '-r',
                   '__ns:=/bag', '-p', 'loop:=true', '-p', 'restamp:=false', '-p', 'clock:=100.',
                   '-p', 'wait_for_subscriber:=.inf', '-p', 'recording:='
                   f"{Path(__file__).resolve().parent.parent / 'recordings/demo_both.mcap'}"]}
    found = {}
    for name, command in commands.items():
        found[name] = Watched(command, Path(folder, f"{name.replace(' ', '_')}.log"))
        stack.callback(found[name].stop)
    return found


def new_listener():
    """Start a listener; it ends by being killed."""
    return subprocess.Popen([sys.executable, '-m', 'benchmarks.soak', '--listen'],
                            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=environ())


class Timetable:
    """Events while frames are sent, each at its period [s]."""

    def __init__(self, now, **periods):
        self._periods = periods
        self._next = {name: now + period for name, period in periods.items()}

    def due(self, name, now):
        """Return whether it is due, and if so count it as done."""
        if now < self._next[name]:
            return False
        self._next[name] += self._periods[name]
        return True


def soak(driver, executor, watched, frames, rate, minutes, listener_life):
    """Send frames for so many minutes; return a row of each minute.

    Parameters
    ----------
    driver : Driver
    executor : rclpy.executors.Executor
        That serves it.
    watched : dict of str to Watched
    frames : list
        From `simulated_messages`.
    rate, minutes, listener_life : float
        [1/s, min, s]

    Returns
    -------
    rows : list of dict
    more : dict of str to int
        How many frames the driver itself sent late, and how often time jumped.
    """
    parameters, jumps = cycle(PARAMETER_CHANGES), cycle(STAMP_JUMPS)
    order = [*range(len(frames)), *range(len(frames) - 2, 0, -1)]
    rows, jumped, number = [], 0, 0
    listener = new_listener()
    began = time.monotonic()
    table = Timetable(began, second=SECOND, minute=MINUTE, parameters=PARAMETERS_EVERY,
                      jump=JUMP_EVERY, listener=listener_life)
    jump, late_sent, before = None, 0, (0, 0)
    due = time.perf_counter_ns()
    try:
        while (now := time.monotonic()) < began + 60. * minutes:
            spin_until(executor, due)
            # Behind by more than a frame: the machine, not the tracker, holds them up.
            late_sent += due + 1e9 / rate < time.perf_counter_ns()
            data, places, is_whole = frames[order[number % len(order)]]
            # Time jumps where both palms are seen: else nothing is to be answered.
            if jump is None and table.due('jump', now):
                jump = next(jumps)
            if jump is not None and is_whole:
                driver.send(data, places, rate, jump)
                jump, jumped = None, jumped + 1
            else:
                driver.send(data, places, rate)
            due += round(1e9 / rate)
            number += 1
            if table.due('parameters', now):
                driver.set(next(parameters))
            if table.due('second', now):
                driver.end_second()
                for one in watched.values():
                    one.sample()
            if table.due('listener', now):
                listener.kill()
                listener.wait()
                listener = new_listener()
            if table.due('minute', now):
                rows.append(minute(driver, watched, len(rows) + 1, rate, before))
                before = driver.sent, driver.lost
                show_row(rows[-1])
                if not rows[-1]['answered'] or any(one.has_crashed for one in watched.values()):
                    break
        spin_until(executor, time.perf_counter_ns() + round(1e9 * (OVERDUE_TIME + 1.)))
        driver.end_second()
        rows.append(minute(driver, watched, len(rows) + 1, rate, before))
        show_row(rows[-1])
    finally:
        listener.kill()
        listener.wait()
    return rows, {'late_sent': late_sent, 'jumps': jumped}


def spin_until(executor, due):
    """Take answers until a time [ns]."""
    while (left := due - time.perf_counter_ns()) > 0:
        executor.spin_once(1e-9 * left)


def minute(driver, watched, number, rate, before):
    """Return the row of a minute; its round trips are forgotten."""
    trips = np.array(driver.trips) * 1e-3
    driver.trips.clear()
    p50, p99, longest = np.percentile(trips, (50, 99, 100)) if trips.size else [np.nan] * 3
    tracker = watched['tracker']
    return {'minute': number, 'sent': driver.sent - before[0], 'lost': driver.lost - before[1],
            'answered': len(trips), 'late': int((trips > 1e6 / rate).sum()),
            'p50_us': round(float(p50), 1), 'p99_us': round(float(p99), 1),
            'max_us': round(float(longest), 1),
            'rss_mb': round(tracker.resident[-1], 1) if tracker.resident else None,
            'files': tracker.files[-1] if tracker.files else None,
            'log_lines': {name: one.new_lines() for name, one in watched.items()}}


def total(driver, watched, rows, rate, minutes):
    """Return the figures of the whole run, and the bounds that it exceeds, as lines of text."""
    # The first tenth, ten minutes at most, is warming up.
    first = min(600, round(6. * minutes))
    edge = max(1, min(EDGE, len(rows) // 3))
    ends = [float(np.median([row['p99_us'] for row in part]))
            for part in (rows[:edge], rows[-edge:])] if rows else [np.nan] * 2
    slopes = {name: one.slope(first) for name, one in watched.items()}
    files = {name: max(one.files[first:]) - one.files[first]
             for name, one in watched.items() if len(one.files) > first}
    crashed = [name for name, one in watched.items() if one.has_crashed]
    lines = max((count for row in rows for count in row['log_lines'].values()), default=0)
    found = {
        'hours': round(minutes / 60., 4), 'rate_hz': rate, 'sent': driver.sent,
        'lost': driver.lost, 'late': sum(row['late'] for row in rows), 'crashes': len(crashed),
        'crashed': crashed, 'rss_slope_mb_h': round(slopes['tracker'], 3),
        'rss_slopes_mb_h': {name: round(slope, 3) for name, slope in slopes.items()},
        'file_descriptors_more': files, 'p99_first_us': round(ends[0], 1),
        'p99_last_us': round(ends[1], 1), 'most_log_lines_a_minute': lines,
        'parameters_set': driver.parameters_set,
        'parameters_refused': driver.parameters_refused, 'diagnostics': driver.diagnostics}
    faults = [f'ended or failed: {name}' for name in crashed]
    if driver.lost:
        faults.append(f'{driver.lost} of {driver.sent} frames lost')
    if not driver.sent or not rows or not driver.parameters_set:
        faults.append('nothing was measured: expected frames, a minute and parameters set')
    if lines > MOST_LINES:
        faults.append(f'{lines} lines logged in a minute; at most {MOST_LINES}')
    faults += [f'{name}: {more} more files open; at most {MOST_FILES}'
               for name, more in files.items() if more > MOST_FILES]
    if len(rows) >= JUDGED_FROM:
        faults += [f'{name}: memory grows by {slope:.2f} MB/h; at most {MOST_SLOPE:g}'
                   for name, slope in slopes.items() if not slope <= MOST_SLOPE]
        if not ends[1] <= MOST_P99 * ends[0]:
            faults.append(f'p99 went from {ends[0]:.0f} to {ends[1]:.0f} µs; at most '
                          f'{MOST_P99:g} times as much')
    return found, faults


def show_row(row):
    """Print the row of a minute."""
    print('minute {minute}: sent {sent}, lost {lost}, late {late}, {p50_us:.0f} µs '
          '(p99 {p99_us:.0f}, max {max_us:.0f}), {rss_mb} MB, {files} files, '.format(**row)
          + 'lines ' + ', '.join(f'{name} {count}' for name, count in row['log_lines'].items()),
          flush=True)


def main():
    """Measure, print and judge."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--hours', type=float, default=2., help='at least 0.02')
    parser.add_argument('--rate', type=float, default=480., help='frames per second')
    parser.add_argument('--listener-life', type=float, default=LISTENER_LIFE, metavar='S',
                        help='seconds until a listener is killed and another one comes')
    add_json_option(parser)
    parser.add_argument('--listen', action='store_true', help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.listener_life < LISTENER_TURN:
        parser.error(f'--listener-life: {options.listener_life:g}; expected {LISTENER_TURN:g} s '
                     'or more')
    isolate()
    if options.listen:
        with suppress(KeyboardInterrupt):
            listen()
        return 0
    from hand_tracker.nodes.executors import fastest_executor
    print(environment())
    with TemporaryDirectory() as folder, ExitStack() as stack:
        frames, hand_file = simulated_messages(options.rate, folder)
        driver = Driver()
        watched = start(stack, folder, hand_file)
        minutes = 60. * options.hours
        with fastest_executor(driver.node) as executor:
            wait_for_answers(driver, executor, watched['tracker'], frames, options.rate)
            # What has been made stays: a collection that goes through it would count as latency.
            gc.collect()
            gc.freeze()
            rows, more = soak(driver, executor, watched, frames, options.rate, minutes,
                              options.listener_life)
        for one in watched.values():
            one.stop()
            one.new_lines()
        found, faults = total(driver, watched, rows, options.rate, minutes)
        logs = {name: one.log.splitlines()[-20:] for name, one in watched.items()}
    found.update(more, listener_life_s=options.listener_life, faults=faults,
                 environment=environment(), minutes=rows)
    for key, value in found.items():
        if key != 'minutes':
            print(f'{key}: {value}')
    if any(one.has_crashed for one in watched.values()):
        for name, lines in logs.items():
            print(f'--- {name}', *lines, sep='\n')
    write_rows(options.json, found)
    return 1 if faults else 0


def wait_for_answers(driver, executor, tracker, frames, rate):
    """Send until the tracker answers, and both hands are there."""
    until = time.monotonic() + FIRST_ANSWER_TIME
    number = 0
    while not driver.trips or len(driver.diagnostics) < len(HANDS):
        if tracker.process.poll() is not None or time.monotonic() > until:
            raise SystemExit(f'the tracker does not answer:\n{tracker.log}')
        driver.send(*frames[number % len(frames)][:2], rate)
        number += 1
        executor.spin_once(.02)
    spin_until(executor, time.perf_counter_ns() + round(1e9 * OVERDUE_TIME))
    driver.drop_first()


if __name__ == '__main__':
    sys.exit(main())
