"""The guard: each rule of safety is broken on purpose, and faults come at random 10,000 times."""

import numpy as np
import pytest
from helpers.command_rules import CommandRules, use_deadman

from hand_tracker.retargeting import guard_kernel
from hand_tracker.retargeting.command_guard import REPEATED, STATES, CommandGuard, GuardState
from hand_tracker.retargeting.guard_kernel import lose_hand, observe_wanted
from hand_tracker.retargeting.guard_options import GuardOptions, InvalidGuardOption

NAMES = ('thumb', 'index', 'wrist')
LOWER, UPPER = np.array((-.5, 0., -1.)), np.array((1., 1.6, 1.))
SPEED = np.array((0., 2., 40.))
REST = np.array((0., .1, 0.))
ROBOT_POSITION = np.array((.4, 1., -.3))
HAND = np.array((.1, .6, .2))
STEP = .01


class Rig:
    """A guard, a hand and a robot on one clock."""

    def __init__(self, **options):
        self.options = GuardOptions(**options)
        self.guard = CommandGuard(NAMES, LOWER, UPPER, SPEED, REST, self.options)
        self.now = 100.

    def tick(self, hand=HAND, robot=ROBOT_POSITION, step=STEP):
        """Let a period pass, with a frame of the hand unless that is None; return the command."""
        self.now += step
        if robot is not None:
            self.guard.observe_robot(robot, self.now)
        if hand is not None:
            self.guard.judge_ages(self.now)
            observe_wanted(self.guard.pack, np.array(hand, dtype=float), self.now)
        return self.guard.command(self.now)

    def run(self, seconds, **given):
        return [self.tick(**given) for _ in range(round(seconds / STEP))]

    def engaged(self):
        """Engage and return the rig."""
        self.tick()
        assert self.guard.engage(self.now) == ''
        return self

    def following(self):
        """Engage, follow, and return the rig."""
        self.engaged().run(4.)
        assert self.guard.state is GuardState.FOLLOWING
        return self


def test_states_have_the_numbers_of_the_kernels():
    assert [getattr(guard_kernel, one.name) for one in STATES] == list(range(len(STATES)))


def test_nothing_moves_before_it_is_engaged():
    rig = Rig()
    assert all(command is None for command in rig.run(2.))
    assert rig.guard.state is GuardState.DISENGAGED
    assert rig.engaged().tick() is not None


@pytest.mark.parametrize('hand, robot, reason', [
    (None, ROBOT_POSITION, 'no hand'), (HAND, None, 'joint states are missing'),
    (np.full(3, np.nan), ROBOT_POSITION, 'no hand'), (HAND, np.full(3, np.nan), 'missing'),
    (HAND, np.array((.4, 1.9, 0.)), 'index is at 1.900, outside its limits 0.000 to 1.600')])
def test_without_a_hand_or_a_robot_it_is_not_engaged(hand, robot, reason):
    rig = Rig()
    rig.run(.1, hand=hand, robot=robot)
    before, missing = rig.guard.reason, rig.guard.missing(rig.now)
    assert rig.guard.reason == before       # nobody has asked to engage it
    assert reason in missing and rig.guard.engage(rig.now) == missing
    assert reason in rig.guard.reason and rig.tick(hand=hand, robot=robot) is None


def test_old_joint_states_are_no_start():
    rig = Rig()
    rig.tick()
    assert rig.guard.missing(rig.now) == ''
    rig.run(1., robot=None)
    assert 'joint states are missing or old' in rig.guard.engage(rig.now)


def test_a_robot_whose_joint_states_end_is_moved_no_more():
    rig = Rig().following()
    commands = rig.run(rig.options.robot_timeout + .1, robot=None)
    assert commands[0] is not None and commands[-1] is None
    assert "the robot's joint states ended" in rig.guard.reason
    assert rig.run(1.)[-1] is None
    without = Rig(require_robot_state=False).following()
    assert without.run(1., robot=None)[-1] is not None


def test_a_robot_without_joint_states_starts_at_rest_by_choice():
    rig = Rig(require_robot_state=False)
    rig.run(.1, robot=None)
    assert rig.guard.engage(rig.now) == ''
    assert np.abs(rig.tick(robot=None) - REST).max() < .01


