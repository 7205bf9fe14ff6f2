"""Cameras see what is before them, and place it as well as their geometry allows."""

import numpy as np
import pytest

from hand_tracker.core.model.hand import JOINTS, LINKS, Hand
from hand_tracker.core.model.kinematics import forward, joint_table, tip_offsets
from hand_tracker.core.model.marker_layout import MARKERS, marker_positions
from hand_tracker.core.model.skeleton import SKELETON_BONES, bone_radii, skeleton_points
from hand_tracker.simulation.cameras import RING_CENTRE, CameraRig, InvalidRig, looking_at
from hand_tracker.simulation.faults import (
    MIRROR_HEIGHT,
    Event,
    Faults,
    InvalidFaults,
    fault_events,
    with_faults,
)
from hand_tracker.simulation.visibility import (
    LED_RADIUS,
    has_line_of_sight,
    in_view,
    observe,
    skin_layout,
    triangulate,
)

HAND = Hand.scaled()
LAYOUT = skin_layout(HAND)


def rig_at(*places, target=(0., 0., 0.), **fields):
    places = np.array(places, dtype=float)
    return CameraRig(places, looking_at(places, target), **fields)


def flat_hand(angles=None, hand=HAND):
    """Return markers and points of a hand at the origin, palm down."""
    pose = forward(joint_table(hand), [np.zeros(25) if angles is None else angles])
    return (marker_positions(skin_layout(hand).mounting(hand), pose),
            skeleton_points(tip_offsets(hand), pose, np.zeros((1, 3))))


def clear_by_search(camera, marker, ends, radii):
    """Decide by many points along the way and along each bone."""
    way = marker + np.linspace(0., 1., 4001)[:, None] * (camera - marker)
    way = way[np.linalg.norm(way - marker, axis=1) < .4]
    gaps = []
    for start, end in ends:
        bone = end - start
        along = np.clip((way - start) @ bone / (bone @ bone), 0., 1.)
        gaps.append(np.linalg.norm(way - start - along[:, None] * bone, axis=1).min())
    return (np.array(gaps) - radii).min()


def test_sees_the_back_of_the_hand_from_above_and_nothing_from_below():
    markers, points = flat_hand()
    rig = rig_at((.08, 0., 1.), (.08, 0., -1.))
    clear = has_line_of_sight(rig, markers, points, bone_radii(HAND))
    assert clear[0, :, 0].all()
    # The thumb's nail looks sideways.
    assert not clear[0, :MARKERS.index('thumb'), 1].any()


def test_a_marker_behind_another_finger_is_not_seen():
    markers, points = flat_hand()
    index, middle = MARKERS.index('index'), MARKERS.index('middle')
    across = markers[0, middle] + (0., 1., 0.)
    low = markers.copy()
    low[0, middle, 2] -= LED_RADIUS + HAND.radii[1, 1] + .001
    rig = rig_at(across, across + 1e-6)
    assert has_line_of_sight(rig, markers, points, bone_radii(HAND))[0, [index, middle], 0].all()
    assert not has_line_of_sight(rig, low, points, bone_radii(HAND))[0, middle, 0]


def test_the_own_finger_hides_its_marker_from_palmar_only():
    """Beside the finger at the marker's height the way is free; the finger's half is not."""
    marker, points = flat_hand()
    i = MARKERS.index('index')
    height = marker[0, i, 2] - points[0, LINKS.index('index_distal'), 2]
    assert height == pytest.approx(HAND.radii[0, 1] + LED_RADIUS)
    # The way grazes the capsule where its angle below the horizon has this sine.
    graze = np.arccos(HAND.radii[0, 1] / height)
    ends = [tuple(b) for b in SKELETON_BONES]
    only = np.array([ends.index(bone) for bone in ends
                     if LINKS.index('index_distal') in bone])
    radii = np.full(len(SKELETON_BONES), 1e-6)
    radii[only] = HAND.radii[0, 1]
    for angle, free in ((graze - .01, True), (graze + .01, False)):
        camera = marker[0, i] + (0., np.cos(angle), -np.sin(angle))
        seen = has_line_of_sight(rig_at(camera, camera + 1e-6), marker, points, radii)
        assert seen[0, i, 0] == free


