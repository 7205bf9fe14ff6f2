"""Options of the viewer's page on a command line: where it listens, and a robot that follows."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from ..core.model.hand import Hand

if TYPE_CHECKING:
    from ..retargeting.robot_file import LoadedRobot

FIRST_PORT = 8080
LOCALHOST = '127.0.0.1'
PLAIN_ROBOT = 'plain'    # the preset whose URDF comes with the package


def add_page_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the page to a command line: where it listens, and a robot."""
    parser.add_argument('--host', default=LOCALHOST, metavar='ADDRESS',
                        help='where to listen: 0.0.0.0 for the whole network, where whoever has '
                        'the printed address sees and steers it (default: this machine alone)')
    parser.add_argument('--port', type=int, default=FIRST_PORT,
                        help=f'first port that is tried (default: {FIRST_PORT})')
    _add_robot_options(parser)


def _add_robot_options(parser: argparse.ArgumentParser) -> None:
    """Add the options `--robot` and `--robot-description` to a command line."""
    parser.add_argument('--robot', nargs='?', const=PLAIN_ROBOT, default='', metavar='ROBOT',
                        help='robot hand that follows: a preset, robot file, dex-retargeting file '
                        'or URDF; without a value the plain hand that comes with this package')
    parser.add_argument('--robot-description', default='', metavar='URDF',
                        help="path of the robot's URDF, for a preset or a file without")


def chosen_robot(options: argparse.Namespace, hand: Hand) -> LoadedRobot | None:
    """Return the robot of the options of `_add_robot_options`; None where there is none.

    Parameters
    ----------
    options : argparse.Namespace
    hand : Hand
        The person's.

    Raises
    ------
    InvalidRobot
        If it cannot be loaded, or does not fit the hand.
    """
    if not options.robot:
        return None
    # Here, as a command line without a robot need not wait for what it imports.
    from ..retargeting.retarget_problem import make_problem
    from ..retargeting.robot_file import load_robot

    loaded = load_robot(options.robot, options.robot_description, preferred_side=hand.side)
    make_problem(loaded.hand, hand, loaded.options)
    return loaded
