"""Step 2, filtering: time step, marker noise, and a Kalman filter for each marker (inertia).

In reading order: `frame_clock` (time step of each frame), `noise_estimate` (noise of each
marker), `ukf` (unscented Kalman filter with the variable turn model), `tracks` (filters of all
markers, seen and hidden, with adaptive process noise).
"""
