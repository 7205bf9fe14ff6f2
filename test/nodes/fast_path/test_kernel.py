"""The fast path: the same as the slow path, or refused with nothing done."""

import struct

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from helpers.markers import big_endian, data_of, marker
from hypothesis import given, settings
from hypothesis import strategies as st
from visualization_msgs.msg import Marker

from hand_tracker.core.model.hand import JOINTS, Hand
from hand_tracker.core.model.kinematics import joint_table
from hand_tracker.core.model.marker_layout import MARKERS
from hand_tracker.core.model.states import (
    MarkerState,
    PalmState,
)
from hand_tracker.core.numerics.jit import COMPILED, empty_like_pack, overwrite, packed, parts
from hand_tracker.core.tracker import HandTracker
from hand_tracker.messages.builders import (
    link_frames,
    prefixed_names,
    transform_numbers,
    wrist_frames,
)
from hand_tracker.messages.cdr import ENCAPSULATION, MarkerReader
from hand_tracker.messages.labels import LabelMap
from hand_tracker.messages.stamps import Stamp, seconds
from hand_tracker.messages.templates import joint_state_template, transforms_template
from hand_tracker.nodes.fast_path.kernel import (
    CONFIDENCES,
    JOINT_STATES,
    LOG_CAPACITY,
    LOG_COLUMNS,
    MESSAGE_CAPACITY,
    REPLIES,
    REPLY_CAPACITY,
    TRANSFORMS,
    drain_log,
    install_reply,
    install_signature,
    log_frame,
    new_memory,
    process_message,
    state_runs,
)
from hand_tracker.simulation.packaged_recordings import demo_recording

NEEDS = 'rclpy', 'visualization_msgs'

NAMES = prefixed_names('right_')
SCALE = .001
DEMO = {side: 1e3 * demo_recording(Hand.scaled(side=side), rate=100.).markers[:200]
        for side in ('right', 'left')}  # [mm]


def markers_of(positions, frame, labels=range(8)):
    """Return the markers of a frame [mm]; those not seen are at zero."""
    at = Time(sec=5, nanosec=10_000_000 * frame)
    return [marker(number, np.nan_to_num(positions[number]), 'leds', 'mocap', Marker.SPHERE, 0, at)
            for number in labels]


class Paths:
    """A hand that is tracked on both paths."""

    def __init__(self, side='right'):
        hand = Hand.scaled(side=side)
        table = joint_table(hand)
        self.reader = MarkerReader(LabelMap(), scale=SCALE)
        self.slow, self.fast = HandTracker(hand), HandTracker(hand)
        self.templates = {
            JOINT_STATES: joint_state_template(NAMES.joints),
            CONFIDENCES: joint_state_template(NAMES.joints),
            TRANSFORMS: transforms_template(
                wrist_frames(NAMES, 'mocap') + link_frames(NAMES, table))}
        self.memories, self.memory = packed(new_memory())
        self.table = table

    def install(self, data):
        """Track a message on the slow path with both trackers, and install its signature."""
        frame = self.reader.read(data)
        for tracker in self.slow, self.fast:
            state = tracker.update(frame.positions, seconds(frame.stamp))
        assert install_signature(self.memory, self.reader.signature, frame.stamp, SCALE, True)
        for number, template in self.templates.items():
            assert install_reply(self.memory, number, template)
        return state

    def go(self, data):
        """Process a message; return whether that was possible."""
        return process_message(self.memories, self.fast.kernel_arguments(),
                               np.frombuffer(data, np.uint8))

    def state(self):
        """Return the state after the last frame of the fast path."""
        reports = self.fast.kernel_arguments()[-1]
        copy = empty_like_pack(reports)
        overwrite(copy, reports)
        return self.fast.state_from_report(copy)

    def replies(self):
        """Return the replies of the fast path, as bytes."""
        return {number: self.memory.replies[number].view(np.uint8)[
            ENCAPSULATION:ENCAPSULATION + template.size].tobytes()
            for number, template in self.templates.items()}

    def expected(self, data):
        """Return state and replies of the slow path."""
        frame = self.reader.read(data)
        state = self.slow.update(frame.positions, seconds(frame.stamp))
        numbers = {JOINT_STATES: state.angles, CONFIDENCES: state.confidence,
                   TRANSFORMS: transform_numbers(self.table, state)}
        return state, {number: template.fill(frame.stamp, numbers[number])
                       for number, template in self.templates.items()}


@pytest.fixture
def paths():
    """Return a hand that was seen once, on the slow path."""
    found = Paths()
    found.install(data_of(markers_of(DEMO['right'][0], 0)))
    return found


