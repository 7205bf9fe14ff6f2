"""Messages to arrays and back: every trap of the marker inputs seen in the wild."""

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from helpers.hands import rest_state
from helpers.markers import MARKER_POSITIONS, STAMP, eight, marker
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rclpy.serialization import deserialize_message, serialize_message
from visualization_msgs.msg import Marker, MarkerArray

from hand_tracker.core.model.hand import JOINTS, LINKS, Hand
from hand_tracker.core.model.kinematics import forward, joint_table, tip_offsets
from hand_tracker.core.model.marker_layout import MARKERS, MarkerLayout, marker_positions
from hand_tracker.core.model.states import MarkerState
from hand_tracker.core.numerics.quaternion import quaternion
from hand_tracker.core.tracker import HandTracker
from hand_tracker.drawing import palette
from hand_tracker.messages.builders import (
    diagnostics,
    fill_transforms,
    joint_state,
    link_frames,
    new_transforms,
    prefixed_names,
    tip_frames,
)
from hand_tracker.messages.labels import InvalidLabel, LabelMap
from hand_tracker.messages.marker_array import markers_from_message
from hand_tracker.messages.rviz_markers import (
    HELD_OPACITY,
    STATE_COLOURS,
    hand_markers,
    states_of_colours,
)
from hand_tracker.messages.templates import transform_numbers
from hand_tracker.tracking.diagnostics import Level, Status

NEEDS = 'rclpy', 'visualization_msgs'

SEEN_RGB, PREDICTED_RGB = palette.rgb(palette.BLUISH_GREEN), palette.rgb(palette.ORANGE)


def read(markers, labels=(), **options):
    """Return the frame of a message of these markers."""
    return markers_from_message(
        MarkerArray(markers=markers), LabelMap(labels) if labels else LabelMap(), **options)


# --- labels

@pytest.mark.parametrize('label, ns, number', [
    ('3', '', 3), ('3', 'leds', 3), (3, 'leds', 3), (' 3 ', 'leds', 3), ('-1', 'x', -1),
    ('leds/3', 'leds', 3), ('a/b/3', 'a/b', 3), ('/3', '', 3),
    ('thumb/*', 'thumb', 0), ('thumb/*', 'thumb', 99), ('a/b/*', 'a/b', 1)])
def test_label_forms(label, ns, number):
    labels = LabelMap(['', '', '', '', '', '', '', label])
    assert labels.slot(ns, number) == 7


@pytest.mark.parametrize('label, ns, number', [
    ('3', '', 4), ('leds/3', 'ids', 3), ('leds/3', 'leds', 4), ('/3', 'leds', 3),
    ('thumb/*', 'index', 0), ('', '', 0)])
def test_label_does_not_match(label, ns, number):
    assert LabelMap([label, '', '', '', '', '', '', '']).slot(ns, number) is None


def test_the_most_precise_label_wins():
    labels = LabelMap(['leds/*', '3', 'leds/3', '', '', '', '', ''])
    assert [labels.slot('leds', 3), labels.slot('ids', 3), labels.slot('leds', 4)] == [2, 1, 0]


@pytest.mark.parametrize('label, said', [
    ('leds', "labels.ring: 'leds'; expected an id"),
    ('leds/x', "labels.ring: 'leds/x'"),
    ('1.5', "labels.ring: '1.5'"),
    (1.5, 'labels.ring: 1.5 is neither'),
    (None, 'labels.ring: None is neither'),
    (True, 'labels.ring: True is neither'),
    (2**31, "labels.ring: '2147483648'"),
    ('4', "labels.ring: '4' is already middle's"),
    ('04', "labels.ring: '04' is already middle's")])
def test_refused_labels(label, said):
    labels = [str(i) for i in range(8)]
    labels[MARKERS.index('ring')] = label
    with pytest.raises(InvalidLabel, match='^' + said):
        LabelMap(labels)


def test_refuses_another_number_of_labels():
    with pytest.raises(InvalidLabel, match='7 given'):
        LabelMap(['1'] * 7)


# --- markers in

def test_reads_eight_markers_in_any_order():
    frame = read(eight()[::-1])
    assert np.array_equal(frame.positions, MARKER_POSITIONS)
    assert (frame.stamp, frame.frame_id) == (STAMP, 'mocap')
    assert (frame.unknown, frame.foreign, frame.doubled) == ((), (), ())


