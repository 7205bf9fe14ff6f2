"""The tracking method: numpy and numba only, no ROS, no files, no plots.

`tracker.HandTracker` keeps the state of a hand; `pipeline.track_frame` is the method, whose steps
are folders here, in the order in which a frame passes them (2 to 4: the palm, then the digits):

1. `labelling`: reject invalid measurements, associate the others with markers.
2. `filtering`: time between frames, noise of the markers, unscented Kalman filters.
3. `occlusion`: predict hidden markers of the palm, then of the digits.
4. `inverse_kinematics`: wrist from the palm, abduction plane and flexion of each digit.
5. `pose`: continuous angles, contact between digits, report with forward kinematics.

Points without names are labelled in front of the tracker, by `point_labelling`.

The steps rest on `model` (hand, marker layout, kinematics, capsules) and on `numerics` (compiler
switch, vectors, quaternions). `records` and `options` are what the kernels read and write;
`constraints` switches single constraints off.
"""
