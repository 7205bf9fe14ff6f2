"""Model of the hand, used by every step: joints, markers, states, kinematics, capsules.

In reading order: `hand` (joints, limits, bone lengths), `marker_layout` (which marker is where),
`layout_presets` (layouts by name), `marker_rows` (any layout as arrays for kernels),
`observability` (joints that a layout shows), `palm_triangle` (the palm's three markers), `states`
(states of palm and markers), `kinematics` (forward kinematics), `skeleton` (points and bones),
`capsules` (collision geometry).
"""
