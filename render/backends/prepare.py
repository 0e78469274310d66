"""What depends on the view and the backend and is worth keeping: tessellations, acceleration structures, light at vertices."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.plan import caustic_casters, light_shapes
from ...compiler.plan import plan as planner
from ...compiler.plan.plan import Plan
from .. import camera
from ..accel import intersect, scene_bvh
from ..accel.formula_packets import shadow_rays
from ..accel.traverse import motion_alpha
from ..film import film
from ..integrator import glossy_lights, no_ray_environment, vertex_lighting, whitted
from ..jit import compile_process
from ..jit.packed_struct import Handle, HandleType
from ..material import principled
from ..sampling import sobol
from ..simd import target
from ..surface import texture_footprint
from ..tessellation import analytic_shapes
from ..texture import procedural
from ..types import Film, Frame, Open, Options, Pinhole, Still, Tile, Triple, Unmet, View

_NEAREST = 0.01  # of a shape's size: where the eye is nearer to its box than this, the tolerance is measured at this distance
LAYERS = 8  # of what is partly there, one behind the other, each of which sends on mirrored and other rays
_BACKGROUNDS = {"sky": 0, "transparent": 1}


@dataclass(frozen=True, eq=False)
class Prepared:
    """Everything a renderer reads. `tables` are the scene's, with meshes in place of analytic shapes that are shaded at vertices."""

    tables: ir.Tables
    packed: Any  # the tables as kernels take them, a Handle; for the reference, the tables themselves
    accel: Any  # trace.Brute, or the Handle of a bvh.Bvh; None where no rays are needed
    gouraud: Any  # GouraudLight, or its Handle; None then, too
    options: Options
    frame: Any  # a Handle of a Frame, or the Frame itself
    paths: Any = None  # reference: a paths.Light; ray: float32 or float64, as wide as waves are; None: transport is no matter of paths
    photons: Any = None  # a photons.Tracer, where some light is carried by them
    shells: dict[int, analytic_shapes.Tessellation] = field(default_factory=dict)  # raster: instance -> its shape in triangles
    triangles: Any = None  # raster: a banded.Triangles, of all there are
    lamps: list[int] = field(default_factory=list)  # ray: those that are asked for beforehand (hidden.py)


def prepare(scene: ir.Scene, plan: Plan, view: View) -> Prepared:
    """Make ready for drawing a validated scene with plan["backend"].

    Shapes shaded at vertices become meshes for every backend; for the raster backend all other analytic shapes are
    tessellated beside the tables, each to plan["tolerance"] pixels of this view. Endless shapes stay smooth: they have no
    vertices.
    """
    backend = plan["backend"]
    procedural.make_ready(scene.tables)
    shapes = Shapes(scene.tables, view, plan["tolerance"])
    lit = light_shapes.let_through(scene.tables, bool(plan["shadows.lamps"]))
    tables = principled.tables_for(with_vertex_shaded_meshes(lit, shapes))
    if plan["textures"] == "filtered":
        further = bool(plan["bounces"] > 0) and plan["transport"] == "tree"
        tables = texture_footprint.with_pyramids(tables, view, _looks(plan), further)
    shells = shapes.shells(tables) if backend == "raster" else {}
    options = options_of(plan, tables)
    if backend == "raster" and plan["raster.secondary"] == "none":
        options = options._replace(environment=no_ray_environment.ambient_environment(scene, tables, options))
    weights = sobol.filter_table(plan["filter"], on_grid=plan["transport"] != "paths")  # the rasterizer draws no paths
    lens = camera.lens_of(tables, view) if backend != "raster" else Pinhole()
    accel = None
    if backend == "raster" and plan["raster.shadows"] == "map":
        from ..raster import shadow_map_pass  # as with paths: other pictures start without

        accel = trees(tables, plan)
        options = options._replace(maps=shadow_map_pass.build(tables, accel))
    frame = Frame(view, options, weights, shutter_of(tables, plan, view), order_of(plan), lens)
    if backend == "reference":
        accel = intersect.Brute()
        if plan["transport"] == "paths":
            return Prepared(tables, tables, accel, None, options, frame, paths=_light(tables, plan, tables, accel, frame))
        light = vertex_lighting.vertex_light(tables, tables, accel, frame)
        return Prepared(tables, tables, accel, light, options, frame, shells=shells)
    if plan["transport"] == "paths" and backend == "ray":
        return _for_paths(tables, plan, options, frame)
    packed, frames = Handle(tables), Handle(frame)
    triangles = None
    if backend == "raster":
        from ..raster import band_renderer  # a tenth of what starting takes, for others too

        triangles = band_renderer.triangles(tables, view, shells)
        if band_renderer.needs_no_rays(plan):
            return Prepared(tables, packed, None, None, options, frames, shells=shells, triangles=triangles)
    fresh = accel is None
    accel = accel or _not_linked(tables, plan)
    still = backend == "ray" and not plan["motion"]
    lamps = shadow_rays.lamps(accel.tables, tables, options) if still else []
    if fresh:
        if _takes_long(accel):
            kinds = whitted.kinds(frames, packed, accel, vertex_lighting.none(), bool(lamps))
            compile_process.compile_in_background(int(plan["threads"]), whitted.linked.kernel, *kinds)
        motion_alpha.link(accel)
    light = Handle(vertex_lighting.vertex_light(tables, packed, accel, frames))
    whitted.link(frames, packed, accel, light, bool(lamps))
    return Prepared(tables, packed, accel, light, options, frames, shells=shells, triangles=triangles, lamps=lamps)