def test_where_the_robot_is_is_known_in_every_state():
    rig, elsewhere = Rig(), ROBOT_POSITION + .1
    np.testing.assert_allclose(rig.guard.present, REST)
    rig.engaged()
    np.testing.assert_allclose(rig.guard.present, ROBOT_POSITION)
    commands = rig.run(1., robot=elsewhere)
    np.testing.assert_array_equal(rig.guard.present, commands[-1])
    rig.guard.disengage()
    np.testing.assert_allclose(rig.guard.present, elsewhere)
    assert rig.tick() is None


def test_it_eases_from_where_the_robot_is():
    rig = Rig().engaged()
    commands = [ROBOT_POSITION]
    while rig.guard.state is GuardState.EASING:
        commands.append(rig.tick())
    assert len(commands) > .3 / (rig.options.ease_speed * STEP)
    assert np.abs(np.diff(commands, axis=0)).max() <= rig.options.ease_speed * STEP + 1e-12
    np.testing.assert_allclose(rig.run(3.)[-1], HAND, atol=1e-6)


def test_from_easing_on_the_speed_rises_gradually():
    rig = Rig(max_jump=10.).engaged()
    while rig.guard.state is GuardState.EASING:
        last = rig.tick()
    far = np.array((.9, 1.5, -.9))
    speeds = []
    for _ in range(10):
        command = rig.tick(hand=far)
        speeds.append(np.abs(command - last).max() / STEP)
        last = command
    assert speeds[0] < 1.2 * rig.options.ease_speed
    assert np.diff(speeds).max() <= .1 * (rig.options.max_speed - rig.options.ease_speed)
    assert speeds[-1] > speeds[0] + .5


def test_a_hand_that_moves_is_followed_once_each_joint_has_reached_it():
    """Waiting until all are there in one frame takes more than a minute here."""
    rig, middle = Rig(), np.array((.1, .8, 0.))
    for step in range(300):
        if step == 1:
            assert rig.guard.engage(rig.now) == ''
        hand = middle + (.4, .5, .4) * np.sin(6. * STEP * step - np.array((0., np.pi / 2., 0.)))
        command = rig.tick(hand=hand)
        if rig.guard.state is GuardState.FOLLOWING:
            break
    assert rig.guard.state is GuardState.FOLLOWING
    assert np.abs(command - hand).max() < rig.options.max_jump


def test_no_joint_is_a_jump_away_as_the_speed_begins_to_rise():
    rig = Rig(max_jump=.15)
    rig.tick(hand=ROBOT_POSITION + (0., 0., .2))
    assert rig.guard.engage(rig.now) == ''
    for frame in range(40):
        # The thumb is there at first, and is left behind before the wrist is.
        hand = ROBOT_POSITION + (min(.05 * frame, .5), 0., .2)
        command = rig.tick(hand=hand)
    assert abs(command[2] - hand[2]) < .01 and command[0] < hand[0] - .15
    assert rig.guard.state is GuardState.EASING
    while rig.guard.state is GuardState.EASING:
        command = rig.tick(hand=hand)
    assert command[0] == pytest.approx(hand[0] - .15, abs=.01)


@pytest.mark.parametrize('degrees, rate_hz', [(15., 1.), (4., 3.), (4., 10.)])
def test_a_swing_is_followed_without_delay(degrees, rate_hz):
    """A guard that brakes before each position of the hand trails it by 13 to 29 ms here."""
    rig, step = Rig(require_robot_state=False), 1. / 120.
    times = np.arange(240) * step
    middle = np.array((.2, .8, 0.))
    swing = np.radians(degrees) * np.sin(2. * np.pi * rate_hz * times)
    rig.tick(hand=middle)
    assert rig.guard.engage(rig.now) == ''
    rig.run(4., hand=middle)
    sent = np.array([rig.tick(hand=middle + (one, 0., 0.), step=step)[0] for one in swing])
    wave = np.exp(-2j * np.pi * rate_hz * times[120:])
    followed = ((sent[120:] - middle[0]) @ wave) / (swing[120:] @ wave)
    assert abs(np.angle(followed)) / (2. * np.pi * rate_hz) < 1e-3
    assert abs(followed) == pytest.approx(1., abs=.02)


