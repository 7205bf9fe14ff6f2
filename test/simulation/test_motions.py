"""Every named motion is what a hand can do, smooth, and the same again for its seed."""

import numpy as np
import pytest

from hand_tracker.core.model.hand import FINGERS, JOINTS, Hand, preset_limits
from hand_tracker.simulation.gestures import GRASPS, LETTER_SHAPES, grasp_shape, shape_angles
from hand_tracker.simulation.layers import ENSLAVING, Strokes, Tremor, finger_stroke
from hand_tracker.simulation.motion import demo_motion
from hand_tracker.simulation.motion_names import MOTION_NAMES
from hand_tracker.simulation.motions import (
    DURATION_RANGE,
    MOTIONS,
    TREMOR_RATE,
    UnknownMotion,
    motion_named,
)

HAND = Hand.scaled()
HANDS = {'mean': HAND, 'small left': Hand.scaled(.16, .07, side='left'),
         'wide': HAND.replace(limits=preset_limits('wide'))}
RATE = 960.  # [Hz]
MCP = [JOINTS.index(f'{finger}_mcp_flexion') for finger in FINGERS]
LOWER, UPPER = preset_limits('paper').T


def sampled(name, seed=1, hand=HAND, duration=6., rate=RATE):
    motion = motion_named(name, hand, seed, duration)
    return motion.sample(np.arange(0., motion.duration, 1. / rate))


@pytest.mark.parametrize('hand', HANDS.values(), ids=HANDS)
@pytest.mark.parametrize('name', MOTIONS)
def test_angles_are_within_table_1_at_every_sample(name, hand):
    for seed in range(3):
        angles, rotation, position = sampled(name, seed, hand)
        assert (angles >= LOWER).all() and (angles <= UPPER).all()
        assert np.isfinite(position).all()
        np.testing.assert_allclose(
            rotation @ rotation.swapaxes(1, 2), np.broadcast_to(np.eye(3), rotation.shape),
            atol=1e-12)


@pytest.mark.parametrize('name', MOTIONS)
def test_dip_follows_pip_and_the_thumbs_ip_its_mcp(name):
    angles, _, _ = sampled(name)
    for digit, (leader, follower) in enumerate(
            [(f'{finger}_pip_flexion', f'{finger}_dip_flexion') for finger in FINGERS]
            + [('thumb_mcp_flexion', 'thumb_ip_flexion')]):
        slope, offset = HAND.coupling[digit]
        np.testing.assert_allclose(angles[:, JOINTS.index(follower)],
                                   slope * angles[:, JOINTS.index(leader)] + offset, atol=1e-12)


@pytest.mark.parametrize('name', MOTIONS)
def test_neighbours_hold_each_other_back(name):
    """The bounds on neighbouring MCPs: 60, 45 and 45 degrees."""
    apart = np.abs(np.diff(np.degrees(sampled(name)[0][:, MCP]), axis=1))
    assert (apart.max(axis=0) <= (60., 45., 45.)).all()


@pytest.mark.parametrize('name', MOTIONS)
def test_is_smooth_and_no_faster_than_fingers_are(name):
    """No step of angle or speed: acceleration is bounded however finely it is sampled."""
    for seed in range(3):
        angles, _, position = sampled(name, seed)
        assert np.degrees(np.abs(np.diff(angles, axis=0))).max() * RATE < 1200.
        # 28 degrees in 55 ms are 53 000 degrees / s^2; strokes may add up.
        assert np.degrees(np.abs(np.diff(angles, 2, axis=0))).max() * RATE ** 2 < 1.2e5
        assert np.linalg.norm(np.diff(position, 2, axis=0), axis=1).max() * RATE ** 2 < 120.


@pytest.mark.parametrize('name', MOTIONS)
def test_the_seed_decides(name):
    for one, same in zip(sampled(name, 4), sampled(name, 4)):
        np.testing.assert_array_equal(one, same)
    if name != 'demo':
        times = np.arange(0., 5., .01)
        one, other = (motion_named(name, HAND, seed).sample(times)[2] for seed in (1, 2))
        assert np.abs(one - other).max() > 1e-4


