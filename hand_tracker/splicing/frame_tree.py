"""Tree of frames, as /tf and /tf_static bring them: where a frame is in the root of its tree."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation


class FramePose(NamedTuple):
    """Pose of a frame in the root of its tree.

    Attributes
    ----------
    root : str
    time : float
        Of the newest transform on the way that moves; NaN where none does [s].
    position : ndarray, shape (3,)
        [m]
    rotation : ndarray, shape (4,)
        Unit quaternion x, y, z, w.
    """

    root: str
    time: float
    position: np.ndarray
    rotation: np.ndarray


class FrameTree:
    """Latest transform of each frame in its parent."""

    def __init__(self) -> None:
        self._transforms: dict[str, tuple[str, float, np.ndarray, Rotation]] = {}

    def update(self, parent: str, child: str, time: float, position: Sequence[float],
               rotation: Sequence[float]) -> bool:
        """Take a transform.

        Parameters
        ----------
        parent, child : str
        time : float
            NaN of a frame that rests in its parent, as on /tf_static [s].
        position : sequence of float, length 3
            [m]
        rotation : sequence of float, length 4
            Quaternion x, y, z, w, of any length.

        Returns
        -------
        bool
            Whether it is a transform: finite, with a rotation.
        """
        at, turn = np.asarray(position, dtype=float), np.asarray(rotation, dtype=float)
        if not np.isfinite((*at, *turn)).all() or not np.linalg.norm(turn) > 0.:
            return False
        self._transforms[child] = parent, time, at, Rotation.from_quat(turn)
        return True

    def chain(self, frame: str) -> list[str]:
        """Return a frame and those above it that have a parent, from below; no frame twice."""
        found: list[str] = []
        while frame in self._transforms and frame not in found:
            found.append(frame)
            frame = self._transforms[frame][0]
        return found

    def pose(self, frame: str) -> FramePose | None:
        """Return the pose of a frame by the latest transforms; None where it has no parent."""
        chain = self.chain(frame)
        if not chain:
            return None
        position, rotation, times = np.zeros(3), Rotation.identity(), [float('nan')]
        for child in chain:
            parent, time, translation, turn = self._transforms[child]
            position, rotation = translation + turn.apply(position), turn * rotation
            times.append(time)
        return FramePose(parent, float(np.fmax.reduce(times)), position, rotation.as_quat())
