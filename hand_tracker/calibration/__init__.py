"""Calibration: fit a person's hand to recorded joint positions, or to markers on the skin."""

from .fit import fit_hand
from .landmarks import LANDMARKS, landmark_positions

__all__ = ['LANDMARKS', 'fit_hand', 'landmark_positions']
