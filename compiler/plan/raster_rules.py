"""Decisions of the raster backend: secondary rays, shadows, tessellation, coverage, shading rate and precision."""

from __future__ import annotations

import math
from typing import Any

from ...lights import SOFT
from ...materials import traits
from ...materials.contract import Lobes
from .. import ir
from ..ir import light_links
from . import scene_facts
from .decision import Decision, Plan, Rule
from .transport_rules import PRECISIONS

TOLERANCE = 0.05  # pixels
BAND_SAMPLES = 16  # sample positions of a pixel that bands hold at a time
SHADOWS = ("rays", "map", "none")
SECONDARY_RAYS = ("none", "trace")
COVERAGES = ("edges", "areas", "scanline")


def _secondary_rays(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    reason = "mirrors, metals and glass show the sky and, below it, the ground's mean light: no secondary ray is traced"
    if not (traits.specular(scene.tables) & traits.used(scene.tables)).any():
        reason = "no material reflects or refracts"
    return Decision("raster.secondary_rays", "none", reason, SECONDARY_RAYS)


def _shadows(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    if not plan["shadows"]:
        return Decision("raster.shadows", "none", "no light casts any", SHADOWS[2:])
    reason = "each point traces shadow rays: exact"
    if light_links.selective(scene.tables).any():
        return Decision("raster.shadows", "rays", f"{reason}; shadow maps hold the blockers of all lights", ("rays", "none"))
    if plan["opacity"]:
        return Decision("raster.shadows", "rays", f"{reason}; shadow maps hold no partly transparent surfaces", ("rays", "none"))
    return Decision("raster.shadows", "rays", f"{reason} (`map`: filtered shadow maps; area lights keep rays)", SHADOWS)


def _tolerance(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    meaning = "pixels that a tessellated shape may be off its true outline"
    if settings.tolerance is not None:
        return Decision("tolerance", float(settings.tolerance), f"asked for: {meaning}")
    return Decision("tolerance", TOLERANCE, f"the default: {meaning}")


def _coverage(scene: ir.Scene, *_: Any) -> Decision:
    return Decision("raster.coverage", "edges", "exact edge functions; all three cover the same samples", COVERAGES)


def _sample_positions(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    samples, name = plan["samples"], "raster.sample_positions"
    if plan["error"] > 0.0 or math.isfinite(plan["budget"]):
        return Decision(name, "per_pixel", "adaptive sampling: the number of samples of a pixel is not known in advance", ("per_pixel",))
    if samples == 1:
        return Decision(name, "shared", "one sample in the middle of each pixel", ("shared",))
    if plan["monte_carlo"]:
        why = "random light: the samples are the ray backend's, so that both have the same noise"
    elif samples > BAND_SAMPLES:
        why = f"edges finer than 1/{BAND_SAMPLES} of a pixel: the positions are the ray backend's"
    else:
        return Decision(name, "shared", "the same positions in every pixel, in bands", ("shared", "per_pixel"))
    return Decision(name, "per_pixel", f"{why} (`shared`: faster, in bands)", ("per_pixel", "shared"))


def _shading(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    choices = ("pixel", "sample")
    shadowed = plan["raster.shadows"] != "none"
    if shadowed or (scene.tables.materials.textures >= 0).any():
        edges = "shadows" if shadowed else "textures"
        return Decision("raster.shading", "sample", f"edges of {edges} cross triangles: each sample is shaded", choices)
    return Decision("raster.shading", "pixel", "light has no edges within a triangle: each pixel shades it once", choices)


def _precision(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    why = _needs_float64(scene, plan)
    if why:
        return Decision("raster.precision", "float64", why, PRECISIONS[1:])
    reason = "unshadowed point lights on meshes: light in float32 is within 1e-5"
    return Decision("raster.precision", "float32", reason, PRECISIONS)


def _needs_float64(scene: ir.Scene, plan: Plan) -> str:
    """Why shading needs float64; "" if it does not."""
    instances, materials = scene.tables.instances, scene.tables.materials
    shown = instances.visible & ir.Visibility.CAMERA != 0
    used = scene_facts.used_rows(instances.material[shown])
    if plan["raster.shadows"] != "none" or ir.is_in(scene.tables.lights.kind, SOFT).any():
        return "lights are sampled by rays"
    if scene.tables.media.everywhere.any():
        return "fog lies over the scene"
    if light_links.are_there(scene.tables):
        return "some light lights some surfaces only"
    if scene_facts.profiled(scene.tables).any():
        return "some light's emission depends on the direction"
    if (scene.tables.geometries.kind[instances.geometry[shown]] != ir.GeometryKind.MESH).any():
        return "some shape is not a mesh: rays intersect it"
    if plan["opacity"]:
        return "some surface is partly transparent"
    if (scene.tables.textures.kind == ir.TextureKind.FORMULA).any():
        return "patterns are formulas, which are evaluated in float64"
    if (materials.textures[used][:, [ir.Slot.NORMAL, ir.Slot.BUMP, ir.Slot.COAT_NORMAL]] >= 0).any():
        return "some material has a normal or bump map"
    if (traits.facets(scene.tables) | traits.slabs(scene.tables))[used].any():
        return "some material has a microfacet BSDF"
    if traits.added(scene.tables)[used].any():
        return "some material has a lobe of its own"
    if traits.has(scene.tables, Lobes.PARTS)[used].any():
        return "some material is a blend"
    if traits.specular(scene.tables)[used].any() or (materials.shading[used] == ir.Shading.GOURAUD).any():
        return "some material is specular or shaded at vertices"
    return ""


SECONDARY: tuple[Rule, ...] = (_secondary_rays,)
RASTER: tuple[Rule, ...] = (_shadows, _tolerance, _coverage, _sample_positions, _shading, _precision)
