"""Read large text files of numbers in blocks: TRC, TSV, CSV, BVH. Also gzipped."""

from __future__ import annotations

import gzip
import warnings
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from typing import IO, NamedTuple

import numpy as np

from .point_recording import PointBuffer, PointRecording, RecordingError, nominal_rate

BLOCK_BYTES = 2**21        # read at once
MAX_LINE_BYTES = 2**22
MAX_TEXT_BYTES = 2**33     # of a file, unpacked
GZIP_MAGIC = b'\x1f\x8b'
CELL_SHOWN = 24            # characters of a bad cell in a message
TIME_ROUNDING = 1e-5       # [s]; five decimals are usual
# Of cameras and their clocks, with much to spare.
HIGHEST_RATE = 1e6         # [Hz]
LATEST_TIME = 1e13         # [s]
LATEST_FRAME = 1e15        # number


@contextmanager
def open_packed(path: str | PathLike[str]) -> Iterator[IO[bytes]]:
    """Open a file for reading, unpacked where it is gzipped.

    Raises
    ------
    RecordingError
        Where it cannot be opened or unpacked.
    """
    try:
        with open(path, 'rb') as file:
            magic = file.read(len(GZIP_MAGIC))
            file.seek(0)
            if magic != GZIP_MAGIC:
                yield file
                return
            with gzip.open(file) as unpacked:
                yield unpacked  # type: ignore[misc]
    except (gzip.BadGzipFile, EOFError, zlib.error) as error:
        raise RecordingError(f'{path}: damaged gzip data ({error}); expected a whole file'
                             ) from None
    except OSError as error:
        raise RecordingError(f'{path}: cannot be read ({error.strerror or error}); expected a '
                             'motion capture file') from None


class Rows(NamedTuple):
    """Some rows of a table.

    Attributes
    ----------
    numbers : ndarray, shape (n, columns)
        NaN for an empty cell.
    first_line : int
        Number of the first row's line in the file, from 1.
    """

    numbers: np.ndarray
    first_line: int


class CutRow(Exception):
    """The last line of a file ends before its last cell."""


