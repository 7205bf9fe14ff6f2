"""The palm's markers through occlusion: rigid among themselves, and told of by the fingers.

A hidden one is carried by those seen, goes on by inertia, and is drawn to where the fingers'
markers, which keep near their places in the palm, have the palm turned.
"""

import math

import numpy as np

from ..filtering.tracks import predict_track, update_track
from ..inverse_kinematics.palm import palm_fault, rigid_palm
from ..model.states import CARRIED, LOST, TRACKED, WAITING
from ..numerics.jit import jit
from ..numerics.vectors import (
    add,
    cross,
    dot,
    frame,
    length,
    rotate,
    rotate_about,
    scale,
    store,
    subtract,
    unit,
    vector,
)

# Weights in the rigid fit against that of a finger's marker; of predicted ones with none, one
# and two of the palm's seen; from captures.
SEEN_WEIGHT = 1e4
PREDICTED_WEIGHTS = (.3, 1., 4.)
FITS = 2              # linear steps of the rigid fit
INSTANT = 1e-3        # [s] over which velocities are compared


@jit
def check_palm(markers, seen, template, rotation, position, placed, stretch, shrink, flatness):
    """Take palm markers that cannot be those of this hand for not seen.

    Parameters
    ----------
    markers : ndarray, shape (8, 3)
        [m]
    seen : ndarray of bool, shape (8,)
        Its first three are cleared where there is a fault.
    template, rotation, position, placed
        As for `follow_palm`.
    stretch, shrink, flatness
        As for `palm_fault`.

    Returns
    -------
    int
        As of `palm_fault`.
    """
    if not (seen[0] or seen[1] or seen[2]) or not placed and not (
            seen[0] and seen[1] and seen[2]):
        return TRACKED
    points = carry_palm((vector(markers[0]), vector(markers[1]), vector(markers[2])),
                        _template_places(template, rotation, position),
                        (seen[0], seen[1], seen[2]))
    palm = np.empty((3, 3))
    for i in range(3):
        store(palm, i, points[i])
    fault = palm_fault(palm, template, stretch, shrink, flatness)
    if fault != TRACKED:
        for i in range(3):
            seen[i] = False
    return fault


@jit
def _template_places(template, rotation, position):
    """Return where a pose has the palm's markers."""
    axes = frame(rotation)
    origin = vector(position)
    return (add(origin, rotate(axes, vector(template[0]))),
            add(origin, rotate(axes, vector(template[1]))),
            add(origin, rotate(axes, vector(template[2]))))


@jit
def follow_palm(markers, seen, tracks, digits, rotation, position, template, placed, step,
                noise, smooth, fading, by_fingers, longest):
    """Bring the palm's tracks to this frame.

    Parameters
    ----------
    markers : ndarray, shape (8, 3)
        [m]
    seen : ndarray of bool, shape (8,)
    tracks, digits : Tracks
        Of the palm's markers, changed, and of the digits'.
    rotation, position : ndarray, shape (3, 3) and (3,)
        The wrist's pose in the last frame [m].
    template : ndarray, shape (3, 3)
        The palm's markers in the wrist's frame [m].
    placed : bool
        Whether there was a last pose.
    noise : ndarray, shape (8,)
        Of each marker, standard deviation on an axis [m].
    step, smooth, fading
        See `update_track` and `predict_track`.
    by_fingers : bool
        Whether the fingers' markers tell of a hidden one.
    longest : float
        Time without any palm marker for which they do [s].

    Returns
    -------
    int
        TRACKED, CARRIED, LOST or WAITING, of `PalmState`.
    """
    count = 0
    for i in range(3):
        if seen[i]:
            count += 1
    if count < 3 and not placed:
        return WAITING
    before = _template_places(template, rotation, position)
    for i in range(3):
        if seen[i]:
            update_track(tracks, i, vector(markers[i]), step, noise[i], smooth)
    if count < 3:
        seen_palm = (seen[0], seen[1], seen[2])
        carried = carry_palm(_places(tracks, 0.), before, seen_palm)
        ahead = carry_palm(_places(tracks, INSTANT), carried, seen_palm)
        for i in range(3):
            if not seen[i]:
                start = vector(tracks.mean[i])
                predict_track(tracks, i, subtract(carried[i], start),
                              scale(subtract(ahead[i], carried[i]), 1. / INSTANT), step, fading)
        hidden_for = min(tracks.hidden_for[0], tracks.hidden_for[1], tracks.hidden_for[2])
        if by_fingers and (count > 0 or hidden_for <= longest):
            _fit_to_fingers(markers, seen, tracks, digits, template, count)
    for i in range(3):
        tracks.seen[i] = seen[i]
    return TRACKED if count == 3 else CARRIED if count > 0 else LOST


@jit
def _places(tracks, ahead):
    """Return the three places, extrapolated by a time [s]."""
    mean, pace = tracks.mean, tracks.pace
    return (add(vector(mean[0]), scale(vector(pace[0]), ahead)),
            add(vector(mean[1]), scale(vector(pace[1]), ahead)),
            add(vector(mean[2]), scale(vector(pace[2]), ahead)))


