"""Marker layout: places and offsets become positions; what cannot be solved is refused."""

import re

import numpy as np
import pytest
from helpers.palms import random_rotation

from hand_tracker.core.errors import HandTrackerError, InvalidLayout
from hand_tracker.core.model.hand import FINGERS, JOINTS, LINKS, Hand
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.marker_layout import (
    DIGIT_LANDMARKS,
    MARKERS,
    PALM_LANDMARKS,
    PALM_MARKERS,
    PAPER_PLACES,
    MarkerLayout,
    marker_positions,
)

ZERO = np.zeros(25)


@pytest.fixture
def hand():
    return Hand.scaled(splay=(.1, 0., -.05, -.1))


def positions(hand, layout, angles=ZERO, **wrist):
    pose = forward(joint_table(hand), angles, *wrist.values())
    return marker_positions(layout.mounting(hand), pose, **wrist)


def offset(marker, xyz):
    offsets = np.zeros((8, 3))
    offsets[MARKERS.index(marker)] = xyz
    return offsets


def test_the_papers_markers_are_joints_of_the_hand(hand):
    angles = np.random.default_rng(1).uniform(*hand.limits.T)
    pose = forward(joint_table(hand), angles)
    found = positions(hand, MarkerLayout(), angles)
    assert found[0] == pytest.approx(np.zeros(3))
    assert found[1] == pytest.approx(hand.finger_mcp[0])
    assert found[2] == pytest.approx(hand.finger_mcp[3])
    dips = [LINKS.index(f'{finger}_distal') for finger in FINGERS]
    assert found[3:7] == pytest.approx(pose.position[dips])
    tip = pose.position[24] + pose.rotation[24] @ (hand.thumb_bones[2], 0., 0.)
    assert found[7] == pytest.approx(tip)


def test_dip_marker_rides_on_the_middle_bone(hand):
    layout = MarkerLayout(offsets=offset('ring', (0., 0., .01)))
    bent = ZERO.copy()
    bent[JOINTS.index('ring_dip_flexion')] = 1.
    assert positions(hand, layout, bent) == pytest.approx(positions(hand, layout))
    bent[JOINTS.index('ring_pip_flexion')] = np.pi / 2.
    shift = positions(hand, layout, bent) - positions(hand, MarkerLayout(), bent)
    # The back of a bone bent by a right angle faces forward, along the finger.
    assert shift[5] == pytest.approx((.01 * np.cos(.05), -.01 * np.sin(.05), 0.), abs=1e-12)
    assert np.delete(shift, 5, axis=0) == pytest.approx(np.zeros((7, 3)))


@pytest.mark.parametrize('marker, place, expected', [
    ('wrist', 'ring_cmc', lambda hand: hand.finger_cmc[2]),
    ('wrist', 'thumb_cmc', lambda hand: hand.thumb_cmc),
    ('index_mcp', 'middle_mcp', lambda hand: hand.finger_mcp[1]),
    ('middle', 'middle_tip', lambda hand: hand.finger_mcp[1] + (hand.finger_bones[1].sum(), 0, 0)),
    ('thumb', 'thumb_ip',
     lambda hand: hand.thumb_cmc + hand.thumb_bones[:2].sum() * hand.thumb_rest_direction),
])
def test_other_places(hand, marker, place, expected):
    places = list(PAPER_PLACES)
    places[MARKERS.index(marker)] = place
    found = positions(hand, MarkerLayout(places))
    assert found[MARKERS.index(marker)] == pytest.approx(expected(hand), abs=1e-12)


def test_every_allowed_place_gives_a_position(hand):
    for marker in MARKERS:
        for place in DIGIT_LANDMARKS.get(marker, PALM_LANDMARKS):
            places = list(PAPER_PLACES)
            places[MARKERS.index(marker)] = place
            assert np.isfinite(positions(hand, MarkerLayout(places))).all()


def test_left_hand_wears_the_mirror_image(hand):
    rng = np.random.default_rng(2)
    layout = MarkerLayout(offsets=rng.uniform(-.02, .02, (8, 3)))
    angles = rng.uniform(*hand.limits.T)
    right = positions(hand, layout, angles)
    left = positions(hand.mirrored(), layout, angles)
    assert left == pytest.approx(right * (1., -1., 1.), abs=1e-12)


def test_wrist_pose_moves_the_markers_as_a_rigid_body(hand):
    rng = np.random.default_rng(3)
    layout = MarkerLayout(offsets=rng.uniform(-.02, .02, (8, 3)))
    angles, turned, at = rng.uniform(*hand.limits.T), random_rotation(rng), rng.normal(size=3)
    found = positions(hand, layout, angles, wrist_rotation=turned, wrist_position=at)
    assert found == pytest.approx(positions(hand, layout, angles) @ turned.T + at, abs=1e-12)


