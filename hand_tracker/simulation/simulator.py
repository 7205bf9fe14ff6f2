"""Record a simulated hand: a natural motion, seen by a ring of cameras, with the truth beside.

The hand's markers sit on its skin. --calibration writes the hand file a tracker would be
given: the same hand as a calibration finds it, a little wrong.
"""

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..core.errors import HandTrackerError, InvalidLayout
from ..core.model.hand import Hand
from ..core.model.marker_layout import MARKERS, MarkerLayout
from ..files.bags import bag_message, marker_array_message, pose_message
from ..files.hand_file import choose_hand
from .cameras import CameraRig
from .faults import Faults, fault_events, with_faults
from .motions import DURATION, RATE_RANGE, motion_named
from .packaged_recordings import DECIMALS, FRAME_ID, START_NS, recording_messages
from .visibility import look, markers_inside, skin_layout

WRIST_TOPIC, PLACES_TOPIC = '/wrist_truth', '/markers_truth'

RATE = 480.             # [Hz] that of the paper's cameras
BLOCK = .5              # [s] simulated at once
LENGTH_ERROR = .02      # [1] standard deviation of a calibrated length
OFFSET_ERROR = .001     # [m] standard deviation of a calibrated marker's place, per axis
# Standard deviations of a calibrated coupling's slope [1] and offset [rad]; ours, unsourced.
SLOPE_ERROR, COUPLING_ERROR = .1, np.radians(2.)


class InvalidRate(HandTrackerError, ValueError):
    """The rate is not allowed."""


class Simulated(NamedTuple):
    """Consecutive frames of a simulated hand.

    Attributes
    ----------
    stamps : ndarray of int, shape (n,)
        [ns]
    markers : ndarray, shape (n, 8, 3)
        As reported, NaN where lost [m].
    angles : ndarray, shape (n, 25)
        True, in the order of `JOINTS` [rad].
    rotation, position : ndarray, shape (n, 3, 3) and (n, 3)
        True, of the wrist [m].
    places : ndarray, shape (n, 8, 3)
        Where the markers truly are [m].
    """

    stamps: np.ndarray
    markers: np.ndarray
    angles: np.ndarray
    rotation: np.ndarray
    position: np.ndarray
    places: np.ndarray


@dataclass(frozen=True, eq=False)
class Simulation:
    """A hand, how it moves and what sees it.

    Parameters
    ----------
    motion : str
        One of `MOTIONS`.
    hand : Hand
    layout : MarkerLayout
        Where the markers truly are.
    rig : CameraRig
    rate : float
        [Hz]
    seed : int
    duration : float
        At least [s].
    faults : Faults
    """

    motion: str
    hand: Hand = field(default_factory=Hand.scaled)
    layout: MarkerLayout = None
    rig: CameraRig = field(default_factory=CameraRig.ring)
    rate: float = RATE
    seed: int = 1
    duration: float = DURATION
    faults: Faults = Faults()

    def __post_init__(self):
        if not RATE_RANGE[0] <= self.rate <= RATE_RANGE[1]:
            raise InvalidRate(f'rate: {self.rate:g} Hz; allowed is '
                              f'{RATE_RANGE[0]:g} to {RATE_RANGE[1]:g} Hz')
        if self.layout is None:
            object.__setattr__(self, 'layout', skin_layout(self.hand))

    @cached_property
    def moving(self):
        """Return the motion."""
        return motion_named(self.motion, self.hand, self.seed, self.duration)

    @property
    def frames(self):
        """Return the number of frames."""
        return int(np.floor(self.moving.duration * self.rate)) + 1

    def blocks(self):
        """Yield the recording in parts of half a second.

        Yields
        ------
        Simulated
        """
        random = np.random.RandomState((self.seed, 1))
        events = fault_events(self.faults, self.moving.duration, len(MARKERS),
                              np.random.RandomState((self.seed, 2)))
        held = {}
        frames = np.arange(self.frames)
        step = max(1, round(BLOCK * self.rate))
        for first in range(0, len(frames), step):
            part = frames[first:first + step]
            times = part / self.rate
            angles, rotation, position = self.moving.sample(times)
            noise = random.standard_normal((len(part), len(MARKERS), len(self.rig.positions), 2))
            sight = look(self.rig, self.hand, self.layout, angles, rotation, position, noise)
            markers = with_faults(sight.positions, sight.truth, times, events, held)
            stamps = START_NS + np.round(part * (1e9 / self.rate)).astype(np.int64)
            yield Simulated(stamps, np.round(markers, DECIMALS), np.round(angles, DECIMALS) + 0.,
                            rotation, position, sight.truth)

    def recording(self):
        """Return the whole recording.

        Returns
        -------
        Simulated
        """
        return Simulated(*map(np.concatenate, zip(*self.blocks())))


