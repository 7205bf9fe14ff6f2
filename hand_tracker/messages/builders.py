"""Arrays to messages of ROS: pure functions."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Sequence
from typing import NamedTuple, Protocol

import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import TransformStamped
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from ..core.model.hand import DIGITS, JOINTS, LINKS, ROOT
from ..core.model.kinematics import JointTable
from .stamps import Time as StampLike

Frames = tuple[tuple[str, str], ...]  # (parent, child) of transforms


class StatusLike(Protocol):
    """A status for /diagnostics, as `tracking.diagnostics.Status`."""

    @property
    def level(self) -> int: ...

    @property
    def text(self) -> str: ...

    @property
    def values(self) -> dict[str, str]: ...


class Names(NamedTuple):
    """Names that one hand's messages use.

    Attributes
    ----------
    prefix : str
    joints, links : tuple of str
        25 each.
    tips : tuple of str
        Frames of the five tips.
    wrist : str
        Frame of the wrist.
    tracked : str
        Frame that is broadcast where the wrist was tracked: the wrist's, but where it hangs on a
        body.
    """

    prefix: str
    joints: tuple[str, ...]
    links: tuple[str, ...]
    tips: tuple[str, ...]
    wrist: str
    tracked: str


def prefixed_names(prefix: str, wrist: str | None = None, on_body: bool = False) -> Names:
    """Return the names of a hand whose joints and frames begin with `prefix`.

    Parameters
    ----------
    prefix : str
    wrist : str, optional
        The wrist's frame, when it is not to be the URDF's root.
    on_body : bool, optional
        Whether the wrist hangs on a body.

    Returns
    -------
    Names
    """
    joints, links, tips = (tuple(prefix + name for name in names) for names in (
        JOINTS, LINKS, [f'{digit}_tip' for digit in DIGITS]))
    wrist = prefix + ROOT if wrist is None else wrist
    return Names(prefix, joints, links, tips, wrist, f'{wrist}_tracked' if on_body else wrist)


def time_message(stamp: StampLike) -> Time:
    """Return a stamp as a builtin_interfaces/msg/Time."""
    return Time(sec=stamp.sec, nanosec=stamp.nanosec)


def joint_state(stamp: StampLike, joints: Sequence[str], angles: np.ndarray,
                effort: Sequence[float] = ()) -> JointState:
    """Return the JointState of a hand, or of several.

    Parameters
    ----------
    stamp : Time or Stamp
    joints : sequence of str, length n
    angles : ndarray, shape (n,)
        [rad]
    effort : sequence of float, optional
        One for each joint, or none.

    Returns
    -------
    JointState
    """
    return JointState(header=Header(stamp=time_message(stamp)), name=joints,
                      position=array('d', np.asarray(angles, dtype=float).tobytes()),
                      effort=array('d', effort))


def diagnostics(stamp: StampLike, name: str, hardware_id: str,
                status: StatusLike) -> DiagnosticArray:
    """Return the DiagnosticArray of one status, as REP 107 asks.

    Parameters
    ----------
    stamp : Time
    name : str
        Of the node and what it does, as 'hand_tracker: right hand'.
    hardware_id : str
        Where the markers come from.
    status : Status

    Returns
    -------
    DiagnosticArray
    """
    values = [KeyValue(key=key, value=value) for key, value in status.values.items()]
    return DiagnosticArray(header=Header(stamp=stamp), status=[DiagnosticStatus(
        level=bytes((status.level,)), name=name, message=status.text, hardware_id=hardware_id,
        values=values)])


def new_transforms(frames: Iterable[tuple[str, str]]) -> list[TransformStamped]:
    """Return transforms for TF with no numbers yet.

    Parameters
    ----------
    frames : iterable of (str, str)
        Parent and child of each.

    Returns
    -------
    list of TransformStamped
    """
    messages = []
    for parent, child in frames:
        message = TransformStamped(child_frame_id=child)
        message.header.frame_id = parent
        messages.append(message)
    return messages


def fill_transforms(messages: list[TransformStamped], stamp: StampLike,
                    numbers: np.ndarray) -> None:
    """Fill transforms in place: building them anew costs ten times as much.

    Parameters
    ----------
    messages : list of TransformStamped, length n
    stamp : Time
    numbers : ndarray, shape (n, 7)
        As of `templates.transform_numbers`.
    """
    for message, row in zip(messages, numbers.tolist()):
        message.header.stamp = stamp
        transform = message.transform
        to, turn = transform.translation, transform.rotation
        to.x, to.y, to.z, turn.x, turn.y, turn.z, turn.w = row


def wrist_frames(names: Names, frame_id: str) -> Frames:
    """Return (parent, child) of the tracked wrist in the frame of the markers."""
    return ((frame_id, names.tracked),)


def link_frames(names: Names, table: JointTable) -> Frames:
    """Return (parent, child) of the 25 links, as the URDF has them."""
    parents = names.links + (names.wrist,)  # link -1 is the wrist
    return tuple((parents[parent], child) for parent, child in zip(table.parent, names.links))


def tip_frames(names: Names) -> Frames:
    """Return (parent, child) of the five tips."""
    return tuple((f'{names.prefix}{digit}_distal', tip) for digit, tip in zip(DIGITS, names.tips))
