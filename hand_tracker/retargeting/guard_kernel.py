"""Kernels of the command guard: accept the wanted position, move the command towards it.

`CommandGuard` owns the memory and changes the state, but for EASING, which ends here; frames of
the hand in that state and in FOLLOWING need these kernels alone.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..core.numerics.jit import jit
from ..core.numerics.packs import Pack
from ..core.numerics.vectors import clamp
from ..messages.stamps import UNSTAMPED, stands_still
from .guard_options import GuardOptions
from .jump_gate import JumpGate, accepts_position, new_jump_gate

GUARD_CAPACITY = 256    # joints at most
REACHED = .1            # [rad] from the person's pose, where a joint has reached it
MIN_EASING = .3         # [s] to a hand that came back: its first frames may be of the pose before
LEAP = .3               # [rad] of the robot in no time, which it cannot move; and in time beyond
LEAP_SPEED = 2.         # times its greatest speed: of two publishers
SPEEDING_UP = .5        # [s] in which the speed allowed rises from that of easing to the greatest
# What is wrong with the robot's joint states; else the first joint that is not finite
NO_FAULT, LACKS_JOINT, SAME_STAMP = -1, -2, -3
# States of the guard, by number
DISENGAGED, EASING, FOLLOWING, HOLDING, RELAXING = range(5)


class GuardMemory(NamedTuple):
    """State of the guard of n joints: the first n entries of each array of joints are used.

    Attributes
    ----------
    joints : int
        Their number, n.
    lower, upper : ndarray, shape (GUARD_CAPACITY,)
        Limits with the margin that commands keep from them [rad or m].
    speed : ndarray, shape (GUARD_CAPACITY,)
        Greatest speed of each joint [rad/s or m/s].
    per_radian : ndarray, shape (GUARD_CAPACITY,)
        What counts as a radian, 1 where a joint does not slide [m].
    still : ndarray, shape (GUARD_CAPACITY,)
        Zeros: the velocity of a goal that does not move.
    command, velocity : ndarray, shape (GUARD_CAPACITY,)
        Last command [rad or m], and how fast it moved.
    wanted, wanted_velocity : ndarray, shape (GUARD_CAPACITY,)
        What the person's hand wants, and how fast that moved, until a command has answered it.
    robot : ndarray, shape (GUARD_CAPACITY,)
        Where the robot is [rad or m].
    inside : ndarray, shape (GUARD_CAPACITY,)
        Workspace.
    reached : ndarray of int, shape (GUARD_CAPACITY,)
        Whether each joint has reached the person's pose since easing began.
    has_wanted, has_robot, state, refused_values : ndarray of int, shape (1,)
        `refused_values` counts frames that were not finite, or beyond a full turn.
    hand_time, wanted_time, command_time, reached_time, press_time, robot_time : ndarray, shape (1,)
        Of the hand's last frame that was accepted, the same unless one has jumped since, of the
        last command, of the pose's being reached, of the deadman and of the robot's joint
        states [s].
    leap_time, former_leap_time : ndarray, shape (1,)
        Of the last two leaps of the robot's joint states [s].
    return_time : ndarray, shape (1,)
        Of the hand's coming back, where the robot held before easing; else infinitely long ago [s].
    gate : JumpGate
        Of what is wanted.
    robot_stamp : ndarray of int, shape (1,)
        Of the robot's last joint states that lack no joint [ns].
    robot_fault : ndarray of int, shape (1,)
        What is wrong with the robot's last joint states: see `NO_FAULT`.
    hold_timeout : ndarray, shape (1,)
        See `GuardOptions`; infinite while no deadman holds the robot [s].
    max_acceleration, max_speed, ease_speed, max_dt, hand_timeout : float
        The same.
    robot_timeout : float
        The same; infinite where no joint states of the robot are asked for.
    """

    joints: int
    lower: np.ndarray
    upper: np.ndarray
    speed: np.ndarray
    per_radian: np.ndarray
    still: np.ndarray
    command: np.ndarray
    velocity: np.ndarray
    wanted: np.ndarray
    wanted_velocity: np.ndarray
    robot: np.ndarray
    inside: np.ndarray
    reached: np.ndarray
    has_wanted: np.ndarray
    has_robot: np.ndarray
    state: np.ndarray
    refused_values: np.ndarray
    hand_time: np.ndarray
    wanted_time: np.ndarray
    command_time: np.ndarray
    reached_time: np.ndarray
    press_time: np.ndarray
    robot_time: np.ndarray
    leap_time: np.ndarray
    former_leap_time: np.ndarray
    return_time: np.ndarray
    gate: JumpGate
    robot_stamp: np.ndarray
    robot_fault: np.ndarray
    hold_timeout: np.ndarray
    max_acceleration: float
    max_speed: float
    ease_speed: float
    max_dt: float
    hand_timeout: float
    robot_timeout: float


def new_guard_memory(lower: np.ndarray, upper: np.ndarray, speed: np.ndarray,
                     per_radian: np.ndarray, options: GuardOptions) -> GuardMemory:
    """Return the memory of a guard that is not engaged.

    Parameters
    ----------
    lower, upper, speed, per_radian : ndarray, shape (n,)
        See `GuardMemory`; n is `GUARD_CAPACITY` at most.
    options : GuardOptions
    """
    def of_joints(values: np.ndarray | float = 0.) -> np.ndarray:
        row = np.zeros(GUARD_CAPACITY)
        row[:len(lower)] = values
        return row

    flags = {name: np.zeros(1, np.int64) for name in (
        'has_wanted', 'has_robot', 'state', 'refused_values')}
    times = {name: np.full(1, -math.inf) for name in GuardMemory._fields if name.endswith('_time')}
    still = {name: of_joints() for name in (
        'still', 'command', 'velocity', 'wanted', 'wanted_velocity', 'robot', 'inside')}
    return GuardMemory(
        joints=len(lower), lower=of_joints(lower), upper=of_joints(upper),
        speed=of_joints(speed), per_radian=of_joints(per_radian), **still,
        reached=np.zeros(GUARD_CAPACITY, np.int64), **flags, **times,
        gate=new_jump_gate(GUARD_CAPACITY, of_joints(options.max_jump * per_radian),
                           options.jump_frames, options.jump_time),
        robot_stamp=np.full(1, UNSTAMPED), robot_fault=np.full(1, NO_FAULT),
        hold_timeout=np.full(1, options.hold_timeout if options.hold_to_engage else math.inf),
        max_acceleration=options.max_acceleration, max_speed=options.max_speed,
        ease_speed=options.ease_speed, max_dt=options.max_dt, hand_timeout=options.hand_timeout,
        robot_timeout=options.robot_timeout if options.require_robot_state else math.inf)


@jit
def is_followed(guard: GuardMemory, now: float) -> bool:
    """Return whether the robot goes on following a frame of the hand that comes now.

    Parameters
    ----------
    guard : GuardMemory
    now : float
        [s]
    """
    return ((guard.state[0] == FOLLOWING or guard.state[0] == EASING)
            and now - guard.hand_time[0] <= guard.hand_timeout
            and not now - guard.press_time[0] > guard.hold_timeout[0]
            and not now - guard.robot_time[0] > guard.robot_timeout)


@jit
def _first_broken(guard: GuardMemory, given: np.ndarray) -> int:
    """Return the first joint whose position is not finite, or `NO_FAULT`."""
    for i in range(guard.joints):
        if not math.isfinite(given[i]):
            return i
    return NO_FAULT


@jit
def observe_position(guards: Pack[GuardMemory], given: np.ndarray, stamp: int,
                     now: float) -> None:
    """Take the robot's measured joint positions; ones that are not finite are left out.

    So are ones with the stamp of the last, as of a driver that hangs.

    Parameters
    ----------
    guards : pack of GuardMemory
        Changed.
    given : ndarray, shape (>= n,)
        [rad or m]
    stamp : int
        Of the message [ns]; `UNSTAMPED` for none.
    now : float
        Time of receipt [s].
    """
    guard = guards[0]
    if stands_still(stamp, guard.robot_stamp[0]):
        guard.robot_fault[0] = SAME_STAMP
        return
    guard.robot_stamp[0] = stamp
    guard.robot_fault[0] = _first_broken(guard, given)
    if guard.robot_fault[0] == NO_FAULT and math.isfinite(now):
        has_leapt, since = False, max(now - guard.robot_time[0], 0.)
        for i in range(guard.joints):
            most = LEAP * guard.per_radian[i] + LEAP_SPEED * guard.speed[i] * since
            has_leapt = has_leapt or abs(given[i] - guard.robot[i]) > most
            guard.robot[i] = given[i]
        if has_leapt:
            guard.former_leap_time[0], guard.leap_time[0] = guard.leap_time[0], now
        guard.has_robot[0], guard.robot_time[0] = 1, now


@jit
def refuse_robot(guards: Pack[GuardMemory]) -> None:
    """Take note that the robot's last joint states lack a joint; `guards` is changed."""
    guards[0].robot_fault[0] = LACKS_JOINT


