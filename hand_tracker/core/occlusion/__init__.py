"""Step 3, occlusion: predict hidden markers of the palm and the digits.

In reading order: `prediction` (options of both), `palm_markers` (by the palm's rigidity and the
fingers), `transdigital` (correlation of the digits), `digit_markers` (by inertia and the other
digits).
"""
