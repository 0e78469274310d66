"""Text of plain values: truth values, numbers, tuples, durations."""

from __future__ import annotations

from typing import Any


def show_value(value: Any) -> str:
    """The text of a value of a plan or of a `param`, in the syntax of the command line."""
    if isinstance(value, bool):
        return "on" if value else "off"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, tuple):
        return ",".join(show_value(v) for v in value) or "none"
    return str(value)


def counted(count: int, noun: str) -> str:
    """A number with its noun, such as "1 frame" or "1,200 frames"."""
    return f"{count:,} {noun}{'' if count == 1 else 's'}"


def time_range(least: float, most: float | None = None) -> str:
    """One or two durations as text, such as "8 to 12 s" or "2:10 min"."""
    short, long = _rounded(least), _rounded(least if most is None else most)
    if short == long:
        return f"{_digits(short, long)} {_unit(long)}"
    return f"{_digits(short, long)} to {_digits(long, long)} {_unit(long)}"


def _rounded(seconds: float) -> int:
    """Seconds, rounded up to a second, to five above a minute, to a minute above an hour."""
    step = 1 if seconds < 60 else 5 if seconds < 3600 else 60
    return -int(-max(seconds, 1.0) // step) * step


def _digits(seconds: int, longest: int) -> str:
    if longest < 60:
        return str(seconds)
    if longest < 3600:
        return f"{seconds // 60}:{seconds % 60:02d}"
    return f"{seconds // 3600}:{seconds % 3600 // 60:02d}"


def _unit(longest: int) -> str:
    return "s" if longest < 60 else "min" if longest < 3600 else "h"
