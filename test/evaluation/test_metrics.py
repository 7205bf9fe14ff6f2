"""Metrics against cases worked out by hand, and against an independent library."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hand_tracker.calibration import LANDMARKS
from hand_tracker.evaluation import metrics


def test_distance_of_two_joints_turned_by_60_and_120_degrees():
    still, turned = np.zeros(25), np.zeros(25)
    turned[[3, 20]] = np.radians((60., -240.))
    found = metrics.angle_distance(still, turned)
    assert found.squared == pytest.approx((np.pi / 6.) ** 2 + (np.pi / 3.) ** 2)
    assert found.distance == pytest.approx(np.sqrt(found.squared))
    assert found.degrees == pytest.approx(180. / 25.)


def test_angles_of_hinges_have_the_distance_of_their_quaternions():
    random = np.random.default_rng(1)
    first, second = random.uniform(-3., 3., (2, 7, 25))
    axes = random.normal(size=(25, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)

    def quaternions(angles):
        return np.concatenate((np.cos(angles / 2.)[..., None],
                               np.sin(angles / 2.)[..., None] * axes), axis=-1)

    # ‖log(q1⁻¹ q2)‖; q and −q are the same rotation.
    halves = np.arccos(np.abs((quaternions(first) * quaternions(second)).sum(axis=-1)))
    found = metrics.angle_distance(first, second)
    np.testing.assert_allclose(found.squared, (halves ** 2).sum(axis=-1), atol=1e-9)
    np.testing.assert_allclose(found.distance, np.sqrt((halves ** 2).sum(axis=-1)), atol=1e-9)
    np.testing.assert_allclose(found.degrees, np.degrees(2. * halves.mean(axis=-1)), atol=1e-9)


def test_small_angles_keep_their_digits():
    assert metrics.angle_distance([0.], [2e-9]).distance == pytest.approx(1e-9)


def test_rotation_angles_are_those_of_scipy():
    first, second = Rotation.random(50, random_state=1), Rotation.random(50, random_state=2)
    np.testing.assert_allclose(metrics.rotation_angles(first.as_matrix(), second.as_matrix()),
                               (first.inv() * second).magnitude(), atol=1e-12)


def test_palm_error_of_a_quarter_turn_and_a_step_of_3_4_12_millimetres():
    turn = Rotation.from_euler('z', 90., degrees=True).as_matrix()
    angle, distance = metrics.palm_pose_error(turn, (.003, .004, .012), np.eye(3), np.zeros(3))
    assert angle == pytest.approx(np.pi / 2.)
    assert distance == pytest.approx(.013)


def test_joint_classes_are_what_they_are_called():
    for name, rows in metrics.JOINT_CLASSES.items():
        landmarks = [LANDMARKS[row] for row in rows]
        if name == 'all':
            assert landmarks == list(LANDMARKS[1:])
        elif name.startswith('thumb'):
            assert landmarks == [name]
        else:
            assert landmarks == [f'{finger}_{name}'
                                 for finger in ('index', 'middle', 'ring', 'little')]


def test_joint_errors_of_one_moved_pip_and_one_joint_unknown():
    true = np.zeros((2, 21, 3))
    found = true.copy()
    found[1, LANDMARKS.index('ring_pip')] = (.002, .003, .006)
    true[0, LANDMARKS.index('thumb_ip')] = np.nan
    errors = metrics.joint_errors(found, true)
    assert errors['pip'].sum() == pytest.approx(.007)
    assert errors['pip'].shape == (8,)
    assert errors['thumb_ip'].tolist() == [0.]
    assert errors['all'].shape == (39,)
    assert not errors['tip'].any()


def test_limit_violations_of_one_frame_in_four():
    limits = [(-1., 1.), (0., 2.)]
    angles = np.array([(0., 0.), (1., 2.), (-1.25, 2.), (.5, 1.)])
    assert metrics.limit_violations(angles, limits) == (.25, .25)
    assert metrics.limit_violations(angles, limits, tolerance=.3) == (0., .25)
    angles[0, 0] = np.nan
    assert metrics.limit_violations(angles, limits)[0] == .5
    assert metrics.limit_violations(angles[1:2], limits) == (0., 0.)


def test_jerk_of_a_cubic_and_of_a_parabola():
    t = np.arange(30) / 120.
    found = metrics.jerk(np.column_stack((5. * t ** 3, t ** 2)), 120.)
    np.testing.assert_allclose(found, (30., 0.), atol=1e-7)


@pytest.mark.parametrize('frames', [240, 241])
def test_energy_above_the_cutoff_is_that_of_the_fast_sine_only(frames):
    rate = 120.
    t = np.arange(frames) / rate
    # Whole periods: the transform takes them apart exactly.
    slow, fast = 4. * rate / frames, 60. * rate / frames
    values = np.stack((.3 * np.sin(2. * np.pi * fast * t) + np.sin(2. * np.pi * slow * t),
                       np.sin(2. * np.pi * slow * t)), axis=1)
    found = metrics.high_frequency_energy(values, rate)
    np.testing.assert_allclose(found, (.045, 0.), atol=2e-3)


def test_energy_of_white_noise_is_its_share_of_the_band():
    noise = np.random.default_rng(1).normal(0., .1, 24000)
    assert metrics.high_frequency_energy(noise, 120., 30.) == pytest.approx(.005, rel=.05)


def test_a_steady_drift_is_no_jitter():
    assert metrics.high_frequency_energy(np.linspace(0., 5., 100), 120.) == pytest.approx(0.)


def test_availability_counts_places_within_the_tolerance():
    assert metrics.availability([.001, .02, np.nan, np.inf], .01) == .25
    assert np.isnan(metrics.availability([], .01))
