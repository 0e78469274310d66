"""Emitters: everything that paths look for light at, one row each: lamps, shining shapes and the triangles of shining meshes.

`sample` draws a point of one emitter, or a direction to it, for each lane; `density` says how likely the same direction was for a ray
that met it by chance, so that both ways of finding light can be weighed against each other (Veach 1997, chapter 9).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.plan import scene_facts
from ..jit.kernel import helper
from ..lanes import ops
from ..types import Lane, Tables, Vec
from . import environment_map, light_tree, lights, rectangle_solid_angle, shape_solid_angle

POINT, SPOT, DIRECTIONAL, SUN = lights.POINT, lights.SPOT, lights.DIRECTIONAL, lights.SUN
SKY, DOME, RECTANGLE, DISK, SPHERE = lights.SKY, lights.DOME, lights.RECTANGLE, lights.DISK, lights.SPHERE
TRIANGLE, TUBE = 20, 21  # one of a shining mesh, a shining cylinder's side; the other kinds are LightKind's
MOST_TRIANGLES = 1 << 17  # of shining meshes that are sampled; rays still meet the others
_AREAS = (RECTANGLE, DISK, SPHERE)
_FAR = (DIRECTIONAL, SUN, DOME)


class Emitters(NamedTuple):
    """Rows of emitters, in the world; those that are endlessly far stand first."""

    kind: NDArray[np.int32]
    place: NDArray[np.float64]  # (n, 3) a plate's or ball's middle, a triangle's first corner, a point light's position
    side_u: NDArray[np.float64]  # (n, 3) a plate's half edges or disk's radii; a triangle's two edges; column 0: a ball's or tube's radius
    side_v: NDArray[np.float64]  # (n, 3); of a tube half its length, along its axis
    normal: NDArray[np.float64]  # (n, 3) where a plate or triangle shines to, a tube's axis; where far light comes from, a spot's axis
    area: NDArray[np.float64]
    color: NDArray[np.float64]  # (n, 3) radiance, or what Lights.color is
    both: NDArray[np.bool_]  # shines to both sides
    square: NDArray[np.bool_]  # a rectangle whose sides are at right angles, a disk whose radii are, and equal
    light: NDArray[np.int32]  # row of Lights, or -1
    shadows: NDArray[np.bool_]
    weighed: NDArray[np.bool_]  # rays that go on may meet it, too: both ways are weighed
    first: NDArray[np.int32]  # (instances,) the row of an instance's first part, or -1
    parts: NDArray[np.int32]  # (instances,) what is taken from a hit's primitive to count from `first`
    tree: light_tree.Tree  # which of them a place looks to
    sky: Any  # sky_map.SkyMap or Even
    wide: shape_solid_angle.Wide  # what is drawn by its solid angle beside rectangles and balls


class Reached(NamedTuple):
    """A point of an emitter with an extent, as seen from a place."""

    direction: Vec
    distance: Lane
    angle: Lane  # 1 over the density of the direction, a solid angle; 0 where no light comes from
    cosine: Lane  # between the direction and the surface there


class Arriving(NamedTuple):
    """One sample of an emitter, as seen from a point."""

    direction: Vec
    distance: Lane  # inf: endlessly far
    light: Vec  # what a surface facing it gets, over the density: samples average to the irradiance
    density: Lane  # of the direction, a solid angle; inf where there is only one
    cosine: Lane  # between the direction and the surface that is seen there; 1 where there is none


def build(tables: ir.Tables, moves: bool = False, horizon: NDArray[np.float64] | None = None) -> Emitters:
    """The emitters of a scene. An even sky is none: rays that leave the scene see it, as often as any sampling could.

    With `moves`, things that have keys move: rays meet those that shine by chance. Nothing comes from below a `horizon`.
    """
    rows: list[dict[str, Any]] = []
    sky = environment_map.build(tables, 0, horizon)
    if isinstance(sky, environment_map.SkyMap):
        rows.append(_row(kind=DOME, color=np.full(3, sky.power), light=int(np.flatnonzero(tables.lights.kind == ir.LightKind.DOME)[0]),
                         weighed=True))  # fmt: skip
    instances = tables.instances
    first = np.full(len(instances.geometry), -1, np.int32)
    parts = np.zeros(len(instances.geometry), np.int32)
    order = sorted(range(len(tables.lights.kind)), key=lambda k: tables.lights.kind[k] not in _FAR)
    for k in order:
        kind = tables.lights.kind[k]
        if kind in (ir.LightKind.AMBIENT, ir.LightKind.SKY, ir.LightKind.DOME) or not tables.lights.color[k].any():
            continue
        if kind in _AREAS:
            i = int(tables.lights.instance[k])
            if i >= 0:
                first[i] = len(rows)
            rows.append(_area(tables, k, i))
        else:
            axis = -tables.lights.direction[k] if kind == ir.LightKind.SPOT else tables.lights.direction[k]
            rows.append(
                _row(kind=kind, place=tables.lights.position[k], normal=axis, color=tables.lights.color[k], light=k,
                     shadows=tables.lights.shadows[k])
            )  # fmt: skip
    still = ~moves | (tables.transforms.first_key[instances.transform] < 0)
    for i in np.flatnonzero(_shining(tables) & still & (instances.light < 0)):
        made = _shape(tables, int(i))
        if made:
            first[i], parts[i] = len(rows), made[0].pop("part")
            rows.extend({name: value for name, value in row.items() if name != "part"} for row in made)
    return _table(tables, rows, first, parts, sky)


def _row(**known: Any) -> dict[str, Any]:
    nothing = np.zeros(3)
    base = {"place": nothing, "side_u": nothing, "side_v": nothing, "normal": np.array([0.0, 1.0, 0.0]), "area": 0.0, "both": False,
            "square": False, "light": -1, "shadows": True, "weighed": False}  # fmt: skip
    return base | known


def _area(tables: ir.Tables, k: int, instance: int) -> dict[str, Any]:
    lit = tables.lights
    seen = instance >= 0 and bool(tables.instances.visible[instance] & ir.Visibility.REFLECTION)
    weighed = bool(lit.shadows[k]) and seen
    matrix = tables.transforms.matrix[lit.transform[k]]
    flips = bool(tables.transforms.flips[lit.transform[k]])
    both = lit.kind[k] == ir.LightKind.SPHERE
    return _plate(int(lit.kind[k]), matrix, flips, lit.size[k], lit.color[k], both, light=k, shadows=lit.shadows[k], weighed=weighed)


def _plate(kind: int, matrix: Any, flips: bool, size: Any, color: Any, both: bool, **more: Any) -> dict[str, Any]:
    """A rectangle, disk or ball in a frame."""
    x, z = matrix[:, 0], matrix[:, 2]
    if kind == SPHERE:
        radius = float(size[0]) * float(np.linalg.norm(x))
        return _row(kind=kind, place=matrix[:, 3], side_u=np.array([radius, 0.0, 0.0]), area=4.0 * math.pi * radius**2, color=color,
                    both=both, **more)  # fmt: skip
    face = np.array(ops.cross(tuple(z), tuple(x))) * (-1.0 if flips else 1.0)  # np.cross takes ten times as long
    stretch = math.sqrt(float(face @ face))
    half = (size[0], size[0]) if kind == DISK else (size[0], size[1])
    area = stretch * (math.pi * half[0] ** 2 if kind == DISK else 4.0 * half[0] * half[1])
    square = abs(float(x @ z)) <= 1e-6 * stretch and (kind == RECTANGLE or abs(float(x @ x - z @ z)) <= 1e-6 * stretch)
    return _row(kind=kind, place=matrix[:, 3], side_u=x * half[0], side_v=z * half[1], normal=face / max(stretch, 1e-300), area=area,
                color=color, both=both, square=square, **more)  # fmt: skip


def _shining(tables: ir.Tables) -> NDArray[np.bool_]:
    """(instances,) whose material shines evenly, with no picture on it, and is wholly there."""
    m, slot = tables.materials, ir.Slot.EMISSION
    even = (m.values[:, slot].max(axis=1, initial=0.0) > 0.0) & (m.textures[:, slot] < 0) & ~scene_facts.partial(tables)
    return even[tables.instances.material] & (tables.instances.visible & ir.Visibility.REFLECTION != 0)


def _shape(tables: ir.Tables, i: int) -> list[dict[str, Any]]:
    """The emitters of a shining instance; none for kinds that rays have to meet by chance."""
    instances, geometries, pools = tables.instances, tables.geometries, tables.pools
    g, row = int(instances.geometry[i]), int(instances.transform[i])
    matrix, color = tables.transforms.matrix[row], tables.materials.values[instances.material[i], ir.Slot.EMISSION]
    kinds = {ir.GeometryKind.RECTANGLE: RECTANGLE, ir.GeometryKind.DISK: DISK, ir.GeometryKind.SPHERE: SPHERE}
    kind, p = int(geometries.kind[g]), geometries.parameters[g]
    shared = {"color": color, "both": True, "weighed": True}
    if kind in kinds:
        even = matrix[:, :3].T @ matrix[:, :3]
        if kind == ir.GeometryKind.RECTANGLE or np.allclose(even, even[0, 0] * np.eye(3), rtol=0, atol=1e-9 * even[0, 0]):
            return [_plate(kinds[ir.GeometryKind(kind)], matrix, bool(tables.transforms.flips[row]), p[:2], **shared, part=0)]
        return []
    if kind == ir.GeometryKind.CYLINDER and p[2] != 0.0:  # of one without caps the inside is seen, too
        return _cylinder(matrix, float(p[0]), float(p[1]), shared)
    first, count = int(geometries.first_triangle[g]), int(geometries.triangle_count[g])
    if kind != ir.GeometryKind.MESH or not 0 < count <= MOST_TRIANGLES:
        return []
    corners = pools.positions[pools.triangles[first : first + count]].astype(np.float64) + geometries.origin[g]
    corners = corners @ matrix[:, :3].T + matrix[:, 3]
    u, v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    face = np.cross(u, v)
    size = np.linalg.norm(face, axis=1)
    return [
        _row(kind=TRIANGLE, place=corners[k, 0], side_u=u[k], side_v=v[k], normal=face[k] / max(size[k], 1e-300), area=0.5 * size[k],
             **shared, part=first)
        for k in range(count)
    ]  # fmt: skip


def _cylinder(matrix: Any, radius: float, half: float, shared: dict[str, Any]) -> list[dict[str, Any]]:
    """A closed cylinder's side, bottom and top; none of one whose outline is no circle, or that leans."""
    even = matrix[:, :3].T @ matrix[:, :3]
    if not np.allclose(even, np.diag([even[0, 0], even[1, 1], even[0, 0]]), rtol=0, atol=1e-9 * even[0, 0]):
        return []
    wide, up = math.sqrt(even[0, 0]) * radius, matrix[:, 1] * half
    axis = up / np.linalg.norm(up)
    side = _row(kind=TUBE, place=matrix[:, 3], side_u=np.array([wide, 0.0, 0.0]), side_v=up, normal=axis,
                area=4.0 * math.pi * wide * float(np.linalg.norm(up)), part=0, **shared)  # fmt: skip
    caps = [
        _row(kind=DISK, place=matrix[:, 3] + side * up, side_u=matrix[:, 0] * radius, side_v=matrix[:, 2] * radius, normal=side * axis,
             area=math.pi * wide**2, square=True, part=0, **shared)
        for side in (-1.0, 1.0)
    ]  # fmt: skip
    return [side, *caps]


