"""A person's hand from recorded joint positions."""

from .fit import fit_hand
from .landmarks import LANDMARKS, landmark_positions

__all__ = ['LANDMARKS', 'fit_hand', 'landmark_positions']
