"""Takes `.usdc` files apart, damages what their compressed sections hold, and puts them together: OpenUSD's crate format, 0.8 to 0.12.

Random bytes in a compressed section nearly always end in a refusal. Changes of its numbers reach what reads them.
"""

from __future__ import annotations

import random
import struct
from dataclasses import dataclass, replace
from typing import Any

from maquette.compiler.importers.usd.layers import crate_check

_TOC = 16  # the place of the offset of the table of contents
_NUMBERS = ("fields", "fieldsets", "paths", "elements", "jumps", "spec_paths", "spec_fields", "spec_types", "strings")
_NAMES = (b"", b"\xff\xfe", b"a/b", b"..", b".x", b"{a=b}", b"[..]", b"x" * 5000)
_ODD = (-1, -2, 0, 1, 1000, 2**31 - 1, -(2**31))


@dataclass(frozen=True, slots=True)
class Crate:
    """The contents of a file. `values` are the bytes before the sections; lists are as the format's documentation names them."""

    values: bytes
    tokens: list[bytes]
    strings: list[int]
    fields: list[int]
    reps: list[int]
    fieldsets: list[int]
    path_count: int
    paths: list[int]
    elements: list[int]
    jumps: list[int]
    spec_paths: list[int]
    spec_fields: list[int]
    spec_types: list[int]


# --- compression: LZ4 blocks (github.com/lz4/lz4/blob/dev/doc/lz4_Block_format.md), and differences of integers in one to four bytes -----


