"""Lowers `text` to a mesh of its letters."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from ...lang import file_types
from ...lang.diagnostics import suggest
from ...lang.elements import Element
from ..importers import fonts
from ..io import stage_cache
from ..io.sandbox import LIBRARY, FileError
from ..mesh import built_geometry, polygon_mesh, swept
from ..scene import transforms
from ..scene.row_records import Piece
from .context import Context

DEPTH = 0.2  # of the size, by default
MAX_LETTERS = 50_000  # a letter has some hundred triangles


def text(lowering: Context, element: Element) -> list[Piece]:
    """The letters of a text; nothing, after a diagnostic, if there are none."""
    args = element.args
    if len(args["string"]) > MAX_LETTERS:
        message = f"a text of {len(args['string']):,} characters is too long: {MAX_LETTERS:,} at most"
        return lowering.refuse(element, message, "write several texts")
    path = _font_file(lowering, element)
    if path is None:
        return []
    try:
        share = 1 / fonts.FINENESS if lowering.tolerance is None else lowering.tolerance / args["size"]
        font = fonts.Font(path, share)
    except fonts.FontError as failure:
        return lowering.refuse(element, str(failure), "write the name of a TrueType or OpenType file")
    layout = fonts.Layout(args["align"], args["vertical"], args["spacing"], args["line_spacing"])
    if built_geometry.is_left_out():
        (low, high), missing = font.extent(args["string"], layout)
        loops = [np.array([low, high])] if high[0] > low[0] else []
    else:
        with built_geometry.part("outlined"):
            loops, missing = _outlines(font, path, args["string"], layout)
    if missing:
        message = f"the font `{args['font']}` has no glyph for {fonts.describe(missing)}"
        lowering.warn(element, message, "take another font, or leave them out")
    if not loops:
        lowering.warn(element, "this text has no visible letter: nothing is drawn")
        return []
    size, depth = args["size"], args["depth"]
    depth = DEPTH * size if depth is None else depth
    loops = [loop * size for loop in loops]
    if built_geometry.is_left_out():
        box = built_geometry.box(np.append(loops[0][0], 0.0), np.append(loops[0][1], depth))
        return [Piece(lowering.builder.mesh(box, element.place), transforms.identity())]
    mesh = swept.extrude(loops, swept.Sweep(0.0, depth)) if depth else swept.sheet(loops)
    data, _ = polygon_mesh.assemble(_upright(mesh), args["crease"])
    off = share * size
    return [Piece(lowering.builder.mesh(replace(data, deviation=off), element.place), transforms.identity())]


def _outlines(font: fonts.Font, path: Path, string: str, layout: fonts.Layout) -> tuple[list[np.ndarray], str]:
    """See fonts.Font.outlines; kept for the next compilation."""
    about = path.stat()
    inputs = (str(path), about.st_mtime_ns, about.st_size, string, tuple(layout))

    def make() -> tuple[tuple[np.ndarray, ...], str]:
        loops, missing = font.outlines(string, layout)
        return tuple(loops), missing

    loops, missing = stage_cache.cached("texts outlined", inputs, make)
    return list(loops), missing


def _upright(mesh: polygon_mesh.PolyMesh) -> polygon_mesh.PolyMesh:
    """A prism along y turned to stand along z, its profile in x and y."""
    points = mesh.points[:, [0, 2, 1]] * (1.0, -1.0, 1.0)
    return polygon_mesh.PolyMesh(points, mesh.counts, mesh.indices, mesh.normals, mesh.uvs)


def _font_file(lowering: Context, element: Element) -> Path | None:
    """The file of a font, which a scene gives by name or as a file; None after a diagnostic."""
    name = element.args["font"]
    shipped_files = {shipped.casefold(): file for shipped, file in fonts.SHIPPED.items()}
    if name.casefold() in shipped_files:
        return LIBRARY / "fonts" / shipped_files[name.casefold()]
    if not name.casefold().endswith(file_types.FONT):
        near = suggest(name, fonts.SHIPPED)
        listed = ", ".join(f'"{shipped}"' for shipped in fonts.SHIPPED)
        hint = near or f'write {listed}, or the name of a file: font: "fonts/name.ttf"'
        lowering.error(element, f"there is no font `{name}`", hint)
        return None
    try:
        return lowering.files.find(name, lowering.folder(element), "font")
    except FileError as failure:
        lowering.error(element, failure.message, failure.hint)
        return None
