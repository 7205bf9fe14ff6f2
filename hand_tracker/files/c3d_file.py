"""Read and write C3D files, of every processor (Intel, DEC, SGI) and both storages of numbers.

The format is that of the C3D user guide of Motion Lab Systems, c3d.org. Points are read a few
megabytes at once, so that an hour needs no more memory than its points.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np

from .point_recording import (
    UP_AXES,
    Axes,
    PointBuffer,
    PointRecording,
    RecordingError,
    unique_labels,
    unit_name,
)

C3D_BLOCK = 512            # [bytes]
C3D_KEY = 0x50             # second byte of every file
INTEL, DEC, SGI = 84, 85, 86
C3D_READ_BYTES = 2**22     # of points at once
SATURATED = 2**16 - 1      # of counts in 16 bits
LABELS_EACH = 255          # in one parameter
MAX_LABEL = 127            # characters
# Points that are no places: outputs of models, by the parameters that list them.
NO_PLACES = ('ANGLES', 'FORCES', 'MOMENTS', 'POWERS', 'SCALARS', 'REACTIONS')
C3D_EXPECTED = 'expected a whole C3D file'

Parameters = dict[tuple[str, str], Any]


class C3dHeader(NamedTuple):
    """Header of a C3D file: counts, start, scale and rate of its points.

    Attributes
    ----------
    points, analog : int
        Points of a frame, and analog values between two frames' points.
    start : int
        Where the first frame is [bytes].
    scale : float
        Of integers; negative where numbers are stored as floats.
    first : int
        Number of the first frame, usually 1.
    frames : tuple of int
        Every number of frames that the file names.
    rate : float
        [Hz]
    processor : int
    """

    points: int
    analog: int
    start: int
    scale: float
    first: int
    frames: tuple[int, ...]
    rate: float
    processor: int

    @property
    def frame_bytes(self) -> int:
        """Size of a frame [bytes]."""
        return (4 * self.points + self.analog) * (4 if self.scale < 0. else 2)

    @property
    def float_type(self) -> str:
        """Type of its floats for numpy; DEC's are converted afterwards."""
        return '>f4' if self.processor == SGI else '<f4'


def read_c3d(path: Path, file: IO[bytes], zero_is_missing: bool = True,
             partial: bool = False) -> tuple[PointRecording, Axes]:
    """Read a C3D file.

    Parameters
    ----------
    path : Path
        For messages.
    file : binary file
    zero_is_missing, partial : bool
        See `ReadingOptions`.

    Returns
    -------
    PointRecording
        Its points as in the file.
    Axes
        As the file says.

    Raises
    ------
    RecordingError
    """
    head = file.read(C3D_BLOCK)
    if len(head) < C3D_BLOCK or head[1] != C3D_KEY:
        raise RecordingError(f'{path}: no C3D header in the first {C3D_BLOCK} bytes; '
                             f'{C3D_EXPECTED}')
    parameters, processor = _read_parameters(path, file, max(head[0], 1))
    header = _header(path, head, parameters, processor)
    labels = _labels(parameters, header.points)
    keep, notes = _places(labels, parameters)
    unique, repeated = unique_labels([labels[i] for i in keep])
    found, points, cut = _read_points(path, file, header, PointBuffer(
        path, unique, zero_is_missing), keep, partial)
    notes += [note for note in (repeated, cut) if note]
    stamps = None     # the first frame is at 0 s
    if header.first > 1 and np.isfinite(header.rate):
        stamps = (header.first - 1 + np.arange(len(points))) / header.rate
    recording = PointRecording(path.name, 'C3D', found, points, header.rate, stamps, Axes(),
                               tuple(notes))
    return recording, Axes(unit_name(_text(parameters, 'UNITS')), _upward_axis(parameters))


def _read_parameters(path: Path, file: IO[bytes], block: int) -> tuple[Parameters, int]:
    """Return the values by group and name, and the processor."""
    file.seek((block - 1) * C3D_BLOCK)
    start = file.read(4)
    if len(start) < 4:
        raise RecordingError(f'{path}: it ends in front of its parameters; {C3D_EXPECTED}')
    processor = start[3]
    if processor not in (INTEL, DEC, SGI):
        raise RecordingError(f'{path}: processor {processor}; expected {INTEL} (Intel), {DEC} '
                             f'(DEC) or {SGI} (SGI)')
    data = file.read(max(start[2], 1) * C3D_BLOCK - 4)
    order = '>' if processor == SGI else '<'
    groups: dict[int, str] = {}
    values: dict[tuple[int, str], Any] = {}
    at = 0
    while at + 4 <= len(data):
        length = abs(struct.unpack_from('b', data, at)[0])
        number = struct.unpack_from('b', data, at + 1)[0]
        if not length:
            break
        name = data[at + 2:at + 2 + length].decode('latin-1').upper().strip()
        step_at = at + 2 + length
        if step_at + 2 > len(data):
            raise RecordingError(f'{path}: its parameters end within {name!r}; {C3D_EXPECTED}')
        step = struct.unpack_from(f'{order}H', data, step_at)[0]
        if number < 0:
            groups[-number] = name
        else:
            values.setdefault((number, name), _value(data, step_at + 2, order, processor))
        if not step:
            break
        at = step_at + step
    return {(groups.get(group, ''), name): value
            for (group, name), value in values.items()}, processor


