"""Lowers `heightfield`: the heights of a picture, a formula or a list become a mesh."""

from __future__ import annotations

import numpy as np

from ...lang.elements import Element
from ...lang.formula_graph import Formula
from ...lang.input_error import InputError
from ..formula import numpy_interpreter
from ..formula.builder import Builder
from ..formula.from_formula import NotASurface, add_formula
from ..formula.tape import X, Z
from ..importers import images
from ..io import stage_cache
from ..io.sandbox import FileError
from ..mesh import built_geometry, height_grids, profiles
from ..scene import transforms
from ..scene.row_records import Piece
from .context import Context

MOST_HEIGHTS = 1 << 22
FEW = 32  # steps of formulas where geometry is left out
LUMINANCE = (0.2126, 0.7152, 0.0722)  # of linear Rec.709


class _Unfit(InputError):
    """Heights that make no surface."""


def heightfield(lowering: Context, element: Element) -> list[Piece]:
    """The surface or solid of a heightfield; nothing, after a diagnostic, if it is impossible."""
    args = element.args
    size, base = args["size"], args["base"]
    try:
        heights = _heights(lowering, element)
        lowest = float(heights.min())
        if base is not None and lowest <= -base:
            raise _Unfit(f"the base ends at y = {-base:.4g} m, and the lowest height is {lowest:.4g} m", "write a greater `base`")
    except _Unfit as unfit:
        return lowering.refuse(element, str(unfit), unfit.hint)
    if built_geometry.is_left_out():
        half = 0.5 * np.array(size)
        low, high = np.array([-half[0], lowest if base is None else -base, -half[1]]), np.array([half[0], heights.max(), half[1]])
        return [Piece(lowering.builder.mesh(built_geometry.box(low, high), element.place), transforms.identity())]
    mesh = height_grids.surface(heights, size) if base is None else height_grids.solid(heights, size, base)
    return [Piece(lowering.builder.mesh(mesh, element.place), transforms.identity())]


def _heights(lowering: Context, element: Element) -> np.ndarray:
    """(rows, columns) heights in metres, both 2 or more. Raises _Unfit."""
    heights = element.args["heights"]
    wanted = {"height": str, "steps": Formula}
    for name, kind in wanted.items():
        if name in element.given and not isinstance(heights, kind):
            what = "a picture" if kind is str else "a formula"
            raise _Unfit(f"`{name}` is for {what}: these heights are {_name(heights)}", f"leave out `{name}`")
    if isinstance(heights, str):
        return element.args["height"] * _of_picture(lowering, element, heights)
    return _of_formula(element, heights) if isinstance(heights, Formula) else _of_rows(heights)


def _name(heights: object) -> str:
    return "a picture" if isinstance(heights, str) else "a formula" if isinstance(heights, Formula) else "lengths"


def _of_picture(lowering: Context, element: Element, name: str) -> np.ndarray:
    try:
        path = lowering.files.find(name, lowering.folder(element), "picture")
        decoded = images.read(str(path), path.name, "linear")
    except (FileError, images.ImageError) as failure:
        raise _Unfit(failure.message, failure.hint) from None
    for message, hint in decoded.faults:
        lowering.warn(element, message, hint)
    rows, columns = decoded.texels.shape[:2]
    if min(rows, columns) < 2 or rows * columns > MOST_HEIGHTS:
        raise _Unfit(
            f"the picture `{path.name}` has {columns} by {rows} pixels",
            f"heights take 2 by 2 pixels or more, and {MOST_HEIGHTS:,} pixels at the most",
        )
    if decoded.odd:
        raise _Unfit(f"{decoded.odd:,} of {rows * columns:,} pixels of the picture `{path.name}` are infinite or no numbers")
    return decoded.texels[..., :3].astype(np.float64) @ LUMINANCE


def _of_formula(element: Element, formula: Formula) -> np.ndarray:
    if len(formula.parameters) != 2:
        raise _Unfit(f"a formula of heights has two parameters, x and z, not {len(formula.parameters)}", "write |x, z| …")
    if formula.kind != "number":
        kind = "truth value" if formula.kind == "truth" else formula.kind
        raise _Unfit(f"a formula of heights gives a number, not a {kind}", "write |x, z| and the height there")
    builder = Builder()
    try:
        tape = builder.finish(*add_formula(builder, formula, (X, Z), exact=True))
    except NotASurface as unfit:
        raise _Unfit(str(unfit), unfit.hint) from None
    size, steps = element.args["size"], element.args["steps"]
    steps = min(steps, FEW) if built_geometry.is_left_out() else steps
    columns, rows = (max(1, round(steps * side / max(size))) + 1 for side in size)
    x, z = np.meshgrid(np.linspace(-0.5, 0.5, columns) * size[0], np.linspace(-0.5, 0.5, rows) * size[1])
    unit = formula.unit
    with built_geometry.part("evaluated"):
        heights = stage_cache.cached(
            "heights evaluated", (tape, x, z, unit), lambda: numpy_interpreter.points(tape, x / unit, 0.0, z / unit)[0] * unit
        )
    wrong = ~np.isfinite(heights)
    if wrong.any():
        row, column = np.argwhere(wrong)[0]
        place = profiles.show(np.array((x[row, column], z[row, column])))
        raise _Unfit(f"the formula has no value at [x, z] = {place}", "keep it in the domain of its functions, by max, abs or clamp")
    return heights


def _of_rows(rows: tuple[tuple[float, ...], ...]) -> np.ndarray:
    if len(rows) < 2 or len(rows[0]) < 2:
        shape = f"{len(rows)} row{'s' * (len(rows) != 1)}" + (f" of {len(rows[0])}" if rows else "")
        raise _Unfit(f"heights are two rows of two or more, got {shape}", "write [[0, 1], [1, 0]]")
    for number, row in enumerate(rows, 1):
        if len(row) != len(rows[0]):
            raise _Unfit(f"row {number} has {len(row)} heights, and the first has {len(rows[0])}", "give every row as many")
    return np.array(rows)
