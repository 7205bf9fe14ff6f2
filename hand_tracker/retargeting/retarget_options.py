"""Options of retargeting, each named, with its range."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

from ..core.errors import HandTrackerError


class InvalidRetargetOption(HandTrackerError, ValueError):
    """An option of retargeting has a value outside its range."""


def _option(default: float, lower: float, upper: float, unit: str, description: str) -> Any:
    return field(default=default, metadata={
        'range': (lower, upper), 'unit': unit, 'description': description})


@dataclass(frozen=True)
class RetargetOptions:
    """Weights, distances and limits of retargeting.

    Raises
    ------
    InvalidRetargetOption
        Naming the option, its value and what is allowed.
    """

    finger_weight: float = _option(
        1., 0., 100., '1', 'Of the distance of a finger tip from its target')
    thumb_weight: float = _option(
        1., 0., 100., '1', "Of the distance of the thumb's tip from its target")
    bone_weight: float = _option(
        .1, 0., 10., '1', "Of the direction of a bone, in lengths of its digit")
    thumb_bone_weight: float = _option(
        .05, 0., 10., '1', "Of the direction of a bone of the thumb, in lengths of the thumb")
    follow_weight: float = _option(
        .03, 0., 10., 'm/rad', 'Of a joint that follows a human joint')
    touch: float = _option(
        .005, .0, .05, 'm', 'Distance of human thumb and finger tip at which the robot\'s touch')
    escape: float = _option(
        .04, .01, .3, 'm', 'Distance of human thumb and finger tip from which they are free')
    touch_weight: float = _option(
        10., 0., 1e3, '1', 'Of the distance of two tips while the human tips touch')
    clearance: float = _option(
        .001, -.05, .05, 'm', 'Least distance of the surfaces of two tips that do not pinch')
    clearance_weight: float = _option(
        3., 0., 1e3, '1', 'Of that distance; small enough for tips to come past each other')
    smoothness: float = _option(
        .015, 0., .1, 'm/rad', 'Pull to the last command; decides what hardly moves a tip')
    rest_weight: float = _option(
        3e-4, 0., .1, 'm/rad', 'Pull to the rest position; decides only what is not observed')
    max_speed: float = _option(
        7.5, .01, 100., 'rad/s or m/s', 'Of every joint of the solution')
    limit_margin: float = _option(
        0., 0., .5, 'rad or m', "Distance kept from the URDF's limits")
    iterations: int = _option(
        6, 1, 100, '1', 'Gauss-Newton steps of a frame at most')
    tolerance: float = _option(
        2e-4, 1e-9, .1, 'rad or m', 'Change that ends the steps of a frame')

    def __post_init__(self) -> None:
        for option in fields(self):
            value = getattr(self, option.name)
            lower, upper = option.metadata['range']
            is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
            if not is_number or not lower <= value <= upper:
                raise InvalidRetargetOption(
                    f"{option.name}: {value!r}; allowed is {lower:g} to {upper:g} "
                    f"{option.metadata['unit']}")
        if self.escape <= self.touch:
            raise InvalidRetargetOption(
                f'escape: {self.escape:g} m; it must exceed touch, {self.touch:g} m')