def _value(data: bytes, at: int, order: str, processor: int) -> Any:
    """Return a parameter's texts (list) or numbers (array), None where it is damaged."""
    if at + 2 > len(data):
        return None
    kind, dimensions = struct.unpack_from('bB', data, at)
    if dimensions > 7 or kind not in (-1, 1, 2, 4):
        return None
    shape = list(data[at + 2:at + 2 + dimensions])
    size = int(np.prod(shape, dtype=np.int64)) * abs(kind)
    raw = data[at + 2 + dimensions:at + 2 + dimensions + size]
    if len(raw) < size:
        return None
    if kind == -1:
        width = shape[0] if shape else 1
        count = size // width if width else 0
        return [raw[i * width:(i + 1) * width].decode('latin-1').strip('\0 ')
                for i in range(count)]
    if kind == 4:
        with np.errstate(invalid='ignore'):
            return _floats(np.frombuffer(raw, f'{order}f4'), processor).astype(float)
    return np.frombuffer(raw, {1: 'b', 2: f'{order}u2'}[kind]).astype(int)


def _floats(values: np.ndarray, processor: int) -> np.ndarray:
    """Return IEEE floats of those of a processor: DEC's have their words swapped and times 4."""
    if processor != DEC:
        return values
    words = np.ascontiguousarray(values).view(np.uint16).reshape(-1, 2)[:, ::-1]
    floats = np.ascontiguousarray(words).view(np.float32).ravel()
    with np.errstate(over='ignore', invalid='ignore', under='ignore'):
        return floats / np.float32(4.)


def _number(parameters: Parameters, group: str, name: str) -> float | None:
    value = parameters.get((group, name))
    if isinstance(value, np.ndarray) and value.size and np.isfinite(value.flat[0]):
        return float(value.flat[0])
    return None


def _text(parameters: Parameters, name: str, group: str = 'POINT') -> str:
    value = parameters.get((group, name))
    return value[0] if isinstance(value, list) and value else ''


def _header(path: Path, head: bytes, parameters: Parameters, processor: int) -> C3dHeader:
    order = '>' if processor == SGI else '<'
    points, analog, first, last, _ = struct.unpack_from(f'{order}5H', head, 2)
    block, _ = struct.unpack_from(f'{order}2H', head, 16)
    numbers = np.frombuffer(head, f'{order}f4', 1, 12), np.frombuffer(head, f'{order}f4', 1, 20)
    scale, rate = (float(_floats(number, processor)[0]) for number in numbers)
    for name, given in (('USED', points), ('DATA_START', block)):
        value = _number(parameters, 'POINT', name)
        if value == 0 and name == 'DATA_START':     # as Motive writes it
            continue
        if value is not None and value != given:
            if not 0 < value < 2**16:
                raise RecordingError(f'{path}: POINT:{name} {value:g}; expected {given}, as in '
                                     'its header')
            points, block = (int(value), block) if name == 'USED' else (points, int(value))
    scale = _number(parameters, 'POINT', 'SCALE') or scale
    rate = _number(parameters, 'POINT', 'RATE') or rate
    if not points:
        raise RecordingError(f'{path}: no points, POINT:USED is 0; expected markers')
    if block < 2:
        raise RecordingError(f'{path}: its points begin in block {block}; expected one behind '
                             'its header')
    if not (np.isfinite(scale) and scale):
        raise RecordingError(f'{path}: POINT:SCALE {scale:g}; expected a number that is not 0')
    trial = _trial_frames(parameters)
    counts = _frame_counts(parameters, trial, last - first + 1)
    if not counts:
        raise RecordingError(f'{path}: frames {first} to {last}; expected at least one')
    rate = rate if np.isfinite(rate) and rate > 0. else np.nan
    return C3dHeader(points, analog, (block - 1) * C3D_BLOCK, scale, trial[0] if trial else first,
                     counts, rate, processor)