def test_phasespace_message():
    """DELETEALL first, spheres in one namespace, texts with the same ids 4 cm above."""
    message = [marker(0, (0, 0, 0), frame='', action=Marker.DELETEALL, stamp=Time())]
    for sphere in eight(ns='leds'):
        at = sphere.pose.position
        message += [sphere, marker(sphere.id, (at.x, at.y, at.z + .04), ns='ids',
                                   kind=Marker.TEXT_VIEW_FACING)]
    frame = read(message)
    assert np.array_equal(frame.positions, MARKER_POSITIONS)
    assert (frame.stamp, frame.frame_id, frame.doubled) == (STAMP, 'mocap', ())


@pytest.mark.parametrize('action', [1, Marker.DELETE, Marker.DELETEALL, 7, -1])
def test_only_what_is_added_counts(action):
    frame = read([*eight()[:7], marker(7, action=action)])
    assert np.isnan(frame.positions[7]).all()
    assert np.array_equal(frame.positions[:7], MARKER_POSITIONS[:7])


@pytest.mark.parametrize('kind', [Marker.CUBE, Marker.SPHERE, Marker.CYLINDER])
def test_point_like_types_count(kind):
    assert np.array_equal(read(eight(kind=kind)).positions, MARKER_POSITIONS)


@pytest.mark.parametrize('kind', [
    Marker.ARROW, Marker.LINE_STRIP, Marker.LINE_LIST, Marker.TEXT_VIEW_FACING,
    Marker.MESH_RESOURCE, Marker.TRIANGLE_LIST, 12, 99, -1])
def test_other_types_do_not_count(kind):
    frame = read(eight(kind=kind, points=MARKER_POSITIONS))
    assert frame.stamp is None
    assert np.isnan(frame.positions).all()


@pytest.mark.parametrize('kind', [Marker.POINTS, Marker.SPHERE_LIST, Marker.CUBE_LIST])
def test_points_of_a_list_are_labelled_by_their_index(kind):
    frame = read([marker(55, (0, 0, 0), kind=kind, points=MARKER_POSITIONS)])
    assert np.array_equal(frame.positions, MARKER_POSITIONS)
    assert frame.stamp == STAMP


def test_points_of_a_list_are_in_its_pose():
    cloud = marker(0, (1., 2., 3.), kind=Marker.POINTS, points=MARKER_POSITIONS)
    turn = cloud.pose.orientation
    turn.z, turn.w = 2., 2.  # a quarter turn about z; drivers forget to normalise
    expected = MARKER_POSITIONS @ np.array(((0, 1, 0), (-1, 0, 0), (0, 0, 1))) + (1, 2, 3)
    assert np.allclose(read([cloud]).positions, expected, rtol=0, atol=1e-15)
    turn.z = turn.w = 0.
    assert np.allclose(read([cloud]).positions, MARKER_POSITIONS + (1, 2, 3), rtol=0, atol=1e-15)


def test_points_of_a_list_are_lost_like_markers():
    points = MARKER_POSITIONS.copy()
    points[2], points[5] = 0., np.nan
    frame = read([marker(0, (1, 1, 1), kind=Marker.POINTS, points=points)])
    assert np.isnan(frame.positions[[2, 5]]).all()
    assert np.isfinite(frame.positions[[0, 1, 3, 4, 6, 7]]).all()


def test_an_empty_list_is_nothing():
    assert read([marker(0, kind=Marker.POINTS)]).stamp is None


def test_absent_markers_are_missing():
    frame = read([eight()[i] for i in (0, 1, 2, 5)])
    assert np.isnan(frame.positions[[3, 4, 6, 7]]).all()
    assert np.array_equal(frame.positions[[0, 1, 2, 5]], MARKER_POSITIONS[[0, 1, 2, 5]])


@pytest.mark.parametrize('lost', [(np.nan,) * 3, (1., np.nan, 1.), (np.inf, 0., 0.)])
def test_numbers_that_are_not_finite_stay_so(lost):
    frame = read([marker(0, lost), *eight()[1:]])
    assert not np.isfinite(frame.positions[0]).all()
    assert np.array_equal(frame.positions[1:], MARKER_POSITIONS[1:])