class TextTable:
    """Lines of a text file, then numbers in columns.

    Parameters
    ----------
    path : path-like
        For messages.
    file : binary file
        Read from where it is.

    Attributes
    ----------
    line : int
        Number of the last line that was read, from 1.
    is_cut : bool
        Whether the last line of the numbers was not whole, so that it was left out.
    doubt : str
        Of its last number, where that may be cut and was taken all the same, else empty.
    """

    def __init__(self, path: str | PathLike[str], file: IO[bytes]) -> None:
        self.path, self._file = Path(path), file
        self.line = 0
        self.is_cut = False
        self.doubt = ''
        self._read = 0
        self._ahead: list[bytes] = []
        self._last = b''
        self._line_before = b''

    def fault(self, what: str, line: int | None = None) -> RecordingError:
        """Return an error at a line, the last one read when left out."""
        return RecordingError(f'{self.path}: line {self.line if line is None else line}: {what}')

    def text_line(self) -> str | None:
        """Return the next line without its end, None at the end of the file."""
        if self._ahead:
            raw = self._ahead.pop()
        else:
            raw = self._file.readline(MAX_LINE_BYTES + 1)
        if not raw:
            return None
        self._last = raw
        self.line += 1
        if len(raw) > MAX_LINE_BYTES:
            raise self.fault(f'more than {MAX_LINE_BYTES} bytes; expected lines of text')
        if self.line == 1:
            raw = raw.removeprefix(b'\xef\xbb\xbf')
        if b'\0' in raw:
            raise self.fault('bytes that are no text; expected a text file in UTF-8')
        try:
            text = raw.decode('utf-8')
        except UnicodeDecodeError:
            text = raw.decode('latin-1')
        return text.rstrip('\r\n')

    def put_back(self) -> None:
        """Let the last line be read again."""
        self._ahead.append(self._last)
        self.line -= 1

    @property
    def has_line_end(self) -> bool:
        """Whether the last line that was read ends as lines do, so that it is whole."""
        return self._last.endswith((b'\n', b'\r'))

    def numbers(self, delimiter: str, columns: int) -> Iterator[Rows]:
        """Yield the rows of numbers up to the end of the file, or up to a blank line.

        Parameters
        ----------
        delimiter : str
            One character; a space stands for any white space between cells.
        columns : int
            Cells of a row; missing last cells are empty ones, more must be empty.

        Yields
        ------
        Rows

        Raises
        ------
        RecordingError
            Naming the line and the cell that is no number.
        """
        rest = b''.join(self._ahead)
        self._ahead.clear()
        comma: bool | None = None
        while True:
            block = self._file.read(BLOCK_BYTES)
            self._read += len(block)
            if self._read > MAX_TEXT_BYTES:
                raise self.fault(f'more than {MAX_TEXT_BYTES / 1e9:.0f} GB of text')
            text = rest + block
            end = text.rfind(b'\n') + 1 if block else len(text)
            text, rest = text[:end], text[end:]
            if len(rest) > MAX_LINE_BYTES:
                raise self.fault(f'more than {MAX_LINE_BYTES} bytes; expected lines of numbers',
                                 self.line + 1)
            if text:
                text = text.replace(b'\r\n', b'\n').replace(b'\r', b'\n')
                if comma is None and delimiter != ',':
                    # Decimal commas of a localised spreadsheet.
                    comma = b',' in text[:text.find(b'\n')]
                if comma:
                    text = text.replace(b',', b'.')
                ended = not block
                text, blank = _until_blank_line(text)
                if text:
                    numbers = self._parse(text, delimiter.encode(), columns, ended)
                    if len(numbers):
                        yield Rows(numbers, self.line + 1)
                    self._line_before = text[text.rfind(b'\n', 0, -1) + 1:]
                    self.line += text.count(b'\n') + (not text.endswith(b'\n'))
                if blank:
                    return
            if not block:
                return

    def _parse(self, text: bytes, delimiter: bytes, columns: int, ended: bool) -> np.ndarray:
        """Return the numbers of whole lines, shape (n, columns)."""
        has_end = text.endswith(b'\n')
        if has_end or not ended:
            fast = _parse_regular(text, delimiter, columns)
            if fast is not None:
                return fast
        lines = text.split(b'\n')
        if has_end:
            lines.pop()
        rows = np.full((len(lines), columns), np.nan)
        for number, line in enumerate(lines):
            is_last = ended and not has_end and number == len(lines) - 1
            try:
                rows[number] = self._row(line, delimiter, columns, number, is_last)
            except CutRow:
                self.is_cut = True
                return rows[:number]
        before = lines[-2] if len(lines) > 1 else self._line_before
        if ended and not has_end:
            if _ends_early(before, lines[-1], delimiter):
                self.is_cut = True
                return rows[:-1]
            self.doubt = _end_doubt(before, lines[-1], delimiter)
        return rows

    def _row(self, line: bytes, delimiter: bytes, columns: int, number: int,
             is_last: bool) -> np.ndarray:
        cells = [cell.strip().strip(b'"') for cell in (
            line.split(delimiter) if delimiter != b' ' else line.split())]
        if is_last and len(cells) < columns:
            raise CutRow
        at = self.line + 1 + number
        if len(cells) > columns and any(cells[columns:]):
            raise self.fault(f'{len(cells)} cells; expected {columns}, as the header names', at)
        row = np.full(columns, np.nan)
        for column, cell in enumerate(cells[:columns]):
            if not cell:
                continue
            try:
                # Python reads 1_000 as a number.
                row[column] = float(cell) if b'_' not in cell else float('x')
            except ValueError:
                if is_last and column == len(cells) - 1:
                    raise CutRow from None
                shown = cell[:CELL_SHOWN].decode('latin-1')
                raise self.fault(f'column {column + 1}: {shown!r}; expected a number', at
                                 ) from None
        return row


def _cells(line: bytes, delimiter: bytes) -> list[bytes]:
    return line.split() if delimiter == b' ' else [
        cell.strip() for cell in line.strip().split(delimiter)]


def _decimals(cells: list[bytes]) -> list[int]:
    """Return of each number that has some how many decimals it has."""
    return [len(cell.partition(b'.')[2]) for cell in cells
            if b'.' in cell and b'e' not in cell.lower()]


def _ends_early(before: bytes, last: bytes, delimiter: bytes) -> bool:
    """Return whether a line ends in a number of fewer decimals than any of the line before.

    Also where it ends in an empty cell that the line before has not.
    """
    if last.endswith(delimiter):
        # White space ends a number, and there are no empty cells between it.
        return delimiter != b' ' and not before.rstrip(b'\n').endswith(delimiter)
    usual, cell = _decimals(_cells(before, delimiter)), _cells(last, delimiter)[-1]
    return (bool(usual and cell) and b'e' not in cell.lower()
            and len(cell.partition(b'.')[2]) < min(usual))


