"""Finds values in `.usdc` files that declare more items than their bytes can hold, or of very many that are compressed.

usd-core makes room for the items before it reads them: a file of 2 kB would take gigabytes. These values are left out of a copy.
Layout of values: pxr/usd/sdf/crateFile.cpp of OpenUSD, `ValueRep` and `_Reader`.
"""

from __future__ import annotations

import mmap
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from .....lang.diagnostics import Diagnostics, Span
from ....io.regular_files import ANY_SIZE, open_regular
from . import crate_check

MOST = 16_000_000  # items in compressed arrays of a file, together
PER_BYTE = 4  # further such items for each byte of the file
MOST_NAMED = 20  # values of a file that are named
_DENSEST = 1020  # items of a compressed array in a byte: 4 in a byte of codes, 255 bytes in a byte of LZ4
_SMALLEST = 16  # items from which arrays are compressed
_DEEP, _MANY = 64, 1_000_000  # levels of nested values; values in one field
_ARRAY, _INLINED, _COMPRESSED, _EDIT = (1 << bit for bit in (63, 62, 61, 60))
_BLOCK = 51 << 48 | _INLINED  # the value that says there is none
_PAYLOAD = (1 << 48) - 1
_BYTES = {  # of an item, by type
    1: 1, 2: 1, 3: 4, 4: 4, 5: 8, 6: 8, 7: 2, 8: 4, 9: 8, 10: 4, 11: 4, 12: 4, 13: 32, 14: 72, 15: 128, 16: 32, 17: 16, 18: 8, 19: 16,
    20: 8, 21: 4, 22: 8, 23: 24, 24: 12, 25: 6, 26: 12, 27: 32, 28: 16, 29: 8, 30: 16, 40: 4, 41: 4, 48: 8, 49: 16, 50: 4, 56: 8, 57: 4,
    59: 1,
}  # fmt: skip
_LIST_OPS = {32: 4, 33: 4, 34: 4, 35: 24, 36: 4, 37: 8, 38: 4, 39: 8, 54: 8, 55: 8}  # bytes of an item, by type
_VECTORS = {40, 41, 48, 49, 50, 59}
_PAIRS = {45: 8, 58: 8}  # bytes of a pair
_DICTIONARY, _SAMPLES, _VALUES = 31, 46, {52, 53}


class Excess(NamedTuple):
    """A field that is left out: its index, and why."""

    field: int
    why: str


def excessive(data: crate_check.Bytes) -> list[Excess]:
    """The fields of a crate file that declare too many items. Files that are damaged elsewhere have none."""
    try:
        walk = _Walk(data)
        return [Excess(k, why) for k, rep in enumerate(_fields(data)[1].tolist()) if (why := walk.fault(rep))]
    except (struct.error, KeyError, IndexError, ValueError, OverflowError):
        return []


def read(path: Path, diagnostics: Diagnostics) -> bytes:
    """A copy of a crate file without such values, which are named; b"" without any, and for other files."""
    try:
        with open_regular(path, ANY_SIZE) as file:
            if file.read(len(crate_check.IDENTIFIER)) != crate_check.IDENTIFIER:
                return b""
            with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
                excess = excessive(data)
                if not excess:
                    return b""
                warn(path.name, data, excess, diagnostics)
                return without(data, excess)
    except (OSError, ValueError):
        return b""


def warn(place: str, data: crate_check.Bytes, excess: list[Excess], diagnostics: Diagnostics) -> None:
    """The warnings about the values of a file that are left out."""
    named = excess[:MOST_NAMED]
    for where, each in zip(paths(data, named), named, strict=True):
        diagnostics.warning(f"the value of `{where}` is left out: {each.why}", Span(place))
    if len(excess) > MOST_NAMED:
        diagnostics.warning(f"the values of {len(excess) - MOST_NAMED:,} more are left out", Span(place))


