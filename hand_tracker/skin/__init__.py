"""The hand's skin: a closed mesh that follows the tracked bones. No ROS."""

from .blend import Skin, deform
from .errors import InvalidMesh, MissingLibrary
from .load import load_skin

__all__ = ['InvalidMesh', 'MissingLibrary', 'Skin', 'deform', 'load_skin']
