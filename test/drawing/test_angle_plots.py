"""Plots: a page for each digit, and what is on it is what the tracker said."""

import re

import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from PIL import Image

from hand_tracker.cli.plot import main
from hand_tracker.core.model.hand import DIGITS, JOINTS, Hand, preset_limits
from hand_tracker.core.model.marker_layout import MARKERS
from hand_tracker.core.model.states import MarkerState
from hand_tracker.core.tracker import HandTracker
from hand_tracker.drawing import angle_plots
from hand_tracker.drawing.angle_plots import (
    PlotError,
    TrackedAngles,
    digit_page,
    save_pages,
    tracked_angles,
)
from hand_tracker.drawing.palette import MARKER_COLOURS
from hand_tracker.files.bags import bag_message, joint_state_message, write_bag
from hand_tracker.simulation.packaged_recordings import demo_recording, recording_messages

STEP = .01  # [s]
INDEX = MARKERS.index('index')


@pytest.fixture(scope='module')
def recording():
    whole = demo_recording()
    middle = slice(980, 1110)  # the index finger's marker drops out
    part = whole._replace(stamps=whole.stamps[middle], markers=whole.markers[middle],
                          angles=whole.angles[middle])
    assert np.isnan(part.markers[:, INDEX]).any()
    return part


@pytest.fixture
def made():
    """Return a second of made-up frames: one marker predicted, rejected, then stale."""
    random = np.random.default_rng(1)
    angles = random.uniform(-.2, 1., (100, 25))
    states = np.full((100, 8), MarkerState.SEEN)
    states[20:30, INDEX] = MarkerState.PREDICTED
    states[30:35, INDEX] = MarkerState.REJECTED
    states[70:, INDEX] = MarkerState.STALE
    residuals = np.where(states == MarkerState.SEEN, random.uniform(0., .002, (100, 8)), np.nan)
    return TrackedAngles(5. + STEP * np.arange(100), angles, states, residuals)


def curve(ax):
    """Return time and value of the curve of a panel."""
    line = max(ax.lines, key=lambda line: len(line.get_xdata()))
    return np.array(line.get_xdata()), np.array(line.get_ydata())


def bands(ax, state):
    """Return where a panel is shaded for a state, shape (n, 2) [s]."""
    colour = to_rgb(MARKER_COLOURS[state])
    return np.array([
        (path.vertices[:, 0].min(), path.vertices[:, 0].max())
        for found in ax.collections if isinstance(found, PolyCollection)
        and len(found.get_paths()) and np.allclose(found.get_facecolor()[0, :3], colour)
        for path in found.get_paths()]).reshape(-1, 2)


@pytest.mark.parametrize('digit', DIGITS)
def test_page_has_the_angles_limits_and_residuals_of_the_digit(made, digit):
    hand = Hand.scaled()
    _, *angles, residual = digit_page(made, hand, digit).axes
    still = 'thumb_mcp_abduction' if digit == 'thumb' else f'{digit}_cmc_flexion'
    joints = [joint for joint in JOINTS if joint.startswith(digit) and joint != still]
    assert len(angles) == len(joints)
    for ax, joint in zip(angles, joints):
        column = JOINTS.index(joint)
        times, values = curve(ax)
        np.testing.assert_allclose(times, made.times - 5.)
        np.testing.assert_allclose(values, np.degrees(made.angles[:, column]))
        levels = sorted(line.get_ydata()[0] for line in ax.lines if len(line.get_xdata()) == 2)
        np.testing.assert_allclose(levels, np.degrees(hand.limits[column]))
        lowest, highest = ax.get_ylim()
        assert lowest < levels[0] and levels[1] < highest
        assert ax.get_ylabel().split() == [
            joint.split('_')[1].upper(), joint.split('_')[2], '[°]']
    _, values = curve(residual)
    np.testing.assert_allclose(values, 1e3 * made.residuals[:, MARKERS.index(digit)])


def test_bands_are_where_the_marker_was_not_seen(made):
    strip, *panels = digit_page(made, Hand.scaled(), 'index').axes
    expected = {MarkerState.PREDICTED: [(.2, .3)], MarkerState.REJECTED: [(.3, .35)],
                MarkerState.STALE: [(.7, 1.)], MarkerState.SWAPPED: [], MarkerState.ABSENT: []}
    for ax in (strip, *panels):
        for state, where in expected.items():
            np.testing.assert_allclose(bands(ax, state), np.reshape(where, (-1, 2)), atol=1e-9)
    # The finger's own marker and the palm's three.
    np.testing.assert_allclose(bands(strip, MarkerState.SEEN), [
        (0., .2), (.35, .7), (0., 1.), (0., 1.), (0., 1.)], atol=1e-9)
    assert not bands(panels[0], MarkerState.SEEN).size


def test_nothing_is_drawn_where_frames_are_missing(made):
    kept = np.r_[:40, 60:100]
    cut = TrackedAngles(*(values[kept] for values in made))
    strip, panel, *_ = digit_page(cut, Hand.scaled(), 'index').axes
    times, values = curve(panel)
    assert np.isnan(times).sum() == np.isnan(values).sum() == 1
    assert times[np.flatnonzero(np.isnan(times)) - 1] == pytest.approx(.39)
    ends = bands(strip, MarkerState.SEEN)[:, 1]
    assert not ((ends > .39 + angle_plots.MAX_STEP_RATIO * STEP + 1e-9) & (ends < .6)).any()