def _table(tables: ir.Tables, rows: list[dict[str, Any]], first: Any, parts: Any, sky: Any) -> Emitters:
    columns: dict[str, Any] = {}
    shapes: dict[str, Any] = dict.fromkeys(("place", "side_u", "side_v", "normal", "color"), (3,))
    types: dict[str, Any] = {"kind": np.int32, "light": np.int32, "both": bool, "square": bool, "shadows": bool, "weighed": bool}
    for name in ("kind", "place", "side_u", "side_v", "normal", "area", "color", "both", "square", "light", "shadows", "weighed"):
        values = [row[name] for row in rows]
        columns[name] = np.array(values, types.get(name, np.float64)).reshape(-1, *shapes.get(name, ()))
    disks, triangles, tubes = (
        shape_solid_angle.Some(int(here.sum())) if here.any() else shape_solid_angle.NoLights()
        for here in ((columns["kind"] == DISK) & columns["square"], columns["kind"] == TRIANGLE, columns["kind"] == TUBE)
    )
    wide = shape_solid_angle.Wide(disks, triangles, tubes)
    return Emitters(**columns, first=first, parts=parts, tree=_tree(tables, columns), sky=sky, wide=wide)


def _tree(tables: ir.Tables, of: dict[str, Any]) -> light_tree.Tree:
    """The tree over all that has a place."""
    kind, place, u, v = of["kind"], of["place"], of["side_u"], of["side_v"]
    shown = np.select([kind == SPHERE, kind == TUBE], [0.25, 1.0 / math.pi], 1.0)  # of its area, from one side
    power = of["color"].mean(axis=1) * np.where(of["area"] > 0, of["area"] * shown, 1.0)
    far = ir.is_in(kind, _FAR)
    span = np.abs(u) + np.abs(v)
    span = np.where((kind == DISK)[:, None], np.sqrt(u * u + v * v), span)
    span = np.where((kind == SPHERE)[:, None], u[:, :1], span)
    round_ = u[:, :1] * np.sqrt(np.maximum(1.0 - of["normal"] ** 2, 0.0))  # the reach of a circle across an axis
    span = np.where((kind == TUBE)[:, None], np.abs(v) + round_, span)
    low, high = place - span, place + span
    corners = np.stack([place, place + u, place + v])
    low = np.where((kind == TRIANGLE)[:, None], corners.min(axis=0), low)
    high = np.where((kind == TRIANGLE)[:, None], corners.max(axis=0), high)
    spot = kind == SPOT
    axis = np.where(spot[:, None], -of["normal"], of["normal"])
    around = of["both"] | (kind == POINT)
    edge = np.full(len(kind), 0.5 * math.pi)
    if spot.any():
        edge[spot] = np.arccos(np.clip(tables.lights.cos_cone[of["light"][spot]], -1.0, 1.0))
    bounds = light_tree.Bounds(low, high, axis, np.where(around, math.pi, 0.0), edge, power)
    return light_tree.build(power[far], light_tree.Bounds(*(column[~far] for column in bounds)))