def test_a_hand_that_stops_dead_is_hardly_overshot():
    rig = Rig().following()
    hand = HAND.copy()
    for _ in range(20):
        hand = hand + (0., .015, 0.)
        rig.tick(hand=hand)
    beyond = max(rig.tick(hand=hand)[1] - hand[1] for _ in range(20))
    speed = 1.5
    assert beyond <= speed**2 / (2. * rig.options.max_acceleration) + speed * STEP


def test_engaging_again_starts_from_the_robot_and_not_from_the_last_command():
    rig = Rig().following()
    rig.guard.disengage()
    assert rig.tick() is None
    moved = ROBOT_POSITION + (.2, -.5, .1)
    rig.run(.1, robot=moved)
    assert rig.guard.engage(rig.now) == ''
    assert np.abs(rig.tick(robot=moved) - moved).max() < .01


def test_a_robot_without_joint_states_is_engaged_again_where_it_was_left():
    rig = Rig(require_robot_state=False).engaged()
    rig.run(4., robot=None)
    last = rig.run(1., robot=None)[-1]
    rig.guard.disengage()
    rig.run(2., robot=None)
    assert rig.guard.engage(rig.now) == ''
    assert np.abs(rig.tick(robot=None) - last).max() < .01
    # Where joint states come all the same, they tell.
    rig.guard.disengage()
    rig.run(.1, robot=UPPER + .5)
    assert 'outside its limits' in rig.guard.engage(rig.now)
    rig.run(1.)
    rig.run(.1)
    assert rig.guard.engage(rig.now) == ''
    assert np.abs(rig.tick() - ROBOT_POSITION).max() < .01


def test_joint_states_older_than_the_last_command_are_no_start():
    rig = Rig().following()
    last = rig.run(.2, robot=None)[-1]
    assert np.abs(last - ROBOT_POSITION).max() > .3
    rig.guard.disengage()
    assert rig.guard.engage(rig.now) == ''
    assert np.abs(rig.tick(robot=None) - last).max() < .01


def test_joint_states_that_leap_to_and_fro_are_no_start():
    rig, other = Rig(), ROBOT_POSITION - .4
    rig.run(1.)
    rig.run(.05, robot=other)
    assert rig.guard.missing(rig.now) == ''     # once: another controller may have moved it
    rig.tick()
    assert 'leap to and fro' in rig.guard.engage(rig.now)
    rig.run(.9)
    assert 'leap to and fro' in rig.guard.missing(rig.now)
    rig.run(.2)
    assert rig.guard.engage(rig.now) == ''


def test_speed_and_acceleration_hold_and_the_urdf_counts():
    rig = Rig(max_jump=10., max_speed=3., max_acceleration=30.).following()
    last, before = rig.tick(), None
    for _ in range(300):
        command = rig.tick(hand=np.array((.9, 1.5, -.9)))
        velocity = (command - last) / STEP
        assert np.abs(velocity[0]) <= rig.options.max_speed + 1e-9
        assert np.abs(velocity[1]) <= 2. + 1e-9    # the URDF
        if before is not None:
            assert np.abs(velocity - before).max() <= rig.options.max_acceleration * STEP + 1e-9
        last, before = command, velocity
    np.testing.assert_allclose(last, (.9, 1.5, -.9), atol=1e-6)


def test_a_long_gap_between_commands_counts_as_a_short_one():
    rig = Rig().following()
    before = rig.tick()
    after = rig.tick(hand=HAND + .5, step=.14)
    assert np.abs(after - before).max() <= rig.options.max_speed * rig.options.max_dt + 1e-12


@pytest.mark.parametrize('robot', [ROBOT_POSITION, None])
@pytest.mark.parametrize('gap, state', [
    (.2, GuardState.EASING), (.9, GuardState.EASING), (1.2, GuardState.DISENGAGED),
    (3600., GuardState.DISENGAGED)])
def test_a_process_that_was_stopped_takes_the_next_frame_as_of_a_hand_that_was_lost(
        gap, state, robot):
    rig = Rig(require_robot_state=robot is not None).following()
    before = rig.tick(robot=robot)
    after = rig.tick(hand=HAND + .6, robot=robot, step=gap)
    assert rig.guard.state is state
    if state is GuardState.EASING:
        assert np.abs(after - before).max() <= rig.options.ease_speed * rig.options.max_dt + 1e-12
        for _ in range(25):
            rig.tick(hand=after, robot=robot)
            assert rig.guard.state is GuardState.EASING
    else:
        assert after is None and all(command is None for command in rig.run(1., robot=robot))


