"""Text as plane polygons: glyphs of TrueType and OpenType fonts, shaped and kerned by HarfBuzz."""

from __future__ import annotations

import unicodedata
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..io.regular_files import read_bytes
from ..ir import F64
from ..mesh import mesh_csg, splines

# The fonts of the package, with their files in stdlib/fonts; its LICENSE.txt allows to copy and to embed them.
SHIPPED = {
    "DejaVu Sans": "DejaVuSans.ttf",
    "DejaVu Sans Bold": "DejaVuSans-Bold.ttf",
    "DejaVu Serif": "DejaVuSerif.ttf",
    "DejaVu Sans Mono": "DejaVuSansMono.ttf",
}
FINENESS = 2000  # capital height / FINENESS is the largest distance of a polygon from a glyph's curve
TAB = "    "


class FontError(Exception):
    """A file that is not a font. The caller adds the span."""


class Layout(NamedTuple):
    """How lines of text are set. Lengths are shares of the height of a capital letter."""

    align: str = "left"  # "left" | "center" | "right" of x = 0
    vertical: str = "baseline"  # what stands at y = 0: the first or last ("bottom") baseline, the "top" or "center" of the capitals
    spacing: float = 1.0  # factor of each advance
    line_spacing: float = 1.0  # factor of the distance of baselines


class Font:
    """A font of a file. Raises FontError."""

    def __init__(self, path: Path, tolerance: float = 1 / FINENESS) -> None:
        """`tolerance` is the largest distance of a polygon from a glyph's curve, as a share of the height of a capital letter."""
        import uharfbuzz

        self._hb: Any = uharfbuzz  # its names are not in its types
        try:
            face = self._hb.Face(self._hb.Blob(read_bytes(path)))
        except OSError as failure:
            raise FontError(f"cannot read the font `{path.name}`: {failure.strerror}") from None
        if not face.glyph_count:
            raise FontError(f"`{path.name}` is not a font")
        self._font = self._hb.Font(face)
        extents, h = self._font.get_font_extents("ltr"), self._font.get_nominal_glyph(ord("H"))
        tall = self._font.get_glyph_extents(h).y_bearing if h else 0
        capital = tall or self._font.get_metric_position_with_fallback(self._hb.OTMetricsTag.CAP_HEIGHT)
        self.capital = float(capital) if capital > 0 else 0.7 * face.upem
        self.line = float(extents.ascender - extents.descender + extents.line_gap) or 1.2 * face.upem
        self._outlines: dict[int, list[F64]] = {}
        self._tolerance = tolerance
        self._draw = self._hb.DrawFuncs()
        self._draw.set_move_to_func(_Pen.move_to)
        self._draw.set_line_to_func(_Pen.line_to)
        self._draw.set_quadratic_to_func(_Pen.curve_to)
        self._draw.set_cubic_to_func(_Pen.curve_to)
        self._draw.set_close_path_func(_Pen.close_path)

    def extent(self, text: str, layout: Layout) -> tuple[tuple[F64, F64], str]:
        """(two corners of a box about a text, its characters without a glyph), without outlines; equal corners: nothing is visible."""
        lines = text.replace("\r\n", "\n").replace("\t", TAB).split("\n")
        missing: dict[str, None] = {}
        width = max(self._shaped(line, layout.spacing, missing)[1] for line in lines) if text.strip() else 0.0
        below = (len(lines) - 1) * layout.line_spacing * self.line
        up = {"baseline": 0.0, "bottom": below, "top": -self.capital, "center": 0.5 * (below - self.capital)}[layout.vertical]
        offset = {"left": 0.0, "center": -0.5 * width, "right": -width}[layout.align]
        corners = np.array([offset, up - below]), np.array([offset + width, up + self.capital])
        return (corners[0] / self.capital, corners[1] / self.capital), "".join(missing)

    def outlines(self, text: str, layout: Layout) -> tuple[list[F64], str]:
        """The polygons (n, 2) of a text, and its characters without a glyph.

        The height of a capital letter is 1. Outlines are counter-clockwise, holes clockwise; overlapping glyphs are united.
        """
        lines = text.replace("\r\n", "\n").replace("\t", TAB).split("\n")
        contours: list[F64] = []
        missing: dict[str, None] = {}
        for row, line in enumerate(lines):
            glyphs, width = self._shaped(line, layout.spacing, missing)
            start = {"left": 0.0, "center": -0.5 * width, "right": -width}[layout.align]
            for glyph, x, y in glyphs:
                place = np.array([start + x, y - row * layout.line_spacing * self.line])
                contours += [contour + place for contour in self._contours(glyph)]
        below = (len(lines) - 1) * layout.line_spacing * self.line
        up = {"baseline": 0.0, "bottom": below, "top": -self.capital, "center": 0.5 * (below - self.capital)}[layout.vertical]
        loops = mesh_csg.union_of_outlines(contours)
        return [(loop + (0.0, up)) / self.capital for loop in loops], "".join(missing)

    def _shaped(self, line: str, spacing: float, missing: dict[str, None]) -> tuple[list[tuple[int, float, float]], float]:
        """The glyphs of a line with their places, and its width; adds the characters without a glyph to `missing`."""
        buffer = self._hb.Buffer()
        buffer.add_str(line)
        buffer.guess_segment_properties()
        self._hb.shape(self._font, buffer)
        glyphs, x = [], 0.0
        for info, position in zip(buffer.glyph_infos or (), buffer.glyph_positions or (), strict=True):
            if info.codepoint == 0:
                missing[line[info.cluster]] = None
            glyphs.append((info.codepoint, x + position.x_offset, float(position.y_offset)))
            x += position.x_advance * spacing
        return glyphs, x

    def _contours(self, glyph: int) -> list[F64]:
        if glyph not in self._outlines:
            pen = _Pen(self.capital * self._tolerance)
            self._font.draw_glyph(glyph, self._draw, pen)
            self._outlines[glyph] = [np.array(contour) for contour in pen.contours if len(contour) > 2]
        return self._outlines[glyph]


class _Pen:
    """Collects the contours of a glyph as polygons. HarfBuzz calls its functions with coordinates and the pen."""

    def __init__(self, tolerance: float) -> None:
        self.contours: list[list[tuple[float, float]]] = []
        self._tolerance = tolerance

    @staticmethod
    def move_to(x: float, y: float, pen: _Pen) -> None:
        pen.contours.append([(x, y)])

    @staticmethod
    def line_to(x: float, y: float, pen: _Pen) -> None:
        pen.contours[-1].append((x, y))

    @staticmethod
    def curve_to(*arguments: Any) -> None:
        *numbers, pen = arguments
        piece = np.array([*pen.contours[-1][-1], *numbers]).reshape(-1, 2)
        pen.contours[-1] += [(float(x), float(y)) for x, y in splines.points_after_first(piece, pen._tolerance)]

    @staticmethod
    def close_path(pen: _Pen) -> None:
        pass


def describe(characters: str) -> str:
    """Characters in a message: `字` (U+5B57)."""
    shown = [f"`{c}` (U+{ord(c):04X})" if unicodedata.category(c)[0] not in "CZ" else f"U+{ord(c):04X}" for c in characters[:8]]
    more = len(characters) - len(shown)
    return ", ".join(shown) + (f" and {more} more" if more else "")
