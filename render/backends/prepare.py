"""Builds all data of one view that a backend reads: tessellations, acceleration structures, light at vertices."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...compiler import ir
from ...compiler.plan import caustic_casters, light_shapes, scene_facts, without_media
from ...compiler.plan.plan import Plan
from ...lights import DISTANT, PICTURED
from ...materials import traits
from .. import camera
from ..accel import intersect, scene_bvh
from ..accel.bvh_build.scene_layout import KIND
from ..accel.formula_packets import shadow_rays
from ..accel.traverse import motion_alpha
from ..film import adaptive_sampling, tile_calls, tile_queue
from ..geometry.bounds import swept_bounds, world_bounds
from ..integrator import glossy_lights, no_ray_environment, sky_sampling, vertex_lighting, whitted
from ..jit import compile_process
from ..jit.packed_struct import Handle, HandleType
from ..light import airlight, dome_spots, environment_map, links
from ..material import flakes, medium_stack, principled
from ..sampling import sobol
from ..simd import target
from ..surface import texture_footprint
from ..tessellation import analytic_shapes, vertex_meshes
from ..tessellation.view import ViewTessellator
from ..texture import graphs, procedural
from ..types import Film, Float3, Frame, Lens, NoGlossyLights, Options, Shutter, StillScene, Tile, VertexLight, View
from . import camera_media

ALPHA_LAYERS = 8  # partly transparent surfaces along a ray that each spawn secondary rays
INPUTS = 4  # handles that the kernel of tiles of the ray backend takes
_BACKGROUNDS = {"sky": 0, "transparent": 1}


@dataclass(frozen=True, eq=False)
class Prepared:
    """All data that a renderer reads. `tables` are the scene's, with meshes in place of analytic shapes shaded at vertices."""

    tables: ir.Tables
    packed: Any  # Handle of the tables; reference: the tables
    accel: Any  # intersect.Brute, or Handle of a scene_bvh.Bvh; None if the picture traces no rays
    vertex_light: Any  # VertexLight or its Handle; None if the picture traces no rays
    options: Options
    frame: Any  # Handle of a Frame; reference: the Frame
    paths: Any = None  # reference: a path_state.PathInputs; ray: the wavefront's dtype, float32 or float64; None: no path transport
    photon_tracer: Any = None  # photon_tracer.Tracer, if photons carry some light
    tessellations: dict[int, analytic_shapes.Tessellation] = field(default_factory=dict)  # raster: by instance
    raster: Any = None  # raster: a RasterScene
    packet_lights: list[int] = field(default_factory=list)  # ray: lights that shadow packets sample, see shadow_rays.py