def test_a_hand_that_comes_back_where_it_was_and_goes_on_at_once_is_eased_to():
    rig = Rig(max_jump=10.).following()
    rig.run(.5, hand=None)
    assert rig.guard.state is GuardState.HOLDING
    far, commands = HAND + np.array((-.5, .6, -.7)), [rig.tick()]
    for _ in range(100):
        commands.append(rig.tick(hand=far))
    assert np.abs(np.diff(commands[:20], axis=0)).max() <= rig.options.ease_speed * STEP + 1e-12
    # Once it is there, the speed rises.
    assert np.abs(rig.run(2., hand=far)[-1] - far).max() < .01
    assert rig.guard.state is GuardState.FOLLOWING


def test_a_hand_that_jumps_to_and_fro_is_not_followed():
    rig, random = Rig(max_jump=.3).following(), np.random.default_rng(1)
    commands, states = [HAND], []
    for _ in range(300):
        commands.append(rig.tick(
            hand=HAND + .5 * random.choice((-1., 1.), 3) + random.uniform(size=3)))
        states.append(rig.guard.state)
    assert np.abs(np.diff(commands, axis=0)).max() <= rig.options.ease_speed * STEP + 1e-9
    timeout = round(rig.options.hand_timeout / STEP)
    assert GuardState.FOLLOWING not in states[timeout + 1:]


@pytest.mark.parametrize('rate', [100., 480., 1000.])
def test_a_jump_has_to_last_at_any_rate(rate):
    rig = Rig(max_jump=.3).following()
    for _ in range(int(.9 * rig.options.jump_time * rate)):
        assert np.abs(rig.tick(hand=HAND + .5, step=1. / rate) - HAND).max() < 1e-3
    rig.run(2., hand=HAND + .5)
    assert np.abs(rig.tick(hand=HAND + .5) - HAND).max() > .3


def test_time_that_stands_still_or_goes_back_moves_nothing():
    rig = Rig().following()
    before = rig.tick()
    for step in (0., -1.):
        np.testing.assert_array_equal(rig.tick(hand=HAND + .3, step=step), before)


def test_a_jump_is_followed_only_when_it_persists():
    rig = Rig(max_jump=.3).following()
    far = HAND + (0., .8, 0.)
    for _ in range(rig.options.jump_frames - 1):
        assert np.abs(rig.tick(hand=far) - HAND).max() < 1e-3
    assert rig.guard.refused_jumps == rig.options.jump_frames - 1
    assert np.abs(np.array(rig.run(2., hand=far))[-1] - far).max() < 1e-3
    rig.tick(hand=HAND)
    assert np.abs(rig.tick(hand=far) - far).max() < 1e-3


def test_a_lost_hand_holds_and_is_never_zero():
    rig = Rig().following()
    held = np.array([c for c in rig.run(.9, hand=None)])
    np.testing.assert_allclose(held, np.tile(HAND, (len(held), 1)), atol=1e-3)
    assert rig.guard.state is GuardState.HOLDING
    assert rig.tick() is not None and rig.guard.state is not GuardState.HOLDING


def test_a_hand_that_is_said_to_be_lost_holds_at_once():
    rig = Rig().following()
    lose_hand(rig.guard.pack)
    rig.tick(hand=None)
    assert rig.guard.state is GuardState.HOLDING


@pytest.mark.parametrize('acceleration, stops_at_once', [(500., True), (50., False), (10., False)])
def test_a_hand_that_is_lost_as_it_moves_is_held_after_the_way_to_brake(
        acceleration, stops_at_once):
    rig = Rig(max_jump=10., max_acceleration=acceleration).following()
    before, command = (rig.run(.12, hand=np.array((.9, 1.5, -.9)))[-2:])
    speed = np.abs(command - before) / STEP
    assert speed.max() > .5
    lose_hand(rig.guard.pack)
    held = rig.run(.8, hand=None)
    assert rig.guard.state is GuardState.HOLDING
    braked = np.abs(np.array(held) - command)
    assert (braked <= speed**2 / (2. * acceleration) + 1e-12).all()
    assert (braked.max() == 0.) == stops_at_once
    np.testing.assert_array_equal(held[-1], held[-20])