@pytest.mark.parametrize('name', MOTIONS)
def test_samples_do_not_depend_on_the_rate(name):
    for coarse, fine in zip(sampled(name, rate=30.), sampled(name, rate=960.)):
        np.testing.assert_allclose(coarse, fine[::32], atol=1e-9)


@pytest.mark.parametrize('name', [
    name for name in MOTIONS if name not in ('demo', 'range_of_motion')])
def test_lasts_as_long_as_asked(name):
    assert 30. <= motion_named(name, HAND, 1, 30.).duration < 34.


def test_the_demo_is_that_of_the_packaged_recording():
    times = np.linspace(0., 20., 50)
    for a, b in zip(motion_named('demo', HAND).sample(times), demo_motion(HAND).sample(times)):
        np.testing.assert_array_equal(a, b)


def test_strikes_one_finger_at_a_time_with_its_neighbours_going_along():
    change = finger_stroke(2, .4, .2)
    np.testing.assert_allclose(change[MCP], .4 * ENSLAVING[2, :4])
    assert change[MCP].argmax() == 2
    strokes = Strokes(*np.array([[1.], [.1], [.1], [.2]]), change[None])
    added = strokes.sample(np.array([.9, 1., 1.05, 1.1, 1.15, 1.2, 1.3, 1.4, 2.]))[:, MCP[2]]
    np.testing.assert_allclose(added, np.multiply(.4, (0., 0., .5, 1., 1., 1., .5, 0., 0.)),
                               atol=1e-12)
    assert Strokes.none().sample(np.zeros(3)).shape == Tremor.none().sample(np.zeros(3)).shape


def test_piano_and_typing_use_every_digit():
    for name in ('piano', 'typing'):
        angles, _, _ = sampled(name, duration=20.)
        spans = np.degrees(np.ptp(angles[:, MCP + [JOINTS.index('thumb_mcp_flexion')]], axis=0))
        assert (spans > 5.).all()


def test_tremor_is_at_four_to_six_hertz_and_small():
    angles, _, position = sampled('tremor', duration=20., rate=120.)
    flexion = angles[:, MCP[0]] - angles[:, MCP[0]].mean()
    power = np.abs(np.fft.rfft(flexion)) ** 2
    frequency = np.fft.rfftfreq(len(flexion), 1. / 120.)
    band = (frequency > TREMOR_RATE[0] - .2) & (frequency < TREMOR_RATE[1] + .2)
    assert power[band].sum() > .95 * power.sum()
    assert 2. < np.degrees(np.ptp(flexion)) < 8.
    assert np.ptp(position, axis=0).max() < .02


def test_shaking_is_fast():
    _, rotation, position = sampled('shaking', duration=10.)
    assert .4 < np.linalg.norm(np.diff(position, axis=0), axis=1).max() * RATE < 3.
    turned = np.einsum('nij,nij->n', rotation[1:], rotation[:-1])
    assert np.degrees(np.arccos(np.clip((turned - 1.) / 2., -1., 1.))).max() * RATE > 200.


def test_shapes_keep_the_bounds_between_neighbours_and_differ():
    shapes = [*LETTER_SHAPES.values(),
              *(grasp_shape(kind, size) for kind in GRASPS for size in (0., 1.))]
    angles = np.degrees([shape_angles(shape, HAND) for shape in shapes])
    assert (np.abs(np.diff(angles[:, MCP], axis=1)) <= (60., 45., 45.)).all()
    apart = np.abs(angles[:, None] - angles).max(axis=2) + 99. * np.eye(len(angles))
    assert apart.min() > 5.


def test_grasps_of_large_objects_are_wider():
    for kind in GRASPS:
        small, large = (shape_angles(grasp_shape(kind, size), HAND) for size in (0., 1.))
        assert (large[MCP] < small[MCP]).all()


def test_says_what_there_is():
    with pytest.raises(UnknownMotion, match='clapping.*spelling'):
        motion_named('clapping', HAND)
    with pytest.raises(UnknownMotion, match=f'duration: 0 s.*{DURATION_RANGE[1]:g}'):
        motion_named('piano', HAND, duration=0.)


def test_options_list_every_motion():
    assert MOTION_NAMES == tuple(MOTIONS)
