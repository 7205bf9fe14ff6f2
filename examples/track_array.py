"""Track an array of markers: eight positions a frame in, 25 joint angles a frame out."""

import numpy as np

from hand_tracker import JOINTS, Hand, HandTracker
from hand_tracker.simulation.packaged_recordings import demo_recording

# In the place of your own: markers (frames, 8, 3) [m], NaN where not seen; times (frames,) [s].
recording = demo_recording()
markers, times = recording.markers[:600], 1e-9 * recording.stamps[:600]

tracker = HandTracker(Hand.scaled(length=0.185, breadth=0.085, side='right'))
states = [tracker.update(frame, time) for frame, time in zip(markers, times)]

angles = np.degrees([state.angles for state in states])    # (frames, 25) [degrees]
np.savetxt('array_angles.csv', np.column_stack((times, angles)), delimiter=',', fmt='%.4f',
           header=','.join(('time', *JOINTS)), comments='')

error = abs(angles - np.degrees(recording.angles[:600]))
print(f'{len(states)} frames tracked, angles off the truth by {error.mean():.2f} degrees '
      'in the mean; written to array_angles.csv')
