"""Links: the distances of a digit's neighbouring markers tell touching digits apart."""

import numpy as np
import pytest

from hand_tracker.core.model.hand import FLEXION_JOINTS, Hand
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.layout_presets import preset_layout
from hand_tracker.core.model.marker_layout import MARKERS, MarkerLayout, marker_positions
from hand_tracker.core.point_labelling.cloud_labeller import CloudLabeller
from hand_tracker.core.point_labelling.clutter import new_cloud, no_clutter
from hand_tracker.core.point_labelling.following import CROSSING_TRUST, _exchange_by_links
from hand_tracker.core.point_labelling.hand_track import begin_track
from hand_tracker.core.point_labelling.links import (
    exchange_gain,
    links_cost,
    marker_links_cost,
)
from hand_tracker.core.point_labelling.natural_poses import (
    FITTED,
    SIZED,
    marker_digits,
    model_prototype,
    natural_poses,
)
from hand_tracker.core.point_labelling.palm_search import (
    blank_finding,
    place_by_palm,
    to_palm_frame,
    write_cost,
)
from hand_tracker.core.point_labelling.posture import (
    posture_cost,
    posture_distance,
    reset_matrix,
)
from hand_tracker.core.point_labelling.prototypes import learn_prototype
from hand_tracker.core.point_labelling.returns import PalmPoints

LAYOUT = preset_layout('sig18_19')
NAMES = tuple(LAYOUT.names)
PROTOTYPE = model_prototype(Hand.scaled(), LAYOUT, NAMES, SIZED)
RING, LITTLE = NAMES.index('RingTip'), NAMES.index('PinkyTip')
RATE = 120.


def markers_of(pose):
    """Return the 19 markers in one of the natural poses, (19, 3) [m]."""
    hand = Hand.scaled()
    return marker_positions(LAYOUT.mounting(hand), forward(
        joint_table(hand), natural_poses(hand, 20)[pose:pose + 1]))[0]


def test_links_join_neighbours_of_digits_with_several_markers():
    statistics = PROTOTYPE.statistics
    linked = {tuple(NAMES[i] for i in pair) for pair in statistics.links}
    assert {('RingPIP', 'RingTip'), ('ThumbIP', 'ThumbTip'), ('IndexMCP', 'IndexPIP')} <= linked
    assert ('RingMCP', 'RingPIP') in linked     # in a fist the middle finger's knuckle is nearer
    assert not any('BackHand' in name for pair in linked for name in pair)
    places = markers_of(5)
    for (one, other), (mean, deviation) in zip(statistics.links, statistics.lengths):
        assert np.linalg.norm(places[one] - places[other]) == pytest.approx(
            mean, abs=4. * deviation)
    eight = model_prototype(Hand.scaled(), MarkerLayout(), MARKERS).statistics
    assert eight.links.shape == (0, 2)


def test_an_exchange_gains_what_the_links_cost_less():
    statistics, places = PROTOTYPE.statistics, markers_of(5)
    rows = np.arange(len(NAMES))
    right = links_cost(statistics, places, rows)
    exchanged = rows.copy()
    exchanged[[RING, LITTLE]] = LITTLE, RING
    wrong = links_cost(statistics, places, exchanged)
    assert wrong > right + 10.
    assert exchange_gain(statistics, places, exchanged, RING, LITTLE) == pytest.approx(
        wrong - right)
    assert exchanged[RING] == LITTLE  # as before
    exchanged[RING] = -1
    assert links_cost(statistics, places, exchanged) < wrong


def test_a_place_costs_what_its_links_to_seen_markers_do():
    statistics, places = PROTOTYPE.statistics, markers_of(5)
    hidden_for = np.zeros(len(NAMES))
    own = marker_links_cost(statistics, places, hidden_for, RING, places[RING])
    assert marker_links_cost(statistics, places, hidden_for, RING, places[LITTLE]) > own + 5.
    hidden_for[NAMES.index('RingPIP')] = .1
    assert marker_links_cost(statistics, places, hidden_for, RING, places[LITTLE]) == 0.


