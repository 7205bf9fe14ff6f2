"""The launch file without ROS: what it starts, by its arguments, and the configuration of RViz."""
