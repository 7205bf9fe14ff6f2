"""Options of retargeting, each named, with its range."""

from __future__ import annotations

from dataclasses import dataclass

from ..core.checked_options import check, number_option
from ..core.errors import HandTrackerError


class InvalidRetargetOption(HandTrackerError, ValueError):
    """An option of retargeting has a value outside its range."""


@dataclass(frozen=True)
class RetargetOptions:
    """Weights, distances and limits of retargeting.

    Raises
    ------
    InvalidRetargetOption
        Naming the option, its value and what is allowed.
    """

    finger_weight: float = number_option(
        1., 0., 100., '', 'Of the distance of a finger tip from its target')
    thumb_weight: float = number_option(
        1., 0., 100., '', "Of the distance of the thumb's tip from its target")
    bone_weight: float = number_option(
        .1, 0., 10., '', "Of the direction of a bone, in lengths of its digit")
    thumb_bone_weight: float = number_option(
        .05, 0., 10., '', "Of the direction of a bone of the thumb, in lengths of the thumb")
    follow_weight: float = number_option(
        .03, 0., 10., 'm/rad', 'Of a joint that follows a human joint')
    touch: float = number_option(
        .005, .0, .05, 'm', 'Distance of the skin of human thumb and finger tip at which the '
        'robot\'s tips touch')
    escape: float = number_option(
        .03, .01, .3, 'm', 'Distance of the skin of human thumb and finger tip from which they '
        'are free')
    touch_weight: float = number_option(
        10., 0., 1e3, '', 'Of the distance of two tips while the human tips touch')
    clearance: float = number_option(
        .001, -.05, .05, 'm', 'Least distance of the surfaces of two tips that do not pinch')
    clearance_weight: float = number_option(
        3., 0., 1e3, '', 'Of that distance; small enough for tips to come past each other')
    smoothness: float = number_option(
        .015, 0., .1, 'm/rad', 'Pull to the last command; decides what hardly moves a tip')
    rest_weight: float = number_option(
        3e-4, 0., .1, 'm/rad', 'Pull to the rest position; decides only what is not observed')
    max_speed: float = number_option(
        7.5, .01, 100., 'rad/s or m/s', 'Of every joint of the solution')
    limit_margin: float = number_option(
        0., 0., .5, 'rad', "Distance kept from the URDF's limits")
    iterations: int = number_option(
        15, 1, 100, '', 'Gauss-Newton steps of a frame at most')
    tolerance: float = number_option(
        2e-4, 1e-9, .1, 'rad or m', 'Change that ends the steps of a frame')

    def __post_init__(self) -> None:
        check(self, InvalidRetargetOption)
        if self.escape <= self.touch:
            raise InvalidRetargetOption(
                f'escape: {self.escape:g} m; it must exceed touch, {self.touch:g} m')
