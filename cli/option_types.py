"""Click parameter types of the command line: sizes, shares, times, frames, colours."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from ..lang import units
from ..lang.schema.setting_values import duration, names, number, seconds, share, size

MAX_FRAMES = 1_000_000


class Value(click.ParamType):
    """A parameter type by a function that reads the text or raises ValueError with the correct form."""

    def __init__(self, name: str, read: Callable[[str], Any]) -> None:
        self.name = name
        self._read = read

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if not isinstance(value, str):
            return value
        try:
            return self._read(value.strip())
        except ValueError as error:
            return self.fail(f"{value!r}: {error}", param, ctx)


def limit(text: str) -> float:
    """`1%` or `0.01`, or 0."""
    message = "a limit is written 1% or 0.01, or 0"
    value = number(text, message)
    if isinstance(value, units.Quantity) or value < 0:
        raise ValueError(message)
    return value


def length(text: str) -> float:
    """`0.05mm`, `2cm`, or a bare number of metres; above zero."""
    message = "a length is written 0.05mm or 2cm, and is more than 0"
    value = number(text, message)
    if isinstance(value, units.Quantity) and value.dimension != units.LENGTH:
        raise ValueError(message)
    metres = value.value if isinstance(value, units.Quantity) else value
    if metres <= 0:
        raise ValueError(message)
    return metres


def memory(text: str) -> int:
    """Bytes: `8GB`, `500MB`."""
    match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([MG])i?B?", text, re.IGNORECASE)
    if not match or not float(match[1]):
        raise ValueError("a memory is written 8GB or 500MB")
    return int(float(match[1]) * (1e9 if match[2].upper() == "G" else 1e6))


def checkpoint(text: str) -> float:
    """A time above zero, or 0 for `off`."""
    if text == "off":
        return 0.0
    value = seconds(text)
    if value <= 0:
        raise ValueError("a time between checkpoints is more than 0 seconds, or off")
    return value


_FRAME = r"(-?(?:\d+(?:\.\d+)?|\.\d+))"


def frames(text: str) -> tuple[float, ...]:
    """`1..24`, `1..240x10`, `1:10x0.5` (as usdrecord), `1,5,10` or mixtures; () for `all`."""
    message = "frames are written 1..24, 1..240x10, 1,5,10 or all"
    seconds: list[float] = []
    for item in text.split(",") if text != "all" else ():
        match = re.fullmatch(rf"{_FRAME}(?:(?:\.\.|:){_FRAME}(?:x{_FRAME})?)?", item.strip())
        if not match:
            raise ValueError(message)
        first, last, step = float(match[1]), float(match[2] or match[1]), float(match[3] or 1)
        if last < first or step <= 0:
            raise ValueError(f"{message}, upwards")
        count = math.floor((last - first) / step + 1e-9) + 1
        if len(seconds) + count > MAX_FRAMES:
            raise ValueError(f"at most {MAX_FRAMES} frames at a time")
        seconds += [round(first + k * step, 9) for k in range(count)]
    return tuple(dict.fromkeys(seconds))


def purposes(text: str) -> tuple[str, ...]:
    """Comma-separated purposes of USD."""
    names = tuple(name.strip() for name in text.split(","))
    if not names or any(name not in ("default", "render", "proxy", "guide") for name in names):
        raise ValueError("purposes are default, render, proxy and guide, as in default,render")
    return names


def complexity(text: str) -> int:
    """A level of subdivision: a name of usdrecord, or its number, 1.0 to 1.6 (0.1 a level)."""
    names = {"low": 0, "medium": 1, "high": 2, "veryhigh": 3}
    if text in names:
        return names[text]
    try:
        level = round((float(text) - 1.0) * 10)
    except (ValueError, OverflowError):
        level = -1
    if not 0 <= level <= 6:
        raise ValueError("a complexity is low, medium, high or veryhigh, or a number from 1.0 to 1.6")
    return level


def assignment(text: str) -> tuple[str, str]:
    """`name=value`."""
    name, equals, value = text.partition("=")
    if not equals or not name.strip() or not value.strip():
        raise ValueError("write it as name=value")
    return name.strip(), value.strip()


def variant(text: str) -> tuple[str, str]:
    """`/prim:set=name`."""
    if not re.fullmatch(r"/[^:=]*:[^=]+=.+", text):
        raise ValueError("a variant is written /prim:set=name")
    return assignment(text)


def frame_path(path: Path, frame: float) -> Path:
    """The file of one frame: `out.####.png` and `out.FRAME.png` become `out.0007.png`, `out.##.##.png` becomes `out.07.50.png`.

    A name without either gets the number before its extension. A fraction keeps the digits it needs.
    """
    marks = re.search(r"(#+)(?:\.(#+))?|FRAME", path.name)
    if not marks:
        return path.with_name(f"{path.stem}.{_digits(frame, 4, 0)}{path.suffix}")
    digits = _digits(frame, len(marks[1] or "####"), len(marks[2] or ""))
    return path.with_name(path.name[: marks.start()] + digits + path.name[marks.end() :])


def _digits(frame: float, digits: int, decimals: int) -> str:
    """A frame number with at least this many digits before and after the point."""
    fraction = f"{abs(frame) % 1:.9f}"[2:].rstrip("0").ljust(decimals, "0")
    sign = "-" if frame < 0 else ""
    return f"{sign}{int(abs(frame)):0{max(digits - len(sign), 1)}d}{f'.{fraction}' if fraction else ''}"


SIZE = Value("WxH", size)
SHARE = Value("share", share)
LIMIT = Value("share", limit)
SECONDS = Value("time", seconds)
DURATION = Value("time", duration)
MEMORY = Value("memory", memory)
CHECKPOINT = Value("checkpoint", checkpoint)
FRAMES = Value("frames", frames)
PURPOSES = Value("names", purposes)
COMPLEXITY = Value("level", complexity)
CHANNELS = Value("names", names)
ASSIGNMENT = Value("name=value", assignment)
VARIANT = Value("/prim:set=name", variant)
