"""A frame of the hand to a command: jump gate, retargeting and guard, compiled as one.

`Teleoperation` owns the memory and calls the parts one by one, where anything else happens in
between; a regular frame needs `follow_frame` alone. Both give the same
commands to the bit.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..core.numerics.jit import jit
from ..core.numerics.packs import Pack
from ..core.pose.deviation import mean_confidence
from ..messages.stamps import UNSTAMPED, stands_still
from .guard_kernel import (
    DISENGAGED,
    GUARD_CAPACITY,
    NO_FAULT,
    GuardMemory,
    follow_wanted,
    is_followed,
    lose_hand,
    observe_wanted,
    start_step,
)
from .guard_options import GuardOptions
from .human_hand import JOINT_COUNT, MOST_ANGLE, HumanHand, place_landmarks
from .jump_gate import JumpGate, accepts_position, new_jump_gate
from .retarget_kernel import Problem, Solution, solve_frame

LONGEST_HAND_STEP = .1  # [s] between two frames of the hand that counts
# What `follow_frame` did with a frame
NOT_FOLLOWED, NO_COMMAND, NOT_ENGAGED, COMMANDED = range(4)


class FollowMemory(NamedTuple):
    """State of a robot that follows a hand: jump gate, last frame, map of joints.

    Attributes
    ----------
    gate : JumpGate
        Of the person's angles.
    hand_time : ndarray, shape (1,)
        Of the last frame that was retargeted [s].
    hand_stamp, repeated : ndarray of int, shape (1,)
        Stamp of the last frame [ns], and how many came with the stamp of the one before.
    repeat_time : ndarray, shape (1,)
        When the last of these came [s].
    is_confident : ndarray of int, shape (1,)
    judged_count : ndarray of int, shape (1,)
        Number of messages of deviations by which it was judged.
    min_confidence : float
        `mean_confidence` of the hand below which it counts as lost.
    used : ndarray of int, shape (GUARD_CAPACITY,)
        Row among the solved variables of each of the robot's, -1 for those that move no digit.
    held, wanted : ndarray, shape (GUARD_CAPACITY,)
        Where the robot has its variables; what the hand wants [rad or m].
    commanded : int
        Joints of a command.
    variable : ndarray of int, shape (GUARD_CAPACITY,)
    multiplier, offset : ndarray, shape (GUARD_CAPACITY,)
        Joint of the command = multiplier * variable + offset.
    joints : ndarray, shape (GUARD_CAPACITY,)
        The command's joints [rad or m].
    """

    gate: JumpGate
    hand_time: np.ndarray
    hand_stamp: np.ndarray
    repeated: np.ndarray
    repeat_time: np.ndarray
    is_confident: np.ndarray
    judged_count: np.ndarray
    min_confidence: float
    used: np.ndarray
    held: np.ndarray
    wanted: np.ndarray
    commanded: int
    variable: np.ndarray
    multiplier: np.ndarray
    offset: np.ndarray
    joints: np.ndarray


def new_follow_memory(count: int, used: list[int], held: np.ndarray, rows: tuple[np.ndarray, ...],
                      min_confidence: float, options: GuardOptions) -> FollowMemory:
    """Return the memory of a robot that has followed nothing yet.

    Parameters
    ----------
    count : int
        Variables of the robot, `GUARD_CAPACITY` at most.
    used : list of int
        Those that are solved, in their order.
    held : ndarray, shape (count,)
        Where the others are [rad or m].
    rows : tuple of three ndarrays, shape (m,)
        Variable, multiplier and offset of each joint of a command.
    min_confidence : float
        See `FollowMemory`.
    options : GuardOptions
    """
    def padded(values: np.ndarray, kind: type = float) -> np.ndarray:
        row: np.ndarray = np.zeros(GUARD_CAPACITY, kind)
        row[:len(values)] = values
        return row

    solved = np.full(count, -1)
    solved[used] = np.arange(len(used))
    variable, multiplier, offset = rows
    return FollowMemory(
        new_jump_gate(JOINT_COUNT, options.max_jump, options.jump_frames, options.jump_time),
        np.full(1, -math.inf), np.full(1, UNSTAMPED), np.zeros(1, np.int64),
        np.full(1, -math.inf), np.ones(1, np.int64), np.zeros(1, np.int64), min_confidence,
        padded(solved, np.int64), padded(held), padded(held), len(variable),
        padded(variable, np.int64), padded(multiplier), padded(offset), np.zeros(GUARD_CAPACITY))


@jit
def observe_deviations(memories: Pack[FollowMemory], guards: Pack[GuardMemory],
                       numbers: np.ndarray, unknown: np.ndarray, rows: np.ndarray) -> None:
    """Update the confidence by the deviations of the hand's angles; if it is low, lose the hand.

    Parameters
    ----------
    memories, guards : packs
        Changed.
    numbers, unknown : ndarray
        Standard deviations of the angles, and their prior ones, see `mean_confidence` [rad].
    rows : ndarray of int, shape (25,)
        Those of the hand's angles.
    """
    memory = memories[0]
    memory.is_confident[0] = (
        mean_confidence(numbers, rows, unknown) >= memory.min_confidence)
    memory.judged_count[0] += 1
    if not memory.is_confident[0]:
        lose_hand(guards)


@jit
def accept_angles(memories: Pack[FollowMemory], humans: Pack[HumanHand], stamp: int,
                  now: float) -> float:
    """Return the time since the last frame [s] if the person's angles are accepted, else -1.

    A frame with the stamp of the last one is the same frame again, as of a tracker that hangs: it
    is not taken for a sign of the hand.

    Parameters
    ----------
    memories, humans : packs
        The first is changed.
    stamp : int
        Of the frame [ns]; `UNSTAMPED` for none.
    now : float
        Time of receipt [s].
    """
    memory = memories[0]
    if stands_still(stamp, memory.hand_stamp[0]):
        memory.repeated[0] += 1
        memory.repeat_time[0] = now
        return -1.
    memory.hand_stamp[0] = stamp
    since = now - memory.hand_time[0]
    is_old = since > LONGEST_HAND_STEP
    if is_old:
        memory.gate.has_last[0] = 0
    # Here and not in the guard alone: retargeting would turn a jump into a fast movement.
    if not accepts_position(memory.gate, humans[0].angles[0], JOINT_COUNT, now):
        return -1.
    memory.hand_time[0] = now
    return LONGEST_HAND_STEP if is_old else max(since, 0.)


@jit
def observe_solution(memories: Pack[FollowMemory], solutions: Pack[Solution],
                     guards: Pack[GuardMemory], now: float) -> bool:
    """Give the guard what the solver has found; return whether it is followed.

    Parameters
    ----------
    memories, solutions, guards : packs
        The first and the last are changed.
    now : float
        Time of receipt [s].
    """
    memory, position = memories[0], solutions[0].position
    for i in range(guards[0].joints):
        row = memory.used[i]
        memory.wanted[i] = position[row] if row >= 0 else memory.held[i]
    return observe_wanted(guards, memory.wanted, now)


@jit
def hold_idle(memories: Pack[FollowMemory], guards: Pack[GuardMemory]) -> None:
    """Let joints that move no digit stay where the robot has them, while it is not engaged.

    Parameters
    ----------
    memories, guards : packs
        The first is changed; the second has just taken joint states of the robot.
    """
    memory, guard = memories[0], guards[0]
    if guard.state[0] == DISENGAGED and guard.robot_fault[0] == NO_FAULT:
        for i in range(guard.joints):
            if memory.used[i] < 0:
                memory.held[i] = guard.robot[i]


@jit
def write_joints(memories: Pack[FollowMemory], guards: Pack[GuardMemory]) -> None:
    """Write the joints of the guard's command, mimic joints too."""
    memory, command = memories[0], guards[0].command
    for i in range(memory.commanded):
        memory.joints[i] = (
            memory.multiplier[i] * command[memory.variable[i]] + memory.offset[i])


