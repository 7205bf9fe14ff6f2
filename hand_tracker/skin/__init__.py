"""The hand's skin: a closed mesh that follows the tracked bones. No ROS."""

from ..core.errors import InvalidMesh, MissingLibrary
from .load import load_skin
from .skinning import Skin, deform

__all__ = ['InvalidMesh', 'MissingLibrary', 'Skin', 'deform', 'load_skin']