def prepare(scene: ir.Scene, plan: Plan, view: View, general: bool = False) -> Prepared:
    """Prepare a validated scene for plan["backend"].

    Every backend gets meshes in place of shapes shaded at vertices. The raster backend also gets tessellations of the other analytic
    shapes, to plan["tolerance"] pixels of this view. Unbounded shapes have no vertices and stay smooth. With `general`, the tables hold
    every optional part, empty where the scene does not need it: general kernels are compiled for these.
    """
    backend = plan["backend"]
    procedural.link(scene.tables)
    tessellator = ViewTessellator(scene.tables, view, plan["tolerance"])
    tables = _renderable_tables(scene, plan, view, tessellator, general)
    tessellations = tessellator.tessellations(tables) if backend == "raster" else {}
    options = options_of(plan, tables, general)
    if plan["transport"] != "path":
        dome_map = sky_sampling.find_dome_map(tables, _horizon(tables, plan), general)
        options = options._replace(airlight=airlight.build(scene.tables), dome_map=dome_map)
    if backend == "raster" and plan["raster.secondary_rays"] == "none":
        options = options._replace(environment=no_ray_environment.ambient_environment(scene, tables, options, general))
    weights = sobol.filter_table(plan["filter"], on_grid=plan["transport"] != "path")  # the rasterizer draws no paths
    lens = camera.lens_of(tables, view, general) if backend != "raster" else Lens()
    accel = None
    if backend == "raster" and plan["raster.shadows"] == "map":
        from ..raster import shadow_map_pass  # only pictures with shadow maps load it

        accel = build_bvh(tables, plan, general)
        options = options._replace(maps=shadow_map_pass.build(tables, accel))
    frame = Frame(view, options, weights, shutter_of(tables, plan, view, general), order_of(plan), lens)
    if backend == "reference":
        accel = intersect.Brute()
        if plan["transport"] == "path":
            return Prepared(tables, tables, accel, None, options, frame, paths=_path_light(tables, plan, tables, accel, frame))
        light = vertex_lighting.vertex_light(tables, tables, accel, frame)
        return Prepared(tables, tables, accel, light, options, frame, tessellations=tessellations)
    if plan["transport"] == "path" and backend == "ray":
        return _prepare_paths(tables, plan, options, frame, general)
    packed, frames = Handle(tables), Handle(frame)
    raster = None
    if backend == "raster":
        from ..raster import band_renderer, raster_scene  # a tenth of the start-up time

        raster = raster_scene.build(tables, view, tessellations, general, by_tiles=not band_renderer.can_draw(plan))
        if band_renderer.needs_no_rays(plan):
            return Prepared(tables, packed, None, None, options, frames, tessellations=tessellations, raster=raster)
    accel, light, lights = _link_whitted(tables, plan, options, packed, frames, accel, general)
    return Prepared(tables, packed, accel, light, options, frames, tessellations=tessellations, raster=raster, packet_lights=lights)


def _renderable_tables(scene: ir.Scene, plan: Plan, view: View, tessellator: ViewTessellator, general: bool) -> ir.Tables:
    """The scene's tables as all backends shade them: layered materials, meshes shaded at vertices, texture pyramids."""
    if plan["transport"] == "path":
        source = without_media.with_an_instance(scene.tables)
    else:
        source = without_media.substitute(scene.tables, plan["bounces"] > 0)
    transparent = light_shapes.let_through(source, bool(plan["shadows.light_shapes"]))
    around = camera_media.around(source, view.camera)
    flat = vertex_meshes.replace_vertex_shaded(transparent, tessellator)
    tables = principled.tables_for(flat, general, around, plan["working_space"] if plan["transport"] == "path" else None)
    tables = flakes.with_view(graphs.with_lookups(tables), view, _texture_samples(plan))
    if plan["transport"] == "path" and plan["backend"] == "ray":
        return tables  # paths do not filter textures
    if plan["texture_filter"] == "footprint":
        further = bool(plan["bounces"] > 0) and plan["transport"] == "whitted"
        return texture_footprint.with_pyramids(tables, view, _texture_samples(plan), further, general)
    return texture_footprint.without_filter(tables) if general else tables


def _link_whitted(
    tables: ir.Tables, plan: Plan, options: Options, packed: Handle, frames: Handle, accel: Handle | None, general: bool
) -> Any:  # fmt: skip
    """(BVH, light at vertices, lights of shadow packets), with the Whitted integrator linked into `frames`; `accel` is a linked BVH."""
    linked = accel is not None
    accel = accel or _build_unlinked(tables, plan, general)
    still = plan["backend"] == "ray" and not plan["motion_blur"]
    lights = shadow_rays.select_lights(accel.tables, tables, options) if still else []
    if not linked:
        if _compiles_slowly(accel):
            kinds = whitted.kinds(frames, packed, accel, vertex_lighting.none(), bool(lights))
            compile_process.compile_in_background(int(plan["threads"]), whitted.linked.kernel, *kinds)
        elif plan["backend"] == "ray":
            tile_queue.compile_in_background(int(plan["threads"]), INPUTS, tile_calls.TILE)
        motion_alpha.link(accel, general)
    light = Handle(vertex_lighting.vertex_light(tables, packed, accel, frames))
    whitted.link(frames, packed, accel, light, bool(lights))
    return accel, light, lights


def _texture_samples(plan: Plan) -> int:
    """Samples of a pixel that look up textures."""
    if plan["backend"] == "raster" and plan["raster.shading"] == "pixel":
        return 1
    settled = plan["error"] == 0.0 and np.isinf(plan["budget"])
    return int(plan["samples"]) if settled else min(int(plan["samples"]), adaptive_sampling.first_samples(plan["error"]))