# --- in lanes ------------------------------------------------------------------------------------------------------------


@helper
def sample(tables: Tables, emitters: Emitters, e: Lane, position: Vec, u: Lane, v: Lane) -> Arriving:
    """Light of emitter e (a row for each lane, or one for all) at a point; u, v in [0, 1) choose where on it."""
    kind = emitters.kind[e]
    zero = ops.full_like(u, 0.0)
    color = (emitters.color[e, 0] + zero, emitters.color[e, 1] + zero, emitters.color[e, 2] + zero)
    place = (emitters.place[e, 0] + zero, emitters.place[e, 1] + zero, emitters.place[e, 2] + zero)
    normal = (emitters.normal[e, 0] + zero, emitters.normal[e, 1] + zero, emitters.normal[e, 2] + zero)
    way = ops.sub(place, position)
    direction, distance, strength, density, slant = normal, zero + math.inf, zero, zero + math.inf, zero + 1.0
    flat = (kind == RECTANGLE) | (kind == DISK) | (kind == TRIANGLE)
    if ops.any_lane(flat):
        a, b = _on_plate(kind, u, v)
        side_u = (emitters.side_u[e, 0], emitters.side_u[e, 1], emitters.side_u[e, 2])
        side_v = (emitters.side_v[e, 0], emitters.side_v[e, 1], emitters.side_v[e, 2])
        wide = (kind == RECTANGLE) & emitters.square[e] & rectangle_solid_angle.is_near(way, emitters.area[e])
        filled = zero
        if ops.any_lane(wide):
            rect = _rectangle(emitters, e, way)
            x, y = rectangle_solid_angle.draw_apart(rect, u, v)
            a, b, filled = ops.where(wide, x, a), ops.where(wide, y, b), rect.solid
        to = ops.add(way, ops.add((side_u[0] * a, side_u[1] * a, side_u[2] * a), (side_v[0] * b, side_v[1] * b, side_v[2] * b)))
        squared = ops.maximum(ops.dot(to, to), lights.TINY)
        inverse = 1.0 / ops.sqrt(squared)
        towards = ops.scale(to, inverse)
        cosine = -ops.dot(towards, normal)
        cosine = ops.where(emitters.both[e], ops.absolute(cosine), ops.maximum(cosine, 0.0))
        angle = emitters.area[e] * cosine * inverse * inverse
        angle = ops.where(wide, ops.where(cosine > 0.0, filled, 0.0), angle)
        reached = _to_wide_disk(emitters.wide.disks, Reached(towards, squared * inverse, angle, cosine), emitters, e, way, u, v)
        reached = _to_wide_triangle(emitters.wide.triangles, reached, emitters, e, way, u, v)
        direction = ops.where3(flat, reached.direction, direction)
        distance = ops.where(flat, reached.distance, distance)
        strength, slant = ops.where(flat, reached.angle, strength), ops.where(flat, reached.cosine, slant)
    reached = _to_any_tube(emitters.wide.tubes, Reached(direction, distance, strength, slant), emitters, e, way, u, v)
    direction, distance, strength, slant = reached
    flat = flat | (kind == TUBE)
    density = ops.where(flat, 1.0 / ops.maximum(strength, lights.TINY), density)
    round_ = kind == SPHERE
    if ops.any_lane(round_):
        towards, reach, angle = lights.to_ball(way, emitters.side_u[e, 0] + zero, u, v)
        direction = ops.where3(round_, towards, direction)
        distance = ops.where(round_, reach, distance)
        strength = ops.where(round_, angle, strength)
        density = ops.where(round_, 1.0 / angle, density)
        middle = ops.absolute(ops.dot(way, towards) - reach)
        slant = ops.where(round_, middle / ops.maximum(emitters.side_u[e, 0] + zero, lights.TINY), slant)
    small = (kind == POINT) | (kind == SPOT)
    if ops.any_lane(small):
        reach = ops.length(way)
        towards = ops.scale(way, 1.0 / ops.maximum(reach, lights.TINY))
        row = ops.maximum(emitters.light[e], 0)
        c = tables.lights.coefficients
        left = lights.falloff(tables.lights.falloff[row], c[row, 0], c[row, 1], c[row, 2], reach)
        cone = lights.spot_share(ops.dot(towards, normal), tables.lights.cos_cone[row], tables.lights.cos_full[row])
        direction = ops.where3(small, towards, direction)
        distance = ops.where(small, reach, distance)
        strength = ops.where(small, left * ops.where(kind == SPOT, cone, zero + 1.0), strength)
    far = (kind == DIRECTIONAL) | (kind == SUN)
    if ops.any_lane(far):
        row = ops.maximum(emitters.light[e], 0)
        half = ops.sin(0.5 * (tables.lights.angle[row] + zero))
        half = ops.where(kind == SUN, half * half, zero)
        towards = lights.in_cone(normal, u * 2.0 * half, v)  # `color` is what a surface that faces it gets from all of it
        direction = ops.where3(far, towards, direction)
        strength = ops.where(far, 1.0 / (1.0 - half), strength)
    light = ops.scale(color, strength)
    above = kind == DOME
    if ops.any_lane(above):
        towards, radiance, likely = environment_map.sample(emitters.sky, tables, u, v)
        direction, density = ops.where3(above, towards, direction), ops.where(above, likely, density)
        light = ops.where3(above, ops.scale(radiance, 1.0 / ops.maximum(likely, lights.TINY)), light)
    return Arriving(direction, distance, light, density, slant)


