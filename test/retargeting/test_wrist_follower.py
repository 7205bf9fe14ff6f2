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

    def tick(self, pose):
        self.now += STEP
        self.it.observe(pose, self.now)
        return self.it.command(self.now)

    def settle(self, pose, ticks=300):
        for _ in range(ticks):
            command = self.tick(pose)
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
    rig = Rig()
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


def test_without_both_poses_it_is_not_engaged_and_sends_nothing():
    it = WristFollower()
    assert "person's wrist is missing" in it.engage(ROBOT_WRIST, 0.)
    it.observe(PERSON, 0.)
    assert "robot's wrist is missing" in it.engage(None, 0.)
    assert it.command(.01) is None
    assert it.engage(ROBOT_WRIST, 0.) == '' and it.command(.01) is not None
    it.disengage()
    assert it.command(.02) is None


def test_what_is_no_pose_is_left_out():
    assert wrist_pose_of((0., np.nan, 0.), (0., 0., 0., 1.)) is None
    assert wrist_pose_of((0., 0., 0.), (0., 0., 0., 0.)) is None
    rig = Rig()
    before = rig.settle(moved(x=.02))
    np.testing.assert_array_equal(rig.tick(None).pose.position, before.position)


def test_options_are_checked():
    with pytest.raises(InvalidWristOption, match='wrist.max_speed: 0; allowed is 0.001 to 5 m/s'):
        WristOptions(max_speed=0)
