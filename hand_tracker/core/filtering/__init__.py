"""Filtering: time between frames, noise, the VTM-UKF, smoothing of seen markers."""
