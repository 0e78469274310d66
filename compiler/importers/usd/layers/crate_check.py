"""Checks `.usdc` files before usd-core opens them: counts that exceed the file, paths that are not a tree, and specs without a type.

Such a file would make usd-core take gigabytes or minutes, or end the process.

The crate format: pxr/usd/sdf/crateFile.h of OpenUSD. LZ4 blocks: github.com/lz4/lz4, doc/lz4_Block_format.md.
"""

from __future__ import annotations

import mmap
import struct
import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ....io.regular_files import ANY_SIZE, open_regular

Bytes = bytes | mmap.mmap
IDENTIFIER = b"PXR-USDC"
COMPRESSED = (0, 4, 0)  # the version from which sections are compressed
_SECTIONS = ("TOKENS", "STRINGS", "FIELDS", "FIELDSETS", "PATHS", "SPECS")
_LZ4 = 255  # bytes that a byte of an LZ4 block can stand for
MAX_LEVELS = 1000  # of prims in prims; usd-core is recursive in some places
_PACKED = 4  # integers in a byte at most


def fault(path: Path) -> str:
    """Why a crate file, or the first layer of a `.usdz` package, cannot be read; "" for a sound file and for other files."""
    try:
        if path.suffix.lower() == ".usdz":
            first, data = next(layers_of(path), ("", b""))
            return f"`{first}`: {why}" if (why := fault_of(data)) else ""
        with open_regular(path, ANY_SIZE) as file:
            if file.read(len(IDENTIFIER)) != IDENTIFIER:
                return ""
            with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
                return fault_of(data)
    except (OSError, ValueError, NotImplementedError, RuntimeError, zipfile.BadZipFile):
        return ""  # usd-core reports it


def layers_of(package: Path) -> Iterator[tuple[str, bytes]]:
    """(name, bytes) of the layers in a `.usdz` package, b"" of compressed ones, which usd-core refuses. Raises as zipfile does."""
    with open_regular(package, ANY_SIZE) as opened, zipfile.ZipFile(opened) as files:
        for info in files.infolist():
            if info.filename.lower().endswith((".usd", ".usda", ".usdc")):
                yield info.filename, files.read(info) if info.compress_type == zipfile.ZIP_STORED else b""


def fault_of(data: Bytes) -> str:
    """Why the bytes of a crate file cannot be read; "" for a sound file and for other files."""
    if data[: len(IDENTIFIER)] != IDENTIFIER:
        return ""
    try:
        contents = table_of_contents(data)
        if contents is None:
            return "its table of contents is longer than the file"
        for name, start, size in contents:
            if start + size > len(data):
                return f"its section {_text(name)} ends beyond the file"
        by_name = sections(data)
        for name, section in by_name.items():
            if name not in _SECTIONS:
                continue
            (items,) = struct.unpack_from("<Q", section)
            most = len(section) // 4 if name == "STRINGS" else len(section) * _LZ4 * (1 if name == "TOKENS" else _PACKED)
            if items > most:
                return f"its section {name} has fewer than the {items:,} items that it declares"
        if tuple(data[8:11]) < COMPRESSED:
            return ""
        jumps = column(by_name["PATHS"], 8, 2)
        if not _is_tree(jumps):
            return "its paths are not a tree"
        if _nests_too_deep(jumps):
            return f"its paths have more than {MAX_LEVELS:,} levels"
        return "" if (column(by_name["SPECS"], 0, 2) >= 0).all() else "the types of its specs are damaged"
    except IndexError:
        return "its paths or specs are damaged"
    except (struct.error, KeyError, OverflowError):
        return ""  # usd-core reports it


def table_of_contents(data: Bytes) -> list[tuple[bytes, int, int]] | None:
    """(name of 16 bytes, start, size) of each section; None where they exceed the file."""
    (start,) = struct.unpack_from("<Q", data, 16)
    (count,) = struct.unpack_from("<Q", data, start)
    if count > len(data) // 32:
        return None
    return [struct.unpack_from("<16sQQ", data, start + 8 + 32 * k) for k in range(count)]


