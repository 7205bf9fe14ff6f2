"""Capture files of hands: loading, validation, and the split into fitted and judged frames."""

from collections.abc import Callable, Iterable, Iterator
from os import PathLike
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..calibration import LANDMARKS
from ..calibration.take_files import rate_notes, recorded_take, usable_rate
from ..core.errors import HandTrackerError
from ..core.model.hand import LEFT_HAND_MIRROR, SIDES
from ..core.model.marker_layout import PAPER_PLACES
from ..files.npz_file import open_arrays
from ..files.recordings import NPZ, ReadingOptions, is_bag, recognised_format
from .evaluation_options import Options
from .rows import Row

CAPTURE_FIELDS = 'positions', 'joints', 'side', 'rate_hz'
FITTING_SHARE = .2                  # first part of a capture, to which its hand is fitted
MIN_CAPTURE_FRAMES = 100
PALM_RANGE = (.03, .2)              # [m] wrist to index MCP: other values are in another unit
PAPER_MARKER_ROWS = np.array([LANDMARKS.index(place) for place in PAPER_PLACES])


class InvalidCapture(HandTrackerError, ValueError):
    """A file that is no capture, or a capture that cannot be judged."""


class Capture(NamedTuple):
    """Captured joint positions of a hand.

    Attributes
    ----------
    name : str
        Name of the file, without its suffix.
    joints : ndarray, shape (T, 21, 3)
        In the order of `LANDMARKS`, NaN where not captured [m].
    side : {'right', 'left'}
    rate : float
        [Hz]
    source, licence : str
        From the file; empty if missing.
    notes : tuple of str
        To print: what was assumed of the file.
    """

    name: str
    joints: np.ndarray
    side: str
    rate: float
    source: str = ''
    licence: str = ''
    notes: tuple[str, ...] = ()

    @property
    def markers(self) -> np.ndarray:
        """The paper's eight markers, shape (T, 8, 3), NaN where not captured [m]."""
        return self.joints[:, PAPER_MARKER_ROWS]

    @property
    def whole(self) -> np.ndarray:
        """Whether each frame has all eight markers, shape (T,) bool."""
        return np.isfinite(self.markers).all(axis=(1, 2))

    @property
    def missing(self) -> list[str]:
        """Names of the joints that are never captured."""
        return [name for name, there in zip(LANDMARKS, _captured(self.joints)) if not there]

    @property
    def split(self) -> int:
        """Number of the first judged frame; the hand is fitted to those before."""
        return int(FITTING_SHARE * len(self.joints))

    def right(self) -> 'Capture':
        """Return the capture, mirrored to a right hand if it is of a left one."""
        if self.side == 'right':
            return self
        return self._replace(joints=self.joints * LEFT_HAND_MIRROR, side='right')


def load_capture(path: str | PathLike[str], frame_rate: float | None = None) -> Capture:
    """Load a capture from an npz file, or from one of another format with joints by name.

    Parameters
    ----------
    path : path-like
        With `positions` (T, 21, 3) [m], `joints`, the 21 names in any order, `side` and
        `rate_hz` (NaN if unknown, then 30 Hz); optionally `source` and `licence`.
    frame_rate : float, optional
        Instead of the file's [Hz].

    Returns
    -------
    Capture

    Raises
    ------
    InvalidCapture
        Naming the file, the fault and what is expected.
    """
    path = Path(path)
    if path.exists() and path.suffix != NPZ.suffixes[0] and (
            is_bag(path) or recognised_format(path) is not NPZ):
        return _checked(path, _recorded_capture(path, frame_rate))
    with open_arrays(path, InvalidCapture) as data:
        fields = {name: data[name] for name in CAPTURE_FIELDS if name in data}
        source, licence = (str(data[name]) if name in data else ''
                           for name in ('source', 'licence'))
    if lacking := [name for name in CAPTURE_FIELDS if name not in fields]:
        raise InvalidCapture(f'{path}: it lacks {", ".join(lacking)}; expected '
                             f'{", ".join(CAPTURE_FIELDS)}')
    names = [str(name) for name in np.atleast_1d(fields['joints'])]
    positions = fields['positions']
    if sorted(names) != sorted(LANDMARKS):
        raise InvalidCapture(f'{path}: its joints are {", ".join(names)}; expected are the '
                             f'{len(LANDMARKS)} joints {", ".join(LANDMARKS)}')
    if positions.ndim != 3 or positions.shape[1:] != (len(LANDMARKS), 3):
        raise InvalidCapture(f'{path}: positions of shape {positions.shape}; '
                             f'expected (T, {len(LANDMARKS)}, 3)')
    if positions.dtype.kind not in 'fiu' or fields['rate_hz'].dtype.kind not in 'fiu':
        raise InvalidCapture(f'{path}: positions and rate_hz must be numbers; they are '
                             f'{positions.dtype} and {fields["rate_hz"].dtype}')
    if fields['side'].size != 1 or str(fields['side'].item()) not in SIDES:
        raise InvalidCapture(f'{path}: side {fields["side"]}; expected {" or ".join(SIDES)}')
    if fields['rate_hz'].size != 1:
        raise InvalidCapture(f'{path}: rate_hz of shape {fields["rate_hz"].shape}; '
                             'expected one number')
    rate = frame_rate or float(fields['rate_hz'].item())
    joints = positions[:, [names.index(name) for name in LANDMARKS]].astype(float)
    # A joint with a missing coordinate is not captured.
    joints[~np.isfinite(joints).all(axis=2)] = np.nan
    return _checked(path, Capture(
        path.stem, joints, str(fields['side'].item()), usable_rate(path, rate, InvalidCapture),
        source, licence, rate_notes(path, rate)))


