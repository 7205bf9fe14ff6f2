"""A hand in the browser: skin, skeleton, markers, angles; no ROS but in `nodes/viewer.py`."""
