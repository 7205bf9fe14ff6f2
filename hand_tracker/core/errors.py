"""The package's errors: one tree; each message names the field, its value and what is allowed."""


class HandTrackerError(Exception):
    """Base of every error that hand_tracker raises for its input."""


class InvalidHand(HandTrackerError, ValueError):
    """A field of `Hand` has a value that no hand can have."""


class InvalidLayout(HandTrackerError, ValueError):
    """A marker sits at a place from which the hand cannot be solved."""


class InvalidOption(HandTrackerError, ValueError):
    """A field of `TrackerOptions` has a value outside its range or choices."""


class InvalidMesh(HandTrackerError, ValueError):
    """A mesh file does not hold the mesh of a hand."""


class MissingLibrary(HandTrackerError, ImportError):
    """A library for making or reading meshes is not installed."""
