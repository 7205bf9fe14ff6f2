"""Refuse positions that jump from one frame to the next, until they persist."""

from __future__ import annotations

import numpy as np


class JumpGate:
    """Accept positions near the last accepted one, and others once several in a row agree.

    Parameters
    ----------
    most : float
        Largest change of any number that is no jump.
    frames : int
        Frames in a row, near each other, after which a jump is accepted.

    Attributes
    ----------
    refused : int
        Positions that were not accepted.
    """

    def __init__(self, most: float, frames: int) -> None:
        self._most, self._frames = most, frames
        self._last: np.ndarray | None = None
        self._jump: np.ndarray | None = None
        self._count = 0
        self.refused = 0

    def forget(self) -> None:
        """Accept the next position, wherever it is."""
        self._last = None

    def accepts(self, position: np.ndarray) -> bool:
        """Return whether a position of finite numbers is accepted."""
        if self._last is not None and self._is_far(position, self._last):
            agrees = self._jump is not None and not self._is_far(position, self._jump)
            self._count = self._count + 1 if agrees else 1
            self._jump = position.copy()
            if self._count < self._frames:
                self.refused += 1
                return False
        self._last, self._jump, self._count = position.copy(), None, 0
        return True

    def _is_far(self, position: np.ndarray, other: np.ndarray) -> bool:
        return bool(np.abs(position - other).max() > self._most)
