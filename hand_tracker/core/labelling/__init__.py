"""Step 1, labelling: assign measurements to markers, refuse outliers, correct swapped labels.

In reading order: `validity` (which rows are measurements), `plausibility` (cost of a labelling
by the hand alone), `readings` (candidate labellings of a frame and their cost), `association`
(data association over frames: outliers, swapped labels).

Points without labels are labelled in front of the tracker, by `cloud_labeller`: `prototypes` and
`natural_poses` (where a hand's markers are, and how they spread), `posture` (cost of a labelling by
all markers together), `palm_search` (hands in a single frame), `clutter` (points of no hand),
`hand_track` (a hand from frame to frame), `returns` (markers that reappear), `following` (data
association of points over frames).
"""
