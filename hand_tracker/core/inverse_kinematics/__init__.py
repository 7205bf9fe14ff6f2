"""Inverse kinematics: the palm from its markers, each digit from its own."""
