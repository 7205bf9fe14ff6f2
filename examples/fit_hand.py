"""Fit a hand to recorded joint positions, and write it as a hand file."""

from hand_tracker import Hand, HandTracker, MarkerLayout, fit_hand, load_hand, save_hand
from hand_tracker.calibration import landmark_positions
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.simulation.packaged_recordings import demo_recording

# In the place of your own: joints (frames, 21, 3) [m], NaN where not recorded. In a row: wrist,
# thumb CMC MCP IP tip, then MCP PIP DIP tip of index, middle, ring and little finger.
person = Hand.scaled(length=0.20, breadth=0.09)
poses = forward(joint_table(person), demo_recording().angles[::10])
joints = landmark_positions(person, poses)

hand = fit_hand(joints, side='right')
save_hand('fitted_hand.yaml', hand, MarkerLayout())

hand, layout = load_hand('fitted_hand.yaml')
tracker = HandTracker(hand, layout)
off = 1e3 * abs(hand.finger_bones - person.finger_bones).max()
print(f'{len(joints)} frames fitted, finger bones right to {off:.2f} mm; '
      'written to fitted_hand.yaml')