def _recorded_capture(path: Path, frame_rate: float | None) -> Capture:
    """Return the capture of a file of points, such as BVH, whose labels name the joints."""
    take = recorded_take(path, reading=ReadingOptions(frame_rate=frame_rate))
    joints = take.columns(LANDMARKS)
    joints[~np.isfinite(joints).all(axis=2)] = np.nan
    return Capture(path.stem, joints, take.side, take.rate, notes=take.notes)


def _checked(path: Path, capture: Capture) -> Capture:
    """Return a capture, or raise `InvalidCapture` where too little of it can be judged."""
    joints = capture.joints
    never = f'; never captured: {", ".join(capture.missing)}' if capture.missing else ''
    # The fit takes joints that are never captured from a mean hand.
    fitted = np.isfinite(joints[:, _captured(joints[:capture.split])]).all(axis=(1, 2))
    for part, needed, frames in (
            ('to fit the hand on', 'markers', capture.whole[:capture.split]),
            ('to fit the hand on', 'joints', fitted[:capture.split]),
            ('to judge', 'markers', capture.whole[capture.split:])):
        if frames.sum() < MIN_CAPTURE_FRAMES:
            what = 'all eight markers' if needed == 'markers' else 'all joints'
            raise InvalidCapture(f'{path}: {frames.sum()} of the {len(frames)} frames {part} have '
                                 f'{what}; at least {MIN_CAPTURE_FRAMES} are needed{never}')
    palm = float(np.nanmedian(np.linalg.norm(
        joints[:, LANDMARKS.index('index_mcp')] - joints[:, LANDMARKS.index('wrist')], axis=1)))
    if not PALM_RANGE[0] <= palm <= PALM_RANGE[1]:
        raise InvalidCapture(f'{path}: positions have the index MCP {palm:.4g} from the wrist; '
                             f'expected metres, {PALM_RANGE[0]:g} to {PALM_RANGE[1]:g}')
    return capture


def _captured(joints: np.ndarray) -> np.ndarray:
    """Return the mask of the joints that are captured in any frame, shape (21,) bool."""
    return np.isfinite(joints).all(axis=2).any(axis=0)


def load_captures(files: Iterable[Path], frame_rate: float | None = None
                  ) -> tuple[list[Capture], dict[Path, HandTrackerError]]:
    """Load the captures of several files, and collect the faults of the others.

    Parameters
    ----------
    files : sequence of Path
    frame_rate : float, optional
        Instead of theirs [Hz].

    Returns
    -------
    captures : list of Capture
        Equal names are numbered.
    faults : dict of Path to HandTrackerError
    """
    captures: list[Capture] = []
    faults: dict[Path, HandTrackerError] = {}
    for path in files:
        try:
            captures.append(load_capture(path, frame_rate))
        except InvalidCapture as fault:
            faults[path] = fault
    names = [capture.name for capture in captures]
    return [capture._replace(name=f'{capture.name}_{names[:i].count(capture.name) + 1}')
            if capture.name in names[:i] else capture
            for i, capture in enumerate(captures)], faults


def judge_each(judge: Callable[[Capture], list[Row]], options: Options) -> Iterator[Row]:
    """Yield the rows of every capture; report and leave out those that cannot be judged.

    Parameters
    ----------
    judge : callable
        Returns the rows of a capture; defined at the top level of a module.
    options : Options

    Yields
    ------
    dict

    Raises
    ------
    InvalidCapture
        If none can be judged.
    """
    yield from options.judge_each('recordings', judge, options.captures, lambda one: one.name,
                                  InvalidCapture('none of the captures can be judged'))
