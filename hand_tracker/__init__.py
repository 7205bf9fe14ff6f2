"""Markers in, hand out: track the 25 joints of a human hand from motion capture."""

__version__ = '0.1.0'