def _trial_frames(parameters: Parameters) -> list[int]:
    """Return the numbers of the first and the last frame that are no 16-bit counts, if given."""
    ends = [end for name in ('START', 'END')
            if isinstance(end := parameters.get(('TRIAL', f'ACTUAL_{name}_FIELD')), np.ndarray)
            and end.size]
    return [int(end.flat[0]) + (int(end.flat[1]) << 16 if end.size > 1 else 0)
            for end in ends] if len(ends) == 2 else []


def _frame_counts(parameters: Parameters, trial: list[int], of_header: int) -> tuple[int, ...]:
    """Return all frame counts in the file; 16-bit counts that are saturated only if alone."""
    found = [trial[1] - trial[0] + 1] if trial else []
    found += [int(value) for name in ('LONG_FRAMES', 'FRAMES')
              if (value := _number(parameters, 'POINT', name)) is not None]
    found.append(of_header)
    found = [count for count in found if 0 < count < 2**31]
    return tuple(count for count in found if count != SATURATED) or tuple(found)


def _labels(parameters: Parameters, points: int) -> list[str]:
    labels: list[str] = []
    number = 1
    while isinstance(more := parameters.get(('POINT', f'LABELS{number if number > 1 else ""}')),
                     list):
        labels += more
        number += 1
    return (labels + [''] * points)[:points]


def _places(labels: list[str], parameters: Parameters) -> tuple[list[int], list[str]]:
    """Return the columns of marker positions, and a note on model outputs, which are left out."""
    others = {label for name in NO_PLACES
              if isinstance(listed := parameters.get(('POINT', name)), list)
              for label in listed if label}
    keep = [i for i, label in enumerate(labels) if label not in others]
    left_out = len(labels) - len(keep)
    if not left_out or not keep:
        return list(range(len(labels))), []
    return keep, [f'left out: {left_out} outputs of models, which are no places']


def _upward_axis(parameters: Parameters) -> str | None:
    up = _text(parameters, 'Y_SCREEN').strip().lower().lstrip('+')
    if _text(parameters, 'COMPANY', 'MANUFACTURER').strip() == 'Qualisys':
        up = up.lstrip('-')     # QTM writes -Z where z is up
    return up if up in UP_AXES else None


