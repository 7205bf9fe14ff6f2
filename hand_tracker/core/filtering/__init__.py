"""Filtering, in step 1 (occlusion: inertia): a Kalman filter for each marker.

In reading order: `frame_clock` (time step of each frame), `noise_estimate` (noise of each
marker), `ukf` (unscented Kalman filter with the variable turn model), `smoothing` (adaptive
process noise of that filter), `tracks` (filters of all markers, seen and hidden).
"""
