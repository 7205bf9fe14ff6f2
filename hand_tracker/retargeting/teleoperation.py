"""From a stream of joint states of a hand to commands for a robot: retarget, then guard. No ROS."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..core.model.hand import JOINTS, SIDES, Hand
from .command_guard import CommandGuard
from .guard_options import GuardOptions
from .jump_gate import JumpGate
from .retarget_problem import used_variables
from .retargeter import Retargeter
from .robot_file import LoadedRobot
from .robot_urdf import InvalidRobot

LONGEST_HAND_STEP = .1  # [s] between two frames of the hand that counts


class Command(NamedTuple):
    """What is sent to the robot.

    Attributes
    ----------
    names : tuple of str
    position : ndarray, shape (len(names),)
        [rad or m]
    """

    names: tuple[str, ...]
    position: np.ndarray


class JointRows:
    """Where joints are in messages whose names hardly ever change.

    Parameters
    ----------
    wanted : sequence of str
    """

    def __init__(self, wanted: Sequence[str]) -> None:
        self._wanted = wanted
        self._names: tuple[str, ...] | None = None
        self._rows = np.zeros(0, dtype=np.int64)

    def find(self, names: Sequence[str]) -> tuple[np.ndarray, bool]:
        """Return the rows of those of the wanted joints that are there, and whether names are new.

        Parameters
        ----------
        names : sequence of str
        """
        names = tuple(names)
        is_new = names != self._names
        if is_new:
            row_of = {name: row for row, name in reversed(list(enumerate(names)))}
            self._names = names
            self._rows = np.array([row_of[name] for name in self._wanted if name in row_of],
                                  dtype=np.int64)
        return self._rows, is_new


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
    order : sequence of str, optional
        Joints of a command, in their order; the robot file's when left out.
    min_confidence : float, optional
        Mean confidence of the hand's angles below which the hand counts as lost.

    Attributes
    ----------
    guard : CommandGuard
    fault : str
        Why the hand or the robot cannot be read, empty where they can.

    Raises
    ------
    InvalidRobot
        If robot and person do not fit, or the order names a joint that there is none of.
    """

    def __init__(self, loaded: LoadedRobot, hand: Hand, prefix: str,
                 options: GuardOptions | None = None, order: Sequence[str] = (),
                 min_confidence: float = 0.) -> None:
        robot, model = loaded.hand, loaded.hand.model
        self._retargeter = Retargeter(robot, hand, loaded.options)
        self._hand_names = [prefix + joint for joint in JOINTS]
        other = f'{SIDES[1 - SIDES.index(hand.side)]}_'
        self._other_names = [other + joint for joint in JOINTS] if other != prefix else []
        self._model = model
        used = used_variables(robot)
        self._idle = [i for i in range(len(model.variables)) if i not in used]
        self.order = tuple(order) or loaded.order
        unknown = [name for name in self.order if name not in model.joint_names]
        if unknown or len(set(self.order)) != len(self.order):
            what = f"there is no movable joint '{unknown[0]}'" if unknown else 'a joint comes twice'
            raise InvalidRobot(f'order: {what}; there are {", ".join(model.joint_names)}')
        self._rows = [model.joint_names.index(name) for name in self.order]
        missing = [model.variables[i] for i in used if model.variables[i] not in self.order]
        if missing:
            raise InvalidRobot(f'order: {", ".join(missing)} missing')
        self.guard = CommandGuard(model.variables, model.lower, model.upper, model.velocity,
                                  robot.rest, options)
        self._gate = JumpGate(self.guard.options.max_jump, self.guard.options.jump_frames)
        self.fault = ''
        self._min_confidence = min_confidence
        self._is_confident = True
        self._hand_time = -math.inf
        self._held = robot.rest.copy()
        self._hand_rows, self._confidence_rows = (JointRows(self._hand_names) for _ in range(2))
        self._robot_rows = JointRows(model.variables)

    @property
    def refused_jumps(self) -> int:
        """Frames of the hand that were not followed, as they jumped."""
        return self._gate.refused + self.guard.refused_jumps

    def prepare(self) -> None:
        """Compile the kernels, so that the first frame does not wait for them."""
        self._retargeter.update_angles(self._retargeter.hand.relaxed(), 0.)
        self._retargeter.reset()

    def observe_hand(self, names: Sequence[str], angles: Sequence[float] | np.ndarray,
                     now: float) -> bool:
        """Take a frame of the hand; return whether it is followed.

        Parameters
        ----------
        names : sequence of str
            Of the joints; another hand's are left out, and named in `fault`.
        angles : sequence of float
            [rad]
        now : float
            Time of receipt [s].
        """
        rows, is_new = self._hand_rows.find(names)
        if is_new:
            self.fault = self._fault_of(names) if len(rows) < len(self._hand_names) else ''
        if self.fault or len(angles) != len(names):
            return False
        given = np.asarray(angles, dtype=float)[rows]
        if not np.isfinite(given).all():
            self.guard.refused_values += 1
            return False
        if not self._is_confident:
            return False
        is_old = now - self._hand_time > LONGEST_HAND_STEP
        if is_old:
            self._gate.forget()
        # Here and not in the guard alone: retargeting would turn a jump into a fast movement.
        if not self._gate.accepts(given):
            self.guard.keep_hand(now)
            return False
        step = LONGEST_HAND_STEP if is_old else max(now - self._hand_time, 0.)
        wanted = self._retargeter.update_angles(given, step)
        self._hand_time = now
        wanted[self._idle] = self._held[self._idle]
        return self.guard.observe_hand(wanted, now)

    def _fault_of(self, names: Sequence[str]) -> str:
        """Return what is wrong with joint states of which some of this hand are missing."""
        if set(names) & set(self._other_names):
            return f'a hand of the other side is refused: {names[0]}'
        missing = next(name for name in self._hand_names if name not in names)
        return f'joint states without {missing}: they are not of this hand'

    def observe_confidence(self, names: Sequence[str], confidence: Sequence[float] | np.ndarray
                           ) -> None:
        """Take the confidence of the hand's angles; where it is low, the hand is lost.

        Parameters
        ----------
        names : sequence of str
        confidence : sequence of float
            0 to 1.
        """
        rows, _ = self._confidence_rows.find(names)
        if not len(rows) or len(confidence) != len(names):
            return
        mean = float(np.asarray(confidence, dtype=float)[rows].mean())
        self._is_confident = mean >= self._min_confidence
        if not self._is_confident:
            self.guard.lose_hand()

    def observe_robot(self, names: Sequence[str], positions: Sequence[float] | np.ndarray,
                      now: float) -> None:
        """Take the robot's joint states; those that lack a joint are left out.

        Parameters
        ----------
        names : sequence of str
        positions : sequence of float
            [rad or m]
        now : float
            Time of receipt [s].
        """
        rows, _ = self._robot_rows.find(names)
        if len(rows) < len(self._model.variables) or len(positions) != len(names):
            return
        given = np.asarray(positions, dtype=float)[rows]
        self.guard.observe_robot(given, now)
        if not self.guard.is_engaged and np.isfinite(given).all():
            # Joints that move no digit stay where the robot has them.
            self._held[self._idle] = given[self._idle]

    def command(self, now: float) -> Command | None:
        """Return what is to be sent now; None for nothing.

        Parameters
        ----------
        now : float
            [s]
        """
        position = self.guard.command(now)
        if position is None:
            return None
        return Command(self.order, self._model.joint_positions(position)[self._rows])
