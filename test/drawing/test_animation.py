"""Pictures: what is drawn is where the hand is, and the demo leaves what it promises."""

import csv
import os
import re
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

from benchmarks.repository import REPOSITORY
from hand_tracker.core.model.hand import JOINTS, SIDES, Hand
from hand_tracker.core.model.kinematics import forward, joint_table, tip_offsets
from hand_tracker.core.model.marker_layout import MarkerLayout, marker_positions
from hand_tracker.core.model.skeleton import (
    SKELETON_BONES,
    SKELETON_POINTS,
    bone_radii,
    skeleton_points,
)
from hand_tracker.drawing.animation import (
    ANIMATION_RATE,
    DIGIT_COLOURS,
    HIDDEN_COLOUR,
    HandMotion,
    save_animation,
    save_sheet,
)
from hand_tracker.drawing.images import save_gif
from hand_tracker.files.bags import write_bag
from hand_tracker.simulation.packaged_recordings import demo_recording, recording_messages


def track(hand, frames=24):
    """Return a hand that closes its fingers within a second, one marker hidden half the time."""
    bend = np.linspace(0., .8, frames)[:, None]
    angles = bend * hand.limits[:, 1]
    pose = forward(joint_table(hand), angles)
    markers = marker_positions(MarkerLayout().mounting(hand), pose)
    seen = np.ones(markers.shape[:2], dtype=bool)
    seen[frames // 2:, 4] = False
    return HandMotion(np.linspace(0., 1., frames),
                 skeleton_points(tip_offsets(hand), pose, np.zeros((frames, 3))), markers, seen)


def colours_of(image):
    pixels = np.asarray(image.convert('RGB')).reshape(-1, 3)
    return {tuple(pixel) for pixel in np.unique(pixels, axis=0).tolist()}


def rgb(colour):
    return tuple(int(colour[i:i + 2], 16) for i in (1, 3, 5))


def test_skeleton_has_the_bones_of_the_hand():
    hand = Hand.scaled()
    points = skeleton_points(
        tip_offsets(hand), forward(joint_table(hand), np.zeros(25)), np.zeros(3))
    lengths = {
        frozenset((SKELETON_POINTS[a], SKELETON_POINTS[b])): np.linalg.norm(points[a] - points[b])
        for a, b in SKELETON_BONES}
    assert lengths[frozenset(('ring_middle', 'ring_distal'))] == pytest.approx(
        hand.finger_bones[2, 1])
    assert lengths[frozenset(('thumb_distal', 'thumb_tip'))] == pytest.approx(hand.thumb_bones[2])
    assert min(lengths.values()) > .005
    radii = bone_radii(hand)
    assert radii.shape == (len(SKELETON_BONES),)
    tip = SKELETON_POINTS.index('little_distal'), SKELETON_POINTS.index('little_tip')
    assert radii[SKELETON_BONES.index(tip)] == \
        hand.radii[3, 2]


@pytest.mark.parametrize('side', SIDES)
def test_animation_moves_and_has_every_colour(side, tmp_path):
    hand = Hand.scaled(side=side)
    save_animation(tmp_path / 'hand.gif', track(hand), hand, 'test')
    with Image.open(tmp_path / 'hand.gif') as image:
        assert image.n_frames == round(ANIMATION_RATE)
        first = np.asarray(image.convert('RGB')).astype(int)
        image.seek(image.n_frames - 1)
        last = np.asarray(image.convert('RGB')).astype(int)
        seen = colours_of(image)
    changed = np.abs(last - first).max(axis=2) > 60
    half = changed.shape[1] // 2
    assert changed[:, :half].mean() > .02 and changed[:, half:].mean() > .02
    for colour in (*DIGIT_COLOURS, HIDDEN_COLOUR):
        assert min(np.abs(np.subtract(rgb(colour), pixel)).max() for pixel in seen) <= 6, colour


def test_small_changes_of_an_animation_are_not_drawn_unless_it_is_dark(tmp_path):
    size = 6, 4
    images = [Image.new('RGB', size, colour) for colour in (
        '#E0C0A0', '#D8B898', '#A08060', '#101010', '#181818')]
    save_gif(tmp_path / 'all.gif', images, 10., 16, (), 12)
    shown = []
    with Image.open(tmp_path / 'all.gif') as image:
        for frame in range(image.n_frames):
            image.seek(frame)
            # Frames that are alike become one that lasts.
            shown += [image.convert('RGB').getpixel((1, 1))] * (image.info['duration'] // 100)
    assert shown == [(0xE0, 0xC0, 0xA0)] * 2 + [(0xA0, 0x80, 0x60)] + [(0x10,) * 3, (0x18,) * 3]


def test_sheet_shows_poses_in_time(tmp_path):
    hand = Hand.scaled()
    save_sheet(tmp_path / 'hand.png', track(hand), hand, 'test')
    with Image.open(tmp_path / 'hand.png') as image:
        width, height = image.size
        drawn = np.asarray(image.convert('L')) < 240
    assert width > height > 500
    # Twelve poses: every cell of six columns and two rows has a hand in it.
    body = drawn[height // 12:]
    for rows in np.array_split(body, 2, axis=0):
        for cell in np.array_split(rows, 6, axis=1):
            assert cell.mean() > .05


def run_demo(*arguments):
    environment = {**os.environ, 'PYTHONPATH': os.pathsep.join(
        [str(REPOSITORY), os.environ.get('PYTHONPATH', '')])}
    return subprocess.run(
        [sys.executable, '-m', 'hand_tracker', 'demo', *map(str, arguments)],
        capture_output=True, text=True, timeout=240., env=environment)


@pytest.fixture
def ros():
    pytest.importorskip('rclpy', reason='needs ROS 2')
    from helpers import ros_process  # noqa: F401  sets a domain of its own


def test_demo_runs_its_nodes_and_leaves_pictures_and_a_table(ros, tmp_path):
    recording = demo_recording()
    short = recording._replace(stamps=recording.stamps[:120], markers=recording.markers[:120],
                               angles=recording.angles[:120])
    write_bag(tmp_path / 'short.mcap', recording_messages(short, 'right'))
    done = run_demo('--recording', tmp_path / 'short.mcap', '--output', tmp_path / 'out',
                    '--robot')
    assert done.returncode == 0, done.stdout + done.stderr
    # A busy machine may lose some frames.
    assert 0 < int(re.search(r'(\d+) frames of markers in', done.stdout).group(1)) <= 120
    for unit in ('Hz', 'latency p50', 'mm', 'markers seen 8 of 8'):
        assert unit in done.stdout
    with open(tmp_path / 'out' / 'angles.csv', newline='', encoding='utf-8') as file:
        header, *rows = csv.reader(file)
    assert header == ['time_s', *(f'right_{joint}_deg' for joint in JOINTS)]
    times, *angles = np.array(rows, dtype=float).T
    # A row has the markers of its frame too, which the listener may have lost.
    assert 0 < len(times) <= int(re.search(r'(\d+) joint states', done.stdout).group(1))
    since_last = 1e-9 * (short.stamps - short.stamps[-1])
    frames = np.searchsorted(since_last, times - times[-1] - .5 / 120.)
    # The recording's noise in an open hand: degrees at the PIP.
    assert np.abs(np.transpose(angles) - np.degrees(short.angles[frames])).mean() < 3.
    assert int(re.search(r'(\d+) commands', done.stdout).group(1)) > 0
    for name in ('hand.gif', 'hand.png', 'robot.gif', 'robot.png'):
        with Image.open(tmp_path / 'out' / name) as image:
            image.verify()


@pytest.mark.parametrize('arguments, message', [
    (('--recording', 'absent.mcap'), 'absent.mcap'),
    (('--recording', __file__), "that of no known format"),
    (('--hand', 'absent.yaml'), 'absent.yaml'),
    (('--robot', 'hal'), "robot: 'hal' is no file and no preset"),
    (('--robot', '--side', 'both'), 'a robot follows one hand')])
def test_demo_says_what_is_wrong_before_it_starts(ros, arguments, message, tmp_path):
    done = run_demo(*arguments, '--output', tmp_path)
    assert done.returncode == 1
    assert message in done.stderr and 'Starting' not in done.stdout
    assert 'Traceback' not in done.stderr
    assert not list(tmp_path.iterdir())
