"""Track a recording: a rosbag2 folder, .mcap or .db3 in, a table of angles out. No ROS needed."""

import sys
from pathlib import Path

from hand_tracker import HandTracker
from hand_tracker.core.errors import HandTrackerError
from hand_tracker.files.bags import open_bag
from hand_tracker.tracking.recording import marker_topic, save, track

DEMO_BAG = Path(__file__).resolve().parents[1] / 'recordings' / 'demo.mcap'
path = sys.argv[1] if sys.argv[1:] else DEMO_BAG

try:
    with open_bag(path) as bag:
        topic = marker_topic(bag)
        frames = track(bag.messages([topic]), HandTracker())
        save('bag_angles.csv', frames, prefix='right_', wrist=True)
        print(f'{bag.counts[topic]} messages of {topic} in {path}; angles written to '
              'bag_angles.csv')
except HandTrackerError as error:
    sys.exit(f'track_bag: {error}')
