"""Fast path of a robot: a serialized JointState of the hand to serialized commands, compiled.

The slow path installs what the messages of each topic begin with, and the templates of the
commands; messages that begin so are answered here, with the same commands. No ROS.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ...core.numerics.jit import jit
from ...core.numerics.packs import Pack
from ...messages.cdr import ENCAPSULATION, LITTLE_ENDIAN
from ...messages.joint_states import STAMP_END, JointStateReader
from ...messages.templates import fill_template
from ...retargeting.follow_kernel import (
    COMMANDED,
    NO_COMMAND,
    NOT_FOLLOWED,
    FollowMemory,
    follow_frame,
    hold_idle,
    observe_deviations,
)
from ...retargeting.guard_kernel import (
    GUARD_CAPACITY,
    GuardMemory,
    observe_position,
    refuse_robot,
)
from ...retargeting.human_hand import JOINT_COUNT, HumanHand
from ...retargeting.retarget_kernel import Problem, Solution

HEAD_CAPACITY = 2**14     # [bytes] of what joint states of a publisher begin with
LISTED_CAPACITY = 512     # numbers in a JointState
MOST_FOREIGN = 4          # layouts of other publishers of a topic, as of an arm
MOST_COMMANDS = 4         # messages of a command, one of them for those who show the robot
COMMAND_CAPACITY = 2**15  # [bytes] of such a message
# Arguments of `follow_frame` before the stamp.
FollowPacks = tuple[Pack[FollowMemory], Pack[HumanHand], Pack[Problem], Pack[Solution],
                    Pack[GuardMemory]]


class ListedNumbers(NamedTuple):
    """Layout of a publisher's JointStates, and those of others on its topic.

    Attributes
    ----------
    head : ndarray of uint8, shape (HEAD_CAPACITY,)
        From the frame's name to the number of positions.
    size, listed : ndarray of int, shape (1,)
        Bytes of the head, 0 where none is installed; positions.
    rows : ndarray of int, shape (GUARD_CAPACITY,)
        Which of the positions count, in the order of whoever reads them; -1 for one that is not
        there.
    used : ndarray of int, shape (1,)
        How many of them.
    numbers, effort : ndarray, shape (LISTED_CAPACITY,)
        Positions of the last message, and efforts where they count, aligned.
    foreign : ndarray of uint8, shape (MOST_FOREIGN, HEAD_CAPACITY)
        Heads of messages that do not count.
    foreign_sizes : ndarray of int, shape (MOST_FOREIGN,)
        Bytes of each, 0 for none.
    """

    head: np.ndarray
    size: np.ndarray
    listed: np.ndarray
    rows: np.ndarray
    used: np.ndarray
    numbers: np.ndarray
    effort: np.ndarray
    foreign: np.ndarray
    foreign_sizes: np.ndarray


class CommandMemory(NamedTuple):
    """Memory of a robot's fast path.

    Attributes
    ----------
    hand, deviations, robot : ListedNumbers
    position : ndarray, shape (GUARD_CAPACITY,)
        Workspace.
    replies, stamps_at, numbers_at, stamps
        See `FastPathMemory`; of `MOST_COMMANDS` messages.
    wanted : ndarray of int, shape (MOST_COMMANDS,)
        Whether each message is sent.
    served_time : ndarray, shape (1,)
        Of the last frame that was answered by a command, or while not engaged retargeted [s].
    frames : ndarray of int, shape (1,)
        Frames processed so far.
    """

    hand: ListedNumbers
    deviations: ListedNumbers
    robot: ListedNumbers
    position: np.ndarray
    replies: np.ndarray
    stamps_at: np.ndarray
    numbers_at: np.ndarray
    stamps: np.ndarray
    wanted: np.ndarray
    served_time: np.ndarray
    frames: np.ndarray


def new_command_memory() -> CommandMemory:
    """Return a `CommandMemory` with nothing installed."""
    def one() -> np.ndarray:
        return np.zeros(1, np.int64)

    def listed() -> ListedNumbers:
        return ListedNumbers(
            np.zeros(HEAD_CAPACITY, np.uint8), one(), one(), np.zeros(GUARD_CAPACITY, np.int64),
            one(), np.zeros(LISTED_CAPACITY), np.zeros(LISTED_CAPACITY),
            np.zeros((MOST_FOREIGN, HEAD_CAPACITY), np.uint8), np.zeros(MOST_FOREIGN, np.int64))

    return CommandMemory(
        hand=listed(), deviations=listed(), robot=listed(), position=np.zeros(GUARD_CAPACITY),
        replies=np.zeros((MOST_COMMANDS, COMMAND_CAPACITY // 8)),
        stamps_at=np.zeros((MOST_COMMANDS, 1), np.int64),
        numbers_at=np.zeros((MOST_COMMANDS, GUARD_CAPACITY), np.int64),
        stamps=np.zeros(MOST_COMMANDS, np.int64), wanted=np.zeros(MOST_COMMANDS, np.int64),
        served_time=np.full(1, -math.inf), frames=one())


def install_numbers(listed: ListedNumbers, reader: JointStateReader, rows: np.ndarray) -> bool:
    """Install the layout that a reader has met last; return whether it fits.

    Parameters
    ----------
    listed : ListedNumbers
        Changed; that of a message that does not count is installed as foreign.
    reader : JointStateReader
    rows : ndarray of int, shape (n,)
        Which of the positions count; none of a message that does not.
    """
    head = reader.head
    if not head or len(head) > HEAD_CAPACITY:
        return False
    if not len(rows):
        _install_foreign(listed, np.frombuffer(head, np.uint8))
        return False
    listed.size[0] = 0
    if not reader.is_complete or reader.count > LISTED_CAPACITY:
        return False
    listed.head[:len(head)] = np.frombuffer(head, np.uint8)
    listed.size[0], listed.listed[0] = len(head), reader.count
    listed.rows[:len(rows)], listed.used[0] = rows, len(rows)
    return True


def _install_foreign(listed: ListedNumbers, head: np.ndarray) -> None:
    """Install the head of messages that do not count, if it is new, in place of the oldest.

    Parameters
    ----------
    listed : ListedNumbers
        Changed.
    head : ndarray of uint8, shape (n,)
        `HEAD_CAPACITY` bytes at most.
    """
    size = len(head)
    if any(known == size and np.array_equal(other[:size], head)
           for known, other in zip(listed.foreign_sizes, listed.foreign)):
        return
    listed.foreign[1:], listed.foreign_sizes[1:] = (
        listed.foreign[:-1].copy(), listed.foreign_sizes[:-1].copy())
    listed.foreign[0, :size], listed.foreign_sizes[0] = head, size


@jit
def _has_head(octets: np.ndarray, head: np.ndarray, size: int) -> bool:
    """Return whether a message is a little-endian JointState with a head of some bytes."""
    if size == 0 or len(octets) < STAMP_END + size:
        return False
    if octets[0] != LITTLE_ENDIAN[0] or octets[1] != LITTLE_ENDIAN[1]:
        return False
    for i in range(size):
        if octets[STAMP_END + i] != head[i]:
            return False
    return True


@jit
def _is_foreign(listed: ListedNumbers, octets: np.ndarray) -> bool:
    """Return whether a message has one of the layouts that do not count."""
    for i in range(MOST_FOREIGN):
        if _has_head(octets, listed.foreign[i], listed.foreign_sizes[i]):
            return True
    return False


@jit
def _read_numbers(listed: ListedNumbers, octets: np.ndarray) -> bool:
    """Read the positions of a JointState; return whether it has the installed layout.

    Parameters
    ----------
    listed : ListedNumbers
        Changed.
    octets : ndarray of uint8, shape (n,)
        The message.
    """
    count, start = listed.listed[0], _numbers_at(listed)
    if not _has_head(octets, listed.head, listed.size[0]) or len(octets) < start + 8 * count:
        return False
    copied = listed.numbers.view(np.uint8)
    for i in range(8 * count):
        copied[i] = octets[start + i]
    return True


@jit
def _numbers_at(listed: ListedNumbers) -> int:
    """Return where the positions of a JointState begin."""
    end = STAMP_END + listed.size[0]
    return end + (ENCAPSULATION - end) % 8


@jit
def _read_effort(listed: ListedNumbers, octets: np.ndarray) -> bool:
    """Read the efforts behind the positions; return whether there are as many, and no velocities.

    Parameters
    ----------
    listed : ListedNumbers
        Whose positions have been read; changed.
    octets : ndarray of uint8, shape (n,)
        The message.
    """
    count = listed.listed[0]
    end = _numbers_at(listed) + 8 * count
    if len(octets) < end + 8 + 8 * count or count == 0:
        return False
    if _word(octets, end) != 0 or _word(octets, end + 4) != count:
        return False
    copied = listed.effort.view(np.uint8)
    for i in range(8 * count):
        copied[i] = octets[end + 8 + i]
    return True


@jit
def process_deviations(commands: Pack[CommandMemory], follows: Pack[FollowMemory],
                       guards: Pack[GuardMemory], octets: np.ndarray) -> bool:
    """Take a message with the deviations of the hand's angles; return whether it was processed.

    Parameters
    ----------
    commands, follows, guards : packs
        Of CommandMemory, FollowMemory and GuardMemory; changed.
    octets : ndarray of uint8, shape (n,)
        The message.
    """
    listed = commands[0].deviations
    if not _read_numbers(listed, octets) or not _read_effort(listed, octets):
        return _is_foreign(listed, octets)
    observe_deviations(
        follows, guards, listed.numbers, listed.effort, listed.rows[:listed.used[0]])
    return True


@jit
def process_position(commands: Pack[CommandMemory], follows: Pack[FollowMemory],
                     guards: Pack[GuardMemory], octets: np.ndarray, now: float) -> bool:
    """Take a message with the robot's joint states; return whether it was processed.

    Parameters
    ----------
    commands, follows, guards : packs
        Of CommandMemory, FollowMemory and GuardMemory; changed.
    octets : ndarray of uint8, shape (n,)
        The message.
    now : float
        Time of receipt [s].
    """
    command = commands[0]
    listed = command.robot
    if not _read_numbers(listed, octets):
        is_foreign = _is_foreign(listed, octets)
        if is_foreign:
            refuse_robot(guards)
        return is_foreign
    for i in range(listed.used[0]):
        row = listed.rows[i]
        command.position[i] = listed.numbers[row] if row >= 0 else guards[0].robot[i]
    observe_position(guards, command.position, _stamp(octets), now)
    hold_idle(follows, guards)
    return True


@jit
def process_hand(commands: Pack[CommandMemory], packs: FollowPacks, octets: np.ndarray,
                 now: float) -> int:
    """Follow a message with the joint states of the hand, and fill the commands.

    Parameters
    ----------
    commands : pack of CommandMemory
        Changed.
    packs : FollowPacks
        Changed.
    octets : ndarray of uint8, shape (n,)
        The message.
    now : float
        Time of receipt [s].

    Returns
    -------
    int
        As `follow_frame`; `NO_COMMAND` also of a foreign layout, `NOT_FOLLOWED` of an unknown one.
    """
    command = commands[0]
    follows, humans, problems, solutions, guards = packs
    listed = command.hand
    if not _read_numbers(listed, octets):
        return NO_COMMAND if _is_foreign(listed, octets) else NOT_FOLLOWED
    human = humans[0]
    for i in range(JOINT_COUNT):
        human.angles[0, i] = listed.numbers[listed.rows[i]]
    done = follow_frame(follows, humans, problems, solutions, guards, _stamp(octets), now)
    if done == NOT_FOLLOWED:
        return NOT_FOLLOWED
    command.frames[0] += 1
    if done != NO_COMMAND:
        command.served_time[0] = now
    if done == COMMANDED:
        sec, nanosec = _word(octets, ENCAPSULATION), _word(octets, ENCAPSULATION + 4)
        follow = follows[0]
        for number in range(MOST_COMMANDS):
            if command.wanted[number]:
                doubles = command.replies[number]
                fill_template(
                    doubles.view(np.uint32), doubles,
                    command.stamps_at[number, :command.stamps[number]],
                    command.numbers_at[number, :follow.commanded], sec, nanosec, follow.joints)
    return done


@jit
def _stamp(octets: np.ndarray) -> int:
    """Return the stamp of a message with a header [ns]."""
    return _word(octets, ENCAPSULATION) * 1_000_000_000 + _word(octets, ENCAPSULATION + 4)


@jit
def _word(octets: np.ndarray, at: int) -> int:
    """Return the number of four bytes, little-endian."""
    word = 0
    for i in range(4):
        word |= np.int64(octets[at + i]) << (8 * i)
    return word
