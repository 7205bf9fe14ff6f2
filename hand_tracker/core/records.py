"""Records that the kernels of a frame read and write: the hand's model, and the tracker's state."""

from typing import NamedTuple

import numpy as np

from .filtering.noise_estimate import NoiseEstimate, initial_noise
from .filtering.tracks import Tracks, initial_tracks
from .inverse_kinematics.angle_average import AngleAverage, initial_average
from .inverse_kinematics.angle_filter import AngleFilter, initial_angle_filter
from .labelling.association import AssociationState, initial_association
from .labelling.readings import ExpectedMarkers, HandBounds, unknown_markers
from .model.capsules import CAPSULE_COUNT, Capsules
from .model.kinematics import JointTable
from .model.marker_layout import MARKERS, Mounting
from .model.marker_rows import ROW_CAPACITY, MarkerRows, RowState, initial_rows
from .model.palm_triangle import Wrist, wrist_at_origin
from .occlusion.transdigital import DigitPrior, Transdigital, nothing_learned
from .pose.continuity import Pace, no_pace

USUAL_PALM_NOISE = .0014  # [m] of the palm's markers before any is learned; ours


class Model(NamedTuple):
    """Constants of one hand with its markers; of a right hand but for table, mounting and mirror.

    Attributes
    ----------
    template : ndarray, shape (3, 3)
        Palm markers in the wrist's frame [m].
    prior : DigitPrior
    levers : ndarray, shape (5,)
        Share of the palm's noise in the digits' markers (`noise_estimate.noise_levers`) [1].
    flexion_bounds : ndarray, shape (3,)
        Largest difference of MCP flexion of neighbouring fingers, index and middle finger
        first [rad].
    hand_bounds : HandBounds
    capsules : Capsules
    table : JointTable
    mounting : Mounting
        Of the principal markers.
    rows : MarkerRows
        Of the right hand.
    mirror : ndarray, shape (3,)
        -1 on the axes that a left hand mirrors, else 1.
    """

    template: np.ndarray
    prior: DigitPrior
    levers: np.ndarray
    flexion_bounds: np.ndarray
    hand_bounds: HandBounds
    capsules: Capsules
    table: JointTable
    mounting: Mounting
    rows: MarkerRows
    mirror: np.ndarray