def test_a_single_frame_and_a_clock_that_stands_are_drawn(made):
    for kept in (slice(1), slice(3)):
        still = TrackedAngles(*(values[kept] for values in made))._replace(
            times=np.ones(len(made.times[kept])))
        assert digit_page(still, Hand.scaled(), 'thumb').axes[0].get_xlim() == (0., 1.)


def test_output_is_a_document_a_picture_of_each_digit_or_a_folder(made, tmp_path):
    hand = Hand.scaled()
    assert save_pages(tmp_path / 'all.pdf', made, hand, 'test') == [tmp_path / 'all.pdf']
    pages = re.findall(rb'/Type /Page\b', (tmp_path / 'all.pdf').read_bytes())
    assert len(pages) == len(DIGITS)
    assert save_pages(tmp_path / 'hand.png', made, hand) == [
        tmp_path / f'hand_{digit}.png' for digit in DIGITS]
    names = save_pages(tmp_path / 'new' / 'folder', made, hand)
    assert names == [tmp_path / 'new' / 'folder' / f'{digit}.png' for digit in DIGITS]
    for name in names:
        with Image.open(name) as image:
            image.verify()
    assert len(list(tmp_path.iterdir())) == 7
    assert save_pages(tmp_path / 'ALL.PDF', made, hand) == [tmp_path / 'ALL.PDF']


def test_command_plots_what_the_tracker_says_of_the_arrays(
        recording, tmp_path, monkeypatch, capsys):
    write_bag(tmp_path / 'in.mcap', recording_messages(recording, 'right'))
    drawn = []

    def note(path, tracked, hand, title, layout):
        drawn.append((tracked, hand, title))
        return save_pages(path, tracked, hand, title, layout)

    monkeypatch.setattr(angle_plots, 'save_pages', note)
    monkeypatch.chdir(tmp_path)
    assert main(['in.mcap', '--limits', 'wide']) == 0
    assert f'in.pdf: {len(recording.stamps)} of' in capsys.readouterr().out
    assert (tmp_path / 'in.pdf').stat().st_size
    (tracked, hand, title), = drawn
    assert title == 'in.mcap, right hand'
    assert np.array_equal(hand.limits, preset_limits('wide'))
    tracker = HandTracker(Hand.scaled().replace(limits=preset_limits('wide')))
    seconds = 1e-9 * recording.stamps
    expected = tracked_angles((time, tracker.update(markers, time))
                       for time, markers in zip(seconds, recording.markers))
    np.testing.assert_allclose(tracked.times - tracked.times[0], seconds - seconds[0], atol=1e-6)
    np.testing.assert_allclose(tracked.angles, expected.angles, atol=1e-4)
    np.testing.assert_array_equal(tracked.marker_states, expected.marker_states)
    np.testing.assert_allclose(tracked.residuals, expected.residuals, atol=1e-6)


def test_history_refuses_what_has_no_time_axis(recording):
    with pytest.raises(PlotError, match='no frames'):
        tracked_angles(())
    state = HandTracker().update(recording.markers[0])
    with pytest.raises(PlotError, match='frame 2 is before frame 1'):
        tracked_angles(((1., state), (2., state), (1.5, state)))


@pytest.mark.parametrize('arguments, said', [
    (('absent.mcap',), 'absent.mcap: no such file or folder'),
    (('angles.mcap',), 'no topic of visualization_msgs/msg/MarkerArray or .*; it has /j'),
    (('angles.mcap', '-o', 'out.svg'), "unknown extension '.svg'; expected .pdf, .png or a fold"),
    (('angles.mcap', '-o', 'absent/out.pdf'), 'no folder absent'),
    (('angles.mcap', '-o', 'folder.pdf'), 'folder.pdf: is a folder'),
    (('angles.mcap', '-o', 'file'), 'file: is no folder'),
    (('angles.mcap', '--hand', 'absent.yaml'), 'absent.yaml: No such file')])
def test_says_what_is_wrong_and_writes_nothing(arguments, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_bag(tmp_path / 'angles.mcap', [
        bag_message('/joint_states', 1, joint_state_message(1, ['a'], [0.]))])
    (tmp_path / 'folder.pdf').mkdir()
    (tmp_path / 'file').touch()
    before = sorted(tmp_path.rglob('*'))
    assert main(list(arguments)) == 1
    assert re.search(said, capsys.readouterr().err)
    assert sorted(tmp_path.rglob('*')) == before


def test_truth_is_drawn_beside(made):
    truth = made.angles + .1
    _, panel, *_ = digit_page(made, Hand.scaled(), 'index', truth=truth).axes
    curves = [line.get_ydata() for line in panel.lines if len(line.get_xdata()) == 100]
    column = JOINTS.index('index_mcp_abduction')
    np.testing.assert_allclose(curves, np.degrees([truth[:, column], made.angles[:, column]]))