def alike(part, other):
    """Return whether two parts of a state are the same."""
    if isinstance(part, tuple):
        return all(map(alike, part, other))
    return np.array_equal(part, other, equal_nan=np.ndim(part) > 0)


@pytest.mark.parametrize('side', ['right', 'left'])
def test_both_paths_reply_alike(side):
    paths, frames = Paths(side), DEMO[side].copy()
    rng = np.random.default_rng(3)
    frames[40:60, rng.integers(0, 8)] = np.nan
    frames[80:90, :3] = np.nan
    frames[100:110, [4, 5]] = frames[100:110, [5, 4]]
    frames[120] += 1e4
    paths.install(data_of(markers_of(frames[0], 0)))
    palms, states = set(), set()
    for number in range(1, len(frames)):
        data = data_of(markers_of(frames[number], number))
        assert paths.go(data)
        state, answers = paths.expected(data)
        assert paths.replies() == answers
        assert all(map(alike, paths.state(), state))
        palms.add(state.palm)
        states.update(state.marker_states.tolist())
    assert {PalmState.TRACKED, PalmState.LOST} <= palms
    assert {MarkerState.SEEN, MarkerState.PREDICTED} < states


def changed(number=1, **fields):
    """Return a frame in which one marker is another."""
    markers = markers_of(DEMO['right'][number], number)
    for name, value in fields.items():
        part = markers[3].header if name in ('frame_id', 'stamp') else markers[3]
        setattr(part, name, value)
    return data_of(markers)


ZERO, BEFORE, AGAIN = Time(), Time(sec=4), Time(sec=5)


@pytest.mark.parametrize('data', [
    changed(ns='other'), changed(ns=''), changed(id=9), changed(type=Marker.CUBE),
    changed(type=Marker.ARROW), changed(action=Marker.DELETE), changed(frame_id='base'),
    data_of(markers_of(DEMO['right'][1], 1, range(7))),
    data_of(markers_of(DEMO['right'][1], 1, (1, 0, *range(2, 8)))),
    data_of(markers_of(DEMO['right'][1], 1) + markers_of(DEMO['right'][1], 1, [3])),
    data_of(markers_of(DEMO['right'][1], 1))[:-40],
    big_endian(markers_of(DEMO['right'][1], 1)), b'', b'\0\1', b'\0\1\0\0',
    b'\0\1' + bytes(MESSAGE_CAPACITY + 5),
    data_of(markers_of(DEMO['right'][0], 0)),
    data_of([marker(number, (1., 2., number), 'leds', 'mocap', Marker.SPHERE, 0, stamp)
             for stamp in [ZERO] for number in range(8)]),
    data_of([marker(number, (1., 2., number), 'leds', 'mocap', Marker.SPHERE, 0, stamp)
             for stamp in [BEFORE] for number in range(8)]),
], ids=['namespace', 'no namespace', 'id', 'type', 'no point', 'deleted', 'frame', 'one less',
        'another order', 'one more', 'cut off', 'big-endian', 'nothing', 'half a head', 'head',
        'too long', 'repeated', 'no stamp', 'earlier'])
def test_what_is_not_alike_is_refused_with_nothing_done(paths, data):
    before = paths.state()
    assert not paths.go(data)
    assert np.array_equal(paths.state().angles, before.angles)
    # The next one goes on as if nothing had come.
    data = data_of(markers_of(DEMO['right'][2], 2))
    assert paths.go(data)
    assert paths.replies() == paths.expected(data)[1]


def test_the_last_stamp_passes_once_even_if_time_does_not_believe_it(paths):
    strays = [data_of([marker(number, DEMO['right'][1][number], 'leds', 'mocap', Marker.SPHERE, 0,
                              Time(sec=sec)) for number in range(8)]) for sec in (1000, 5000)]
    assert paths.go(strays[0])
    assert not paths.go(strays[0])
    # As one that came the slow path.
    paths.install(strays[1])
    assert not paths.go(strays[1])


def test_nothing_passes_before_the_palm_was_seen():
    paths = Paths()
    hidden = DEMO['right'][0].copy()
    hidden[0] = 0.
    paths.install(data_of(markers_of(hidden, 0)))
    assert not paths.go(data_of(markers_of(DEMO['right'][1], 1)))


def test_points_of_lists_and_messages_of_others_are_not_installed(paths):
    points = marker(0, (0., 0., 0.), 'leds', 'mocap', Marker.POINTS, 0, Time(sec=6),
                    [tuple(at) for at in DEMO['right'][0]])
    for data in data_of([points]), data_of([marker(99, (0., 0., 1.), 'x', 'mocap')]), data_of([]):
        paths.reader.read(data)
        assert not install_signature(paths.memory, paths.reader.signature, Stamp(6, 0), SCALE, True)
    assert paths.go(data_of(markers_of(DEMO['right'][1], 1)))


