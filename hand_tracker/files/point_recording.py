"""Recording of 3-D points from any motion capture file, in metres, z up, right-handed."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..core.errors import HandTrackerError

# [m] of each unit, by every spelling that files use; the first spelling of a unit names it.
UNIT_SPELLINGS = {
    'm': (1., ('m', 'meter', 'meters', 'metre', 'metres')),
    'dm': (.1, ('dm', 'decimeter', 'decimeters', 'decimetre', 'decimetres')),
    'cm': (.01, ('cm', 'centimeter', 'centimeters', 'centimetre', 'centimetres')),
    'mm': (.001, ('mm', 'millimeter', 'millimeters', 'millimetre', 'millimetres')),
    'in': (.0254, ('in', 'inch', 'inches')),
    'ft': (.3048, ('ft', 'foot', 'feet')),
}
UNIT_WORDS = {'in': 'inches', 'ft': 'feet'}     # for sentences, in which 'in in' is odd
UP_AXES = ('x', 'y', 'z', '-x', '-y', '-z')
HANDEDNESS = ('right', 'left')  # of axes
# Rows: the axes x, y, z of this package in those of a right-handed file, by its upward axis.
ROTATIONS = {
    'z': ((1, 0, 0), (0, 1, 0), (0, 0, 1)), '-z': ((1, 0, 0), (0, -1, 0), (0, 0, -1)),
    'y': ((1, 0, 0), (0, 0, -1), (0, 1, 0)), '-y': ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
    'x': ((0, 1, 0), (0, 0, 1), (1, 0, 0)), '-x': ((0, 1, 0), (0, 0, -1), (-1, 0, 0)),
}
# Horizontal axis that is mirrored where a file's axes are left-handed.
MIRRORED_AXIS = {'x': 1, '-x': 1, 'y': 0, '-y': 0, 'z': 0, '-z': 0}
MAX_COORDINATE = 1e7       # of a point, in the file's unit
MAX_POINT_BYTES = 2**31    # of all points of a recording
WRITTEN_RATE = 100.        # [Hz] of written frames where a recording has no rate
ROWS_AT_ONCE = 2**14       # frames that are converted at once
FINEST_STAMP = 1e-9        # [s]: ROS 2 has whole nanoseconds
MOST_FILLED = 20           # times as many frames as there are, with those that were left out
# Names that systems give to markers that nobody labelled.
ANONYMOUS = re.compile(r'|\*\d*|(unlabell?ed|unidentified|unnamed)(?![a-z]).*', re.IGNORECASE)


class RecordingError(HandTrackerError):
    """A motion capture file that cannot be read or written: which, where, what was expected."""


class Axes(NamedTuple):
    """Unit and axes of a file.

    Attributes
    ----------
    units : str or None
        Key of `UNIT_SPELLINGS`; None where the file does not say.
    up : str or None
        One of `UP_AXES`; None where the file does not say.
    handed : {'right', 'left'}
    """

    units: str | None = None
    up: str | None = None
    handed: str = 'right'

    @property
    def scale(self) -> float:
        """Length of the unit [m]."""
        return UNIT_SPELLINGS[self.units or 'm'][0]

    @property
    def matrix(self) -> np.ndarray:
        """Turn a point of the file into metres, z up, right-handed; shape (3, 3)."""
        up = self.up or 'z'
        matrix = np.array(ROTATIONS[up], dtype=float)
        if self.handed == 'left':
            matrix[:, MIRRORED_AXIS[up]] *= -1.
        return self.scale * matrix


class Said(NamedTuple):
    """Whether units, handedness and upward axis are given, by file or user, or assumed.

    Attributes
    ----------
    units, handed, up : bool
    """

    units: bool = True
    handed: bool = False
    up: bool = True


class BagOrigin(NamedTuple):
    """Where in a rosbag2 recording points come from.

    Attributes
    ----------
    topic : str
    type : str
        Of its messages.
    frame_id : str
        Of the first points.
    start : int
        Stamp of the first message, else its time of recording [ns].
    """

    topic: str
    type: str
    frame_id: str
    start: int


class PointRecording(NamedTuple):
    """Points over time, whatever file they came from.

    Attributes
    ----------
    name : str
        Of the file.
    format : str
        As a reader would search for: 'C3D', 'TRC', ...
    labels : tuple of str, length N
        Of the points, each different; empty for one that nobody labelled.
    points : ndarray, shape (T, N, 3)
        NaN where missing, z up, right-handed [m].
    rate : float
        NaN where it is not known [Hz].
    stamps : ndarray, shape (T,), or None
        Time of each frame; None where frames are `1 / rate` apart [s].
    axes : Axes
        Of the file; `points` are converted.
    notes : tuple of str
        Conversions, assumptions and omissions, a line each.
    is_landmarks : bool
        Whether these are joint centres, not markers on the skin.
    said : Said
    origin : BagOrigin or None
        Of rosbag2 recordings.
    side : str
        Of the hand, where the file says it beside its labels; else empty.
    """

    name: str
    format: str
    labels: tuple[str, ...]
    points: np.ndarray
    rate: float
    stamps: np.ndarray | None
    axes: Axes
    notes: tuple[str, ...] = ()
    is_landmarks: bool = False
    said: Said = Said()
    origin: BagOrigin | None = None
    side: str = ''

    @property
    def seen(self) -> np.ndarray:
        """Whether each point is there, shape (T, N) bool."""
        return np.concatenate([np.isfinite(rows).all(axis=2) for rows in self.blocks()]
                              or [np.zeros((0, len(self.labels)), dtype=bool)])

    def times(self, unknown_rate: float = WRITTEN_RATE) -> np.ndarray:
        """Return the time of each frame, at `unknown_rate` [Hz] where it is not known, (T,) [s]."""
        if self.stamps is not None:
            return self.stamps
        rate = self.rate if np.isfinite(self.rate) else unknown_rate
        return np.arange(len(self.points)) / rate

    def evenly_spaced(self) -> PointRecording:
        """Return this recording with the frames that were left out, as their times say.

        Their points are missing.
        """
        if self.stamps is None or not self.left_out:
            return self
        rows = even_rows(self.stamps)
        count = int(rows[-1]) + 1
        points = np.full((count, *self.points.shape[1:]), np.nan, dtype=self.points.dtype)
        points[rows] = self.points
        return self._replace(points=points, stamps=np.interp(np.arange(count), rows, self.stamps))

    @property
    def left_out(self) -> int:
        """Number of frames that were left out between the others, as their times say."""
        if self.stamps is None or len(self.stamps) < 2:
            return 0
        return int(even_rows(self.stamps)[-1]) + 1 - len(self.stamps)

    def first_number(self, rate: float) -> int:
        """Return the number of the first frame at a rate [Hz], where frame 1 is at 0 s.

        It is 1 where the rate is 0 or NaN, and where a file cannot hold the last frame's number.
        """
        if self.stamps is None or not rate > 0.:
            return 1
        first = 1. + float(self.stamps[0]) * rate
        return round(first) if 1. <= first < 2**31 - len(self.points) else 1

    def blocks(self) -> Iterator[np.ndarray]:
        """Yield views of the points, some frames at once."""
        for first in range(0, len(self.points), ROWS_AT_ONCE):
            yield self.points[first:first + ROWS_AT_ONCE]

    def converted(self, axes: Axes) -> PointRecording:
        """Return this recording, whose points are still the file's, in metres and z up.

        The points are converted in place, as there may be hundreds of megabytes.

        Parameters
        ----------
        axes : Axes
            Of the file.

        Returns
        -------
        PointRecording
        """
        if not np.array_equal(axes.matrix, np.eye(3)):
            matrix = axes.matrix.T.astype(self.points.dtype)
            for rows in self.blocks():
                rows[:] = rows @ matrix
        return self._replace(axes=axes)


def even_rows(times: np.ndarray) -> np.ndarray:
    """Return the row of each frame in an evenly timed recording, with rows for left-out frames.

    Parameters
    ----------
    times : ndarray, shape (T,)
        Of the frames, two or more, increasing [s].

    Returns
    -------
    ndarray of int, shape (T,)
        0, 1, 2, ... where none was left out, or too many, see `MOST_FILLED`.
    """
    steps, usual = np.diff(times), np.median(np.diff(times))
    if usual <= 0. or (np.abs(steps - usual) < .5 * usual).all():
        return np.arange(len(times))
    rows = np.zeros(len(times), dtype=np.int64)
    early = 0.     # [1] of the usual step, by which a frame came before its row
    for i, step in enumerate((steps / usual).tolist()):
        passed = step - early
        # Some jitter is made good by the next frames; a rate a little off the usual one is not.
        rows[i + 1] = rows[i] + max(round(passed), 1)
        early = min(max(.9 * (rows[i + 1] - rows[i] - passed), -.5), .5)
    return rows if rows[-1] < MOST_FILLED * len(rows) else np.arange(len(rows))


def nominal_rate(times: np.ndarray) -> float | None:
    """Return the whole rate that frames cannot be told from by their times [Hz].

    Stamps resolve the length of a take as far as they are even: within twice what the worst is off
    the straight line through all of them.

    Parameters
    ----------
    times : ndarray, shape (T,)
        Of the frames, of which some may be left out [s].

    Returns
    -------
    float or None
        None where no whole rate, or more than one, is within their resolution.
    """
    steps, own = np.diff(times), times - times[:1]
    if not len(steps) or not (steps > 0.).all():
        return None
    if not own[-1] < MOST_FILLED * len(times) * np.median(steps):
        return None    # two recordings, or stamps of different clocks
    rows = even_rows(times).astype(float)
    rate = round(rows[-1] / own[-1])
    across, along = rows - rows.mean(), own - own.mean()
    off = along - across * (across @ along) / (across @ across)
    resolution = 2. * float(np.abs(off).max()) + FINEST_STAMP
    is_one = rate > 0 and resolution * rate < .5 * own[-1]
    return float(rate) if is_one and abs(rows[-1] / rate - own[-1]) <= resolution else None


def usual_rate(times: np.ndarray) -> float:
    """Return the nominal rate of frames, else that of their usual step, NaN without any [Hz].

    Parameters
    ----------
    times : ndarray, shape (T,)
        [s]
    """
    steps = np.diff(times)
    forward = steps[steps > 0.]
    if not len(forward):
        return np.nan
    return nominal_rate(times) or float(1. / np.median(forward))


def conversion_note(axes: Axes, said: Said, unit_reason: str = '') -> str:
    """Return the note on a file's unit and axes, empty where there is nothing to say.

    Parameters
    ----------
    axes : Axes
        As the points were converted.
    said : Said
    unit_reason : str, optional
        Why the unit is this one, where the file does not say.
    """
    named = UNIT_WORDS.get(axes.units or '', axes.units)
    units = f'{named} ({unit_reason}: --units)' if unit_reason else named
    handed = ', left-handed' if axes.handed == 'left' else ''
    assumed = [f'--{name}' for name, given in (('units', said.units or unit_reason),
                                               ('up', said.up)) if not given]
    if axes == Axes('m', 'z') and not (assumed or unit_reason):
        return ''
    return (f'the file is in {units}, {axes.up} up{handed}; read as metres, z up'
            + (f' (assumed, as it does not say: {", ".join(assumed)})' if assumed else ''))


def unit_name(text: str) -> str | None:
    """Return the unit that a text names, None for no unit of length."""
    word = text.strip().lower().rstrip('.')
    return next((unit for unit, (_, spellings) in UNIT_SPELLINGS.items() if word in spellings),
                None)


def printable(text: str) -> str:
    """Return a text without what cannot be printed, or would lead a terminal astray."""
    return ''.join(c for c in text if c.isprintable())


def unique_labels(labels: Sequence[str]) -> tuple[tuple[str, ...], str]:
    """Return labels without padding, each different, and a note on those that were repeated.

    Parameters
    ----------
    labels : sequence of str
        Those of `ANONYMOUS` points become empty.

    Returns
    -------
    labels : tuple of str
        The second 'LFIN' becomes 'LFIN#2'.
    note : str
        Empty where none was repeated.
    """
    found: list[str] = []
    taken: set[str] = set()
    repeated: list[str] = []
    for label in labels:
        # One that looks empty but is not would be invisible in messages.
        label = printable(label).strip()
        if ANONYMOUS.fullmatch(label.rpartition(':')[2].strip()) or ANONYMOUS.fullmatch(label):
            found.append('')
            continue
        name, number = label, 1
        while name in taken:
            number += 1
            name = f'{label}#{number}'
        if number > 1:
            repeated.append(name)
        taken.add(name)
        found.append(name)
    note = f'repeated labels: the later ones are read as {", ".join(repeated[:8])}' \
        if repeated else ''
    return tuple(found), note


class PointBuffer:
    """Collect the frames of a file in little more memory than they need.

    Points without a label are kept in as few columns as are seen at once: systems begin a new
    column after every gap.

    Parameters
    ----------
    path : Path
        For messages.
    labels : sequence of str, length N
        Empty for points without a label.
    zero_is_missing : bool
        Whether a point at exactly (0, 0, 0) is one that the system lost.
    expected : int, optional
        Number of frames, where it is trusted.
    is_origin : ndarray of bool, shape (N,), optional
        Whether each point is at (0, 0, 0) in every frame: where one alone is, it is the origin
        itself, and not lost.
    """

    def __init__(self, path: Path, labels: Sequence[str], zero_is_missing: bool = True,
                 expected: int = 0, is_origin: np.ndarray | None = None) -> None:
        named = np.array([bool(label) for label in labels], dtype=bool)
        self._path = path
        self._may_be_lost = np.full(len(labels), zero_is_missing)
        if is_origin is not None and is_origin.sum() == 1:
            self._may_be_lost &= ~is_origin
        self._labels = tuple(label for label in labels if label)
        self._named = slice(None) if named.all() else np.flatnonzero(named)
        self._unnamed = np.flatnonzero(~named)
        self._points = np.empty((0, len(self._labels), 3), dtype=np.float32)
        self._clouds: list[np.ndarray] = []
        self.frames = 0
        self._reserve(expected)

    def _reserve(self, frames: int) -> None:
        if frames <= len(self._points):
            return
        self._check_size(frames)
        # In place: a copy would need twice the memory for a moment.
        self._points.resize((frames, len(self._labels), 3), refcheck=False)

    def _check_size(self, frames: int, width: int = 0) -> None:
        size = 12 * frames * (len(self._labels) + width)
        if size > MAX_POINT_BYTES:
            raise RecordingError(
                f'{self._path}: {frames} frames of {len(self._labels) + width} points, '
                f'{size / 1e9:.1f} GB; expected at most {MAX_POINT_BYTES / 1e9:.1f} GB')

    def append(self, points: np.ndarray) -> None:
        """Add frames, shape (n, N, 3); points with an impossible coordinate become missing."""
        with np.errstate(over='ignore', invalid='ignore'):
            points = points.astype(np.float32, copy=False)
            missing = ~(np.abs(points) < MAX_COORDINATE).all(axis=2)
            if self._may_be_lost.any():
                missing |= (points == 0.).all(axis=2) & self._may_be_lost
        if missing.any():
            points = np.where(missing[..., None], np.float32(np.nan), points)
        end = self.frames + len(points)
        if end > len(self._points):
            self._reserve(max(end, min(2 * self.frames, self.frames + 2**17)))
        self._points[self.frames:end] = points[:, self._named]
        self.frames = end
        if len(self._unnamed):
            self._clouds.append(_packed(points[:, self._unnamed], ~missing[:, self._unnamed]))
            self._check_size(end, max(cloud.shape[1] for cloud in self._clouds))

    def finish(self) -> tuple[tuple[str, ...], np.ndarray]:
        """Return the labels, those of points without a label empty, and the points (T, N, 3)."""
        self._points.resize((self.frames, len(self._labels), 3), refcheck=False)
        width = max((cloud.shape[1] for cloud in self._clouds), default=0)
        if not width:
            return self._labels, self._points
        points = np.full((self.frames, len(self._labels) + width, 3), np.nan, dtype=np.float32)
        points[:, :len(self._labels)] = self._points
        first = 0
        for cloud in self._clouds:
            points[first:first + len(cloud), len(self._labels):][:, :cloud.shape[1]] = cloud
            first += len(cloud)
        return self._labels + ('',) * width, points


def _packed(points: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Return points (n, U, 3) moved to the first columns, as many as are seen at once."""
    width = int(seen.sum(axis=1).max(initial=0))
    order = np.argsort(~seen, axis=1, kind='stable')[:, :width]
    return np.take_along_axis(points, order[..., None], axis=1)