def calibrated(hand, layout, seed):
    """Return hand and layout as a calibration finds them: a little wrong.

    Bones and coordinates of the palm's joints err by `LENGTH_ERROR`, markers' places on their
    links by `OFFSET_ERROR`, the coupling by `SLOPE_ERROR` and `COUPLING_ERROR`.

    Parameters
    ----------
    hand : Hand
    layout : MarkerLayout
    seed : int

    Returns
    -------
    hand : Hand
    layout : MarkerLayout
    """
    random = np.random.RandomState((seed, 3))
    fields = {name: getattr(hand, name) * (
        1. + LENGTH_ERROR * random.standard_normal(getattr(hand, name).shape))
        for name in ('finger_cmc', 'finger_mcp', 'finger_bones', 'thumb_cmc', 'thumb_bones')}
    offsets = layout.offsets + OFFSET_ERROR * random.standard_normal(layout.offsets.shape)
    slope, offset = hand.coupling.T
    coupling = np.column_stack((
        slope * (1. + SLOPE_ERROR * random.standard_normal(len(slope))),
        offset + COUPLING_ERROR * random.standard_normal(len(offset))))
    return hand.replace(coupling=coupling, **fields), MarkerLayout(layout.places, offsets)


def simulated_hand(path=None, side=None):
    """Return a hand and where its markers are; one without an offset is put on the skin.

    Parameters
    ----------
    path : path-like, optional
        Hand file; the mean hand when left out.
    side : {'right', 'left'}, optional

    Returns
    -------
    hand : Hand
    layout : MarkerLayout

    Raises
    ------
    InvalidLayout
        Naming the markers that lie inside the hand.
    """
    hand, layout = choose_hand(path, side)
    bare = ~layout.offsets.any(axis=1)
    layout = MarkerLayout(layout.places, np.where(
        bare[:, None], skin_layout(hand).offsets, layout.offsets))
    inside = markers_inside(hand, layout)
    if inside.any():
        named = ', '.join(name for name, hidden in zip(MARKERS, inside) if hidden)
        raise InvalidLayout(f'{path}: offset of {named}: inside the hand, where no camera sees '
                            'them; expected places outside its capsules')
    return hand, layout


def frame_messages(part, side, truth=True):
    """Yield the messages of each frame: markers, and the truth of joints, wrist and markers.

    Parameters
    ----------
    part : Simulated
    side : {'right', 'left'}
    truth : bool
        Whether to tell it.

    Yields
    ------
    tuple of BagMessage
        Markers; joints, wrist, true places.
    """
    messages = recording_messages(part, side)
    for stamp, rotation, position, places in zip(
            part.stamps.tolist(), part.rotation, part.position, part.places):
        markers, joints = next(messages), next(messages)
        yield (markers,) if not truth else (
            markers, joints,
            bag_message(WRIST_TOPIC, stamp, pose_message(stamp, FRAME_ID, position, rotation)),
            bag_message(PLACES_TOPIC, stamp, marker_array_message(
                stamp, FRAME_ID, MARKERS, places)))
