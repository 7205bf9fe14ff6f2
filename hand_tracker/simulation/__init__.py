"""Simulated hands: motions, cameras, faults, recordings with ground truth."""
