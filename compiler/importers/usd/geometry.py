"""Imports USD meshes and shapes as geometries: primvars, holes, orientation, subsets, axes."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pxr import UsdGeom

from ....lang.diagnostics import Diagnostics, Span
from ....shapes import SHAPES as ANALYTIC
from ... import ir
from ...mesh import polygon_mesh, subdivision, triangulate, vertex_normals
from ...scene.builder import NONE, SceneBuilder
from ...scene.row_records import MeshAttribute
from ..common import vertex_numbers
from . import stage
from .skeletons import Skin

Kind = ir.GeometryKind
_At = ir.Interpolation
# Rotations from the IR's y axis to the axis of a shape.
_AXES = {
    "Y": np.eye(4),
    "Z": np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]]),
    "X": np.array([[0.0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]),
}
_INTERPOLATIONS = {"constant": _At.CONSTANT, "uniform": _At.FACE, "varying": _At.VERTEX, "vertex": _At.VERTEX, "faceVarying": _At.CORNER}
SHAPES = tuple(dict.fromkeys(name for shape in ANALYTIC.values() for name in shape.USD))
"""The types of prims that are analytic shapes."""
_OF_TYPE = {name: [(shape.KIND, shape.USD[name]) for shape in ANALYTIC.values() if name in shape.USD] for name in SHAPES}
_SEGMENTS, _RINGS = 48, 12


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """A geometry's row and its (4, 4) placement in the prim's frame."""

    geometry: int
    matrix: np.ndarray


def shape(prim: Any, time: Any, builder: SceneBuilder, span: Span) -> Shape | None:
    """Imports a prim of a type in SHAPES, with its schema's fallbacks. None for a shape without extent."""
    name = str(prim.GetTypeName())

    def number(attribute: str) -> float:
        return stage.number(prim.GetAttribute(attribute), time)

    axis = prim.GetAttribute("axis")
    turn = _AXES.get(str(axis.Get(time)) if axis else "Y", _AXES["Z"])
    side = str(axis.Get(time)) if axis else ""
    shape = next(((kind, p) for kind, read in _OF_TYPE[name] if (p := read(number, side)) is not None), None)
    if shape is None:
        bottom, top, half = number("radiusBottom"), number("radiusTop"), number("height") / 2
        return Shape(builder.mesh(_uneven_capsule(bottom, top, half), span, str(prim.GetName())), turn)
    if not all(math.isfinite(p) and p >= 0 for p in shape[1]) or max(shape[1][:2]) <= 0:
        builder.diagnostics.warning(f"this {name} has no size: it is not drawn", span)
        return None
    return Shape(builder.geometry(shape[0], shape[1], span, str(prim.GetName())), turn)


