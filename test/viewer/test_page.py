"""The viewer without a browser: its sources, meshes and panel."""

import asyncio
import itertools
import socket
import urllib.request
from concurrent.futures import ThreadPoolExecutor
from threading import Event

import numpy as np
import pytest

from hand_tracker.cli import inspect, view
from hand_tracker.cli.demo_anonymous import take_labels_off
from hand_tracker.cli.recording_options import WornHand
from hand_tracker.core.constraints import CONSTRAINTS, DEFAULT_CONSTRAINTS, constrained, describe
from hand_tracker.core.errors import HandTrackerError
from hand_tracker.core.model.hand import JOINTS, SIDES, Hand
from hand_tracker.core.model.kinematics import forward, joint_table, tip_offsets
from hand_tracker.core.model.marker_layout import MarkerLayout
from hand_tracker.core.model.skeleton import (
    DIGIT_CHAINS,
    DIGIT_TIPS,
    SKELETON_POINTS,
    skeleton_points,
)
from hand_tracker.core.options import TrackerOptions
from hand_tracker.core.tracker import HandTracker
from hand_tracker.files.bags import bag_message, marker_array_message, open_bag, write_bag
from hand_tracker.files.recordings import read_recording, write_recording
from hand_tracker.messages.labels import DEFAULT_LABELS, LabelMap, label_maps
from hand_tracker.package_data import packaged_recording
from hand_tracker.tracking.recording import USUAL_READING, MarkerReading, track
from hand_tracker.viewer.angle_bars import angle_bars
from hand_tracker.viewer.coverage_bars import coverage_bars
from hand_tracker.viewer.page import LOCALHOST, ShownHand, Viewer, free_port
from hand_tracker.viewer.panel import Panel
from hand_tracker.viewer.recording_source import LEAD_IN, Playhead, viewed_hands
from hand_tracker.viewer.scene import (
    MAX_ANCHOR_DISTANCE,
    HandScene,
    anchor_near,
    strongest_weights,
    wrist_pose,
)

DIP = JOINTS.index('index_dip_flexion')


def mean_hand_of(path):
    """Return the mean right hand of a recording for the viewer."""
    return viewed_hands(path, [(Hand.scaled(), MarkerLayout(), USUAL_READING)])


@pytest.fixture(scope='module')
def recording():
    recording = mean_hand_of(packaged_recording())
    recording.prepare(print)
    recording.playhead.toggle()
    return recording


@pytest.mark.parametrize('name', CONSTRAINTS)
def test_each_constraint_changes_hand_or_options(name):
    before = constrained(Hand.scaled(), TrackerOptions(), DEFAULT_CONSTRAINTS)
    hand, options = constrained(Hand.scaled(), TrackerOptions(), DEFAULT_CONSTRAINTS ^ {name})
    assert options != before[1] or not (np.array_equal(hand.limits, before[0].limits)
                                        and np.array_equal(hand.coupling, before[0].coupling))


def test_the_default_constraints_are_the_default_tracker():
    hand = Hand.scaled()
    assert constrained(hand, TrackerOptions(), DEFAULT_CONSTRAINTS) == (hand, TrackerOptions())


def test_a_switched_recording_stays_at_its_place(recording):
    recording.playhead.seek(2.)
    bent = recording.state()
    recording.constrain(DEFAULT_CONSTRAINTS - {'DIP coupling'})
    straight = recording.state()
    recording.constrain(DEFAULT_CONSTRAINTS)
    assert bent.angles[DIP] > .1
    assert straight.angles[DIP] == 0.
    assert np.array_equal(recording.state().angles, bent.angles)
    np.testing.assert_allclose(straight.wrist_position, bent.wrist_position, atol=1e-12)


def test_without_any_constraint_limits_are_passed(recording):
    lower, upper = recording.hand.limits.T
    passed = []
    for second in np.arange(0., recording.playhead.duration, .1):
        recording.playhead.seek(second)
        assert (lower <= recording.state().angles).all()
        assert (recording.state().angles <= upper).all()
        angles = recording.bare_state().angles
        passed.append((angles < lower - 1e-3) | (angles > upper + 1e-3))
    assert np.any(passed)


def test_numbers_are_those_of_the_recording(recording):
    recording.playhead.seek(1.)
    numbers = recording.numbers(recording.state())
    assert numbers['rate'] == '120 Hz'
    assert 0. < float(numbers['residual'].split()[0]) < 5.