@helper
def _to_disk(plain: Reached, emitters: Emitters, e: Lane, way: Vec, u: Lane, v: Lane) -> Reached:
    """The same; by the solid angle where a round disk fills much of what a place sees."""
    wide = (emitters.kind[e] == DISK) & emitters.square[e] & rectangle_solid_angle.is_near(way, emitters.area[e])
    if ops.any_lane(wide):
        seen = _ellipse(emitters, e, way)
        towards, reach, angle = shape_solid_angle.draw_disk(seen, u, v)
        angle = ops.where(_shines_to(emitters, e, towards), angle, 0.0)
        plain = _instead(wide, plain, Reached(towards, reach, angle, ops.dot(towards, seen.toward)))
    return plain


@helper
def _to_triangle(plain: Reached, emitters: Emitters, e: Lane, way: Vec, u: Lane, v: Lane) -> Reached:
    """The same for triangles."""
    one, other = _sides(emitters, e, way)
    wide = (emitters.kind[e] == TRIANGLE) & shape_solid_angle.fills_much(way, one, other)
    if ops.any_lane(wide):
        seen = shape_solid_angle.corners(way, one, other)
        towards = shape_solid_angle.draw_triangle(seen, u, v)
        normal = (emitters.normal[e, 0], emitters.normal[e, 1], emitters.normal[e, 2])
        along = ops.dot(towards, normal)
        reach = ops.dot(way, normal) / ops.where(ops.absolute(along) > lights.TINY, along, lights.TINY)
        angle = ops.where(_shines_to(emitters, e, towards), seen.solid, 0.0)
        plain = _instead(wide, plain, Reached(towards, reach, angle, ops.absolute(along)))
    return plain


