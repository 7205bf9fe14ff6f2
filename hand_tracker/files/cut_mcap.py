"""Recover truncated or unclosed MCAP files: their complete records, with an end appended.

The format is that of mcap.dev/spec: records of a code and a length, of which some are chunks of
records.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path
from struct import Struct
from typing import BinaryIO

from rosbags.rosbag2 import storage_mcap

MCAP_MAGIC = b'\x89MCAP0\r\n'
RECORD_HEAD = Struct('<BQ')       # code and length
CHUNK_HEAD = Struct('<QQQII')     # first and last time, length, checksum; length of a name
FOOTER, CHUNK = 2, 6              # codes
# A footer without a summary.
MCAP_END = RECORD_HEAD.pack(FOOTER, 20) + bytes(20) + MCAP_MAGIC
MAX_CHUNK_BYTES = 2**28           # when unpacked; usual are 1 to 4 MB
MAX_CUT_BYTES = 2**25             # read of a truncated chunk, at most
# Decompression of a truncated chunk; one compressed by lz4 is left out.
PARTIAL_UNPACKING: dict[bytes, Callable[[bytes, int], bytes]] = {
    b'': lambda data, size: data[:size],
    b'zstd': lambda data, size: storage_mcap.zstd.ZstdDecompressor().decompress(data, size)}


def is_cut(path: Path) -> bool:
    """Return whether an MCAP file is truncated: its end magic is missing."""
    with open(path, 'rb') as file:
        head = file.read(len(MCAP_MAGIC))
        file.seek(-min(path.stat().st_size, len(MCAP_MAGIC)), io.SEEK_END)
        return head == MCAP_MAGIC and file.read() != MCAP_MAGIC


class WholeRecords:
    """Complete records of a truncated MCAP file, as a path-like object that rosbags can open.

    Parameters
    ----------
    path : Path
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        with open(path, 'rb') as file:
            self._size = _whole_size(file, len(MCAP_MAGIC), path.stat().st_size)
            file.seek(self._size)
            self._end = _whole_chunk(file.read(MAX_CUT_BYTES)) + MCAP_END

    def open(self, mode: str) -> BinaryIO:
        """Open the complete records, with an end appended, for reading."""
        del mode
        raw: io.RawIOBase = _EndedFile(self._path, self._size, self._end)
        return io.BufferedReader(raw)

    def __str__(self) -> str:
        return str(self._path)


class _EndedFile(io.RawIOBase):
    """The first bytes of a file with other bytes appended, as a raw stream."""

    def __init__(self, path: Path, size: int, end: bytes) -> None:
        self._file = open(path, 'rb', buffering=0)
        self._size, self._end, self._at = size, end, 0

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        start = {io.SEEK_SET: 0, io.SEEK_CUR: self._at,
                 io.SEEK_END: self._size + len(self._end)}[whence]
        self._at = max(start + offset, 0)
        return self._at

    def readinto(self, buffer: bytearray) -> int:  # type: ignore[override]
        if self._at < self._size:
            self._file.seek(self._at)
            count = self._file.readinto(memoryview(buffer)[:self._size - self._at]) or 0
        else:
            behind = self._end[self._at - self._size:][:len(buffer)]
            count = len(behind)
            buffer[:count] = behind
        self._at += count
        return count

    def close(self) -> None:
        self._file.close()
        super().close()


def _whole_size(file: BinaryIO, at: int, size: int) -> int:
    """Return the end offset of the last complete record, from `at` on and before the footer."""
    while True:
        file.seek(at)
        head = file.read(RECORD_HEAD.size)
        if len(head) < RECORD_HEAD.size:
            return at
        code, length = RECORD_HEAD.unpack(head)
        if code == FOOTER or at + len(head) + length > size:
            return at
        at += len(head) + length


def _whole_chunk(cut: bytes) -> bytes:
    """Return the complete records of a truncated chunk as an uncompressed chunk; empty if none."""
    place = RECORD_HEAD.size + CHUNK_HEAD.size
    if len(cut) < place or cut[0] != CHUNK:
        return b''
    first, last, size, _, length = CHUNK_HEAD.unpack_from(cut, RECORD_HEAD.size)
    unpack = PARTIAL_UNPACKING.get(cut[place:place + length])
    if unpack is None:
        return b''
    try:
        records = unpack(cut[place + length + 8:], min(size, MAX_CUT_BYTES))
    # Damaged bytes, or another version of the library, may raise anything: no record is recovered.
    except Exception:
        return b''
    records = records[:_whole_size(io.BytesIO(records), 0, len(records))]
    content = CHUNK_HEAD.pack(first, last, len(records), 0, 0) + len(records).to_bytes(
        8, 'little') + records
    return RECORD_HEAD.pack(CHUNK, len(content)) + content if records else b''
