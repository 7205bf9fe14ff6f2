"""Signed distance of a hand's surface: smooth union of tapered capsules, a palm and webs.

All positions are of a right hand in the wrist frame. The shape's constants are unsourced: chosen
by eye until the rendered surface looked like a hand.
"""

from typing import NamedTuple

import numpy as np

from ..core.model.hand import FINGERS, JOINTS, LINKS, MCP_OF_LENGTH, MEAN_LENGTH, Hand
from ..core.model.kinematics import Pose, forward, joint_table, tip_offsets
from ..core.model.skeleton import DIGIT_CHAINS, skeleton_points
from ..core.numerics.vectors import unit_vectors

# [degrees] abduction in the pose of the surface: parallel fingers would merge.
MODELLING_ABDUCTION_DEG = {'index': 13., 'middle': 0., 'ring': 11., 'little': 19.}
# [mm of the mean hand] Calibrated radii may be thinner: they are bounds from recorded postures.
MIN_DIGIT_RADIUS, MIN_PALM_RADIUS = 4.5, 8.


class HandShape(NamedTuple):
    """Dimensions of a right hand's surface, its fingers spread.

    Attributes
    ----------
    points : ndarray, shape (31, 3)
        `skeleton_points` [m].
    pose : Pose
        Of the 25 links.
    radii : ndarray, shape (5, 3)
        Of the phalanges [m].
    palm_radius : float
        [m]
    millimetre : float
        A millimetre of the mean hand, scaled to this hand [m].
    """

    points: np.ndarray
    pose: Pose
    radii: np.ndarray
    palm_radius: float
    millimetre: float


def hand_shape(hand: Hand) -> HandShape:
    """Return the dimensions of a hand's surface, as a right hand with its fingers spread."""
    right = hand.as_right()
    angles = np.zeros(len(JOINTS))
    for finger, degrees in MODELLING_ABDUCTION_DEG.items():
        angles[JOINTS.index(f'{finger}_mcp_abduction')] = np.radians(degrees)
    pose = forward(joint_table(right), angles)
    mm = .001 * float(np.linalg.norm(hand.finger_mcp[1])) / (MCP_OF_LENGTH[1] * MEAN_LENGTH)
    return HandShape(
        skeleton_points(tip_offsets(right), pose, np.zeros(3)), pose,
        np.maximum(hand.radii, MIN_DIGIT_RADIUS * mm), max(hand.palm_radius, MIN_PALM_RADIUS * mm),
        mm)


def signed_distance(shape: HandShape, points: np.ndarray) -> np.ndarray:
    """Return the signed distance of points to the hand's surface, negative inside.

    Parameters
    ----------
    shape : HandShape
    points : ndarray, shape (n, 3)
        [m]

    Returns
    -------
    ndarray, shape (n,)
        [m]; exact only at zero.
    """
    mm = shape.millimetre
    distance = palm(shape, points)
    for digit in range(len(FINGERS)):
        distance = _smooth_union(distance, finger(shape, digit, points), 5. * mm)
    return _smooth_union(distance, thumb(shape, points), 12. * mm)


def finger(shape: HandShape, digit: int, points: np.ndarray) -> np.ndarray:
    """Return the signed distance to a finger, from its knuckle to its tip, shape (n,) [m]."""
    mm = shape.millimetre
    mcp, pip, dip, tip = shape.points[list(DIGIT_CHAINS[digit][1:])]
    first, second, third = shape.radii[digit]
    down = -_dorsal(shape, f'{FINGERS[digit]}_proximal')
    end = tip - 1.05 * third * unit_vectors(tip - dip)
    # The pulp of each phalanx lies palmar of the bone, the joints dorsal of it.
    proximal = _tapered_capsule(points, mcp, pip, 1.12 * first, second + .4 * mm, -.3 * mm)
    proximal_pulp = _tapered_capsule(
        points, mcp + .3 * (pip - mcp) + 1.2 * mm * down,
        mcp + .7 * (pip - mcp) + 1.2 * mm * down, .95 * first, .9 * first)
    middle = _tapered_capsule(
        points, pip, dip + .3 * mm * down, second + .4 * mm, third + .2 * mm, -.3 * mm)
    middle_pulp = _tapered_capsule(
        points, pip + .4 * (dip - pip) + mm * down, pip + .6 * (dip - pip) + mm * down,
        .9 * second, .88 * second)
    distal = _tapered_capsule(
        points, dip + .3 * mm * down, end + .8 * mm * down, third, .9 * third, .3 * mm, down, .9)
    distance = _smooth_union(proximal, proximal_pulp, 5. * mm)
    distance = _smooth_union(distance, middle, 2. * mm)
    distance = _smooth_union(distance, middle_pulp, 5. * mm)
    return _smooth_union(distance, distal, 2. * mm)


