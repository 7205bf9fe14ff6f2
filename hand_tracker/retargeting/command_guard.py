"""The guard of a robot's commands: the one owner of whether and how fast the robot may move.

States and what changes them:

    disengaged ─ engage, press ─▶ easing ─ pose reached ─▶ following
    easing, following ─ hand lost ─▶ holding ─ hand back ─▶ easing
    holding ─ still lost ─▶ disengaged, or, by option, relaxing ─ at rest ─▶ disengaged
    relaxing ─ hand back ─▶ easing
    any ─ disengage, deadman released, no joint states of the robot ─▶ disengaged

Nothing is sent while disengaged. Every command follows from the last one that was sent, or, after
engaging, from where the robot is: within limits, speed and acceleration, whatever comes in.
"""

from __future__ import annotations

import enum
import math

import numpy as np
from numpy.typing import ArrayLike

from .guard_options import GuardOptions
from .jump_gate import JumpGate

REACHED = .1           # [rad or m] from the person's pose, from which the robot follows
SPEEDING_UP = .5       # [s] in which the speed allowed rises from that of easing to the greatest
AT_REST = 1e-3         # [rad or m] from the rest position
OUT_OF_LIMITS = .15    # [rad or m] of a robot that is not engaged


class GuardState(enum.Enum):
    """Whether the robot moves."""

    DISENGAGED = 'disengaged'
    EASING = 'easing'
    FOLLOWING = 'following'
    HOLDING = 'holding'
    RELAXING = 'relaxing'