def _compress(data: bytes) -> bytes:
    """A block of literals alone."""
    if len(data) < 15:
        return bytes((0, len(data) << 4)) + data
    more = len(data) - 15
    return b"\0\xf0" + b"\xff" * (more // 255) + bytes((more % 255,)) + data


def _signed(number: int) -> int:
    return ((number + 2**31) & 0xFFFFFFFF) - 2**31


def _integers(raw: bytes, count: int) -> list[int]:
    (common,) = struct.unpack_from("<i", raw)
    at, last, made = 4 + (2 * count + 7) // 8, 0, []
    for k in range(count):
        size = (0, 1, 2, 4)[raw[4 + k // 4] >> 2 * (k % 4) & 3]
        last = _signed(last + (int.from_bytes(raw[at : at + size], "little", signed=True) if size else common))
        made.append(last)
        at += size
    return made


def _packed(numbers: list[int]) -> bytes:
    steps = [_signed(b - a) for a, b in zip([0, *numbers], numbers, strict=False)]
    codes = bytes(sum(3 << 2 * k for k in range(min(4, len(steps) - at))) for at in range(0, len(steps), 4))
    return struct.pack("<i", 2**31 - 1) + codes + struct.pack(f"<{len(steps)}i", *steps)


# --- files ---------------------------------------------------------------------------------------------------------------------------


class _Section:
    """Reads a section from its start."""

    def __init__(self, data: bytes) -> None:
        self._data, self._at = data, 0

    def number(self) -> int:
        self._at += 8
        return struct.unpack_from("<Q", self._data, self._at - 8)[0]

    def bytes(self) -> bytes:
        size = self.number()
        self._at += size
        return crate_check.decompressed(self._data[self._at - size : self._at])

    def integers(self, count: int) -> list[int]:
        return _integers(self.bytes(), count)

    def rest(self, code: str) -> list[int]:
        return [number for (number,) in struct.iter_unpack(code, self._data[self._at :])]


def read(data: bytes) -> Crate:
    """The contents of a whole file."""
    (toc,) = struct.unpack_from("<q", data, _TOC)
    (count,) = struct.unpack_from("<Q", data, toc)
    rows = [struct.unpack_from("<16sqq", data, toc + 8 + 32 * k) for k in range(count)]
    found = {name.rstrip(b"\0").decode(): _Section(data[start : start + size]) for name, start, size in rows}
    tokens, strings, fields, fieldsets, paths, specs = (
        found[name] for name in ("TOKENS", "STRINGS", "FIELDS", "FIELDSETS", "PATHS", "SPECS")
    )  # fmt: skip
    for counted in (tokens, tokens, strings):
        counted.number()
    names = tokens.bytes().split(b"\0")[:-1]
    names_of_fields = fields.integers(count := fields.number())
    reps = [rep for (rep,) in struct.iter_unpack("<Q", fields.bytes())]
    sets = fieldsets.integers(fieldsets.number())
    path_count, count = paths.number(), paths.number()
    of_paths: Any = (path_count, *(paths.integers(count) for _ in range(3)))
    count = specs.number()
    of_specs: Any = tuple(specs.integers(count) for _ in range(3))
    return Crate(data[: min(row[1] for row in rows)], names, strings.rest("<i"), names_of_fields, reps, sets, *of_paths, *of_specs)


def written(crate: Crate) -> bytes:
    """The bytes of a file with these contents."""
    made, rows = bytearray(crate.values), []

    def number(*numbers: int) -> bytes:
        return struct.pack(f"<{len(numbers)}Q", *numbers)

    def block(data: bytes) -> bytes:
        return number(len(packed := _compress(data))) + packed

    def integers(*lists: list[int]) -> bytes:
        return b"".join(block(_packed(numbers)) for numbers in lists)

    def section(name: bytes, data: bytes) -> None:
        rows.append((name, len(made), len(data)))
        made.extend(data)

    names = b"".join(token + b"\0" for token in crate.tokens)
    section(b"TOKENS", number(len(crate.tokens), len(names)) + block(names))
    section(b"STRINGS", number(len(crate.strings)) + struct.pack(f"<{len(crate.strings)}i", *crate.strings))
    section(b"FIELDS", number(len(crate.fields)) + integers(crate.fields) + block(number(*crate.reps)))
    section(b"FIELDSETS", number(len(crate.fieldsets)) + integers(crate.fieldsets))
    section(b"PATHS", number(crate.path_count, len(crate.paths)) + integers(crate.paths, crate.elements, crate.jumps))
    section(b"SPECS", number(len(crate.spec_paths)) + integers(crate.spec_paths, crate.spec_fields, crate.spec_types))
    struct.pack_into("<q", made, _TOC, len(made))
    return bytes(made) + number(len(rows)) + b"".join(struct.pack("<16sqq", *row) for row in rows)


# --- damage --------------------------------------------------------------------------------------------------------------------------


def damaged(data: bytes, rng: random.Random) -> bytes:
    """A file with one to four changes of what its sections hold."""
    crate = read(data)
    for _ in range(rng.choice((1, 1, 2, 4))):
        change = rng.choice(("tokens", "values", "reps", "reps", "path_count", "jumps", *_NUMBERS))
        made: Any
        if change == "path_count":
            made = rng.choice((0, max(crate.path_count + rng.choice((-1, 1)), 0), 10**6, 2**31, 2**40))
        elif change == "values":
            made = bytearray(crate.values)
            made[rng.randrange(88, len(made))] = rng.randrange(256)
            made = bytes(made)
        elif not (made := list(getattr(crate, change))):
            continue
        elif change == "tokens":
            made[rng.randrange(len(made))] = rng.choice((*_NAMES, rng.choice(made)))
        elif change == "reps":
            at = rng.randrange(len(made))
            made[at] = _rep(made[at], made, len(crate.values), rng)
        else:
            _change(made, rng)
        crate = replace(crate, **{change: made})
    return written(crate)


def _rep(rep: int, others: list[int], end: int, rng: random.Random) -> int:
    """Another value: a changed bit, type, place or flag, or that of another field."""
    place = 2**48 - 1
    return rng.choice((
        rep ^ 1 << rng.randrange(64), rep & ~(255 << 48) | rng.randrange(1, 64) << 48, rep & ~place | rng.randrange(end),
        rng.choice(others), rep & (1 << 60) - 1 | rng.randrange(16) << 60, rep & ~place | rng.choice((0, 2**20, 2**31, place)),
        rng.getrandbits(64),
    ))  # fmt: skip


def _change(numbers: list[int], rng: random.Random) -> None:
    at, other, change = rng.randrange(len(numbers)), rng.randrange(len(numbers)), rng.randrange(7)
    if change == 0:
        numbers[at] ^= 1 << rng.randrange(31)
    elif change == 1:
        numbers[at] = numbers[other]
    elif change == 2:
        numbers[at] = _signed(numbers[at] + rng.choice((-1, 1)))
    elif change == 3:
        numbers[at] = rng.choice(_ODD)
    elif change == 4:
        del numbers[at]
    elif change == 5:
        numbers.insert(at, numbers[other])
    else:
        numbers[at], numbers[other] = numbers[other], numbers[at]
