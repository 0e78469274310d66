"""Emitter table: one row for each light, emissive shape, triangle of an emissive mesh, and medium that emits."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.ir.light_links import CASTERS
from ...lights import AMBIENT, DISKS, LIGHTS, PICTURED, PROFILED, RECTANGLES, SKIES, SURFACES
from ...lights import DISTANT as DISTANT_KINDS
from ...materials import traits
from ...shapes import SHAPES
from ...shapes.contract import Emitting
from ..lanes import ops
from ..medium import emitting_cells
from . import emitter_points, environment_map, light_tree, round_emitters, shape_solid_angle
from .form_samples import DISK, DISTANT, POINT, RECTANGLE, SKY, SPHERE, TRIANGLE
from .round_emitters import CAPSULE, CONE, ELLIPSOID, TORUS, TUBE

MOST_TRIANGLES = 1 << 17  # of a mesh whose triangles are sampled; paths still hit larger ones
_FAR = (DISTANT, SKY)
_PLAIN = {"rectangle": RECTANGLE, "disk": DISK, "sphere": SPHERE}
_ROUND = {"tube": TUBE, "cone": CONE, "torus": TORUS, "capsule": CAPSULE}  # by form of shapes.contract.Emitting


class Emitters(NamedTuple):
    """Emitters in world space; rows without a position stand first."""

    kind: NDArray[np.int32]
    place: NDArray[np.float64]  # (n, 3) center of a plate or ball, first corner of a triangle, position of a point light
    side_u: NDArray[np.float64]  # (n, 3) half edges of a plate, radii of a disk; edges of a triangle; columns 0 and 1: radius of a ball,
    # tube or capsule; radii of a cone at its lower and upper end; of the ring and the tube of a torus
    side_v: NDArray[np.float64]  # (n, 3) likewise; of a tube, cone or capsule half its length without caps, along its axis
    normal: NDArray[np.float64]  # (n, 3) of a plate or triangle; axis of round shapes; toward a distant light; against the axis of a spot;
    # side_u, side_v and normal of an ellipsoid are its three axes
    area: NDArray[np.float64]
    color: NDArray[np.float64]  # (n, 3) radiance, with a texture its mean, or as ir.Lights.color
    both: NDArray[np.bool_]  # emits to both sides; closed shapes do, too, but only their outside is sampled
    square: NDArray[np.bool_]  # a rectangle with right angles; a circular disk
    light: NDArray[np.int32]  # row of ir.Lights, or -1
    shadows: NDArray[np.bool_]
    weighed: NDArray[np.bool_]  # BSDF samples can hit it, too: MIS weights apply
    textured: NDArray[np.bool_]  # its radiance has a texture
    instance: NDArray[np.int32]  # of an emissive shape, or -1
    profile: NDArray[np.int32]  # kind of a light whose emission depends on the angle from its normal, or -1
    first: NDArray[np.int32]  # (instances,) first row of an instance, or -1
    parts: NDArray[np.int32]  # (instances,) the primitive of a hit that belongs to the row `first`
    tree: light_tree.Tree  # for light selection
    sky: Any  # environment_map.SkyMap or Even
    wide: shape_solid_angle.Wide  # shapes that are sampled by solid angle, beside rectangles and balls
    media: Any = emitting_cells.NoCells()  # or emitting_cells.Cells of media that emit, whose rows come last


def build(
    tables: ir.Tables, moves: bool = False, horizon: NDArray[np.float64] | None = None, general: bool = False, learns: bool = False
) -> Emitters:
    """Build the emitter table of a scene.

    Uniform skies have no row: BSDF samples find them as well as light samples could. With `moves`, instances with keys move; emissive
    ones have no row. No light comes from below a `horizon`. With `general`, every optional part is there. With `learns`, all of the
    sky has a row, for light/sky_openings.py.
    """
    rows: list[dict[str, Any]] = []
    sky = environment_map.build(tables, 0, horizon, general, learns)
    if isinstance(sky, environment_map.SkyMap) and sky.row >= 0:
        alone = environment_map.is_sampled_alone(tables)
        kinds = SKIES if alone or learns else PICTURED
        skies = np.flatnonzero(ir.is_in(tables.lights.kind, kinds) & (tables.lights.shadows | (not alone)))
        rows.append(_row(kind=SKY, color=np.full(3, sky.power), light=int(skies[0]), weighed=not alone))
    instances = tables.instances
    first = np.full(len(instances.geometry), -1, np.int32)
    parts = np.zeros(len(instances.geometry), np.int32)
    order = sorted(range(len(tables.lights.kind)), key=lambda k: tables.lights.kind[k] not in DISTANT_KINDS + PICTURED)
    for k in order:
        kind = tables.lights.kind[k]
        if kind in AMBIENT + SKIES or not tables.lights.color[k].any():
            continue
        if kind in SURFACES:
            i = int(tables.lights.instance[k])
            if i >= 0:
                first[i] = len(rows)
            rows.append(_light_row(tables, k, i))
        else:
            rows.append(
                _row(kind=int(LIGHTS[kind].FORM), place=tables.lights.position[k], normal=tables.lights.direction[k],
                     color=tables.lights.color[k], light=k, shadows=tables.lights.shadows[k], profile=_profile(kind))
            )  # fmt: skip
    still = ~moves | (tables.transforms.first_key[instances.transform] < 0)
    for i in np.flatnonzero(_is_emissive(tables) & still & (instances.light < 0)):
        shapes = _shape_rows(tables, int(i))
        if shapes:
            first[i], parts[i] = len(rows), shapes[0].pop("part")
            rows.extend({name: value for name, value in row.items() if name != "part"} for row in shapes)
    media, shining = emitting_cells.build(tables, len(rows), moves, general)
    for medium in shining:
        rows.append(
            _row(kind=emitting_cells.KIND, place=0.5 * (medium.low + medium.high), side_u=0.5 * (medium.high - medium.low),
                 color=medium.intensity, both=True, weighed=True)
        )  # fmt: skip
    return _table(tables, rows, first, parts, sky, general)._replace(media=media)


def _row(**values: Any) -> dict[str, Any]:
    nothing = np.zeros(3)
    base = {"place": nothing, "side_u": nothing, "side_v": nothing, "normal": np.array([0.0, 1.0, 0.0]), "area": 0.0, "both": False,
            "square": False, "light": -1, "shadows": True, "weighed": False, "textured": False, "instance": -1, "profile": -1}  # fmt: skip
    return base | values


def _profile(kind: int) -> int:
    """A kind of light with a profile, else -1."""
    return int(kind) if kind in PROFILED else -1


def _light_row(tables: ir.Tables, k: int, instance: int) -> dict[str, Any]:
    lit = tables.lights
    seen = instance >= 0 and bool(tables.instances.visible[instance] & ir.Visibility.REFLECTION)
    weighed = bool(lit.shadows[k]) and seen and lit.blockers[k] == CASTERS
    matrix = tables.transforms.matrix[lit.transform[k]]
    flips = bool(tables.transforms.flips[lit.transform[k]])
    form = int(LIGHTS[int(lit.kind[k])].FORM)
    both, profile = form == SPHERE, _profile(lit.kind[k])
    return _surface_row(form, matrix, flips, lit.size[k], lit.color[k], both, light=k, shadows=lit.shadows[k], weighed=weighed,
                        profile=profile)  # fmt: skip


def _surface_row(kind: int, matrix: Any, flips: bool, size: Any, color: Any, both: bool, **more: Any) -> dict[str, Any]:
    """A rectangle, disk or ball with a transform."""
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


def _is_emissive(tables: ir.Tables) -> NDArray[np.bool_]:
    """(instances,) whether the material emits and is opaque, or flat and evenly transparent: the back of a round one is seen through it."""
    materials, instances = tables.materials, tables.instances
    varies = (materials.textures[:, [ir.Slot.OPACITY, ir.Slot.EMISSION]] >= 0).any(axis=1) | (materials.threshold > 0.0)
    shining, partial = traits.emissive(tables), traits.partial(tables)
    flat = ir.is_in(tables.geometries.kind, [ir.GeometryKind.MESH, *(kind for kind, shape in SHAPES.items() if shape.FLAT)])
    sampled = (shining & ~partial)[instances.material]
    sampled |= (shining & partial & ~varies)[instances.material] & flat[instances.geometry]
    return sampled & (instances.visible & ir.Visibility.REFLECTION != 0)


def _shape_rows(tables: ir.Tables, i: int) -> list[dict[str, Any]]:
    """Return the rows of an emissive instance; none for kinds that only BSDF samples find."""
    instances, geometries, pools = tables.instances, tables.geometries, tables.pools
    g, row = int(instances.geometry[i]), int(instances.transform[i])
    matrix, of_material = tables.transforms.matrix[row], tables.materials.values[instances.material[i]]
    color = of_material[ir.Slot.EMISSION]
    if tables.materials.textures[instances.material[i], ir.Slot.OPACITY] < 0 and tables.materials.threshold[instances.material[i]] <= 0.0:
        color = color * np.clip(of_material[ir.Slot.OPACITY, 0], 0.0, 1.0)
    textured = bool(tables.materials.textures[instances.material[i], ir.Slot.EMISSION] >= 0)
    shared = {"color": color, "both": True, "weighed": True, "textured": textured, "instance": i}
    shape = SHAPES.get(int(geometries.kind[g]))
    if shape is not None:
        emitting = None if shape.emitting is None else shape.emitting(geometries.parameters[g].tolist())
        return [] if emitting is None else _analytic_rows(emitting, matrix, bool(tables.transforms.flips[row]), shared)
    first, count = int(geometries.first_triangle[g]), int(geometries.triangle_count[g])
    if geometries.kind[g] != ir.GeometryKind.MESH or not 0 < count <= MOST_TRIANGLES:
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


def _analytic_rows(shape: Emitting, matrix: Any, flips: bool, shared: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the rows of an analytic shape; none if a transform deforms it so that only BSDF samples find it."""
    if shape.form == "box":
        return _box_rows(matrix, shape.size, shared)
    if shape.form not in _PLAIN:
        return _round_rows(shape, matrix, shared)
    even = matrix[:, :3].T @ matrix[:, :3]
    if shape.form == "rectangle" or np.allclose(even, even[0, 0] * np.eye(3), rtol=0, atol=1e-9 * even[0, 0]):
        return [_surface_row(_PLAIN[shape.form], matrix, flips, shape.size, **shared, part=0)]
    return [_ellipsoid_row(matrix[:, :3] * shape.size[0], matrix[:, 3], shared)] if shape.form == "sphere" else []


