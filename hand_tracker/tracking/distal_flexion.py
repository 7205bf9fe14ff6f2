"""Measured flexion of the last joints, as of a glove's flex sensors. No ROS."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ..core.model.hand import DIGITS, JOINTS

DISTAL_JOINTS = JOINTS[4::5]  # of each digit


class DistalFlexion:
    """Keep the last measurement of each digit for as long as it is fresh.

    Parameters
    ----------
    prefix : str
        Of the published joint names; measurements may have it or not.

    Attributes
    ----------
    heard : bool
        Whether any measurement ever came.
    """

    def __init__(self, prefix: str) -> None:
        self._digits = {name: digit for digit, joint in enumerate(DISTAL_JOINTS)
                        for name in (joint, prefix + joint)}
        self._angles = np.full(len(DIGITS), np.nan)
        self._received = np.full(len(DIGITS), -np.inf)
        self.heard = False

    def received(self, now: float, names: Sequence[str], angles: Sequence[float]) -> list[str]:
        """Take measurements; those that are not finite are left out.

        Parameters
        ----------
        now : float
            Of the clock that `fresh` is asked by [s].
        names : sequence of str
        angles : sequence of float
            [rad]

        Returns
        -------
        list of str
            The names that are of no last joint.
        """
        unknown = []
        for name, angle in zip(names, angles):
            digit = self._digits.get(name)
            if digit is None:
                unknown.append(name)
            elif math.isfinite(angle):
                self._angles[digit], self._received[digit] = angle, now
                self.heard = True
        return unknown

    def fresh(self, now: float, timeout: float) -> np.ndarray | None:
        """Return the measurements that are not too old.

        Parameters
        ----------
        now : float
            [s]
        timeout : float
            [s]

        Returns
        -------
        ndarray, shape (5,), or None
            NaN for digits without; None when no digit has one [rad].
        """
        age = now - self._received
        # A clock that jumped back leaves measurements of the future.
        fresh = (0. <= age) & (age <= timeout)
        return np.where(fresh, self._angles, np.nan) if fresh.any() else None
