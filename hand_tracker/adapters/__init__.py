"""Adapters: packets and messages of motion capture systems to frames of points. No ROS.

Each module reads one source; all give a `SourceFrame`, which `MarkerArrayWriter` serializes.
"""
