"""From a stream of joint states of a hand to commands for a robot: retarget, then guard. No ROS."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ..core.model.hand import JOINTS, OTHER_SIDE, Hand
from ..core.numerics.packs import Pack, packed
from ..messages.stamps import UNSTAMPED, stands_still
from .command_guard import CommandGuard
from .follow_kernel import (
    accept_angles,
    follow_frame,
    hold_idle,
    new_follow_memory,
    observe_deviations,
    observe_solution,
    write_joints,
)
from .guard_kernel import GUARD_CAPACITY, lose_hand, refuse_robot
from .guard_options import GuardOptions
from .human_hand import are_joint_angles
from .retargeter import Retargeter
from .robot_file import LoadedRobot
from .robot_urdf import InvalidRobot


class Command(NamedTuple):
    """Joint command for the robot.

    Attributes
    ----------
    names : tuple of str
    position : ndarray, shape (len(names),)
        [rad or m]
    """

    names: tuple[str, ...]
    position: np.ndarray


class JointRows:
    """Rows of wanted joints in JointStates, cached by the names of the last one.

    Parameters
    ----------
    wanted : sequence of str

    Attributes
    ----------
    rows : ndarray of int, shape (len(wanted),)
        The last result of `find`.
    """

    def __init__(self, wanted: Sequence[str]) -> None:
        self._wanted = wanted
        self._names: tuple[str, ...] | None = None
        self.rows = np.full(len(wanted), -1)

    def find(self, names: Sequence[str]) -> tuple[np.ndarray, bool]:
        """Return the rows of the wanted joints, -1 where one is missing, and whether names are new.

        Parameters
        ----------
        names : sequence of str
        """
        names = tuple(names)
        is_new = names != self._names
        if is_new:
            row_of = {name: row for row, name in reversed(list(enumerate(names)))}
            self._names = names
            self.rows = np.array([row_of.get(name, -1) for name in self._wanted], dtype=np.int64)
        return self.rows, is_new


class Teleoperation:
    """Drive one robot hand by one human hand.

    Times come from a clock that never jumps [s].

    Parameters
    ----------
    loaded : LoadedRobot
    hand : Hand
        The person's.
    prefix : str
        Of the hand's joints, such as 'right_'.
    options : GuardOptions, optional
    min_confidence : float, optional
        `mean_confidence` of the hand below which it counts as lost.

    Attributes
    ----------
    guard : CommandGuard
    fault : str
        Why the hand or the robot cannot be read, empty where they can.

    Raises
    ------
    InvalidRobot
        If robot and person do not fit, or the order of commands lacks a joint that moves a digit.
    """

    def __init__(self, loaded: LoadedRobot, hand: Hand, prefix: str,
                 options: GuardOptions | None = None, min_confidence: float = 0.) -> None:
        robot, model = loaded.hand, loaded.hand.model
        self._retargeter = Retargeter(robot, hand, loaded.options)
        self._hand_names = [prefix + joint for joint in JOINTS]
        other = f'{OTHER_SIDE[hand.side]}_'
        self._other_names = [other + joint for joint in JOINTS] if other != prefix else []
        self._model = model
        used = robot.digit_variables
        self.order = loaded.order
        if max(len(model.variables), len(self.order)) > GUARD_CAPACITY:
            raise InvalidRobot(f'{len(model.variables)} independent joints; at most '
                               f'{GUARD_CAPACITY} are supported')
        missing = [model.variables[i] for i in used if model.variables[i] not in self.order]
        if missing:
            raise InvalidRobot(f'order: {", ".join(missing)} missing')
        self.guard = CommandGuard(model.variables, model.lower, model.upper, model.velocity,
                                  robot.rest, options, model.per_radian)
        self.fault = ''
        self._named_time = -math.inf  # of the last joint states of this hand
        rows = [model.joint_names.index(name) for name in self.order]
        self._ordered_rows = rows
        self._pack, self._memory = packed(new_follow_memory(
            len(model.variables), used, robot.rest,
            (model.joints.variable[rows], model.joints.multiplier[rows],
             model.joints.offset[rows]), min_confidence, self.guard.options))
        self._hand_rows, self._deviation_rows = (JointRows(self._hand_names) for _ in range(2))
        # Where the others are, as those of an arm, another driver knows.
        self._needed = np.isin(np.arange(len(model.variables)), model.joints.variable[rows])
        self._robot_rows = JointRows([name if needed else '' for name, needed in zip(
            model.variables, self._needed)])
        self._lacking = ''
        self._refused_time = -math.inf  # of angles that are none
        self._lacks_unknown = False     # the last message of deviations

    def why_lost(self, now: float) -> str:
        """Return why a hand counts as lost though its joint states come, in words, or nothing.

        Parameters
        ----------
        now : float
            [s]
        """
        timeout, repeat_time = self.guard.options.hand_timeout, self._memory.repeat_time[0]
        if repeat_time > self._memory.hand_time[0] and now - repeat_time <= timeout:
            return 'its joint states have the same stamp again and again'
        if not now - self._named_time <= timeout:
            return ''
        if not self._memory.is_confident[0]:
            return ('joint_confidence has no effort, by which to judge it' if self._lacks_unknown
                    else 'too little is known of it (joint_confidence, min_confidence)')
        if self._refused_time > self._memory.hand_time[0]:
            return 'its angles are not finite, or beyond a full turn (degrees?)'
        return ''

    @property
    def refused_jumps(self) -> int:
        """Frames of the hand that were not followed, as they jumped."""
        return int(self._memory.gate.refused[0]) + self.guard.refused_jumps

    @property
    def repeated_frames(self) -> int:
        """Frames of the hand that were not followed, as they had the stamp of the one before."""
        return int(self._memory.repeated[0])

    @property
    def judged_count(self) -> int:
        """Number of messages of deviations by which it was judged whether enough is known."""
        return int(self._memory.judged_count[0])

    @property
    def packs(self) -> tuple[Pack[Any], ...]:
        """The arguments of `follow_frame` before the stamp."""
        return self._pack, *self._retargeter.packs, self.guard.pack

    @property
    def is_regular(self) -> bool:
        """Whether the next frame may be given to `follow_frame`, which looks at the rest."""
        return (not self._retargeter.is_first and not self.fault
                and (self.guard.is_following or not self.guard.is_engaged))

    @property
    def rows(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rows of the hand, its deviations and the robot in their last joint states.

        Of the robot -1 for a joint that is not commanded; none of a message that does not count.
        """
        hand, deviations, robot = (
            self._hand_rows.rows, self._deviation_rows.rows, self._robot_rows.rows)
        return (_rows_if(hand.min() >= 0, hand), _rows_if(deviations.min() >= 0, deviations),
                _rows_if(robot[self._needed].min() >= 0, robot))

    def observe_hand(self, names: Sequence[str], angles: Sequence[float] | np.ndarray,
                     now: float, stamp: int = UNSTAMPED) -> bool:
        """Take a frame of the hand; return whether it is followed.

        Parameters
        ----------
        names : sequence of str
            Of the joints; another hand's are left out, and named in `fault`.
        angles : sequence of float
            [rad]
        now : float
            Time of receipt [s].
        stamp : int, optional
            Of the frame [ns]; one with the stamp of the last is no new one.
        """
        self.guard.judge_ages(now)
        rows, _ = self._hand_rows.find(names)
        if rows.min() < 0:
            # Others, as an arm, may share the topic with the hand while it is there.
            since = now - max(self._named_time, self._memory.hand_time[0])
            if since > self.guard.options.hand_timeout and not self.fault:
                self.fault = self._fault_of(names)
            return False
        self.fault, self._named_time = '', now
        if len(angles) != len(names):
            return False
        given = np.asarray(angles, dtype=float)[rows]
        if not are_joint_angles(given):
            self.guard.refuse_values()
            self._refused_time = now
            return False
        if not self._memory.is_confident[0]:
            return False
        self._retargeter.human.angles[0] = given
        human, _, solution = self._retargeter.packs
        step = accept_angles(self._pack, human, stamp, now)
        if step < 0.:
            return False
        self._retargeter.update_angles(given, step)
        return bool(observe_solution(self._pack, solution, self.guard.pack, now))

    def _fault_of(self, names: Sequence[str]) -> str:
        """Return the fault of joint states that lack joints of this hand, in words."""
        if set(names) & set(self._other_names):
            return f'a hand of the other side is refused: {names[0]}'
        missing = next(name for name in self._hand_names if name not in names)
        return f'joint states without {missing}: they are not of this hand'

    def observe_deviations(self, names: Sequence[str], deviations: Sequence[float] | np.ndarray,
                           unknown: Sequence[float] | np.ndarray) -> None:
        """Update the confidence by the deviations of the angles; if it is low, lose the hand.

        Parameters
        ----------
        names : sequence of str
        deviations : sequence of float
            [rad]
        unknown : sequence of float
            Prior deviations of the angles; with another length the confidence is 0 [rad].
        """
        rows, _ = self._deviation_rows.find(names)
        if rows.min() < 0 or len(deviations) != len(names):
            return
        self._lacks_unknown = len(unknown) != len(names)
        most = (np.full(len(names), np.nan) if self._lacks_unknown
                else np.array(unknown, dtype=float))
        observe_deviations(
            self._pack, self.guard.pack, np.array(deviations, dtype=float), most, rows)

    def observe_robot(self, names: Sequence[str], positions: Sequence[float] | np.ndarray,
                      now: float, stamp: int = UNSTAMPED) -> None:
        """Take the robot's joint states; those that lack a commanded joint are left out.

        Parameters
        ----------
        names : sequence of str
        positions : sequence of float
            [rad or m]
        now : float
            Time of receipt [s].
        stamp : int, optional
            Of the message [ns]; one with the stamp of the last is no new one.
        """
        rows, is_new = self._robot_rows.find(names)
        if is_new:
            self._lacking = next(
                (name for name, needed, row in zip(self._model.variables, self._needed, rows)
                 if needed and row < 0), '')
        lacking = self._lacking or ('' if len(positions) == len(names) else 'positions')
        if lacking:
            self.guard.refuse_robot(lacking)
            return
        there = rows >= 0
        given = self.guard.robot
        given[there] = np.asarray(positions, dtype=float)[rows[there]]
        self.guard.observe_robot(given, now, stamp)
        hold_idle(self._pack, self.guard.pack)

    def command(self, now: float) -> Command | None:
        """Return the command to send now; None where none is to be sent.

        Parameters
        ----------
        now : float
            [s]
        """
        if self.guard.command(now) is None:
            return None
        write_joints(self._pack, self.guard.pack)
        return Command(self.order, self._memory.joints[:len(self.order)].copy())

    @property
    def present(self) -> np.ndarray:
        """Where the joints of a command are, by `CommandGuard.present`, shape (len(order),)."""
        return self._model.joint_positions(self.guard.present)[self._ordered_rows]


def _rows_if(counts: bool, rows: np.ndarray) -> np.ndarray:
    """Return rows if they count, else none."""
    return rows if counts else np.zeros(0, dtype=np.int64)


def compile_following(loaded: LoadedRobot, hand: Hand) -> None:
    """Compile the kernels of all states, so that no frame waits for them.

    Parameters
    ----------
    loaded : LoadedRobot
    hand : Hand
        Of the robot's side.
    """
    one = Teleoperation(loaded, hand, '', GuardOptions(require_robot_state=False))
    angles = hand.relaxed()
    one.observe_hand(JOINTS, angles, 0.)
    one.guard.engage(0.)
    one.command(0.)
    one.observe_hand(JOINTS, angles + 10., 0.)
    memory, human, problem, solution, guard = one.packs
    follow_frame(memory, human, problem, solution, guard, UNSTAMPED, 0.)
    one.observe_deviations(JOINTS, angles, angles)
    one.observe_robot(loaded.hand.model.variables, loaded.hand.rest, 0.)
    refuse_robot(one.guard.pack)
    lose_hand(one.guard.pack)
    stands_still(UNSTAMPED, UNSTAMPED)
    one.command(0.)
