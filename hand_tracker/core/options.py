"""Options of the tracker: one named option for each constraint and each alternative method."""

import math
from dataclasses import dataclass
from typing import NamedTuple

from .checked_options import check, choice_option, number_option, switch
from .errors import InvalidOption
from .labelling.association import LabellingOptions
from .model.palm_triangle import PalmLimits
from .occlusion.prediction import PredictionOptions
from .pose.contact import PENETRATION


@dataclass(frozen=True)
class TrackerOptions:
    """Options of `HandTracker`.

    The metadata of each field has its `description`, and its `range` (lower, upper) with its `unit`
    or its `choices`.

    Raises
    ------
    InvalidOption
        Naming the option, its value and the allowed values.
    """

    palm_method: str = choice_option(
        'rigid', ('rigid', 'spheres'), 'Palm from its three markers: rigid fit, or the spheres '
        'and plane of the paper')
    finger_ik: str = choice_option(
        'closed_form', ('closed_form', 'fabrik'), 'Flexion of the digits: closed form, or '
        'constrained FABRIK as in the paper')
    fabrik_tolerance: float = number_option(
        1e-5, 1e-9, 1e-2, 'm', 'Distance from the marker at which FABRIK stops')
    fabrik_iterations: int = number_option(
        200, 1, 10000, '', 'Iterations after which FABRIK stops, per digit and frame')
    palm_arch: str = choice_option(
        'observed', ('observed', 'synergy', 'flat'), 'Cupping of the palm at the CMC joints of '
        'its fingers: observed where a layout has a marker more on a knuckle, else flat; synergy: '
        'where none shows it, by the MCP flexion of ring and little finger; or flat, as in the '
        'paper')
    palm_stretch: float = number_option(
        1.5, 1.05, 10., '', "Longest side of the palm triangle that is accepted, as a multiple of "
        "the hand's own")
    palm_shrink: float = number_option(
        0.3, 0.01, 0.95, '', "Shortest side of the palm triangle that is accepted, as a multiple "
        "of the hand's own")
    palm_flatness: float = number_option(
        0.2, 0.01, 0.95, '', "Area of the palm triangle, as a multiple of the hand's own, below "
        "which it counts as collinear")

    frozen_frames: int = number_option(
        10, 0, 100000, '', 'Frames after which a marker that repeats its position to the last bit '
        'while the palm moves counts as hidden; 0 is never')

    smoothing: bool = switch(
        True, 'Smooth the positions of seen markers by their filters')
    angle_filter: bool = switch(
        True, 'Filter the angles of seen digits too, as smoothing is on: quiet within the noise '
        'of their markers')
    marker_noise: float = number_option(
        5e-4, 1e-5, 1e-2, 'm', 'Upper bound of the marker noise, which is estimated: standard '
        'deviation on each axis')
    prediction: str = choice_option(
        'fading', ('fading', 'vtm_ukf'), 'Own motion of a hidden marker: its mean velocity, '
        'fading, or velocity, acceleration and turn of its VTM-UKF as in the paper')
    inertia: float = number_option(
        0.04, 0., 1., 's', 'Inertia: time constant in which the own motion of a hidden marker '
        'fades; 0 is off')
    palm_from_fingers: bool = switch(
        True, "Correct a hidden palm marker by a rigid fit that includes the fingers' markers")
    transdigital_memory: float = number_option(
        7., 0., 600., 's', 'Transdigital correlation: time constant of the statistics of how '
        'digits move together; 0 is off')
    link_index_middle: float = number_option(
        0.6, 0., 0.99, '', 'Correlation of index and middle finger before any is learned')
    link_middle_ring: float = number_option(
        0.8, 0., 0.99, '', 'Correlation of middle and ring finger before any is learned')
    link_ring_little: float = number_option(
        0.8, 0., 0.99, '', 'Correlation of ring and little finger before any is learned')
    bound_index_middle: float = number_option(
        1.05, 0., 3.15, 'rad', 'Largest difference of the MCP flexion of index and middle finger '
        'while one is hidden')
    bound_middle_ring: float = number_option(
        0.79, 0., 3.15, 'rad', 'Largest difference of the MCP flexion of middle and ring finger '
        'while one is hidden')
    bound_ring_little: float = number_option(
        0.79, 0., 3.15, 'rad', 'Largest difference of the MCP flexion of ring and little finger '
        'while one is hidden')
    friction: float = number_option(
        0., 0., 1., '', "Friction: share of a touching digit's motion that a hidden digit "
        "follows; 0 is off, as it gains nothing on captured hands")
    rigidity: bool = switch(
        True, 'Rigidity: move digits apart that overlap each other or the palm')
    penetration: float = number_option(
        PENETRATION, 1e-4, 1e-2, 'm', 'Overlap that rigidity leaves, as flesh yields')
    outlier_gate: float = number_option(
        5., 0., 100., '', 'Standard deviations from its prediction beyond which a marker is '
        'rejected, unless a hand can move so; 0 is off')
    swap_margin: float = number_option(
        2., 0., 100., '', 'Factor by which exchanged labels have to fit better; 0 is off')
    patience: float = number_option(
        0.3, 0., 60., 's', 'Time after which a marker that is rejected in one place is accepted '
        'there; 0 is never')
    max_prediction_time: float = number_option(
        2., 0., 600., 's', 'Time after which a hidden marker is stale')
    stale: str = choice_option(
        'relax', ('relax', 'hold'), 'Stale digits: relax to their mean place beside their '
        'neighbours, or hold')
    relax_time: float = number_option(
        1., 0.05, 60., 's', 'Time constant in which a stale digit relaxes')
    reentry_rate: float = number_option(
        5., 0.1, 1000., 'rad/s', 'Largest angular rate of a predicted angle, and of the '
        'correction where a marker comes back or vanishes, unless it turned faster just before')

    def __post_init__(self) -> None:
        check(self, InvalidOption)


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
    prediction : PredictionOptions

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
    prediction: PredictionOptions
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
        prediction=PredictionOptions(
            options.smoothing,
            math.inf if options.prediction == 'vtm_ukf' and options.inertia else
            float(options.inertia), options.palm_from_fingers,
            float(options.transdigital_memory), float(options.max_prediction_time),
            float(options.relax_time) if options.stale == 'relax' else 0.),
        friction=float(options.friction),
        rigidity=options.rigidity,
        penetration=float(options.penetration),
        reentry_rate=float(options.reentry_rate))