def _uneven_capsule(bottom: float, top: float, half: float) -> Any:
    """A capsule of two radii, the convex hull of two spheres, as a mesh about y."""
    slope = math.asin(max(-1.0, min(1.0, (bottom - top) / max(2 * half, 1e-12))))
    low = np.linspace(-math.pi / 2, slope, _RINGS + 1)
    high = np.linspace(slope, math.pi / 2, _RINGS + 1)
    angle = np.concatenate([low, high])
    radius = np.concatenate([np.full(_RINGS + 1, bottom), np.full(_RINGS + 1, top)])
    middle = np.concatenate([np.full(_RINGS + 1, -half), np.full(_RINGS + 1, half)])
    turn = np.linspace(0.0, 2 * math.pi, _SEGMENTS, endpoint=False)
    outward = np.stack([np.outer(np.cos(angle), np.cos(turn)), np.outer(np.sin(angle), np.ones(_SEGMENTS)),
                        -np.outer(np.cos(angle), np.sin(turn))], axis=-1)  # fmt: skip
    points = outward * radius[:, None, None] + np.array([0.0, 1.0, 0.0]) * middle[:, None, None]
    rows = np.arange(len(angle) - 1)[:, None] * _SEGMENTS
    column = np.arange(_SEGMENTS)
    quads = np.stack(
        [rows + column, rows + np.roll(column, -1), rows + _SEGMENTS + np.roll(column, -1), rows + _SEGMENTS + column], axis=-1
    )
    mesh = polygon_mesh.PolyMesh(
        points.reshape(-1, 3), np.full(quads.size // 4, 4), quads.reshape(-1), MeshAttribute(outward.reshape(-1, 3))
    )
    return polygon_mesh.assemble(mesh)[0]


@dataclass(frozen=True, slots=True, eq=False)
class Faces:
    """A mesh prim at one time, ready to be split by material subset."""

    mesh: polygon_mesh.PolyMesh
    rows: np.ndarray  # rows of the prim's drawn faces
    subdivided: bool  # whether it is the control cage of a subdivision surface

    def part(self, faces: np.ndarray | None) -> polygon_mesh.PolyMesh:
        """The mesh of the drawn faces among `faces` (None: all)."""
        if faces is None:
            return self.mesh
        return polygon_mesh.subset(self.mesh, np.flatnonzero(np.isin(self.rows, faces)))


def _colors(attribute: MeshAttribute | None, diagnostics: Diagnostics, span: Span) -> MeshAttribute | None:
    """Colours with negative components clamped to 0, with a warning."""
    if attribute is None or not (attribute.values < 0).any():
        return attribute
    diagnostics.warning("this mesh's colours have negative components, which count as 0", span)
    return MeshAttribute(np.maximum(attribute.values, 0), attribute.interpolation)


@dataclass(frozen=True, slots=True)
class Reads:
    """The primvars that a mesh takes its texture coordinates and colours from; None: none."""

    uv: str | None = None
    color: str | None = None
    ramp: bool = False  # `uv` is a number in 0…1: it becomes u


def mesh(
    prim: Any, time: Any, reads: Reads, diagnostics: Diagnostics, span: Span, level: int = 0, skin: Skin | None = None
) -> Faces | None:
    """A Mesh prim as polygons counter-clockwise from outside, with the texture coordinates and colours of the primvars of `reads`.

    Subdivision surfaces are refined `level` times; at 0 they become their control cages with smooth normals (as usdrecord at low
    complexity). Other meshes keep their normals or are flat. `skin` has deformed points. None for an empty mesh, with a warning for
    inconsistent data.
    """
    schema = UsdGeom.Mesh(prim)
    points = skin.points if skin else stage.points(prim, time)
    counts, indices = topology(prim, time)
    if not len(points) or not len(counts):
        return None
    counts, indices = _fitting(counts, indices, diagnostics, span)
    solid = str(prim.GetTypeName()) == "TetMesh"
    subdivided = not solid and str(schema.GetSubdivisionSchemeAttr().Get(time)) != "none"
    api = UsdGeom.PrimvarsAPI(prim)
    sound = _valid_indices(indices, points)
    normals = None if subdivided else _normals(schema, api, time, len(points), counts, diagnostics, span)
    uvs = primvar(api, reads.uv, time, 1 if reads.ramp else 2, len(points), counts, diagnostics, span) if reads.uv else None
    if reads.uv and uvs is None and not api.FindPrimvarWithInheritance(reads.uv).HasValue():
        diagnostics.warning(f"the material reads the primvar `{reads.uv}`, which this mesh lacks: each picture shows one texel", span)
        uvs = MeshAttribute(np.zeros((1, 2), np.float32), _At.CONSTANT)
    if reads.ramp and uvs is not None:
        uvs = vertex_numbers.coordinates(uvs, lambda message: diagnostics.warning(f"{message} (primvar `{reads.uv}`)", span))
    colors = primvar(api, reads.color, time, 3, len(points), counts, diagnostics, span) if reads.color else None
    polygons = polygon_mesh.PolyMesh(points, counts, indices, normals, uvs, _colors(colors, diagnostics, span))
    if skin is not None and sound.all():
        polygons = skin.deform(polygons)
    if schema.GetOrientationAttr().Get(time) == UsdGeom.Tokens.leftHanded:
        polygons = polygon_mesh.flip(polygons)
    bad = np.repeat(np.arange(len(counts)), counts)[~sound]
    drawn = np.ones(len(counts), dtype=bool)
    drawn[bad] = False
    if len(bad):
        lost = int(np.count_nonzero(~drawn))
        diagnostics.warning(f"{lost} of {len(counts)} faces use points that do not exist or are not finite: they are left out", span)
    holes = np.zeros(0, np.int64) if solid else stage.numbers(schema.GetHoleIndicesAttr(), time, np.int64)
    holes = holes[(holes >= 0) & (holes < len(counts))]
    varying = frozenset(kind for kind, name in (("uvs", reads.uv), ("colors", reads.color)) if name and _is_varying(api, name))
    how = replace(_scheme(schema, time), linear=varying) if subdivided and level else None
    if how is not None and (refined := _refined(polygons, drawn, how, level, diagnostics, span)) is not None:
        visible, rows = refined
        if len(holes):
            below = np.flatnonzero(~np.isin(rows, holes))
            visible, rows = polygon_mesh.subset(visible, below), rows[below]
        subdivided = False
    else:
        drawn[holes] = False
        rows = np.flatnonzero(drawn)
        visible = polygons if drawn.all() else polygon_mesh.subset(polygons, rows)
    if subdivided:
        visible = replace(visible, normals=_smooth(visible))
    return Faces(visible, rows, subdivided)


def _fitting(counts: np.ndarray, indices: np.ndarray, diagnostics: Diagnostics, span: Span) -> tuple[np.ndarray, np.ndarray]:
    """Face counts that add up to the indices, and the indices; see `stage.fitted_counts`."""
    fitted = stage.fitted_counts(counts, len(indices), ("the face counts", "indices", "faces"), diagnostics, span)
    return fitted, indices[: fitted.sum()]


def topology(prim: Any, time: Any) -> tuple[np.ndarray, np.ndarray]:
    """(face counts, indices) of a Mesh, or of the surface of a TetMesh: its own surface triangles, else those of one tetrahedron alone."""
    if str(prim.GetTypeName()) != "TetMesh":
        schema = UsdGeom.Mesh(prim)
        counts, indices = schema.GetFaceVertexCountsAttr(), schema.GetFaceVertexIndicesAttr()
        return stage.numbers(counts, time, np.int64), stage.numbers(indices, time, np.int64)
    triangles = stage.numbers(prim.GetAttribute("surfaceFaceVertexIndices"), time, np.int64, 3)
    if not len(triangles):
        corners = stage.numbers(prim.GetAttribute("tetVertexIndices"), time, np.int64, 4)
        sides = corners[:, [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]]].reshape(-1, 3)  # outward for a right-handed tetrahedron
        _, first, number = np.unique(np.sort(sides, axis=1), axis=0, return_index=True, return_counts=True)
        triangles = sides[np.sort(first[number == 1])]
    return np.full(len(triangles), 3), triangles.reshape(-1)


