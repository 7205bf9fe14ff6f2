"""Measure round trips of each source: a system's frame out, joint states back.

    python -m benchmarks.adapters [--rate 120] [--seconds 5] [--rows ROW ...] [--json OUT]

Each source has a tracker that takes its messages as they are, another one behind a source node
(`..._node`), and one in the source node's process (`..._all`); `markers` is a tracker that gets
MarkerArrays. All run at once and are measured in turns, one frame on its way at a time, of eight
markers; the ratio is that of the medians, the processor time that of all processes of a row.
OptiTrack and Qualisys are simulated servers on this machine. In the tracker's process (`..._all`)
their packets may also have the thumb occluded (`natnet_occluded`), a list of three unlabelled
markers (`..._unlabelled`), or a body of 300 markers, which are left out (`natnet_large`).
"""

import argparse
import gc
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
sys.path.append(str(Path(__file__).resolve().parent.parent / 'test'))

import numpy as np

from benchmarks.common import add_json_option, end, environ, environment, write_rows
from benchmarks.round_trip import BOUTS, FIRST_ANSWER_TIME, WARM, cpu_time, isolate

BASE = 'markers'
# Parameter `marker_message` of the tracker, by source.
DIRECT = {'point_cloud': 'point_cloud', 'mocap4r2': 'mocap4r2_markers', 'landmarks': 'pose_array',
          'named_landmarks': 'named_pose_array', 'landmark_markers': 'landmark_markers_21'}
# Rows that are other messages of a source: parameters `source` and `message` of its node.
OTHER_MESSAGES = {'named_landmarks': ('landmarks', 'named_pose_array'),
                  'landmark_markers': ('landmarks', 'marker_array')}
# Behind a source's name: through a source node, in a process of its own or in the tracker's.
AS_NODE, IN_ONE = '_node', '_all'
SERVERS = 'natnet', 'qualisys'
# Packets of these in the tracker's process, with more in them or less.
WITH_OCCLUDED, WITH_UNLABELLED, LARGE_FRAMES = '_occluded', '_unlabelled', '_large'
PACKETS = (*(f'{name}{how}' for name in SERVERS for how in (WITH_OCCLUDED, WITH_UNLABELLED)),
           f'natnet{LARGE_FRAMES}')
CROWD = {'crowd': tuple(map(str, range(300)))}
SOURCES = (*DIRECT, *(f'{name}{how}' for how in (AS_NODE, IN_ONE)
                      for name in (*DIRECT, *SERVERS)), *PACKETS)


def hand_frames(rate):
    """Return eight markers of the demo motion, forwards and backwards, shape (n, 8, 3)."""
    from hand_tracker.core.model.hand import Hand
    from hand_tracker.simulation.packaged_recordings import demo_recording
    motion = demo_recording(Hand.scaled(), rate=rate).markers[:round(2. * rate)]
    motion = np.where(np.isfinite(motion), motion, motion[0])
    return np.concatenate((motion, motion[-2:0:-1]))


def landmark_points(positions):
    """Return 21 landmarks, of which those of the eight markers are somewhere, shape (21, 3)."""
    from hand_tracker.calibration.landmarks import LANDMARKS
    from hand_tracker.core.model.marker_layout import PAPER_PLACES
    rows = dict(zip(PAPER_PLACES, positions))
    return np.array([rows.get(name, (np.nan,) * 3) for name in LANDMARKS])


def landmark_poses(positions):
    """Return the same as poses."""
    from geometry_msgs.msg import Point, Pose
    return [Pose(position=Point(x=x, y=y, z=z))
            for x, y, z in landmark_points(positions).tolist()]


def source_of(name):
    """Return the source of a row."""
    for how in AS_NODE, IN_ONE, WITH_OCCLUDED, WITH_UNLABELLED, LARGE_FRAMES:
        name = name.removesuffix(how)
    return name