def _looks(plan: Plan) -> int:
    """How many samples a pixel's textures are looked at by."""
    if plan["backend"] == "raster" and plan["raster.shading"] == "pixel":
        return 1
    settled = plan["error"] == 0.0 and np.isinf(plan["budget"])
    return int(plan["samples"]) if settled else min(int(plan["samples"]), film.FIRST)


def _for_paths(tables: ir.Tables, plan: Plan, options: Options, frame: Frame) -> Prepared:
    """Trees of all for the channels; pieces, trees of the rest and narrow tables for waves."""
    from ..accel import primitive_list
    from ..integrator import wavefront  # as with all of paths: other pictures start without

    threads = int(plan["threads"])
    kind = np.float32 if plan["precision"] == "float32" else np.float64
    lit = tables.lights.kind
    near = not ir.among(lit, (ir.LightKind.DIRECTIONAL, ir.LightKind.SUN, ir.LightKind.DOME)).any() and not plan["motion"]
    tried, inside = primitive_list.build(tables, near, plan["motion"])
    accel = Handle(wavefront.NoTrees())
    if not inside.all():
        brute, closed = plan["accelerator"] == "brute", plan["formulas"] == "closed"
        accel = Handle(scene_bvh.build(tables, brute, threads, moves=plan["motion"], left_out=inside, closed=closed))
    boxes = (scene_bvh.swept_bounds if plan["motion"] else scene_bvh.world_bounds)(tables)[~inside]
    low, high = boxes[:, :3].min(axis=0, initial=np.inf), boxes[:, 3:].max(axis=0, initial=-np.inf)
    if not np.isfinite(boxes).all():
        low, high = np.full(3, -np.inf), np.full(3, np.inf)
    light = _light(tables, plan, Handle(tables), None, Handle(frame))
    light, aims = _with_photons(tables, plan, light, kind) if plan["transport.caustics"] == "photons" else (light, None)
    scene = wavefront.Scene(_as(tables, kind), _as(tried, kind), _as(light, kind), not inside.all(), low, high)
    packed, frames, tracer = Handle(scene), Handle(_as(frame, kind)), None
    if not inside.all() or aims is not None:
        _tiles_ahead(threads, accel, packed, frames, kind, plan["transport.reuse"] == "blocks")
    if not inside.all():
        motion_alpha.link(accel)
    if aims is not None:
        from ..integrator import photon_tracer  # what few scenes need

        tracer = photon_tracer.Tracer(accel, packed, frames, _as(aims, kind), kind, threads or target.cores())
        tracer.ready()
    return Prepared(tables, packed, accel, None, options, frames, paths=kind, photons=tracer)