def thumb(shape: HandShape, points: np.ndarray) -> np.ndarray:
    """Return the signed distance to the thumb, thenar and web to the index, shape (n,) [m]."""
    mm = shape.millimetre
    cmc, mcp, ip, tip = shape.points[list(DIGIT_CHAINS[4])]
    first, second, third = shape.radii[4]
    down = -_dorsal(shape, 'thumb_proximal')
    knuckle, root = shape.points[DIGIT_CHAINS[0][1]], shape.points[DIGIT_CHAINS[0][0]]
    end = tip - 1.05 * third * unit_vectors(tip - ip)
    metacarpal = _tapered_capsule(points, cmc, mcp, 1.15 * first, 1.02 * first)
    # The thenar is thickest over the proximal half of the metacarpal.
    thenar = _tapered_capsule(
        points, np.array((24., 8., -15.)) * mm,
        cmc + .75 * (mcp - cmc) + (0., -3. * mm, -2. * mm), 1.25 * first, first)
    proximal = _tapered_capsule(points, mcp, ip, 1.02 * first, .98 * second, -.5 * mm)
    distal = _tapered_capsule(
        points, ip + .3 * mm * down, end + .6 * mm * down, 1.02 * second, .92 * third, .2 * mm,
        down, .84)
    web = _rounded_triangle(points, .5 * (cmc + root), cmc + .92 * (mcp - cmc),
                            root + .82 * (knuckle - root), 4.5 * mm)
    distance = _smooth_union(metacarpal, thenar, 8. * mm)
    distance = _smooth_union(distance, proximal, 4. * mm)
    distance = _smooth_union(distance, distal, 3. * mm)
    return _smooth_union(distance, web, 10. * mm)


def palm(shape: HandShape, points: np.ndarray) -> np.ndarray:
    """Return the signed distance to palm, wrist stump and finger webs, shape (n,) [m]."""
    mm = shape.millimetre
    radius = shape.palm_radius
    metacarpals = []
    for digit in range(len(FINGERS)):
        cmc, mcp = shape.points[list(DIGIT_CHAINS[digit][:2])]
        metacarpals.append(_tapered_capsule(
            points, cmc + (0., 0., -2.5 * mm), mcp + (0., 0., -1.2 * mm), radius,
            max(1.15 * shape.radii[digit, 0], .9 * radius)))
    distance = metacarpals[0]
    for metacarpal in metacarpals[1:]:
        distance = _smooth_union(distance, metacarpal, 8. * mm)
    cmc, mcp = shape.points[list(DIGIT_CHAINS[3][:2])]
    hypothenar = _tapered_capsule(
        points, np.array((16., -15., -8.)) * mm,
        cmc + .75 * (mcp - cmc) + np.array((0., -2., -5.)) * mm, 1.15 * radius, .95 * radius)
    distance = _smooth_union(distance, hypothenar, 9. * mm)
    down = np.array((0., 0., -2. * mm))
    for a, b in zip(DIGIT_CHAINS[:3], DIGIT_CHAINS[1:4]):
        (near, first), (far, second) = shape.points[np.array((a[:2], b[:2]))]
        between = _rounded_quadrilateral(points - 1.5 * down, near, far, first, second, .7 * radius)
        distance = _smooth_union(distance, between, 4. * mm)
        ahead = first + .3 * (shape.points[a[2]] - first), second + .3 * (
            shape.points[b[2]] - second)
        web = _rounded_quadrilateral(points - down, first, second, *ahead, 5. * mm)
        distance = _smooth_union(distance, web, 4. * mm)
    return _cut_proximal(
        _smooth_union(distance, _wrist(shape, points), 12. * mm), points, -24. * mm, 7. * mm)


