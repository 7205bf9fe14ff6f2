"""Occlusion: hidden markers of palm and digits are predicted."""