def test_a_hand_that_stays_lost_needs_engaging_anew():
    rig = Rig().following()
    rig.run(2., hand=None)
    assert rig.guard.state is GuardState.DISENGAGED and 'engage again' in rig.guard.reason
    assert all(command is None for command in rig.run(1.))
    assert rig.engaged().tick() is not None


@pytest.mark.parametrize('on_lost', ['hold', 'stop'])
def test_a_hand_that_is_back_in_time_elsewhere_is_eased_to_from_where_the_robot_holds(on_lost):
    rig = Rig(on_lost=on_lost).following()
    before = rig.tick()
    rig.run(.9 * rig.options.disengage_after, hand=None)
    assert rig.guard.state is GuardState.HOLDING
    elsewhere, commands = np.array((.9, 1.5, -.9)), [before]
    while rig.guard.state is not GuardState.FOLLOWING:
        commands.append(rig.tick(hand=elsewhere))
    steps = np.abs(np.diff(commands, axis=0)).max(axis=1)
    assert steps.max() <= rig.options.ease_speed * STEP + 1e-12
    # It took as long as the way of 0.9 rad does, to where following begins.
    assert len(steps) > .8 / (rig.options.ease_speed * STEP)


def test_a_robot_that_others_moved_while_the_stream_was_stopped_is_eased_from_where_it_is():
    rig = Rig(on_lost='stop').following()
    rig.run(.5, hand=None)
    moved = ROBOT_POSITION + (.1, -.3, .2)
    rig.run(.2, hand=None, robot=moved)
    commands = rig.run(.1, robot=moved)
    assert np.abs(commands[0] - moved).max() < .01
    assert rig.guard.state is GuardState.EASING


def test_a_robot_that_two_publishers_tell_of_is_not_eased_to_after_a_silence():
    rig = Rig(on_lost='stop').following()
    for _ in range(25):
        rig.tick(hand=None)
        rig.tick(hand=None, robot=ROBOT_POSITION - .4)
    assert rig.tick(robot=ROBOT_POSITION - .4) is None
    assert rig.guard.state is GuardState.DISENGAGED and 'leap' in rig.guard.reason


def test_after_a_silence_it_relaxes_from_where_it_is():
    rig = Rig(on_lost='stop', relax=True, max_acceleration=5.).engaged()
    rig.run(1.)
    moved = ROBOT_POSITION + (.1, -.3, .2)
    rig.run(.3, hand=None)
    commands = rig.run(rig.options.disengage_after, hand=None, robot=moved)
    first = next(command for command in commands if command is not None)
    assert rig.guard.state is GuardState.RELAXING
    assert np.abs(first - moved).max() < .001


def test_how_far_the_robot_is_counts_while_it_tells_and_is_to_follow():
    rig = Rig().following()
    assert rig.guard.farthest_from_command(rig.now) == ('wrist', pytest.approx(.5, abs=.01))
    rig.guard.disengage()
    assert rig.guard.farthest_from_command(rig.now) == ('', 0.)
    unknown = Rig(require_robot_state=False).engaged()
    unknown.run(2., robot=None)
    assert unknown.guard.farthest_from_command(unknown.now) == ('', 0.)


@pytest.mark.parametrize('release', ['by itself', 'said'])
def test_a_hand_that_is_back_in_time_is_not_followed_once_the_deadman_was_released(release):
    rig = Rig(hold_to_engage=True)
    rig.tick()
    for _ in range(100):
        rig.guard.press(rig.now)
        rig.tick()
    rig.run(.2, hand=None)
    assert rig.guard.state is GuardState.HOLDING
    if release == 'said':
        rig.guard.disengage('the deadman was released')
    else:
        rig.run(.1, hand=None)
    assert all(command is None for command in rig.run(.3))
    assert 'deadman' in rig.guard.reason
    # Pressed all the while, it is.
    rig.guard.press(rig.now)
    rig.tick()
    for hand in 20 * (HAND, ) + 40 * (None, ) + 10 * (HAND, ):
        rig.guard.press(rig.now)
        rig.tick(hand=hand)
    assert rig.guard.is_following


