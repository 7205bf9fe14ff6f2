"""How thick a person's digits are, as far as recorded postures bound it."""

import numpy as np

from ..core.inverse_kinematics.abduction_plane import REFERENCE_STEP
from ..core.inverse_kinematics.digit import chains, solve_digits
from ..core.model.capsules import capsules, pair_gaps
from ..core.model.hand import DIGITS, FINGERS, JOINTS
from ..core.model.marker_layout import MARKERS, PAPER_PLACES, MarkerLayout
from ..core.pose.contact import PENETRATION
from .landmarks import LANDMARKS

FIT_FRAMES = 300   # spread over the recording
RARE = 1.          # [percent] of the frames in which an overlap is taken for an error
THIN = .5          # share of the radii that is kept at least; ours, unsourced
MARKER_ROWS = [LANDMARKS.index(place) for place in PAPER_PLACES[MARKERS.index('index'):]]


def fit_radii(hand, local):
    """Return `hand` with capsules so thin that they pass through its recorded postures.

    Radii scaled with the hand's length are guesses. Where two capsules overlap in postures
    that were recorded, as the tracker sees them, both are made thinner by half the overlap.

    Parameters
    ----------
    hand : Hand
        Fitted in all but its radii.
    local : ndarray, shape (T, 21, 3)
        The joints of a right hand in the palm's frame, in the order of `LANDMARKS` [m].

    Returns
    -------
    Hand
    """
    right = hand.replace(side='right')
    body, digits = capsules(right), chains(right, MarkerLayout().mounting(right))
    every = np.unique(np.linspace(0, len(local) - 1, FIT_FRAMES).astype(int))
    gaps = []
    for markers in local[every][:, MARKER_ROWS]:
        angles = np.zeros(len(JOINTS))
        solve_digits(digits, digits.root.copy(), np.array(markers, order='C'), angles, REFERENCE_STEP,
                     False, 1e-5, 1)
        gaps.append(pair_gaps(body, angles))
    excess = np.maximum(-np.percentile(gaps, RARE, axis=0) - PENETRATION, 0.)
    thinner = np.zeros(len(body.link))
    np.maximum.at(thinner, body.first, excess / 2.)
    np.maximum.at(thinner, body.second, excess / 2.)
    # The palm and the phalanges beyond the web come after the bones of the digits.
    bones, palm, webbed = np.split(thinner, (3 * len(DIGITS), 3 * len(DIGITS) + len(FINGERS)))
    bones = bones.reshape(-1, 3)
    bones[:len(FINGERS), 0] = np.maximum(bones[:len(FINGERS), 0], webbed)
    return hand.replace(
        radii=np.maximum(hand.radii - bones, THIN * hand.radii),
        palm_radius=max(hand.palm_radius - palm.max(), THIN * hand.palm_radius))