def test_batch_equals_single_frames(hand):
    rng = np.random.default_rng(4)
    layout = MarkerLayout(offsets=rng.uniform(-.02, .02, (8, 3)))
    angles = rng.uniform(*hand.limits.T, size=(5, 25))
    turned = np.array([random_rotation(rng) for _ in angles])
    at = rng.normal(size=(5, 3))
    batch = positions(hand, layout, angles, wrist_rotation=turned, wrist_position=at)
    assert batch.shape == (5, 8, 3)
    for i in range(5):
        assert batch[i] == pytest.approx(positions(
            hand, layout, angles[i], wrist_rotation=turned[i], wrist_position=at[i]), abs=1e-15)


def test_offsets_are_frozen_copies():
    mine = np.zeros((8, 3))
    layout = MarkerLayout(offsets=mine)
    mine[0] = 1.
    assert (layout.offsets == 0.).all()
    with pytest.raises(ValueError, match='read-only'):
        layout.offsets[0] = 1.


@pytest.mark.parametrize('fields, message', [
    ({'places': PAPER_PLACES[:7]}, 'places: 7 given; expected one for each of'),
    ({'places': PAPER_PLACES[:3] + ('index_pip',) + PAPER_PLACES[4:]},
     "marker index: place 'index_pip' is not one of index_dip, index_tip"),
    ({'places': ('index_dip',) + PAPER_PLACES[1:]},
     "marker wrist: place 'index_dip' is not one of wrist, thumb_cmc, index_cmc"),
    ({'places': PAPER_PLACES[:7] + ('index_tip',)},
     "marker thumb: place 'index_tip' is not one of thumb_ip, thumb_tip"),
    ({'offsets': np.zeros((7, 3))}, 'offsets: shape (7, 3); expected (8, 3)'),
    ({'offsets': offset('ring', (0., .1, 0.))}, 'marker ring: offset [0.  0.1 0. ] m; allowed is'),
    ({'offsets': offset('thumb', (np.nan, 0., 0.))}, 'marker thumb: offset [nan  0.  0.] m'),
    ({'deviations': np.zeros(5)}, 'deviations: shape (5,); expected (8,)'),
    ({'deviations': (0.,) * 7 + (.02,)}, 'marker thumb: deviation 0.02; allowed is 0 to 0.01 m'),
    ({'deviations': (np.nan,) + (0.,) * 7}, 'marker wrist: deviation nan; allowed is'),
])
def test_refusals_name_marker_value_and_what_is_allowed(fields, message):
    with pytest.raises(InvalidLayout, match=re.escape(message)) as refused:
        MarkerLayout(**fields)
    assert isinstance(refused.value, HandTrackerError)


def test_palm_markers_come_first():
    assert PALM_MARKERS == ('wrist', 'index_mcp', 'little_mcp')
    assert not set(PALM_MARKERS) & set(DIGIT_LANDMARKS)


@pytest.mark.parametrize('side', ['right', 'left'])
@pytest.mark.parametrize('place, link, joint', [
    ('ring_pip', 'ring_proximal', 'ring_pip_flexion'),
    ('little_dip', 'little_middle', 'little_dip_flexion'),
    ('thumb_mcp', 'thumb_metacarpal', 'thumb_mcp_flexion'),
    ('thumb_ip', 'thumb_proximal', 'thumb_ip_flexion')])
def test_skin_turns_by_its_share_of_the_flexion(hand, side, place, link, joint):
    worn, share, height = hand.replace(side=side), .4, .01
    layout = MarkerLayout([*PAPER_PLACES, place], np.vstack((np.zeros((8, 3)), (0., 0., height))),
                          names=[*MARKERS, 'skin'], skin_shares=[*[0.] * 8, share])
    angles = np.random.default_rng(2).uniform(*hand.limits.T)
    pose = forward(joint_table(worn), np.stack((angles, ZERO)))
    landmark = marker_positions(layout.with_offsets(np.zeros((9, 3))).mounting(worn), pose)[:, 8]
    found = marker_positions(layout.mounting(worn), pose)[:, 8] - landmark
    turn = share * angles[JOINTS.index(joint)]
    axes = pose.rotation[:, LINKS.index(link)]
    assert found[0] == pytest.approx(axes[0] @ (height * np.sin(turn), 0., height * np.cos(turn)))
    assert found[1] == pytest.approx(axes[1] @ (0., 0., height))