@jit
def lose_hand(guards: Pack[GuardMemory]) -> None:
    """Take note that the hand is not tracked, before its last frame is old; `guards` is changed."""
    guards[0].hand_time[0] = -math.inf


@jit
def observe_wanted(guards: Pack[GuardMemory], given: np.ndarray, now: float) -> bool:
    """Take the position that the person's hand wants; return whether it is followed.

    Parameters
    ----------
    guards : pack of GuardMemory
        Changed.
    given : ndarray, shape (>= n,)
        [rad or m]
    now : float
        Time of receipt [s].
    """
    guard = guards[0]
    if _first_broken(guard, given) != NO_FAULT or not math.isfinite(now):
        guard.refused_values[0] += 1
        return False
    if now - guard.hand_time[0] > guard.hand_timeout:
        guard.gate.has_last[0] = 0
    for i in range(guard.joints):
        guard.inside[i] = min(max(given[i], guard.lower[i]), guard.upper[i])
    if not accepts_position(guard.gate, guard.inside, guard.joints, now):
        # After a jump nobody knows how fast the hand is.
        guard.wanted_time[0] = -math.inf
        return False
    guard.hand_time[0] = now
    since = now - guard.wanted_time[0]
    is_next = guard.has_wanted[0] > 0 and 0. < since <= guard.max_dt
    for i in range(guard.joints):
        moved = guard.inside[i] - guard.wanted[i]
        guard.wanted_velocity[i] = moved / since if is_next else 0.
        guard.wanted[i] = guard.inside[i]
    guard.has_wanted[0], guard.wanted_time[0] = 1, now
    return True


