"""The fast path: the same as the slow path, or refused with nothing done."""

import struct

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, PoseArray
from helpers.clouds import cloud
from helpers.markers import big_endian, data_of, marker
from hypothesis import given, settings
from hypothesis import strategies as st
from mocap4r2_msgs.msg import Marker as NamedMarker
from mocap4r2_msgs.msg import Markers, RigidBodies, RigidBody
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2
from teleop_ros2_interfaces.msg import NamedPoseArray
from visualization_msgs.msg import Marker

from hand_tracker.calibration.landmarks import LANDMARKS
from hand_tracker.core.model.hand import JOINTS, Hand
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.layout_presets import preset_layout
from hand_tracker.core.model.marker_layout import (
    MARKERS,
    PAPER_PLACES,
    MarkerLayout,
    marker_positions,
)
from hand_tracker.core.model.marker_rows import LAYOUT_CAPACITY
from hand_tracker.core.model.states import (
    MarkerState,
    PalmState,
)
from hand_tracker.core.numerics.jit import COMPILED
from hand_tracker.core.numerics.packs import empty_like_pack, overwrite, packed, parts
from hand_tracker.core.pose.deviation import unknown_deviation
from hand_tracker.core.tracker import HandTracker
from hand_tracker.files.bags import TYPE_STORE
from hand_tracker.messages.builders import (
    link_frames,
    prefixed_names,
    wrist_frames,
)
from hand_tracker.messages.cdr import ENCAPSULATION, MarkerReader
from hand_tracker.messages.labels import (
    DEFAULT_LABELS,
    LabelMap,
    default_labels,
    labels_of_hand,
)
from hand_tracker.messages.landmark_kinds import (
    LANDMARK_MARKERS,
    LANDMARK_POSES,
    NAMED_LANDMARKS,
    OPENXR,
    kind_of_hand,
)
from hand_tracker.messages.message_kinds import (
    MARKER_ARRAY_KIND,
    MOCAP4R2_MARKERS,
    POINT_CLOUD,
    RIGID_BODIES,
)
from hand_tracker.messages.stamps import Stamp, seconds
from hand_tracker.messages.templates import (
    ANGLE_DEVIATIONS,
    JOINT_STATES,
    TRANSFORMS,
    joint_state_template,
    transform_numbers,
    transforms_template,
)
from hand_tracker.nodes.fast_path.track_kernel import (
    LOG_CAPACITY,
    LOG_COLUMNS,
    MESSAGE_CAPACITY,
    NOT_WANTED,
    REPLY_CAPACITY,
    RESIDUAL,
    TrackPacks,
    drain_log,
    install_layout,
    install_part,
    install_reply,
    install_signature,
    log_frame,
    new_hand_memory,
    new_memory,
    process_message,
    state_runs,
)
from hand_tracker.simulation.motion import demo_motion
from hand_tracker.simulation.packaged_recordings import demo_recording

