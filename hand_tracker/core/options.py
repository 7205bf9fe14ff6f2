"""Options of the tracker: one named option for each constraint and each alternative method."""

import math
from dataclasses import dataclass, field, fields
from typing import Any, NamedTuple

from .errors import InvalidOption
from .labelling.association import LabellingOptions
from .model.palm_triangle import PalmLimits
from .occlusion.prediction import Prediction
from .pose.contact import PENETRATION


def _option(default: Any, description: str, **limits: Any) -> Any:
    """Return a dataclass field with its description, unit and range or choices as metadata."""
    return field(default=default, metadata={'description': description, **limits})


@dataclass(frozen=True)
class TrackerOptions:
    """Options of `HandTracker`.

    The metadata of each field has its `description`, its `unit` where it has one, and its
    `range` (lower, upper) or `choices`.

    Raises
    ------
    InvalidOption
        Naming the option, its value and the allowed values.
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
    palm_arch: str = _option(
        'observed', 'Cupping of the palm at the CMC joints of its fingers: observed where a layout '
        'has a marker more on a knuckle, else flat; synergy: where none shows it, by the MCP '
        'flexion of ring and little finger; or flat, as in the paper',
        choices=('observed', 'synergy', 'flat'))
    palm_stretch: float = _option(
        1.5, 'Longest side of the palm triangle that is accepted, as a multiple of the hand\'s own',
        range=(1.05, 10.))
    palm_shrink: float = _option(
        0.3, 'Shortest side of the palm triangle that is accepted, as a multiple of the hand\'s '
        'own', range=(0.01, 0.95))
    palm_flatness: float = _option(
        0.2, 'Area of the palm triangle, as a multiple of the hand\'s own, below which it counts '
        'as collinear', range=(0.01, 0.95))

    frozen_frames: int = _option(
        10, 'Frames after which a marker that repeats its position to the last bit while the palm '
        'moves counts as hidden; 0 is never', range=(0, 100000))

    smoothing: bool = _option(
        True, 'Smooth the positions of seen markers by their filters')
    angle_filter: bool = _option(
        True, 'Filter abduction and flexion of seen digits too, as smoothing is on: quiet where '
        'their markers constrain them little')
    marker_noise: float = _option(
        5e-4, 'Upper bound of the marker noise, which is estimated: standard deviation on each '
        'axis', unit='m', range=(1e-5, 1e-2))
    prediction: str = _option(
        'fading', 'Own motion of a hidden marker: its mean velocity, fading, or velocity, '
        'acceleration and turn of its VTM-UKF as in the paper', choices=('fading', 'vtm_ukf'))
    inertia: float = _option(
        0.04, 'Inertia: time constant in which the own motion of a hidden marker fades; 0 is off',
        unit='s', range=(0., 1.))
    palm_from_fingers: bool = _option(
        True, 'Correct a hidden palm marker by a rigid fit that includes the fingers\' markers')
    transdigital_memory: float = _option(
        7., 'Transdigital correlation: time constant of the statistics of how digits move '
        'together; 0 is off', unit='s', range=(0., 600.))
    link_index_middle: float = _option(
        0.6, 'Correlation of index and middle finger before any is learned', range=(0., 0.99))
    link_middle_ring: float = _option(
        0.8, 'Correlation of middle and ring finger before any is learned', range=(0., 0.99))
    link_ring_little: float = _option(
        0.8, 'Correlation of ring and little finger before any is learned', range=(0., 0.99))
    bound_index_middle: float = _option(
        1.05, 'Largest difference of the MCP flexion of index and middle finger while one is '
        'hidden', unit='rad', range=(0., 3.15))
    bound_middle_ring: float = _option(
        0.79, 'Largest difference of the MCP flexion of middle and ring finger while one is '
        'hidden', unit='rad', range=(0., 3.15))
    bound_ring_little: float = _option(
        0.79, 'Largest difference of the MCP flexion of ring and little finger while one is '
        'hidden', unit='rad', range=(0., 3.15))
    friction: float = _option(
        0., 'Friction: share of a touching digit\'s motion that a hidden digit follows; 0 is off, '
        'as it gains nothing on captured hands', range=(0., 1.))
    rigidity: bool = _option(
        True, 'Rigidity: move digits apart that overlap each other or the palm')
    penetration: float = _option(
        PENETRATION, 'Overlap that rigidity leaves, as flesh yields', unit='m',
        range=(1e-4, 1e-2))
    outlier_gate: float = _option(
        5., 'Standard deviations from its prediction beyond which a marker is rejected, unless a '
        'hand can move so; 0 is off', range=(0., 100.))
    swap_margin: float = _option(
        2., 'Factor by which exchanged labels have to fit better; 0 is off', range=(0., 100.))
    patience: float = _option(
        0.3, 'Time after which a marker that is rejected in one place is accepted there; 0 is '
        'never', unit='s', range=(0., 60.))
    max_prediction_time: float = _option(
        2., 'Time after which a hidden marker is stale', unit='s', range=(0., 600.))
    stale: str = _option(
        'relax', 'Stale digits: relax to their mean place beside their neighbours, or hold',
        choices=('relax', 'hold'))
    relax_time: float = _option(
        1., 'Time constant in which a stale digit relaxes', unit='s', range=(0.05, 60.))
    reentry_rate: float = _option(
        5., 'Largest angular rate of a predicted angle, and of the correction where a marker '
        'comes back or vanishes', unit='rad/s', range=(0.1, 1000.))

    def __post_init__(self) -> None:
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


class KernelOptions(NamedTuple):
    """`TrackerOptions` as kernels take them.

    Attributes
    ----------
    by_spheres : bool
        Palm by the paper's spheres instead of the rigid fit.
    by_fabrik : bool
        FABRIK instead of the closed form.
    palm_limits : PalmLimits
    labelling : LabellingOptions
    prediction : Prediction

    The other fields are those of `TrackerOptions`.
    """

    by_spheres: bool
    by_fabrik: bool
    fabrik_tolerance: float
    fabrik_iterations: int
    angle_filter: bool
    palm_limits: PalmLimits
    frozen_frames: int
    labelling: LabellingOptions
    marker_noise: float
    prediction: Prediction
    friction: float
    rigidity: bool
    penetration: float
    reentry_rate: float


def kernel_options(options: TrackerOptions) -> KernelOptions:
    """Return `TrackerOptions` as kernels take them: floats, even where a whole number stands."""
    return KernelOptions(
        by_spheres=options.palm_method == 'spheres',
        by_fabrik=options.finger_ik == 'fabrik',
        fabrik_tolerance=float(options.fabrik_tolerance),
        fabrik_iterations=options.fabrik_iterations,
        angle_filter=options.smoothing and options.angle_filter,
        palm_limits=PalmLimits(float(options.palm_stretch), float(options.palm_shrink),
                               float(options.palm_flatness)),
        frozen_frames=options.frozen_frames,
        labelling=LabellingOptions(float(options.outlier_gate), float(options.swap_margin),
                                   float(options.patience)),
        marker_noise=float(options.marker_noise),
        prediction=Prediction(
            options.smoothing,
            math.inf if options.prediction == 'vtm_ukf' and options.inertia else
            float(options.inertia), options.palm_from_fingers,
            float(options.transdigital_memory), float(options.max_prediction_time),
            float(options.relax_time) if options.stale == 'relax' else 0.),
        friction=float(options.friction),
        rigidity=options.rigidity,
        penetration=float(options.penetration),
        reentry_rate=float(options.reentry_rate))
