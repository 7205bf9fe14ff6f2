"""Occlusion: predict hidden markers of the palm (`palm_markers`) and the digits (`digit_markers`).

The digits' markers are predicted from each other by `transdigital` correlation; `prediction` has
what both share.
"""
