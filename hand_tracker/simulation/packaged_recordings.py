"""The packaged recordings: markers of the demo motion as a camera system might give them.

`hand_tracker record` makes them again, byte for byte: that of the right hand, and with
`--side left` that of a left hand in the same motion.
"""

from typing import NamedTuple

import numpy as np

from ..core.model.hand import JOINTS, Hand
from ..core.model.kinematics import forward, joint_table
from ..core.model.marker_layout import MARKERS, MarkerLayout, marker_positions
from ..files.bags import bag_message, joint_state_message, marker_array_message
from .motion import demo_motion

RATE = 120.                  # [Hz]
NOISE = .0003                # [m] standard deviation per axis
SEED = 1
START_NS = 1_700_000_000_000_000_000
DECIMALS = 6                 # of stored metres and radians: hides last-bit differences
FRAME_ID = 'mocap'
MARKER_TOPIC, TRUTH_TOPIC = '/markers', '/joint_states_truth'

# [m] between the hands of a person with the arms ahead; no phase of the motion makes them touch.
LEFT_HAND_OFFSET = np.array((0., .4, 0.))

DROPOUT_EVERY = .9           # [s] between drop-outs, on average
DROPOUT_LENGTH = (.03, .3)   # [s]
DROPOUT_FREE = 1.            # [s] at the beginning
DROPOUT_OF_TWO = .15         # share of drop-outs that take two markers


class Recording(NamedTuple):
    """Markers and true angles of a made recording.

    Attributes
    ----------
    stamps : ndarray of int, shape (n,)
        [ns]
    markers : ndarray, shape (n, 8, 3)
        In the order of `MARKERS`, NaN where lost [m].
    angles : ndarray, shape (n, 25)
        True, in the order of `JOINTS` [rad].
    """

    stamps: np.ndarray
    markers: np.ndarray
    angles: np.ndarray


def demo_recording(hand=None, layout=None, rate=RATE, noise=NOISE, seed=SEED):
    """Return a recording of the demo motion, a left hand's 0.4 m to the left of a right one's.

    Parameters
    ----------
    hand : Hand, optional
        The mean right hand when left out.
    layout : MarkerLayout, optional
        The paper's eight markers when left out.
    rate : float
        [Hz]
    noise : float
        Standard deviation per axis [m].
    seed : int

    Returns
    -------
    Recording
    """
    hand = Hand.scaled() if hand is None else hand
    layout = MarkerLayout() if layout is None else layout
    motion = demo_motion(hand)
    frames = np.arange(int(np.floor(motion.duration * rate)) + 1)
    angles, rotation, position = motion.sample(frames / rate)
    if hand.side == 'left':
        position = position + LEFT_HAND_OFFSET
    pose = forward(joint_table(hand), angles, rotation, position)
    markers = marker_positions(layout.mounting(hand), pose, rotation, position)
    # RandomState's streams are frozen for good; those of default_rng may change with numpy.
    random = np.random.RandomState(seed)
    markers = np.round(markers + random.normal(0., noise, markers.shape), DECIMALS)
    markers[~visible(len(frames), rate, random)] = np.nan
    stamps = START_NS + np.round(frames * (1e9 / rate)).astype(np.int64)
    return Recording(stamps, markers, np.round(angles, DECIMALS) + 0.)


def visible(frames, rate, random):
    """Return which markers are seen: short drop-outs of one, sometimes of two, now and then.

    Parameters
    ----------
    frames : int
    rate : float
        [Hz]
    random : numpy.random.RandomState

    Returns
    -------
    ndarray of bool, shape (frames, 8)
    """
    seen = np.ones((frames, len(MARKERS)), dtype=bool)
    clock = DROPOUT_FREE + random.exponential(DROPOUT_EVERY)
    while clock * rate < frames:
        length = random.uniform(*DROPOUT_LENGTH)
        lost = random.permutation(len(MARKERS))[:2 if random.uniform() < DROPOUT_OF_TWO else 1]
        first, last = int(np.ceil(clock * rate)), int(np.ceil((clock + length) * rate))
        seen[first:last, lost] = False
        # A frame in between keeps two drop-outs of one marker apart.
        clock += length + 1. / rate + random.exponential(DROPOUT_EVERY)
    return seen


def recording_messages(recording, side):
    """Yield a recording as messages: markers and true joint states of each frame.

    Parameters
    ----------
    recording : Recording
    side : {'right', 'left'}
        Prefix of the joints' names.

    Yields
    ------
    BagMessage
    """
    names = [f'{side}_{joint}' for joint in JOINTS]
    for stamp, markers, angles in zip(
            recording.stamps.tolist(), recording.markers, recording.angles):
        yield bag_message(MARKER_TOPIC, stamp, marker_array_message(
            stamp, FRAME_ID, MARKERS, markers))
        yield bag_message(TRUTH_TOPIC, stamp, joint_state_message(
            stamp, names, angles, FRAME_ID))
