"""Errors of joints against a capture, and those of the method that anyone would try first."""

import numpy as np
from scipy.spatial.transform import Rotation

CLASSES = {'mcp': slice(5, None, 4), 'pip': slice(6, None, 4), 'dip': slice(7, None, 4),
           'tip': slice(8, None, 4), 'thumb_cmc': 1, 'thumb_mcp': 2, 'thumb_ip': 3,
           'thumb_tip': 4}
PALM_POINT_ROWS = [0, 5, 17]


def in_palm(joints, template):
    """Return joints (n, 21, 3) in the frame of a template (3, 3) of wrist and two knuckles."""
    center = joints[:, PALM_POINT_ROWS].mean(axis=1, keepdims=True)
    rotation = np.array([Rotation.align_vectors(
        template - template.mean(axis=0), frame)[0].as_matrix()
        for frame in joints[:, PALM_POINT_ROWS] - center])
    return np.einsum('nij,nkj->nki', rotation, joints - center) + template.mean(axis=0)


def plain_pip_errors(fitted, judged):
    """Return the PIP errors (n, 4) [m] of the method that anyone would try first.

    Medians for palm and bones, a rigid palm, the exact two-bone solution in the plane of
    the palm's normal, no limits.
    """
    fitted, judged = (part.right().joints for part in (fitted, judged))
    first = fitted[0] - fitted[0, 0]
    x = first[9] / np.linalg.norm(first[9])
    z = np.cross(first[17], first[5])
    z -= (z @ x) * x
    z /= np.linalg.norm(z)
    template = np.median(
        in_palm(fitted, (first @ np.column_stack((x, np.cross(z, x), z)))[PALM_POINT_ROWS]), axis=0)
    local = in_palm(judged, template[PALM_POINT_ROWS])
    errors = np.empty((len(local), 4))
    for finger in range(4):
        mcp, pip, dip = (5 + 4 * finger + joint for joint in range(3))
        l1, l2 = (np.median(np.linalg.norm(fitted[:, b] - fitted[:, a], axis=1))
                  for a, b in ((mcp, pip), (pip, dip)))
        target = local[:, dip] - template[mcp]
        ahead = np.hypot(target[:, 0], target[:, 1])
        aim = np.column_stack((target[:, :2] / ahead[:, None], np.zeros(len(target))))
        bend = np.arccos(np.clip((ahead ** 2 + target[:, 2] ** 2 - l1 ** 2 - l2 ** 2)
                                 / (2. * l1 * l2), -1., 1.))
        down = np.arctan2(-target[:, 2], ahead) - np.arctan2(
            l2 * np.sin(bend), l1 + l2 * np.cos(bend))
        place = template[mcp] + l1 * (np.cos(down)[:, None] * aim
                                      - np.outer(np.sin(down), (0., 0., 1.)))
        errors[:, finger] = np.linalg.norm(place - local[:, pip], axis=1)
    return errors


def class_errors(joints, capture):
    misses = np.linalg.norm(joints - capture.joints, axis=2)
    return {name: misses[:, rows] for name, rows in CLASSES.items()}