def is_in_one(name):
    """Return whether a row's source is in the tracker's process."""
    return name.endswith(IN_ONE) or name in PACKETS


class Sender:
    """Send frames as one source does.

    Parameters
    ----------
    name : str
        `BASE` or one of `SOURCES`, which has topics of its own.
    node : rclpy.node.Node
    server : NatNetServer, QtmServer or None
    """

    def __init__(self, name, node, server):
        from geometry_msgs.msg import PoseArray
        from rclpy.qos import QoSProfile, ReliabilityPolicy
        from sensor_msgs.msg import PointCloud2
        from visualization_msgs.msg import MarkerArray
        kinds = {BASE: MarkerArray, 'point_cloud': PointCloud2, 'landmarks': PoseArray,
                 'landmark_markers': MarkerArray}
        self._name, self._server, self._number = source_of(name), server, 0
        self._how = name.removeprefix(self._name)
        self._points = np.full((3, 3), .5) + np.eye(3)
        self._crowd = {name: np.ones((len(names), 3)) for name, names in CROWD.items()
                       if self._how == LARGE_FRAMES}
        if self._name == 'mocap4r2':
            from mocap4r2_msgs.msg import Markers
            kinds[self._name] = Markers
        if self._name == 'named_landmarks':
            from teleop_ros2_interfaces.msg import NamedPoseArray
            kinds[self._name] = NamedPoseArray
        if self._name in kinds:
            topic = 'markers' if name in (BASE, *DIRECT) else 'in'
            self._publisher = node.create_publisher(
                kinds[self._name], f'/{name}/{topic}', QoSProfile(
                    depth=10, reliability=ReliabilityPolicy.BEST_EFFORT))

    def prepare(self, positions, stamp):
        """Return what sends a frame."""
        if self._name == 'natnet':
            packet = self._server.packed(
                {'hand': positions, **self._crowd},
                unlabelled=self._points if self._how == WITH_UNLABELLED else (),
                occluded=[('hand', 7)] if self._how == WITH_OCCLUDED else ())
            return lambda: self._server.send_at_once(packet)
        if self._name == 'qualisys':
            from helpers.qtm_server import data_packet
            self._number += 1
            packet = data_packet(
                self._number, time.monotonic_ns() // 1000, {'3d': 1e3 * (
                    np.vstack((positions[:7], np.full((1, 3), np.nan)))
                    if self._how == WITH_OCCLUDED else positions),
                    **({'3dnolabels': 1e3 * self._points} if self._how == WITH_UNLABELLED else {})})
            return lambda: self._server.send_at_once(packet)
        data = getattr(self, f'_{self._name}')(positions, stamp)
        return lambda: self._publisher.publish(data)

    def _markers(self, positions, stamp):
        from hand_tracker.messages.stamps import Stamp
        from hand_tracker.messages.templates import markers_template
        template = markers_template('mocap', [('leds', number) for number in range(8)])
        return template.fill(Stamp(stamp.sec, stamp.nanosec), positions)

    def _point_cloud(self, positions, stamp):
        from helpers.clouds import cloud

        from hand_tracker.files.bags import TYPE_STORE
        message = cloud(positions, form='f4')
        message.header.stamp.sec, message.header.stamp.nanosec = stamp.sec, stamp.nanosec
        return bytes(TYPE_STORE.serialize_cdr(message, 'sensor_msgs/msg/PointCloud2'))

    def _mocap4r2(self, positions, stamp):
        from geometry_msgs.msg import Point
        from mocap4r2_msgs.msg import Marker, Markers
        from rclpy.serialization import serialize_message

        from hand_tracker.core.model.marker_layout import MARKERS
        message = Markers(markers=[
            Marker(marker_name=name, translation=Point(x=x, y=y, z=z))
            for name, (x, y, z) in zip(MARKERS, positions.tolist())])
        message.header.stamp, message.header.frame_id = stamp, 'map'
        return serialize_message(message)

    def _landmarks(self, positions, stamp):
        from geometry_msgs.msg import PoseArray
        return self._with_header(PoseArray(poses=landmark_poses(positions)), stamp)

    def _named_landmarks(self, positions, stamp):
        """Return the message of both hands, the left one beside the right."""
        from teleop_ros2_interfaces.msg import NamedPoseArray

        from hand_tracker.calibration.landmarks import LANDMARKS
        from hand_tracker.messages.landmark_kinds import OPENXR
        name_of = {landmark: name for name, landmark in OPENXR.items()}
        return self._with_header(NamedPoseArray(
            name=[f'{side}_{name_of[name]}' for side in ('left', 'right') for name in LANDMARKS],
            pose=landmark_poses(positions + 1.) + landmark_poses(positions),
            is_valid=[True] * (2 * len(LANDMARKS))), stamp)

    def _landmark_markers(self, positions, stamp):
        from hand_tracker.calibration.landmarks import LANDMARKS
        from hand_tracker.messages.stamps import Stamp
        from hand_tracker.messages.templates import markers_template
        template = markers_template('head', [('hand', row) for row in range(len(LANDMARKS))])
        return template.fill(Stamp(stamp.sec, stamp.nanosec), landmark_points(positions))

    @staticmethod
    def _with_header(message, stamp):
        from rclpy.serialization import serialize_message
        message.header.stamp, message.header.frame_id = stamp, 'head'
        return serialize_message(message)


