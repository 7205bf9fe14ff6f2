"""Read and write files: hand files, rosbag2 recordings, angle tables, URDF."""
