"""Labelling of anonymous points, in front of the tracker: assigns points to markers.

In reading order: `prototypes`, `bending` and `natural_poses` (joint distribution of a hand's
markers), `posture` (cost of a labelling by that distribution), `links` (by distances of
neighbouring markers on a digit), `palm_search` (hands in a single frame), `clutter` (points of no
hand), `hand_track` (state and prediction of a followed hand), `pair_search` (hands with two palm
markers seen), `returns` (markers that reappear after occlusion), `point_costs` (each point as each
marker), `rivals` (competing labellings), `following` (data association over frames),
`side_evidence` (right or left hand), `wearer_postures` (what the wearer does, learned in use),
`cloud_labeller` (all of it, for one or two hands).
"""
