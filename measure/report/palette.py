"""Colours, markers and dashes of a chart, for light and dark themes; a backend has the same ones on every chart.

The colours are distinct for the usual colour blindnesses (Okabe and Ito 2008, "Color universal design"). Each backend also has its own
marker, and each further curve of a backend its own dash.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ..records import Curve

PAPER, INK, FAINT, GRID, FRONT, FLOOR = "#ffffff", "#1f2328", "#59636e", "#e4e7eb", "#c9ced6", "#eceef1"
ON_DARK = {PAPER: "#0f1419", INK: "#e6e9ed", FAINT: "#98a2ae", GRID: "#252c34", FRONT: "#3d4752", FLOOR: "#1b2229"}

# Marks, text (contrast 4.5 : 1 on white), both in the dark theme, marker.
_BACKENDS = {
    "ray": ("#0072b2", "#00629b", "#3fa7e0", "#6cbdea", "o"),
    "raster": ("#d55e00", "#b04c00", "#f07f2b", "#f59a55", "s"),
    "reference": ("#009e73", "#007a59", "#1fc197", "#4fd3b0", "^"),
    "mitsuba": ("#cc79a7", "#a5447b", "#d98bb6", "#e5a6c8", "D"),
    "povray": ("#e69f00", "#8f6200", "#efb02f", "#f3c260", "p"),
}
_OTHERS = (("#56b4e9", "#1f78a8", "#56b4e8", "#8accf0", "P"), ("#6b5b95", "#574a7a", "#9d8cc9", "#b6a8da", "X"))
_DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (1.2, 1.2)), (0, (5, 1.2, 1.2, 1.2)))


@dataclass(frozen=True, slots=True)
class Style:
    """The style of a curve: colours of marks and text, marker and dash of matplotlib; hollow markers for a second curve."""

    color: str
    text_color: str
    marker: str
    dash: Any
    hollow: bool


def styles(curves: Sequence[Curve]) -> list[Style]:
    """A style for each curve."""
    unknown = list(dict.fromkeys(curve.backend for curve in curves if curve.backend not in _BACKENDS))
    listed: list[Style] = []
    seen: dict[str, int] = {}
    for curve in curves:
        name = curve.backend
        color, words, _, _, marker = _BACKENDS[name] if name in _BACKENDS else _OTHERS[unknown.index(name) % len(_OTHERS)]
        nth = seen.get(name, 0)
        seen[name] = nth + 1
        listed.append(Style(color, words, marker, _DASHES[nth % len(_DASHES)], nth % 2 == 1))
    return listed


def variables() -> list[tuple[str, str, str]]:
    """Every colour as a CSS variable: name, value in the light theme, value in the dark theme."""
    named = [(f"--c{i}", light, dark) for i, (light, dark) in enumerate(ON_DARK.items())]
    for i, (mark, words, dark_mark, dark_words, _) in enumerate([*_BACKENDS.values(), *_OTHERS]):
        named += [(f"--m{i}", mark, dark_mark), (f"--w{i}", words, dark_words)]
    return named
