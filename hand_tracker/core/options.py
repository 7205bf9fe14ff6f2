"""Choices of method: each constraint and each alternative is one named option."""

from dataclasses import dataclass, field, fields

from .errors import InvalidOption
from .pose.contact import PENETRATION


def _option(default, description, **limits):
    return field(default=default, metadata={'description': description, **limits})


@dataclass(frozen=True)
class TrackerOptions:
    """Choices of method; each field's metadata has its description and what it allows.

    Raises
    ------
    InvalidOption
        Naming the option, its value and what is allowed.
    """

    palm_method: str = _option(
        'rigid', 'Palm from its three markers: rigid fit, or the spheres and plane of the paper',
        choices=('rigid', 'spheres'))
    finger_ik: str = _option(
        'closed_form', 'Flexion of the digits: closed form, or constrained FABRIK as in the paper',
        choices=('closed_form', 'fabrik'))
    fabrik_tolerance: float = _option(
        1e-5, 'Distance from the marker at which FABRIK stops', unit='m', range=(1e-9, 1e-2))
    fabrik_iterations: int = _option(
        200, 'Iterations after which FABRIK stops, per digit and frame', range=(1, 10000))
    palm_stretch: float = _option(
        1.5, 'Palm markers farther apart than this times their distance on the hand are refused',
        range=(1.05, 10.))
    palm_shrink: float = _option(
        0.3, 'Palm markers nearer than this times their distance on the hand are refused',
        range=(0.01, 0.95))
    palm_flatness: float = _option(
        0.2, 'Palm triangles with less than this times the area on the hand count as collinear',
        range=(0.01, 0.95))

    frozen_frames: int = _option(
        10, 'Frames after which a marker that repeats its place to the last bit, while the palm '
        'moves, counts as lost; 0 is never', range=(0, 100000))

    smoothing: bool = _option(
        True, 'Whether the positions of seen markers are those of their filters')
    marker_noise: float = _option(
        5e-4, 'Noise of a seen marker on each axis at most, standard deviation; how much there '
        'is, is learned', unit='m',
        range=(1e-5, 1e-2))
    inertia: float = _option(
        0.04, 'Inertia: time in which the own motion of a hidden marker fades to a third; '
        '0 is off', unit='s', range=(0., 1.))
    palm_from_fingers: bool = _option(
        True, 'Whether the markers of the digits tell how the palm turns while one of its '
        'markers is hidden')
    transdigital_memory: float = _option(
        7., 'Transdigital correlation: memory of how digits move together; 0 is off',
        unit='s', range=(0., 600.))
    link_index_middle: float = _option(
        0.6, 'Correlation of index and middle finger before any is learned', range=(0., 0.99))
    link_middle_ring: float = _option(
        0.8, 'Correlation of middle and ring finger before any is learned', range=(0., 0.99))
    link_ring_little: float = _option(
        0.8, 'Correlation of ring and little finger before any is learned', range=(0., 0.99))
    bound_index_middle: float = _option(
        1.05, 'MCP flexion by which index and middle finger may differ while one is hidden',
        unit='rad', range=(0., 3.15))
    bound_middle_ring: float = _option(
        0.79, 'MCP flexion by which middle and ring finger may differ while one is hidden',
        unit='rad', range=(0., 3.15))
    bound_ring_little: float = _option(
        0.79, 'MCP flexion by which ring and little finger may differ while one is hidden',
        unit='rad', range=(0., 3.15))
    friction: float = _option(
        0., 'Friction: share of the movement of what touches a hidden digit that it follows; '
        '0 is off, as it gains nothing on captured hands', range=(0., 1.))
    rigidity: bool = _option(
        True, 'Whether digits that are in each other or in the palm are moved apart')
    penetration: float = _option(
        PENETRATION, 'Overlap that rigidity leaves, as flesh gives way', unit='m',
        range=(1e-4, 1e-2))
    outlier_gate: float = _option(
        5., 'Standard deviations from its prediction beyond which a marker is refused, when no '
        'hand can move so; 0 is off', range=(0., 100.))
    swap_margin: float = _option(
        2., 'How many times better exchanged labels have to fit; 0 is off', range=(0., 100.))
    patience: float = _option(
        0.3, 'Time after which a marker that is refused in one place is believed; 0 is never',
        unit='s', range=(0., 60.))
    max_prediction_time: float = _option(
        2., 'Time after which a hidden marker is stale', unit='s', range=(0., 600.))
    stale: str = _option(
        'relax', 'What a stale digit does: relax to what is usual with its neighbours, or hold',
        choices=('relax', 'hold'))
    relax_time: float = _option(
        1., 'Time in which a stale digit goes two thirds of the way to relax', unit='s',
        range=(0.05, 60.))
    reentry_rate: float = _option(
        5., 'Angular rate at most of an angle that is predicted, or corrected where a marker '
        'comes back or vanishes, unless what is seen turns it faster', unit='rad/s',
        range=(0.1, 1000.))

    def __post_init__(self):
        for option in fields(self):
            value, allowed = getattr(self, option.name), option.metadata
            if isinstance(option.default, bool):
                if not isinstance(value, bool):
                    raise InvalidOption(f'{option.name}: {value!r} is neither true nor false')
                continue
            if 'choices' in allowed:
                if value not in allowed['choices']:
                    raise InvalidOption(
                        f'{option.name}: {value!r} is not one of {", ".join(allowed["choices"])}')
                continue
            lower, upper = allowed['range']
            kinds = int if isinstance(option.default, int) else (int, float)
            if isinstance(value, bool) or not isinstance(value, kinds) \
                    or not lower <= value <= upper:
                whole = 'a whole number from ' if kinds is int else ''
                raise InvalidOption(
                    f'{option.name}: {value!r}; allowed is {whole}{lower:g} to {upper:g}')
