"""Warns of lights enclosed in opaque solids, which light nothing outside."""

from __future__ import annotations

import math

import numpy as np

from ...lang.diagnostics import Diagnostics
from ...lights import PLACED, POINTS, RECTANGLES, SPHERES
from ...materials import traits
from ...materials.contract import Lobes
from ...shapes import SHAPES
from .. import ir
from ..formula import numpy_interpreter, solid_fields
from ..formula.builder import Builder
from ..formula.tape import load_tape
from ..ir import light_links

AHEAD = 1e-6  # distance in front of the eye, relative to that from the origin and in metres, where enclosure is tested
MOST_LIGHTS = 64  # lights that are tested
MOST_TRIANGLES = 1 << 20  # times points, of all meshes: a fifth of a second


def warn_of_enclosed_lights(scene: ir.Scene, diagnostics: Diagnostics) -> None:
    """Warn of each light in a closed opaque instance that the first camera is outside of."""
    tables = scene.tables
    lights = tables.lights
    rows = np.flatnonzero(ir.is_in(lights.kind, PLACED) & lights.shadows & ~light_links.selective(tables))[:MOST_LIGHTS]
    if not len(rows) or not len(tables.cameras.transform):
        return
    boxes = [corners(tables, int(row)) for row in rows]
    frame = tables.transforms.matrix[tables.cameras.transform[0]]
    eye = frame[:, 3] - frame[:, 2] * (AHEAD * (1.0 + np.linalg.norm(frame[:, 3])))
    remaining = MOST_TRIANGLES
    for instance in dark_inside(tables).tolist():
        g = int(tables.instances.geometry[instance])
        inverse = tables.transforms.inverse[tables.instances.transform[instance]]
        low, high = tables.geometries.bounds[g]
        local_points = [points @ inverse[:, :3].T + inverse[:, 3] for points in boxes]
        within = [((points > low) & (points < high)).all() for points in local_points]
        near = [k for k in range(len(rows)) if within[k] and lights.instance[rows[k]] != instance]
        if not near:
            continue
        triangle_count = int(tables.geometries.triangle_count[g])
        remaining -= triangle_count
        if remaining < 0:
            return
        if inside(tables, g, (inverse[:, :3] @ eye + inverse[:, 3])[None])[0]:
            continue
        for k in near:
            remaining -= triangle_count * len(local_points[k])
            if remaining < 0:
                return
            if inside(tables, g, local_points[k]).all():
                hint = "move it out, or make that of glass, or write `shadows: false`"
                span = scene.spans.get("lights", int(rows[k]))
                diagnostics.warning("this light is inside of an opaque solid: nothing outside is lit by it", span, hint)


_AROUND = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], np.float64)
_SQUARE = np.array([[1, 0, 1], [1, 0, -1], [-1, 0, 1], [-1, 0, -1], [1, 0, 0], [0, 0, 1]], np.float64)


def corners(tables: ir.Tables, row: int) -> np.ndarray:
    """Points (n, 3) of a light in the world, which stand for all of it; one for a light without extent."""
    lights = tables.lights
    kind, (x, z) = lights.kind[row], lights.size[row].tolist()
    if kind in POINTS:
        return lights.position[row][None]
    local = _SQUARE * [x, 0.0, z] if kind in RECTANGLES else _AROUND * [x, x if kind in SPHERES else 0.0, x]
    matrix = tables.transforms.matrix[lights.transform[row]]
    return local @ matrix[:, :3].T + matrix[:, 3]


def opaque(tables: ir.Tables) -> np.ndarray:
    """Rows of opaque instances that cast shadows, without shapes of lights (light_shapes.py) and blends of materials."""
    instances = tables.instances
    through = traits.passes_light(tables) | traits.has(tables, Lobes.PARTS)
    return np.flatnonzero((instances.visible & ir.Visibility.SHADOW != 0) & (instances.light < 0) & ~through[instances.material])


def dark_inside(tables: ir.Tables) -> np.ndarray:
    """Rows of opaque instances through which no light scatters, either; wax and paper glow with a lamp inside."""
    rows = opaque(tables)
    return rows[~traits.translucent(tables)[tables.instances.material[rows]]]


def inside(tables: ir.Tables, g: int, points: np.ndarray) -> np.ndarray:
    """Whether points (n, 3) in a geometry's frame are inside of it; False for open geometries."""
    kind, parameters = tables.geometries.kind[g], tables.geometries.parameters[g]
    if kind == ir.GeometryKind.MESH:
        return _in_mesh(tables, g, points)
    if kind == ir.GeometryKind.FORMULA:
        if parameters[0]:
            return np.zeros(len(points), np.bool_)
        tape = load_tape(tables, int(tables.geometries.tape[g]))
    else:
        builder = Builder()
        try:
            tape = builder.finish(SHAPES[int(kind)].field(builder, parameters.tolist(), (0, 1, 2)))
        except solid_fields.NoSolid:
            return np.zeros(len(points), np.bool_)
    with np.errstate(all="ignore"):
        below = np.broadcast_to(numpy_interpreter.points(tape, *points.T)[0], len(points)) < 0.0
    if kind == ir.GeometryKind.FORMULA and parameters[4] > 0.0:
        below = below & (np.linalg.norm(points - parameters[1:4], axis=1) < parameters[4])
    return below


def _in_mesh(tables: ir.Tables, g: int, points: np.ndarray) -> np.ndarray:
    """By the winding number: the solid angle of all triangles over 4π, 1 inside of a closed mesh (van Oosterom 1983)."""
    first = int(tables.geometries.first_triangle[g])
    rows = tables.pools.triangles[first : first + int(tables.geometries.triangle_count[g])]
    corners = tables.pools.positions[rows].astype(np.float64) + tables.geometries.origin[g]
    inside = np.zeros(len(points), np.bool_)
    for k, point in enumerate(points):
        a, b, c = (corners - point).transpose(1, 0, 2)
        la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
        over = np.einsum("ij,ij->i", a, np.cross(b, c))
        under = la * lb * lc + np.einsum("ij,ij->i", a, b) * lc + np.einsum("ij,ij->i", b, c) * la + np.einsum("ij,ij->i", c, a) * lb
        inside[k] = abs(np.arctan2(over, under).sum() / (2.0 * math.pi)) > 0.99
    return inside