def _ellipsoid_row(axes: Any, place: Any, shared: dict[str, Any]) -> dict[str, Any]:
    return _row(kind=ELLIPSOID, place=place, side_u=axes[:, 0], side_v=axes[:, 1], normal=axes[:, 2],
                area=round_emitters.ellipsoid_area(axes), part=0, **shared | {"both": False})  # fmt: skip


def _box_rows(matrix: Any, half: Any, shared: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the six faces of a box in the order of Hit.primitive, each with its outside alone."""
    rows = []
    for axis in range(3):
        u, v = matrix[:, (axis + 1) % 3] * half[(axis + 1) % 3], matrix[:, (axis + 2) % 3] * half[(axis + 2) % 3]
        face, way = np.cross(u, v), matrix[:, axis] * half[axis]
        size = float(np.linalg.norm(face))
        out = face / max(size, 1e-300) * (1.0 if float(face @ way) > 0.0 else -1.0)
        square = abs(float(u @ v)) <= 1e-6 * size
        rows += [
            _row(kind=RECTANGLE, place=matrix[:, 3] + side * way, side_u=u, side_v=v, normal=side * out, area=4.0 * size, square=square,
                 part=0, **shared | {"both": False})
            for side in (-1.0, 1.0)
        ]  # fmt: skip
    return rows


def _round_rows(shape: Emitting, matrix: Any, shared: dict[str, Any]) -> list[dict[str, Any]]:
    """Return side, bottom and top of a tube or cone, or the surface of a torus or capsule; none if a transform deforms it."""
    even, form, radii = matrix[:, :3].T @ matrix[:, :3], _ROUND[shape.form], shape.size
    y = 0 if form in (TORUS, CAPSULE) else 1
    if not np.allclose(even, np.diag([even[0, 0], even[y, y], even[0, 0]]), rtol=0, atol=1e-9 * even[0, 0]):
        return []
    grown, axis, place = math.sqrt(even[0, 0]), matrix[:, 1] / np.linalg.norm(matrix[:, 1]), matrix[:, 3]
    up = matrix[:, 1] * shape.half
    wide = (grown * radii[0], grown * radii[1])
    area = round_emitters.area(form, wide, float(np.linalg.norm(up)))
    of_side = shared | {"both": not shape.closed or form == TUBE}  # without caps the inside is visible, too
    side = _row(kind=form, place=place, side_u=np.array([*wide, 0.0]), side_v=up, normal=axis, area=area, part=0, **of_side)
    if not shape.closed or form in (TORUS, CAPSULE):
        return [side]
    caps = [
        _row(kind=DISK, place=place + end * up, side_u=matrix[:, 0] * radius, side_v=matrix[:, 2] * radius, normal=end * axis,
             area=math.pi * (grown * radius) ** 2, square=True, part=0, **shared | {"both": False})
        for end, radius in zip((-1.0, 1.0), radii, strict=True)
    ]  # fmt: skip
    return [side, *caps]


def _table(tables: ir.Tables, rows: list[dict[str, Any]], first: Any, parts: Any, sky: Any, general: bool) -> Emitters:
    columns: dict[str, Any] = {}
    shapes: dict[str, Any] = dict.fromkeys(("place", "side_u", "side_v", "normal", "color"), (3,))
    types: dict[str, Any] = {"kind": np.int32, "light": np.int32, "both": bool, "square": bool, "shadows": bool, "weighed": bool,
                             "textured": bool, "instance": np.int32, "profile": np.int32}  # fmt: skip
    for name in ("kind", "place", "side_u", "side_v", "normal", "area", "color", "both", "square", "light", "shadows", "weighed",
                 "textured", "instance", "profile"):  # fmt: skip
        values = [row[name] for row in rows]
        columns[name] = np.array(values, types.get(name, np.float64)).reshape(-1, *shapes.get(name, ()))
    kind = columns["kind"]
    shaped = (columns["light"] >= 0) & (kind != SKY) & (np.append(tables.lights.image, -1)[columns["light"]] >= 0)
    marks = (
        shape_solid_angle.HasLights(int(mask.sum())) if mask.any() or general else shape_solid_angle.NoLights()
        for mask in (
            (kind == DISK) & columns["square"], kind == TRIANGLE, kind == TUBE, ir.is_in(kind, round_emitters.ROUND[1:]), shaped,
            columns["textured"],
        )
    )
    wide = shape_solid_angle.Wide(*marks)
    columns["color"] = emitter_points.mean_radiance(tables, SimpleNamespace(**columns, first=first, parts=parts))
    return Emitters(**columns, first=first, parts=parts, tree=_build_tree(tables, columns, general), sky=sky, wide=wide)


def widest_angle(tables: ir.Tables, light: int) -> float:
    """The angle in radians from the axis of a light beyond which it emits nothing."""
    kind = LIGHTS[int(tables.lights.kind[light])]
    if kind.widest is not None:
        return kind.widest(tables.lights, light)
    return 0.5 * math.pi if kind.KIND in RECTANGLES + DISKS else math.pi


def _peaks(tables: ir.Tables, light: Any, kind: Any) -> NDArray[np.float64]:
    """(n,) the largest factor by direction of each emitter, the mean of its channels; 1 without an image."""
    peaks, images = np.ones(len(light)), tables.images
    for row in np.flatnonzero((light >= 0) & (kind != SKY)).tolist():
        image = int(tables.lights.image[light[row]])
        if image >= 0:
            first, count = int(images.first[image]), int(images.width[image]) * int(images.height[image])
            peaks[row] = images.texels[first : first + count, :3].mean(axis=1, dtype=np.float64).max()
    return peaks


def _build_tree(tables: ir.Tables, columns: dict[str, Any], general: bool) -> light_tree.Tree:
    """Build the light tree over the emitters with a position."""
    kind, place, u, v = columns["kind"], columns["place"], columns["side_u"], columns["side_v"]
    round_ = ir.is_in(kind, round_emitters.ROUND)
    hollow = columns["both"] & (kind == CONE)
    one_side = [(kind == SPHERE) | (kind == ELLIPSOID), round_ & ~hollow]
    shown = np.select(one_side, [0.25, 1.0 / math.pi], 1.0)  # visible share of the area
    power = (
        columns["color"].mean(axis=1) * np.where(columns["area"] > 0, columns["area"] * shown, 1.0) * _peaks(tables, columns["light"], kind)
    )
    far = ir.is_in(kind, _FAR)
    span = np.abs(u) + np.abs(v)
    span = np.where((kind == DISK)[:, None], np.sqrt(u * u + v * v), span)
    span = np.where((kind == SPHERE)[:, None], u[:, :1], span)
    span = np.where(round_[:, None], round_emitters.extent(kind, u, v, columns["normal"]), span)
    low, high = place - span, place + span
    corners = np.stack([place, place + u, place + v])
    low = np.where((kind == TRIANGLE)[:, None], corners.min(axis=0), low)
    high = np.where((kind == TRIANGLE)[:, None], corners.max(axis=0), high)
    axis = np.where((kind == ELLIPSOID)[:, None], [0.0, 1.0, 0.0], columns["normal"])
    around = columns["both"] | ((kind == POINT) & (columns["profile"] < 0)) | round_
    edge = np.full(len(kind), 0.5 * math.pi)
    for row in np.flatnonzero(columns["profile"] >= 0).tolist():
        edge[row] = widest_angle(tables, int(columns["light"][row]))
    bounds = light_tree.Bounds(low, high, axis, np.where(around, math.pi, 0.0), edge, power)
    return light_tree.build(power[far], light_tree.Bounds(*(column[~far] for column in bounds)), general)