def test_labels_of_tips_whose_points_cross_are_exchanged_within_frames():
    labeller = CloudLabeller([PROTOTYPE])
    places, random = markers_of(5), np.random.default_rng(1)
    wrong = 0
    for frame in range(180):
        points = places + random.normal(0., .0005, places.shape)
        # One glides into the other's place, each step like those of fast fingers.
        share = min(max((frame - 100) / 8., 0.), 1.)
        points[[RING, LITTLE]] += share * (points[[LITTLE, RING]] - points[[RING, LITTLE]])
        order = random.permutation(len(points))
        rows = labeller.update(points[order], frame / RATE).rows[0]
        right = np.argsort(order)
        if share == 1.:
            # The point that ends as the tip of the ring finger is the little one's first.
            right[[RING, LITTLE]] = right[[LITTLE, RING]]
            wrong += not np.array_equal(rows, right)
        elif share == 0. and frame > 30:
            assert np.array_equal(rows, right)
    assert wrong <= 4


def judge(rows, seen):
    """Return what labels cost, as a finding, and matrix, gradient and distance of the posture."""
    statistics, count = PROTOTYPE.statistics, len(NAMES)
    finding = blank_finding(count)
    place_by_palm(statistics, seen.cloud.points, np.arange(count), finding)
    finding.rows[:] = rows
    to_palm_frame(
        seen.cloud.points, finding.rotation, finding.position, finding.size[0], seen.local)
    matrix, gradient = np.empty((3 * count, 3 * count)), np.empty(3 * count)
    constant, hidden = reset_matrix(statistics, rows, matrix)
    distance = posture_distance(
        matrix, statistics.template, seen.local, rows, np.empty(3 * count), gradient)
    write_cost(statistics, seen.local, finding,
               posture_cost(constant, distance, count - hidden, hidden), distance)
    return finding, (matrix, gradient, distance)


def exchanged_track(one, other):
    """Return a track with two markers' points exchanged, its points, posture and right cost."""
    places, rows = markers_of(5), np.arange(len(NAMES))
    cloud = new_cloud(places, np.full(len(NAMES), -1))
    cloud.slots[:] = np.arange(len(NAMES))
    seen = PalmPoints(cloud, np.empty_like(places), no_clutter(len(NAMES)).history, 0)
    right, _ = judge(rows, seen)
    rows[[one, other]] = other, one
    finding, posture = judge(rows, seen)
    return begin_track(PROTOTYPE.statistics, finding, places), seen, posture, right


@pytest.mark.parametrize('trusted, frames', [(0., 3), (.5, 6), (1., None)])
def test_points_are_exchanged_after_as_many_frames_as_the_labels_were_trusted(trusted, frames):
    track, seen, posture, right = exchanged_track(RING, LITTLE)
    track.trusted_for[:] = trusted * CROSSING_TRUST
    track.drift[RING], track.drift[LITTLE] = 1., 2.
    needed = 0
    while track.finding.rows[RING] == LITTLE and needed < 20:
        _exchange_by_links(PROTOTYPE.statistics, track, seen, *posture, len(NAMES))
        needed += 1
    if frames is None:
        assert track.finding.rows[RING] == LITTLE
        return
    assert needed == frames
    assert np.array_equal(track.finding.rows, np.arange(len(NAMES)))
    assert np.array_equal(track.local[[RING, LITTLE]], seen.local[[RING, LITTLE]])
    assert (track.drift[RING] == 2.).all() and (track.drift[LITTLE] == 1.).all()
    assert not track.exchanged[[RING, LITTLE]].any() and track.trusted_for[RING, LITTLE] == 0.
    # What the hand is judged by next is of the labels that it has now.
    assert track.finding.cost[0] == pytest.approx(right.cost[0])
    assert track.finding.distance[0] == pytest.approx(right.distance[0])


