"""Repairs damaged `.usda` text: leaves out byte order marks, stray bytes and statements that usd-core refuses, with warnings."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Sdf, Tf

from .....lang import text_encoding
from .....lang.diagnostics import Diagnostics, Span
from ....io.regular_files import ANY_SIZE, open_regular
from .crate_check import IDENTIFIER, MAX_LEVELS

LEFT_OUT = "this statement cannot be read and is left out"
ENDS_EARLY = "the file ends early: it is read as if its prims ended there"
MOST = 20  # statements of a layer that may be left out
_HEADER = "#usda 1.0"
_FARTHEST = 1000  # characters before the header
_ODD = re.compile("[\0-\x08\x0b\x0c\x0e-\x1f\ufffd\ufeff]+")
_PLACE = re.compile(r":(\d+):\d+: ")
_PROPERTY = re.compile(r" in <[^<>]*?([^/<>.]+)\.([\w:]+)>")
_STRING = re.compile(r'"""(?:[^\\]|\\[\s\S])*?"""|"(?:[^"\\\n]|\\.)*"|\'(?:[^\'\\\n]|\\.)*\'|@[^@\n]*@|#.*')  # or comment
_UNENDED = re.compile("[\"'].*")  # a string without an end
_PAIRS = {"(": ")", "[": "]", "{": "}"}
_CHUNK = 1 << 24  # bytes whose levels are counted at a time
_STEPS = np.zeros(256, np.int8)
_STEPS[list(b"([{")], _STEPS[list(b")]}")] = 1, -1


def text_of(failure: Exception) -> str:
    """The text of an error of usd-core; "" where it is not UTF-8."""
    try:
        return str(failure)
    except UnicodeDecodeError:
        return ""


def is_sound(data: bytes) -> bool:
    """Whether usd-core reads some text as a layer."""
    if _nests_too_deep(data, 0)[0]:
        return False
    try:
        return Sdf.Layer.CreateAnonymous(".usda").ImportFromString(data.decode())
    except (Tf.ErrorException, UnicodeDecodeError):
        return False


def lost(diagnostics: Diagnostics) -> int:
    """The number of warnings of statements that were left out or cut off."""
    return sum(item.message.startswith((LEFT_OUT, ENDS_EARLY)) for item in diagnostics.items)


def nests_too_deep(path: Path) -> bool:
    """Whether the brackets of a text file nest in more levels than usd-core may read, counted with those of strings and comments."""
    level = 0
    try:
        with open_regular(path, ANY_SIZE) as file:
            if file.read(len(IDENTIFIER)) == IDENTIFIER:
                return False
            while data := file.read(_CHUNK):
                deep, level = _nests_too_deep(data, level)
                if deep:
                    return True
    except OSError:
        return False  # usd-core reports it
    return False


def _nests_too_deep(data: bytes, level: int) -> tuple[bool, int]:
    """Whether the brackets of text nest too deep, and the level at its end. `level` is that at its start."""
    levels = level + np.cumsum(_STEPS[np.frombuffer(data, np.uint8)], dtype=np.int32)
    return bool(levels.max(initial=level) > MAX_LEVELS), int(levels[-1]) if data else level


def repaired(data: bytes, place: str, diagnostics: Diagnostics) -> Any:
    """An anonymous layer of the text of a damaged file at a place; None for other data and text of which no prim can be read."""
    encoding, mark = text_encoding.encoding_of(data)
    before, header, rest = data[mark:].decode(encoding, "replace").partition(_HEADER)
    if not header or len(before) > _FARTHEST:
        return None
    said = Diagnostics()  # for a layer that can be read
    if place.lower().endswith(".usdc"):
        warn(place, 1, "this file is text, and its name ends as those of binary files", said)
    if mark:
        warn(place, 1, f"a byte order mark ({encoding.upper()}) is left out", said)
    elif encoding != "utf-8":
        warn(place, 1, f"this text is {encoding.upper()}, and USD has UTF-8: it is read", said)
    skipped = before.count("\n")
    if odd := _ODD.search(rest):
        warn(place, skipped + rest[: odd.start()].count("\n") + 1, "bytes that are not text are left out", said)
    lines = [""] * skipped + (header + _without_depths(_ODD.sub(" ", rest), skipped + 1, place, said)).split("\n")
    layer = Sdf.Layer.CreateAnonymous(".usda")
    if not _read(layer, lines, skipped, place, said) or (said.items and not layer.rootPrims):
        return None
    diagnostics.items += said.items
    return layer


def _without_depths(text: str, line: int, place: str, diagnostics: Diagnostics) -> str:
    """A text that begins at a line, with spaces in place of brackets that nest too deep and of what they hold."""
    codes = np.frombuffer(text.encode("utf-32-le", "replace"), np.uint32).copy()
    steps = _STEPS[np.minimum(codes, 255)]
    if steps.sum(where=steps > 0) <= MAX_LEVELS:
        return text
    for string in _STRING.finditer(text):
        steps[string.start() : string.end()] = 0
    levels = np.cumsum(steps, dtype=np.int32)
    deep = np.minimum(levels, levels - steps) > MAX_LEVELS  # not the brackets around what is left out
    if not deep.any():
        return text
    message = f"brackets nest in more than {MAX_LEVELS:,} levels here: what the deeper ones hold is left out"
    warn(place, line + text.count("\n", 0, int(deep.argmax())), message, diagnostics)
    codes[deep & (codes != ord("\n"))] = ord(" ")
    return codes.tobytes().decode("utf-32-le")


def _read(layer: Any, lines: list[str], skipped: int, place: str, diagnostics: Diagnostics) -> bool:
    """Fill the layer from lines, after `skipped` empty ones. Lines that cannot be read are made empty."""
    closed = 0
    for _ in range(MOST):
        try:
            return bool(layer.ImportFromString("\n".join(lines[skipped:]) + "\n" + "}\n" * closed))
        except Tf.ErrorException as failure:
            text = text_of(failure)
        layer.Clear()
        statement = _bad(text, lines, skipped)
        if statement is None:
            return False
        first, last, closers = statement
        if first >= len(lines) or not any(line.strip() for line in lines[first:]):
            if not closed:
                warn(place, len(lines), ENDS_EARLY, diagnostics)
            closed += 1
            continue
        warn(place, first + 1, f"{LEFT_OUT}: `{lines[first].strip()[:60]}`", diagnostics)
        lines[first : last + 1] = [*[""] * (last - first), closers if closers != lines[first].strip() else ""]
    return False


def _bad(text: str, lines: list[str], skipped: int) -> tuple[int, int, str] | None:
    """(first line, last line, brackets it closes that others open) of the statement that a parser's error names; None if it names none."""
    if named := _PROPERTY.search(text):
        prim, name = named.groups()
        opening = next((k for k, line in enumerate(lines) if f'"{prim}"' in line), 0)
        statement = re.compile(rf"(?:^|[\s\]]){re.escape(name)}(?:\.\w+)?\s*=")
        first = next((k for k in range(opening, len(lines)) if statement.search(lines[k])), -1)
    elif location := _PLACE.search(text):
        first = int(location[1]) - 1 + skipped
    else:
        return None
    if first < 0:
        return None
    return first, *_extent(lines, first)


def _extent(lines: list[str], first: int) -> tuple[int, str]:
    """(last line of a statement, brackets it closes that others open). One whose brackets do not match ends with its first line."""
    stack, closers = [], ""
    for last in range(first, len(lines)):
        for c in _UNENDED.sub("", _STRING.sub("", lines[last])):
            if c in _PAIRS:
                stack.append(_PAIRS[c])
            elif c in ")]}" and not stack:
                closers += c
            elif c in ")]}" and stack.pop() != c:
                if last > first:
                    return first, ""
                stack, closers = [], closers + c
        if not stack:
            return last, closers
    return first, ""


def warn(place: str, line: int, message: str, diagnostics: Diagnostics) -> None:
    """A warning at a line of the file or the layer of a package at a place."""
    diagnostics.warning(message, Span(place, line, 1, line, 1))