@pytest.mark.parametrize('seed', range(3))
def test_obstruction_agrees_with_a_search_along_the_way(seed):
    random = np.random.RandomState(seed)
    lower, upper = HAND.limits.T
    markers, points = flat_hand(random.uniform(lower, upper))
    rig = CameraRig.ring(8, centre=(.05, 0., 0.))
    clear = has_line_of_sight(rig, markers, points, bone_radii(HAND))[0]
    ends = points[0][np.array(SKELETON_BONES)]
    for m in range(8):
        for c in range(8):
            gap = clear_by_search(rig.positions[c], markers[0, m], ends, bone_radii(HAND))
            if abs(gap) > 1e-4:
                assert clear[m, c] == (gap > 0.), (MARKERS[m], c, gap)


def test_a_fist_hides_what_an_open_hand_shows():
    fist = np.where(['pip' in joint or 'mcp_flexion' in joint for joint in JOINTS],
                    HAND.limits[:, 1], 0.)
    rig = CameraRig.ring(centre=(.05, 0., 0.))
    seen = [has_line_of_sight(rig, *flat_hand(angles), bone_radii(HAND))[0, 3:7].sum()
            for angles in (None, fist)]
    assert seen[1] < .6 * seen[0]


def test_field_of_view_has_edges():
    rig = rig_at((0., 0., 1.), (1., 0., 0.), field_of_view=np.radians(60.))
    edge = np.tan(np.radians(30.))
    places = np.array([[(0., 0., 0.), (edge - .001, 0., 0.), (edge + .001, 0., 0.),
                        (0., edge + .001, 0.), (0., 0., 1.5)]])
    np.testing.assert_array_equal(in_view(rig, places)[0, :, 0], (True, True, False, False, False))


def test_two_cameras_at_a_right_angle_have_the_textbook_covariance():
    """Each tells two axes with s = noise d / focal: s^2, s^2 and s^2 / 2 where both tell."""
    rig = rig_at((2., 0., 0.), (0., 2., 0.))
    sight = triangulate(rig, np.zeros((1, 1, 3)), np.ones((1, 1, 2), bool), np.zeros((1, 1, 2, 2)))
    s = rig.pixel_noise * 2. / rig.focal
    np.testing.assert_allclose(sight.covariance[0, 0], np.diag((s * s, s * s, s * s / 2.)),
                               atol=1e-12 * s * s + 1e-22)
    np.testing.assert_allclose(sight.positions, 0., atol=1e-15)


def test_noise_grows_with_distance_and_shrinks_with_cameras():
    def spread(rig):
        seen = np.ones((1, 1, len(rig.positions)), dtype=bool)
        sight = triangulate(rig, np.array([[RING_CENTRE]]), seen,
                            np.zeros((1, 1, len(rig.positions), 2)))
        return np.sqrt(np.trace(sight.covariance[0, 0]))

    near, far = (CameraRig.ring(8, radius=size, height=.5 * size) for size in (1., 2.))
    assert spread(far) == pytest.approx(2. * spread(near))
    spreads = [spread(CameraRig.ring(count)) for count in (2, 4, 8, 16)]
    assert spreads == sorted(spreads, reverse=True)
    assert spreads[3] == pytest.approx(spreads[2] / np.sqrt(2.))
    assert spread(CameraRig.ring(8, resolution=1800)) == pytest.approx(2. * spreads[2])