def test_by_choice_the_stream_stops_while_the_hand_is_lost():
    rig = Rig(on_lost='stop').following()
    commands = rig.run(.5, hand=None)
    assert commands[-1] is None and rig.guard.state is GuardState.HOLDING


def test_by_choice_it_relaxes_slowly_and_then_disengages():
    rig = Rig(relax=True).following()
    commands = [c for c in rig.run(10., hand=None) if c is not None]
    assert np.abs(np.diff(commands, axis=0)).max() <= rig.options.relax_speed * STEP + 1e-9
    np.testing.assert_allclose(commands[-1], np.clip(REST, .02 + LOWER, UPPER - .02), atol=2e-3)
    assert rig.guard.state is GuardState.DISENGAGED


@pytest.mark.parametrize('acceleration', [20., 137., 500.])
def test_a_limit_is_met_within_the_acceleration(acceleration):
    rig = Rig(max_acceleration=acceleration, max_jump=10.).following()
    commands = [rig.tick()]
    for goal in 2 * (UPPER + .5, LOWER - .5):
        commands += rig.run(1.5, hand=goal)
    velocity = np.diff(commands, axis=0) / STEP
    assert np.abs(np.diff(velocity, axis=0)).max() <= acceleration * STEP * (1. + 1e-6)
    reached = np.array(commands)
    np.testing.assert_allclose(reached.max(axis=0), UPPER - .02, atol=1e-6)
    np.testing.assert_allclose(reached.min(axis=0), LOWER + .02, atol=1e-6)


def test_a_hand_that_comes_back_as_the_robot_relaxes_is_followed_once_engaged_anew():
    rig = Rig(relax=True, relax_speed=.05).following()
    rig.run(1.5, hand=None)
    assert rig.guard.state is GuardState.RELAXING
    rig.run(.5)
    assert rig.guard.state is GuardState.RELAXING
    before = rig.tick()
    assert rig.guard.engage(rig.now) == '' and rig.guard.state is GuardState.EASING
    assert np.abs(rig.tick() - before).max() <= rig.options.ease_speed * STEP + 1e-9


def test_hold_to_engage_moves_only_while_it_is_pressed():
    rig = Rig(hold_to_engage=True)
    rig.tick()
    assert 'deadman' in rig.guard.engage(rig.now)
    for _ in range(50):
        rig.guard.press(rig.now)
        assert rig.tick() is not None
    commands = rig.run(.5)
    assert commands[-1] is None and 'released' in rig.guard.reason
    rig.guard.press(rig.now)
    assert rig.tick() is not None


@pytest.mark.parametrize('first', ['press', 'engage'])
def test_silence_after_a_press_is_a_release_whether_or_not_one_is_asked_for(first):
    rig = Rig()
    rig.tick()
    if first == 'engage':
        assert rig.guard.engage(rig.now) == ''
        assert all(command is not None for command in rig.run(2.))
    for _ in range(50):
        assert rig.guard.press(rig.now) == ''
        assert rig.tick() is not None
    held = rig.run(.5)
    assert held[0] is not None and held[-1] is None and 'deadman' in rig.guard.reason
    # Engaged by another means it needs no deadman, before one is pressed again.
    assert rig.guard.engage(rig.now) == ''
    assert all(command is not None for command in rig.run(2.))
    rig.guard.disengage()
    assert rig.guard.press(rig.now) == '' and rig.tick() is not None


@pytest.mark.parametrize('why, relax', [
    ('stopped', False), ('hand lost', False), ('hand lost', True), ('robot lost', False)])
def test_a_deadman_that_is_pressed_on_and_on_undoes_no_stop(why, relax):
    rig = Rig(hold_to_engage=True, relax=relax)
    rig.tick()

    def pressed(seconds, **given):
        commands = []
        for _ in range(round(seconds / STEP)):
            rig.guard.press(rig.now)
            commands.append(rig.tick(**given))
        return commands

    assert pressed(2.)[-1] is not None
    if why == 'stopped':
        rig.guard.disengage()
    else:
        pressed(rig.options.disengage_after + .5, **{why.removesuffix(' lost'): None})
    assert rig.guard.state is (GuardState.RELAXING if relax else GuardState.DISENGAGED)
    pressed(2.)
    assert not rig.guard.is_following
    rig.guard.release()
    assert pressed(.1)[-1] is not None and rig.guard.is_following
    # Silence is a release, too.
    rig.guard.disengage()
    assert all(command is None for command in [*pressed(.1), *rig.run(.3)])
    assert pressed(.1)[-1] is not None