@helper
def _to_tube(plain: Reached, emitters: Emitters, e: Lane, way: Vec, u: Lane, v: Lane) -> Reached:
    """The same for the sides of cylinders, which are always drawn so."""
    here = emitters.kind[e] == TUBE
    if ops.any_lane(here):
        direction, distance, angle, cosine = shape_solid_angle.draw_tube(_tube(emitters, e, way), u, v)
        plain = _instead(here, plain, Reached(direction, distance, angle, cosine))
    return plain


_to_wide_disk, _to_wide_triangle, _to_any_tube = (shape_solid_angle.if_some(each) for each in (_to_disk, _to_triangle, _to_tube))


@helper
def _instead(here: Lane, plain: Reached, other: Reached) -> Reached:
    return Reached(
        ops.where3(here, other.direction, plain.direction), ops.where(here, other.distance, plain.distance),
        ops.where(here, other.angle, plain.angle), ops.where(here, other.cosine, plain.cosine),
    )  # fmt: skip


@helper
def _shines_to(emitters: Emitters, e: Lane, direction: Vec) -> Lane:
    """Whether what is met in a direction shows its shining side."""
    cosine = ops.dot(direction, (emitters.normal[e, 0], emitters.normal[e, 1], emitters.normal[e, 2]))
    return ops.where(emitters.both[e], cosine != 0.0, cosine < 0.0)


