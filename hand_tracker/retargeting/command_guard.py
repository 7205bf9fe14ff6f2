"""The guard of a robot's commands: the one owner of whether and how fast the robot may move.

States and what changes them:

    disengaged ─ engage, press ─▶ easing ─ pose reached ─▶ following
    easing, following ─ hand lost ─▶ holding ─ hand back ─▶ easing
    holding ─ still lost ─▶ disengaged, or, by option, relaxing ─ at rest ─▶ disengaged
    relaxing ─ engage, press ─▶ easing
    any ─ disengage, deadman released, no joint states of the robot ─▶ disengaged

Whoever engages it by the deadman holds it by that: silence is a release, as after each press.
A deadman that is pressed on as the robot is disengaged, or relaxes, has to be released before it
engages again, and a request that is repeated on and on has to pause. Nothing is sent while
disengaged. Every command follows from the last one that was sent, or, after engaging and after a
silence (`on_lost` stop), from where the robot is, by what came last, its joint states or a command:
within limits, speed and acceleration, whatever comes in.
"""

from __future__ import annotations

import enum
import math

import numpy as np
from numpy.typing import ArrayLike

from ..core.numerics.packs import Pack, packed
from ..messages.stamps import UNSTAMPED
from .guard_kernel import (
    LACKS_JOINT,
    NO_FAULT,
    SAME_STAMP,
    GuardMemory,
    follow_wanted,
    move_command,
    new_guard_memory,
    observe_position,
    refuse_robot,
    start_step,
)
from .guard_options import GuardOptions

# Reasons of `CommandGuard` that a frame of the hand ends
NO_HAND, WAS_LOST = 'there is no hand to follow', 'the hand was lost: engage again'
ROBOT_MISSING = "the robot's joint states are missing"  # what such a reason begins with
AT_REST = 1e-3         # [rad] from the rest position
MOVED_BY_OTHERS = .1   # [rad] of a robot that others have moved meanwhile
REQUEST_PAUSE = 3.     # [s] after which a request is no repetition: `ros2 topic pub` has 1 Hz
REPEATED = (f'it was asked for less than {REQUEST_PAUSE:g} s before: a request that is repeated '
            'undoes no stop')
LEAPING_TIME = 1.      # [s] in which two leaps of the robot's joint states contradict each other


class GuardState(enum.Enum):
    """Whether the robot moves; in the order of their numbers in `guard_kernel`."""

    DISENGAGED = 'disengaged'
    EASING = 'easing'
    FOLLOWING = 'following'
    HOLDING = 'holding'
    RELAXING = 'relaxing'


STATES = tuple(GuardState)