def test_a_frame_in_which_a_marker_was_given_up_is_no_evidence_for_an_exchange():
    track, seen, posture, _ = exchanged_track(RING, LITTLE)
    _exchange_by_links(PROTOTYPE.statistics, track, seen, *posture, len(NAMES))
    thumb = NAMES.index('ThumbTip')
    evidence = track.exchanged.copy()
    assert evidence.any()
    track.finding.rows[thumb] = -1
    for _ in range(9):
        _exchange_by_links(PROTOTYPE.statistics, track, seen, *posture, len(NAMES))
    assert track.finding.rows[RING] == LITTLE
    assert np.array_equal(track.exchanged, evidence)


@pytest.mark.parametrize('pair', [('IndexMCP', 'MiddleMCP'), ('PinkyMCP', 'PinkyPIP')])
def test_points_of_the_palm_are_not_exchanged_by_links(pair):
    one, other = map(NAMES.index, pair)
    track, seen, posture, _ = exchanged_track(one, other)
    for _ in range(9):
        _exchange_by_links(PROTOTYPE.statistics, track, seen, *posture, len(NAMES))
    assert track.finding.rows[one] == other


def test_links_join_neighbours_where_the_tips_are_mostly_nearer_to_the_palm():
    hand = Hand.scaled()
    angles = natural_poses(hand, 100)
    angles[10:, FLEXION_JOINTS[:4]] = np.radians((80., 115., 70.))
    places = marker_positions(LAYOUT.mounting(hand), forward(joint_table(hand), angles))
    bent = learn_prototype(NAMES, places, marker_digits(LAYOUT.mounting(hand).link), 'right')
    linked = {tuple(NAMES[i] for i in pair) for pair in bent.statistics.links}
    assert {('MiddlePIP', 'MiddleTip'), ('RingPIP', 'RingTip'), ('PinkyPIP', 'PinkyTip')} <= linked
    tip, pip, knuckle = (NAMES.index(f'Middle{joint}') for joint in ('Tip', 'PIP', 'MCP'))
    mean = bent.statistics.template
    assert np.linalg.norm(mean[tip] - mean[knuckle]) < np.linalg.norm(mean[pip] - mean[knuckle])


def test_markers_next_but_one_tell_which_is_hidden():
    statistics, places = PROTOTYPE.statistics, markers_of(5)
    knuckle, middle, tip = (NAMES.index(f'Ring{joint}') for joint in ('MCP', 'PIP', 'Tip'))
    rows = np.arange(len(NAMES))
    rows[middle] = -1
    right = links_cost(statistics, places, rows)
    rows[tip] = middle
    assert links_cost(statistics, places, rows) > right + 5.
    # Among all three the neighbours alone tell it.
    rows[[middle, tip]] = middle, tip
    neighbours = statistics._replace(**{name: getattr(statistics, name)[statistics.between < 0]
                                        for name in ('links', 'lengths', 'between')})
    assert links_cost(statistics, places, rows) == links_cost(neighbours, places, rows)


def test_links_keep_their_length_where_skin_turns_with_the_joint():
    hand = Hand.scaled()
    # Behind its joint, and turning with all of its flexion: as if on the next bone.
    on_next = {name: (.016, 0., .011) for name in NAMES if name.endswith('PIP')}
    layout = MarkerLayout(
        LAYOUT.places, [on_next.get(name, at) for name, at in zip(NAMES, LAYOUT.offsets)],
        names=NAMES, skin_shares=[float(name in on_next) for name in NAMES])
    statistics = model_prototype(hand, layout, NAMES, FITTED).statistics
    spread = {tuple(NAMES[i] for i in pair): deviation
              for pair, (_, deviation) in zip(statistics.links, statistics.lengths)}
    assert all(spread[f'{digit}PIP', f'{digit}Tip'] < .006
               for digit in ('Index', 'Middle', 'Ring', 'Pinky'))