def _tiles_ahead(threads: int, accel: Handle, packed: Handle, frames: Handle, kind: type, reuses: bool) -> None:
    """Let what draws tiles of paths be compiled beside everything else; see ahead.start."""
    from ..integrator import wavefront, wavefront_blocks

    none, film = np.zeros((0, 0), np.int64), Film(np.zeros((0, 0, 3)), np.zeros((0, 0)), np.zeros((0, 0), np.int64))
    made = wavefront_blocks.draw_tile if reuses else wavefront.draw_tile
    compile_process.compile_in_background(
        threads, made, accel, packed, frames, Tile(0, 0, 0, 0), none, none, 1, film, _room_type(kind, reuses)
    )


@functools.cache
def _room_type(kind: type, reuses: bool) -> HandleType:
    from ..integrator import wavefront

    return Handle(wavefront.Room.of(kind, reuses)).numba_type


def _with_photons(tables: ir.Tables, plan: Plan, light: Any, kind: type) -> tuple[Any, Any]:
    """(what paths look for beside photons, where those are aimed); the light as it is and None where no lamp shines on what gathers."""
    from ..integrator import photon_map, photon_tracer

    covered = photon_tracer.covered(tables, light.emitters, plan.decisions["transport.caustics"].overridden)
    aims = photon_tracer.photon_targets(tables, light.emitters, covered)
    if aims is None:
        return light, None
    gains = caustic_casters.gains(tables) * (caustic_casters.gleam(tables) > 0.0)[tables.instances.material]
    gleaming = gains if gains.any() else photon_map.NoMaps()
    return light._replace(photons=photon_map.empty(kind), covered=covered, gleaming=gleaming), aims


def _light(tables: ir.Tables, plan: Plan, packed: Any, accel: Any, frame: Any) -> Any:
    """What paths look for; `packed`, `accel` and `frame` as gouraud.vertex_light takes them, without trees yet where those are None."""
    from ..integrator import path
    from ..light import emitters

    horizon = None
    if plan["horizon"]:
        horizon = np.array(no_ray_environment.normal(tables, planner.ground(tables)))
    vertices: Any = path.NoVertices()
    if (tables.materials.shading[tables.instances.material] == ir.Shading.GOURAUD).any():
        vertices = vertex_lighting.vertex_light(tables, packed, trees(tables, plan) if accel is None else accel, frame)
    weighing = path.WEIGHINGS.index(plan["weighing"])
    return path.Light(emitters.build(tables, plan["motion"], horizon), path.uses_of(tables), vertices, weighing)


def _as(nest: Any, kind: type) -> Any:
    """A nest of tuples with its float64 arrays as another kind."""
    if isinstance(nest, np.ndarray):
        return np.ascontiguousarray(nest, kind) if nest.dtype == np.float64 else nest
    return type(nest)(*(_as(item, kind) for item in nest)) if hasattr(nest, "_fields") else nest


def trees(tables: ir.Tables, plan: Plan) -> Handle:
    """Trees over a scene, ready for kernels."""
    accel = _not_linked(tables, plan)
    motion_alpha.link(accel)
    return accel


def _not_linked(tables: ir.Tables, plan: Plan) -> Handle:
    """The same before aside.link."""
    moves = plan["motion"] and plan["backend"] != "raster"
    brute, closed = plan["accelerator"] == "brute", plan["formulas"] == "closed"
    return Handle(scene_bvh.build(tables, brute, int(plan["threads"]), moves=moves, closed=closed))


