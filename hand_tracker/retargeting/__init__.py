"""Retargeting: joint commands of a robot hand from a human hand. No ROS.

`robot_urdf` and `robot_model` read a robot, `robot_anatomy` finds its palm and digits by geometry,
`robot_hand` adds spheres at the tips; `robot_file` and `dexretargeting_file` read settings,
`robot_inspection` reports what was found, `hand_frame` names frames that are turned.
`retarget_options` and `retarget_problem` lay out what is solved, `retarget_kernel` solves a
frame with `box_qp`, `retargeter` is the public class.
`command_guard` is the one owner of whether and how fast the robot may move.
"""
