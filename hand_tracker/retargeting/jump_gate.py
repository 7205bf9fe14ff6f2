"""Refuse positions that jump from one frame to the next, until they persist."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..core.numerics.jit import jit


class JumpGate(NamedTuple):
    """Accept positions near the last accepted one, and others once several in a row agree.

    Attributes
    ----------
    last, jump : ndarray, shape (size,)
        Positions accepted last, and refused last.
    has_last, has_jump : ndarray of int, shape (1,)
        Whether they count; without `has_last` the next position is accepted, wherever it is.
    agreeing : ndarray of int, shape (1,)
        Refused positions in a row, near each other.
    agreeing_since : ndarray, shape (1,)
        Time of the first of them [s].
    refused : ndarray of int, shape (1,)
        Positions that were not accepted, in all.
    most : ndarray, shape (size,)
        Largest change of each number that is no jump.
    frames, time : int and float
        Frames in a row, near each other, and the time they last, after which a jump is accepted.
    """

    last: np.ndarray
    jump: np.ndarray
    has_last: np.ndarray
    has_jump: np.ndarray
    agreeing: np.ndarray
    agreeing_since: np.ndarray
    refused: np.ndarray
    most: np.ndarray
    frames: int
    time: float


def new_jump_gate(size: int, most: np.ndarray | float, frames: int, time: float) -> JumpGate:
    """Return a gate for positions of up to `size` numbers that accepts the first one."""
    def flag() -> np.ndarray:
        return np.zeros(1, np.int64)

    return JumpGate(np.zeros(size), np.zeros(size), flag(), flag(), flag(), np.zeros(1),
                    flag(), np.full(size, most), frames, time)


@jit
def accepts_position(gate: JumpGate, position: np.ndarray, size: int, now: float) -> bool:
    """Return whether a position of `size` finite numbers is accepted.

    Parameters
    ----------
    gate : JumpGate
        Changed.
    position : ndarray, shape (>= size,)
    size : int
    now : float
        [s]
    """
    if gate.has_last[0] and _is_far(position, gate.last, size, gate.most):
        agrees = gate.has_jump[0] and not _is_far(position, gate.jump, size, gate.most)
        gate.agreeing[0] = gate.agreeing[0] + 1 if agrees else 1
        if not agrees:
            gate.agreeing_since[0] = now
        for i in range(size):
            gate.jump[i] = position[i]
        gate.has_jump[0] = 1
        if gate.agreeing[0] < gate.frames or now - gate.agreeing_since[0] < gate.time:
            gate.refused[0] += 1
            return False
    for i in range(size):
        gate.last[i] = position[i]
    gate.has_last[0], gate.has_jump[0], gate.agreeing[0] = 1, 0, 0
    return True


@jit
def _is_far(position: np.ndarray, other: np.ndarray, size: int, most: np.ndarray) -> bool:
    for i in range(size):
        if abs(position[i] - other[i]) > most[i]:
            return True
    return False
