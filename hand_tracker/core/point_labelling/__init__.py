"""Labelling of points without names, in front of the tracker: which point is which marker.

In reading order: `prototypes`, `bending` and `natural_poses` (where a hand's markers are, and how
they spread), `posture` (cost of a labelling by all markers together), `links` (by the distances of
neighbours on a digit), `palm_search` (hands in a single frame), `clutter` (points of no hand),
`hand_track` (a hand from frame to frame), `pair_search` (hands with too few palm markers),
`returns` (markers that reappear), `point_costs` (each point as each marker), `rivals` (when another
labelling is taken), `following` (data association of points over frames), `side_evidence` (whether
it is rather a hand of the other side), `cloud_labeller` (all of it, for one or two hands).
"""