def _takes_long(accel: Handle) -> bool:
    """Whether what goes through trees takes long to compile, and nothing else needs it to be compiled before."""
    kinds = accel.tables.placed[:, 3]
    return not motion_alpha.is_used(accel.numba_type) and bool(ir.among(kinds, (ir.GeometryKind.MESH, ir.GeometryKind.FORMULA)).any())


def shutter_of(tables: ir.Tables, plan: Plan, view: View) -> Still | Open:
    """When a view's rays fly."""
    return Open(*planner.open_during(tables, view.camera)) if plan["motion"] and plan["backend"] != "raster" else Still()


def order_of(plan: Plan) -> int:
    """How pixels share sequences of sample numbers."""
    return sobol.order_of(int(plan["samples"])) if plan["noise"] == "blue" else sobol.ALONE


def options_of(plan: Plan, tables: ir.Tables) -> Options:
    """The plan's values that kernels read."""
    background = plan["background"]
    colored = not isinstance(background, str)
    ground = planner.ground(tables) if plan["horizon"] else -1
    return Options(
        seed=int(plan["seed"]),
        bounces=int(plan["bounces"]),
        interreflection=bool(plan["interreflection"]),
        shadows=bool(plan["shadows"]) and not (plan["backend"] == "raster" and plan["raster.shadows"] == "none"),
        background=2 if colored else _BACKGROUNDS[background],
        horizon=Triple(*no_ray_environment.normal(tables, ground)) if ground >= 0 else Triple(0.0, 0.0, 0.0),
        ground=ground,
        layers=LAYERS if plan["opacity"] else 0,
        color=Triple(*(float(c) for c in background)) if colored else Triple(0.0, 0.0, 0.0),
        lamps=Unmet() if plan["transport"] == "paths" else glossy_lights.of(tables),
    )


# --- tessellation to the pixel -------------------------------------------------------------------------------------------


def pixel_size(tables: ir.Tables, view: View) -> float:
    """The side of a pixel in metres, at a distance of 1 m along the axis for a perspective camera, anywhere for an orthographic one."""
    cameras = tables.cameras
    pixels = view.height if cameras.fit[view.camera] == ir.Fit.VERTICAL else view.width
    return 2.0 * float(cameras.extent[view.camera]) / pixels


