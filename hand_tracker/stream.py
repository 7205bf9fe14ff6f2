"""A tracker fed with a stream of stamped frames, live or recorded. No ROS."""

from .core.clock import Clock
from .core.palm import PalmState


class Stream:
    """Feed one tracker, and tell whether what comes out is a hand.

    Parameters
    ----------
    tracker : HandTracker

    Attributes
    ----------
    placed : bool
        Whether the palm was seen since the first frame, or since time jumped back; before
        that the pose is none to publish.
    restarted : bool
        Whether time jumped back with the last frame, so that all began anew.
    """

    def __init__(self, tracker):
        self._tracker = tracker
        self._clock = Clock()
        self.placed = self.restarted = False

    def update(self, markers, time, **measured):
        """Return the hand for the next frame.

        Parameters
        ----------
        markers, time, **measured
            See `HandTracker.update`.

        Returns
        -------
        HandState
        """
        state = self._tracker.update(markers, time, **measured)
        _, _, self.restarted = self._clock.step(time)
        self.placed = (self.placed and not self.restarted) or state.palm <= PalmState.CARRIED
        return state