@helper
def _sides(emitters: Emitters, e: Lane, like: Vec) -> tuple[Vec, Vec]:
    zero = 0.0 * like[0]
    u = (emitters.side_u[e, 0] + zero, emitters.side_u[e, 1] + zero, emitters.side_u[e, 2] + zero)
    return u, (emitters.side_v[e, 0] + zero, emitters.side_v[e, 1] + zero, emitters.side_v[e, 2] + zero)


@helper
def _ellipse(emitters: Emitters, e: Lane, way: Vec) -> shape_solid_angle.Ellipse:
    zero = 0.0 * way[0]
    normal = (emitters.normal[e, 0] + zero, emitters.normal[e, 1] + zero, emitters.normal[e, 2] + zero)
    radius = ops.sqrt(ops.maximum(emitters.area[e] * (1.0 / math.pi) + zero, lights.TINY))
    return shape_solid_angle.ellipse(way, normal, radius)


@helper
def _tube(emitters: Emitters, e: Lane, way: Vec) -> shape_solid_angle.Tube:
    zero = 0.0 * way[0]
    axis = (emitters.normal[e, 0] + zero, emitters.normal[e, 1] + zero, emitters.normal[e, 2] + zero)
    half = ops.sqrt(ops.dot(_sides(emitters, e, way)[1], _sides(emitters, e, way)[1]))
    return shape_solid_angle.tube(way, axis, emitters.side_u[e, 0] + zero, half)