def start(stack, names):
    """Start a tracker of each name and, where it says so, a source node and its server.

    Returns
    -------
    processes : dict of str to list of subprocess.Popen
    servers : dict of str to NatNetServer or QtmServer
    """
    from helpers.natnet_server import NatNetServer
    from helpers.qtm_server import QtmServer

    from hand_tracker.core.model.marker_layout import MARKERS
    from hand_tracker.messages.marker_ids import FIRST_FOREIGN_ID

    def run(name, node, *arguments):
        process = stack.enter_context(subprocess.Popen(
            [sys.executable, '-m', 'hand_tracker.entry', *node.split(), '--ros-args', '-r',
             f'__ns:=/{name}', *arguments], stderr=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL, env=environ()))
        stack.callback(end, process)
        processes.setdefault(name, []).append(process)

    processes, servers = {}, {}
    for name in names:
        source, more = source_of(name), []
        if source in SERVERS:
            servers[name] = stack.enter_context(
                NatNetServer((4, 1), {'hand': MARKERS, **(
                    CROWD if name.endswith(LARGE_FRAMES) else {})}) if source == 'natnet' else
                QtmServer(MARKERS))
        if source == 'point_cloud':
            more = [part for row, marker in enumerate(MARKERS)
                    for part in ('-p', f'labels.{marker}:="{FIRST_FOREIGN_ID + row}"')]
        if name in DIRECT:
            more += ['-p', f'marker_message:={DIRECT[name]}']
        elif name != BASE:
            more += ['-r', f'markers:=/{name}/source/markers']
            source, message = OTHER_MESSAGES.get(source, (source, 'first'))
            origin = ['-p', f'source:={source}', '-p', f'topic:=/{name}/in',
                      '-p', f'message:={message}',
                      '-p', f'port:={servers[name].port if name in servers else 0}',
                      *(['-p', 'subject:=hand'] if name.endswith(LARGE_FRAMES) else [])]
            if is_in_one(name):
                more += origin
            else:
                run(name, 'source', *origin)
        run(name, 'all tracker source' if is_in_one(name) else 'tracker',
            '-p', 'auto_size:=false', *more)
    return processes, servers


