"""Track of one labelled hand: its state, and the prediction of its markers."""

import math
from typing import NamedTuple

import numpy as np

from ..numerics.jit import labelling_jit, loaded_or_plain
from .clutter import FIRST_DEVIATION, UNFORESEEN
from .palm_search import Finding, to_palm_frame
from .posture import CLUTTER_DENSITY, hidden_places, reset_matrix
from .prototypes import Prototype

# An occluded marker's place has a standard deviation of HIDDEN_DEVIATION sqrt(t) [m] after t [s],
# with the tails of Student's distribution, as fingers rest for long and then move at once; ours.
HIDDEN_DEVIATION = .014
HIDDEN_PALM_DEVIATION = .009    # the same of a palm marker, which the others constrain
LONGEST_HIDDEN = 5.         # [s] after which that stops growing
CLUTTER_RANGE = .25         # [m] on each axis from the palm: neighbourhood of a hand
ASTRAY_DISTANCE = 4.        # gate: implausible posture, distance relative to the typical; ours
LEAST_FOLLOWED = .3         # share of seen markers below which a hand is lost
RELABELLING_PERIOD = .05    # [s] between two relabellings
SEARCH_PERIOD = .3          # [s] between two searches for the palm elsewhere
# New points near a hand in a frame; ours.
LEAST_ARRIVALS, INITIAL_ARRIVALS, MOST_ARRIVALS = .005, .1, 10.


class Returns(NamedTuple):
    """Evidence on reappeared markers: cost, path and offset from the expected place since then.

    Attributes
    ----------
    age : ndarray, shape (M,)
        Time since its point appeared; infinite where no return is judged [s].
    cost : ndarray, shape (M,)
        Cost of its point as this marker when the point appeared.
    stretch : ndarray, shape (M,)
        Age of the current stretch of its path, see `PointHistory` [s].
    motion : ndarray, shape (M,)
        Motion term of its cost, from earlier stretches.
    came : ndarray, shape (M, 3)
        Start of the current stretch [m].
    pace : ndarray, shape (M, 3)
        Mean velocity over the previous stretch, NaN in the first [m/s].
    offset : ndarray, shape (2, M, 3)
        Offset from the expected place in the palm's frame, at the start of the stretch and now [m].
    shift : ndarray, shape (M, 3)
        Change of the offset over the previous stretch [m].
    hidden_for : ndarray, shape (M,)
        Duration of the occlusion before the return [s].
    """

    age: np.ndarray
    cost: np.ndarray
    stretch: np.ndarray
    motion: np.ndarray
    came: np.ndarray
    pace: np.ndarray
    offset: np.ndarray
    shift: np.ndarray
    hidden_for: np.ndarray


