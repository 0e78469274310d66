"""Decisions about how the scene is evaluated: backend, accelerator, implicit surfaces, motion, textures."""

from __future__ import annotations

import math

from ...lang.schema.picture_settings import BACKENDS
from .. import ir
from .decision import Decision, Plan, Rule
from .picture_rules import RASTER_MOMENTS
from .scene_facts import moving, used_rows

BRUTE_FORCE_INSTANCES = 2  # analytic shapes, up to which a loop is as fast as a BVH (9.2 against 8.9 million rays a second at 2)
MANY_SAMPLES = 16  # a pixel, from which on patterns are not filtered: the samples suffice


def _backend(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    if settings.backend in (None, "auto"):
        return Decision("backend", "ray", "draws every kind of scene", BACKENDS, fixed="--backend")
    return Decision("backend", settings.backend, "asked for", BACKENDS, fixed="--backend")


def _accelerator(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    tables = scene.tables
    choices = ("bvh", "brute_force")
    meshes = tables.geometries.kind[tables.instances.geometry] == ir.GeometryKind.MESH
    count = len(tables.instances.geometry)
    if plan["backend"] == "reference":
        return Decision("accelerator", "brute_force", "the reference backend intersects every primitive", fixed="--backend")
    if count <= BRUTE_FORCE_INSTANCES and not meshes.any():
        return Decision("accelerator", "brute_force", f"{count} shapes: a loop is faster than a BVH", choices)
    reason = f"{count} instances of {len(tables.geometries.kind)} geometries, {len(tables.pools.triangles)} triangles"
    return Decision("accelerator", "bvh", reason, choices)


def _implicit_surfaces(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    name, tables, choices = "implicit_surfaces", scene.tables, ("closed_form", "interval")
    shown = used_rows(tables.instances.geometry)
    surfaces = shown[tables.geometries.kind[shown] == ir.GeometryKind.FORMULA].tolist()
    if plan["backend"] == "reference":
        return Decision(name, "interval", "the reference backend isolates roots by interval arithmetic alone", fixed="--backend")
    if not surfaces:
        return Decision(name, "interval", "the scene has none", fixed="the scene's shapes")
    from ..formula import closed_form_solids  # loaded for scenes with formulas alone

    closed = sum(closed_form_solids.of_geometry(tables, g) is not None for g in surfaces)
    if not closed:
        reason = "no surface consists of planes, quadrics and tori: interval arithmetic isolates roots"
        return Decision(name, "interval", reason, ("interval",))
    count = f"{closed} of {len(surfaces)}" if closed < len(surfaces) else "each" if closed > 1 else "it"
    return Decision(name, "closed_form", f"surfaces of planes, quadrics and tori ({count}): all roots along a ray in closed form", choices)


def _motion_blur(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    name, tables, row = "motion_blur", scene.tables, plan["camera"]
    shutter = float(tables.cameras.shutter[row])
    if shutter <= 0.0:
        return Decision(name, False, "the shutter is open for no time", fixed="the camera's shutter")
    if not moving(tables, row):
        return Decision(name, False, f"nothing moves in the {shutter:.4g} s that the shutter is open", fixed="the scene's motion")
    count = int((tables.transforms.first_key[tables.instances.transform] >= 0).sum())
    camera = ", the camera" if tables.transforms.first_key[tables.cameras.transform[row]] >= 0 else ""
    objects = f"{count} object{'s' if count != 1 else ''}{camera}"
    how = "each ray has a time" if plan["backend"] != "raster" else f"drawn at {RASTER_MOMENTS} times, which samples share"
    return Decision(name, True, f"moving in the {shutter:.4g} s of the shutter: {objects}; {how}")


def _texture_filter(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    name, tables = "texture_filter", scene.tables
    rows = used_rows(tables.materials.textures[used_rows(tables.instances.material)])
    kind, nearest = tables.textures.kind[rows], tables.textures.nearest[rows]
    patterns, images = bool((kind == ir.TextureKind.FORMULA).any()), bool(((kind == ir.TextureKind.IMAGE) & ~nearest).any())
    cells = bool(ir.is_in(kind, (ir.TextureKind.CHECKER, ir.TextureKind.STRIPES)).any())
    if not patterns and not images and not cells:
        return Decision(name, "point", "no material has a texture to filter", fixed="the scene's materials")
    why = ""
    adaptive = plan["error"] or math.isfinite(plan["budget"])
    if not images and (adaptive or (not cells and plan["samples"] >= MANY_SAMPLES)):
        why = "the samples of a pixel suffice for patterns"
    if plan["transport"] == "path":
        why = "path tracing takes many samples"
    elif plan["motion_blur"] or plan["lens"] != "pinhole":
        why = "each pixel has many camera rays"
    if why:
        return Decision(name, "point", why, ("point",))
    if patterns or not images:
        return Decision(name, "footprint", "patterns are averaged over a pixel's footprint", ("footprint", "point"))
    return Decision(name, "footprint", "images are filtered over a pixel's footprint", ("footprint", "point"))


BACKEND: tuple[Rule, ...] = (_backend,)
GEOMETRY: tuple[Rule, ...] = (_accelerator, _implicit_surfaces)
MOTION: tuple[Rule, ...] = (_motion_blur,)
TEXTURES: tuple[Rule, ...] = (_texture_filter,)