class Measurement:
    """Round trips of all sources, by one node.

    Parameters
    ----------
    servers : dict of str to NatNetServer or QtmServer
        By the name of the row.
    rate : float
        [Hz]
    names : sequence of str
        Of the rows.
    """

    def __init__(self, servers, rate, names):
        import rclpy
        from rclpy.node import Node
        from sensor_msgs.msg import JointState
        try:
            from rclpy.experimental.events_executor import EventsExecutor as Executor
        except ImportError:
            from rclpy.executors import SingleThreadedExecutor as Executor
        rclpy.init()
        self._node, self._rate, self._count = Node('adapters'), rate, 0
        self._answered = {}
        self._senders = {}
        for name in names:
            self._senders[name] = Sender(name, self._node, servers.get(name))
            self._node.create_subscription(
                JointState, f'/{name}/joint_states',
                lambda data, name=name: self._answered.setdefault(name, time.perf_counter_ns()),
                100, raw=True)
        self._executor = Executor()
        self._executor.add_node(self._node)
        self._frames = hand_frames(rate)

    def trips(self, name, seconds):
        """Return the round trips [µs] of a source, NaN for frames without answer."""
        found, due = [], time.perf_counter_ns()
        for _ in range(round(seconds * self._rate)):
            self._count += 1
            send = self._senders[name].prepare(
                self._frames[self._count % len(self._frames)],
                self._node.get_clock().now().to_msg())
            self._spin_until(due)
            self._answered.pop(name, None)
            given = time.perf_counter_ns()
            send()
            due += round(1e9 / self._rate)
            self._spin_until(max(due - 1_000_000, given + 4_000_000), name)
            found.append((self._answered.get(name, np.nan) - given) * 1e-3)
        return np.array(found)

    def wait_for(self, name):
        """Send until a source answers each frame of half a second."""
        until = time.monotonic() + FIRST_ANSWER_TIME
        while not np.isfinite(self.trips(name, .5)).all():
            if time.monotonic() > until:
                raise SystemExit(f'{name} does not answer')

    def _spin_until(self, due, answered=''):
        while (left := due - time.perf_counter_ns()) > 0 and answered not in self._answered:
            self._executor.spin_once(1e-9 * left)


def main():
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--rate', type=float, default=120., help='frames per second')
    parser.add_argument('--seconds', type=float, default=5., help='of each measurement')
    parser.add_argument('--rows', nargs='+', choices=SOURCES, default=SOURCES,
                        help='that are measured beside markers')
    add_json_option(parser)
    options = parser.parse_args()
    isolate()
    print(environment())
    with ExitStack() as stack:
        names = BASE, *options.rows
        processes, servers = start(stack, names)
        measurement = Measurement(servers, options.rate, names)
        for name in names:
            measurement.wait_for(name)
        found = {name: [] for name in names}
        used = dict.fromkeys(found, 0.)
        gc.collect()
        gc.disable()
        for _ in range(BOUTS):
            for name, trips in found.items():
                measurement.trips(name, WARM)
                before = sum(map(cpu_time, processes[name]))
                trips.append(measurement.trips(name, options.seconds / BOUTS))
                used[name] += sum(map(cpu_time, processes[name])) - before
    rows = []
    base = np.nanmedian(np.concatenate(found[BASE]))
    print(f"{'source':18}{'median µs':>11}{'p99 µs':>9}{'of markers':>12}{'CPU %':>8}"
          f"{'dropped %':>11}")
    for name, trips in found.items():
        trips = np.concatenate(trips)
        median, p99 = np.nanpercentile(trips, (50, 99))
        rows.append({'source': name, 'median_us': round(float(median), 1),
                     'p99_us': round(float(p99), 1), 'of_markers': round(float(median / base), 2),
                     'cpu_percent': round(100. * used[name] * options.rate / len(trips), 1),
                     'dropped_percent': round(100. * float(np.isnan(trips).mean()), 3)})
        print('{source:18}{median_us:11.0f}{p99_us:9.0f}{of_markers:12.2f}'
              '{cpu_percent:8.1f}{dropped_percent:11.2f}'.format(**rows[-1]))
    write_rows(options.json, rows)
    return 0


if __name__ == '__main__':
    sys.exit(main())