def sections(data: Bytes) -> dict[str, bytes]:
    """The sections of a file by name; the first of equal names."""
    return {_text(name): data[start : start + size] for name, start, size in (table_of_contents(data) or [])[::-1]}


def _text(name: bytes) -> str:
    return name.partition(b"\0")[0].decode("ascii", "replace")


def column(section: bytes, offset: int, before: int) -> np.ndarray:
    """Integers (n,) of a section, after some other lists of as many. `offset` is the place of their number."""
    (count,) = struct.unpack_from("<Q", section, offset)
    offset += 8
    for _ in range(before):
        offset += 8 + struct.unpack_from("<Q", section, offset)[0]
    (size,) = struct.unpack_from("<Q", section, offset)
    return _integers(decompressed(section[offset + 8 : offset + 8 + size]), count)


def _is_tree(jumps: np.ndarray) -> bool:
    """Whether no path has two parents, for which usd-core takes exponential time.

    A jump is -2 without a child or sibling, -1 with a child, 0 with a sibling; with both it is the distance to the sibling. What comes
    first is the next path.
    """
    rows = np.arange(len(jumps))
    reached = np.concatenate([rows[jumps >= -1] + 1, (rows + jumps)[jumps > 0]])
    return bool((np.bincount(reached[reached < len(jumps)], minlength=1) <= 1).all())


def _nests_too_deep(jumps: np.ndarray) -> bool:
    """Whether a path of a tree has more than MAX_LEVELS above it."""
    if np.count_nonzero((jumps == -1) | (jumps > 0)) <= MAX_LEVELS:
        return False
    siblings: dict[int, int] = {}  # the level of paths that are reached by a jump
    level = 0
    for row, jump in enumerate(jumps.tolist()):
        level = siblings.pop(row, level)
        if level > MAX_LEVELS:
            return True
        if jump > 0:
            siblings[row + jump] = level
        level += jump > 0 or jump == -1
    return False


def decompressed(block: bytes) -> bytes:
    """The bytes of a compressed block. Blocks of several chunks, from 2 GB on, give the first."""
    output, position = bytearray(), 1 if block[0] == 0 else 5
    while position < len(block):
        kinds, position = block[position], position + 1
        length, position = _length(block, position, kinds >> 4)
        output += block[position : position + length]
        position += length
        if position >= len(block):
            break
        back = block[position] | block[position + 1] << 8
        length, position = _length(block, position + 2, kinds & 15)
        length += 4
        piece = bytes(output[len(output) - back : len(output) - back + length])
        output += (piece * (length // len(piece) + 1))[:length] if piece else bytes(length)
    return bytes(output)


def _length(block: bytes, position: int, length: int) -> tuple[int, int]:
    if length == 15:
        while True:
            length, position = length + block[position], position + 1
            if block[position - 1] != 255:
                break
    return length, position


def _integers(raw: bytes, count: int) -> np.ndarray:
    """Integers (n,) from their differences: a common one, or one of 1, 2 or 4 bytes, as two bits for each say. Raises IndexError."""
    stored = np.frombuffer(raw, np.uint8)
    if len(stored) < 4 + (2 * count + 7) // 8:
        raise IndexError("the codes end early")
    codes = stored[4 : 4 + (2 * count + 7) // 8]
    which = (codes[:, None] >> np.array([0, 2, 4, 6], np.uint8) & 3).reshape(-1)[:count]
    sizes = np.array([0, 1, 2, 4])[which]
    starts = 4 + len(codes) + np.cumsum(sizes) - sizes
    if 4 + len(codes) + sizes.sum() > len(stored):
        raise IndexError("the differences end early")
    steps = np.full(count, np.frombuffer(raw, "<i4", 1)[0], np.int32)
    for code, kind in ((1, np.dtype("<i1")), (2, np.dtype("<i2")), (3, np.dtype("<i4"))):
        rows = np.flatnonzero(which == code)
        steps[rows] = stored[starts[rows][:, None] + np.arange(kind.itemsize)].reshape(-1).view(kind)
    return np.cumsum(steps, dtype=np.int32)
