"""Inverse kinematics: the wrist from the `palm`, abduction and flexion of each `digit`.

A digit is solved in its `abduction_plane`, its flexion in closed form (`two_bone`, `three_bone`)
or by `fabrik`.
"""
