"""Simulated motion capture of a hand: motion, cameras, faults, and the ground truth.

The markers are on the skin. `calibrated` gives the hand and the layout with the errors of a
calibration, as a tracker would be given them.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from os import PathLike
from typing import NamedTuple

import numpy as np

from ..core.errors import HandTrackerError, InvalidLayout
from ..core.model.hand import Hand
from ..core.model.marker_layout import MARKERS, MarkerLayout
from ..files.bags import BagMessage, bag_message, marker_array_message, pose_message
from ..files.hand_file import choose_hand
from .cameras import CameraRig
from .faults import Event, Faults, fault_events, with_faults
from .motion_names import MOTION_DURATION, PAPER_RATE
from .motions import FRAME_RATE_RANGE, HandMotion, motion_named
from .packaged_recordings import (
    RECORDING_DECIMALS,
    RECORDING_FRAME_ID,
    RECORDING_START_NS,
    SimulatedRecording,
    recording_messages,
)
from .visibility import (
    LEAST_RADIUS_SHARE,
    markers_inside,
    observe,
    raised_to_skin,
    skin_layout,
)

WRIST_TRUTH_TOPIC, MARKER_TRUTH_TOPIC = '/wrist_truth', '/markers_truth'

BLOCK_LENGTH = .5             # [s] simulated at once
# Standard deviations of calibrated lengths, relative [1], of marker offsets per axis [m], and of
# the coupling's slope, relative [1], and offset [rad]; ours, unsourced.
LENGTH_ERROR = .02
OFFSET_ERROR = .001
COUPLING_SLOPE_ERROR, COUPLING_OFFSET_ERROR = .1, np.radians(2.)


class InvalidRate(HandTrackerError, ValueError):
    """The frame rate is out of range."""


class Simulated(NamedTuple):
    """Consecutive frames of a simulated hand.

    Attributes
    ----------
    stamps : ndarray of int, shape (n,)
        [ns]
    markers : ndarray, shape (n, m, 3)
        Reported by the camera system, NaN where lost [m].
    angles : ndarray, shape (n, 25)
        True joint angles, in the order of `JOINTS` [rad].
    rotation : ndarray, shape (n, 3, 3)
        True rotation, wrist frame to world.
    position : ndarray, shape (n, 3)
        True position of the wrist [m].
    places : ndarray, shape (n, m, 3)
        True positions of the markers [m].
    """

    stamps: np.ndarray
    markers: np.ndarray
    angles: np.ndarray
    rotation: np.ndarray
    position: np.ndarray
    places: np.ndarray


@dataclass(frozen=True, eq=False)
class Simulation:
    """Simulation of a hand in motion, seen by a camera rig.

    Parameters
    ----------
    motion : str
        One of `MOTIONS`.
    hand : Hand
    layout : MarkerLayout
        True marker layout; `skin_layout(hand)` if None.
    rig : CameraRig
    rate : float
        Frame rate [Hz].
    seed : int
    duration : float
        Least duration [s].
    faults : Faults
    """

    motion: str
    hand: Hand = field(default_factory=Hand.scaled)
    layout: MarkerLayout = None  # type: ignore[assignment]
    rig: CameraRig = field(default_factory=CameraRig.ring)
    rate: float = PAPER_RATE
    seed: int = 1
    duration: float = MOTION_DURATION
    faults: Faults = Faults()

    def __post_init__(self) -> None:
        if not FRAME_RATE_RANGE[0] <= self.rate <= FRAME_RATE_RANGE[1]:
            raise InvalidRate(f'rate: {self.rate:g} Hz; allowed is '
                              f'{FRAME_RATE_RANGE[0]:g} to {FRAME_RATE_RANGE[1]:g} Hz')
        if self.layout is None:
            object.__setattr__(self, 'layout', skin_layout(self.hand))

    @cached_property
    def moving(self) -> HandMotion:
        """The motion of the hand."""
        return motion_named(self.motion, self.hand, self.seed, self.duration)

    @property
    def frames(self) -> int:
        """Number of frames."""
        return int(np.floor(self.moving.duration * self.rate)) + 1

    def blocks(self) -> Iterator[Simulated]:
        """Yield the recording in blocks of half a second.

        Yields
        ------
        Simulated
        """
        random = np.random.RandomState((self.seed, 1))
        count = len(self.layout.names)
        events = fault_events(self.faults, self.moving.duration, count,
                              np.random.RandomState((self.seed, 2)))
        held: dict[Event, np.ndarray] = {}
        frames = np.arange(self.frames)
        step = max(1, round(BLOCK_LENGTH * self.rate))
        for first in range(0, len(frames), step):
            part = frames[first:first + step]
            times = part / self.rate
            angles, rotation, position = self.moving.sample(times)
            noise = random.standard_normal((len(part), count, len(self.rig.positions), 2))
            observed = observe(self.rig, self.hand, self.layout, angles, rotation, position, noise)
            markers = with_faults(observed.positions, observed.truth, times, events, held)
            stamps = RECORDING_START_NS + np.round(part * (1e9 / self.rate)).astype(np.int64)
            yield Simulated(stamps, np.round(markers, RECORDING_DECIMALS),
                            np.round(angles, RECORDING_DECIMALS) + 0., rotation, position,
                            observed.truth)

    def recording(self) -> Simulated:
        """Return all blocks as one.

        Returns
        -------
        Simulated
        """
        return Simulated(*map(np.concatenate, zip(*self.blocks())))


def calibrated(hand: Hand, layout: MarkerLayout, seed: int) -> tuple[Hand, MarkerLayout]:
    """Return hand and layout with random calibration errors.

    Bones and coordinates of the palm's joints err by `LENGTH_ERROR`, marker offsets by
    `OFFSET_ERROR`, the coupling by `COUPLING_SLOPE_ERROR` and `COUPLING_OFFSET_ERROR`.

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
        slope * (1. + COUPLING_SLOPE_ERROR * random.standard_normal(len(slope))),
        offset + COUPLING_OFFSET_ERROR * random.standard_normal(len(offset))))
    return hand.replace(coupling=coupling, **fields), layout.with_offsets(offsets)