class CommandGuard:
    """Turn wanted positions into commands that are safe to send.

    Times come from a clock that never jumps [s].

    Parameters
    ----------
    names : sequence of str
        Of the n joints, for messages.
    lower, upper : array_like, shape (n,)
        The URDF's limits [rad or m].
    speed : array_like, shape (n,)
        The URDF's limits of speed; 0 where it has none.
    rest : array_like, shape (n,)
        Rest position.
    options : GuardOptions, optional
    per_radian : array_like, shape (n,), optional
        What counts as a radian of each joint in the options: a length where it slides [m].

    Attributes
    ----------
    memory : GuardMemory
        Its numbers.
    pack : pack of GuardMemory
        The same, for kernels.
    """

    def __init__(self, names: tuple[str, ...], lower: ArrayLike, upper: ArrayLike,
                 speed: ArrayLike, rest: ArrayLike, options: GuardOptions | None = None,
                 per_radian: ArrayLike = 1.) -> None:
        self.options = options or GuardOptions()
        self._names = names
        self._lower, self._upper = np.array(lower, dtype=float), np.array(upper, dtype=float)
        self._per_radian = np.broadcast_to(np.array(per_radian, dtype=float), self._lower.shape)
        margin = np.minimum(self.options.limit_margin * self._per_radian,
                            .25 * (self._upper - self._lower))
        self._inner = self._lower + margin, self._upper - margin
        given = np.array(speed, dtype=float)
        most = self.options.max_speed * self._per_radian
        most = np.where(given > 0., np.minimum(given, most), most)
        self._rest = np.clip(np.array(rest, dtype=float), *self._inner)
        self.pack: Pack[GuardMemory]
        self.memory: GuardMemory
        self.pack, self.memory = packed(new_guard_memory(
            *self._inner, most, self._per_radian, self.options))
        self._command[:] = self._rest
        self.memory.robot[:self.memory.joints] = self._rest
        self._reason = 'nobody has engaged it yet'
        self._lost_time = -math.inf
        self._must_release = self._must_ask_anew = False
        self._request_time = -math.inf
        self._held_at = self.robot      # as the stream of commands stopped
        self._judged_time = self._resumed_time = -math.inf
        self._lacking = ''

    @property
    def state(self) -> GuardState:
        """Whether the robot moves."""
        return STATES[int(self.memory.state[0])]

    @property
    def reason(self) -> str:
        """Why it is in this state, for a person."""
        # The kernels begin to follow without a word.
        return 'as the hand moves' if self.state is GuardState.FOLLOWING else self._reason

    @property
    def is_engaged(self) -> bool:
        """Whether commands are made."""
        return self.state is not GuardState.DISENGAGED

    @property
    def refused_jumps(self) -> int:
        """Frames that were not followed, as they jumped."""
        return int(self.memory.gate.refused[0])

    @property
    def refused_values(self) -> int:
        """Frames that were not followed: not finite, or of angles beyond a full turn."""
        return int(self.memory.refused_values[0])

    @property
    def _command(self) -> np.ndarray:
        return self.memory.command[:self.memory.joints]

    @property
    def present(self) -> np.ndarray:
        """Where the robot is, shape (n,) [rad or m]: as commanded, or by its joint states.

        Not engaged and without joint states it is where it was left, at first at rest.
        """
        at_robot = not self.is_engaged and self.memory.has_robot[0]
        return (self.memory.robot if at_robot else self.memory.command)[:self.memory.joints].copy()

    @property
    def robot(self) -> np.ndarray:
        """Where the robot was last by its joint states, at first at rest, shape (n,) [rad or m]."""
        return self.memory.robot[:self.memory.joints].copy()

    @property
    def is_following(self) -> bool:
        """Whether commands lead to the person's pose."""
        return self.state in (GuardState.EASING, GuardState.FOLLOWING)

    def observe_robot(self, position: ArrayLike, now: float, stamp: int = UNSTAMPED) -> None:
        """Take the robot's joint states; what is not finite, or not new, is left out.

        Parameters
        ----------
        position : array_like, shape (n,)
            [rad or m]
        now : float
            Time of receipt [s].
        stamp : int, optional
            Of the message [ns]; one with the stamp of the last is no new one.
        """
        given = np.array(position, dtype=float)
        if given.shape == self._rest.shape:
            observe_position(self.pack, given, stamp, now)

    def farthest_from_command(self, now: float) -> tuple[str, float]:
        """Return the joint that is farthest from its command by its last states, and how far.

        Parameters
        ----------
        now : float
            [s]

        Returns
        -------
        name : str
        off : float
            0 while no commands lead to the hand, or no joint states come [rad, or where it slides
            in shares of what counts as one].
        """
        if not (self.is_following and self._has_recent_robot(now)):
            return '', 0.
        off = np.abs(self.robot - self._command) / self._per_radian
        joint = int(off.argmax())
        return self._names[joint], float(off[joint])

    def refuse_robot(self, lacking: str) -> None:
        """Take note that the robot's last joint states lack a joint, for messages."""
        self._lacking = lacking
        refuse_robot(self.pack)

    def refuse_values(self) -> None:
        """Count a frame that is not followed, by its values."""
        self.memory.refused_values[0] += 1

    def engage(self, now: float) -> str:
        """Let the robot move from where it is; return why not, or nothing.

        Parameters
        ----------
        now : float
            [s]
        """
        is_needed = not self.is_engaged or self.state is GuardState.RELAXING
        reason = self._start(now)
        if is_needed and not reason and not self.options.hold_to_engage:
            # No deadman holds the robot before one is pressed.
            self.memory.hold_timeout[0] = math.inf
        return reason

    def _start(self, now: float) -> str:
        """Engage, whoever asks for it; return why not, or nothing."""
        if self.is_engaged and self.state is not GuardState.RELAXING:
            return ''
        if missing := self.missing(now):
            self._reason = missing
            return missing
        if self.state is GuardState.RELAXING:
            self._go(GuardState.EASING, 'the hand is back, and it was engaged anew')
            return ''
        self._begin_at(self._start_position(now), now)
        self._go(GuardState.EASING, "moving slowly to the person's pose")
        return ''

    def request(self, now: float) -> str:
        """Engage by a request that may be repeated, as on a topic; return why not, or nothing.

        Repeated on and on, it does not undo what has disengaged the robot, or lets it relax.

        Parameters
        ----------
        now : float
            [s]
        """
        self.judge_ages(now)
        is_repeated = now - max(self._request_time, self._resumed_time) < REQUEST_PAUSE
        self._request_time = now
        if self._must_ask_anew and is_repeated:
            self._reason = REPEATED
            return REPEATED
        return self.engage(now)

    def _has_recent_robot(self, now: float) -> bool:
        """Return whether joint states of the robot came within `robot_timeout`."""
        return not now - self.memory.robot_time[0] > self.options.robot_timeout

    def _start_position(self, now: float) -> np.ndarray:
        """Return where the robot is, by what came last: its joint states or a command."""
        memory = self.memory
        if self._has_recent_robot(now) and memory.robot_time[0] >= memory.command_time[0]:
            return self.robot
        # It goes on to the last command, where nobody moves it otherwise.
        return self._command

    def _start_fault(self, now: float) -> str:
        """Return why the robot's joint states, where there are some, are no start, or nothing."""
        if not self._has_recent_robot(now):
            return ''
        if now - self.memory.former_leap_time[0] < LEAPING_TIME:
            return "the robot's joint states leap to and fro, as of two publishers"
        start = self.robot
        beyond = np.maximum(self._lower - start, start - self._upper) / self._per_radian
        if beyond.max() > self.options.outside_limits:
            joint = int(beyond.argmax())
            return (f'{self._names[joint]} is at {start[joint]:.3f}, outside its limits '
                    f'{self._lower[joint]:.3f} to {self._upper[joint]:.3f}: move it within them, '
                    'or raise safety.outside_limits')
        return ''

    def _end_silence(self, now: float) -> bool:
        """Let commands begin again after the stream was stopped; return whether they may."""
        if self.options.on_lost != 'stop':
            return True
        moved = (np.abs(self.robot - self._held_at) / self._per_radian).max()
        is_elsewhere = moved > MOVED_BY_OTHERS and self._has_recent_robot(now)
        if is_elsewhere and (fault := self._start_fault(now)):
            self.disengage(fault)
            return False
        self._begin_at(self.robot if is_elsewhere else self._command, now)
        return True

    def _begin_at(self, position: np.ndarray, now: float) -> None:
        """Let the next command follow from where the robot is, at rest."""
        self._command[:] = np.clip(position, self._lower, self._upper)
        self.memory.velocity[:] = 0.
        self.memory.command_time[0] = max(now, float(self.memory.command_time[0]))

    def has_hand(self, now: float) -> bool:
        """Return whether a frame of the hand came within `hand_timeout`.

        Parameters
        ----------
        now : float
            [s]
        """
        return not now - self.memory.hand_time[0] > self.memory.hand_timeout

    def missing(self, now: float) -> str:
        """Return what is missing to engage the robot, or nothing.

        Parameters
        ----------
        now : float
            [s]
        """
        memory = self.memory
        if self.options.hold_to_engage and now - memory.press_time[0] > memory.hold_timeout[0]:
            return 'the deadman is not pressed (hold_to_engage)'
        if not memory.has_wanted[0] or not self.has_hand(now):
            return NO_HAND
        if self.state is GuardState.RELAXING:
            return ''
        if self.options.require_robot_state and not self._has_recent_robot(now):
            kind = 'old' if memory.robot_fault[0] in (NO_FAULT, LACKS_JOINT) else 'of no use'
            return f'{ROBOT_MISSING} or {kind}{self._robot_fault()}'
        return self._start_fault(now)

    def _robot_fault(self) -> str:
        """Return the fault of the robot's last joint states after a colon, or nothing."""
        fault = int(self.memory.robot_fault[0])
        if fault == LACKS_JOINT:
            return f': they lack {self._lacking}'
        if fault == SAME_STAMP:
            return ': they have the same stamp again and again'
        return '' if fault == NO_FAULT else f': {self._names[fault]} is not finite'

    def press(self, now: float) -> str:
        """Press the deadman, which also engages; return why not, or nothing.

        From then on it holds the robot: silence is a release. Pressed on and on, it does not undo
        what has disengaged the robot, or lets it relax.

        Parameters
        ----------
        now : float
            [s]
        """
        if not math.isfinite(now):
            return 'the time is not finite'
        self.judge_ages(now)
        self.memory.press_time[0], self.memory.hold_timeout[0] = now, self.options.hold_timeout
        return 'the deadman was not released since' if self._must_release else self._start(now)

    def release(self) -> None:
        """Release the deadman, which disengages the robot."""
        self.disengage('the deadman was released')
        self._must_release = False

    def disengage(self, reason: str = 'by the person') -> None:
        """Stop sending commands until the robot is engaged again."""
        self._go(GuardState.DISENGAGED, reason)

    def _go(self, state: GuardState, reason: str) -> None:
        self.memory.state[0], self._reason = STATES.index(state), reason
        self._must_release = self._must_ask_anew = state in (
            GuardState.DISENGAGED, GuardState.RELAXING)
        self.memory.reached[:], self.memory.return_time[0] = 0, -math.inf

    def command(self, now: float) -> np.ndarray | None:
        """Return the command to send now, None where nothing is to be sent.

        Parameters
        ----------
        now : float
            [s]

        Returns
        -------
        ndarray, shape (n,), or None
            [rad or m]
        """
        if not math.isfinite(now):
            return None
        self.judge_ages(now)
        if not self.is_engaged:
            return None
        state = self.state
        if state is GuardState.HOLDING and self.options.on_lost == 'stop':
            return None
        step = start_step(self.pack, now)
        if state is GuardState.HOLDING:
            self._move(self._command.copy(), 0., step)
        elif state is GuardState.RELAXING:
            self._move(self._rest, self.options.relax_speed, step)
            if (np.abs(self._command - self._rest) / self._per_radian).max() < AT_REST:
                self.disengage('at rest, as the hand was lost')
        else:
            follow_wanted(self.pack, step)
        return self._command.copy()

    def _move(self, goal: np.ndarray, speed: float, step: float) -> None:
        """Move the command towards a goal that stands still, see `move_command`."""
        move_command(self.pack, goal, self.memory.still, speed, step)

    def judge_ages(self, now: float) -> None:
        """Change the state by the ages of the deadman, of the robot's states and of the hand.

        Before a frame of the hand is taken, too: the process may have been stopped.

        Parameters
        ----------
        now : float
            [s]
        """
        if not math.isfinite(now):
            return
        memory = self.memory
        if now - self._judged_time > self.options.hold_timeout:
            self._resumed_time = now
        self._judged_time = now
        if self.is_engaged and now - memory.press_time[0] > memory.hold_timeout[0]:
            self.disengage('the deadman was released')
        # Silence while this process itself was stopped is no release.
        elif now - max(memory.press_time[0], self._resumed_time) > self.options.hold_timeout:
            self._must_release = False
        if self.is_engaged and now - memory.robot_time[0] > memory.robot_timeout:
            # It may start anew elsewhere, and would snap to the command.
            self.disengage(f"the robot's joint states ended{self._robot_fault()}")
        is_lost = not self.has_hand(now)
        if self.is_following and is_lost:
            # Lost since its last frame grew old, even if nobody looked then.
            grown_old = float(memory.hand_time[0]) + memory.hand_timeout
            self._lost_time = grown_old if math.isfinite(grown_old) else now
            self._go(GuardState.HOLDING, 'the hand is lost')
            self._held_at = self.robot
        if self.state is not GuardState.HOLDING:
            return
        if not is_lost:
            if self._end_silence(now):
                self._go(GuardState.EASING, 'the hand is back')
                memory.return_time[0] = now
        elif now - self._lost_time > self.options.disengage_after:
            if self.options.relax and self._end_silence(now):
                self._go(GuardState.RELAXING, 'the hand is lost: going to the rest position')
            elif self.is_engaged:
                self.disengage(WAS_LOST)