def _end_doubt(before: bytes, last: bytes, delimiter: bytes) -> str:
    """Return a note on a line that ends in a number of fewer decimals than most before.

    Where programs leave out zeros, that number may be cut, or be as it was.
    """
    cells = _cells(last, delimiter)
    # A zero has none to leave out.
    usual = sorted(_decimals([cell for cell in _cells(before, delimiter) if cell.strip(b'-0.')]))
    if last[-1:].isspace() or not usual or not cells[-1]:
        return ''
    found = len(cells[-1].partition(b'.')[2])
    if found >= usual[len(usual) // 4]:
        return ''
    return (f'the last line has no end: its last number {cells[-1].decode("latin-1")!r} may be '
            'cut, as most have more decimals')


def _until_blank_line(text: bytes) -> tuple[bytes, bool]:
    """Return the text in front of the first blank line, and whether there is one."""
    if text.startswith(b'\n'):
        return b'', True
    at = text.find(b'\n\n')
    return (text, False) if at < 0 else (text[:at + 1], True)


def _parse_regular(text: bytes, delimiter: bytes, columns: int) -> np.ndarray | None:
    """Return the numbers of rows that all have as many cells; None where one does not."""
    lines = text.count(b'\n') + (not text.endswith(b'\n'))
    if delimiter != b' ':
        octets = np.frombuffer(text, np.uint8)
        ends = np.flatnonzero(octets == ord('\n'))
        if not text.endswith(b'\n'):
            ends = np.append(ends, len(octets))
        cells = np.flatnonzero(octets == ord(delimiter))
        counts = np.diff(np.searchsorted(cells, ends), prepend=0)
        if not len(counts) or (counts != counts[0]).any() or not (
                columns - 1 <= counts[0] <= columns):
            return None
        width = int(counts[0]) + 1
        double, filled = 2 * delimiter, delimiter + b'nan' + delimiter
        if double in text:
            text = text.replace(double, filled).replace(double, filled)
        text = text.replace(delimiter + b'\n', delimiter + b'nan\n')
        if text.endswith(delimiter):
            text += b'nan'
        # One separator for fromstring, which takes white space for none.
        text = text.replace(b'\n', delimiter) if delimiter != b'\t' else text
    else:
        width = columns
    text = text.strip()
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        try:
            numbers = np.fromstring(text.rstrip(delimiter), sep=delimiter.decode())
        except (ValueError, DeprecationWarning):
            return None
    if len(numbers) != lines * width:
        return None
    return numbers.reshape(lines, width)[:, :columns]


class TablePoints(NamedTuple):
    """Points of a table.

    Attributes
    ----------
    labels : tuple of str
    points : ndarray, shape (T, N, 3)
        As in the file.
    times : ndarray, shape (T,), or None
        None where there is no column of increasing times [s].
    numbers : ndarray, shape (T,), or None
        Of the frames; None where they are one after another from 0 or 1 on, or no count of them.
    note : str
        Where the file is cut, or leaves frames out; else empty.
    """

    labels: tuple[str, ...]
    points: np.ndarray
    times: np.ndarray | None
    numbers: np.ndarray | None
    note: str


def read_points(table: TextTable, delimiter: str, columns: int, coordinates: np.ndarray,
                buffer: PointBuffer, time_column: int | None, expected: int | None,
                partial: bool, frame_column: int | None = 0) -> TablePoints:
    """Read points from the columns of a table.

    Parameters
    ----------
    table : TextTable
    delimiter, columns
        See `TextTable.numbers`.
    coordinates : ndarray of int, shape (N, 3)
        Columns of x, y and z of each point.
    buffer : PointBuffer
        Of the N points.
    time_column : int or None
    expected : int or None
        Number of frames, where the file says.
    partial : bool
        Whether a file that is cut is read as far as it goes, with a note.
    frame_column : int or None, optional
        Column of the frames' numbers, which distinguish frames that the file leaves out from a cut.

    Returns
    -------
    TablePoints

    Raises
    ------
    RecordingError
    """
    times: list[np.ndarray] = []
    numbers: list[np.ndarray] = []
    for rows in table.numbers(delimiter, columns):
        buffer.append(rows.numbers[:, coordinates])
        if frame_column is not None:
            numbers.append(rows.numbers[:, frame_column].copy())
        if time_column is not None:
            times.append(rows.numbers[:, time_column].copy())
    frames = buffer.frames
    counted = np.concatenate(numbers) if numbers else np.full(1, np.nan)
    counted[np.abs(counted) > LATEST_FRAME] = np.nan  # a damaged cell counts nothing
    first, last = counted[0], counted[-1]
    note = ''
    left_out = last - first + 1. - frames if frames else 0.
    if left_out > 0.:
        note = f'frames that the file leaves out: {left_out:.0f}'
    if table.is_cut or expected is not None and frames < expected and not (
            last - first + 1. >= expected or last == expected):
        note = f'cut: {frames} whole frames' + (f' of {expected}' if expected else '')
        if not partial or not frames:
            raise table.fault(f'{note}; expected a whole file'
                              + (' (--partial reads what is there)' if frames else ''))
    if not frames:
        raise table.fault('no frames; expected rows of numbers')
    note = note or table.doubt
    labels, points = buffer.finish()
    seconds = np.concatenate(times) if times else np.empty(0)
    skip = ((left_out > 0. or first > 1.) and _is_increasing(counted)
            and np.median(np.diff(counted)) == 1.)
    return TablePoints(labels, points, seconds if _is_increasing(seconds) else None,
                       counted if skip else None, note)


def _is_increasing(values: np.ndarray) -> bool:
    """Return whether values increase: damaged ones may be any, such as no clock shows."""
    return bool(len(values) > 1 and np.abs(values).max() < LATEST_TIME
                and (np.diff(values) > 0.).all())


def write_point_rows(path: Path, header: str, recording: PointRecording, matrix: np.ndarray,
                     decimals: int, delimiter: str, lead: str, missing: str = '',
                     first: int = 1) -> None:
    """Write points as rows of text.

    Parameters
    ----------
    path : Path
    header : str
        Written first.
    recording : PointRecording
    matrix : ndarray, shape (3, 3)
        From metres, z up, to the file's unit and axes.
    decimals : int
    delimiter : str
    lead : str
        Format of the first cells, of `frame` (from 0), `number` (from `first`) and `time` [s].
    missing : str, optional
        Cell of a coordinate of a missing point.
    first : int, optional
        Number of the first frame.
    """
    count = recording.points.shape[1]
    line = delimiter.join([f'%.{decimals}f'] * (3 * count))
    times = iter(recording.times().tolist())
    frame = 0
    with open(path, 'w', newline='', encoding='utf-8') as file:
        file.write(header)
        for rows in recording.blocks():
            for values in (rows.astype(float) @ matrix.T).reshape(len(rows), -1).tolist():
                text = line % tuple(values)
                if 'nan' in text:
                    text = text.replace('nan', missing)
                start = lead.format(frame=frame, number=frame + first, time=next(times))
                file.write(f'{start}{delimiter}{text}\n')
                frame += 1


def known_rate(rate: float, times: np.ndarray | None) -> float:
    """Return a file's frame rate: as given, else by its times, else NaN [Hz].

    Parameters
    ----------
    rate : float
        NaN, or a number that is no camera's, where there is none [Hz].
    times : ndarray, shape (T,), or None
        [s]
    """
    if 0. < rate <= HIGHEST_RATE:
        return rate
    step = float(np.median(np.diff(times))) if times is not None else np.nan
    if times is None or not step * HIGHEST_RATE >= 1.:
        return np.nan
    return nominal_rate(times) or 1. / step


def frame_times(rate: float, times: np.ndarray | None, numbers: np.ndarray | None = None
                ) -> tuple[float, np.ndarray | None]:
    """Return frame rate and times; evenly spaced times are freed of the file's rounding.

    Parameters
    ----------
    rate : float
        Of the file's header, NaN where it has none [Hz].
    times : ndarray, shape (T,), or None
        As in the file [s].
    numbers : ndarray, shape (T,), optional
        Of the frames, where some are left out, at the start or later: without times they tell when.

    Returns
    -------
    rate : float
        As of `known_rate`.
    times : ndarray, shape (T,), or None
        Multiples of the period if all are within the rounding of one; frames may be left out.
    """
    known = known_rate(rate, times)
    if times is None:
        return known, None if numbers is None or np.isnan(known) else (
            numbers - min(numbers[0], 1.)) / known
    periods = np.round(np.diff(times) * known)
    if not periods.all():
        return known, times
    steps = np.concatenate(([0.], np.cumsum(periods)))
    if known != rate:
        known = nominal_rate(times) or float(steps[-1] / (times[-1] - times[0]))
    even = times[0] + steps / known
    return known, even if np.abs(even - times).max() <= TIME_ROUNDING else times


def number_of(text: str) -> float:
    """Return the number of a header's cell, NaN for anything else; decimal commas count."""
    try:
        return float(text.strip().replace(',', '.'))
    except ValueError:
        return np.nan


def count_of(text: str) -> int | None:
    """Return the count of a header's cell, None for anything else."""
    number = number_of(text)
    return int(number) if np.isfinite(number) and 0. < number < 2.**31 else None


def written_labels(labels: Iterable[str], delimiter: str) -> list[str]:
    """Return labels for a file, numbered where there is none, without delimiter and quotes."""
    return [''.join(c for c in label if c != delimiter and c not in '"\r\n\t')
            or f'Unlabeled {i + 1}' for i, label in enumerate(labels)]