def nearest_depths(tables: ir.Tables, view: View, boxes: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Depths at which (n, 6) boxes begin, or the view does if later; and depths below which their tolerance is not told for."""
    to_camera = tables.transforms.inverse[tables.cameras.transform[view.camera]]
    middle, half = 0.5 * (boxes[:, :3] + boxes[:, 3:]), 0.5 * (boxes[:, 3:] - boxes[:, :3])
    depth = -(middle @ to_camera[2, :3] + to_camera[2, 3]) - half @ np.abs(to_camera[2, :3])
    return np.maximum(depth, float(tables.cameras.near[view.camera])), _NEAREST * np.linalg.norm(half, axis=1)


def object_tolerances(tables: ir.Tables, view: View, pixels: float) -> NDArray[np.float64]:
    """(instances,) what `pixels` are in each instance's own frame, where it is nearest to the eye and stretched most; nan if endless.

    Never more than asked; powers of √2, so that like instances share one tessellation.
    """
    boxes = scene_bvh.world_bounds(tables)
    with np.errstate(all="ignore"):
        nearest, least = nearest_depths(tables, view, boxes)
        size = np.full(len(boxes), pixel_size(tables, view))
        if tables.cameras.projection[view.camera] == ir.Projection.PERSPECTIVE:
            size = size * np.maximum(nearest, least)
        linear = tables.transforms.matrix[tables.instances.transform][:, :, :3]
        tolerance = pixels * size / np.linalg.norm(linear, ord=2, axis=(1, 2))
        return np.where(np.isfinite(boxes).all(axis=1), 2.0 ** (np.floor(2 * np.log2(tolerance)) / 2), np.nan)


class Shapes:
    """Tessellations of a view's analytic instances, each made once for a geometry and a tolerance."""

    def __init__(self, tables: ir.Tables, view: View, pixels: float) -> None:
        self.tables, self.pixels = tables, pixels
        self.eye = tables.transforms.matrix[tables.cameras.transform[view.camera], :, 3]
        self.view = view
        self._made: dict[tuple[int, float], analytic_shapes.Tessellation] = {}

    @cached_property
    def tolerances(self) -> NDArray[np.float64]:
        """Those of instances; see object_tolerances."""
        return object_tolerances(self.tables, self.view, self.pixels)

    def shells(self, tables: ir.Tables) -> dict[int, analytic_shapes.Tessellation]:
        """The tessellations of all instances that have one: not of meshes, formulas and quadrics, nor where the eye is so near to a round
        shape that triangles within the tolerance would be too many. What has none is met by a ray for each sample."""
        boxes = scene_bvh.world_bounds(tables)
        with np.errstate(all="ignore"):
            nearest, least = nearest_depths(tables, self.view, boxes)
        perspective = tables.cameras.projection[self.view.camera] == ir.Projection.PERSPECTIVE
        close = perspective & ~(nearest >= least)
        geometries, found = tables.geometries, {}
        for i in analytic_shapes.analytic_seen(tables).tolist():
            g = tables.instances.geometry[i]
            kind = int(geometries.kind[g])
            if kind in (ir.GeometryKind.FORMULA, ir.GeometryKind.QUADRIC):
                continue
            if kind in analytic_shapes.FLAT or not (
                close[i] or analytic_shapes.too_fine(kind, geometries.parameters[g].tolist(), self.key(i)[1])
            ):
                found[i] = self.of(i)
        return found

    def key(self, instance: int) -> tuple[int, float]:
        """What instances with the same tessellation have in common."""
        tolerance = float(self.tolerances[instance])
        return int(self.tables.instances.geometry[instance]), 0.0 if math.isnan(tolerance) else tolerance

    def of(self, instance: int) -> analytic_shapes.Tessellation:
        """The tessellation of one instance, in its own frame; not of an endless quadric."""
        key, geometries = self.key(instance), self.tables.geometries
        if geometries.kind[key[0]] == ir.GeometryKind.PLANE:  # its middle lies below the eye
            x, _, z = self.tables.transforms.inverse[self.tables.instances.transform[instance]] @ [*self.eye, 1.0]
            return analytic_shapes.plane(float(x), float(z))
        if key not in self._made and geometries.kind[key[0]] == ir.GeometryKind.FORMULA:
            self._made[key] = _formula(self.tables, key[0], key[1])
        if key not in self._made:
            self._made[key] = analytic_shapes.tessellate(int(geometries.kind[key[0]]), geometries.parameters[key[0]], key[1])
        return self._made[key]


def contoured(tables: ir.Tables, g: int, tolerance: float, whole: bool = False) -> Any:
    """A formula's surface as triangles, a contour.Contour in its own frame; of a sheet in a ball what lies in that. See contour.within."""
    from ...compiler.formula import dual_contouring
    from ..formula import scene_surfaces

    made = dual_contouring.within(scene_surfaces.tape_of(tables, g), tables.geometries.bounds[g], tolerance, whole=whole)
    *middle, radius = tables.geometries.parameters[g, 1:5].tolist()
    if radius > 0.0:
        inside = np.linalg.norm(made.positions[made.triangles].mean(axis=1) - middle, axis=1) <= radius
        made = made._replace(triangles=made.triangles[inside])
    return made


def _formula(tables: ir.Tables, g: int, tolerance: float) -> analytic_shapes.Tessellation:
    made = contoured(tables, g, tolerance)
    positions = np.concatenate([made.positions, np.ones((len(made.positions), 1))], axis=1)
    triangles = made.triangles.astype(np.int32)
    uvs = np.stack([made.positions[:, 0], -made.positions[:, 2]], axis=1)  # as shapes.uv has them
    return analytic_shapes.Tessellation(positions, triangles, made.normals, uvs, np.zeros(len(triangles), np.int32))


# --- meshes in place of shapes shaded at vertices ------------------------------------------------------------------------


def with_vertex_shaded_meshes(tables: ir.Tables, shapes: Shapes) -> ir.Tables:
    """The same scene with a mesh for each bounded analytic instance whose material is shaded at vertices (Gouraud)."""
    instances = tables.instances
    chosen = tables.materials.shading[instances.material] == ir.Shading.GOURAUD
    chosen &= tables.geometries.kind[instances.geometry] != ir.GeometryKind.MESH
    if chosen.any():
        chosen &= np.isfinite(shapes.tolerances)
    if not chosen.any():
        return tables
    geometry = instances.geometry.copy()
    rows: dict[tuple[int, float], int] = {}
    made: list[tuple[int, analytic_shapes.Tessellation]] = []
    for i in np.flatnonzero(chosen):
        key = shapes.key(int(i))
        if key not in rows:
            rows[key] = len(tables.geometries.kind) + len(made)
            made.append((key[0], shapes.of(int(i))))
        geometry[i] = rows[key]
    placed = ir.table_of("instances", {**instances._asdict(), "geometry": geometry})
    return _with_meshes(tables, made)._replace(instances=placed)


def _with_meshes(tables: ir.Tables, made: list[tuple[int, analytic_shapes.Tessellation]]) -> ir.Tables:
    """Tables with a mesh geometry more for each (geometry it stands for, triangles), with normals and coordinates by vertex."""
    pools, attributes, geometries = tables.pools, tables.attributes, tables.geometries
    vertices, triangles, values = len(pools.positions), len(pools.triangles), len(pools.values)
    positions_of, triangles_of, values_of = [pools.positions], [pools.triangles], [pools.values]
    attribute_rows: list[tuple[int, int, int, int]] = []
    geometry_rows: dict[str, list[Any]] = {name: [] for name in geometries._fields}
    for original, mesh in made:
        count = len(mesh.positions)
        row = {
            "kind": ir.GeometryKind.MESH, "parameters": np.zeros(ir.PARAMETERS),
            "bounds": geometries.bounds[original], "origin": np.zeros(3),
            "first_vertex": vertices, "vertex_count": count, "first_triangle": triangles, "triangle_count": len(mesh.triangles),
            "first_polygon": 0, "polygon_count": 0, "colors": -1, "tape": -1,
        }  # fmt: skip
        for name, data in (("normals", mesh.normals), ("uvs", mesh.uvs)):
            row[name] = len(attributes.width) + len(attribute_rows)
            attribute_rows.append((ir.Interpolation.VERTEX, data.shape[1], values, count))
            values_of.append(data.astype(np.float32).ravel())
            values += data.size
        for name, value in row.items():
            geometry_rows[name].append(value)
        positions_of.append(mesh.positions[:, :3].astype(np.float32))
        triangles_of.append(mesh.triangles + np.int32(vertices))
        vertices += count
        triangles += len(mesh.triangles)
    columns = ("interpolation", "width", "first", "count")
    more_attributes: dict[str, Any] = {name: [row[k] for row in attribute_rows] for k, name in enumerate(columns)}
    grown = {"positions": positions_of, "triangles": triangles_of, "values": values_of}
    return tables._replace(
        pools=ir.table_of("pools", {**pools._asdict(), **{name: np.concatenate(rows) for name, rows in grown.items()}}),
        attributes=_appended("attributes", attributes, more_attributes),
        geometries=_appended("geometries", geometries, geometry_rows),
    )


def _appended(table: str, rows: Any, more: dict[str, Any]) -> Any:
    """A table with more rows."""
    return ir.table_of(table, {name: np.concatenate([getattr(rows, name), np.asarray(more[name])]) for name in rows._fields})