def _refined(
    polygons: polygon_mesh.PolyMesh, drawn: np.ndarray, scheme: subdivision.Scheme, level: int, diagnostics: Diagnostics, span: Span
) -> tuple[polygon_mesh.PolyMesh, np.ndarray] | None:  # fmt: skip
    """The refined faces of a subdivision surface and the prim's face of each; None if they cannot be refined, with a warning."""
    faces = np.flatnonzero(drawn & (np.asarray(polygons.counts) > 2))
    cage = polygon_mesh.subset(polygons, faces)
    if not len(faces):
        return None
    if scheme.name == "loop" and (np.asarray(cage.counts) != 3).any():
        diagnostics.warning("the scheme loop subdivides triangles alone, and this mesh has other faces: its cage is drawn", span)
        return None
    possible = subdivision.levels_within(len(faces), len(cage.indices), level, scheme.name)
    if possible < level:
        message = f"{level} refinements of {len(faces):,} faces are too many: it is refined {possible} times"
        diagnostics.warning(message, span)
    if not possible:
        return None
    refined, parents = subdivision.refine(cage, scheme, possible)
    return refined, faces[parents]


def _is_varying(api: Any, name: str) -> bool:
    source = api.FindPrimvarWithInheritance(name)
    return bool(source) and str(source.GetInterpolation()) == "varying"


def _scheme(schema: Any, time: Any) -> subdivision.Scheme:
    """How a Mesh prim is subdivided. A crease is a chain of vertices with one sharpness, or one for each of its edges."""

    def numbers(attribute: Any, kind: type) -> np.ndarray:
        return stage.numbers(attribute, time, kind)

    chain, lengths = numbers(schema.GetCreaseIndicesAttr(), np.int64), numbers(schema.GetCreaseLengthsAttr(), np.int64)
    sharpness = numbers(schema.GetCreaseSharpnessesAttr(), np.float64)
    edges = np.zeros((0, 2), np.int64)
    if len(lengths) and (lengths > 1).all() and lengths.sum() == len(chain):
        ends = np.cumsum(lengths) - 1
        edges = np.delete(np.stack([chain[:-1], chain[1:]], axis=1), ends[:-1], axis=0)
        sharpness = np.repeat(sharpness, lengths - 1) if len(sharpness) == len(lengths) else sharpness
    if len(sharpness) != len(edges):
        edges, sharpness = np.zeros((0, 2), np.int64), np.zeros(0)
    corners, of_corners = numbers(schema.GetCornerIndicesAttr(), np.int64), numbers(schema.GetCornerSharpnessesAttr(), np.float64)
    sound = len(corners) == len(of_corners)
    return subdivision.Scheme(
        str(schema.GetSubdivisionSchemeAttr().Get(time)), edges, sharpness,
        corners if sound else np.zeros(0, np.int64), of_corners if sound else np.zeros(0),
        str(schema.GetInterpolateBoundaryAttr().Get(time)), str(schema.GetFaceVaryingLinearInterpolationAttr().Get(time)),
        str(schema.GetTriangleSubdivisionRuleAttr().Get(time)) == "smooth",
    )  # fmt: skip