def _wrist(shape: HandShape, points: np.ndarray) -> np.ndarray:
    """Return the signed distance to the wrist: an oval cylinder along x."""
    mm = shape.millimetre
    x, y, z = (points - np.array((0., -3., -5.5)) * mm).T
    beside = np.maximum(np.abs(y) - 12.5 * mm, 0.)
    return -_smooth_union(13.5 * mm - np.hypot(beside, z), 16. * mm - x, 10. * mm)


def _cut_proximal(distance: np.ndarray, points: np.ndarray, x: float, k: float) -> np.ndarray:
    """Return the signed distance to the part distal of x [m], its rim rounded by k [m]."""
    return -_smooth_union(-distance, points[:, 0] - x, k)


def _smooth_union(a: np.ndarray, b: np.ndarray, k: float) -> np.ndarray:
    """Return the smooth union of two signed distances, blended where they differ by < k [m]."""
    near = np.maximum(k - np.abs(a - b), 0.) / k
    return np.minimum(a, b) - .25 * k * near * near


def _tapered_capsule(points: np.ndarray, start: np.ndarray, end: np.ndarray, start_radius: float,
                     end_radius: float, bulge: float = 0., flat_axis: np.ndarray | None = None,
                     flatness: float = 1.) -> np.ndarray:
    """Return the signed distance to a tapered capsule.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        [m]
    start, end : ndarray, shape (3,)
        Centres of its ends [m].
    start_radius, end_radius : float
        [m]
    bulge : float
        Added to the radius in the middle [m].
    flat_axis : ndarray, shape (3,), optional
        Unit direction along which the capsule is flattened.
    flatness : float
        Its thickness along that direction, relative to that across [1].

    Returns
    -------
    ndarray, shape (n,)
        [m]
    """
    along = end - start
    t = np.clip((points - start) @ along / (along @ along), 0., 1.)
    offset = points - start - t[:, None] * along
    if flat_axis is not None:
        offset = offset + (offset @ flat_axis * (1. / flatness - 1.))[:, None] * flat_axis
    return (np.sqrt(np.einsum('ni,ni->n', offset, offset)) - start_radius
            - t * (end_radius - start_radius) - 4. * bulge * t * (1. - t))


def _rounded_quadrilateral(points: np.ndarray, a: np.ndarray, b: np.ndarray, c: np.ndarray,
                           d: np.ndarray, radius: float) -> np.ndarray:
    """Return the distance [m] to the triangles a b c and b c d; see `_rounded_triangle`."""
    return np.minimum(_rounded_triangle(points, a, b, c, radius),
                      _rounded_triangle(points, b, c, d, radius))


def _rounded_triangle(points: np.ndarray, a: np.ndarray, b: np.ndarray, c: np.ndarray,
                      radius: float) -> np.ndarray:
    """Return the signed distance to the points within `radius` of a triangle [m], shape (n,)."""
    u, v, w = b - a, c - a, points - a
    uu, uv, vv = u @ u, u @ v, v @ v
    wu, wv = w @ u, w @ v
    scale = uu * vv - uv * uv
    s, t = (vv * wu - uv * wv) / scale, (uu * wv - uv * wu) / scale
    offset = w - s[:, None] * u - t[:, None] * v
    inside = (s >= 0.) & (t >= 0.) & (s + t <= 1.)
    edges = np.min([_tapered_capsule(points, p, q, 0., 0.)
                    for p, q in ((a, b), (b, c), (c, a))], axis=0)
    return np.where(inside, np.linalg.norm(offset, axis=1), edges) - radius


def _dorsal(shape: HandShape, link: str) -> np.ndarray:
    """Return the dorsal axis of a link, z of its frame."""
    return shape.pose.rotation[LINKS.index(link), :, 2]