class HandTrack(NamedTuple):
    """Track of one labelled hand.

    Attributes
    ----------
    finding : Finding
        Its labels and its palm.
    predicted : ndarray, shape (M, 3)
        Place of each marker that `error` is measured from [m].
    place : ndarray, shape (M, 3)
        The same, once a sure palm is fitted to its points by that palm [m].
    local : ndarray, shape (M, 3)
        The same in the palm's frame, scaled to the prototype's size [m].
    drift : ndarray, shape (M, 3)
        Velocity in the palm's frame [m/s].
    expected : ndarray, shape (M, 3)
        Conditional mean of each hidden marker given the seen ones, in the last frame [m].
    spread : ndarray, shape (M,)
        Conditional variance of each hidden marker, on each axis [m²].
    error : ndarray, shape (M,)
        Filtered distance of each seen marker from `predicted` [m].
    own_error : ndarray, shape (M,)
        The same in the frame of a sure palm fitted to its points, on each axis [m].
    deviation : ndarray, shape (M,)
        Standard deviation of `place`: by `error`, by `own_error` once a sure palm is fitted [m].
    hidden_for : ndarray, shape (M,)
        Duration of the occlusion, 0 for a seen marker [s].
    suspected_for : ndarray, shape (M,)
        Time for which the other markers have contradicted each label [s].
    motion : ndarray, shape (2, 3)
        Velocity of the palm [m/s] and its angular velocity [rad/s].
    trusted_for : ndarray, shape (M, M)
        Trust in pairs of labels: time without a better rival since the two could be exchanged; on
        the diagonal, since a marker's point could be clutter [s].
    seen_for : ndarray, shape (M,)
        Time with a label since the track began, or since another labelling was taken [s].
    ids : ndarray of int, shape (M,)
        Source's id of each marker's last point; -1 for none.
    id_kept_for : ndarray, shape (M,)
        Time for which each marker's points have had that id [s].
    returns : Returns
        Evidence on markers that have reappeared after an occlusion.
    exchanged : ndarray, shape (M, M)
        Evidence that the labels of two markers are exchanged, by links and posture.
    palm_offset : ndarray, shape (M, 3)
        Offset of each hidden palm marker from where the joint distribution places it, in the palm's
        frame; NaN where unknown [m].
    palm_gaps : ndarray, shape (M, M)
        Distance of each two palm markers, at first by the template, then filtered towards those
        seen; 0 for those of digits [m].
    doubt : ndarray, shape (1,)
        Accumulated cost lead of rival labellings [variances].
    astray_for : ndarray, shape (1,)
        Time for which the posture has been implausible, or too few markers seen [s].
    age : ndarray, shape (1,)
        Time since the start [s].
    arrivals : ndarray, shape (1,)
        Rate of new clutter near the hand [points a frame].
    shaken_for : ndarray, shape (1,)
        Time left after a cut in which a rival labelling is taken at once; negative once over [s].
    unlikely_for : ndarray, shape (1,)
        Time for which the posture has been unlikely, which puts the labels in doubt [s].
    unreviewed_for, unsearched_for : ndarray, shape (1,)
        Time since the last relabelling, and since the last search for the palm elsewhere; at first
        the period of each [s].
    next_corner : ndarray of int, shape (1,)
        Point from which that search continues.
    """

    finding: Finding
    predicted: np.ndarray
    place: np.ndarray
    local: np.ndarray
    drift: np.ndarray
    expected: np.ndarray
    spread: np.ndarray
    error: np.ndarray
    own_error: np.ndarray
    deviation: np.ndarray
    hidden_for: np.ndarray
    suspected_for: np.ndarray
    motion: np.ndarray
    trusted_for: np.ndarray
    seen_for: np.ndarray
    ids: np.ndarray
    id_kept_for: np.ndarray
    returns: Returns
    exchanged: np.ndarray
    palm_offset: np.ndarray
    palm_gaps: np.ndarray
    doubt: np.ndarray
    astray_for: np.ndarray
    age: np.ndarray
    arrivals: np.ndarray
    shaken_for: np.ndarray
    unlikely_for: np.ndarray
    unreviewed_for: np.ndarray
    unsearched_for: np.ndarray
    next_corner: np.ndarray


def begin_track(prototype: Prototype, finding: Finding, points: np.ndarray) -> HandTrack:
    """Return the track of a hand that was found among points, shape (n, 3) [m]."""
    count = len(prototype.template)
    track = HandTrack(
        Finding(*(part.copy() for part in finding)), np.zeros((count, 3)), np.zeros((count, 3)),
        prototype.template.copy(), np.zeros((count, 3)), prototype.template.copy(),
        np.zeros(count), np.full(count, FIRST_DEVIATION), np.full(count, FIRST_DEVIATION),
        np.full(count, FIRST_DEVIATION), np.zeros(count), np.zeros(count), np.zeros((2, 3)),
        np.zeros((count, count)), np.zeros(count), np.full(count, -1), np.zeros(count),
        Returns(np.full(count, np.inf), np.zeros(count), np.zeros(count), np.zeros(count),
                np.zeros((count, 3)), np.zeros((count, 3)), np.zeros((2, count, 3)),
                np.zeros((count, 3)), np.zeros(count)),
        np.zeros((count, count)), np.full((count, 3), np.nan),
        np.zeros((count, count)), np.zeros(1), np.zeros(1), np.zeros(1),
        np.full(1, INITIAL_ARRIVALS), np.zeros(1), np.zeros(1),
        # The first labels are checked soon.
        np.full(1, RELABELLING_PERIOD), np.full(1, SEARCH_PERIOD), np.zeros(1, dtype=np.int64))
    loaded_or_plain(start_places)(prototype, points, track)
    return track


