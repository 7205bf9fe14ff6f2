"""Step 5, pose: `continuity` of the angles, `contact` between digits, and the frame's `report`.

`deviation` says how far the angles may be off.
"""
