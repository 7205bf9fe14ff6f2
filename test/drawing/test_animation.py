"""Pictures: what is drawn is where the hand is."""

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from hand_tracker.core.model.hand import SIDES, Hand
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
from hand_tracker.drawing.images import save_gif, spread_rows


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


def test_images_are_spread_rows_and_none_is_shown_twice():
    assert spread_rows(24, 12).tolist() == list(range(1, 24, 2))
    assert spread_rows(5, 12).tolist() == [0, 1, 2, 3, 4]


def test_sheet_of_frames_that_are_mostly_missing_shows_each_instant_once(tmp_path, monkeypatch):
    shown = []
    monkeypatch.setattr(Figure, 'text', lambda self, x, y, text, **options: shown.append(text))
    motion = track(Hand.scaled())
    # All that was answered are six frames at the start, and seven at the end.
    rows = np.r_[:6, 17:24]
    few = HandMotion(*(values[rows] for values in motion))
    save_sheet(tmp_path / 'hand.png', few._replace(times=10. * few.times), Hand.scaled(), 'test')
    times = [text for text in shown if text.endswith(' s')]
    assert len(times) == len(set(times)) == 12