def _prepare_paths(tables: ir.Tables, plan: Plan, options: Options, frame: Frame, general: bool) -> Prepared:
    """For the wavefront path tracer: a primitive list, a BVH of the other instances, and tables in its precision."""
    from ..accel import primitive_list
    from ..integrator import wave_memory  # only path-traced pictures load it

    threads = int(plan["threads"])
    kind = np.float32 if plan["precision"] == "float32" else np.float64
    lit = tables.lights.kind
    near = not ir.is_in(lit, (*DISTANT, *PICTURED)).any() and not plan["motion_blur"]
    primitives, inside = primitive_list.build(tables, near, plan["motion_blur"], general)
    accel = Handle(wave_memory.NoBvh())
    if general or not inside.all():
        brute, closed = plan["accelerator"] == "brute_force", plan["implicit_surfaces"] == "closed_form"
        built = scene_bvh.build(tables, brute, threads, moves=plan["motion_blur"], left_out=inside, closed=closed, general=general)
        accel = Handle(built)
    boxes = (swept_bounds if plan["motion_blur"] else world_bounds)(tables)[~inside]
    low, high = boxes[:, :3].min(axis=0, initial=np.inf), boxes[:, 3:].max(axis=0, initial=-np.inf)
    if not np.isfinite(boxes).all():
        low, high = np.full(3, -np.inf), np.full(3, np.inf)
    light = _path_light(tables, plan, Handle(tables), None, Handle(frame), general)
    light, aims = _add_photons(tables, plan, light, kind) if plan["transport.caustics"] == "photons" else (light, None)
    light = _fill_photons(tables, light, kind) if general else light
    scene = wave_memory.WaveScene(cast(tables, kind), cast(primitives, kind), cast(light, kind), not inside.all(), low, high)
    packed, frames, tracer = Handle(scene), Handle(cast(frame, kind)), None
    if general or not inside.all() or aims is not None:
        _compile_tiles(threads, accel, packed, frames, kind, plan["transport.path_reuse"] == "groups")
    if general or not inside.all():
        motion_alpha.link(accel, general)
    if aims is not None:
        from ..integrator.photons import tracer as photons  # few scenes need it

        tracer = photons.Tracer(accel, packed, frames, cast(aims, kind), kind, threads or target.cores(), light.photons.beams)
        tracer.compile_kernel()
    return Prepared(tables, packed, accel, None, options, frames, paths=kind, photon_tracer=tracer)


def _compile_tiles(threads: int, accel: Handle, packed: Handle, frames: Handle, kind: type, reuses: bool) -> None:
    """Start compiling the kernel that draws tiles, in the background; see compile_process.py."""
    from ..integrator import wavefront

    none, film = np.zeros((0, 0), np.int64), Film(np.zeros((0, 0, 3)), np.zeros((0, 0)), np.zeros((0, 0), np.int64))
    kernel = wavefront.draw_tile_in_groups if reuses else wavefront.draw_tile
    compile_process.compile_in_background(
        threads, kernel, accel, packed, frames, Tile(0, 0, 0, 0), none, none, 1, film, workspace_type(kind, reuses)
    )


@functools.cache
def workspace_type(kind: type, reuses: bool) -> HandleType:
    """The type of a thread's memory of waves."""
    from ..integrator import wave_memory

    return Handle(wave_memory.WaveMemory.of(kind, reuses)).type


