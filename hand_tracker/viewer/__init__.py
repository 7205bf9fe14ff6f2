"""Browser viewer of a tracked hand: skin, skeleton, markers and angles; no ROS."""