def simulated_hand(path: str | PathLike[str] | None = None, side: str | None = None,
                   layout: str | None = None) -> tuple[Hand, MarkerLayout]:
    """Load a hand and its marker layout; a marker without an offset is placed on the skin.

    Parameters
    ----------
    path : path-like, optional
        Hand file; default: the mean hand.
    side : {'right', 'left'}, optional
    layout : str, optional
        Name of a layout preset, or a layout file, in place of the hand file's markers. Of other
        layouts than the paper's eight all markers inside the hand are placed on the skin.

    Returns
    -------
    hand : Hand
    layout : MarkerLayout

    Raises
    ------
    InvalidLayout
        Naming markers far inside the hand, visible to no camera; a little inside, as calibrations
        find them, they are seen.
    """
    hand, worn = choose_hand(path, side, layout=layout)
    if worn.names != MARKERS:
        return hand, raised_to_skin(hand, worn)
    at_joint = np.all(worn.offsets == 0., axis=1)
    worn = MarkerLayout(worn.places, np.where(
        at_joint[:, None], skin_layout(hand).offsets, worn.offsets))
    inside = markers_inside(hand, worn, LEAST_RADIUS_SHARE)
    if inside.any():
        named = ', '.join(name for name, hidden in zip(MARKERS, inside) if hidden)
        raise InvalidLayout(f'{path}: offset of {named}: inside the hand, where no camera sees '
                            'them; expected places outside its capsules')
    return hand, worn


def frame_messages(part: Simulated, side: str, truth: bool = True,
                   names: Sequence[str] = MARKERS) -> Iterator[tuple[BagMessage, ...]]:
    """Yield the bag messages of each frame: markers, and the true joints, wrist and markers.

    Parameters
    ----------
    part : Simulated
    side : {'right', 'left'}
    truth : bool
        Whether to include the ground truth.
    names : sequence of str, optional
        Of the markers.

    Yields
    ------
    tuple of BagMessage
        MarkerArray; with `truth` also JointState, PoseStamped and MarkerArray.
    """
    messages = recording_messages(
        SimulatedRecording(part.stamps, part.markers, part.angles), side, names)
    for stamp, rotation, position, places in zip(
            part.stamps.tolist(), part.rotation, part.position, part.places):
        markers, joints = next(messages), next(messages)
        yield (markers,) if not truth else (
            markers, joints,
            bag_message(WRIST_TRUTH_TOPIC, stamp, pose_message(
                stamp, RECORDING_FRAME_ID, position, rotation)),
            bag_message(MARKER_TRUTH_TOPIC, stamp, marker_array_message(
                stamp, RECORDING_FRAME_ID, names, places)))