def _add_photons(tables: ir.Tables, plan: Plan, light: Any, kind: type) -> tuple[Any, Any]:
    """(path light with photon maps, photon targets); the light unchanged and None if no light reaches a gathering surface."""
    from ..integrator.photon_maps import photon_map
    from ..integrator.photons import aims as targets

    spots = dome_spots.build(tables, environment_map.row_of(light.emitters.sky))
    photon_emitters = targets.carried_by_photons(tables, light.emitters, spots, plan.decisions["transport.caustics"].overridden)
    aims = targets.photon_targets(tables, light.emitters, spots, photon_emitters)
    if aims is None:
        return light, None
    aims = aims._replace(inside=_emitter_stacks(tables, light.emitters, photon_emitters))
    gains = caustic_casters.gains(tables) * (traits.narrow_highlights(tables) > 0.0)[tables.instances.material]
    caustic_reflectance = gains if gains.any() else photon_map.NoMaps()
    photons = _no_photons(tables, kind, _beamed(tables, plan), aims.reach)
    light = light._replace(photons=photons, photon_emitters=photon_emitters, caustic_reflectance=caustic_reflectance)
    return light._replace(spots=spots), aims


def _no_photons(tables: ir.Tables, kind: type, beamed: np.ndarray | None = None, reach: float = 0.0) -> Any:
    """Maps without photons, with those of media in scenes with scattering ones; see photon_beams.Beams."""
    from ..integrator.photon_maps import photon_beams, photon_map, photon_volume

    maps = photon_map.empty(kind)
    if medium_stack.scattering(tables) is None:
        return maps
    table: Any = tables.materials.media  # pyright: ignore[reportAttributeAccessIssue]
    none = np.zeros(len(table.index), bool)
    beams = photon_beams.empty(kind, none if beamed is None else beamed, reach)
    return maps._replace(volume=photon_volume.empty(kind), beams=beams)


def _beamed(tables: ir.Tables, plan: Plan) -> np.ndarray | None:
    """By number, whether photons in a medium are beams; None in scenes without scattering media."""
    form = plan.decisions["transport.caustics_in_media"]
    if medium_stack.scattering(tables) is None:
        return None
    table: Any = tables.materials.media  # pyright: ignore[reportAttributeAccessIssue]
    beamed = np.zeros(len(table.index), bool)
    if form.value == "beams":
        thin, medium = caustic_casters.beam_media(tables, form.overridden), tables.materials.medium
        rows = np.flatnonzero((table.number > 0) & (medium >= 0))
        beamed[table.number[rows]] = thin[medium[rows]]
        beamed[1:2] |= (thin & tables.media.everywhere).any()
    return beamed


def _emitter_stacks(tables: ir.Tables, emitters: Any, chosen: np.ndarray) -> Any:
    """The medium stacks where emitters are, for photons; see photons.media.stacks."""
    from ..integrator.photons import aims, media

    if medium_stack.scattering(tables) is None:
        return aims.NoStacks()
    table: Any = tables.materials.media  # pyright: ignore[reportAttributeAccessIssue]
    outside = 1 if tables.media.everywhere.any() else 0

    def search(place: np.ndarray) -> int:
        stack = np.int64(outside)
        for row in camera_media.around_place(tables, table.number > 0, place):
            stack = medium_stack.push(stack, np.int64(table.number[row]))
        return int(stack)

    return media.stacks(emitters, chosen, outside, search)


def _fill_photons(tables: ir.Tables, light: Any, kind: type) -> Any:
    """Path light with empty records in place of absent ones of photons."""
    from ..integrator.photon_maps import photon_map

    absent = photon_map.NoMaps
    return light._replace(
        photons=_no_photons(tables, kind) if isinstance(light.photons, absent) else light.photons,
        photon_emitters=np.zeros(len(light.emitters.kind), bool) if isinstance(light.photon_emitters, absent) else light.photon_emitters,
        caustic_reflectance=np.zeros(len(tables.instances.geometry))
        if isinstance(light.caustic_reflectance, absent)
        else light.caustic_reflectance,
        spots=dome_spots.none() if isinstance(light.spots, dome_spots.NoSpots) else light.spots,
    )