@jit
def _fit_to_fingers(markers, seen, tracks, digits, template, count):
    """Move hidden palm markers to where a rigid fit that includes the fingers has them."""
    axes, origin = rigid_palm(
        vector(tracks.mean[0]), vector(tracks.mean[1]), vector(tracks.mean[2]),
        vector(template[0]), vector(template[1]), vector(template[2]))
    points = np.zeros((8, 3))
    aims = np.zeros((8, 3))
    weights = np.zeros(8)
    for i in range(3):
        weights[i] = SEEN_WEIGHT if seen[i] else PREDICTED_WEIGHTS[count]
        store(points, i, vector(tracks.mean[i]))
        store(aims, i, vector(tracks.mean[i]))
    for i in range(3, 8):
        # In a palm that is lost no digit is followed, and each keeps the place it had.
        if seen[i] and (digits.seen[i - 3] or count == 0 and digits.known[i - 3]):
            expected = add(origin, rotate(axes, vector(digits.mean[i - 3])))
            weights[i] = 1.
            store(points, i, expected)
            store(aims, i, vector(markers[i]))
    for _ in range(FITS):
        _lay_on(points, aims, weights)
    for i in range(3):
        if not seen[i]:
            store(tracks.mean, i, vector(points[i]))


@jit
def _lay_on(points, aims, weights):
    """Move points rigidly towards their aims, by a linear step of the least squares."""
    total = 0.
    center = (0., 0., 0.)
    shift = (0., 0., 0.)
    for i in range(len(weights)):
        point = vector(points[i])
        total += weights[i]
        center = add(center, scale(point, weights[i]))
        shift = add(shift, scale(subtract(vector(aims[i]), point), weights[i]))
    center = scale(center, 1. / total)
    shift = scale(shift, 1. / total)

    # The small turn that takes the misses away
    inertia = np.zeros((3, 3))
    moment = (0., 0., 0.)
    for i in range(len(weights)):
        point = vector(points[i])
        arm = subtract(point, center)
        moment = add(moment, scale(cross(arm, subtract(vector(aims[i]), point)), weights[i]))
        for k in range(3):
            inertia[k, k] += weights[i] * dot(arm, arm)
            for j in range(3):
                inertia[k, j] -= weights[i] * arm[k] * arm[j]
    turned = _solved(vector(inertia[0]), vector(inertia[1]), vector(inertia[2]), moment)
    axis, angle = unit(turned), length(turned)
    for i in range(len(weights)):
        arm = subtract(vector(points[i]), center)
        store(points, i, add(rotate_about(axis, angle, arm), add(shift, center)))


@jit
def _solved(a, b, c, m):
    """Return the x with [a b c] x = m, for a symmetric positive matrix; 0 for a singular one."""
    volume = dot(a, cross(b, c))
    if not volume > 0.:
        return (0., 0., 0.)
    return scale((dot(m, cross(b, c)), dot(a, cross(m, c)), dot(a, cross(b, m))), 1. / volume)


@jit
def carry_palm(points, expected, seen):
    """Return the three palm markers, the hidden ones carried by those seen.

    Parameters
    ----------
    points : tuple of three vectors
        Measured r, p, q; those not seen are not read [m].
    expected : tuple of three vectors
        Where the previous pose of the palm has them [m].
    seen : tuple of three bool

    Returns
    -------
    tuple of three vectors
        With one hidden the expected triangle turns by the smallest rotation that lays
        the seen side right; with two hidden it is shifted [m].
    """
    r, p, q = points
    if seen[0] and seen[1] and not seen[2]:
        q = _carry(r, p, expected[0], expected[1], expected[2])
    elif seen[0] and seen[2] and not seen[1]:
        p = _carry(r, q, expected[0], expected[2], expected[1])
    elif seen[1] and seen[2] and not seen[0]:
        r = _carry(p, q, expected[1], expected[2], expected[0])
    else:
        for i in range(3):
            if seen[i]:
                shift = subtract(points[i], expected[i])
                if not seen[0]:
                    r = add(expected[0], shift)
                if not seen[1]:
                    p = add(expected[1], shift)
                if not seen[2]:
                    q = add(expected[2], shift)
    return r, p, q


@jit
def _carry(a, b, expected_a, expected_b, expected_c):
    """Return c when a and b are seen and all three were expected elsewhere."""
    before = unit(subtract(expected_b, expected_a))
    now = unit(subtract(b, a))
    axis = cross(before, now)
    angle = math.atan2(length(axis), dot(before, now))
    middle = scale(add(a, b), 0.5)
    expected_middle = scale(add(expected_a, expected_b), 0.5)
    arm = subtract(expected_c, expected_middle)
    return add(middle, rotate_about(unit(axis), angle, arm))


@jit
def expected_markers(palm, digits, template, step, expected):
    """Write where all markers are expected after a step, if they move on as they did.

    Parameters
    ----------
    palm, digits : Tracks
    template : ndarray, shape (3, 3)
        The palm's markers in the wrist's frame [m].
    step : float
        [s]
    expected : ndarray, shape (8, 3)
        Replaced [m].
    """
    places = (_onward(palm, 0, step), _onward(palm, 1, step), _onward(palm, 2, step))
    axes, origin = rigid_palm(places[0], places[1], places[2], vector(template[0]),
                              vector(template[1]), vector(template[2]))
    for i in range(8):
        store(expected, i, places[i] if i < 3 else add(
            origin, rotate(axes, _onward(digits, i - 3, step))))


@jit
def _onward(tracks, row, step):
    """Return where a marker goes on to: a seen one by its filter, which does not lag."""
    mean = tracks.mean[row]
    velocity = vector(mean[3:]) if tracks.seen[row] else vector(tracks.pace[row])
    return add(vector(mean), scale(velocity, step))