def without(data: crate_check.Bytes, excess: list[Excess]) -> bytes:
    """A copy of a file with blocks in place of the values of some fields; its section of fields and table of contents are at the end."""
    names, reps = _fields(data)
    reps[[each.field for each in excess]] = _BLOCK
    packed = _literals(reps.tobytes())
    section = names + struct.pack("<Q", len(packed)) + packed
    table = crate_check.table_of_contents(data) or []
    toc = [(name, len(data), len(section)) if name.startswith(b"FIELDS\0") else (name, start, size) for name, start, size in table]
    output = bytearray(data[:]) + section
    struct.pack_into("<Q", output, 16, len(output))
    return bytes(output) + struct.pack("<Q", len(toc)) + b"".join(struct.pack("<16sQQ", *row) for row in toc)


def paths(data: crate_check.Bytes, excess: list[Excess]) -> list[str]:
    """The path of the first spec that has each field, with the field's name where it is not a value; "" where it is not known."""
    try:
        tokens, sections = _tokens(data), crate_check.sections(data)
        sets = crate_check.column(sections["FIELDSETS"], 0, 0)
        specs = [crate_check.column(sections["SPECS"], 0, k) for k in (0, 1)]
        names = crate_check.column(sections["FIELDS"], 0, 0)
        spec_paths = dict(_paths(sections["PATHS"], tokens))
        starts = {int(first): int(path) for path, first in zip(*specs, strict=True)}
    except (struct.error, KeyError, IndexError, ValueError, OverflowError):
        return ["" for _ in excess]
    labels = []
    for field, _ in excess:
        index = next(iter(np.flatnonzero(sets == field)), 0)
        while index > 0 and sets[index - 1] >= 0:
            index -= 1
        name = tokens[names[field]] if 0 <= names[field] < len(tokens) else ""
        path = spec_paths.get(starts.get(int(index), -1), "")
        labels.append(path if name in ("default", "timeSamples") else f"{path} {name}")
    return labels


class _Walk:
    """Counts the items of values."""

    def __init__(self, data: crate_check.Bytes) -> None:
        self._data, self._version = data, tuple(data[8:11])
        self._left = MOST + PER_BYTE * len(data)
        self._seen: set[int] = set()  # compressed arrays
        self._values = 0

    def fault(self, rep: int) -> str:
        """Why the value of a field is left out; "" for a sound one."""
        self._values = 0
        return self._of(rep, 0)

    def _of(self, rep: int, depth: int) -> str:
        kind, place = rep >> 48 & 255, rep & _PAYLOAD
        self._values += 1
        if depth > _DEEP or self._values > _MANY:
            return f"it holds values in values, over {_DEEP} deep or more than {_MANY:,}"
        if rep & _INLINED or not place or place >= len(self._data):
            return ""
        if rep & _ARRAY:
            return self._of_array(rep, kind, place)
        if rep & _EDIT:
            return next(filter(None, (self._of(self._number(place + 8 * k), depth + 1) for k in (0, 1))), "")
        if kind in _LIST_OPS:
            return self._of_list_op(place, _LIST_OPS[kind])
        if kind in _VECTORS or kind in _PAIRS:
            return self._fits(self._number(place), _PAIRS.get(kind) or _BYTES[kind], place + 8)
        if kind == _SAMPLES:
            return self._of_samples(place, depth)
        if kind == _DICTIONARY:
            return self._of_dictionary(place, depth)
        return self._of(self._number(place + self._number(place)), depth + 1) if kind in _VALUES else ""

    def _number(self, place: int) -> int:
        return struct.unpack_from("<Q", self._data, place)[0]

    def _fits(self, count: int, size: int, place: int) -> str:
        room = len(self._data) - place
        return f"it declares {count:,} items, and the file has {room:,} bytes for them" if count * size > room else ""

    def _of_array(self, rep: int, kind: int, place: int) -> str:
        first = place
        if self._version < (0, 5, 0):
            place += 4
        short = self._version < (0, 7, 0)
        count = struct.unpack_from("<I", self._data, place)[0] if short else self._number(place)
        place += 4 if short else 8
        if not rep & _COMPRESSED or count < _SMALLEST or kind not in range(3, 10):
            return self._fits(count, _BYTES.get(kind, 1), place)
        if count > _DENSEST * (len(self._data) - place):
            return f"it declares {count:,} items, and the file has {len(self._data) - place:,} bytes for them"
        if count > self._left:
            most = f"{MOST:,} in a file, and {PER_BYTE} for each of its bytes"
            return f"it declares {count:,} items, and compressed ones are at most {most}: a .usda file has no such limit"
        if first not in self._seen:
            self._seen.add(first)
            self._left -= count
        return ""

    def _of_list_op(self, place: int, size: int) -> str:
        head, place = self._data[place], place + 1
        for _ in range((head >> 1 & 63).bit_count()):
            count = self._number(place)
            if why := self._fits(count, size, place + 8):
                return why
            if size not in (4, 8):
                break  # items of several sizes
            place += 8 + size * count
        return ""

    def _of_samples(self, place: int, depth: int) -> str:
        place += self._number(place)
        times, place = self._number(place), place + 8
        place += self._number(place)
        count = self._number(place)
        if why := self._of(times, depth + 1) or self._fits(count, 8, place + 8):
            return why
        reps = np.frombuffer(self._data[place + 8 : place + 8 + 8 * count], "<u8")
        for rep in np.unique(reps[reps & np.uint64(_INLINED) == 0]).tolist():
            self._values -= 1  # samples are read one at a time
            if why := self._of(rep, depth + 1):
                return why
        return ""

    def _of_dictionary(self, place: int, depth: int) -> str:
        count, place = self._number(place), place + 8
        if why := self._fits(count, 12, place):
            return why
        for _ in range(count):
            place += 4 + self._number(place + 4)
            if why := self._of(self._number(place), depth + 1):
                return why
            place += 8
        return ""