def _read_points(path: Path, file: IO[bytes], header: C3dHeader, buffer: PointBuffer,
                 keep: list[int], partial: bool) -> tuple[tuple[str, ...], np.ndarray, str]:
    """Return labels, points as in the file, and a note where it is cut."""
    available = (file.seek(0, 2) - header.start) // header.frame_bytes
    fitting = [count for count in header.frames if count <= available]
    frames = max(fitting, default=max(available, 0))
    note = ''
    if not fitting:
        note = f'cut: {frames} whole frames of {min(header.frames)}'
        if not partial or not frames:
            raise RecordingError(f'{path}: {note}; {C3D_EXPECTED}'
                                 + (' (--partial reads what is there)' if frames else ''))
    file.seek(header.start)
    at_once = max(C3D_READ_BYTES // header.frame_bytes, 1)
    columns = slice(None) if len(keep) == header.points else np.array(keep)
    for first in range(0, frames, at_once):
        count = min(at_once, frames - first)
        raw = file.read(count * header.frame_bytes)
        if len(raw) < count * header.frame_bytes:
            raise RecordingError(f'{path}: it ends within frame {first}; {C3D_EXPECTED}')
        buffer.append(_decoded(raw, header)[:, columns])
    labels, points = buffer.finish()
    return labels, points, note


def _decoded(raw: bytes, header: C3dHeader) -> np.ndarray:
    """Return the points of whole frames, NaN where missing, shape (n, N, 3)."""
    width = 4 * header.points
    if header.scale < 0.:
        numbers = _floats(np.frombuffer(raw, header.float_type), header.processor)
        values = numbers.reshape(-1, width + header.analog)[:, :width].reshape(
            -1, header.points, 4)
        points = values[..., :3].astype(np.float32)
        with np.errstate(invalid='ignore'):
            # The fourth number is cameras and residual as an integer, its sign is that of both.
            missing = ~(values[..., 3] > -1.)
    else:
        order = '>' if header.processor == SGI else '<'
        words = np.frombuffer(raw, f'{order}i2').reshape(-1, width + header.analog)
        integers = words[:, :width].reshape(-1, header.points, 4)
        with np.errstate(over='ignore'):
            points = integers[..., :3] * np.float32(header.scale)
        missing = integers[..., 3] < 0
    points[missing] = np.nan
    return points


def write_c3d(path: Path, recording: PointRecording) -> None:
    """Write points as a C3D file: Intel floats, millimetres, z up.

    Parameters
    ----------
    path : Path
    recording : PointRecording

    Raises
    ------
    RecordingError
        If it has more points or frames than the format can hold.
    """
    frames, count = recording.points.shape[:2]
    if not 0 < count < SATURATED or not 0 < frames < 2**31:
        raise RecordingError(f'{path}: {frames} frames of {count} points; a C3D file holds 1 to '
                             f'{SATURATED - 1} points')
    rate = recording.rate if np.isfinite(recording.rate) else 0.
    first = recording.first_number(rate)
    section = _parameter_section(recording, rate, first, 0)
    blocks = -(-(len(section) + 4) // C3D_BLOCK)
    if blocks > 255:
        raise RecordingError(f'{path}: the labels of {count} points need {blocks} blocks; a C3D '
                             'file has 255 for its parameters')
    data_block = 2 + blocks
    section = _parameter_section(recording, rate, first, data_block)
    ends = (min(frame, SATURATED) for frame in (first, first + frames - 1))
    head = struct.pack('<BB5HfHHf', 2, C3D_KEY, count, 0, *ends, 0, -1., data_block, 0, rate)
    with open(path, 'wb') as file:
        file.write(head.ljust(C3D_BLOCK, b'\0'))
        file.write((struct.pack('4B', 1, C3D_KEY, blocks, INTEL) + section).ljust(
            blocks * C3D_BLOCK, b'\0'))
        for rows in recording.blocks():
            values = np.zeros((len(rows), count, 4), '<f4')
            values[..., :3] = 1000. * rows
            values[~np.isfinite(rows).all(axis=2)] = (0., 0., 0., -1.)
            file.write(values.tobytes())
        file.write(bytes(-file.tell() % C3D_BLOCK))


def _parameter_section(recording: PointRecording, rate: float, start: int,
                       data_block: int) -> bytes:
    frames, count = recording.points.shape[:2]
    labels = [label.encode('latin-1', 'replace')[:MAX_LABEL]
              for label in recording.labels]
    # A marker without a label has the name that Vicon gives it.
    labels = [label or f'*{i + 1}'.encode() for i, label in enumerate(labels)]
    section = _group(1, 'POINT') + _group(2, 'ANALOG') + _group(3, 'TRIAL')
    section += _parameter(1, 'USED', 2, (), struct.pack('<H', count))
    section += _parameter(1, 'SCALE', 4, (), struct.pack('<f', -1.))
    section += _parameter(1, 'RATE', 4, (), struct.pack('<f', rate))
    section += _parameter(1, 'FRAMES', 2, (), struct.pack('<H', min(frames, SATURATED)))
    section += _parameter(1, 'LONG_FRAMES', 4, (), struct.pack('<f', frames))
    section += _texts('UNITS', [b'mm']) + _texts('X_SCREEN', [b'+X']) + _texts(
        'Y_SCREEN', [b'+Z'])
    for number, first in enumerate(range(0, count, LABELS_EACH), 1):
        some = labels[first:first + LABELS_EACH]
        suffix = str(number) if number > 1 else ''
        section += _texts(f'LABELS{suffix}', some)
        section += _texts(f'DESCRIPTIONS{suffix}', [b' '] * len(some))
    section += _parameter(2, 'USED', 2, (), struct.pack('<H', 0))
    for name, frame in (('START', start), ('END', start + frames - 1)):
        section += _parameter(3, f'ACTUAL_{name}_FIELD', 2, (2,),
                              struct.pack('<2H', frame & 0xffff, frame >> 16))
    section += _parameter(1, 'DATA_START', 2, (), struct.pack('<H', data_block))
    return section + bytes(2)


def _group(number: int, name: str) -> bytes:
    return struct.pack('bb', len(name), -number) + name.encode() + struct.pack('<hB', 3, 0)


def _parameter(group: int, name: str, kind: int, shape: Sequence[int], data: bytes) -> bytes:
    body = struct.pack('bB', kind, len(shape)) + bytes(shape) + data + b'\0'
    return (struct.pack('bb', len(name), group) + name.encode()
            + struct.pack('<h', len(body) + 2) + body)


def _texts(name: str, texts: Sequence[bytes]) -> bytes:
    width = max(max(map(len, texts)), 4)
    data = b''.join(text.ljust(width) for text in texts)
    return _parameter(1, name, -1, (width, len(texts)), data)
