"""The method: numpy only, no ROS, no files, no plots."""
