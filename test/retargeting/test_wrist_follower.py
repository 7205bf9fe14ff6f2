"""The wrist: it follows by increments, is re-indexed by the clutch, and never leaps."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hand_tracker.retargeting.wrist_follower import (
    InvalidWristOption,
    WristFollower,
    WristOptions,
    WristPose,
    wrist_pose_of,
)

STEP = .01
ROBOT_WRIST = WristPose(np.array((.5, -.2, .8)), Rotation.from_rotvec((.3, .2, -.4)))
PERSON = WristPose(np.array((2., 1., 1.2)), Rotation.from_rotvec((0., 1., 0.)))


def moved(x=0., y=0., z=0., turn=(0., 0., 0.)):
    return WristPose(PERSON.position + (x, y, z), Rotation.from_rotvec(turn) * PERSON.rotation)


class Rig:
    """A wrist that is followed on one clock."""

    def __init__(self, **options):
        self.it, self.now = WristFollower(WristOptions(**options)), 5.
        self.it.observe(PERSON, self.now)
        assert self.it.engage(ROBOT_WRIST, self.now) == ''

    def tick(self, pose, frame=''):
        self.now += STEP
        self.it.observe(pose, self.now, frame)
        return self.it.command(self.now)

    def settle(self, pose, ticks=300, frame=''):
        for _ in range(ticks):
            command = self.tick(pose, frame)
        return command.pose


def turned_by(first, second):
    return (second.rotation * first.rotation.inv()).as_rotvec()


def test_it_moves_as_much_as_the_person_in_the_frame_of_the_robots_base():
    rig = Rig(scale=.5, yaw_deg=90.)
    at = rig.settle(moved(x=.08, z=.04, turn=(.3, 0., 0.)))
    np.testing.assert_allclose(at.position - ROBOT_WRIST.position, (0., .04, .02), atol=1e-9)
    np.testing.assert_allclose(turned_by(ROBOT_WRIST, at), (0., .3, 0.), atol=1e-9)


def test_the_twist_leads_to_the_pose_and_ends_there():
    rig = Rig()
    at, goal = ROBOT_WRIST, moved(y=.05, turn=(0., 0., .2))
    for _ in range(100):
        command = rig.tick(goal)
        np.testing.assert_allclose(command.pose.position, at.position + STEP * command.linear)
        np.testing.assert_allclose(turned_by(at, command.pose), STEP * command.angular, atol=1e-12)
        at = command.pose
    np.testing.assert_allclose(at.position - ROBOT_WRIST.position, (0., .05, 0.), atol=1e-9)
    assert np.abs(command.linear).max() < 1e-9 and np.abs(command.angular).max() < 1e-9


def test_while_the_clutch_is_held_the_robot_stays_and_then_goes_on():
    rig = Rig(max_jump=1.)
    there = rig.settle(moved(x=.05))
    rig.it.clutch(True)
    elsewhere = moved(x=-.3, turn=(0., .5, 0.))
    held = rig.settle(elsewhere, 20)
    np.testing.assert_array_equal(held.position, there.position)
    rig.it.clutch(False)
    at = rig.settle(elsewhere, 20)
    np.testing.assert_allclose(at.position, there.position, atol=1e-12)
    at = rig.settle(moved(x=-.2, turn=(0., .5, 0.)))
    np.testing.assert_allclose(at.position - there.position, (.1, 0., 0.), atol=1e-9)
    np.testing.assert_allclose(turned_by(there, at), 0., atol=1e-9)


@pytest.mark.parametrize('fault', ['jump', 'lost', 'late'])
def test_speeds_hold_whatever_comes_and_a_jump_is_not_followed(fault):
    # Every turn is followed, so that the speed is tried.
    rig = Rig(max_turn_jump=3.15)
    before = rig.settle(moved(x=.02))
    if fault == 'lost':
        rig.now += 10.
        assert np.abs(rig.it.command(rig.now).linear).max() == 0.
    if fault == 'late':
        rig.now += 10.
    after = rig.settle(moved(x=3.), 50)
    np.testing.assert_allclose(after.position, before.position, atol=1e-12)
    last, random = after, np.random.default_rng(0)
    for _ in range(300):
        command = rig.tick(moved(*random.normal(scale=.03, size=3), turn=random.normal(size=3)))
        assert np.linalg.norm(command.pose.position - last.position) <= (
            rig.it.options.max_speed * STEP + 1e-9)
        assert np.linalg.norm(turned_by(last, command.pose)) <= (
            rig.it.options.max_turn_rate * STEP + 1e-9)
        last = command.pose


def test_a_flip_of_the_persons_wrist_is_not_followed():
    rig = Rig()
    before = rig.settle(moved(x=.02, turn=(0., 0., .2)))
    assert rig.it.refused_jumps == 0
    for turn in ((3., 0., 0.), (0., 0., .2), (0., 0., .75)):
        after = rig.settle(moved(x=.02, turn=turn), 50)
        np.testing.assert_allclose(turned_by(before, after), 0., atol=1e-9)
    assert rig.it.refused_jumps == 3
    # It goes on from there, and a turn of less is a movement.
    after = rig.settle(moved(x=.02, turn=(0., 0., 1.2)))
    np.testing.assert_allclose(turned_by(before, after), (0., 0., .45), atol=1e-9)
    assert rig.it.refused_jumps == 3


def test_another_frame_of_the_persons_wrist_is_no_movement():
    rig = Rig()
    before = rig.settle(moved(x=.02))
    for frame in ('room', 'floor'):
        after = rig.settle(moved(x=.09, turn=(0., 0., .3)), 50, frame)
        np.testing.assert_allclose(after.position, before.position, atol=1e-9)
        np.testing.assert_allclose(turned_by(before, after), 0., atol=1e-9)
    assert rig.it.refused_jumps == 0
    after = rig.settle(moved(x=.05, turn=(0., 0., .3)), frame='floor')
    np.testing.assert_allclose(after.position - before.position, (-.04, 0., 0.), atol=1e-9)


@pytest.mark.parametrize('turn', [False, True])
def test_the_speed_rises_by_the_acceleration_and_falls_by_it_as_it_arrives(turn):
    rig = Rig(max_turn_rate=1., max_turn_acceleration=4., max_speed=.25, max_acceleration=1.)
    goal = moved(turn=(0., 0., .4)) if turn else moved(y=.09)
    acceleration, most = (4., 1.) if turn else (1., .25)
    speeds = [0.]
    for _ in range(100):
        command = rig.tick(goal)
        speeds.append(float(np.linalg.norm(command.angular if turn else command.linear)))
    assert np.abs(np.diff(speeds)).max() <= acceleration * STEP + 1e-9
    assert max(speeds) == pytest.approx(most) and speeds[1] == pytest.approx(acceleration * STEP)
    assert speeds[-1] < 1e-9
    assert STEP * sum(speeds) == pytest.approx(.4 if turn else .09)
    # Sent back, it neither goes on nor starts at full speed; the clutch stops it at once.
    rig.settle(moved(), 20)
    back = rig.tick(goal)
    assert np.linalg.norm((*back.linear, *back.angular)) == pytest.approx(acceleration * STEP)
    rig.it.clutch(True)
    held = rig.tick(goal)
    assert not held.linear.any() and not held.angular.any()


def test_it_follows_as_evenly_as_the_person_moves_whose_frames_are_rarer_than_commands():
    rig, speeds = Rig(), []
    for i in range(300):
        rig.now += STEP
        if i % 3 == 0:
            rig.it.observe(moved(y=.1 * STEP * i), rig.now)
        speeds.append(float(rig.it.command(rig.now).linear[1]))
    assert np.ptp(speeds[100:]) < .05
    assert np.mean(speeds[100:]) == pytest.approx(.1, rel=.02)


def test_without_both_poses_it_is_not_engaged_and_sends_nothing():
    it = WristFollower()
    assert "person's wrist is missing" in it.engage(ROBOT_WRIST, 0.)
    it.observe(PERSON, 0.)
    assert "robot's wrist is missing" in it.engage(None, 0.)
    assert it.command(.01) is None
    assert it.engage(ROBOT_WRIST, 0.) == '' and it.command(.01) is not None
    last = it.disengage()
    np.testing.assert_allclose(last.pose.position, ROBOT_WRIST.position)
    assert not last.linear.any() and not last.angular.any()
    assert it.command(.02) is None and it.disengage() is None


def test_what_is_no_pose_is_left_out():
    assert wrist_pose_of((0., np.nan, 0.), (0., 0., 0., 1.)) is None
    assert wrist_pose_of((0., 0., 0.), (0., 0., 0., 0.)) is None
    rig = Rig()
    before = rig.settle(moved(x=.02))
    np.testing.assert_array_equal(rig.tick(None).pose.position, before.position)


def test_options_are_checked():
    with pytest.raises(InvalidWristOption, match='wrist.max_speed: 0; allowed is 0.001 to 5 m/s'):
        WristOptions(max_speed=0)