@labelling_jit
def reset_palm_gaps(prototype: Prototype, track: HandTrack, i: int) -> None:
    """Set a palm marker's distances from the others to those of the template; no other's."""
    for j in range(len(prototype.rigid)):
        if prototype.rigid[i] <= 0. or prototype.rigid[j] <= 0.:
            continue
        off = 0.
        for k in range(3):
            off += (prototype.template[i, k] - prototype.template[j, k]) ** 2
        track.palm_gaps[i, j] = track.palm_gaps[j, i] = track.finding.size[0] * math.sqrt(off)


@labelling_jit
def start_places(prototype: Prototype, points: np.ndarray, track: HandTrack) -> None:
    """Initialise the markers' places from the labels; hidden ones at their conditional mean.

    Palm markers that had no label before, by `seen_for`, get the template's distances.
    """
    rows = track.finding.rows
    local = np.empty((len(points), 3))
    to_palm_frame(points, track.finding.rotation, track.finding.position,
                  track.finding.size[0], local)
    expected = np.empty((len(rows), 3))
    matrix = np.empty((3 * len(rows), 3 * len(rows)))
    reset_matrix(prototype, rows, matrix)
    hidden_places(prototype, local, rows, matrix, expected)
    for i in range(len(rows)):
        for k in range(3):
            track.local[i, k] = local[rows[i], k] if rows[i] >= 0 else expected[i, k]
            track.drift[i, k] = 0.
            track.expected[i, k] = track.palm_offset[i, k] = np.nan
        track.hidden_for[i] = 0. if rows[i] >= 0 else 1.
        track.suspected_for[i] = 0.
        track.returns.age[i] = math.inf
        track.exchanged[i] = 0.
        if track.seen_for[i] <= 0.:
            reset_palm_gaps(prototype, track, i)


@labelling_jit
def turn_rotation(rotation: np.ndarray, x: float, y: float, z: float) -> None:
    """Turn a rotation by a rotation vector in the outer frame [rad]."""
    angle = math.sqrt(x * x + y * y + z * z)
    if angle < 1e-9:
        return
    x, y, z = x / angle, y / angle, z / angle
    c, s = math.cos(angle), math.sin(angle)
    for k in range(3):
        a, b, d = rotation[0, k], rotation[1, k], rotation[2, k]
        along = (1. - c) * (x * a + y * b + z * d)
        rotation[0, k] = c * a + s * (y * d - z * b) + along * x
        rotation[1, k] = c * b + s * (z * a - x * d) + along * y
        rotation[2, k] = c * d + s * (x * b - y * a) + along * z


@labelling_jit
def predict_hand(prototype: Prototype, track: HandTrack, step: float) -> None:
    """Predict palm and markers a time step [s] ahead, at constant velocity."""
    finding = track.finding
    for k in range(3):
        finding.position[k] += track.motion[0, k] * step
    turn_rotation(finding.rotation, track.motion[1, 0] * step, track.motion[1, 1] * step,
                  track.motion[1, 2] * step)
    for i in range(len(track.place)):
        for k in range(3):
            track.local[i, k] += track.drift[i, k] * step
    write_deviations(prototype, track, track.error, step)
    place_again(track)
    track.predicted[:] = track.place


@labelling_jit
def write_deviations(prototype: Prototype, track: HandTrack, error: np.ndarray,
                     step: float) -> None:
    """Write the deviations of places a time step [s] ahead, by the markers' errors, (M,) [m]."""
    leap = min(UNFORESEEN * step * step, FIRST_DEVIATION)
    for i in range(len(error)):
        growth = HIDDEN_PALM_DEVIATION if prototype.rigid[i] > 0. else HIDDEN_DEVIATION
        grown = growth * growth * min(track.hidden_for[i], LONGEST_HIDDEN)
        track.deviation[i] = math.sqrt(error[i] ** 2 + leap * leap + grown)


@labelling_jit
def place_again(track: HandTrack) -> None:
    """Transform the markers' places from the palm's frame to that of the points."""
    finding = track.finding
    size, rotation = finding.size[0], finding.rotation
    for i in range(len(track.place)):
        for k in range(3):
            track.place[i, k] = finding.position[k] + size * (
                rotation[k, 0] * track.local[i, 0] + rotation[k, 1] * track.local[i, 1]
                + rotation[k, 2] * track.local[i, 2])


@labelling_jit
def coming_cost(track: HandTrack) -> float:
    """Return the cost of labelling a new point, by the rate of new clutter near the hand."""
    return 2. * math.log(track.arrivals[0] / (8. * CLUTTER_RANGE ** 3 * CLUTTER_DENSITY))
