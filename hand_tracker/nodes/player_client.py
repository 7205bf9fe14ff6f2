"""Client of the node that plays a recording, by rosbag2's services."""

from __future__ import annotations

import time

import numpy as np
from rclpy.node import Node
from rclpy.task import Future

try:
    from rosbag2_interfaces import srv
except ImportError:
    srv = None

ASKED_EVERY = 1.     # [s] whether the player is paused: others may pause it too


class PlayerClient:
    """The node that plays the recording, as the viewer's playhead: that of rosbag2, or replay.

    It does not publish where in the recording it is.

    Parameters
    ----------
    node : Node
    name : str
        Of the player.

    Attributes
    ----------
    duration : None
    playing : bool
    there : bool
        Whether the player answers.
    """

    duration = None
    is_available = srv is not None  # with rosbag2_interfaces

    def __init__(self, node: Node, name: str) -> None:
        self._is_paused, self._pause, self._resume, self._set_rate = (
            node.create_client(kind, f'{name}/{service}') for kind, service in (
                (srv.IsPaused, 'is_paused'), (srv.Pause, 'pause'), (srv.Resume, 'resume'),
                (srv.SetRate, 'set_rate')))
        self.playing, self.there = True, False
        self._asked = -np.inf

    def poll(self) -> None:
        """Ask whether it is there and plays, when it is time."""
        now = time.monotonic()
        if now - self._asked < ASKED_EVERY:
            return
        self._asked = now
        if self._is_paused.service_is_ready():
            self._is_paused.call_async(srv.IsPaused.Request()).add_done_callback(self._on_answer)
        else:
            self.there = False

    def _on_answer(self, future: Future) -> None:
        self.playing, self.there = not future.result().paused, True

    def toggle(self) -> None:
        """Pause or go on."""
        if self.playing:
            self._pause.call_async(srv.Pause.Request())
        else:
            self._resume.call_async(srv.Resume.Request())
        self.playing = not self.playing

    def set_rate(self, rate: float) -> None:
        """Play so many times as fast as recorded [1]."""
        self._set_rate.call_async(srv.SetRate.Request(rate=rate))