def test_an_answer_that_has_no_room_is_not_installed(paths):
    long = joint_state_template([f'{joint}{"x" * (REPLY_CAPACITY // 25)}' for joint in JOINTS])
    assert not install_reply(paths.memory, JOINT_STATES, long)
    assert not install_reply(paths.memory, JOINT_STATES, joint_state_template(['x'] * 300))
    assert not install_reply(
        paths.memory, TRANSFORMS, transforms_template([('mocap', f'l{i}') for i in range(33)]))
    data = data_of(markers_of(DEMO['right'][1], 1))
    assert paths.go(data)
    assert paths.replies() == paths.expected(data)[1]


def test_only_what_is_wanted_is_filled(paths):
    paths.memory.wanted[CONFIDENCES] = 0
    before = paths.replies()
    assert paths.go(data_of(markers_of(DEMO['right'][1], 1)))
    after = paths.replies()
    assert [after[number] != before[number] for number in range(REPLIES)] == [True, True, False]


@pytest.fixture(scope='module')
def hostile_paths():
    """Return a hand that was seen once, for all hostile messages."""
    found = Paths()
    found.install(data_of(markers_of(DEMO['right'][0], 0)))
    return found


@pytest.mark.skipif(not COMPILED, reason='the numbers of NumPy overflow in plain Python')
@settings(max_examples=400, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 400), st.one_of(
    st.sampled_from([-1, -2**31, 2**31 - 1, 2**30, 2**16, 1000, 25, 5, 1, 0]),
    st.integers(-2**31, 2**31 - 1))), min_size=1, max_size=5), st.integers(0, 2000))
def test_hostile_messages_are_survived(hostile_paths, changes, end):
    data = bytearray(data_of(markers_of(DEMO['right'][1], 1)))
    for at, value in changes:
        at = 4 * (at % (len(data) // 4 - 1)) + ENCAPSULATION
        if at + 4 <= len(data):
            data[at:at + 4] = struct.pack('<i', value)
    hostile_paths.go(bytes(data[:end] if end < 300 else data))
    state = hostile_paths.state()
    assert np.isfinite(state.angles).all() and np.isfinite(state.pose.position).all()


def seen(memories, reports):
    """Look, and return what is new."""
    log = np.zeros((LOG_CAPACITY, LOG_COLUMNS))
    states = np.zeros((LOG_CAPACITY, len(MARKERS)), np.int8)
    report = empty_like_pack(reports)
    kept, frames = drain_log(memories, reports, log, states, report)
    return log[:kept], states[:kept], frames, report


@pytest.mark.parametrize('count', [0, 1, 7, LOG_CAPACITY, LOG_CAPACITY + 30])
def test_what_was_noted_is_looked_at_once(paths, count):
    reports = paths.fast.kernel_arguments()[-1]
    for lap in range(2):
        for i in range(count):
            paths.memory.time[0] = i
            log_frame(paths.memory, reports[0], lap + 1e-3 * i, lap + 1e-3 * i + 1e-4)
        log, states, frames, report = seen(paths.memories, reports)
        assert frames == count and len(log) == min(count, LOG_CAPACITY)
        numbers = np.arange(count)[-LOG_CAPACITY:]
        assert np.array_equal(log[:, 0], lap + 1e-3 * numbers)
        assert np.array_equal(log[:, 2], numbers)
        assert (states == MarkerState.SEEN).all()
        if count:
            assert all(map(alike, parts(report), parts(reports)))


def test_state_runs_have_the_first_and_last_frame_of_what_stays_the_same():
    log, states = np.zeros((6, LOG_COLUMNS)), np.zeros((6, 8), np.int8)
    log[:, 1], log[:, 3] = np.arange(6), np.arange(6) * 1e-3
    states[2:4, 5] = MarkerState.PREDICTED
    log[5:, 4] = PalmState.LOST
    found = state_runs(log, states)
    assert [at for at, _ in found] == [0., 1., 2., 3., 4., 5.]
    assert [run.palm for _, run in found] == [PalmState.TRACKED] * 5 + [PalmState.LOST]
    assert [run.marker_states[5] for _, run in found] == [0, 0, 1, 1, 0, 0]
    assert np.allclose([run.residuals for _, run in found],
                       [[.0005], [.0005], [.0025], [.0025], [.004], [.005]])
    assert len(state_runs(log[:1], states[:1])) == 1
