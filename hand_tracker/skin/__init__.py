"""Skin of the hand: generate or register a closed mesh, and deform it with the tracked links."""

from ..core.errors import InvalidMesh, MissingLibrary
from .load import load_skin
from .skinning import Skin, deform

__all__ = ['InvalidMesh', 'MissingLibrary', 'Skin', 'deform', 'load_skin']
