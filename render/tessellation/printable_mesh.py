"""Closed triangle meshes of a whole scene, for 3D printing; diagnostics name open and missing parts."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.formula import dual_contouring
from ...compiler.formula.tape import load_tape
from ...compiler.mesh import mesh_csg, shells
from ...compiler.mesh.parts import Part
from ...lang.diagnostics import Diagnostic
from ...shapes import SHAPES
from ..geometry.bounds import world_bounds
from . import analytic_shapes, implicit_surfaces
from .part_materials import material_of, triangle_materials

RESOLUTION = 2000  # the default tolerance is the scene's extent over this
_KIND = ir.GeometryKind
_OPEN = {
    **{kind: shape.OPEN for kind, shape in SHAPES.items()},
    _KIND.MESH: ("is a mesh with gaps", ""),
    _KIND.FORMULA: ("is a sheet", "with <= in place of == it is a solid, and `abs(...) <= thickness` is a thick sheet"),
}
_CROWDED = ("touches itself", "")


class _LocalMesh(NamedTuple):
    """A geometry in its own frame."""

    positions: NDArray[np.float64]  # (n, 3)
    triangles: NDArray[np.int64]  # (m, 3)
    off: float  # the largest distance from the true surface
    thin: float = 0.0  # parts thinner than this are missing
    colors: NDArray[np.float64] | None = None  # (m, 3, 3) of the corners of triangles


def printable_parts(scene: ir.Scene, tolerance: float | None = None, share: float = math.inf) -> tuple[list[Part], list[Diagnostic]]:
    """Meshes of a scene's bounded instances in the world, within `tolerance` metres where possible; and diagnostics.

    `share` of the longest side of its own box limits the tolerance of each instance, too. Diagnostics name meshes that are open and
    instances that are left out: lights and unbounded shapes. Deviations of solids of formulas are the largest ones at samples of their
    triangles.
    """
    tables, diagnostics, parts = scene.tables, [], []
    boxes, light, ends = _boxes(tables)
    tolerance = default_tolerance(scene) if tolerance is None else tolerance
    for i in range(len(boxes)):
        name = scene.names.instances[i] if i < len(scene.names.instances) else ""
        label = f"`{name}`" if name else "an object"

        def say(severity: str, message: str, hint: str = "", row: int = i) -> None:
            diagnostics.append(Diagnostic(severity, message, scene.spans.get("instances", row), hint))

        if light[i] or not ends[i]:
            say("note", f"{label} is {'a light' if light[i] else 'unbounded'} and is left out")
            continue
        side = float((boxes[i, 3:] - boxes[i, :3]).max())
        part = _part(tables, i, name or f"part{i}", min(tolerance, share * side) if side > 0.0 else tolerance)
        if part.missing > 0.0:
            missing = "thinner parts are missing" if len(part.triangles) else "it is thinner and is left out"
            hint = "a smaller box as `within` has smaller cells"
            say("warning", f"{label} is sampled in cells of {part.missing * 1000:.3g} mm: {missing}", hint)
        if len(part.triangles):
            parts.append(_with_materials(scene, i, part))
        if part.open_edges:
            why, hint = _why_open(tables, i, part)
            say("warning", f"{label} {why}: {part.open_edges} of its edges do not have one triangle on each side", hint)
    return parts, diagnostics


def default_tolerance(scene: ir.Scene) -> float:
    """The extent of the bounded instances over RESOLUTION, of lights only where there are no others; 0 without any."""
    boxes, light, ends = _boxes(scene.tables)
    bounded = boxes[ends & ~light] if (ends & ~light).any() else boxes[ends]
    return float((bounded[:, 3:].max(axis=0) - bounded[:, :3].min(axis=0)).max()) / RESOLUTION if len(bounded) else 0.0


def _boxes(tables: ir.Tables) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_]]:
    """(bounding boxes of the instances, whether each is a light, whether it is bounded)"""
    boxes = world_bounds(tables)
    light = np.asarray(np.isin(np.arange(len(boxes)), tables.lights.instance))
    return boxes, light, np.asarray(np.isfinite(boxes).all(axis=1))


def _with_materials(scene: ir.Scene, i: int, part: Part) -> Part:
    """The part with the materials of its triangles, in the order of their rows."""
    rows = triangle_materials(scene.tables, i, part.positions[part.triangles].mean(axis=1))
    used, material = np.unique(rows, return_inverse=True)
    materials = tuple(material_of(scene, row) for row in used.tolist())
    return part._replace(materials=materials, material=material.reshape(-1), instance=i, rows=tuple(used.tolist()))


def _why_open(tables: ir.Tables, i: int, part: Part) -> tuple[str, str]:
    g = tables.instances.geometry[i]
    kind = _KIND(int(tables.geometries.kind[g]))
    solid = kind == _KIND.FORMULA and tables.geometries.parameters[g, 0] == 0
    bare = (mesh_csg.edges(part.triangles) == 1).any()
    return _OPEN[kind] if bare and not solid else _CROWDED


def _part(tables: ir.Tables, i: int, name: str, tolerance: float) -> Part:
    """The mesh of an instance."""
    g, row = int(tables.instances.geometry[i]), int(tables.instances.transform[i])
    matrix = tables.transforms.matrix[row]
    largest = float(np.linalg.norm(matrix[:, :3], 2))
    local = _local_mesh(tables, g, tolerance / largest)
    positions, triangles, colors = local.positions, local.triangles, local.colors
    if tables.geometries.kind[g] != _KIND.FORMULA:  # merge the vertices duplicated at creases and seams
        positions, index = np.unique(np.round(positions, 15), axis=0, return_inverse=True)
        triangles = index.reshape(-1)[triangles]
        distinct = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
        triangles, colors = triangles[distinct], None if colors is None else colors[distinct]
    if tables.transforms.flips[row]:
        triangles, colors = triangles[:, ::-1], None if colors is None else colors[:, ::-1]
    positions = positions @ matrix[:, :3].T + matrix[:, 3]
    leaks = dual_contouring.open_edges(triangles)
    kind = tables.geometries.kind[g]
    part = Part(name, positions, triangles, local.off * largest, leaks, colors=colors, is_mesh=bool(kind == _KIND.MESH))
    return part._replace(is_contour=bool(kind == _KIND.FORMULA), missing=local.thin * largest)


def _local_mesh(tables: ir.Tables, g: int, tolerance: float) -> _LocalMesh:
    geometries, kind = tables.geometries, int(tables.geometries.kind[g])
    if kind == _KIND.MESH:
        positions, triangles = ir.mesh_arrays(tables, g)
        tint = int(geometries.colors[g])
        colors = None if tint < 0 else shells.at_corners(tables, tint, triangles)
        positions = positions.astype(np.float64) + geometries.origin[g]
        return _LocalMesh(positions, triangles.astype(np.int64), float(geometries.parameters[g, 0]), colors=colors)
    if kind == _KIND.FORMULA:
        tape = load_tape(tables, int(geometries.tape[g]))
        contour = implicit_surfaces.contour(tables, g, mesh_csg.CONTOUR_SHARE * tolerance, True)
        return _LocalMesh(*mesh_csg.simplify(tape, contour, tolerance), contour.missing)
    mesh = analytic_shapes.tessellate(kind, geometries.parameters[g].tolist(), tolerance)
    off = analytic_shapes.deviation(kind, geometries.parameters[g].tolist(), tolerance, mesh)
    return _LocalMesh(mesh.positions[:, :3], mesh.triangles.astype(np.int64), off)
