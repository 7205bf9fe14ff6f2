"""The pictures of the README: made of what the tracker says, legible on any page."""

import numpy as np
import pytest
from PIL import Image

from docs import draw_pictures
from hand_tracker.core.model.hand import JOINTS, Hand
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.marker_layout import marker_positions
from hand_tracker.core.numerics.jit import COMPILED

NEEDS = 'skimage',


def test_markers_rest_on_the_skin():
    hand = Hand.scaled()
    rest = forward(joint_table(hand), np.zeros(len(JOINTS)))
    markers = marker_positions(draw_pictures.resting_layout(hand).mounting(hand), rest)
    skin = draw_pictures.skin_mesh(hand, rest).vertices
    gaps = np.linalg.norm(markers[:, None] - skin, axis=2).min(axis=1)
    assert (gaps > .4 * draw_pictures.DRAWN_BALL_RADIUS).all()
    assert (gaps < 1.4 * draw_pictures.DRAWN_BALL_RADIUS).all()


def test_hidden_markers_are_larger_and_of_another_colour():
    seen, hidden = draw_pictures.balls(np.zeros((2, 3)), [0, 1])
    assert np.ptp(hidden.vertices) > 1.2 * np.ptp(seen.vertices)
    assert not np.allclose(seen.colours, hidden.colours)


def test_the_motion_of_the_readme_is_smooth_and_small():
    path = draw_pictures.PICTURE_FOLDER / 'motion.gif'
    assert path.stat().st_size <= 3e6
    with Image.open(path) as image:
        assert image.info['loop'] == 0 and image.info['duration'] <= 50  # [ms]
        assert image.n_frames * image.info['duration'] > 20_000


@pytest.mark.skipif(not COMPILED, reason='takes minutes in plain Python')
def test_the_demo_ends_as_it_begins():
    _, states = draw_pictures.demo()
    steps = np.abs(np.diff([state.angles for state in states], axis=0)).max(axis=1)
    seam = np.abs(states[0].angles - states[-1].angles).max()
    assert seam < np.quantile(steps, .99)


def test_round_trips_are_drawn_where_they_are_on_the_axis(tmp_path, monkeypatch):
    monkeypatch.setattr(draw_pictures, 'PICTURE_FOLDER', tmp_path)
    centres = {'hand_tracker': .3, 'rclpy_echo': 1., 'c_echo': .1}  # [ms]
    spread = np.append(np.geomspace(.9, 1.1, 99), np.nan)
    np.savez(tmp_path / 'trips.npz', **{
        f'{node}_{draw_pictures.TRIP_RATE}_1': 1e3 * centre * spread
        for node, centre in centres.items()})
    draw_pictures.latency(tmp_path / 'trips.npz')
    with Image.open(tmp_path / 'latency.png') as image:
        pixels = np.asarray(image.convert('RGB')).astype(int)[:, 440:]
    means = {}
    for node, (_, _, colour) in draw_pictures.TRIP_NODES.items():
        off = np.abs(pixels - 255. * np.array(draw_pictures.rgb(colour))).max(axis=2)
        # Of the outline, not of its foot that runs along the whole axis.
        here = (off < 8.).sum(axis=0)
        means[node] = np.flatnonzero(here > 5).mean()
    decade = means['rclpy_echo'] - means['c_echo']
    assert decade > 400.
    assert means['hand_tracker'] - means['c_echo'] == pytest.approx(np.log10(3.) * decade, abs=9.)


@pytest.mark.skipif(not COMPILED, reason='takes minutes in plain Python')
def test_hero_is_a_whole_card_with_three_stages(tmp_path, monkeypatch):
    monkeypatch.setattr(draw_pictures, 'PICTURE_FOLDER', tmp_path)
    draw_pictures.hero()
    with Image.open(tmp_path / 'hero.png') as image:
        pixels = np.asarray(image.convert('RGBA')).astype(int)
    # Round corners, and no hole but them.
    assert pixels[0, 0, 3] == 0 and (pixels[..., 3] == 255).mean() > .995
    rows = pixels[34:590]
    drawn = np.abs(rows[..., :3] - pixels[300, 5, :3]).max(axis=2) > 8
    for stage in np.array_split(drawn, 3, axis=1):
        assert .02 < stage.mean() < .6
    # Nothing is cut off.
    assert not drawn[:, :20].any() and not drawn[:, -20:].any() and not drawn[:5].any()