@pytest.mark.parametrize('why, relax', [
    ('stopped', False), ('hand lost', False), ('hand lost', True), ('robot lost', False)])
def test_a_request_that_is_repeated_undoes_no_stop(why, relax):
    rig = Rig(relax=relax)
    rig.run(.1, hand=None)

    def requested(seconds, **given):
        answers = []
        for tick in range(round(seconds / STEP)):
            if tick % 100 == 0:     # as `ros2 topic pub` does
                answers.append(rig.guard.request(rig.now))
            rig.tick(**given)
        return answers

    # Before it was engaged once, it may be repeated until a hand comes.
    assert requested(1., hand=None) == ['there is no hand to follow']
    rig.tick()
    assert requested(3.)[-1] == '' and rig.guard.state is GuardState.FOLLOWING
    if why == 'stopped':
        rig.guard.disengage()
    else:
        requested(rig.options.disengage_after + .5, **{why.removesuffix(' lost'): None})
    answers = requested(5.)
    assert not rig.guard.is_following
    assert answers and set(answers) == {REPEATED} and rig.guard.reason == REPEATED
    rig.guard.disengage()       # by a single message between those that are repeated
    assert requested(2.) == [REPEATED] * 2
    # A pause of this process is none of whoever asks.
    rig.now += 10.
    assert requested(.1) == [REPEATED]
    rig.run(3.)
    assert requested(.1) == ['']


@pytest.mark.parametrize('gap', [.3, .9, 2., 3600.])
@pytest.mark.parametrize('first', ['press', 'hand', 'timer'])
def test_a_stop_of_the_process_is_no_release_of_the_deadman(gap, first):
    rig = Rig(hold_to_engage=True)
    rig.tick()
    for _ in range(300):
        rig.guard.press(rig.now)
        rig.tick()
    assert rig.guard.state is GuardState.FOLLOWING
    rig.now += gap
    if first != 'press':
        rig.tick(hand=HAND if first == 'hand' else None, step=0.)
    for _ in range(200):
        rig.guard.press(rig.now)
        assert rig.tick() is None
    rig.guard.release()
    rig.guard.press(rig.now)
    assert rig.tick() is not None


@pytest.mark.parametrize('robot', [LOWER, UPPER, LOWER - .1, UPPER + .1])
def test_limits_are_kept_with_a_margin_that_a_robot_at_its_limit_enters_slowly(robot):
    rig = Rig()
    rig.tick(robot=robot)
    assert rig.guard.engage(rig.now) == ''
    hand, easing = np.where(robot > 0., UPPER, LOWER) * 3., []
    while rig.guard.state is GuardState.EASING:
        easing.append(rig.tick(hand=hand))
    commands = np.array([*easing, *rig.run(4., hand=hand)])
    assert (commands >= LOWER).all() and (commands <= UPPER).all()
    # As far as it comes in by the margin, and on to what the hand wants.
    assert np.abs(commands[0] - np.clip(robot, LOWER, UPPER)).max() <= .7 * STEP + 1e-9
    assert np.abs(np.diff(easing, axis=0)).max(initial=0.) <= .7 * STEP + 1e-9
    assert (commands[-1] >= LOWER + .02 - 1e-9).all()
    assert (commands[-1] <= UPPER - .02 + 1e-9).all()


@pytest.mark.parametrize('bad', [np.nan, np.inf, -np.inf, 1e308])
def test_what_is_not_finite_comes_in_and_never_out(bad):
    rig = Rig().following()
    for slot in range(3):
        hand = HAND.copy()
        hand[slot] = bad
        command = rig.tick(hand=hand)
        assert np.isfinite(command).all() and (command >= LOWER).all() and (
            command <= UPPER).all()
    assert rig.guard.command(bad) is None or np.isfinite(bad)


