"""The plane of a digit: conformal algebra as oracle, and the fist."""

import numpy as np
import pytest

from hand_tracker.core.inverse_kinematics.abduction_plane import (
    BEHIND_JOINT_WEIGHT,
    FIST_FAR,
    FIST_NEAR,
    REFERENCE_STEP,
    in_plane,
    plane_abduction,
)

FREE = (-np.pi / 2, np.pi / 2)


def turn_of(target, lateral=0., reach=.07, limits=FREE, previous=0., step=REFERENCE_STEP):
    turn = plane_abduction(tuple(target), lateral, reach, *limits, previous, step)
    return turn, *in_plane(tuple(target), turn, 0.)


def test_lateral_offset_keeps_the_marker_beside_the_plane():
    rng = np.random.default_rng(2)
    for _ in range(200):
        target = rng.uniform((.03, -.02, -.05), (.07, .02, .02))
        turn, along, _ = turn_of(target, lateral=.004)
        beside = -target[0] * np.sin(turn) + target[1] * np.cos(turn)
        assert beside == pytest.approx(.004, abs=1e-12)
        assert along > 0.


@pytest.mark.parametrize('lateral', [.004, -.004])
def test_a_marker_nearer_to_the_axis_than_to_its_plane_turns_the_plane_by_a_quarter(lateral):
    turn, along, _ = turn_of((.003, 0., 0.), lateral=lateral, reach=.01)
    assert turn == pytest.approx(-np.copysign(np.pi / 2., lateral))
    assert along == pytest.approx(0., abs=1e-12)


def test_the_plane_passes_a_marker_on_the_side_on_which_it_rides():
    for lateral in (.004, -.004):
        turn, _, _ = turn_of((.05, 0., 0.), lateral=lateral)
        assert turn == pytest.approx(-np.arcsin(lateral / .05))


def test_past_a_fist_the_plane_does_not_flip():
    # The marker has passed under the joint: the projected direction points backwards.
    turn, along, _ = turn_of((-.03, .003, -.02))
    assert turn == pytest.approx(-.1 * BEHIND_JOINT_WEIGHT, abs=1e-3)
    for _ in range(100):
        turn, along, _ = turn_of((-.03, .003, -.02), previous=turn)
    assert turn == pytest.approx(-.1, abs=1e-3)
    assert along < 0.


@pytest.mark.parametrize('target', [(-.03, .003, -.02), (.009, .003, -.02)])
def test_in_a_fist_it_follows_as_fast_at_any_rate_of_frames(target):
    def after(frames, step):
        turn = 0.
        for _ in range(frames):
            turn, _, _ = turn_of(target, previous=turn, step=step)
        return turn

    assert after(8, REFERENCE_STEP / 4.) == pytest.approx(after(2, REFERENCE_STEP))
    assert after(1, 2. * REFERENCE_STEP) == pytest.approx(after(2, REFERENCE_STEP))
    # None of it while no time passes, and all of it where it is not in a fist.
    assert after(1, 0.) == 0.
    assert turn_of((.03, .003, -.02), step=0.)[0] == pytest.approx(np.arctan2(.003, .03))


def test_a_marker_under_the_joint_leaves_abduction_as_it_was():
    turn, along, height = turn_of((.0, .0, -.03), previous=.1)
    assert (turn, along, height) == (.1, 0., -.03)
    near = FIST_NEAR * .07 * .99
    assert turn_of((near * .6, near * .8, -.03), previous=.1)[0] == .1


def test_abduction_gains_its_say_gradually_and_has_all_of_it_beyond():
    shares = np.linspace(FIST_NEAR, FIST_FAR, 50)
    turns = [turn_of((.07 * share, .07 * share, -.03), previous=0.)[0] for share in shares]
    assert (np.diff(turns) >= 0.).all()
    assert max(np.diff(turns)) < .05
    assert turns[-1] == pytest.approx(np.pi / 4)


def test_noise_in_a_fist_does_not_shake_abduction():
    # 60/95 degrees of flexion bring the marker right under the MCP.
    rng = np.random.default_rng(3)
    l1, l2 = .045, .026
    target = np.array((l1 * np.cos(np.radians(60)) + l2 * np.cos(np.radians(155)), 0.,
                       -l1 * np.sin(np.radians(60)) - l2 * np.sin(np.radians(155))))
    previous, turns = 0., []
    for _ in range(500):
        previous, _, _ = turn_of(
            target + rng.normal(scale=.0003, size=3), reach=l1 + l2,
            limits=np.radians((-15, 15)), previous=previous)
        turns.append(previous)
    assert np.degrees(np.abs(turns)).max() < 1.


def test_limits_hold():
    limits = np.radians((-15., 15.))
    assert turn_of((.05, .05, 0.), limits=limits)[0] == limits[1]
    assert turn_of((.05, -.05, 0.), limits=limits)[0] == limits[0]