def test_zero_is_missing_or_not():
    message = [marker(0, (0., -0., 0.)), marker(1, (0., 0., 1e-9)), *eight()[2:]]
    frame = read(message)
    assert np.isnan(frame.positions[0]).all()
    assert np.array_equal(frame.positions[1], (0., 0., 1e-9))
    assert np.array_equal(read(message, zero_is_missing=False).positions[0], (0., 0., 0.))


def test_a_lost_marker_still_gives_the_stamp():
    assert read([marker(4, (np.nan,) * 3)]).stamp == STAMP


def test_the_last_of_two_that_answer_to_one_label_wins_and_is_reported():
    frame = read([*eight(), marker(3, (9., 9., 9.), ns='other')])
    assert np.array_equal(frame.positions[3], (9., 9., 9.))
    assert frame.doubled == (3,)
    frame = read([marker(3, (9., 9., 9.)), marker(3, (np.nan,) * 3)])
    assert np.isnan(frame.positions[3]).all()


def test_labels_choose_one_of_two_hands():
    other = eight(MARKER_POSITIONS + 5., ns='left')
    frame = read([*other, *eight(ns='right')], [f'right/{i}' for i in range(8)])
    assert np.array_equal(frame.positions, MARKER_POSITIONS)
    assert frame.doubled == ()
    assert frame.unknown == tuple(('left', i) for i in range(8))


def test_a_marker_in_another_frame_is_left_out():
    frame = read([marker(0, MARKER_POSITIONS[0]), marker(1, frame='base'),
                  marker(2, MARKER_POSITIONS[2], frame='')])
    assert np.array_equal(frame.positions[[0, 2]], MARKER_POSITIONS[[0, 2]])
    assert np.isnan(frame.positions[1]).all()
    assert (frame.frame_id, frame.foreign) == ('mocap', ('base',))


def test_the_first_marker_of_the_hand_gives_the_frame():
    frame = read([marker(99, frame='base'), marker(0, frame=''), marker(1)])
    assert (frame.frame_id, frame.foreign) == ('mocap', ())


def test_frame_asked_for():
    frame = read([marker(0, MARKER_POSITIONS[0], frame='base'), marker(1, MARKER_POSITIONS[1]),
                  marker(2, frame='')],
                 frame_id='mocap')
    assert np.isnan(frame.positions[0]).all()
    assert np.array_equal(frame.positions[1], MARKER_POSITIONS[1])
    assert (frame.frame_id, frame.foreign) == ('mocap', ('base',))
    alone = read([marker(0, frame='base')], frame_id='mocap')
    assert (alone.stamp, alone.foreign) == (None, ('base',))


def test_units():
    frame = read(eight(MARKER_POSITIONS * 1000.), scale=.001)
    assert np.allclose(frame.positions, MARKER_POSITIONS, rtol=1e-15, atol=0)


def test_stamp_of_the_first_marker_of_the_hand():
    message = [marker(99, stamp=Time(sec=1)), marker(0, stamp=Time(sec=2)),
               marker(1, stamp=Time(sec=3))]
    assert read(message).stamp == Time(sec=2)


def test_empty_messages():
    for markers in ([], [marker(0, action=Marker.DELETEALL)], [marker(8), marker(-1)]):
        frame = read(markers)
        assert frame.stamp is None
        assert np.isnan(frame.positions).all()


def test_a_hostile_message_is_reported_within_bounds():
    crowd = [marker(100 + i, frame=f'frame{i}') for i in range(500)]
    crowd += [marker(0, (0, 0, 0), kind=Marker.POINTS, points=np.ones((5000, 3)))]
    crowd += [marker(1, frame=f'frame{i}') for i in range(500)]
    frame = read(crowd)
    assert len(frame.unknown) == len(frame.foreign) == 8
    assert np.array_equal(frame.positions, np.ones((8, 3)))


@settings(max_examples=100, deadline=None)
@given(arrays(float, (8, 3)), st.booleans(), st.sampled_from([1e-6, .001, 1., 1e3]))
def test_any_numbers_go_through_and_are_tracked(numbers, zero_is_missing, scale):
    with np.errstate(over='ignore', invalid='ignore'):
        frame = read(eight(numbers), zero_is_missing=zero_is_missing, scale=scale)
        expected = numbers * scale
    lost = zero_is_missing & ~numbers.any(axis=1)
    assert np.isnan(frame.positions[lost]).all()
    assert np.array_equal(frame.positions[~lost], expected[~lost], equal_nan=True)
    state = HandTracker().update(frame.positions)
    assert np.isfinite(state.angles).all()
    assert np.isfinite(joint_state(STAMP, prefixed_names('').joints, state.angles).position).all()


