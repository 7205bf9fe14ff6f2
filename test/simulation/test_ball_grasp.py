"""A ball that is grasped stays, one that is not falls: in MuJoCo, where that is installed."""

import numpy as np
import pytest

from hand_tracker import Hand, HandTracker
from hand_tracker.retargeting.retargeter import Retargeter
from hand_tracker.retargeting.robot_file import load_robot
from hand_tracker.simulation import ball_grasp
from hand_tracker.simulation.ball_grasp import (
    CLOSED_AT,
    FREE_FROM,
    LOST_FROM,
    OPENS_AT,
    TURNED_AT,
    BallGrasp,
    PhysicsUnavailable,
    grasp_recording,
    gravity_at,
)

HAND = Hand.scaled()


def test_the_recording_is_of_a_hand_that_is_tracked():
    recording = grasp_recording(HAND)
    tracker = HandTracker(HAND)
    times = 1e-9 * (recording.stamps - recording.stamps[0])
    states = [tracker.update(frame, at) for frame, at in zip(recording.markers, times)]
    off = np.abs([state.angles for state in states] - recording.angles)[times > 1.]
    assert np.degrees(np.median(off)) < 2.
    assert times[-1] > OPENS_AT + 1.


def test_gravity_turns_about_the_palm_once_the_hand_is_closed():
    np.testing.assert_allclose(gravity_at(CLOSED_AT - .1), (0., 0., ball_grasp.GRAVITY))
    np.testing.assert_allclose(gravity_at(TURNED_AT), (0., 0., -ball_grasp.GRAVITY), atol=1e-9)
    for at in np.linspace(0., TURNED_AT):
        assert np.linalg.norm(gravity_at(at)) == pytest.approx(ball_grasp.GRAVITY)


def test_without_mujoco_it_says_so(monkeypatch):
    monkeypatch.setitem(__import__('sys').modules, 'mujoco', None)
    with pytest.raises(PhysicsUnavailable, match='pip install mujoco'):
        BallGrasp(load_robot('plain'))


def held_until(end, closes=True):
    """Return the ball's place when the hand is closed and at an end, and what follows then."""
    pytest.importorskip('mujoco')
    robot, recording = load_robot('plain'), grasp_recording(HAND)
    retargeter, physics = Retargeter(robot.hand, HAND), BallGrasp(robot)
    rows = [robot.hand.model.variables.index(name) for name in robot.order]
    places, step = [], 1. / 120.
    for i, angles in enumerate(recording.angles):
        if step * i > end:
            break
        wanted = retargeter.update_angles(angles if closes else recording.angles[0], step)
        physics.command(wanted[rows])
        physics.advance(step * i)
        places.append(physics.ball)
    return np.array(places)[[round(CLOSED_AT / step), -1]]


def test_a_ball_that_is_grasped_is_held_upside_down():
    closed, end = held_until(OPENS_AT)
    assert np.linalg.norm(end - closed) < .5 * LOST_FROM


def test_a_ball_falls_when_the_hand_opens():
    closed, end = held_until(np.inf)
    assert np.linalg.norm(end - closed) > FREE_FROM


def test_a_ball_that_is_not_grasped_falls_when_the_hand_is_turned():
    closed, end = held_until(OPENS_AT, closes=False)
    assert np.linalg.norm(end - closed) > FREE_FROM
