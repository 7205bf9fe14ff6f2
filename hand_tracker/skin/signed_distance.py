"""The flesh of a hand as a signed distance: smooth union of tapered capsules, a palm and webs.

Everything is that of a right hand in the wrist's frame. Shapes are unsourced: drawn until the
pictures looked like a hand.
"""

from typing import NamedTuple

import numpy as np

from ..core.model.hand import FINGERS, JOINTS, LINKS, MCP_OF_LENGTH, MEAN_LENGTH
from ..core.model.kinematics import forward, joint_table, tip_offsets
from ..core.model.skeleton import DIGIT_CHAINS, skeleton_points

# [degrees] abduction at which the skin is made: side by side, digits would grow together.
SPREAD_DEG = {'index': 13., 'middle': 0., 'ring': 11., 'little': 19.}
# [mm of the mean hand] Calibrated radii may be thinner than any flesh: postures must be free.
THINNEST, THIN_PALM = 4.5, 8.


class Flesh(NamedTuple):
    """Where the flesh of a right hand is.

    Attributes
    ----------
    points : ndarray, shape (31, 3)
        `skeleton_points` with the digits spread [m].
    pose : Pose
        The links with the digits spread.
    radii : ndarray, shape (5, 3)
        [m]
    palm_radius : float
        [m]
    size : float
        [m] that are a millimetre of the mean hand.
    """

    points: np.ndarray
    pose: object
    radii: np.ndarray
    palm_radius: float
    size: float


def flesh_of(hand):
    """Return the flesh of a hand, as a right hand with its digits spread."""
    right = hand.replace(side='right')
    angles = np.zeros(len(JOINTS))
    for finger, degrees in SPREAD_DEG.items():
        angles[JOINTS.index(f'{finger}_mcp_abduction')] = np.radians(degrees)
    pose = forward(joint_table(right), angles)
    size = .001 * np.linalg.norm(hand.finger_mcp[1]) / (MCP_OF_LENGTH[1] * MEAN_LENGTH)
    return Flesh(skeleton_points(tip_offsets(right), pose, np.zeros(3)), pose,
                 np.maximum(hand.radii, THINNEST * size), max(hand.palm_radius, THIN_PALM * size),
                 size)


def distance(flesh, at):
    """Return the signed distance of places to the skin, negative inside.

    Parameters
    ----------
    flesh : Flesh
    at : ndarray, shape (n, 3)
        [m]

    Returns
    -------
    ndarray, shape (n,)
        Exact only at zero [m].
    """
    mm = flesh.size
    found = palm(flesh, at)
    for digit in range(len(FINGERS)):
        found = union(found, finger(flesh, digit, at), 5. * mm)
    return union(found, thumb(flesh, at), 12. * mm)


def finger(flesh, digit, at):
    """Return the signed distance to a finger, from its knuckle to its tip."""
    mm = flesh.size
    mcp, pip, dip, tip = flesh.points[list(DIGIT_CHAINS[digit][1:])]
    first, second, third = flesh.radii[digit]
    down = -_dorsal(flesh, f'{FINGERS[digit]}_proximal')
    end = tip - 1.05 * third * _unit(tip - dip)
    # The pulp of each phalanx lies before the bone, the joints behind it.
    found = tube(at, mcp, pip, 1.12 * first, second + .4 * mm, -.3 * mm)
    found = union(found, tube(at, mcp + .3 * (pip - mcp) + 1.2 * mm * down,
                              mcp + .7 * (pip - mcp) + 1.2 * mm * down,
                              .95 * first, .9 * first), 5. * mm)
    found = union(found, tube(at, pip, dip + .3 * mm * down, second + .4 * mm,
                              third + .2 * mm, -.3 * mm), 2. * mm)
    found = union(found, tube(at, pip + .4 * (dip - pip) + mm * down,
                              pip + .6 * (dip - pip) + mm * down,
                              .9 * second, .88 * second), 5. * mm)
    return union(found, tube(at, dip + .3 * mm * down, end + .8 * mm * down,
                             third, .9 * third, .3 * mm, down, .9), 2. * mm)


def thumb(flesh, at):
    """Return the signed distance to the thumb, its ball and the web to the index finger."""
    mm = flesh.size
    cmc, mcp, ip, tip = flesh.points[list(DIGIT_CHAINS[4])]
    first, second, third = flesh.radii[4]
    down = -_dorsal(flesh, 'thumb_proximal')
    knuckle, root = flesh.points[DIGIT_CHAINS[0][1]], flesh.points[DIGIT_CHAINS[0][0]]
    end = tip - 1.05 * third * _unit(tip - ip)
    found = tube(at, cmc, mcp, 1.15 * first, 1.02 * first)
    # The ball of the thumb: thick over the near half of the metacarpal.
    ball = np.array((24., 8., -15.)) * mm
    found = union(found, tube(at, ball, cmc + .75 * (mcp - cmc) + (0., -3. * mm, -2. * mm),
                              1.25 * first, first), 8. * mm)
    found = union(found, tube(at, mcp, ip, 1.02 * first, .98 * second, -.5 * mm), 4. * mm)
    found = union(found, tube(at, ip + .3 * mm * down, end + .6 * mm * down, 1.02 * second,
                              .92 * third, .2 * mm, down, .84), 3. * mm)
    web = triangle(at, .5 * (cmc + root), cmc + .92 * (mcp - cmc), root + .82 * (knuckle - root),
                   4.5 * mm)
    return union(found, web, 10. * mm)


