"""Lowers shapes to geometries and their frames."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from ...lang.elements import Element
from ...shapes.catalogue import ELEMENTS
from ...shapes.contract import ShapeError
from ..importers.common.replacements import NONE, Replacements
from ..mesh import built_geometry, polygon_mesh, repair, triangulate
from ..scene import fit_height, transforms
from ..scene.row_records import MeshAttribute, MeshData, Outlines, Piece
from . import formulas, heightfields, solids, sweeps, texts
from .context import Context
from .placements import rotation_of

FLATNESS = 1e-3  # how far a polygon's corners may be off its plane, as a share of its extent


def pieces(lowering: Context, element: Element) -> list[Piece]:
    """The geometries of a shape; nothing, after a diagnostic, if it is impossible."""
    if element.kind not in _GENERATED:
        return _pieces(lowering, element)
    form = (item for item in element.args.items() if item[0] not in _NOT_ITS_FORM)
    key = element.kind, element.place.file, tuple(form), lowering.tolerance
    if not lowering.generated.get(key):
        lowering.generated[key] = _pieces(lowering, element)
    return lowering.generated[key]


def _pieces(lowering: Context, element: Element) -> list[Piece]:
    with built_geometry.timed(element.kind, element.place):
        return [piece for piece in _SHAPES[element.kind](lowering, element) if piece.geometry >= 0]


def centered(lowering: Context, element: Element) -> tuple[int, tuple[float, float, float]]:
    """The geometry of a shape of CENTERED, and where its origin is."""
    shape, makes = ELEMENTS[element.kind]
    parameters = makes.parameters(element.args)
    key = shape.KIND, parameters
    row = lowering.centered.get(key)
    if row is None:
        row = lowering.centered[key] = lowering.builder.geometry(shape.KIND, parameters, element.place)
    return row, element.args["center"]


def _centered(lowering: Context, element: Element) -> list[Piece]:
    row, center = centered(lowering, element)
    return [Piece(row, transforms.translation(center))]


def _framed(lowering: Context, element: Element) -> list[Piece]:
    """An analytic shape with a frame of its own."""
    shape, makes = ELEMENTS[element.kind]
    assert makes.frame is not None
    try:
        parameters, frame = makes.parameters(element.args), makes.frame(element.args)
    except ShapeError as error:
        return lowering.refuse(element, error.message, error.hint)
    matrix = transforms.translation(frame.center) if frame.normal is None else transforms.facing(frame.center, frame.normal)
    if matrix is None:
        return lowering.refuse(element, f"the {element.kind}'s normal is 0", "give it a direction, like [0, 1, 0]")
    if frame.stretch is not None:
        matrix = matrix @ transforms.scaling(frame.stretch)
    return [Piece(lowering.builder.geometry(shape.KIND, parameters, element.place), matrix)]


def _triangle(lowering: Context, element: Element) -> list[Piece]:
    args = element.args
    for name in ("points", "normals", "uv"):
        if args[name] is not None and len(args[name]) != 3:
            return lowering.refuse(element, f"a triangle has three {name}, got {len(args[name])}")
    corners = np.array(args["points"])
    if not np.cross(corners[1] - corners[0], corners[2] - corners[0]).any():
        return lowering.refuse(element, "the triangle's corners lie on one line: it has no area")
    uv = args["uv"] or ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0))
    mesh = MeshData(corners, np.array([[0, 1, 2]]), _vertex(args["normals"]), _vertex(uv))
    return [Piece(lowering.builder.mesh(mesh, element.place), transforms.identity())]


def _polygon(lowering: Context, element: Element) -> list[Piece]:
    args = element.args
    loops = [args["points"], *(args["holes"] or ())]
    for index, loop in enumerate(loops):
        if len(loop) < 3:
            what = "a polygon" if index == 0 else "a hole"
            return lowering.refuse(element, f"{what} has three corners or more, got {len(loop)}")
    points = np.array([corner for loop in loops for corner in loop])
    if args["uv"] is not None and len(args["uv"]) != len(points):
        coordinates = f"{len(args['uv'])} texture coordinate{'s' * (len(args['uv']) != 1)}"
        return lowering.refuse(element, f"the polygon has {len(points)} corners and {coordinates}: there is one for each corner")
    counts = [len(loop) for loop in loops]
    firsts = np.cumsum([0, *counts[:-1]]).tolist()
    rows = [list(range(first, first + count)) for first, count in zip(firsts, counts, strict=True)]
    triangles = triangulate.triangulate(points, rows)
    if not len(triangles):
        return lowering.refuse(element, "the polygon has no area")
    axes = _plane_axes(points[: counts[0]])
    off = float(np.abs((points - points[0]) @ axes[2]).max())
    if off > FLATNESS * float(np.ptp(points, axis=0).max()):
        lowering.warn(element, f"the polygon is not flat: its corners are up to {off:.3g} m off its plane", "cut it into triangles")
    loops_table = np.array(list(zip(firsts, counts, strict=True)))
    outlines = Outlines(np.arange(len(points)), loops_table, np.array([[0, len(loops), 0, len(triangles)]]))
    uv = _vertex(args["uv"]) if args["uv"] is not None else MeshAttribute(_flat_uv(points, axes))
    return [Piece(lowering.builder.mesh(MeshData(points, triangles, None, uv, None, outlines), element.place), transforms.identity())]


def _plane_axes(outline: np.ndarray) -> np.ndarray:
    """Rows u, v, n of a right-handed frame: n is Newell's normal, u runs along the first edge that has a length."""
    around = np.roll(outline, -1, axis=0)
    normal = transforms.unit(np.cross(outline - outline[0], around - outline[0]).sum(axis=0))
    edge = next(u for u in (transforms.unit(e) for e in around - outline) if u is not None)
    normal = normal if normal is not None else np.array([0.0, 1.0, 0.0])
    u = transforms.unit(edge - (edge @ normal) * normal)
    u = u if u is not None else edge
    return np.stack([u, np.cross(normal, u), normal])