def _path_light(tables: ir.Tables, plan: Plan, packed: Any, accel: Any, frame: Any, general: bool = False) -> Any:
    """The path_state.PathInputs of a scene; arguments as for vertex_lighting.vertex_light, which gets a new BVH if `accel` is None."""
    from ..integrator.state import path_state
    from ..light import emitter_table

    nowhere = VertexLight(np.full(len(tables.instances.geometry), -1, np.int64), np.zeros((2, 3)))
    vertices: Any = nowhere if general else path_state.NoVertices()
    if (tables.materials.shading[tables.instances.material] == ir.Shading.GOURAUD).any():
        vertices = vertex_lighting.vertex_light(tables, packed, build_bvh(tables, plan, general) if accel is None else accel, frame)
    weighing = path_state.WEIGHINGS.index(plan["mis"])
    learns = plan["transport.sky_visibility"] == "learnt"
    emitters = emitter_table.build(tables, plan["motion_blur"], _horizon(tables, plan), general, learns)
    return path_state.PathInputs(emitters, path_state.uses_of(tables), vertices, weighing)


def _horizon(tables: ir.Tables, plan: Plan) -> np.ndarray | None:
    """The unit normal of the ground plane, or None without one."""
    return np.array(no_ray_environment.normal(tables, scene_facts.ground(tables))) if plan["ground_plane"] else None


def cast(nest: Any, kind: type) -> Any:
    """Nested NamedTuples with their float64 arrays converted to another dtype."""
    if isinstance(nest, np.ndarray):
        return np.ascontiguousarray(nest, kind) if nest.dtype == np.float64 else nest
    return type(nest)(*(cast(item, kind) for item in nest)) if hasattr(nest, "_fields") else nest


def build_bvh(tables: ir.Tables, plan: Plan, general: bool = False) -> Handle:
    """The scene's BVH, linked for kernels."""
    accel = _build_unlinked(tables, plan, general)
    motion_alpha.link(accel, general)
    return accel


def _build_unlinked(tables: ir.Tables, plan: Plan, general: bool) -> Handle:
    """The scene's BVH before motion_alpha.link."""
    moves = plan["motion_blur"] and plan["backend"] != "raster"
    brute, closed = plan["accelerator"] == "brute_force", plan["implicit_surfaces"] == "closed_form"
    return Handle(scene_bvh.build(tables, brute, int(plan["threads"]), moves=moves, closed=closed, general=general))


def _compiles_slowly(accel: Handle) -> bool:
    """Whether BVH traversal compiles slowly and no other kernel needs it earlier."""
    kinds = accel.tables.instance_rows[:, KIND]
    return not motion_alpha.is_used(accel.type) and bool(ir.is_in(kinds, (ir.GeometryKind.MESH, ir.GeometryKind.FORMULA)).any())


def shutter_of(tables: ir.Tables, plan: Plan, view: View, general: bool = False) -> StillScene | Shutter:
    """The interval in which the shutter is open."""
    if plan["motion_blur"] and plan["backend"] != "raster":
        return Shutter(*scene_facts.open_during(tables, view.camera))
    return Shutter(0.0, 0.0) if general and plan["backend"] == "ray" else StillScene()


def order_of(plan: Plan) -> int:
    """How pixels share sample sequences, as `Frame.order`."""
    return sobol.order_of(int(plan["samples"])) if plan["noise"] == "blue" else sobol.ALONE


def options_of(plan: Plan, tables: ir.Tables, general: bool = False) -> Options:
    """The plan's decisions that kernels read."""
    background = plan["background"]
    colored = not isinstance(background, str)
    ground = scene_facts.ground(tables) if plan["ground_plane"] else -1
    return Options(
        seed=int(plan["seed"]),
        bounces=int(plan["bounces"]),
        interreflection=bool(plan["interreflection"]),
        shadows=bool(plan["shadows"]) and not (plan["backend"] == "raster" and plan["raster.shadows"] == "none"),
        background=2 if colored else _BACKGROUNDS[background],
        horizon=Float3(*no_ray_environment.normal(tables, ground)) if ground >= 0 else Float3(0.0, 0.0, 0.0),
        ground=ground,
        layers=ALPHA_LAYERS if plan["opacity"] else 0,
        color=Float3(*(float(c) for c in background)) if colored else Float3(0.0, 0.0, 0.0),
        links=links.of(tables),
        glossy_lights=NoGlossyLights() if plan["transport"] == "path" else glossy_lights.find_glossy_lights(tables, general),
    )
