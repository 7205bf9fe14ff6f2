"""Labelling: which measurement is which marker, and which is none."""