class State(NamedTuple):
    """Everything the tracker keeps from frame to frame, of a right hand.

    And what a step leaves to later steps of the same frame: "This frame's".

    Attributes
    ----------
    palm : Tracks
        Filters of the palm's markers, in the markers' frame.
    digits : Tracks
        Filters of the digits' markers, in the wrist's frame.
    noise : NoiseEstimate
    palm_noise : NoiseEstimate
        Of the palm's markers, by their distances from each other over √2: these vary as much as
        the coordinates of one marker, and no motion of the hand changes them.
    digit_noise : ndarray, shape (5,)
        This frame's standard deviation of the digits' markers, on an axis of the wrist's frame [m].
    association : AssociationState
    transdigital : Transdigital
    wrist : Wrist
    angles : ndarray, shape (25,)
        Solved by inverse kinematics [rad].
    estimate : AngleFilter
        Of these angles.
    blended, offset : ndarray, shape (25,)
        Angles without jumps, and their difference to the estimated ones [rad].
    pace : Pace
        Of the estimated angles.
    separated, contact_offset : ndarray, shape (25,)
        Angles after contact resolution, and their difference to the blended ones [rad].
    neighbour_difference : ndarray, shape (3,)
        MCP flexion between neighbouring fingers when both were last seen [rad].
    pushes : ndarray, shape (5, 3)
        Displacement of the hidden digits' markers by contact [m].
    capsule_ends : ndarray, shape (2, 23, 3, 3)
        Ends and middles of the capsules' axes in the last frame and in this one [m].
    are_placed : ndarray of bool, shape (1,)
        Whether the capsules are those of the separated angles.
    last_markers, repeats, repeated_distances : ndarray, shape (65, 3), (65,) and (3, 3)
        Memory of `reject_frozen`.
    expected : ExpectedMarkers
        This frame's predictions.
    verdict : ndarray of int, shape (8,)
        This frame's verdicts of the association.
    measured : ndarray of bool, shape (5,)
        Whether the last joint of a digit was measured in the last frame.
    changed : ndarray of bool, shape (5,)
        Digits whose evidence differs from the last frame's.
    roots : ndarray, shape (5, 3)
        This frame's first joints of the digits, in the wrist's frame [m].
    rows : RowState
        Of the markers of layouts with more than the principal ones.
    average : AngleAverage
        Of the angles of digits with several markers.
    fitted : Wrist
        This frame's wrist by all markers of the palm.
    palm_shape : ndarray, shape (3, 3)
        The palm's markers in the wrist's frame, as last seen [m].
    """

    palm: Tracks
    digits: Tracks
    noise: NoiseEstimate
    palm_noise: NoiseEstimate
    digit_noise: np.ndarray
    association: AssociationState
    transdigital: Transdigital
    wrist: Wrist
    angles: np.ndarray
    estimate: AngleFilter
    blended: np.ndarray
    offset: np.ndarray
    pace: Pace
    separated: np.ndarray
    contact_offset: np.ndarray
    neighbour_difference: np.ndarray
    pushes: np.ndarray
    capsule_ends: np.ndarray
    are_placed: np.ndarray
    last_markers: np.ndarray
    repeats: np.ndarray
    repeated_distances: np.ndarray
    expected: ExpectedMarkers
    verdict: np.ndarray
    measured: np.ndarray
    changed: np.ndarray
    roots: np.ndarray
    rows: RowState
    average: AngleAverage
    fitted: Wrist
    palm_shape: np.ndarray


def blank_state(template: np.ndarray, rest: np.ndarray, relaxed: np.ndarray,
                marker_noise: float) -> State:
    """Return the state before the first frame: a relaxed hand at the origin.

    Parameters
    ----------
    template : ndarray, shape (3, 3)
        Palm markers in the wrist's frame [m].
    rest : ndarray, shape (5, 3)
        Digits' markers of the relaxed hand, in the wrist's frame [m].
    relaxed : ndarray, shape (25,)
        Angles of the relaxed hand [rad].
    marker_noise : float
        Standard deviation of a marker on an axis before any is learned [m].

    Returns
    -------
    State
    """
    count, joints = len(MARKERS), len(relaxed)
    return State(
        initial_tracks(template), initial_tracks(rest), initial_noise(count, marker_noise),
        initial_noise(1, USUAL_PALM_NOISE), np.full(len(rest), marker_noise),
        initial_association(), nothing_learned(), wrist_at_origin(), angles=relaxed.copy(),
        estimate=initial_angle_filter(relaxed), blended=relaxed.copy(), offset=np.zeros(joints),
        pace=no_pace(), separated=relaxed.copy(), contact_offset=np.zeros(joints),
        neighbour_difference=np.zeros(3), pushes=np.zeros(rest.shape),
        capsule_ends=np.zeros((2, CAPSULE_COUNT, 3, 3)), are_placed=np.zeros(1, dtype=bool),
        last_markers=np.full((ROW_CAPACITY, 3), np.nan),
        repeats=np.zeros(ROW_CAPACITY, dtype=np.int64),
        repeated_distances=np.full((3, 3), np.nan), expected=unknown_markers(),
        verdict=np.zeros(count, dtype=np.int64), measured=np.zeros(len(rest), dtype=bool),
        changed=np.zeros(len(rest), dtype=bool), roots=np.zeros(rest.shape),
        rows=initial_rows(relaxed), average=initial_average(relaxed), fitted=wrist_at_origin(),
        palm_shape=template.copy())
