"""Model of the hand, used by every step: joints, markers, states, kinematics, capsules.

In reading order: `hand` (joints, limits, bone lengths), `marker_layout` (places of the eight
markers), `states` (states of palm and markers), `kinematics` (forward kinematics), `skeleton`
(points and bones), `capsules` (collision geometry).
"""
