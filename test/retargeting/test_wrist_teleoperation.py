"""Whether a robot's wrist follows: what it needs, what ends it, and what it says."""

import numpy as np
import pytest

from hand_tracker.retargeting.wrist_follower import WristOptions, wrist_pose_of
from hand_tracker.retargeting.wrist_teleoperation import WristTeleoperation

STEP, TIMEOUT = .01, .5     # [s]
UNTURNED = 0., 0., 0., 1.


class Rig:
    """A person's wrist that moves to x at 10 cm/s, and a robot's at rest, on one clock."""

    def __init__(self, sends_poses=True):
        self.it = WristTeleoperation(WristOptions(), 'base', sends_poses, TIMEOUT)
        self.now = 100.

    def tick(self, robot='base', is_following=True):
        """Let a period pass; `robot` is the frame of its wrist's pose, None for no pose."""
        self.now += STEP
        self.it.observe(wrist_pose_of((.1 * self.now, 0., 0.), UNTURNED), self.now, 'lab')
        if robot is not None:
            self.it.observe_robot(wrist_pose_of((1., 2., 3.), UNTURNED), self.now, robot,
                                  round(1e9 * self.now))
        return self.it.command(self.now, is_following)

    def engaged(self):
        self.tick()
        self.it.engage(self.now)
        assert self.it.fault == ''
        return self


def test_it_follows_from_where_the_robot_is():
    rig = Rig().engaged()
    for _ in range(100):
        sent = rig.tick()
    np.testing.assert_allclose(sent.pose.position, (1.1, 2., 3.), atol=5e-3)
    assert sent.linear[0] == pytest.approx(.1, abs=.02)


def test_poses_need_that_of_the_robot_and_twists_do_not():
    rig = Rig()
    rig.tick(robot=None)
    rig.it.engage(rig.now)
    assert "the pose of the robot's wrist is missing; once that is mended" in rig.it.fault
    assert rig.tick(robot=None) is None
    twists = Rig(sends_poses=False)
    twists.tick(robot=None)
    twists.it.engage(twists.now)
    assert twists.it.fault == '' and twists.tick(robot=None) is not None
    assert twists.it.ended(twists.now + 2. * TIMEOUT) == ''


def test_poses_that_end_disengage_the_robot():
    rig = Rig().engaged()
    assert rig.it.ended(rig.now + .9 * TIMEOUT) == ''
    assert rig.it.ended(rig.now + 1.1 * TIMEOUT) == "the pose of the robot's wrist ended"
    rig.tick(robot='tool')
    assert "ended: robot/wrist_pose: frame_id 'tool'; expected wrist.base_frame, 'base'" in (
        rig.it.ended(rig.now + 1.1 * TIMEOUT))
    last = rig.it.disengage()
    assert not last.linear.any() and rig.tick() is None and rig.it.disengage() is None


def test_a_pose_in_another_frame_is_named_as_the_cause():
    rig = Rig()
    rig.tick(robot='tool')
    rig.it.engage(rig.now)
    assert "the arm stays where it is: robot/wrist_pose: frame_id 'tool'" in rig.it.fault
    assert "frame_id 'tool'" in rig.it.status(rig.now)
    rig.tick(robot='')
    rig.it.engage(rig.now)
    assert rig.it.fault == '' and rig.it.status(rig.now) == 'ok'


def test_repeated_stamps_are_no_new_poses():
    rig = Rig().engaged()
    pose = wrist_pose_of((1., 2., 3.), UNTURNED)
    for _ in range(round(1.2 * TIMEOUT / STEP)):
        rig.tick(robot=None)
        rig.it.observe_robot(pose, rig.now, 'base', 10**9)
    assert rig.it.ended(rig.now) != ''


@pytest.mark.parametrize('by_clutch', [True, False])
def test_it_stays_while_the_clutch_is_held_or_the_fingers_do_not_follow(by_clutch):
    rig = Rig().engaged()
    for _ in range(50):
        before = rig.tick()
    rig.it.is_clutched = by_clutch
    for _ in range(50):
        held = rig.tick(is_following=by_clutch)
    assert not held.linear.any()
    np.testing.assert_array_equal(held.pose.position, before.pose.position)
    assert rig.it.status(rig.now) == ('held by the clutch' if by_clutch else 'ok')
    rig.it.is_clutched = False
    np.testing.assert_allclose(rig.tick().pose.position, held.pose.position, atol=1e-3)
