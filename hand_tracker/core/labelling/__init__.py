"""Step 1, labelling: assign measurements to markers, refuse outliers, correct swapped labels.

In reading order: `validity` (which rows are measurements), `plausibility` (cost of a labelling
by the hand alone), `readings` (candidate labellings of a frame and their cost), `association`
(data association over frames: outliers, swapped labels), `digit_exchange` (labels exchanged within
a digit of several markers).
"""