def test_the_tracking_time_is_the_median_of_the_shown_constraints(monkeypatch):
    recording = mean_hand_of(packaged_recording())
    recording.prepare(print)
    recording.playhead.toggle()
    recording.playhead.seek(1.)
    # Each update takes 30 µs, and the very first a second: it compiled the kernels.
    clock = itertools.accumulate(itertools.chain([0., 1.], itertools.repeat(30e-6)))
    monkeypatch.setattr(
        'hand_tracker.viewer.recording_source.time.perf_counter', lambda: next(clock))
    assert recording.numbers(recording.state())['tracking time'] == '30 µs'
    clock = itertools.accumulate(itertools.repeat(70e-6))
    recording.bare_state()
    assert recording.numbers(recording.state())['tracking time'] == '30 µs'
    recording.constrain(())
    assert recording.numbers(recording.state())['tracking time'] == '70 µs'


def test_what_plays_is_what_is_tracked_from_the_start(recording):
    hand, layout = Hand.scaled(), MarkerLayout()
    with open_bag(packaged_recording()) as bag:
        frames = list(track(bag.messages(['/markers']), HandTracker(hand, layout)))
    start = frames[0].time
    for second in np.arange(0., recording.playhead.duration, .5):
        recording.playhead.seek(second)
        before = [frame for frame in frames if frame.time <= start + round(1e9 * second)]
        assert np.array_equal(recording.state().angles, before[-1].state.angles), second


def test_a_leap_tracks_no_more_than_the_warm_up(recording, monkeypatch):
    updates = []
    update = HandTracker.update
    monkeypatch.setattr(HandTracker, 'update', lambda self, *args: (
        updates.append(args), update(self, *args))[1])
    recording.playhead.seek(20.)
    recording.constrain(DEFAULT_CONSTRAINTS - {'Inertia'})
    recording.state()
    assert len(updates) == pytest.approx(120. * LEAD_IN, abs=3.)
    updates.clear()
    recording.playhead.seek(21.)
    recording.state()
    assert len(updates) == pytest.approx(120., abs=2.)
    updates.clear()
    recording.playhead.seek(0.)
    recording.state()
    assert len(updates) <= 2
    recording.constrain(DEFAULT_CONSTRAINTS)


def test_a_playhead_runs_stops_and_begins_again(monkeypatch):
    now = [10.]
    monkeypatch.setattr('hand_tracker.viewer.recording_source.time.monotonic', lambda: now[0])
    head = Playhead(4.)
    now[0] += 1.5
    assert head.now() == 1.5
    head.set_rate(.5)
    now[0] += 1.
    assert head.now() == 2.
    head.toggle()
    now[0] += 9.
    assert head.now() == 2.
    head.toggle()
    now[0] += 5.
    assert head.now() == .5
    head.seek(3.)
    assert head.now() == 3.


def test_a_recording_without_a_palm_is_refused(tmp_path):
    positions = np.full((8, 3), np.nan)
    positions[3:] = .1
    path = tmp_path / 'palmless.mcap'
    write_bag(path, (bag_message('/markers', second * 10**9, marker_array_message(
        second * 10**9, 'mocap', DEFAULT_LABELS, positions)) for second in range(3)))
    with pytest.raises(HandTrackerError, match='nothing to show'):
        mean_hand_of(path).prepare(print)
    with pytest.raises(HandTrackerError, match='no such file'):
        mean_hand_of(tmp_path / 'none.mcap')


@pytest.mark.parametrize('side', ['right', 'left'])
def test_the_mesh_of_the_skeleton_follows_the_links(side):
    pytest.importorskip('trimesh', reason='trimesh is not installed')
    from hand_tracker.skin import deform
    from hand_tracker.viewer.skeleton_mesh import JOINT_RADIUS, skeleton_mesh

    hand = Hand.scaled(side=side)
    lower, upper = hand.limits.T
    pose = forward(joint_table(hand), lower + .8 * (upper - lower))
    mesh = skeleton_mesh(hand)
    vertices = deform(mesh, pose)
    points = skeleton_points(tip_offsets(hand), pose, np.zeros(3))
    for name, point in zip(SKELETON_POINTS, points):
        nearest = np.linalg.norm(vertices - point, axis=1).min()
        assert name in DIGIT_TIPS or nearest < 1.01 * JOINT_RADIUS, name
    # The last bones end within the flesh.
    for chain, radii in zip(DIGIT_CHAINS, hand.radii):
        last, tip = points[chain[-2]], points[chain[-1]]
        bone = vertices[mesh.weights[:, mesh.links.index(chain[-2])] == 1.]
        beyond = (bone - tip) @ (tip - last) / np.linalg.norm(tip - last)
        assert -radii[-1] < beyond.max() < -.5 * radii[-1]


def test_the_strongest_weights_are_few_and_sum_to_one():
    weights = np.random.RandomState(1).dirichlet(np.ones(19), 50)
    kept = strongest_weights(weights)
    assert ((kept > 0.).sum(axis=1) == 4).all()
    np.testing.assert_allclose(kept.sum(axis=1), 1.)
    assert (kept.argmax(axis=1) == weights.argmax(axis=1)).all()