@settings(max_examples=100, deadline=None)
@given(arrays(float, (8, 3), elements=st.floats(-1e3, 1e3)))
def test_a_list_and_single_markers_say_the_same(positions):
    cloud = marker(0, (0, 0, 0), kind=Marker.SPHERE_LIST, points=positions)
    assert np.array_equal(
        read([cloud]).positions, read(eight(positions)).positions, equal_nan=True)


# --- joint states

def test_joint_state():
    angles = np.linspace(-1., 1., 25)
    message = joint_state(STAMP, prefixed_names('left_').joints, angles)
    assert list(message.name) == [f'left_{joint}' for joint in JOINTS]
    assert np.array_equal(message.position, angles)
    assert message.header.stamp == STAMP
    assert len(message.velocity) == len(message.effort) == 0


# --- diagnostics

@pytest.mark.parametrize('level', Level)
def test_diagnostics(level):
    message = diagnostics(STAMP, 'hand_tracker: right hand', '/markers', Status(
        level, 'tracking', {'palm': 'tracked', 'rate [Hz]': '120.0'}))
    status, = message.status
    assert message.header.stamp == STAMP
    assert status.level == getattr(DiagnosticStatus, level.name)
    assert (status.name, status.hardware_id, status.message) == (
        'hand_tracker: right hand', '/markers', 'tracking')
    assert [(pair.key, pair.value) for pair in status.values] == [
        ('palm', 'tracked'), ('rate [Hz]', '120.0')]


# --- transforms

def turned(q):
    """Return the rotation of a quaternion by the product q v q*, column by column."""
    w, v = q[3], np.array(q[:3])
    return np.column_stack([
        e + 2. * np.cross(v, np.cross(v, e) + w * e) for e in np.eye(3)])


def about(axis, angle):
    """Return the rotation by Rodrigues' formula."""
    x, y, z = axis
    k = np.array(((0, -z, y), (z, 0, -x), (-y, x, 0)))
    return np.eye(3) + np.sin(angle) * k + (1. - np.cos(angle)) * k @ k


@settings(max_examples=300, deadline=None)
@given(arrays(float, 3, elements=st.floats(-1., 1.)), st.floats(-np.pi, np.pi))
def test_quaternion_of_any_rotation(axis, angle):
    axis = axis / np.linalg.norm(axis) if np.linalg.norm(axis) > .01 else np.eye(3)[0]
    matrix = about(axis, angle)
    q = quaternion(matrix.tolist())
    assert abs(np.linalg.norm(q) - 1.) < 1e-15
    assert q[3] >= 0.
    assert np.allclose(turned(q), matrix, rtol=0, atol=1e-14)


@pytest.mark.parametrize('half_turn', [(1, -1, -1), (-1, 1, -1), (-1, -1, 1)])
def test_quaternion_of_half_turns(half_turn):
    q = quaternion(np.diag(half_turn).astype(float).tolist())
    assert np.allclose(np.abs(q), (np.array((*half_turn, 0)) + 1) / 2 * (1, 1, 1, 0))


def test_quaternion_of_no_turn():
    assert quaternion(np.eye(3).tolist()) == (0., 0., 0., 1.)


@pytest.mark.parametrize('side', ['right', 'left'])
def test_chained_transforms_are_the_pose(side):
    hand = Hand.scaled(side=side)
    table = joint_table(hand)
    rng = np.random.default_rng(7)
    turn, at = about(np.array((.6, 0., .8)), 2.), np.array((.1, -.2, 1.))
    pose = forward(table, rng.uniform(*hand.limits.T), turn, at)
    state = rest_state(side=side)._replace(pose=pose, wrist_rotation=turn, wrist_position=at)
    names = prefixed_names('r_', 'base')
    messages = new_transforms(link_frames(names, table))
    fill_transforms(messages, STAMP, transform_numbers(table, state)[1:])
    frames = {'base': (turn, at)}
    for message in messages:
        rotation, position = frames[message.header.frame_id]
        to, q = message.transform.translation, message.transform.rotation
        frames[message.child_frame_id] = (
            rotation @ turned((q.x, q.y, q.z, q.w)), rotation @ (to.x, to.y, to.z) + position)
        assert message.header.stamp == STAMP
    for i, link in enumerate(LINKS):
        rotation, position = frames[f'r_{link}']
        assert np.allclose(rotation, pose.rotation[i], rtol=0, atol=1e-13)
        assert np.allclose(position, pose.position[i], rtol=0, atol=1e-13)


