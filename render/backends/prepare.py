"""What depends on the view and the backend and is worth keeping: tessellations, acceleration structures, light at vertices."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...compiler import ir
from ...compiler.plan import caustic_casters, light_shapes
from ...compiler.plan import plan as planner
from ...compiler.plan.plan import Plan
from .. import camera
from ..accel import intersect, scene_bvh
from ..accel.formula_packets import shadow_rays
from ..accel.traverse import motion_alpha
from ..film import film
from ..geometry.bounds import swept_bounds, world_bounds
from ..integrator import glossy_lights, no_ray_environment, vertex_lighting, whitted
from ..jit import compile_process
from ..jit.packed_struct import Handle, HandleType
from ..material import principled
from ..sampling import sobol
from ..simd import target
from ..surface import texture_footprint
from ..tessellation import analytic_shapes, vertex_meshes
from ..tessellation.view import ViewTessellator
from ..texture import procedural
from ..types import Film, Frame, Open, Options, Pinhole, Still, Tile, Triple, Unmet, View

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
    triangles: Any = None  # raster: a RasterScene
    lamps: list[int] = field(default_factory=list)  # ray: those that are asked for beforehand (hidden.py)


def prepare(scene: ir.Scene, plan: Plan, view: View) -> Prepared:
    """Make ready for drawing a validated scene with plan["backend"].

    Shapes shaded at vertices become meshes for every backend; for the raster backend all other analytic shapes are
    tessellated beside the tables, each to plan["tolerance"] pixels of this view. Endless shapes stay smooth: they have no
    vertices.
    """
    backend = plan["backend"]
    procedural.make_ready(scene.tables)
    tessellator = ViewTessellator(scene.tables, view, plan["tolerance"])
    lit = light_shapes.let_through(scene.tables, bool(plan["shadows.lamps"]))
    tables = principled.tables_for(vertex_meshes.with_vertex_shaded_meshes(lit, tessellator))
    if plan["textures"] == "filtered":
        further = bool(plan["bounces"] > 0) and plan["transport"] == "tree"
        tables = texture_footprint.with_pyramids(tables, view, _looks(plan), further)
    shells = tessellator.shells(tables) if backend == "raster" else {}
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
        from ..raster import band_renderer, raster_scene  # a tenth of what starting takes, for others too

        triangles = raster_scene.build(tables, view, shells)
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
    boxes = (swept_bounds if plan["motion"] else world_bounds)(tables)[~inside]
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
