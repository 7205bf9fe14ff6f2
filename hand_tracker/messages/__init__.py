"""Messages to arrays and back: pure functions; only builders and rviz_markers need ROS."""
