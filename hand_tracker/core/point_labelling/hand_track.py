"""Track of one labelled hand: its state, and where its markers are a time step ahead."""

import math
from typing import NamedTuple

import numpy as np

from ..numerics.jit import labelling_jit, loaded_or_plain
from .clutter import FIRST_DEVIATION, UNFORESEEN
from .palm_search import Finding, to_palm_frame
from .posture import CLUTTER_DENSITY, hidden_places, reset_matrix
from .prototypes import Prototype

# Of the place of a marker that is hidden for t [s]: deviation sqrt(t) [m], with the tails of
# Student's distribution, as fingers rest for long and then move at once; ours.
HIDDEN_DEVIATION = .014
HIDDEN_PALM_DEVIATION = .009    # the same of a marker of the palm, which the others place
LONGEST_HIDDEN = 5.         # [s] after which it grows no more
CLUTTER_RANGE = .25         # [m] from the palm, in which they are
ASTRAY_DISTANCE = 4.        # of a posture that is no hand's, relative to the typical one; ours
LEAST_FOLLOWED = .3         # share of a hand's markers below which it is lost
RELABELLING_FRAMES = 6      # between two searches for another labelling
SEARCH_FRAMES = 36          # between two searches for another place of the palm
BIRTHS = .005, .1, 10.       # points that come there in a frame: least, at the start, most; ours


class Returns(NamedTuple):
    """Evidence on reappeared markers: cost, path and offset from the expected place since then.

    Attributes
    ----------
    age : ndarray, shape (M,)
        Time since each came; infinite where it is no more in question [s].
    cost : ndarray, shape (M,)
        Of its point as this marker when it came.
    stretch : ndarray, shape (M,)
        Time since the present stretch of its path began [s].
    motion : ndarray, shape (M,)
        What earlier stretches change in its cost.
    came : ndarray, shape (M, 3)
        Where the stretch began [m].
    pace : ndarray, shape (M, 3)
        Velocity in the stretch before; not a number in the first [m/s].
    offset : ndarray, shape (2, M, 3)
        From where it was expected in the palm's frame, when the stretch began and now [m].
    shift : ndarray, shape (M, 3)
        By how much it changed in the stretch before [m].
    hidden_for : ndarray, shape (M,)
        Time for which it had been hidden [s].
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
    place : ndarray, shape (M, 3)
        Predicted place of each marker [m].
    local : ndarray, shape (M, 3)
        Its place in the palm's frame, of the prototype's size [m].
    drift : ndarray, shape (M, 3)
        Speed there [m/s].
    expected : ndarray, shape (M, 3)
        Where the seen markers expected each hidden one in the last frame [m].
    spread : ndarray, shape (M,)
        Variance of its place there, on each axis [m²].
    error : ndarray, shape (M,)
        By which predictions err, while the marker is seen [m].
    deviation : ndarray, shape (M,)
        Standard deviation of the prediction [m].
    hidden_for : ndarray, shape (M,)
        [s]
    suspected_for : ndarray, shape (M,)
        Time for which the other markers have contradicted each label [s].
    motion : ndarray, shape (2, 3)
        Velocity of the palm [m/s] and its angular velocity [rad/s].
    trusted_for : ndarray, shape (M, M)
        Time for which labels have been the best since each seen marker's point may have been each
        other marker's; on the diagonal since it may have been none [s].
    ids : ndarray of int, shape (M,)
        By which the source distinguished the markers' points; -1 where it did not.
    id_kept_for : ndarray, shape (M,)
        Time for which each seen marker's point has had that [s].
    returns : Returns
        How each marker came back that was hidden.
    exchanged : ndarray, shape (M, M)
        Evidence that two markers have each other's points, by their links.
    palm_offset : ndarray, shape (M, 3)
        Of each hidden marker of the palm from where all seen markers together place it, in the
        palm's frame; not a number where that is not known [m].
    doubt : ndarray, shape (1,)
        By how much another labelling has been better [variances].
    astray_for : ndarray, shape (1,)
        Time for which the posture has been no hand's [s].
    age : ndarray, shape (1,)
        Time since the start [s].
    arrivals : ndarray, shape (1,)
        Points near the hand that come in a frame.
    shaken_for : ndarray, shape (1,)
        Time for which another labelling is taken at once, after a cut; below 0 once that is over
        [s].
    unlikely_for : ndarray, shape (1,)
        Time for which the posture has put the labels in doubt [s].
    since_relabelling, since_search : ndarray of int, shape (1,)
        Frames since another labelling was sought, and another place of the palm.
    next_corner : ndarray of int, shape (1,)
        Point from which that search goes on.
    """

    finding: Finding
    place: np.ndarray
    local: np.ndarray
    drift: np.ndarray
    expected: np.ndarray
    spread: np.ndarray
    error: np.ndarray
    deviation: np.ndarray
    hidden_for: np.ndarray
    suspected_for: np.ndarray
    motion: np.ndarray
    trusted_for: np.ndarray
    ids: np.ndarray
    id_kept_for: np.ndarray
    returns: Returns
    exchanged: np.ndarray
    palm_offset: np.ndarray
    doubt: np.ndarray
    astray_for: np.ndarray
    age: np.ndarray
    arrivals: np.ndarray
    shaken_for: np.ndarray
    unlikely_for: np.ndarray
    since_relabelling: np.ndarray
    since_search: np.ndarray
    next_corner: np.ndarray