def _smooth(mesh: polygon_mesh.PolyMesh) -> MeshAttribute:
    """Smooth normals of a whole control cage, computed before it is split by material."""
    cut = triangulate.faces(mesh.points, mesh.indices, mesh.counts)
    return MeshAttribute(vertex_normals.vertex_normals(mesh.points, np.asarray(mesh.indices)[cut.corners]))


def _valid_indices(indices: np.ndarray, points: np.ndarray) -> np.ndarray:
    inside = (indices >= 0) & (indices < len(points))
    if not np.isfinite(points).all():
        inside[inside] = np.isfinite(points[indices[inside]]).all(axis=1)
    return inside


def _normals(
    schema: Any, api: Any, time: Any, points: int, counts: np.ndarray, diagnostics: Diagnostics, span: Span
) -> MeshAttribute | None:
    """Normals from primvars:normals, else from normals."""
    authored = api.GetPrimvar("normals")
    if authored and authored.HasValue():
        return primvar(api, "normals", time, 3, points, counts, diagnostics, span)
    values = stage.numbers(schema.GetNormalsAttr(), time, np.float32, 3)
    if not len(values):
        return None
    return _attribute("normals", values, str(schema.GetNormalsInterpolation()), points, counts, diagnostics, span)


def primvar(
    api: Any, name: str, time: Any, width: int, points: int, counts: np.ndarray, diagnostics: Diagnostics, span: Span
) -> MeshAttribute | None:
    """A mesh's own or inherited primvar, indices resolved. None if absent, or if its size does not fit (with a warning)."""
    source = api.FindPrimvarWithInheritance(name)
    if not source or not source.HasValue():
        return None
    flat = stage.flattened(source, time)
    if flat is None:
        diagnostics.warning(f"the indices of the primvar `{name}` do not fit it: it is left out", span)
        return None
    try:
        values = np.array(flat, dtype=np.float32)
    except (TypeError, ValueError):
        values = np.zeros((1, 0), np.float32)
    values = values.reshape(len(values), -1) if values.size else values.reshape(-1, width)
    if values.shape[1] == 1 and width == 3:
        values = np.repeat(values, 3, axis=1)
    if values.shape[1] < width:
        diagnostics.warning(f"the primvar `{name}` has the wrong type: it is left out", span)
        return None
    values = stage.linear(source.GetAttr(), values[:, :width])
    return _attribute(name, values, str(source.GetInterpolation()), points, counts, diagnostics, span)


def _attribute(
    name: str, values: np.ndarray, interpolation: str, points: int, counts: np.ndarray, diagnostics: Diagnostics, span: Span
) -> MeshAttribute | None:
    kind = _INTERPOLATIONS.get(interpolation, _At.CONSTANT)
    wanted = {_At.CONSTANT: 1, _At.FACE: len(counts), _At.VERTEX: points, _At.CORNER: int(counts.sum())}[kind]
    if len(values) != wanted:
        if len(values) == 1:
            return MeshAttribute(values, _At.CONSTANT)
        diagnostics.warning(
            f"`{name}` has {len(values)} values where its interpolation `{interpolation}` needs {wanted}: it is left out", span
        )
        return None
    if not np.isfinite(values).all():
        diagnostics.warning(f"`{name}` has values that are not finite: NaN counts as 0", span)
    return MeshAttribute(np.nan_to_num(values), kind)


def row(part: polygon_mesh.PolyMesh | None, builder: SceneBuilder, span: Span, name: str) -> int:
    """The builder's row of a mesh; NONE if no face has area."""
    if part is None or not len(part.counts):
        return NONE
    assembled, dropped = polygon_mesh.assemble(part, 0.0, name)
    if dropped:
        builder.diagnostics.note(f"{dropped} of {len(part.counts)} faces have no area: they are left out", span)
    return builder.mesh(assembled, span, name) if len(assembled.triangles) else NONE
