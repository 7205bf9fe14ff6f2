"""Retargeter: joint positions of a robot hand from those of a person, frame by frame."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ..calibration.landmarks import LANDMARKS, TIP_ROWS
from ..core.model.hand import JOINTS, Hand
from ..core.numerics.packs import Pack, packed
from .hand_frame import require_wrist_frame
from .human_hand import HumanHand, are_joint_angles, new_human_hand, place_landmarks
from .retarget_kernel import Problem, Solution, solve_frame
from .retarget_options import RetargetOptions
from .retarget_problem import make_problem, new_solution
from .robot_hand import RobotHand

# The first frame is solved from several positions, as a start far away may end in a corner.
FIRST_STARTS, FIRST_ROUNDS, LAST_ROUNDS = 8, 4, 12
UNKNOWN_ANGLES = np.full(len(JOINTS), np.nan)


class Retargeter:
    """Retarget one person's hand to one robot hand.

    Parameters
    ----------
    robot : RobotHand
    hand : Hand
        The person's, of the robot's side. It gives the scale, which never changes.
    options : RetargetOptions, optional

    Attributes
    ----------
    names : tuple of str
        The robot's independent joints, in the order of the positions.
    human : HumanHand
        The person's, as of the last angles.

    Raises
    ------
    InvalidRobot
        If robot and person do not fit.
    """

    def __init__(self, robot: RobotHand, hand: Hand,
                 options: RetargetOptions | None = None) -> None:
        self.robot = robot
        self.hand = hand
        self.options = options or RetargetOptions()
        self.names: Sequence[str] = robot.model.variables
        self._used = robot.digit_variables
        self._human, self.human = packed(new_human_hand(hand))
        self._problem, self.problem = packed(make_problem(robot, hand, self.options))
        self._solution, self.solution = packed(new_solution(robot.rest[self._used]))
        self._position = robot.rest.copy()
        self._is_first = True

    @property
    def is_first(self) -> bool:
        """Whether the next frame is the first, which is solved from several starts."""
        return self._is_first

    @property
    def packs(self) -> tuple[Pack[HumanHand], Pack[Problem], Pack[Solution]]:
        """The person's hand, the problem and the solution, for kernels."""
        return self._human, self._problem, self._solution

    def reset(self, position: ArrayLike | None = None) -> None:
        """Begin anew from a position of the robot.

        Parameters
        ----------
        position : array_like, shape (n,), optional
            Of all independent joints; the rest position when left out [rad or m].

        Raises
        ------
        ValueError
            If it has another shape or is not finite.
        """
        start = self.robot.rest if position is None else np.asarray(position, dtype=float)
        if start.shape != self._position.shape or not np.isfinite(start).all():
            raise ValueError(f'position: {position!r}; expected {len(self._position)} numbers')
        self._position = start.copy()
        self.solution.position[:len(self._used)] = start[self._used]
        self._is_first = True

    def update_angles(self, angles: ArrayLike, dt: float) -> np.ndarray:
        """Return the robot's position for the person's joint angles.

        Parameters
        ----------
        angles : array_like, shape (25,)
            In the order of `JOINTS` [rad].
        dt : float
            Since the last frame [s].

        Returns
        -------
        ndarray, shape (n,)
            As `update`.

        Raises
        ------
        ValueError
            If the shape is another, or an angle is not finite or beyond a full turn, as in degrees.
        """
        given = np.asarray(angles, dtype=float)
        if given.shape != (len(JOINTS),) or not are_joint_angles(given):
            raise ValueError(
                f'angles: shape {given.shape}, up to {np.abs(given).max(initial=0.):g}; expected '
                f'{len(JOINTS)} finite numbers, in radians')
        self.human.angles[0] = given
        place_landmarks(self._human)
        return self._solve(self.human.landmarks, dt, self.human.angles[0])

    def update(self, landmarks: ArrayLike, dt: float,
               angles: np.ndarray = UNKNOWN_ANGLES) -> np.ndarray:
        """Return the robot's position for the person's landmarks.

        Parameters
        ----------
        landmarks : array_like, shape (21, 3)
            In the order of `LANDMARKS`, in the frame of the person's wrist: x distal, z dorsal,
            y = z × x; NaN where not known [m].
        dt : float
            Since the last frame [s].
        angles : ndarray, shape (25,)
            The person's joint angles, for joints that follow them [rad]; NaN where not known.

        Returns
        -------
        ndarray, shape (n,)
            Of the independent joints, as `names` [rad or m]. Joints that move no digit stay.

        Raises
        ------
        ValueError
            If a shape is another, or dt is no time.
        TurnedHandFrame
            If the first landmarks are in another frame than the wrist's.
        """
        human = np.ascontiguousarray(landmarks, dtype=float)
        if human.shape != (len(LANDMARKS), 3) or angles.shape != (len(JOINTS),):
            raise ValueError(f'landmarks: shape {human.shape}, angles: shape {angles.shape}; '
                             f'expected ({len(LANDMARKS)}, 3) and ({len(JOINTS)},)')
        if self._is_first and _shows_tip(human):
            require_wrist_frame(human, self.hand.side)
        return self._solve(human, dt, angles)

    def _solve(self, human: np.ndarray, dt: float, angles: np.ndarray) -> np.ndarray:
        """Solve a frame in the wrist's frame, see `update`."""
        if not dt >= 0.:
            raise ValueError(f'dt: {dt!r}; expected seconds, not less than 0')
        if not _shows_tip(human):
            return self._position.copy()
        if self._is_first:
            self._solve_first(human, angles)
            self._is_first = False
        else:
            solve_frame(self._problem, self._solution, human, angles, dt)
        self._position[self._used] = self.solution.position[:len(self._used)]
        return self._position.copy()

    def _solve_first(self, human: np.ndarray, angles: np.ndarray) -> None:
        """Solve a frame from several starts; keep the best."""
        used, solution = len(self._used), self.solution
        lower, upper = self.problem.lower[:used], self.problem.upper[:used]
        random = np.random.default_rng(0)
        starts = [solution.position[:used].copy(), .5 * (lower + upper)]
        starts += [random.uniform(lower, upper) for _ in range(FIRST_STARTS - len(starts))]
        least, best = np.inf, starts[0]
        for start in starts:
            solution.position[:used] = start
            cost = self._settle(human, angles, FIRST_ROUNDS)
            if cost < least:
                least, best = cost, solution.position[:used].copy()
        solution.position[:used] = best
        self._settle(human, angles, LAST_ROUNDS)

    def _settle(self, human: np.ndarray, angles: np.ndarray, rounds: int) -> float:
        for _ in range(rounds):
            cost = solve_frame(self._problem, self._solution, human, angles, np.inf)
        return float(cost)


def _shows_tip(landmarks: np.ndarray) -> bool:
    """Return whether the place of any tip is known."""
    return bool(np.isfinite(landmarks[TIP_ROWS]).all(axis=1).any())
