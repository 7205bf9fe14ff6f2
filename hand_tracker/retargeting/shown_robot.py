"""A robot as it is shown beside the hand that drives it: its URDF, and where its root is."""

from pathlib import Path
from typing import NamedTuple

from ..core.numerics.quaternion import quaternion
from .robot_file import load_robot
from .robot_paths import with_file_addresses

ROBOT_DISTANCE = .25    # [m] from the wrist to the robot's palm


class ShownRobot(NamedTuple):
    """A robot beside a hand.

    Attributes
    ----------
    description : str
        URDF whose meshes have the addresses of files.
    missing : tuple of str
        Meshes of it that were not found.
    place : tuple of float
        Of the root in the wrist's frame: position [m] and quaternion x, y, z, w.
    root : str
        Link.
    """

    description: str
    missing: tuple[str, ...]
    place: tuple[float, ...]
    root: str


def shown_robot(robot: str, description: str, side: str) -> ShownRobot:
    """Return a robot as it is shown beside a hand, on the side of the little finger.

    Parameters
    ----------
    robot, description : str
        As `robot` and `urdf` of `load_robot`.
    side : {'right', 'left'}
        Of the hand.

    Raises
    ------
    InvalidRobot
        As `load_robot`.
    """
    loaded = load_robot(robot, description, preferred_side=side)
    model = loaded.hand.model
    turned, at = loaded.hand.base_pose(model.frames(model.open_position()))
    # The little finger is on -y of the right wrist.
    at = at + (0., ROBOT_DISTANCE if side == 'left' else -ROBOT_DISTANCE, 0.)
    addressed = (with_file_addresses(Path(loaded.urdf).read_text(encoding='utf-8'),
                                     Path(loaded.urdf).parent) if loaded.urdf
                 else with_file_addresses(description, None))
    return ShownRobot(*addressed, (*at.tolist(), *quaternion(turned)), next(iter(model.links)))
