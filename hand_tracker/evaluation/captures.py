"""Captured hands as files: loaded, checked, and cut into a part to fit and a part to judge."""

import zipfile
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..calibration import LANDMARKS
from ..core.errors import HandTrackerError
from ..core.model.hand import SIDES
from ..core.model.marker_layout import PAPER_PLACES

ASSUMED_RATE = 30.  # [Hz] of captures that do not say theirs
RATE_RANGE = (5., 2000.)  # [Hz]
CALIBRATION = .2    # the first part of a capture, on which its hand is fitted
MIN_FRAMES = 100
PALM_RANGE = (.03, .2)  # [m] from wrist to index MCP: what is outside is in another unit
MARKER_ROWS = np.array([LANDMARKS.index(place) for place in PAPER_PLACES])
MIRROR = np.array((1., -1., 1.))


class InvalidCapture(HandTrackerError, ValueError):
    """A file that is no capture, or one that cannot be judged."""


class Capture(NamedTuple):
    """A captured hand.

    Attributes
    ----------
    name : str
        The file's, without its suffix.
    joints : ndarray, shape (T, 21, 3)
        In the order of `LANDMARKS`, NaN where not captured [m].
    side : {'right', 'left'}
    rate : float
        [Hz]
    source, licence : str
        As the file has them.
    """

    name: str
    joints: np.ndarray
    side: str
    rate: float
    source: str = ''
    licence: str = ''

    @property
    def markers(self):
        """Return the paper's eight markers, shape (T, 8, 3), NaN where not captured [m]."""
        return self.joints[:, MARKER_ROWS]

    @property
    def whole(self):
        """Return which frames have all eight markers, shape (T,)."""
        return np.isfinite(self.markers).all(axis=(1, 2))

    @property
    def missing(self):
        """Return the names of the joints that are never captured."""
        return [name for name, there in zip(LANDMARKS, _captured(self.joints)) if not there]

    @property
    def split(self):
        """Return the first frame that is judged; the hand is fitted on those before."""
        return int(CALIBRATION * len(self.joints))

    def right(self):
        """Return the capture as that of a right hand."""
        if self.side == 'right':
            return self
        return self._replace(joints=self.joints * MIRROR, side='right')


def load_capture(path):
    """Return the capture in a file.

    Parameters
    ----------
    path : path-like
        npz file with `positions` (T, 21, 3) [m], `joints`, the 21 names in any order,
        `side` and `rate_hz` (NaN: unknown, 30 Hz are taken); and, to be credited, `source`
        and `licence`.

    Returns
    -------
    Capture

    Raises
    ------
    InvalidCapture
        Naming the file, what is wrong with it and what is expected.
    """
    path = Path(path)
    try:
        with np.load(path, allow_pickle=False) as data:
            fields = {name: data[name] for name in ('positions', 'joints', 'side', 'rate_hz')}
            credit = [str(data[name]) if name in data else '' for name in ('source', 'licence')]
    except KeyError as error:
        raise InvalidCapture(f'{path}: {error.args[0]}; expected positions, joints, side '
                             'and rate_hz') from None
    # An array alone is no context: TypeError, before Python 3.11 AttributeError.
    except (OSError, ValueError, TypeError, AttributeError, EOFError, zipfile.BadZipFile) as error:
        reason = getattr(error, 'strerror', None)
        raise InvalidCapture(f'{path}: no npz file that can be read'
                             + (f' ({reason})' if reason else '')
                             + '; expected plain arrays, as numpy.savez writes them') from None
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
    rate = float(fields['rate_hz'].item())
    rate = ASSUMED_RATE if np.isnan(rate) else rate
    if not RATE_RANGE[0] <= rate <= RATE_RANGE[1]:
        raise InvalidCapture(f'{path}: rate_hz {rate:g}; allowed is {RATE_RANGE[0]:g} to '
                             f'{RATE_RANGE[1]:g} Hz, or NaN where it is not known')
    joints = positions[:, [names.index(name) for name in LANDMARKS]].astype(float)
    # A joint without one coordinate is not captured.
    joints[~np.isfinite(joints).all(axis=2)] = np.nan
    capture = Capture(path.stem, joints, str(fields['side'].item()), rate, *credit)
    never = f'; never captured: {", ".join(capture.missing)}' if capture.missing else ''
    # Of joints that are never captured the fit makes do with those of a mean hand.
    fitted = np.isfinite(joints[:, _captured(joints[:capture.split])]).all(axis=(1, 2))
    for part, needed, frames in (
            ('to fit the hand on', 'markers', capture.whole[:capture.split]),
            ('to fit the hand on', 'joints', fitted[:capture.split]),
            ('to judge', 'markers', capture.whole[capture.split:])):
        if frames.sum() < MIN_FRAMES:
            what = 'all eight markers' if needed == 'markers' else 'all joints'
            raise InvalidCapture(f'{path}: {frames.sum()} of the {len(frames)} frames {part} have '
                                 f'{what}; at least {MIN_FRAMES} are needed{never}')
    palm = float(np.nanmedian(np.linalg.norm(
        joints[:, LANDMARKS.index('index_mcp')] - joints[:, LANDMARKS.index('wrist')], axis=1)))
    if not PALM_RANGE[0] <= palm <= PALM_RANGE[1]:
        raise InvalidCapture(f'{path}: positions have the index MCP {palm:.4g} from the wrist; '
                             f'expected metres, {PALM_RANGE[0]:g} to {PALM_RANGE[1]:g}')
    return capture


def _captured(joints):
    """Return which of the 21 joints are captured in any frame."""
    return np.isfinite(joints).all(axis=2).any(axis=0)


def load_captures(files):
    """Return the captures in files, and why the others cannot be judged.

    Parameters
    ----------
    files : sequence of path-like

    Returns
    -------
    captures : list of Capture
        Files of one name in two folders are told apart.
    faults : list of InvalidCapture
    """
    captures, faults = [], []
    for path in files:
        try:
            captures.append(load_capture(path))
        except InvalidCapture as fault:
            faults.append(fault)
    names = [capture.name for capture in captures]
    return [capture._replace(name=f'{capture.name}_{names[:i].count(capture.name) + 1}')
            if capture.name in names[:i] else capture
            for i, capture in enumerate(captures)], faults


def judge_each(judge, options):
    """Yield the rows of every capture; one that cannot be judged is named and left out.

    Parameters
    ----------
    judge : callable
        Returns the rows of a capture; at the top level of a module.
    options : Options

    Yields
    ------
    dict

    Raises
    ------
    InvalidCapture
        If none can be judged.
    """
    judged = 0
    for found, capture in zip(options.each(
            'recordings', partial(_rows_or_fault, judge), options.captures), options.captures):
        if isinstance(found, str):
            options.leave_out(f'{capture.name}: {found}')
        else:
            judged += 1
            yield from found
    if not judged:
        raise InvalidCapture('none of the captures can be judged')


def _rows_or_fault(judge, capture):
    # A fault comes back as text: raised, it would end the work on the others.
    try:
        return judge(capture)
    except HandTrackerError as fault:
        return str(fault)