def _flat_uv(points: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Texture coordinates that span the polygon's extent along its own axes once."""
    flat = points @ axes[:2].T
    extent = np.ptp(flat, axis=0)
    return (flat - flat.min(axis=0)) / np.where(extent > 0, extent, 1.0)


def _mesh(lowering: Context, element: Element) -> list[Piece]:
    args = element.args
    beside = [name for name in ("points", "faces", "normals", "uv", "colors") if args[name] is not None]
    if args["file"] is None:
        pieces = _written_mesh(lowering, element)
    elif beside:
        return lowering.refuse(element, f"`{beside[0]}` goes with `points`, not with a file: the file brings its own")
    else:
        pieces = lowering.mesh_file(element)
    pieces = _with_materials(lowering, element, [piece for piece in pieces if piece.geometry >= 0])
    if args["single_sided"]:
        lowering.builder.single_sided.update(piece.geometry for piece in pieces)
    return _to_height(lowering, element, pieces) if pieces and args["height"] is not None else pieces


def _written_mesh(lowering: Context, element: Element) -> list[Piece]:
    args = element.args
    if args["points"] is None or args["faces"] is None:
        hint = 'write mesh("bunny.obj") or mesh(points: […], faces: […])'
        return lowering.refuse(element, "a mesh needs a file, or points and faces", hint)
    points = np.array(args["points"], dtype=np.float64).reshape(-1, 3)
    for number, face in enumerate(args["faces"]):
        if len(face) < 3:
            return lowering.refuse(element, f"face {number} has {len(face)} vertices: a face has three or more")
        if max(face) >= len(points):
            return lowering.refuse(element, f"face {number} names vertex {max(face)}, and there are {len(points)} (counted from 0)")
    for name in ("normals", "uv", "colors"):
        if args[name] is not None and len(args[name]) != len(points):
            return lowering.refuse(element, f"the mesh has {len(points)} points and {len(args[name])} {name}: there is one for each point")
    counts = np.array([len(face) for face in args["faces"]], dtype=np.int64)
    indices = np.array([vertex for face in args["faces"] for vertex in face], dtype=np.int64)
    mesh = polygon_mesh.PolyMesh(points, counts, indices, _vertex(args["normals"]), _vertex(args["uv"]), _vertex(args["colors"]))
    if args["repair"]:
        mesh, _, repairs = repair.repaired(mesh)
        repairs.tell("the mesh", lowering.builder.diagnostics, element.place)
    data, dropped = polygon_mesh.assemble(mesh)
    if dropped:
        lowering.warn(element, f"{dropped} of the mesh's {len(counts)} faces {'has' if dropped == 1 else 'have'} no area and are left out")
    return [Piece(lowering.builder.mesh(data, element.place), transforms.identity())]


def _with_materials(lowering: Context, element: Element, pieces: list[Piece]) -> list[Piece]:
    """The pieces of a file with the materials of the argument `materials` in place of the file's."""
    if element.args["materials"] is None or not pieces:
        return pieces
    if element.args["file"] is None:
        return lowering.refuse(element, "`materials` replaces those of a file, and this mesh has none", "write material: for its own")
    replaced = Replacements(lowering.material_rows(element))
    rows = [replaced.row(piece.material_name) if piece.material_name else NONE for piece in pieces]
    for message, hint in replaced.unused():
        lowering.error(element, message, hint)
    return [piece if row == NONE else replace(piece, material=row, chosen=True) for piece, row in zip(pieces, rows, strict=True)]


def _to_height(lowering: Context, element: Element, pieces: list[Piece]) -> list[Piece]:
    """Scaled evenly to `height` as it is rotated, the base at y = 0, the middle at x = z = 0."""
    placed = [fit_height.Placed(piece.geometry, piece.matrix[None]) for piece in pieces]
    fitted = fit_height.fitted(lowering.builder, placed, element.args["height"], rotation_of(element))
    if fitted is None:
        return lowering.refuse(element, "the mesh is flat: it has no height that could be scaled", "use scale instead of height")
    return [replace(piece, matrix=fitted @ piece.matrix) for piece in pieces]


def _vertex(values: Any) -> MeshAttribute | None:
    return None if values is None else MeshAttribute(np.array(values, dtype=np.float64))


CENTERED = frozenset(name for name, (_, makes) in ELEMENTS.items() if makes.frame is None)
"""Shapes that are one geometry about their `center`."""

_SHAPES: dict[str, Callable[[Context, Element], list[Piece]]] = {
    **dict.fromkeys(ELEMENTS, _framed),
    **dict.fromkeys(CENTERED, _centered),
    "triangle": _triangle,
    "polygon": _polygon,
    "mesh": _mesh,
    "implicit": formulas.implicit,
    "revolve": sweeps.revolve,
    "extrude": sweeps.extrude,
    "curve": sweeps.curve,
    "heightfield": heightfields.heightfield,
    "text": texts.text,
    **dict.fromkeys(solids.KINDS, solids.solid),
}
KINDS = frozenset(_SHAPES)
_GENERATED = frozenset({"revolve", "extrude", "curve", "heightfield", "text"})  # shapes whose meshes take a while: equal ones are made once
_NOT_ITS_FORM = frozenset({"material", "medium", "name", "translate", "rotate", "scale"})
