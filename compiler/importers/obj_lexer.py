"""Tokenizes OBJ files by array operations, one keyword at a time; irregular lines are parsed one by one."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from ...lang import text_encoding
from ..ir import F64, I64
from .common import number_text

_SPACE = np.zeros(256, dtype=bool)
_SPACE[[9, 10, 11, 12, 13, 32]] = True
_DIGITS = np.zeros(256, dtype=bool)
_DIGITS[list(b"0123456789+-")] = True
_SLASH = ord("/")
NONE = 0  # an absent index; OBJ counts from 1
BAD = np.iinfo(np.int64).min  # an invalid index

Complain = Callable[[int, str], None]  # line number, message


class Lines(NamedTuple):
    """An OBJ file split into lines. `\\r` and line continuations are replaced by blanks, so offsets equal those of the file."""

    data: bytes
    starts: I64  # offset of each line
    numbers: I64  # line number in the file, from 1
    keys: I64  # its keyword, a row of KEYWORDS, or OTHER, or BLANK

    def text(self, row: int) -> bytes:
        end = self.starts[row + 1] if row + 1 < len(self.starts) else len(self.data)
        return self.data[self.starts[row] : end].strip()


KEYWORDS = (b"v", b"vt", b"vn", b"f")
OTHER, BLANK = len(KEYWORDS), len(KEYWORDS) + 1


class Faces(NamedTuple):
    """Corners of all faces."""

    rows: I64  # (f,) rows of Lines
    counts: I64  # (f,)
    corners: I64  # (c, 3) v, vt, vn as written: from 1, negative from the end, NONE, BAD


def without_comment(text: str) -> str:
    """A name without a trailing `# comment`. A # inside a word belongs to the name."""
    return re.split(r"(?:^|\s+)#", text, maxsplit=1)[0].strip()


def split(data: bytes) -> Lines:
    """Splits a file into lines, for any line ends, byte order mark or encoding."""
    data = text_encoding.as_utf8(data).replace(b"\x1a", b"")  # Ctrl-Z ends a text in old DOS programs
    data = data.replace(b"\r\n", b" \n").replace(b"\r", b"\n")
    data = re.sub(rb"\\[ \t]*\n", lambda m: b" " * (len(m[0]) - 1) + b"\v", data)
    if not data.endswith(b"\n"):
        data += b"\n"
    buffer = np.frombuffer(data, dtype=np.uint8)
    ends = np.flatnonzero(buffer == 10)
    starts = np.concatenate([[0], ends[:-1] + 1])
    continued = np.cumsum(buffer == 11)[starts] if b"\v" in data else 0
    starts = _past_indent(data, starts, ends)
    return Lines(data, starts, np.arange(1, len(starts) + 1) + continued, _keys(buffer, starts))


def _past_indent(data: bytes, starts: I64, ends: I64) -> I64:
    """Line starts moved past leading blanks."""
    buffer = np.frombuffer(data, dtype=np.uint8)
    starts = starts.copy()
    open_rows = np.flatnonzero(_SPACE[buffer[starts]] & (starts < ends))
    while len(open_rows):
        starts[open_rows] += 1
        open_rows = open_rows[_SPACE[buffer[starts[open_rows]]] & (starts[open_rows] < ends[open_rows])]
    return starts


def _keys(buffer: np.ndarray, starts: I64) -> I64:
    last = len(buffer) - 1
    a, b, c = (buffer[np.minimum(starts + k, last)] for k in range(3))
    keys = np.full(len(starts), OTHER, dtype=np.int64)
    keys[_SPACE[a] | (a == ord("#"))] = BLANK
    keys[(a == ord("v")) & _SPACE[b]] = 0
    keys[(a == ord("v")) & (b == ord("t")) & _SPACE[c]] = 1
    keys[(a == ord("v")) & (b == ord("n")) & _SPACE[c]] = 2
    keys[(a == ord("f")) & _SPACE[b]] = 3
    return keys


def with_plain_numbers(lines: Lines, complain: Complain) -> Lines:
    """The lines with points and blanks in place of the commas of numbers and faces; see number_text. Says once that there were some."""
    if not number_text.has_commas(lines.data):
        return lines
    buffer = np.frombuffer(lines.data, dtype=np.uint8)
    rows = np.unique(np.searchsorted(lines.starts, np.flatnonzero((buffer == ord(",")) | (buffer == ord(";"))), "right") - 1)
    rows = rows[lines.keys[rows] < OTHER]
    texts = [lines.text(int(row)).split(b"#")[0] for row in rows]
    written = [(row, text) for row, text in zip(rows.tolist(), texts, strict=True) if number_text.has_commas(text)]
    if not written:
        return lines
    measured = [(row, text) for row, text in written if lines.keys[row] < 3]
    decimal = all(len(text.split()) > 3 for row, text in measured if lines.keys[row] != 1)
    joined = b"\n".join(text[len(KEYWORDS[lines.keys[row]]) :] for row, text in measured)
    numbers = number_text.plain(joined, decimal)
    decimal = numbers.warning == number_text.DECIMAL
    changed = bytearray(lines.data)
    for row, text in written:
        start = int(lines.starts[row])
        changed[start : start + len(text)] = number_text.plain(text, decimal and int(lines.keys[row]) < 3).text
    complain(int(lines.numbers[written[0][0]]), numbers.warning or number_text.SEPARATORS)
    return lines._replace(data=bytes(changed))


class Block(NamedTuple):
    """The text of all lines of one keyword, without the keyword, and their rows."""

    text: np.ndarray  # uint8
    starts: I64
    rows: I64