def test_sliding_joints_are_guarded_as_turning_ones_by_their_strokes():
    length = .025   # [m] for a radian
    turning, sliding = Rig(), Rig()
    sliding.guard = CommandGuard(NAMES, length * LOWER, length * UPPER, length * SPEED,
                                 length * REST, sliding.options, length)
    beyond = UPPER + .2
    assert sliding.tick(hand=length * HAND, robot=length * beyond) is None
    assert 'outside its limits' in sliding.guard.engage(sliding.now)
    turning.tick(robot=beyond)
    for rig, scale in ((turning, 1.), (sliding, length)):
        rig.tick(scale * HAND, scale * ROBOT_POSITION)
        assert rig.guard.engage(rig.now) == ''
    hands = [HAND + .4 * np.sin(.05 * frame) + (1.5 if frame == 300 else 0.)
             for frame in range(600)] + [None] * 30
    for hand in hands:
        expected = turning.tick(hand)
        found = sliding.tick(None if hand is None else length * hand, length * ROBOT_POSITION)
        np.testing.assert_allclose(found, length * expected, atol=1e-12)
        assert sliding.guard.state is turning.guard.state
    assert sliding.guard.refused_jumps == turning.guard.refused_jumps == 1


@pytest.mark.parametrize('fields, message', [
    ({'max_speed': 0.}, 'max_speed: 0.0; allowed is 0.01 to 100 rad/s'),
    ({'on_lost': 'open'}, "on_lost: 'open' is not one of hold, stop"),
    ({'jump_frames': 1.5}, 'jump_frames: 1.5; allowed is a whole number from 1 to 1000'),
    ({'relax': 1}, 'relax: 1; expected true or false')])
def test_options_are_checked(fields, message):
    with pytest.raises(InvalidGuardOption) as refusal:
        GuardOptions(**fields)
    assert message in str(refusal.value)


FAULTS = ('none', 'frozen', 'killed', 'late', 'nan', 'jump', 'noise', 'robot lost', 'clock jumps',
          'disengaged', 'reengaged', 'released', 'huge', 'short')


@pytest.mark.parametrize('options', [
    {}, {'on_lost': 'stop'}, {'relax': True, 'disengage_after': .1},
    {'hold_to_engage': True, 'jump_frames': 2}])
def test_ten_thousand_faults_break_no_rule(options):
    random = np.random.default_rng(len(options) + sum(map(len, options)))
    rig = Rig(**options)
    guard, robot, frozen = rig.guard, ROBOT_POSITION.copy(), HAND.copy()
    rules, seen = CommandRules(LOWER, UPPER, SPEED, rig.options), set()
    for _ in range(2500):
        fault = FAULTS[random.integers(len(FAULTS))]
        for _ in range(int(random.integers(1, 7))):
            wanted = HAND + .4 * np.sin(rig.now * np.array((2., 3., 5.)))
            hand, robot_seen, step = faulty(fault, wanted, frozen, robot, random)
            if fault != 'frozen':
                frozen = wanted
            use_deadman(guard, fault, rig.now)
            rules.expect(guard, robot, rig.now)
            command = rig.tick(hand=hand, robot=robot_seen, step=step)
            seen.add(guard.state)
            rules.check(guard, command, rig.now)
            if command is not None:
                robot = command.copy()
    assert rules.sent > 1000
    assert seen >= {GuardState.DISENGAGED, GuardState.EASING, GuardState.FOLLOWING,
                    GuardState.HOLDING} | ({GuardState.RELAXING} if rig.options.relax else set())


def faulty(fault, wanted, frozen, robot, random):
    """Return the hand, what is seen of the robot, and the time step, with a fault."""
    hand, step = wanted, float(random.uniform(.002, .02))
    if fault == 'frozen':
        hand = frozen
    elif fault == 'killed':
        hand, step = None, .1
    elif fault == 'late':
        step = float(random.uniform(.1, 3.))
    elif fault == 'nan':
        hand = np.where(random.random(3) < .5, np.nan, wanted)
    elif fault == 'jump':
        hand = random.uniform(-5., 5., 3)
    elif fault == 'noise':
        hand = wanted + random.normal(scale=.3, size=3)
    elif fault == 'clock jumps':
        step = float(random.choice((-2., 0., 50.)))
    elif fault == 'huge':
        hand = random.choice((1e300, -1e300, np.inf), 3)
    elif fault == 'short':
        hand = wanted[:2]
    return hand, None if fault == 'robot lost' else robot, step
