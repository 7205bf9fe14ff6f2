"""The packaged recordings: noisy markers of the demo motion with drop-outs, and the true angles.

`hand_tracker record` reproduces them byte for byte: the right hand, with `--side left` a left
hand in the same motion, or with `--side both` the two side by side.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..core.model.hand import BOTH, JOINTS, SIDES, Hand
from ..core.model.kinematics import forward, joint_table
from ..core.model.marker_layout import MARKERS, MarkerLayout, marker_positions
from ..files.bags import BagMessage, bag_message, joint_state_message, marker_array_message
from .faults import DROPOUT_LENGTH
from .motion import demo_motion

RECORDING_RATE = 120.        # [Hz]
RECORDING_NOISE = .0003      # [m] standard deviation per axis
RECORDING_SEED = 1
LEFT_SEED = 2                # beside a right hand: their markers are lost at different times
RECORDING_START_NS = 1_700_000_000_000_000_000
RECORDING_DECIMALS = 6       # of stored [m] and [rad]: hides rounding differences of platforms
RECORDING_FRAME_ID = 'mocap'
MARKER_TOPIC, JOINT_TRUTH_TOPIC = '/markers', '/joint_states_truth'

# [m] between the hands of a person with the arms ahead: they never touch in this motion.
LEFT_HAND_OFFSET = np.array((0., .4, 0.))

DROPOUT_INTERVAL = .9        # [s] between drop-outs, mean
DROPOUT_FREE = 1.            # [s] at the beginning
DROPOUT_OF_TWO = .15         # share of drop-outs of two markers


class SimulatedRecording(NamedTuple):
    """Markers and true joint angles of a simulated recording.

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


def demo_recording(hand: Hand | None = None, layout: MarkerLayout | None = None,
                   rate: float = RECORDING_RATE, noise: float = RECORDING_NOISE,
                   seed: int = RECORDING_SEED) -> SimulatedRecording:
    """Return a recording of the demo motion; a left hand is 0.4 m to the left of a right hand.

    Parameters
    ----------
    hand : Hand, optional
        Default: the mean right hand.
    layout : MarkerLayout, optional
        Default: the paper's eight markers at their joints.
    rate : float
        [Hz]
    noise : float
        Standard deviation per axis [m].
    seed : int

    Returns
    -------
    SimulatedRecording
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
    # RandomState's streams never change; those of default_rng may change with numpy.
    random = np.random.RandomState(seed)
    markers = np.round(markers + random.normal(0., noise, markers.shape), RECORDING_DECIMALS)
    markers[~visible(len(frames), rate, random)] = np.nan
    stamps = RECORDING_START_NS + np.round(frames * (1e9 / rate)).astype(np.int64)
    return SimulatedRecording(stamps, markers, np.round(angles, RECORDING_DECIMALS) + 0.)


def visible(frames: int, rate: float, random: np.random.RandomState) -> np.ndarray:
    """Return a visibility mask with random short drop-outs of one or two markers.

    Parameters
    ----------
    frames : int
        Number of frames.
    rate : float
        [Hz]
    random : numpy.random.RandomState

    Returns
    -------
    ndarray of bool, shape (frames, 8)
    """
    seen = np.ones((frames, len(MARKERS)), dtype=bool)
    clock = DROPOUT_FREE + random.exponential(DROPOUT_INTERVAL)
    while clock * rate < frames:
        length = random.uniform(*DROPOUT_LENGTH)
        lost = random.permutation(len(MARKERS))[:2 if random.uniform() < DROPOUT_OF_TWO else 1]
        first, last = int(np.ceil(clock * rate)), int(np.ceil((clock + length) * rate))
        seen[first:last, lost] = False
        # One visible frame separates drop-outs of one marker.
        clock += length + 1. / rate + random.exponential(DROPOUT_INTERVAL)
    return seen


def recording_messages(recording: SimulatedRecording, side: str,
                       markers: Sequence[str] = MARKERS) -> Iterator[BagMessage]:
    """Yield a recording as bag messages: MarkerArray and true JointState of each frame.

    Parameters
    ----------
    recording : SimulatedRecording
    side : {'right', 'left'}
        Prefix of the joints' names.
    markers : sequence of str, optional
        Names of the markers: their namespaces, too, of others than the paper's eight, whose ids
        name none.

    Yields
    ------
    BagMessage
    """
    names = [f'{side}_{joint}' for joint in JOINTS]
    namespace = 'hand' if tuple(markers) == MARKERS else None
    for stamp, places, angles in zip(
            recording.stamps.tolist(), recording.markers, recording.angles):
        yield bag_message(MARKER_TOPIC, stamp, marker_array_message(
            stamp, RECORDING_FRAME_ID, markers, places, namespace=namespace))
        yield bag_message(JOINT_TRUTH_TOPIC, stamp, joint_state_message(
            stamp, names, angles, RECORDING_FRAME_ID))


def packaged_recordings(side: str) -> dict[str, SimulatedRecording]:
    """Return the recordings of the hands in a packaged recording, by side.

    Parameters
    ----------
    side : {'right', 'left', 'both'}
    """
    if side != BOTH:
        return {side: demo_recording(Hand.scaled(side=side))}
    return {side: demo_recording(Hand.scaled(side=side), seed=seed)
            for side, seed in zip(SIDES, (RECORDING_SEED, LEFT_SEED))}


def both_hands_messages(recordings: Mapping[str, SimulatedRecording]) -> Iterator[BagMessage]:
    """Yield hands side by side as bag messages: MarkerArray and true JointState of each frame.

    The markers of each hand are in the namespace of its side, 'right' or 'left'.

    Parameters
    ----------
    recordings : mapping of str to SimulatedRecording
        By side, of the same stamps.

    Yields
    ------
    BagMessage
    """
    names = [f'{side}_{joint}' for side in recordings for joint in JOINTS]
    stamps = next(iter(recordings.values())).stamps.tolist()
    for number, stamp in enumerate(stamps):
        first, *others = (marker_array_message(
            stamp, RECORDING_FRAME_ID, MARKERS, recording.markers[number], namespace=side)
            for side, recording in recordings.items())
        for other in others:
            first.markers.extend(other.markers)
        yield bag_message(MARKER_TOPIC, stamp, first)
        yield bag_message(JOINT_TRUTH_TOPIC, stamp, joint_state_message(
            stamp, names, np.concatenate(
                [recording.angles[number] for recording in recordings.values()]),
            RECORDING_FRAME_ID))