def block(lines: Lines, key: int) -> Block:
    rows = np.flatnonzero(lines.keys == key)
    buffer = np.frombuffer(lines.data, dtype=np.uint8)
    ends = np.append(lines.starts[1:], len(buffer))
    lengths = ends[rows] - lines.starts[rows]
    starts = np.cumsum(lengths) - lengths
    text = buffer[np.repeat(lines.starts[rows] - starts, lengths) + np.arange(int(lengths.sum()))]
    for k in range(len(KEYWORDS[key])):
        text[starts + k] = 32
    return Block(text, starts, rows)


def numbers(lines: Lines, key: int, least: int, complain: Complain) -> tuple[F64, I64]:
    """Numbers of all lines of a keyword, flat, and the count on each line.

    A line with fewer than `least` numbers or an invalid number is reported and read as NaN.
    """
    lines_of_key = block(lines, key)
    if not len(lines_of_key.rows):
        return np.zeros(0), np.zeros(0, np.int64)
    counts = np.add.reduceat(_word_starts(lines_of_key.text), lines_of_key.starts)
    values = _parse(lines_of_key.text, np.float64)
    if values is None or len(values) != counts.sum() or (counts < least).any():
        return _numbers_by_line(lines, lines_of_key.rows, key, least, complain)
    return values, counts


def _numbers_by_line(lines: Lines, rows: I64, key: int, least: int, complain: Complain) -> tuple[F64, I64]:
    values: list[float] = []
    counts = np.zeros(len(rows), dtype=np.int64)
    for k, row in enumerate(rows):
        words = lines.text(int(row)).split(b"#")[0].split()[1:]
        numbers = _floats(words)
        if numbers is None or len(numbers) < least:
            kind = KEYWORDS[key].decode()
            got = "" if numbers is None else f", got {len(numbers)}"
            complain(int(lines.numbers[row]), f"`{kind}` needs {least} numbers or more{got}")
            numbers = [float("nan")] * least
        values += numbers
        counts[k] = len(numbers)
    return np.array(values), counts


def _floats(words: list[bytes]) -> list[float] | None:
    try:
        return [float(w) for w in words if b"_" not in w or float("x")]
    except ValueError:
        return None


def faces(lines: Lines, complain: Complain) -> Faces:
    """Corners of all faces. An invalid index is reported and BAD."""
    face_lines = block(lines, 3)
    if not len(face_lines.rows):
        return Faces(face_lines.rows, np.zeros(0, np.int64), np.zeros((0, 3), np.int64))
    words = _word_starts(face_lines.text)
    counts = np.add.reduceat(words, face_lines.starts)
    corners = _corners(face_lines.text, words)
    if corners is None:
        return _faces_by_line(lines, face_lines.rows, complain)
    return Faces(face_lines.rows, counts, corners)


def _corners(text: np.ndarray, words: np.ndarray) -> I64 | None:
    """(c, 3) corners from well-formed text, else None: v, v/vt, v//vn and v/vt/vn in any mixture."""
    slash = text == _SLASH
    if not (_DIGITS[text] | slash | _SPACE[text]).all():
        return None
    word_of = np.cumsum(words) - 1
    total = int(word_of[-1]) + 1 if len(word_of) else 0
    slashes = np.bincount(word_of[slash], minlength=total) if slash.any() else np.zeros(total, np.int64)
    raw = text.tobytes()
    if slashes.max(initial=0) > 2:
        return None
    plain = raw.replace(b"//", b" 0 ") if b"//" in raw else raw
    plain = plain.replace(b"/", b" ")
    values = _parse(np.frombuffer(plain, dtype=np.uint8), np.int64)
    if values is None or len(values) != total + slashes.sum():
        return None
    firsts = np.cumsum(slashes + 1) - slashes - 1
    corners = np.full((total, 3), NONE, dtype=np.int64)
    corners[:, 0] = values[firsts]
    for k in (1, 2):
        present = slashes >= k
        corners[present, k] = values[firsts[present] + k]
    return corners


def _faces_by_line(lines: Lines, rows: I64, complain: Complain) -> Faces:
    counts = np.zeros(len(rows), dtype=np.int64)
    corners: list[list[int]] = []
    for k, row in enumerate(rows):
        words = lines.text(int(row)).split(b"#")[0].split()[1:]
        counts[k] = len(words)
        for word in words:
            corner = [_index(part, empty=k > 0) for k, part in enumerate(word.split(b"/"))]
            if len(corner) > 3 or BAD in corner:
                shown = word[:40].decode(errors="replace")
                complain(int(lines.numbers[row]), f"`{shown}` is not a corner of a face: v, v/vt, v//vn or v/vt/vn, whole numbers")
                corner = [BAD]
            corners.append(corner[:3] + [NONE] * (3 - len(corner)))
    return Faces(rows, counts, np.array(corners, dtype=np.int64).reshape(-1, 3))


def _index(text: bytes, empty: bool) -> int:
    if not text and empty:
        return NONE
    if not re.fullmatch(rb"[+-]?\d{1,18}", text):
        return BAD
    return int(text)


def _word_starts(text: np.ndarray) -> I64:
    """1 at the start of each word, else 0."""
    space = _SPACE[text]
    begins = ~space
    begins[1:] &= space[:-1]
    return begins.astype(np.int64)


def _parse(text: np.ndarray, dtype: type) -> np.ndarray | None:
    """All numbers of the text; None if one is invalid."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)
        try:
            return np.fromstring(text.tobytes(), dtype=dtype, sep=" ")
        except (DeprecationWarning, ValueError):
            return None


def others(lines: Lines) -> Iterator[tuple[int, str, str]]:
    """(row, keyword, rest) of lines that are neither numbers nor faces."""
    for row in np.flatnonzero(lines.keys == OTHER):
        text = lines.text(int(row)).decode(errors="replace")
        keyword, _, rest = text.partition(" ") if " " in text else text.partition("\t")
        yield int(row), keyword, rest.strip()