@jit
def follow_frame(memories: Pack[FollowMemory], humans: Pack[HumanHand], problems: Pack[Problem],
                 solutions: Pack[Solution], guards: Pack[GuardMemory], stamp: int,
                 now: float) -> int:
    """Retarget and guard a frame of the hand while the robot follows, after the jump gate.

    Of a robot that is not engaged the frame is retargeted, so that engaging starts from it.

    Parameters
    ----------
    memories, humans, problems, solutions, guards : packs
        With the person's angles; all but the third are changed.
    stamp : int
        Of the frame [ns]; `UNSTAMPED` for none.
    now : float
        Time of receipt [s].

    Returns
    -------
    int
        `NOT_FOLLOWED`, and nothing has changed, where `Teleoperation` is needed; `COMMANDED`;
        `NOT_ENGAGED`; or `NO_COMMAND`, as after a jump, or of a frame that was there before.
    """
    memory, human = memories[0], humans[0]
    is_engaged = guards[0].state[0] != DISENGAGED
    if not memory.is_confident[0] or (is_engaged and not is_followed(guards[0], now)):
        return NOT_FOLLOWED
    for i in range(JOINT_COUNT):
        # Of NaN this is true, too.
        if not abs(human.angles[0, i]) <= MOST_ANGLE:
            return NOT_FOLLOWED
    step = accept_angles(memories, humans, stamp, now)
    if step < 0.:
        return NO_COMMAND
    place_landmarks(humans)
    # A slice, as numba compiles anew for a record's array what `Retargeter` calls with another.
    solve_frame(problems, solutions, human.landmarks[:], human.angles[0], step)
    if not observe_solution(memories, solutions, guards, now):
        return NO_COMMAND
    if not is_engaged:
        return NOT_ENGAGED
    follow_wanted(guards, start_step(guards, now))
    write_joints(memories, guards)
    return COMMANDED