ENGAGED = frozenset(GuardState) - {GuardState.DISENGAGED}


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

    Attributes
    ----------
    state : GuardState
    reason : str
        Why it is in this state, for a person.
    refused_values : int
        Frames that were not followed, as they were not finite.
    """

    def __init__(self, names: tuple[str, ...], lower: ArrayLike, upper: ArrayLike,
                 speed: ArrayLike, rest: ArrayLike, options: GuardOptions | None = None) -> None:
        self.options = options or GuardOptions()
        self._names = names
        self._lower, self._upper = np.array(lower, dtype=float), np.array(upper, dtype=float)
        margin = np.minimum(self.options.limit_margin, .25 * (self._upper - self._lower))
        self._inner = self._lower + margin, self._upper - margin
        given = np.array(speed, dtype=float)
        self._speed = np.where(given > 0., np.minimum(given, self.options.max_speed),
                               self.options.max_speed)
        self._rest = np.clip(np.array(rest, dtype=float), *self._inner)
        self.state = GuardState.DISENGAGED
        self.reason = 'not engaged yet'
        self.refused_values = 0
        self._robot: np.ndarray | None = None
        self._robot_time = self._hand_time = self._press_time = -math.inf
        self._wanted: np.ndarray | None = None
        self._wanted_time = -math.inf
        # Of the wanted position, until a command has answered it [rad/s or m/s].
        self._wanted_velocity = np.zeros(len(self._rest))
        self._gate = JumpGate(self.options.max_jump, self.options.jump_frames)
        self._command = self._rest.copy()
        self._velocity = np.zeros(len(self._rest))
        self._time = self._lost_time = self._reached_time = -math.inf

    @property
    def is_engaged(self) -> bool:
        """Whether commands are made."""
        return self.state in ENGAGED

    @property
    def refused_jumps(self) -> int:
        """Frames that were not followed, as they jumped."""
        return self._gate.refused

    @property
    def is_following(self) -> bool:
        """Whether commands lead to the person's pose."""
        return self.state in (GuardState.EASING, GuardState.FOLLOWING)

    def observe_robot(self, position: ArrayLike, now: float) -> None:
        """Take the robot's joint states; what is not finite is left out.

        Parameters
        ----------
        position : array_like, shape (n,)
            [rad or m]
        now : float
            Time of receipt [s].
        """
        given = np.array(position, dtype=float)
        if given.shape == self._rest.shape and np.isfinite(given).all() and math.isfinite(now):
            self._robot, self._robot_time = given, now

    def observe_hand(self, wanted: ArrayLike, now: float) -> bool:
        """Take the position that the person's hand wants; return whether it is followed.

        Parameters
        ----------
        wanted : array_like, shape (n,)
            [rad or m]
        now : float
            Time of receipt [s].
        """
        given = np.array(wanted, dtype=float)
        if given.shape != self._rest.shape or not np.isfinite(given).all() or (
                not math.isfinite(now)):
            self.refused_values += 1
            return False
        if now - self._hand_time > self.options.hand_timeout:
            self._gate.forget()
        # The hand is there, even where what it wants is not believed yet.
        self._hand_time = now
        inside = np.clip(given, *self._inner)
        if not self._gate.accepts(inside):
            # After a jump nobody knows how fast the hand is.
            self._wanted_time = -math.inf
            return False
        since = now - self._wanted_time
        self._wanted_velocity[:] = 0.
        if self._wanted is not None and 0. < since <= self.options.max_dt:
            self._wanted_velocity[:] = (inside - self._wanted) / since
        self._wanted, self._wanted_time = inside, now
        return True

    def keep_hand(self, now: float) -> None:
        """Take note that the hand is there, though its frame is not to be followed."""
        if math.isfinite(now) and self._wanted is not None:
            self._hand_time = now

    def lose_hand(self) -> None:
        """Take note that the hand is not tracked, before its last frame is old."""
        self._hand_time = -math.inf

    def engage(self, now: float) -> str:
        """Let the robot move from where it is; return why not, or nothing.

        Parameters
        ----------
        now : float
            [s]
        """
        if self.is_engaged:
            return ''
        if self.options.hold_to_engage and now - self._press_time > self.options.hold_timeout:
            return self._refuse('the deadman is not pressed (hold_to_engage)')
        if self._wanted is None or now - self._hand_time > self.options.hand_timeout:
            return self._refuse('there is no hand to follow')
        start = self._rest
        if self.options.require_robot_state:
            if self._robot is None or now - self._robot_time > self.options.robot_timeout:
                return self._refuse("the robot's joint states are missing or old")
            start = self._robot
            beyond = np.maximum(self._lower - start, start - self._upper)
            if beyond.max() > OUT_OF_LIMITS:
                joint = int(beyond.argmax())
                return self._refuse(
                    f'{self._names[joint]} is at {start[joint]:.3f}, outside its limits '
                    f'{self._lower[joint]:.3f} to {self._upper[joint]:.3f}')
        self._command = np.clip(start, self._lower, self._upper)
        self._velocity = np.zeros(len(start))
        self._time = now
        self._go(GuardState.EASING, "moving slowly to the person's pose")
        return ''

    def _refuse(self, reason: str) -> str:
        self.reason = f'not engaged: {reason}'
        return reason

    def press(self, now: float) -> str:
        """Press the deadman, which also engages; return why not, or nothing.

        Parameters
        ----------
        now : float
            [s]
        """
        if not math.isfinite(now):
            return 'the time is not finite'
        self._press_time = now
        return self.engage(now)

    def disengage(self, reason: str = 'disengaged by the person') -> None:
        """Stop sending commands until the robot is engaged again."""
        self._go(GuardState.DISENGAGED, reason)

    def _go(self, state: GuardState, reason: str) -> None:
        self.state, self.reason = state, reason

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
        if self.options.hold_to_engage and self.is_engaged and (
                now - self._press_time > self.options.hold_timeout):
            self.disengage('the deadman was released')
        if self.options.require_robot_state and self.is_engaged and (
                now - self._robot_time > self.options.robot_timeout):
            # It may start anew elsewhere, and would snap to the command.
            self.disengage("the robot's joint states ended")
        self._follow_hand(now)
        if not self.is_engaged:
            return None
        step = min(max(now - self._time, 0.), self.options.max_dt)
        self._time = max(now, self._time)
        if self.state is GuardState.HOLDING:
            if self.options.on_lost == 'stop':
                # The next command follows from the last one that was sent.
                self._velocity[:] = 0.
                return None
            self._move(self._command, 0., step)
            return self._command.copy()
        if self.state is GuardState.RELAXING:
            self._move(self._rest, self.options.relax_speed, step)
            if np.abs(self._command - self._rest).max() < AT_REST:
                self.disengage('at rest, as the hand was lost')
            return self._command.copy()
        assert self._wanted is not None
        share = 0.
        if self.state is GuardState.FOLLOWING:
            share = min((self._time - self._reached_time) / SPEEDING_UP, 1.)
        ease, most = self.options.ease_speed, max(self.options.ease_speed, self.options.max_speed)
        self._move(self._wanted, ease + share * (most - ease), step, self._wanted_velocity)
        self._wanted_velocity[:] = 0.
        if self.state is GuardState.EASING and (
                np.abs(self._command - self._wanted).max() < REACHED):
            self._reached_time = self._time
            self._go(GuardState.FOLLOWING, 'following the hand')
        return self._command.copy()

    def _follow_hand(self, now: float) -> None:
        """Change the state by the age of the hand's last frame."""
        if not self.is_engaged:
            return
        age = now - self._hand_time
        if age <= self.options.hand_timeout:
            if self.state in (GuardState.HOLDING, GuardState.RELAXING):
                self._go(GuardState.EASING, 'the hand is back')
            return
        if self.state in (GuardState.EASING, GuardState.FOLLOWING):
            self._lost_time = now
            self._go(GuardState.HOLDING, 'the hand is lost')
        elif self.state is GuardState.HOLDING and (
                now - self._lost_time > self.options.disengage_after):
            if self.options.relax:
                self._go(GuardState.RELAXING, 'the hand is lost: going to the rest position')
            else:
                self.disengage('the hand was lost: engage again')

    def _move(self, goal: np.ndarray, speed: float, step: float,
              goal_velocity: np.ndarray | float = 0.) -> None:
        """Move the command towards a goal within speed and acceleration, in one time step.

        A goal that moves is met with its own velocity: slowed down to a stop before each of its
        positions, the command would trail it by v / 2a, with v its speed and a the acceleration.
        """
        if step <= 0.:
            return
        slowing = self.options.max_acceleration * step
        most = np.minimum(self._speed, speed)
        ahead = np.clip(goal_velocity, -most, most)
        away = goal - self._command - ahead * step
        braked = self._braked_speed(away, slowing)
        wished = np.clip(ahead + np.clip(away / step, -braked, braked), -most, most)
        # So that it can still stop within the margin of a limit.
        lower, upper = self._inner
        wished = np.clip(wished, -self._braked_speed(self._command - lower, slowing),
                         self._braked_speed(upper - self._command, slowing))
        velocity = np.clip(wished, self._velocity - slowing, self._velocity + slowing)
        velocity = np.clip(velocity, -self._speed, self._speed)
        # A command within the margin of a limit never goes on outwards.
        moved = np.clip(self._command + velocity * step, np.minimum(lower, self._command),
                        np.maximum(upper, self._command))
        self._velocity = (moved - self._command) / step
        self._command = moved

    def _braked_speed(self, distance: np.ndarray, slowing: float) -> np.ndarray:
        """Return the speeds that can be braked to nothing within distances, with a step to spare.

        Parameters
        ----------
        distance : ndarray, shape (n,)
            Of either sign [rad or m].
        slowing : float
            Change of speed in a step at most.
        """
        return np.sqrt(2. * self.options.max_acceleration * np.abs(distance)
                       + slowing**2 / 4.) - slowing / 2.