def palm(flesh, at):
    """Return the signed distance to the palm, the wrist's stump and the webs of the fingers."""
    mm = flesh.size
    radius = flesh.palm_radius
    found = None
    for digit in range(len(FINGERS)):
        cmc, mcp = flesh.points[list(DIGIT_CHAINS[digit][:2])]
        part = tube(at, cmc + (0., 0., -2.5 * mm), mcp + (0., 0., -1.2 * mm), radius,
                    max(1.15 * flesh.radii[digit, 0], .9 * radius))
        found = part if found is None else union(found, part, 8. * mm)
    cmc, mcp = flesh.points[list(DIGIT_CHAINS[3][:2])]
    # The ball of the little finger.
    found = union(found, tube(at, np.array((16., -15., -8.)) * mm,
                              cmc + .75 * (mcp - cmc) + np.array((0., -2., -5.)) * mm,
                              1.15 * radius, .95 * radius), 9. * mm)
    down = np.array((0., 0., -2. * mm))
    for a, b in zip(DIGIT_CHAINS[:3], DIGIT_CHAINS[1:4]):
        (near, first), (far, second) = flesh.points[[[a[0], a[1]], [b[0], b[1]]]]
        found = union(found, quadrilateral(at - 1.5 * down, near, far, first, second,
                                           .7 * radius), 4. * mm)
        ahead = first + .3 * (flesh.points[a[2]] - first), second + .3 * (
            flesh.points[b[2]] - second)
        found = union(found, quadrilateral(at - down, first, second, *ahead, 5. * mm), 4. * mm)
    return _cut(union(found, _stump(flesh, at), 12. * mm), at, -24. * mm, 7. * mm)


def _stump(flesh, at):
    """Return the signed distance to the wrist: a flat tube along x."""
    mm = flesh.size
    x, y, z = (at - np.array((0., -3., -5.5)) * mm).T
    beside = np.maximum(np.abs(y) - 12.5 * mm, 0.)
    return -union(13.5 * mm - np.hypot(beside, z), 16. * mm - x, 10. * mm)


def _cut(found, at, x, k):
    """Return the part of a shape distal of x, its rim rounded."""
    return -union(-found, at[:, 0] - x, k)


def union(a, b, k):
    """Return the smooth union of two signed distances, blended where they differ by < k."""
    near = np.maximum(k - np.abs(a - b), 0.) / k
    return np.minimum(a, b) - .25 * k * near * near


def tube(at, start, end, first, second, belly=0., flat_along=None, flat=1.):
    """Return the signed distance to a tapered capsule.

    Parameters
    ----------
    at : ndarray, shape (n, 3)
        [m]
    start, end : ndarray, shape (3,)
        [m]
    first, second : float
        Radius at start and end [m].
    belly : float
        By which the radius is greater in the middle [m].
    flat_along : ndarray, shape (3,), optional
        Unit direction in which it is flattened.
    flat : float
        To this share.
    """
    along = end - start
    t = np.clip((at - start) @ along / (along @ along), 0., 1.)
    off = at - start - t[:, None] * along
    if flat_along is not None:
        off = off + (off @ flat_along * (1. / flat - 1.))[:, None] * flat_along
    return (np.sqrt(np.einsum('ni,ni->n', off, off)) - first - t * (second - first)
            - 4. * belly * t * (1. - t))


def quadrilateral(at, a, b, c, d, thickness):
    """Return the signed distance to the triangles a b c and b c d, see `triangle`."""
    return np.minimum(triangle(at, a, b, c, thickness), triangle(at, b, c, d, thickness))


def triangle(at, a, b, c, thickness):
    """Return the signed distance to a triangle with round edges, `thickness` being half of it."""
    u, v, w = b - a, c - a, at - a
    uu, uv, vv = u @ u, u @ v, v @ v
    wu, wv = w @ u, w @ v
    scale = uu * vv - uv * uv
    s, t = (vv * wu - uv * wv) / scale, (uu * wv - uv * wu) / scale
    off = w - s[:, None] * u - t[:, None] * v
    inside = (s >= 0.) & (t >= 0.) & (s + t <= 1.)
    edges = np.min([tube(at, p, q, 0., 0.) for p, q in ((a, b), (b, c), (c, a))], axis=0)
    return np.where(inside, np.linalg.norm(off, axis=1), edges) - thickness


def _dorsal(flesh, link):
    return flesh.pose.rotation[LINKS.index(link), :, 2]


def _unit(vector):
    return vector / np.linalg.norm(vector)
