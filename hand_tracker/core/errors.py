"""The package's errors: one small tree, each saying which, what and what is allowed."""


class HandTrackerError(Exception):
    """Base of every error that hand_tracker raises on purpose."""


class InvalidHand(HandTrackerError, ValueError):
    """A hand's field has a value that no hand can have."""


class InvalidLayout(HandTrackerError, ValueError):
    """A marker rides on a place from which the tracker cannot solve the hand."""


class InvalidOption(HandTrackerError, ValueError):
    """A tracker option has a value that is not among those it allows."""


class InvalidMesh(HandTrackerError, ValueError):
    """A file holds no mesh that a hand can have."""


class MissingLibrary(HandTrackerError, ImportError):
    """A library is not installed that makes or reads meshes."""
