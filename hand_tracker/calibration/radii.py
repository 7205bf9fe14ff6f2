"""Bound the radii of the digits' capsules by recorded postures."""

import numpy as np

from ..core.inverse_kinematics.abduction_plane import REFERENCE_STEP
from ..core.inverse_kinematics.digit import digit_chains, solve_digits
from ..core.model.capsules import hand_capsules, pair_gaps
from ..core.model.hand import DIGITS, FINGERS, JOINTS, Hand
from ..core.model.marker_layout import MARKERS, PAPER_PLACES, MarkerLayout
from ..core.numerics.sampling import evenly_spaced
from ..core.pose.contact import PENETRATION
from .landmarks import LANDMARKS

RADII_FIT_FRAMES = 300
OUTLIER_PERCENTAGE = 1.  # of the frames, in which an overlap is taken for an error
MIN_RADIUS_SHARE = .5    # of the initial radii; ours, unsourced
MARKER_LANDMARKS = [LANDMARKS.index(place) for place in PAPER_PLACES[MARKERS.index('index'):]]


def fit_radii(hand: Hand, local: np.ndarray) -> Hand:
    """Return `hand` with its capsules thinned until recorded postures are free of overlap.

    Radii scaled with the hand's length are guesses. Where two capsules overlap in recorded
    postures, as tracked, both radii are reduced by half the overlap.

    Parameters
    ----------
    hand : Hand
        Fitted in all but its radii.
    local : ndarray, shape (T, 21, 3)
        Landmarks of a right hand in the palm frame, in the order of `LANDMARKS` [m].

    Returns
    -------
    Hand
    """
    right = hand.as_right()
    digits = digit_chains(right, MarkerLayout().mounting(right))
    frames = evenly_spaced(len(local), RADII_FIT_FRAMES)
    postures = np.zeros((len(frames), len(JOINTS)))
    for angles, markers in zip(postures, local[frames][:, MARKER_LANDMARKS]):
        solve_digits(digits, digits.root.copy(), np.array(markers, order='C'), angles,
                     REFERENCE_STEP, False, 1e-5, 1)
    return thinned(hand, postures)


def thinned(hand: Hand, postures: np.ndarray) -> Hand:
    """Return `hand` with its capsules thinned until postures are free of overlap.

    Parameters
    ----------
    hand : Hand
    postures : ndarray, shape (n, 25)
        [rad]

    Returns
    -------
    Hand
    """
    body = hand_capsules(hand.as_right())
    gaps = [pair_gaps(body, angles.copy()) for angles in postures]
    overlap = -np.percentile(gaps, OUTLIER_PERCENTAGE, axis=0)
    excess = np.maximum(overlap - PENETRATION, 0.)
    thinner = np.zeros(len(body.link))
    np.maximum.at(thinner, body.first, excess / 2.)
    np.maximum.at(thinner, body.second, excess / 2.)
    # Order of the capsules: bones of the digits, palm, phalanges distal of the web.
    bones, palm, webbed = np.split(thinner, (3 * len(DIGITS), 3 * len(DIGITS) + len(FINGERS)))
    bones = bones.reshape(-1, 3)
    bones[:len(FINGERS), 0] = np.maximum(bones[:len(FINGERS), 0], webbed)
    return hand.replace(
        radii=np.maximum(hand.radii - bones, MIN_RADIUS_SHARE * hand.radii),
        palm_radius=max(hand.palm_radius - palm.max(), MIN_RADIUS_SHARE * hand.palm_radius))