def test_a_hand_that_roams_stays_in_view(recording):
    recording.playhead.seek(1.)
    state = recording.state()
    anchor = wrist_pose(state)
    near, far = (state._replace(wrist_position=anchor.position + (off, 0., 0.))
                 for off in (.9 * MAX_ANCHOR_DISTANCE, 3. * MAX_ANCHOR_DISTANCE))
    np.testing.assert_array_equal(anchor_near(anchor, near).position, anchor.position)
    moved = anchor_near(anchor, far)
    np.testing.assert_allclose(moved.position, anchor.position + (2. * MAX_ANCHOR_DISTANCE, 0., 0.))
    assert moved.rotation is anchor.rotation


def test_a_switch_is_not_taken_back_by_what_is_reported_meanwhile(recording, monkeypatch):
    messages = pytest.importorskip('viser._messages', reason='viser is not installed')
    viewer = Viewer(port=8390)
    server, busy, idle = viewer._server, ThreadPoolExecutor(1), Event()
    try:
        panel = Panel(server, recording, has_skin=False)
        switch = panel._switches['Rigidity']
        # A person clicks while viser's other threads are busy.
        busy.submit(idle.wait)
        monkeypatch.setattr(server.gui, '_thread_executor', busy)
        monkeypatch.setattr(server.gui, '_resolve_client', lambda _: server)
        recording.playhead.seek(1.)
        state = recording.state()

        async def click():
            await server.gui._handle_gui_updates(
                0, messages.GuiUpdateMessage(switch._impl.uuid, {'value': False}))
            panel.refresh(state)

        asyncio.run_coroutine_threadsafe(click(), server.get_event_loop()).result()
        idle.set()
        busy.shutdown()
        assert not switch.value
        assert recording.constraints == DEFAULT_CONSTRAINTS - {'Rigidity'}
    finally:
        idle.set()
        recording.constrain(DEFAULT_CONSTRAINTS)
        viewer.stop()


def test_bars_tell_angles_and_which_are_at_a_limit():
    hand = Hand.scaled()
    angles = np.zeros(25)
    angles[DIP] = hand.limits[DIP, 1]
    page = angle_bars(angles, hand.limits)
    assert page.count('class="at"') == 1
    assert f'{np.degrees(hand.limits[DIP, 1]):.0f}°' in page
    assert page.count('<div') == 25
    low, high = np.degrees(hand.limits[DIP])
    assert f'<s>{low:.0f}</s>' in page and f'<s>{high:.0f}</s>' in page


def test_bars_tell_what_a_calibration_has_seen():
    page = coverage_bars('make a <fist>', {'open hand': 1., 'fist': .25})
    assert 'make a &lt;fist&gt;' in page
    assert 'class=all><span>open hand' in page and 'width:25%' in page
    assert page.count('class=all') == 1


def test_the_constraints_that_are_off_are_described():
    assert describe(DEFAULT_CONSTRAINTS) == 'with constraints'
    assert describe(DEFAULT_CONSTRAINTS - {'Rigidity'}) == 'without Rigidity'
    assert describe(DEFAULT_CONSTRAINTS - {'Rigidity', 'Inertia'}) == 'without Rigidity and Inertia'
    assert describe({'Rigidity'}) == f'with 1 of {len(CONSTRAINTS)} constraints'
    assert describe(()) == 'without any constraint'


def test_another_hand_takes_the_place_of_the_first(recording, monkeypatch):
    pytest.importorskip('viser', reason='viser is not installed')
    first, other = recording.hand, Hand.scaled(.2)
    drawn, removed = [], []

    class Counted(HandScene):
        def __init__(self, scene, name, hand, skin):
            super().__init__(scene, name, hand, skin)
            drawn.append((name, hand))

        def remove(self):
            removed.append(self)
            super().remove()

    def running():
        monkeypatch.setattr(recording, 'hand', other)
        return len(drawn) < 4

    monkeypatch.setattr('hand_tracker.viewer.page.HandScene', Counted)
    viewer = Viewer(port=8390)
    try:
        viewer.show(recording, lambda hand: None, running)
    finally:
        viewer.stop()
    assert drawn == [('/hand', first), ('/hand_bare', first), ('/hand', other),
                     ('/hand_bare', other)]
    assert len(removed) == 2


