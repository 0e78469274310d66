"""Whether the camera is in a room that sees little of the sky, and whether light samples of the sky aim at its openings.

See render/light/sky_openings.py.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...lights import DISTANT, SKIES
from ...materials import traits
from ...shapes import SHAPES
from .. import ir
from ..formula import numpy_interpreter, solid_fields
from ..formula.builder import Builder
from ..formula.tape import Tape, load_tape
from ..ir import light_links
from .decision import Plan

LEARNT = ("learnt", "none")
MOST_SEEN = 0.25  # share of all directions that see the sky from places around the camera, above which a room counts as open
RAYS = 384  # from each place
PLACES = 7  # beside the camera
MOST_TRIANGLES = 4096  # of a mesh that is tested exactly; larger ones count as their boxes, and not at all from inside
MOST_OBJECTS = 1000  # of a scene that is searched for openings: a few milliseconds for a hundred
OPEN = 0.6  # share of directions that see the sky from the camera, above which no other place is asked
MARGIN = 0.02  # of a room's size, between its walls and its box
_BOXES = (ir.GeometryKind.MESH, *(kind for kind, shape in SHAPES.items() if shape.EXACT or shape.FLAT))
"""Kinds that are about their boxes, or that have triangles."""
_STEPS = 96  # along a ray through a shape's box, in search of its surface
_FAR = 1e3  # metres that such a ray goes in a surface without bounds


class Room(NamedTuple):
    """What surrounds a camera."""

    low: np.ndarray  # (3,) corners of the box of what most rays hit
    high: np.ndarray
    seen: float  # share of directions that see the sky


def indoors(scene: ir.Scene, plan: Plan) -> tuple[bool, str]:
    """(whether the camera is in a room that sees little of the sky, reason)."""
    if plan["transport"] != "path":
        return False, "there are no random paths"
    if not _has_sky(scene.tables):
        return False, "no sky casts shadows"
    if len(scene.tables.instances.geometry) > MOST_OBJECTS:
        return False, f"more than {MOST_OBJECTS:,} objects are not searched for a room"
    seen = find_room(scene.tables, plan["camera"]).seen
    return seen <= MOST_SEEN, f"places around the camera see the sky in {100.0 * seen:.2g} % of all directions"


def _has_sky(tables: ir.Tables) -> bool:
    lit = tables.lights
    return bool((ir.is_in(lit.kind, SKIES) & lit.shadows & lit.color.any(axis=1)).any())


def learnt(scene: ir.Scene, plan: Plan) -> tuple[str, str, tuple[str, ...]]:
    """(value, reason, choices) of the decision."""
    why, lit = "", scene.tables.lights
    if plan["transport"] != "path" or not _has_sky(scene.tables):
        why = plan.decisions["indoors"].reason if not plan["indoors"] else "no sky casts shadows"
    elif not plan["indoors"]:
        why = f"the camera is not in a room: {plan.decisions['indoors'].reason}"
    elif plan["backend"] != "ray":
        why = "the reference backend samples the whole sky"
    elif (ir.is_in(lit.kind, DISTANT) & lit.color.any(axis=1)).any():
        why = "a sun lights the scene: what its patches of light send on has most of the noise"
    elif traits.participates(scene.tables):
        why = "light scatters inside of media"
    elif plan["motion_blur"]:
        why = "objects move"
    elif light_links.are_there(scene.tables):
        why = "some light lights some surfaces only"
    if why:
        return "none", why, LEARNT[1:]
    return "learnt", f"{plan.decisions['indoors'].reason}: light samples aim at openings", LEARNT


def find_room(tables: ir.Tables, camera: int) -> Room:
    """The room around a camera, by rays to the boxes of instances and to the triangles of small meshes."""
    eye = tables.transforms.matrix[tables.cameras.transform[camera], :, 3]
    directions = even_directions(RAYS)
    reach = first_hits(tables, eye, directions)
    hit = np.flatnonzero(np.isfinite(reach))
    if len(hit) <= (1.0 - OPEN) * len(reach):
        return Room(eye, eye, 1.0 - len(hit) / len(reach))
    some = hit[:: max(len(hit) // PLACES, 1)][:PLACES]
    places = eye + 0.5 * reach[some, None] * directions[some]
    points, seen = [eye + reach[hit, None] * directions[hit]], [float(np.mean(~np.isfinite(reach)))]
    for place in places:
        reach = first_hits(tables, place, directions)
        hit = np.flatnonzero(np.isfinite(reach))
        points.append(place + reach[hit, None] * directions[hit])
        seen.append(float(np.mean(~np.isfinite(reach))))
    low, high = np.percentile(np.concatenate(points), [1, 99], axis=0)
    margin = MARGIN * (high - low) + 1e-6
    return Room(low - margin, high + margin, float(np.mean(seen)))


def even_directions(count: int) -> np.ndarray:
    """(count, 3) directions of a Fibonacci spiral over the sphere."""
    k = np.arange(count) + 0.5
    y, turn = 1.0 - 2.0 * k / count, np.pi * (1.0 + 5.0**0.5) * k
    across = np.sqrt(1.0 - y * y)
    return np.stack([across * np.cos(turn), y, across * np.sin(turn)], axis=1)


def first_hits(tables: ir.Tables, origin: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """(n,) distances along rays from a place to the first shadow caster; inf: none."""
    instances = tables.instances
    casts = (instances.visible & ir.Visibility.SHADOW != 0) & (instances.light < 0) & ~traits.partial(tables)[instances.material]
    return hits(tables, origin, directions, casts)[0]


def hits(
    tables: ir.Tables, origin: np.ndarray, directions: np.ndarray, casts: np.ndarray, exact: bool = True,
    round_too: bool = False, large: tuple[int, ...] = (),
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """((n,) distances along rays from a place to the first of the instances `casts`, inf: none; (n,) its row).

    Without `exact`, all shapes are their boxes, from inside of them, too. With `round_too`, round shapes and formulas are not their boxes.
    The triangles of `large` rows are tested whatever their number.
    """
    instances, geometries = tables.instances, tables.geometries
    reach, rows = np.full(len(directions), np.inf), np.zeros(len(directions), np.int64)
    for row in np.flatnonzero(casts).tolist():
        g, inverse = int(instances.geometry[row]), tables.transforms.inverse[instances.transform[row]]
        o, d = inverse[:, :3] @ origin + inverse[:, 3], directions @ inverse[:, :3].T
        near = _box_hits(geometries.bounds[g], o, d, not exact or bool(geometries.kind[g] == ir.GeometryKind.BOX))
        tested = geometries.triangle_count[g] <= MOST_TRIANGLES or row in large
        if exact and geometries.kind[g] == ir.GeometryKind.MESH and tested:
            inside = bool(((o > geometries.bounds[g][0]) & (o < geometries.bounds[g][1])).all())
            some = np.flatnonzero(np.isfinite(near)) if not inside else np.arange(len(d))
            near = np.full(len(d), np.inf)
            near[some] = _triangle_hits(tables, g, o, d[some])
        if round_too and geometries.kind[g] not in _BOXES and (tape := _field_of(tables, g)) is not None:
            near = _field_hits(tape, geometries.bounds[g], o, d)
        rows = np.where(near < reach, row, rows)
        reach = np.minimum(reach, near)
    return reach, rows


def _box_hits(bounds: np.ndarray, o: np.ndarray, d: np.ndarray, solid: bool) -> np.ndarray:
    """(n,) distances to a box; from inside of it those to its far side if it is `solid`, else inf."""
    with np.errstate(all="ignore"):
        lower, upper = (bounds[0] - o) / d, (bounds[1] - o) / d
        near, far = np.fmin(lower, upper).max(axis=1), np.fmax(lower, upper).min(axis=1)
    hit = (near <= far) & (far > 0.0)
    return np.where(hit & (near > 0.0), near, np.where(hit & solid, far, np.inf))


def _field_of(tables: ir.Tables, g: int) -> Tape | None:
    """The formula that is negative inside of a shape; None for surfaces that enclose nothing."""
    if tables.geometries.kind[g] == ir.GeometryKind.FORMULA:
        return load_tape(tables, int(tables.geometries.tape[g]))
    builder = Builder()
    try:
        kind, parameters = int(tables.geometries.kind[g]), tables.geometries.parameters[g].tolist()
        return builder.finish(SHAPES[kind].field(builder, parameters, (0, 1, 2)))
    except solid_fields.NoSolid:
        return None


def _field_hits(tape: Tape, bounds: np.ndarray, o: np.ndarray, d: np.ndarray) -> np.ndarray:
    """(n,) about the distances to where a formula changes sign within a box, between steps."""
    distances = np.full(len(d), np.inf)
    with np.errstate(all="ignore"):
        lower, upper = (bounds[0] - o) / d, (bounds[1] - o) / d
        near, far = np.fmin(lower, upper).max(axis=1), np.fmax(lower, upper).min(axis=1)
        rows = np.flatnonzero((near <= far) & (far > 0.0))
        near = np.clip(np.where(np.isfinite(near), near, 0.0), 0.0, None)[rows]
        far = np.where(np.isfinite(far), far, _FAR / np.linalg.norm(d, axis=1))[rows]
        t = near[:, None] + (far - near)[:, None] * np.linspace(0.0, 1.0, _STEPS)
        places = o + t[..., None] * d[rows, None]
        value = numpy_interpreter.points(tape, *places.reshape(-1, 3).T)[0]
        inside = np.broadcast_to(value, t.size).reshape(t.shape) < 0.0
    changes = inside[:, 1:] != inside[:, :-1]
    if len(rows):
        first = np.take_along_axis(t, changes.argmax(axis=1)[:, None] + 1, 1)[:, 0]
        distances[rows] = np.where(changes.any(axis=1), first, np.where(inside[:, 0] & (near > 0.0), near, np.inf))
    return distances


def _triangle_hits(tables: ir.Tables, g: int, o: np.ndarray, d: np.ndarray) -> np.ndarray:
    """(n,) distances to the triangles of a mesh (Möller and Trumbore 1997)."""
    first = int(tables.geometries.first_triangle[g])
    rows = tables.pools.triangles[first : first + int(tables.geometries.triangle_count[g])]
    a, b, c = (tables.pools.positions[rows].astype(np.float64) + tables.geometries.origin[g]).transpose(1, 0, 2)
    edge1, edge2, off = b - a, c - a, o - a
    across = np.cross(off, edge1)
    nearest = np.full(len(d), np.inf)
    with np.errstate(all="ignore"):
        for k, way in enumerate(d):
            p = np.cross(way, edge2)
            determinant = np.einsum("ij,ij->i", edge1, p)
            u, v = np.einsum("ij,ij->i", off, p) / determinant, across @ way / determinant
            t = np.einsum("ij,ij->i", edge2, across) / determinant
            nearest[k] = np.min(t[(u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (t > 0.0)], initial=np.inf)
    return nearest
