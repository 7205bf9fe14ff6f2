"""Step 4, inverse kinematics: wrist from the `palm`, abduction and flexion of each `digit`.

A palm of more than three markers is solved with its arch (`palm_arch`). A digit of one marker is
solved in its `abduction_plane`, its flexion in closed form (`flexion`) or by `fabrik`; one of
several by Gauss-Newton (`digit_angles`), its `further_markers` refused where they leap, kept quiet
by `angle_average`. As one of several markers vanishes the others keep their `skin_shift`.
`angle_filter` estimates angles that the markers hardly constrain.
"""