def begin_track(prototype: Prototype, finding: Finding, points: np.ndarray) -> HandTrack:
    """Return the track of a hand that was found among points, shape (n, 3) [m]."""
    count = len(prototype.template)
    track = HandTrack(
        Finding(*(part.copy() for part in finding)), np.zeros((count, 3)),
        prototype.template.copy(), np.zeros((count, 3)), prototype.template.copy(),
        np.zeros(count), np.full(count, FIRST_DEVIATION),
        np.full(count, FIRST_DEVIATION), np.zeros(count), np.zeros(count), np.zeros((2, 3)),
        np.zeros((count, count)), np.full(count, -1), np.zeros(count),
        Returns(np.full(count, np.inf), np.zeros(count), np.zeros(count), np.zeros(count),
                np.zeros((count, 3)), np.zeros((count, 3)), np.zeros((2, count, 3)),
                np.zeros((count, 3)), np.zeros(count)),
        np.zeros((count, count)), np.full((count, 3), np.nan), np.zeros(1), np.zeros(1),
        np.zeros(1), np.full(1, BIRTHS[1]), np.zeros(1), np.zeros(1),
        # The first labels are checked soon.
        np.full(1, RELABELLING_FRAMES), np.full(1, SEARCH_FRAMES), np.zeros(1, dtype=np.int64))
    loaded_or_plain(start_places)(prototype, points, track)
    return track


@labelling_jit
def start_places(prototype: Prototype, points: np.ndarray, track: HandTrack) -> None:
    """Set the markers' places by the present labels; hidden ones are where they are expected."""
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
    """Predict palm and markers a time step [s] ahead."""
    finding = track.finding
    for k in range(3):
        finding.position[k] += track.motion[0, k] * step
    turn_rotation(finding.rotation, track.motion[1, 0] * step, track.motion[1, 1] * step,
                  track.motion[1, 2] * step)
    for i in range(len(track.place)):
        growth = HIDDEN_PALM_DEVIATION if prototype.rigid[i] > 0. else HIDDEN_DEVIATION
        grown = growth * growth * min(track.hidden_for[i], LONGEST_HIDDEN)
        leap = min(UNFORESEEN * step * step, FIRST_DEVIATION)
        track.deviation[i] = math.sqrt(track.error[i] ** 2 + leap * leap + grown)
        for k in range(3):
            track.local[i, k] += track.drift[i, k] * step
    place_again(track)


@labelling_jit
def place_again(track: HandTrack) -> None:
    """Write the places of the markers in the frame of the points."""
    finding = track.finding
    size, rotation = finding.size[0], finding.rotation
    for i in range(len(track.place)):
        for k in range(3):
            track.place[i, k] = finding.position[k] + size * (
                rotation[k, 0] * track.local[i, 0] + rotation[k, 1] * track.local[i, 1]
                + rotation[k, 2] * track.local[i, 2])


@labelling_jit
def coming_cost(track: HandTrack) -> float:
    """Return the cost of taking a point that has just come, relative to `CLUTTER_DENSITY`."""
    return 2. * math.log(track.arrivals[0] / (8. * CLUTTER_RANGE ** 3 * CLUTTER_DENSITY))
