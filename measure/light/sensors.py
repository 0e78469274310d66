"""A scene with the sensors of its meters: white diffuse surfaces that only cameras of their own see.

A white diffuse surface that receives E lux has a luminance of E/π. So a path from an orthographic camera just above a sensor estimates
its illuminance, by the light transport of pictures. Light and other paths pass sensors as if they were not there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.ir.single_sided import SINGLE_SIDED
from ...compiler.mesh.parts import Part
from ...compiler.plan import scene_facts
from ...compiler.scene import selection
from ...render.geometry.bounds import world_bounds
from ...render.tessellation import printable_mesh

LIFT = 1e-5  # of its coordinates, by which a sensor lies off its plane: rays off a surface start 2e-6 of theirs above it
FROM_SIZE = 0.01  # of the scene's size, that counts as a coordinate: shapes around the origin have rounding errors, too
HIGHEST = 0.01  # of the scene's size: a sensor that would lie higher over its plane is refused
POINT = 1e-4  # of its coordinates or of the scene's size: half an edge of a sensor at a point
FINE = 1e-3  # of LIFT in float64
BIAS = 1e-4  # of a value: the greatest effect of rounding and of a sensor's height over its plane, beside `height_error`
FAR = 2.0  # sizes of the scene from the origin, from which float32 is too coarse for sensors
REPLICATES = 16  # of points on a surface
POINTS = 1024  # most on a surface, of a replicate
STEPS = 0.8191725133961645, 0.6710436067037893, 0.5497004779019703  # of a low-discrepancy sequence in a cube (Roberts 2018)
F64 = NDArray[np.float64]


class MeterError(ValueError):
    """A meter that cannot be read. The message names it; `hint` is the fix."""

    def __init__(self, message: str, hint: str, meter: ir.Meter) -> None:
        super().__init__(message)
        self.hint, self.meter = hint, meter


@dataclass(frozen=True)
class Sensor:
    """What one meter receives: cameras of `scene`, each a picture of `cells` pixels whose luminance times π is illuminance."""

    meter: ir.Meter
    cameras: range  # rows; of a surface REPLICATES · POINTS, those of a replicate together; of others one
    cells: tuple[int, int]
    area: float  # square metres; 0: a point
    area_error: float = 0.0
    height_error: float = 0.0  # share of the light, by a sensor higher over its plane than BIAS counts


class _Rows:
    """Rows that are added to the tables of a scene, in blocks."""

    def __init__(self, tables: ir.Tables) -> None:
        self.tables = tables
        self.blocks: dict[str, list[dict[str, Any]]] = {}
        self.counts: dict[str, int] = {}

    def add(self, table: str, count: int = 1, **columns: Any) -> int:
        """Add `count` rows, whose columns are (count, …) or equal for all; return the first."""
        before = getattr(self.tables, table)
        first = self.counts.setdefault(table, len(before[0]))
        rows = {}
        for column, value in columns.items():
            kind, shape = ir.column_type(table, column)
            value = np.asarray(value, kind)
            rows[column] = np.broadcast_to(value, (count, *shape)) if value.ndim <= len(shape) else value
        self.blocks.setdefault(table, []).append(rows)
        self.counts[table] += count
        return first

    def transforms(self, matrices: F64) -> int:
        """Add still transforms (n, 4, 4); return the first."""
        inverse = np.linalg.inv(matrices)
        return self.add(
            "transforms", len(matrices), matrix=matrices[:, :3], inverse=inverse[:, :3], flips=False, first_key=-1, keys=0
        )  # fmt: skip

    def finish(self) -> ir.Tables:
        """The tables with the added rows."""
        rows = {}
        for table, blocks in self.blocks.items():
            before = getattr(self.tables, table)._asdict()
            rows[table] = ir.table_of(table, {c: np.concatenate([values, *(b[c] for b in blocks)]) for c, values in before.items()})
        return self.tables._replace(**rows)


def with_sensors(scene: ir.Scene, meters: Sequence[ir.Meter], seed: int = 0) -> tuple[ir.Scene, list[Sensor]]:
    """The scene with a sensor for each meter, whose cameras are its only ones. Raises MeterError for an unknown or unbounded surface."""
    hidden = scene.tables.instances.visible & ~np.int32(ir.Visibility.CAMERA | SINGLE_SIDED)
    tables = scene.tables._replace(instances=scene.tables.instances._replace(visible=hidden))
    tables = tables._replace(cameras=ir.table_of("cameras", {}))
    rows = _Rows(tables)
    size, fine = extent(scene.tables), FINE if is_far(scene, meters) else 1.0
    white = np.zeros((ir.SLOTS, 3))
    white[ir.Slot.DIFFUSE] = 1.0
    white[[ir.Slot.IOR, ir.Slot.OPACITY], 0] = 1.0
    material = rows.add(
        "materials", model=ir.MaterialModel.LAMBERT, shading=ir.Shading.FLAT, normalized=False, threshold=0.0, values=white,
        textures=np.full(ir.SLOTS, -1), textured=False, first=-1, second=-1, medium=-1,
    )  # fmt: skip
    sensors = [
        _surface(rows, scene, meter, material, seed + k, fine) if meter.on else _rectangle(rows, meter, material, size, fine)
        for k, meter in enumerate(meters)
    ]
    tables = rows.finish()
    names = {
        table: (*getattr(scene.names, table), *[""] * (len(next(iter(getattr(tables, table)))) - len(getattr(scene.names, table))))
        for table in ("geometries", "materials")
    }
    placed = (*scene.names.instances, *["meter"] * (len(tables.instances.geometry) - len(scene.names.instances)))
    cameras = tuple(map(str, range(len(tables.cameras.extent))))
    named = replace(scene.names, **names, instances=placed, cameras=cameras)
    settings = ir.Settings(background=scene.settings.background)
    spans = replace(scene.spans, rows={table: of for table, of in scene.spans.rows.items() if table not in ("cameras", "settings")})
    return replace(scene, tables=tables, names=named, settings=settings, spans=spans), sensors


def _rectangle(rows: _Rows, meter: ir.Meter, material: int, size: float, fine: float) -> Sensor:
    """The sensor of a rectangle or a point."""
    frame = np.array(meter.frame)
    half = np.array(meter.size) / 2
    corners = np.abs(frame[:3, 3]) + np.abs(frame[:3, [0, 2]]) @ half
    scale = max(fine * float(corners.max()), FROM_SIZE * size, float(half.max())) or 1.0
    if not half.any():
        half = np.full(2, POINT * min(scale, size))
    lift = LIFT * scale
    height_error = _height_error(lift, max(size, float(half.max())), meter)
    x, z = half.tolist()
    parameters = np.zeros(ir.PARAMETERS)
    parameters[:2] = half
    geometry = rows.add(
        "geometries", kind=ir.GeometryKind.RECTANGLE, parameters=parameters, bounds=[[-x, 0.0, -z], [x, 0.0, z]], origin=np.zeros(3),
        **dict.fromkeys(
            ("first_vertex", "vertex_count", "first_triangle", "triangle_count", "first_polygon", "polygon_count"), 0
        ), **dict.fromkeys(("normals", "uvs", "colors", "tape"), -1),
    )  # fmt: skip
    _instance(rows, geometry, rows.transforms(_lifted(frame, lift)[None]), material, _lit_bits(rows.tables))
    camera = _cameras(rows, frame[None], 1.5 * lift, lift, x, z, meter.cells[0] / meter.cells[1])
    return Sensor(meter, range(camera, camera + 1), meter.cells, 4.0 * x * z if any(meter.size) else 0.0, height_error=height_error)


def _height_error(lift: float, size: float, meter: ir.Meter) -> float:
    """The share of light that the height of a sensor changes, beyond BIAS, which counts heights up to FAR · LIFT of the scene's size.

    It grows with the height. Raises MeterError for a height above HIGHEST of the size.
    """
    if lift > HIGHEST * size:
        raise MeterError(
            f"the meter `{meter.name}` lies too far from the origin: its sensor would lie {lift:.3g} m above its plane, "
            f"more than {HIGHEST:.0%} of the scene's {size:.3g} m",
            "move the scene and its meters to the origin", meter,
        )  # fmt: skip
    return BIAS * max(lift / (FAR * LIFT * size) - 1.0, 0.0)


def _surface(rows: _Rows, scene: ir.Scene, meter: ir.Meter, material: int, seed: int, fine: float) -> Sensor:
    """The sensor of the surface of objects: copies of them, and cameras at points that are even over their area."""
    instances = scene.tables.instances
    names = [*scene.names.instances, *[""] * (len(instances.geometry) - len(scene.names.instances))]
    try:
        chosen = np.flatnonzero(selection.named(names, meter.on))
    except selection.SelectionError as unknown:
        raise MeterError(f"the meter `{meter.name}` has no surface: {unknown}", "", meter) from None
    parts = triangles(scene, chosen)
    endless = set(chosen.tolist()) - {part.instance for part in parts}
    if endless:
        raise MeterError(
            f"the meter `{meter.name}` is on `{names[min(endless)]}`, which has no end or no surface",
            "give the meter a center and a size in place of `on`", meter,
        )  # fmt: skip
    bits = _lit_bits(rows.tables)
    for row in chosen.tolist():
        _instance(rows, int(instances.geometry[row]), int(instances.transform[row]), material, int(instances.visible[row]) & bits)
    corners = np.concatenate([part.positions[part.triangles] for part in parts])  # (n, 3, 3)
    deviation = np.concatenate([np.full(len(part.triangles), part.deviation) for part in parts])
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = 0.5 * np.linalg.norm(across, axis=1)
    total = float(areas.sum())
    random = np.random.default_rng(seed)
    side = -1.0 if meter.back else 1.0
    first, height_error = rows.counts.get("cameras", 0), 0.0
    size = max(extent(scene.tables), math.sqrt(total))
    for _ in range(REPLICATES):
        area_sample, u, v = ((random.random(3) + np.outer(np.arange(POINTS), STEPS)) % 1.0).T
        row, u = np.minimum(np.searchsorted(np.cumsum(areas), area_sample * total), len(areas) - 1), np.sqrt(u)
        weights = np.stack([1.0 - u, u * (1.0 - v), u * v], axis=1)
        points = np.einsum("ni,nij->nj", weights, corners[row])
        above = np.maximum(8.0 * deviation[row], fine * LIFT * np.abs(points).max(axis=1, initial=LIFT, keepdims=False))
        half = 1e-3 * above
        height_error = max(height_error, _height_error(float((fine * LIFT * np.abs(points)).max()), size, meter))
        _cameras(rows, _frames(points, side * across[row] / (2.0 * areas[row, None])), above, 2.0 * above, half, half)
    off = float(deviation.max(initial=0.0))
    return Sensor(meter, range(first, first + REPLICATES * POINTS), (1, 1), total, 4.0 * math.sqrt(math.pi * total) * off, height_error)


def extent(tables: ir.Tables) -> float:
    """The longest side of the box around the bounded instances, in metres; 1 without any."""
    boxes = world_bounds(tables)
    boxes = boxes[np.isfinite(boxes).all(axis=1)]
    return float((boxes[:, 3:].max(axis=0) - boxes[:, :3].min(axis=0)).max()) or 1.0 if len(boxes) else 1.0


def is_far(scene: ir.Scene, meters: Sequence[ir.Meter]) -> bool:
    """Whether the scene or a meter lies so far from the origin that sensors need float64."""
    reach = scene_facts.extents(scene.tables)[0]
    places = [max(abs(row[3]) for row in meter.frame[:3]) for meter in meters]
    return max([reach, *places]) > FAR * extent(scene.tables)


def triangles(scene: ir.Scene, rows: NDArray[np.int64]) -> list[Part]:
    """The surfaces of some instances in the world, shapes of lights too; unbounded ones are left out."""
    instances = ir.Instances(*(column[rows] for column in scene.tables.instances))
    instances = instances._replace(light=np.full_like(instances.light, -1))  # shapes of lights count as others, so that they have triangles
    dark = scene.tables.lights._replace(instance=np.full_like(scene.tables.lights.instance, -1))
    some = replace(scene, tables=scene.tables._replace(instances=instances, lights=dark), names=replace(scene.names, instances=()))
    return [part._replace(instance=int(rows[part.instance])) for part in printable_mesh.printable_parts(some)[0]]


def _frames(points: F64, normals: F64) -> F64:
    """(n, 4, 4) frames at points with +y along normals."""
    x = np.cross(normals, np.eye(3)[np.abs(normals).argmin(axis=1)])
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    matrices = np.tile(np.eye(4), (len(points), 1, 1))
    matrices[:, :3] = np.stack([x, normals, np.cross(x, normals), points], axis=2)
    return matrices


def _lifted(frame: F64, height: float) -> F64:
    matrices = frame.copy()
    matrices[:3, 3] += height * frame[:3, 1]
    return matrices


def _instance(rows: _Rows, geometry: int, transform: int, material: int, bits: int) -> None:
    visible = int(ir.Visibility.CAMERA) | bits
    rows.add("instances", geometry=geometry, transform=transform, material=material, light=-1, visible=visible)


def _lit_bits(tables: ir.Tables) -> int:
    """Bits of light links that let lights with `receivers` light a sensor, without those that make it cast shadows."""
    lit = int(np.bitwise_or.reduce(np.where(tables.lights.receivers == -1, 0, tables.lights.receivers), initial=0))
    return lit & ~int(np.bitwise_or.reduce(tables.lights.blockers, initial=0)) & ~7


def _cameras(rows: _Rows, frames: F64, height: Any, far: Any, half_x: Any, half_z: Any, aspect: float = 1.0) -> int:
    """Cameras above sensors with the frames (n, 4, 4) that look down at them; their pictures have x to the right and −z up.

    `aspect` is the number of cells along x over that along z.
    """
    turned = frames.copy()
    turned[:, :3, 1], turned[:, :3, 2] = -frames[:, :3, 2], frames[:, :3, 1]
    turned[:, :3, 3] += np.reshape(height, (-1, 1)) * frames[:, :3, 1]
    transform = rows.transforms(turned) + np.arange(len(frames))
    return rows.add(
        "cameras", len(frames), projection=ir.Projection.ORTHOGRAPHIC, transform=transform, extent=half_x, fit=ir.Fit.HORIZONTAL,
        aspect=0.0, near=0.0, far=far, shift=0.0, exposure=0.0, opening=0.0, shutter=0.0, lens=0.0, focus=1.0,
        pixel_aspect=half_x / half_z / aspect, planes=0.0,
    )  # fmt: skip
