"""Postures of the wearer, learned while the hand is followed: they move the prototype towards them.

A prototype holds whatever hands do; most wearers do a few things. The more its covariance is that
of their own postures, the better the seen markers predict the hidden ones.
"""

import numpy as np

from .hand_track import HandTrack
from .prototypes import HandPrototype

POSTURE_PERIOD = .05        # [s] between two postures
FIRST_POSTURES = 20         # postures at which the prototype is first mixed; then at twice as many
REMEMBERED_POSTURES = 1200  # after which the oldest fade, and the prototype is mixed anew; ours
WEARER_SHARE = .4           # of the wearer's postures in the prototype; ours
SURE_SHARE = .6             # least share of markers that are surely labelled; ours
SETTLED_TIME = 2.           # [s] with a label, in which a rival would have replaced a wrong one


class WearerPostures:
    """Mean and covariance of a followed hand's markers in the palm's frame.

    Parameters
    ----------
    prototype : HandPrototype
        Of the hand as it is known without its postures.
    """

    def __init__(self, prototype: HandPrototype) -> None:
        self.prototype = prototype
        self._rigid = prototype.statistics.rigid > 0.
        self._mean = prototype.statistics.template.ravel()
        self._covariance = np.zeros_like(prototype.statistics.precision)
        self._count = 0
        self._next = FIRST_POSTURES     # count at which the prototype is mixed anew
        self._waited = 0.               # [s] since the last posture

    def add(self, track: HandTrack, present: HandPrototype, step: float) -> HandPrototype | None:
        """Add the posture of a frame, if its labels are sure.

        Parameters
        ----------
        track : HandTrack
            Of the confirmed hand.
        present : HandPrototype
            By which it is followed; places the hidden markers.
        step : float
            Time since the last call [s].

        Returns
        -------
        HandPrototype or None
            Mixed with the postures, where it is time to follow the hand by that.
        """
        self._waited += step
        if self._waited < POSTURE_PERIOD or not self._is_sure(track):
            return None
        sure = ((track.hidden_for <= 0.) & (track.finding.rows >= 0) & np.isinf(track.returns.age)
                & (track.seen_for >= SETTLED_TIME))
        if not sure[self._rigid].all() or sure.mean() < SURE_SHARE:
            return None
        self._waited = 0.
        self._learn(track.local.ravel(), np.repeat(sure, 3), present)
        if self._count < self._next:
            return None
        self._next = self._count + min(self._count, REMEMBERED_POSTURES)
        return self.prototype.mixed_with(self._mean, self._covariance, WEARER_SHARE)

    def _is_sure(self, track: HandTrack) -> bool:
        """Return whether nothing speaks against the labels of a hand."""
        return bool(track.unlikely_for[0] <= 0. and track.shaken_for[0] <= 0.
                    and track.doubt[0] <= 0. and track.finding.distance[0] <= max(
                        self.prototype.statistics.typical, .5))

    def _learn(self, place: np.ndarray, sure: np.ndarray, present: HandPrototype) -> None:
        """Add a posture; the others' conditional distribution stands for unsure markers.

        Parameters
        ----------
        place : ndarray, shape (3 M,)
            Of the markers, in the palm's frame [m].
        sure : ndarray of bool, shape (3 M,)
            Which coordinates are known.
        present : HandPrototype
        """
        precision, template = present.statistics.precision, present.statistics.template.ravel()
        off, unsure = place - template, ~sure
        hidden = np.linalg.inv(precision[np.ix_(unsure, unsure)])
        off[unsure] = -hidden @ (precision[np.ix_(unsure, sure)] @ off[sure])
        self._count += 1
        gain = 1. / min(self._count, REMEMBERED_POSTURES)
        change = template + off - self._mean
        self._mean = self._mean + gain * change
        self._covariance = (1. - gain) * (self._covariance + gain * np.outer(change, change))
        self._covariance[np.ix_(unsure, unsure)] += gain * hidden
