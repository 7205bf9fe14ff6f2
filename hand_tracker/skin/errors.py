"""What can go wrong with a skin."""

from ..core.errors import HandTrackerError


class InvalidMesh(HandTrackerError, ValueError):
    """A file holds no mesh that a hand can have."""


class MissingLibrary(HandTrackerError, ImportError):
    """A library is not installed that makes or reads meshes."""
