"""Postures of the wearer, learned from a followed hand and mixed with the natural ones.

A prototype covers all natural postures. The nearer it is to those that the wearer takes, the better
the seen markers predict the hidden ones.
"""

import numpy as np

from .hand_track import HandTrack
from .prototypes import LEAST_TYPICAL, HandPrototype

POSTURE_PERIOD = .05        # [s] between two checks, and so between two postures, at least
POSTURE_CHANGE = .002       # [m] mean distance of the markers from the last posture, at least; ours
# Postures at which the prototype is mixed for the first time, and again whenever they have doubled;
# number that is remembered: older ones fade, and it is mixed after as many; ours.
FIRST_POSTURES, REMEMBERED_POSTURES = 20, 1200
WEARER_SHARE = .4           # [1] of the wearer's postures in the mixture; ours
SURE_SHARE = .6             # [1] of the markers with sure labels, at least; ours
# [s] for which a sure label has been seen in all, and without a break or a better rival; ours.
LABELLED_TIME, UNRIVALLED_TIME = 2., .1


class WearerPostures:
    """Mean and covariance of a followed hand's markers, in the palm's frame.

    They are learned from frames with sure labels, and kept while the hand is lost.

    Parameters
    ----------
    prototype : HandPrototype
        Of natural postures.
    """

    def __init__(self, prototype: HandPrototype) -> None:
        self.prototype = prototype
        self._rigid = prototype.statistics.rigid > 0.
        self._added_precision = np.linalg.inv(prototype.added_covariance)
        self._mean = prototype.statistics.template.ravel()
        self._covariance = np.zeros_like(prototype.statistics.precision)
        self._last = np.full_like(prototype.statistics.template, np.inf)  # posture [m]
        self._count = 0
        self._mixed_at = FIRST_POSTURES     # postures at which the prototype is mixed anew
        self._waited = 0.                   # [s] since the last check

    def add(self, track: HandTrack, present: HandPrototype, step: float) -> HandPrototype | None:
        """Add the posture of a frame, if its labels are sure and it differs from the last one.

        Parameters
        ----------
        track : HandTrack
            Of the confirmed hand.
        present : HandPrototype
            By which it is followed.
        step : float
            Time since the last frame [s].

        Returns
        -------
        HandPrototype or None
            Natural postures and the wearer's, where it is time to follow the hand by them.
        """
        self._waited += step
        if self._waited < POSTURE_PERIOD:
            return None
        self._waited = 0.
        if not self._is_likely(track):
            return None
        sure = ((track.finding.rows >= 0) & (track.returns.age == np.inf)
                & (track.seen_for >= LABELLED_TIME)
                & (np.diagonal(track.trusted_for) >= UNRIVALLED_TIME))
        if not sure[self._rigid].all() or sure.mean() < SURE_SHARE:
            return None
        if np.linalg.norm(track.local - self._last, axis=1)[sure].mean() < POSTURE_CHANGE:
            return None
        self._last = track.local.copy()
        self._learn(track.local, sure, present)
        if self._count < self._mixed_at:
            return None
        self._mixed_at = self._count + min(self._count, REMEMBERED_POSTURES)
        return self.prototype.mixed_with(self._mean, self._covariance, WEARER_SHARE)

    def _is_likely(self, track: HandTrack) -> bool:
        """Return whether the posture is typical, and no rival labelling does better."""
        return bool(track.shaken_for[0] <= 0. and track.doubt[0] <= 0. and (
            track.finding.distance[0] <= max(self.prototype.statistics.typical, LEAST_TYPICAL)))

    def _learn(self, place: np.ndarray, sure: np.ndarray, present: HandPrototype) -> None:
        """Add a posture; unsure markers enter by their conditional distribution given the others.

        Parameters
        ----------
        place : ndarray, shape (M, 3)
            In the palm's frame [m].
        sure : ndarray of bool, shape (M,)
            Markers whose places are known.
        present : HandPrototype
            Of the conditional distribution.
        """
        template, u = present.statistics.template.ravel(), np.flatnonzero(np.repeat(~sure, 3))
        precision = present.statistics.precision[u]     # (3 U, 3 M)
        conditional = np.linalg.inv(precision[:, u])    # (3 U, 3 U)
        off = place.ravel() - template                  # (3 M,)
        off[u] = 0.
        off[u] = -conditional @ (precision @ off)
        self._count += 1
        gain = 1. / min(self._count, REMEMBERED_POSTURES)
        change = template + off - self._mean
        self._mean = self._mean + gain * change
        self._covariance = (1. - gain) * (self._covariance + gain * np.outer(change, change))
        # Without what the mixture adds to all.
        added = np.linalg.inv(self._added_precision[np.ix_(~sure, ~sure)])
        self._covariance[np.ix_(u, u)] += gain * (conditional - np.kron(added, np.eye(3)))