def test_a_narrow_base_is_worst_along_the_view():
    rig = rig_at((2., .2, 0.), (2., -.2, 0.))
    covariance = triangulate(rig, np.zeros((1, 1, 3)), np.ones((1, 1, 2), bool),
                             np.zeros((1, 1, 2, 2))).covariance[0, 0]
    values, axes = np.linalg.eigh(covariance)
    assert abs(axes[0, 2]) > .999
    assert values[2] / values[1] == pytest.approx(1. / np.tan(np.arctan(.1)) ** 2, rel=1e-6)


def test_measured_places_scatter_as_predicted():
    random = np.random.RandomState(3)
    rig = CameraRig.ring(3)
    n = 40000
    markers = np.broadcast_to(np.add(RING_CENTRE, (.1, -.05, .02)), (n, 1, 3))
    sight = triangulate(rig, markers, np.ones((n, 1, 3), bool),
                        random.standard_normal((n, 1, 3, 2)))
    errors = (sight.positions - markers)[:, 0]
    predicted = sight.covariance[0, 0]
    scale = np.sqrt(np.outer(predicted.diagonal(), predicted.diagonal()))
    # A covariance of n samples errs by 1 / sqrt(n) or so.
    np.testing.assert_allclose(np.cov(errors.T) / scale, predicted / scale, atol=5. / np.sqrt(n))
    np.testing.assert_allclose(errors.mean(axis=0) / np.sqrt(predicted.diagonal()), 0.,
                               atol=5. / np.sqrt(n))


def test_agrees_with_triangulation_of_the_noisy_pictures():
    """Gauss-Newton to the end on true projections: linearising costs next to nothing."""
    random = np.random.RandomState(0)
    rig = CameraRig.ring(4)
    truth = np.add(RING_CENTRE, (.1, .1, -.1))
    noise = random.standard_normal((1, 1, 4, 2))
    found = triangulate(rig, truth[None, None], np.ones((1, 1, 4), bool), noise).positions[0, 0]

    def pictures(place):
        local = np.einsum('cij,cj->ci', rig.rotations, place - rig.positions)
        return rig.focal * local[:, :2] / local[:, 2:]

    measured = pictures(truth) + rig.pixel_noise * noise[0, 0]
    place = truth.copy()
    for _ in range(10):
        steps = 1e-6 * np.eye(3)
        slope = np.array([(pictures(place + step) - pictures(place - step)).ravel() / 2e-6
                          for step in steps]).T
        miss = (measured - pictures(place)).ravel()
        place = place + np.linalg.lstsq(slope, miss, rcond=None)[0]
    np.testing.assert_allclose(found, place, atol=1e-3 * np.linalg.norm(place - truth))


def test_one_camera_places_nothing():
    rig = CameraRig.ring(4)
    seen = np.zeros((1, 3, 4), dtype=bool)
    seen[0, 1, :1] = seen[0, 2, :2] = True
    sight = triangulate(rig, np.full((1, 3, 3), RING_CENTRE), seen, np.zeros((1, 3, 4, 2)))
    np.testing.assert_array_equal(np.isfinite(sight.positions).all(axis=2)[0],
                                  (False, False, True))
    np.testing.assert_array_equal(np.isfinite(sight.covariance).all(axis=(2, 3))[0],
                                  (False, False, True))


def test_looking_is_the_same_again_and_the_same_in_parts():
    rig = CameraRig.ring(4)
    moves = (np.zeros((7, 25)), np.broadcast_to(np.eye(3), (7, 3, 3)),
             np.full((7, 3), RING_CENTRE),
             np.random.RandomState(5).standard_normal((7, 8, 4, 2)))

    def sight(*parts):
        return np.concatenate([observe(rig, HAND, LAYOUT, *(move[part] for move in moves)).positions
                               for part in parts])

    whole = sight(slice(None))
    np.testing.assert_array_equal(whole, sight(slice(None)))
    np.testing.assert_allclose(whole, sight(slice(0, 3), slice(3, 7)), rtol=0., atol=1e-15)