def test_tips_hang_on_the_distal_links():
    frames = tip_frames(prefixed_names('r_'))
    assert frames[0] == ('r_index_distal', 'r_index_tip')
    assert frames[4] == ('r_thumb_distal', 'r_thumb_tip')


# --- the picture

def picture(state):
    """Return the picture's markers by namespace."""
    message = hand_markers(
        STAMP, 'mocap', prefixed_names('r_'), tip_offsets(Hand.scaled()), state)
    return {marker.ns: marker for marker in message.markers}


def rgb(colour):
    """Return a colour's numbers."""
    return pytest.approx((colour.r, colour.g, colour.b))


def test_picture_of_a_seen_hand():
    state = rest_state()
    parts = picture(state)
    assert set(parts) == {'r_bones', 'r_joints', 'r_markers'}
    for part in parts.values():
        assert (part.header.stamp, part.header.frame_id) == (STAMP, 'mocap')
        assert part.color.a == 1.
        assert part.lifetime.sec + part.lifetime.nanosec > 0
    points = [(p.x, p.y, p.z) for p in parts['r_markers'].points]
    assert np.array_equal(points, state.markers)
    assert all(SEEN_RGB == rgb(colour) for colour in parts['r_markers'].colors)


def test_bones_have_the_lengths_of_the_hand():
    hand = Hand.scaled()
    ends = np.array([(p.x, p.y, p.z) for p in picture(rest_state())['r_bones'].points])
    lengths = np.linalg.norm(ends[::2] - ends[1::2], axis=1)
    for bone in (*hand.finger_bones.ravel(), *hand.thumb_bones,
                 *np.linalg.norm(hand.finger_cmc, axis=1)):
        assert np.abs(lengths - bone).min() < 1e-12
    assert lengths.min() > .005


def test_picture_shows_seen_held_and_absent_differently():
    hand = Hand.scaled()
    places = marker_positions(
        MarkerLayout().mounting(hand), forward(joint_table(hand), np.zeros(len(JOINTS))))
    tracker = HandTracker(hand)
    places[7] = np.nan
    tracker.update(places)
    places[5] = np.nan
    part = picture(tracker.update(places))['r_markers']
    assert len(part.points) == len(part.colors) == 7
    assert [PREDICTED_RGB == rgb(colour) for colour in part.colors] == [i == 5 for i in range(7)]


def test_picture_has_a_colour_for_every_state_of_a_marker():
    states = np.array((*STATE_COLOURS, *STATE_COLOURS))[:8]
    assert set(STATE_COLOURS) == set(MarkerState) - {MarkerState.ABSENT}
    state = rest_state()._replace(marker_states=states)
    part = picture(state)['r_markers']
    assert (part.id, len(part.points)) == (0, 8)
    assert len(set(STATE_COLOURS.values())) == len(STATE_COLOURS)
    assert all(STATE_COLOURS[kind] == rgb(colour) for kind, colour in zip(states, part.colors))


def test_states_are_read_back_from_the_colours_of_a_serialized_picture():
    states = np.resize([state for state in MarkerState if state != MarkerState.ABSENT], 8)
    shown = picture(rest_state()._replace(marker_states=states))['r_markers']
    read_back = deserialize_message(serialize_message(shown), Marker)
    assert states_of_colours(read_back.colors).tolist() == states.tolist()
    assert len(states_of_colours([])) == 0


def test_picture_fades_when_the_palm_is_lost():
    tracker = HandTracker()
    tracker.update(rest_state().markers)
    parts = picture(tracker.update(np.full((8, 3), np.nan)))
    assert parts['r_bones'].color.a == pytest.approx(HELD_OPACITY)
    assert all(PREDICTED_RGB == rgb(colour) for colour in parts['r_markers'].colors)