# --- sections --------------------------------------------------------------------------------------------------------------------------


def _fields(data: crate_check.Bytes) -> tuple[bytes, np.ndarray]:
    """(the section up to the values, their 64-bit numbers); no values in versions without compressed sections."""
    if tuple(data[8:11]) < crate_check.COMPRESSED:
        return b"", np.zeros(0, np.uint64)
    section = crate_check.sections(data)["FIELDS"]
    count, size = struct.unpack_from("<QQ", section)
    raw = crate_check.decompressed(section[24 + size : 24 + size + struct.unpack_from("<Q", section, 16 + size)[0]])
    return section[: 16 + size], np.frombuffer(raw[: 8 * count], "<u8").copy()


def _tokens(data: crate_check.Bytes) -> list[str]:
    section = crate_check.sections(data)["TOKENS"]
    (size,) = struct.unpack_from("<Q", section, 16)
    return [name.decode("utf-8", "replace") for name in crate_check.decompressed(section[24 : 24 + size]).split(b"\0")]


def _paths(section: bytes, tokens: list[str]) -> Iterator[tuple[int, str]]:
    """(index, path) of the paths of a file; jumps are as crate_check explains them."""
    rows, elements, jumps = (crate_check.column(section, 8, k).tolist() for k in range(3))
    parents: dict[int, str] = {0: ""}
    for k, (row, element, jump) in enumerate(zip(rows, elements, jumps, strict=True)):
        above = parents.get(k, "")
        path = "/" if k == 0 else f"{above}.{tokens[-element]}" if element < 0 else f"{above.rstrip('/')}/{tokens[element]}"
        if jump >= 0:
            parents[k + (jump or 1)] = above
        if jump > 0 or jump == -1:
            parents[k + 1] = path
        yield row, path


def _literals(data: bytes) -> bytes:
    """An LZ4 block of literals alone, as one chunk."""
    if len(data) < 15:
        return bytes((0, len(data) << 4)) + data
    more = len(data) - 15
    return b"\0\xf0" + b"\xff" * (more // 255) + bytes((more % 255,)) + data