NEEDS = 'rclpy', 'visualization_msgs', 'mocap4r2_msgs', 'teleop_ros2_interfaces'

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

    def __init__(self, side='right', labels=DEFAULT_LABELS, layout=None, kind=MARKER_ARRAY_KIND):
        hand, layout = Hand.scaled(side=side), layout or MarkerLayout()
        table = joint_table(hand)
        self.reader = MarkerReader(LabelMap(labels, layout.names), scale=SCALE, kind=kind)
        self.slow, self.fast = HandTracker(hand, layout), HandTracker(hand, layout)
        self.templates = {
            JOINT_STATES: joint_state_template(NAMES.joints),
            ANGLE_DEVIATIONS: joint_state_template(
                NAMES.joints, unknown_deviation(hand.limits).tolist()),
            TRANSFORMS: transforms_template(
                wrist_frames(NAMES, 'mocap') + link_frames(NAMES, table))}
        self.memories, self.memory = packed(new_memory())
        self.hands, self.hand = packed(new_hand_memory())
        install_layout(self.hand, layout)
        self.table = table

    def install(self, data):
        """Track a message on the slow path with both trackers, and install its signature."""
        frame = self.begin(data)
        assert install_signature(
            self.memory, [self.hand], [self.reader.signature], frame.stamp, SCALE, True)
        for number, template in self.templates.items():
            assert install_reply(self.memory, number, template)
            install_part(self.hand, number, number, slice(0, len(template.numbers)))

    def begin(self, data):
        """Track a message on the slow path with both trackers; return its markers."""
        frame = self.reader.read(data)
        for tracker in self.slow, self.fast:
            tracker.update(frame.positions, seconds(frame.stamp))
        return frame

    def go(self, data):
        """Process a message; return whether that was possible."""
        return process_message(
            self.memories, (self.hands,), (TrackPacks(*self.fast.kernel_arguments()),),
            np.frombuffer(data, np.uint8))

    def state(self):
        """Return the state after the last frame of the fast path."""
        reports = self.fast.kernel_arguments()[-1]
        copy = empty_like_pack(reports)
        overwrite(copy, reports)
        return self.fast.state_from_report(copy, self.hand.listed[0])

    def replies(self):
        """Return the replies of the fast path, as bytes."""
        return {number: self.memory.replies[number].view(np.uint8)[
            ENCAPSULATION:ENCAPSULATION + template.size].tobytes()
            for number, template in self.templates.items()}

    def expected(self, data):
        """Return state and replies of the slow path."""
        frame = self.reader.read(data)
        state = self.slow.update(frame.positions, seconds(frame.stamp))
        numbers = {JOINT_STATES: state.angles, ANGLE_DEVIATIONS: state.deviation,
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


@pytest.mark.parametrize('name', ['vicon_production5', 'sig18_19'])
def test_both_paths_reply_alike_for_other_layouts(name):
    layout, count = preset_layout(name), len(preset_layout(name).names)
    paths = Paths(labels=default_labels(layout.names), layout=layout)
    motion = demo_motion(paths.slow.hand)
    pose = motion.sample(np.arange(60) / 100.)
    frames = 1e3 * marker_positions(layout.mounting(paths.slow.hand), forward(
        paths.table, *pose), *pose[1:])
    frames[20:30, layout.further[0]] = np.nan
    frames[40:45, layout.principal[5:]] = np.nan
    frames[50:, layout.principal[0]] = np.nan
    paths.install(data_of(markers_of(frames[0], 0, range(count))))
    for number in range(1, len(frames)):
        data = data_of(markers_of(frames[number], number, range(count)))
        assert paths.go(data)
        state, answers = paths.expected(data)
        assert paths.replies() == answers
        assert all(map(alike, paths.state(), state))
        log_frame(paths.hand, paths.fast.kernel_arguments()[-1][0], number, number)
    log, states = np.zeros(
        (LOG_CAPACITY, LOG_COLUMNS)), np.zeros((LOG_CAPACITY, LAYOUT_CAPACITY), np.int8)
    reports = paths.fast.kernel_arguments()[-1]
    logged, _ = drain_log(paths.hands, reports, log, states, empty_like_pack(reports))
    assert logged == len(frames) - 1
    np.testing.assert_array_equal(states[logged - 1, :count], state.marker_states)
    assert log[logged - 1, RESIDUAL] == pytest.approx(np.nanmean(state.residuals))


def headed(found, frame):
    """Return the bytes of a message with the header of a frame."""
    found.header.stamp, found.header.frame_id = Time(sec=5, nanosec=10_000_000 * frame), 'mocap'
    return serialize_message(found)


def points_of(positions):
    """Return places as messages."""
    return [Point(**dict(zip('xyz', at))) for at in positions.tolist()]


def named_markers(positions, frame):
    return headed(Markers(frame_number=frame, markers=[
        NamedMarker(marker_name=name, translation=at)
        for name, at in zip(MARKERS, points_of(positions))]), frame)


def bodies(positions, frame):
    return headed(RigidBodies(frame_number=frame, rigidbodies=[
        RigidBody(rigid_body_name=name, markers=[NamedMarker(marker_name=name, translation=at)])
        for name, at in zip(MARKERS, points_of(positions))]), frame)


def landmarks(positions, frame):
    at = dict(zip(PAPER_PLACES, points_of(positions)))
    nowhere = Point(x=np.nan, y=np.nan, z=np.nan)
    return headed(PoseArray(poses=[Pose(position=at.get(name, nowhere))
                                   for name in LANDMARKS]), frame)


def named_landmarks(positions, frame):
    """Return a message of both hands, of which the left one is elsewhere."""
    name_of = {landmark: name for name, landmark in OPENXR.items()}
    return headed(NamedPoseArray(
        name=[f'{side}_{name_of[place]}' for side in ('left', 'right') for place in PAPER_PLACES],
        pose=[Pose(position=at) for at in points_of(np.concatenate((positions + 1., positions)))],
        is_valid=[True] * 16), frame)


def landmark_markers(positions, frame):
    stamp = Time(sec=5, nanosec=10_000_000 * frame)
    return data_of([marker(LANDMARKS.index(place), at, '', 'mocap', Marker.SPHERE, 0, stamp)
                    for place, at in zip(PAPER_PLACES, positions)])


def points(positions, frame):
    data = bytes(TYPE_STORE.serialize_cdr(cloud(positions, form='f8'), POINT_CLOUD.type))
    return headed(deserialize_message(data, PointCloud2), frame)


@pytest.mark.parametrize('kind, data_at', [
    (MOCAP4R2_MARKERS, named_markers), (RIGID_BODIES, bodies), (LANDMARK_POSES, landmarks),
    (POINT_CLOUD, points), (kind_of_hand(NAMED_LANDMARKS, 'right'), named_landmarks),
    (LANDMARK_MARKERS[21], landmark_markers)],
    ids=['markers', 'rigid bodies', 'poses', 'cloud', 'named poses', 'landmarks'])
def test_both_paths_reply_alike_to_messages_of_systems(kind, data_at):
    labels = [str(1000 + row) for row in range(8)] if kind is POINT_CLOUD else DEFAULT_LABELS
    paths, frames = Paths(kind=kind, labels=labels), DEMO['right'][:60].copy()
    if kind is not POINT_CLOUD:  # of which a point that is missing changes the others' numbers
        frames[20:30, 5] = frames[40:45, :2] = np.nan
    paths.install(data_at(frames[0], 0))
    for number in range(1, len(frames)):
        data = data_at(frames[number], number)
        assert paths.go(data)
        state, answers = paths.expected(data)
        assert paths.replies() == answers
        assert all(map(alike, paths.state(), state))
    before = paths.state()
    for data in (data_at(frames[0], 0), data_at(frames[0], 60)[:-60],
                 data_of(markers_of(frames[0], 60))):
        assert not paths.go(data)
    assert all(map(alike, paths.state(), before))
    assert paths.go(data_at(frames[0], 60))


def both_at(frames, frame, sides=('right', 'left'), late=()):
    """Return the message of a frame [mm] of both hands, each in the namespace of its side."""
    at = {side: Time(sec=5, nanosec=10_000_000 * frame + (side in late)) for side in sides}
    return data_of([marker(number, np.nan_to_num(frames[side][frame, number]), side, 'mocap',
                           Marker.SPHERE, 0, at[side]) for side in sides for number in range(8)])


def test_both_hands_of_a_message_are_tracked_as_each_alone():
    hands = {side: Paths(side, labels_of_hand(DEFAULT_LABELS, f'{side}/0')) for side in DEMO}
    one, other = hands.values()
    memories, memory = packed(new_memory())
    frames = {side: positions.copy() for side, positions in DEMO.items()}
    frames['left'][40:60] = np.nan

    def install(data):
        first = [hand.begin(data) for hand in hands.values()][0]
        assert install_signature(memory, [one.hand, other.hand],
                                 [hand.reader.signature for hand in hands.values()], first.stamp,
                                 SCALE, True)

    def go(data):
        return process_message(
            memories, tuple(hand.hands for hand in hands.values()),
            tuple(TrackPacks(*hand.fast.kernel_arguments()) for hand in hands.values()),
            np.frombuffer(data, np.uint8))

    template = joint_state_template([f'{side}_{joint}' for side in DEMO for joint in JOINTS])
    assert install_reply(memory, 0, template)
    install_part(one.hand, JOINT_STATES, 0, slice(0, 25))
    install_part(other.hand, JOINT_STATES, 0, slice(25, 50))
    install(both_at(frames, 0))
    for number in range(1, 100):
        data = both_at(frames, number)
        assert go(data)
        expected = [hand.expected(data)[0] for hand in hands.values()]
        assert all(all(map(alike, hand.state(), state))
                   for hand, state in zip(hands.values(), expected))
        reply = memory.replies[0].view(np.uint8)[ENCAPSULATION:ENCAPSULATION + template.size]
        assert reply.tobytes() == template.fill(
            Stamp(5, 10_000_000 * number), np.concatenate([state.angles for state in expected]))
    # One stamp is of both; nothing is done where it is not.
    before = [hand.state() for hand in hands.values()]
    assert not go(both_at(frames, 100, late=('left',)))
    assert not go(both_at(frames, 100, sides=('right',)))
    assert not go(both_at(frames, 99))
    assert all(all(map(alike, hand.state(), state)) for hand, state in zip(hands.values(), before))
    assert go(both_at(frames, 100))


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
        assert not install_signature(
            paths.memory, [paths.hand], [paths.reader.signature], Stamp(6, 0), SCALE, True)
    assert paths.go(data_of(markers_of(DEMO['right'][1], 1)))


def test_an_answer_that_has_no_room_is_not_installed(paths):
    long = joint_state_template([f'{joint}{"x" * (REPLY_CAPACITY // 25)}' for joint in JOINTS])
    assert not install_reply(paths.memory, JOINT_STATES, long)
    assert not install_reply(paths.memory, JOINT_STATES, joint_state_template(['x'] * 400))
    assert not install_reply(
        paths.memory, TRANSFORMS, transforms_template([('mocap', f'l{i}') for i in range(53)]))
    data = data_of(markers_of(DEMO['right'][1], 1))
    assert paths.go(data)
    assert paths.replies() == paths.expected(data)[1]


def test_only_what_is_wanted_is_filled(paths):
    paths.hand.reply[ANGLE_DEVIATIONS] = NOT_WANTED
    before = paths.replies()
    assert paths.go(data_of(markers_of(DEMO['right'][1], 1)))
    after = paths.replies()
    assert [after[number] != before[number] for number in sorted(before)] == [True, True, False]


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


def seen(hands, reports):
    """Look, and return what is new."""
    log = np.zeros((LOG_CAPACITY, LOG_COLUMNS))
    states = np.zeros((LOG_CAPACITY, LAYOUT_CAPACITY), np.int8)
    report = empty_like_pack(reports)
    kept, frames = drain_log(hands, reports, log, states, report)
    return log[:kept], states[:kept, :len(MARKERS)], frames, report


@pytest.mark.parametrize('count', [0, 1, 7, LOG_CAPACITY, LOG_CAPACITY + 30])
def test_what_was_noted_is_looked_at_once(paths, count):
    reports = paths.fast.kernel_arguments()[-1]
    for lap in range(2):
        for i in range(count):
            paths.hand.time[0] = i
            log_frame(paths.hand, reports[0], lap + 1e-3 * i, lap + 1e-3 * i + 1e-4)
        log, states, frames, report = seen(paths.hands, reports)
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
