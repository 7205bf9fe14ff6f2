"""Measure the growth of memory over an hour of frames, in core, fast path and node.

    python -m benchmarks.memory [--frames 432000] [--json OUT]

The core is `HandTracker.update`; the fast path is its compiled kernel without rcl; the node takes
serialized messages on the slow path and publishes, and its timers run. The slope is that of a line
fitted to the resident memory of the second half. `blocks` is the growth of allocated Python memory
blocks in that half, which includes latencies kept until the next diagnostics; `collections` are
runs of the garbage collector by generation.
"""

import argparse
import gc
import sys
import time
from pathlib import Path

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import numpy as np
import psutil

from benchmarks.common import RATE, add_json_option, environment, put_stamps, write_rows
from benchmarks.round_trip import isolate, messages
from hand_tracker.core.model.hand import JOINTS
from hand_tracker.core.model.marker_rows import LAYOUT_CAPACITY
from hand_tracker.core.numerics.packs import empty_like_pack, packed
from hand_tracker.core.tracker import HandTracker
from hand_tracker.messages.cdr import MarkerReader
from hand_tracker.messages.labels import LabelMap
from hand_tracker.messages.stamps import seconds
from hand_tracker.messages.templates import JOINT_STATES, joint_state_template
from hand_tracker.nodes.fast_path.track_kernel import (
    LOG_CAPACITY,
    LOG_COLUMNS,
    TrackPacks,
    drain_log,
    install_part,
    install_reply,
    install_signature,
    log_frame,
    new_hand_memory,
    new_memory,
    process_message,
)
from hand_tracker.simulation.packaged_recordings import RECORDING_START_NS, demo_recording

HOUR = 432_000    # frames at 120 Hz
SAMPLES = 200
TIMERS_EVERY = 30  # frames


def core_frames():
    """Return a function that tracks frame number i of the repeated demo motion."""
    tracker, lap = HandTracker(), demo_recording().markers
    return lambda i: tracker.update(lap[i % len(lap)], i / RATE)


def fast_path_frames():
    """Return a function that processes the message of frame number i on the fast path."""
    tracker, reader = HandTracker(), MarkerReader(LabelMap())
    memories, memory = packed(new_memory())
    hands, hand = packed(new_hand_memory())
    lap, answer = messages(['right'], RATE), joint_state_template(JOINTS)
    packs = TrackPacks(*tracker.kernel_arguments())
    seen = (np.zeros((LOG_CAPACITY, LOG_COLUMNS)),
            np.zeros((LOG_CAPACITY, LAYOUT_CAPACITY), np.int8), empty_like_pack(packs.report))

    def frame(i):
        data, places = lap[i % len(lap)]
        put_stamps(data, places, RECORDING_START_NS + round(i * 1e9 / RATE))
        if i == 0:
            first = reader.read(bytes(data))
            tracker.update(first.positions, seconds(first.stamp))
            install_signature(memory, [hand], [reader.signature], first.stamp, 1., True)
            install_reply(memory, 0, answer)
            install_part(hand, JOINT_STATES, 0, slice(0, len(JOINTS)))
            return
        if not process_message(
                memories, (hands,), (packs,), np.frombuffer(data, np.uint8)):
            raise RuntimeError(f'frame {i} left the fast path')
        log_frame(hand, packs.report[0], 0., 0.)
        if i % TIMERS_EVERY == 0:
            drain_log(hands, packs.report, *seen)

    return frame


def node_frames():
    """Return a function that passes the message of frame number i to the node's callback."""
    import rclpy
    from rclpy.executors import SingleThreadedExecutor

    from hand_tracker.nodes.tracker_node import TrackerNode
    rclpy.init(args=['--ros-args', '-p', 'auto_size:=false'])
    node, executor = TrackerNode(), SingleThreadedExecutor()
    executor.add_node(node)
    lap = messages(['right'], RATE)
    subscription, = (one for one in node.subscriptions if one.topic_name == '/markers')

    def frame(i):
        data, places = lap[i % len(lap)]
        put_stamps(data, places, RECORDING_START_NS + round(i * 1e9 / RATE))
        subscription.callback(bytes(data))
        if i % TIMERS_EVERY == 0:
            executor.spin_once(0.)

    return frame


def measure(what, frame, frames):
    """Return the row of memory growth over calls of `frame(i)`."""
    process = psutil.Process()
    every = max(frames // SAMPLES, 1)
    # Before the first sample: allocations at first use.
    for i in range(every):
        frame(i)
    gc.collect()
    resident, blocks = np.zeros(SAMPLES), np.zeros(SAMPLES)
    before, start = _collections(), time.monotonic()
    half = SAMPLES // 2
    for sample in range(SAMPLES):
        if sample == half:
            # What is left over of the first half is no growth of the second.
            gc.collect()
            before[2] += 1
        for i in range((sample + 1) * every, (sample + 2) * every):
            frame(i)
        resident[sample], blocks[sample] = process.memory_info().rss, sys.getallocatedblocks()
    seconds = time.monotonic() - start
    slope = np.polyfit(np.arange(half) * every, resident[half:], 1)[0]
    return {'what': what, 'frames': SAMPLES * every, 'resident_mb': round(resident[-1] / 1e6, 1),
            'grown_mb': round((resident[-1] - resident[half]) / 1e6, 3),
            'slope_bytes_per_frame': round(float(slope), 3),
            'blocks': int(blocks[-1] - blocks[half]),
            'collections': [int(count) for count in _collections() - before],
            'seconds': round(seconds, 1)}


def _collections():
    """Return the number of garbage collections by generation."""
    return np.array([generation['collections'] for generation in gc.get_stats()])


def main():
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--frames', type=int, default=HOUR, help='rounded to 200s')
    add_json_option(parser)
    options = parser.parse_args()
    isolate()
    print(environment())
    rows = []
    for what, frames in (('core', core_frames), ('fast path', fast_path_frames),
                         ('node', node_frames)):
        try:
            rows.append(measure(what, frames(), options.frames))
        except ImportError as error:
            print(f'{what}: left out ({error})')
            continue
        print('{what}: {frames} frames, {resident_mb} MB, in the second half {grown_mb} MB more '
              '({slope_bytes_per_frame} bytes a frame) and {blocks} blocks; collections of '
              'each generation {collections}'.format(**rows[-1]), flush=True)
    write_rows(options.json, rows)
    return 0


if __name__ == '__main__':
    sys.exit(main())
