"""A stream of frames, live or recorded: tracked and monitored, without ROS."""