@jit
def start_step(guards: Pack[GuardMemory], now: float) -> float:
    """Note the time of a command; return the time since the last one, at most `max_dt` [s].

    Parameters
    ----------
    guards : pack of GuardMemory
        Changed.
    now : float
        [s]
    """
    guard = guards[0]
    step = min(max(now - guard.command_time[0], 0.), guard.max_dt)
    guard.command_time[0] = max(now, guard.command_time[0])
    return step


@jit
def follow_wanted(guards: Pack[GuardMemory], step: float) -> None:
    """Move the command towards the wanted position; EASING becomes FOLLOWING once it is reached.

    Each joint has to reach it once, not all of them in one frame: of a hand that moves, one or
    another would always be late. None may be a jump away when the speed begins to rise.

    Parameters
    ----------
    guards : pack of GuardMemory
        Changed.
    step : float
        [s]
    """
    guard = guards[0]
    share = 0.
    if guard.state[0] == FOLLOWING:
        share = min((guard.command_time[0] - guard.reached_time[0]) / SPEEDING_UP, 1.)
    ease, most = guard.ease_speed, max(guard.ease_speed, guard.max_speed)
    move_command(guards, guard.wanted, guard.wanted_velocity, ease + share * (most - ease), step)
    may_reach = guard.command_time[0] - guard.return_time[0] >= MIN_EASING
    is_reached = True
    for i in range(guard.joints):
        guard.wanted_velocity[i] = 0.
        away = abs(guard.command[i] - guard.wanted[i])
        if may_reach and away < REACHED * guard.per_radian[i]:
            guard.reached[i] = 1
        is_reached = is_reached and guard.reached[i] > 0 and away <= guard.gate.most[i]
    if guard.state[0] == EASING and is_reached:
        guard.state[0], guard.reached_time[0] = FOLLOWING, guard.command_time[0]


@jit
def move_command(guards: Pack[GuardMemory], goal: np.ndarray, goal_velocity: np.ndarray,
                 speed: float, step: float) -> None:
    """Move the command towards a goal within speed and acceleration, in one time step.

    A goal that moves is met with its own velocity: slowed down to a stop before each of its
    positions, the command would trail it by v / 2a, with v its speed and a the acceleration.

    Parameters
    ----------
    guards : pack of GuardMemory
        Changed.
    goal, goal_velocity : ndarray, shape (>= n,)
        [rad or m, and per second]
    speed : float
        At most [rad/s].
    step : float
        [s]
    """
    guard = guards[0]
    if step <= 0.:
        return
    for i in range(guard.joints):
        command, velocity = guard.command[i], guard.velocity[i]
        acceleration = guard.max_acceleration * guard.per_radian[i]
        slowing = acceleration * step
        most = min(guard.speed[i], speed * guard.per_radian[i])
        ahead = clamp(goal_velocity[i], -most, most)
        away = goal[i] - command - ahead * step
        braked = _braked_speed(away, acceleration, slowing)
        wished = clamp(ahead + clamp(away / step, -braked, braked), -most, most)
        # So that it can still stop within the margin of a limit.
        wished = clamp(wished, -_braked_speed(command - guard.lower[i], acceleration, slowing),
                         _braked_speed(guard.upper[i] - command, acceleration, slowing))
        wished = clamp(wished, velocity - slowing, velocity + slowing)
        wished = clamp(wished, -guard.speed[i], guard.speed[i])
        # A command within the margin of a limit never goes on outwards.
        moved = clamp(command + wished * step, min(guard.lower[i], command),
                        max(guard.upper[i], command))
        guard.velocity[i] = (moved - command) / step
        guard.command[i] = moved


@jit
def _braked_speed(distance: float, acceleration: float, slowing: float) -> float:
    """Return the highest speed from which braking in discrete steps stops within a distance.

    Parameters
    ----------
    distance : float
        Of either sign [rad or m].
    acceleration : float
        At most.
    slowing : float
        Change of speed in a step at most.
    """
    step = slowing / acceleration
    # Number n of whole braking steps that follow: the distance is covered in n + 1 steps.
    following = math.floor(.5 * (math.sqrt(1. + 8. * abs(distance) / (slowing * step)) - 1.))
    return (abs(distance) / step + .5 * slowing * following * (following + 1.)) / (following + 1.)