def test_a_left_hand_is_seen_as_its_mirror_image():
    rig, left = CameraRig.ring(8, centre=(0., 0., 0.)), HAND.mirrored()
    angles = .5 * HAND.limits[:, 1]
    clear = [has_line_of_sight(rig, *flat_hand(angles, hand), bone_radii(hand))[0]
             for hand in (HAND, left)]
    # Camera k of the ring mirrors to camera -k.
    np.testing.assert_array_equal(clear[0], clear[1][:, -np.arange(8)])


@pytest.mark.parametrize('fields, message', [
    ({'count': 1}, 'cameras: 1; allowed is 2 to 24'),
    ({'count': 25}, 'cameras: 25; allowed is 2 to 24'),
    ({'field_of_view': 4.}, 'field_of_view: 4.0'),
    ({'pixel_noise': -1.}, 'pixel_noise: -1.0'),
    ({'resolution': 0}, 'resolution: 0'),
    ({'radius': 0., 'height': 0.}, 'a camera stands where it looks')])
def test_refuses_impossible_rigs(fields, message):
    with pytest.raises(InvalidRig, match=message):
        CameraRig.ring(**fields)


def test_faults_come_at_their_rates_and_pick_every_marker():
    random = np.random.RandomState(1)
    faults = Faults(swaps=.5, ghosts=1., dropouts=2., frozen=.7)
    events = fault_events(faults, 1000., 8, random)
    for kind, rate in (('swap', .5), ('ghost', 1.), ('dropout', 2.), ('frozen', .7)):
        mine = [event for event in events if event.kind == kind]
        # Poisson: a standard deviation is the root of the number.
        assert abs(len(mine) - 1000. * rate) < 4. * np.sqrt(1000. * rate)
        assert {event.marker for event in mine} == set(range(8))
        assert all(event.end > event.start for event in mine)
    assert fault_events(Faults(), 1000., 8, random) == []
    assert fault_events(faults, 9., 8, np.random.RandomState(2)) == fault_events(
        faults, 9., 8, np.random.RandomState(2))
    with pytest.raises(InvalidFaults, match='ghosts: -1.*0 to 50'):
        fault_events(Faults(ghosts=-1.), 1., 8, random)


def test_faults_do_to_a_marker_what_they_say():
    times = np.arange(10) / 10.
    truth = np.array([(0., 0., 1.), (.02, 0., 1.), (.5, 0., 1.)]) + np.zeros((10, 1, 3))
    measured = truth + .001
    kept = measured.copy()

    def reported(kind, marker=0):
        return with_faults(measured, truth, times, [Event(kind, marker, .25, .55)])

    swapped = reported('swap')
    np.testing.assert_array_equal(swapped[3:6, [0, 1]], measured[3:6, [1, 0]])
    ghosts = reported('ghost')
    np.testing.assert_allclose(ghosts[3:6, 0],
                               np.add((0., 0., 2. * MIRROR_HEIGHT - 1.), np.full((3, 3), .001)))
    dropped = reported('dropout')
    assert np.isnan(dropped[3:6, 0]).all()
    for result in (swapped, ghosts, dropped):
        np.testing.assert_array_equal(result[[0, 1, 2, 6, 7, 8, 9]],
                                      measured[[0, 1, 2, 6, 7, 8, 9]])
        np.testing.assert_array_equal(result[:, 2], measured[:, 2])
    np.testing.assert_array_equal(measured, kept)


def test_a_frozen_marker_stays_where_it_was_also_in_the_next_part_of_a_recording():
    times = np.arange(10) / 10.
    truth = np.arange(90.).reshape(10, 3, 3)
    events, held = [Event('frozen', 1, .25, .75)], {}
    whole = with_faults(truth, truth, times, events)
    expected = truth.copy()
    expected[3:8, 1] = truth[3, 1]
    np.testing.assert_array_equal(whole, expected)
    np.testing.assert_array_equal(whole, np.concatenate([
        with_faults(truth[part], truth[part], times[part], events, held)
        for part in (slice(0, 5), slice(5, 10))]))