@helper
def _on_plate(kind: Lane, u: Lane, v: Lane) -> tuple[Lane, Lane]:
    """Where on a plate u, v fall, in its half edges, radii or a triangle's edges, evenly over its area."""
    a, b = 2.0 * u - 1.0, 2.0 * v - 1.0
    if ops.any_lane(kind == DISK):
        radius, turn = ops.sqrt(u), 2.0 * math.pi * v
        a = ops.where(kind == DISK, radius * ops.cos(turn), a)
        b = ops.where(kind == DISK, radius * ops.sin(turn), b)
    if ops.any_lane(kind == TRIANGLE):
        root = ops.sqrt(u)
        a = ops.where(kind == TRIANGLE, root * (1.0 - v), a)
        b = ops.where(kind == TRIANGLE, root * v, b)
    return a, b


@helper
def _rectangle(emitters: Emitters, e: Lane, way: Vec) -> rectangle_solid_angle.Seen:
    """A rectangle whose middle is `way` off, by the solid angle that it fills."""
    zero = 0.0 * way[0]
    u = (emitters.side_u[e, 0] + zero, emitters.side_u[e, 1] + zero, emitters.side_u[e, 2] + zero)
    v = (emitters.side_v[e, 0] + zero, emitters.side_v[e, 1] + zero, emitters.side_v[e, 2] + zero)
    half_u, half_v = ops.length(u), ops.length(v)
    unit_u = ops.scale(u, 1.0 / ops.maximum(half_u, lights.TINY))
    unit_v = ops.scale(v, 1.0 / ops.maximum(half_v, lights.TINY))
    return rectangle_solid_angle.seen_apart(way, unit_u, unit_v, ops.maximum(half_u, lights.TINY), ops.maximum(half_v, lights.TINY))


@helper
def density(emitters: Emitters, e: Lane, origin: Vec, direction: Vec, distance: Lane) -> Lane:
    """How likely `sample` takes this direction from a point, given that it takes emitter e, which is met at a distance."""
    kind = emitters.kind[e]
    cosine = ops.dot(direction, (emitters.normal[e, 0], emitters.normal[e, 1], emitters.normal[e, 2]))
    found = distance * distance / ops.maximum(ops.absolute(cosine) * emitters.area[e], lights.TINY)
    round_ = kind == SPHERE
    way = ops.sub((emitters.place[e, 0], emitters.place[e, 1], emitters.place[e, 2]), origin)
    if ops.any_lane(round_):
        angle = 2.0 * math.pi * lights.ball_height(ops.dot(way, way), emitters.side_u[e, 0])
        found = ops.where(round_, 1.0 / angle, found)
    wide = (kind == RECTANGLE) & emitters.square[e] & rectangle_solid_angle.is_near(way, emitters.area[e])
    if ops.any_lane(wide):
        found = ops.where(wide, 1.0 / _rectangle(emitters, e, way).solid, found)
    found = _disk_density(emitters.wide.disks, found, emitters, e, way, direction)
    found = _triangle_density(emitters.wide.triangles, found, emitters, e, way)
    return _tube_density(emitters.wide.tubes, found, emitters, e, way, direction, distance)


@helper
def _of_disk(plain: Lane, emitters: Emitters, e: Lane, way: Vec, direction: Vec) -> Lane:
    wide = (emitters.kind[e] == DISK) & emitters.square[e] & rectangle_solid_angle.is_near(way, emitters.area[e])
    if ops.any_lane(wide):
        plain = ops.where(wide, shape_solid_angle.disk_density(_ellipse(emitters, e, way), direction), plain)
    return plain


@helper
def _of_triangle(plain: Lane, emitters: Emitters, e: Lane, way: Vec) -> Lane:
    one, other = _sides(emitters, e, way)
    wide = (emitters.kind[e] == TRIANGLE) & shape_solid_angle.fills_much(way, one, other)
    if ops.any_lane(wide):
        plain = ops.where(wide, 1.0 / shape_solid_angle.corners(way, one, other).solid, plain)
    return plain


@helper
def _of_tube(plain: Lane, emitters: Emitters, e: Lane, way: Vec, direction: Vec, distance: Lane) -> Lane:
    here = emitters.kind[e] == TUBE
    if ops.any_lane(here):
        plain = ops.where(here, shape_solid_angle.tube_density(_tube(emitters, e, way), direction, distance), plain)
    return plain


_disk_density, _triangle_density, _tube_density = (shape_solid_angle.if_some(each) for each in (_of_disk, _of_triangle, _of_tube))