def test_both_hands_of_a_recording_play_together():
    path, layout = packaged_recording('both'), MarkerLayout()
    labels = label_maps(DEFAULT_LABELS, {side: f'{side}/0' for side in SIDES})
    both = viewed_hands(path, [
        (Hand.scaled(side=side), layout, MarkerReading(labels[side])) for side in SIDES])
    left = both.beside
    both.prepare(print)
    both.playhead.toggle()
    both.playhead.seek(1.)
    assert left.playhead is both.playhead
    right_state, left_state = both.state(), left.state()
    assert left_state.wrist_position[1] - right_state.wrist_position[1] == pytest.approx(
        .4, abs=.02)
    both.constrain(DEFAULT_CONSTRAINTS - {'Rigidity'})
    assert left.constraints == both.constraints
    pytest.importorskip('viser', reason='viser is not installed')
    drawn = []

    class Placed(HandScene):
        def draw(self, state, anchor, offset=0.):
            super().draw(state, anchor, offset)
            drawn.append((self._name, offset, len(self._markers)))

    viewer = Viewer(port=8390)
    try:
        hands = [ShownHand(viewer._server.scene, name, one, lambda hand: None)
                 for name, one in (('/hand', both), ('/other_hand', left))]
        for one, place in zip(hands, (-.09, .09)):
            one.follow(looked_at=True, compared=False)
            one._shown.__class__ = Placed
            one.draw(Panel(viewer._server, both, False), place, False)
    finally:
        viewer.stop()
    assert drawn == [('/hand', -.09, 8), ('/other_hand', .09, 8)]


def test_points_without_labels_show_the_hands_that_markers_show(tmp_path):
    path, layout, sources = packaged_recording('both'), MarkerLayout(), []
    labels = label_maps(DEFAULT_LABELS, {side: f'{side}/0' for side in SIDES})
    hands = [WornHand(Hand.scaled(side=side), layout, labels[side]) for side in SIDES]
    with open_bag(path) as bag:
        take_labels_off(bag, '/markers', hands, tmp_path / 'points.mcap')
    for recording, readings in (
            (path, labels), (tmp_path / 'points.mcap', dict.fromkeys(SIDES, LabelMap()))):
        one = viewed_hands(recording, [(worn.hand, layout, MarkerReading(
            readings[worn.hand.side], has_labels=recording == path)) for worn in hands])
        one.prepare(print)
        one.playhead.toggle()
        one.playhead.seek(.2)
        sources.append(one)
    labelled, found = sources
    for shown, expected in ((found, labelled), (found.beside, labelled.beside)):
        np.testing.assert_allclose(
            shown.state().wrist_position, expected.state().wrist_position, atol=.003)


def test_the_page_takes_points_without_labels_or_names_the_option(tmp_path, capsys):
    recording = read_recording(packaged_recording())
    without = recording._replace(
        labels=('',) * len(recording.labels), points=recording.points[:40],
        stamps=None)
    write_recording(tmp_path / 'points.npz', without)
    source = view._source(view._parse([str(tmp_path / 'points.npz'), '--side', 'right']))
    source.prepare(print)
    assert source.hand.side == 'right' and source.state() is not None
    write_recording(tmp_path / 'named.npz', without._replace(labels=tuple('abcdefgh')))
    with pytest.raises(HandTrackerError, match='--labels none'):
        view._source(view._parse([str(tmp_path / 'named.npz')]))
    with open_bag(packaged_recording()) as bag:
        take_labels_off(bag, '/markers', [WornHand(
            Hand.scaled(), MarkerLayout(), LabelMap())], tmp_path / 'points.mcap')
    options = [str(tmp_path / 'points.mcap')]
    view._source(view._parse(options))
    assert 'in only 9 % of the frames; if they are of no use, --labels none' in (
        capsys.readouterr().err)
    view._source(view._parse([*options, '--labels', 'none'])).prepare(print)
    # As the page says, so does what names the next command.
    assert inspect.main(options) == 0
    assert capsys.readouterr().out.endswith(' --labels none\n')
    assert inspect.main([str(packaged_recording())]) == 0
    assert '--labels' not in capsys.readouterr().out


def test_the_addresses_lead_to_the_page():
    pytest.importorskip('viser', reason='viser is not installed')
    viewer = Viewer('0.0.0.0', 8390)
    try:
        here, *elsewhere = viewer.addresses
        assert here.startswith('http://localhost:')
        for address in viewer.addresses:
            assert b'<html' in urllib.request.urlopen(address, timeout=240.).read(200)
        assert len(elsewhere) <= 1
    finally:
        viewer.stop()


def test_a_taken_port_is_passed_over_and_a_foreign_host_refused():
    with socket.create_server((LOCALHOST, 0)) as taken:
        port = taken.getsockname()[1]
        assert free_port(LOCALHOST, port) > port
    with pytest.raises(HandTrackerError, match='--host 192.0.2.1'):
        free_port('192.0.2.1', 8080)
