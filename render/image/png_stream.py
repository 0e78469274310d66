"""A writer of PNG files that filters and compresses rows on several threads. OpenImageIO writes the other chunks.

Blocks of rows are compressed one by one into a single stream, each with the 32 kB before it as its dictionary (Adler, pigz).
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

LEVEL = 4  # of zlib: with the Sub filter a quarter of the default time, for about the same size
BLOCK = 1 << 18  # bytes of rows that are compressed together
TOGETHER = 256  # blocks in memory
WINDOW = 1 << 15  # bytes that a block may refer to
SUB = 1  # PNG's filter of differences from the pixel to the left
BASE = 65521  # of Adler-32
SIGNATURE = b"\x89PNG\r\n\x1a\n"
HEADER = b"\x78\x5e"  # of a zlib stream

Run = Callable[[Callable[[Any], Any], Sequence[Any]], Iterable[Any]]


class PngStream:
    """A PNG file that is written strip by strip from the top. Raises OSError where it cannot be written."""

    def __init__(self, path: Path, template: bytes, height: int, threads: int) -> None:
        """`template` is a PNG of one row, as wide as the picture, with its metadata; the file has `height` rows."""
        chunks = list(_chunks(template))
        data = [k for k, (kind, _) in enumerate(chunks) if kind == b"IDAT"]
        width = chunks[0][1][:4]
        self._before = [(b"IHDR", width + struct.pack(">I", height) + chunks[0][1][8:]), *chunks[1 : data[0]]]
        self._after = chunks[data[-1] + 1 :]
        self._threads, self._sum, self._tail = threads, 1, b""
        self._file = path.open("wb")
        self._file.write(SIGNATURE)
        for kind, content in self._before:
            self._put(kind, content)
        self._header = HEADER

    def add(self, codes: NDArray[Any]) -> None:
        """Write the next rows, (h, w, channels) of uint8 or uint16."""
        rows = max(1, BLOCK // max(1, codes[:1].nbytes))
        blocks = [codes[top : top + rows] for top in range(0, len(codes), rows)]
        if self._threads <= 1 or len(blocks) <= 1:
            self._add(blocks, map)
            return
        with ThreadPoolExecutor(min(self._threads, len(blocks))) as pool:
            for first in range(0, len(blocks), TOGETHER):
                self._add(blocks[first : first + TOGETHER], pool.map)

    def _add(self, blocks: list[NDArray[Any]], run: Run) -> None:
        filtered = list(run(filter_rows, blocks))
        before: list[Any] = [self._tail, *(block[-WINDOW:] for block in filtered)]
        parts, sums = run(_compress, list(zip(filtered, before, strict=False))), run(zlib.adler32, filtered)
        for block, part, total in zip(filtered, parts, sums, strict=True):
            self._put(b"IDAT", self._header + part)
            self._header, self._sum = b"", combine(self._sum, total, len(block))
        self._tail = bytes(before[-1])

    def close(self) -> None:
        """End the file."""
        end = zlib.compressobj(LEVEL, zlib.DEFLATED, -zlib.MAX_WBITS).flush()
        self._put(b"IDAT", self._header + end + struct.pack(">I", self._sum))
        for kind, content in self._after:
            self._put(kind, content)
        self._file.close()

    def abandon(self) -> None:
        """Close an unfinished file, which may fail to write what is buffered."""
        with suppress(OSError):
            self._file.close()

    def _put(self, kind: bytes, content: bytes) -> None:
        self._file.write(struct.pack(">I", len(content)) + kind)
        self._file.write(content)
        self._file.write(struct.pack(">I", zlib.crc32(content, zlib.crc32(kind))))


def filter_rows(codes: NDArray[Any]) -> memoryview:
    """The bytes of rows (h, w, channels), each behind its filter: differences of each pixel from that to its left."""
    height, width, channels = codes.shape
    size = channels * codes.itemsize
    raw = np.ascontiguousarray(codes, codes.dtype.newbyteorder(">")).view(np.uint8).reshape(height, width * size)
    out = np.empty((height, 1 + width * size), np.uint8)
    out[:, 0], out[:, 1 : 1 + size] = SUB, raw[:, :size]
    np.subtract(raw[:, size:], raw[:, :-size], out=out[:, 1 + size :])
    return out.reshape(-1).data


def combine(first: int, second: int, length: int) -> int:
    """The Adler-32 sum of two sequences, one behind the other, from those of each; the second has `length` bytes."""
    a, b = first & 0xFFFF, first >> 16
    c, d = second & 0xFFFF, second >> 16
    return (a + c - 1) % BASE | (b + d + length * (a - 1)) % BASE << 16


def _compress(blocks: tuple[memoryview, memoryview | bytes]) -> bytes:
    block, before = blocks
    compressor = zlib.compressobj(LEVEL, zlib.DEFLATED, -zlib.MAX_WBITS, zlib.DEF_MEM_LEVEL, zlib.Z_DEFAULT_STRATEGY, before)
    return compressor.compress(block) + compressor.flush(zlib.Z_SYNC_FLUSH)


def _chunks(png: bytes) -> Iterator[tuple[bytes, bytes]]:
    """(kind, content) of the chunks of a PNG."""
    offset = len(SIGNATURE)
    while offset < len(png):
        size = struct.unpack_from(">I", png, offset)[0]
        yield png[offset + 4 : offset + 8], png[offset + 8 : offset + 8 + size]
        offset += 12 + size
