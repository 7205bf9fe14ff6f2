"""Options of the guard of a robot's commands, each a parameter of the node."""

from __future__ import annotations

from dataclasses import dataclass

from ..core.checked_options import check, choice_option, number_option, switch
from ..core.errors import HandTrackerError

ON_LOST = ('hold', 'stop')


class InvalidGuardOption(HandTrackerError, ValueError):
    """An option of the guard has a value outside its range or choices."""


@dataclass(frozen=True)
class GuardOptions:
    """When a robot may move, and how fast.

    Raises
    ------
    InvalidGuardOption
        Naming the option, its value and what is allowed.
    """

    hold_to_engage: bool = switch(
        False, 'Whether the robot moves only while the deadman is pressed again and again; else it '
        'may be engaged without one, which holds the robot from its first press on')
    hold_timeout: float = number_option(
        .25, .01, 10., 's', 'How long one press of the deadman lasts')
    require_robot_state: bool = switch(
        True, "Whether the robot's own joint states must be known to engage and while it moves; "
        'else commands begin at the last one, at first at the rest position, where none come')
    robot_timeout: float = number_option(
        .5, .01, 60., 's', "Age of the robot's joint states up to which it may be or stay engaged")
    max_speed: float = number_option(
        5., .01, 100., 'rad/s', 'Of every joint of a command, besides the URDF\'s limits')
    max_acceleration: float = number_option(
        500., .1, 1e4, 'rad/s²', 'Of every joint of a command')
    ease_speed: float = number_option(
        .7, .01, 100., 'rad/s', "Of every joint until each has reached the person's "
        'pose once')
    max_jump: float = number_option(
        .7, .01, 10., 'rad', 'Of the wanted position from one frame to the next; larger '
        'jumps are not followed at once')
    jump_frames: int = number_option(
        6, 1, 1000, '', 'Frames after which a jump that persists is followed, at limited speed')
    jump_time: float = number_option(
        .04, 0., 10., 's', 'Time, besides, after which a jump that persists is followed')
    max_dt: float = number_option(
        .05, .001, 1., 's', 'Time since the last command that counts at most')
    limit_margin: float = number_option(
        .02, 0., .5, 'rad', "Distance that commands keep from the URDF's limits")
    outside_limits: float = number_option(
        .15, 0., 1., 'rad', "By how much a robot that is engaged may be outside the URDF's limits; "
        'its first command is at the limit')
    hand_timeout: float = number_option(
        .15, .01, 10., 's', 'Age of the hand\'s last frame that was followed from which the robot '
        'holds')
    on_lost: str = choice_option(
        'hold', ON_LOST, 'While the hand is lost: hold, the last command is repeated, or stop, '
        'nothing is sent')
    disengage_after: float = number_option(
        1., .01, 3600., 's', 'Time without the hand after which the robot must be engaged anew')
    relax: bool = switch(
        False, 'Whether the robot goes to its rest position slowly before it disengages, where '
        'the hand stays lost; only engaging anew ends that')
    relax_speed: float = number_option(
        .2, .001, 10., 'rad/s', 'Of every joint on the way to the rest position')

    def __post_init__(self) -> None:
        check(self, InvalidGuardOption)
