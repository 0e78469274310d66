"""Decisions about light transport: area lights, bounces, integrator, importance sampling, shadows, caustics."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ...lights import SKIES, SOFT
from ...materials import traits
from ...materials.contract import Lobes
from .. import ir
from ..ir import light_links
from . import caustic_casters, enclosure, light_shapes, path_reuse, sky_visibility
from .decision import Decision, Plan, Rule
from .scene_facts import extents, ground

SPECULAR_BOUNCES = 8
MEDIA_BOUNCES = 512  # collisions count, too
TRANSPORTS = ("path", "whitted")
HEURISTICS = ("power", "balance", "light", "bsdf")  # of multiple importance sampling; in the order of render/integrator/path.py
PRECISIONS = ("float32", "float64")
FLOAT32_RATIO = 5000.0  # of the largest coordinate over the smallest instance, up to which float32 is precise enough


def _area_lights(scene: ir.Scene, *_: Any) -> Decision:
    lights = scene.tables.lights
    area = [k for k in SOFT if np.any((lights.kind == k) & np.any(lights.color > 0, axis=1))]
    if area and not traits.lit(scene.tables).any():
        reason = "no surface is lit: all materials emit, reflect or transmit"
        area = []
    elif area:
        reason = f"{', '.join(ir.LightKind(k).name.lower() for k in area)}: sampled with random numbers"
    else:
        reason = "only lights without area: one exact shadow ray each, no random numbers"
    return Decision("area_lights", bool(area), reason, fixed="the scene's lights")


def _bounces(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    if plan["backend"] == "raster" and plan["raster.secondary_rays"] == "none":
        reason = "the raster backend traces no secondary rays: --plan raster.secondary_rays=trace does"
        return Decision("bounces", 0, reason, fixed="--bounces")
    if settings.bounces is not None:
        return Decision("bounces", settings.bounces, "asked for", fixed="--bounces")
    if traits.participates(scene.tables):
        return Decision("bounces", MEDIA_BOUNCES, "light scatters inside of media", fixed="--bounces")
    if plan["enclosed_bounces"]:
        return Decision("bounces", plan["enclosed_bounces"], plan.decisions["enclosed_bounces"].reason, fixed="--bounces")
    if traits.specular(scene.tables).any():
        return Decision("bounces", SPECULAR_BOUNCES, "some materials reflect or refract", fixed="--bounces")
    if (traits.translucent(scene.tables) & traits.used(scene.tables)).any():
        return Decision("bounces", SPECULAR_BOUNCES, "light passes translucent materials", fixed="--bounces")
    return Decision("bounces", 0, "no material reflects or refracts: direct light only", fixed="--bounces")


def _enclosed_bounces(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    if plan["backend"] == "raster":
        return Decision("enclosed_bounces", 0, "the raster backend draws no light that bounces unless it is asked for", fixed="--backend")
    if settings.bounces is not None:
        return Decision("enclosed_bounces", 0, "a number of bounces was asked for", fixed="--bounces")
    return Decision("enclosed_bounces", *enclosure.bounces(scene, plan["camera"]), fixed="the shapes around the camera")


def _interreflection(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    diffuse = traits.diffuse(scene.tables)
    if traits.participates(scene.tables) and plan["backend"] != "raster":
        return Decision("interreflection", True, "light scatters inside of media")
    if traits.disperses(scene.tables) and plan["backend"] != "raster" and plan["bounces"] > 0:
        return Decision("interreflection", True, "glass disperses light: each path has one wavelength")
    if plan["enclosed_bounces"]:
        return Decision("interreflection", True, "the camera stands in an enclosed space: diffuse surfaces light each other")
    if settings.bounces and plan["bounces"] > 0 and diffuse.any():
        return Decision("interreflection", True, "bounces were asked for: diffuse surfaces light each other")
    if plan["bounces"] > 0 and (traits.glossy(scene.tables) & traits.used(scene.tables)).any():
        return Decision("interreflection", True, "glossy surfaces reflect light from all directions")
    if plan["bounces"] > 0 and (traits.translucent(scene.tables) & traits.used(scene.tables)).any():
        return Decision("interreflection", True, "translucent surfaces send light on in all directions")
    reason = "no bounces were asked for: mirrors and glass alone send rays on" if diffuse.any() else "no material is diffuse"
    return Decision("interreflection", False, reason)


def _monte_carlo(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    fixed = "the scene's lights and materials"
    used = traits.used(scene.tables)
    why = []
    if plan["area_lights"]:
        why.append("area lights")
    if traits.participates(scene.tables) and plan["backend"] != "raster":
        why.append("media")
    if traits.disperses(scene.tables) and plan["backend"] != "raster" and plan["bounces"] > 0:
        why.append("dispersion")
    if plan["interreflection"]:
        why.append("interreflection")
    if (traits.glossy(scene.tables) & used).any():
        why.append("glossy reflections")
    if (traits.has(scene.tables, Lobes.PARTS) & used).any():
        why.append("blends of materials")
    if why:
        return Decision("monte_carlo", True, f"{', '.join(why)}: integrated by random samples", fixed=fixed)
    return Decision("monte_carlo", False, "light is exact at each sample: antialiasing alone is random", fixed=fixed)


def _transport(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    if not plan["interreflection"]:
        return Decision("transport", "whitted", "mirrors and glass alone send rays on: every branch is traced", TRANSPORTS[1:])
    if plan["backend"] == "raster":
        return Decision("transport", "whitted", "secondary rays of the raster backend: every branch is traced", TRANSPORTS[1:])
    return Decision("transport", "path", "surfaces light each other: one random direction at each", TRANSPORTS)


def _mis(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    if plan["transport"] != "path":
        return Decision("mis", "power", "no light is sampled in two ways", HEURISTICS[:1])
    reason = "heuristic that weighs light samples and BSDF samples (`light`, `bsdf`: only one of them)"
    return Decision("mis", "power", reason, HEURISTICS)


def _precision(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    if plan["transport"] != "path" or plan["backend"] != "ray":
        return Decision("precision", "float64", "float32 is for path tracing of the ray backend alone", PRECISIONS[1:])
    if (scene.tables.geometries.kind == ir.GeometryKind.FORMULA).any() or (scene.tables.textures.kind == ir.TextureKind.FORMULA).any():
        return Decision("precision", "float64", "formulas are evaluated in float64", PRECISIONS[1:])
    largest, smallest = extents(scene.tables)
    ratio = largest / smallest if smallest > 0.0 else math.inf
    figures = f"coordinates up to {largest:.3g} m, the smallest object {smallest:.3g} m: ratio {ratio:.3g}"
    if ratio <= FLOAT32_RATIO:
        return Decision("precision", "float32", f"{figures}; rays start 2e-6 of their coordinates off a surface", PRECISIONS)
    return Decision("precision", "float64", f"{figures}; more than {FLOAT32_RATIO:g}, too much for float32", PRECISIONS)


def _shadows(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    if scene.tables.lights.shadows.any():
        return Decision("shadows", True, "some light casts them")
    if traits.emissive(scene.tables)[traits.used(scene.tables)].any():
        return Decision("shadows", True, "some material emits light")
    return Decision("shadows", False, "no light casts any")


def _light_shapes(scene: ir.Scene, *_: Any) -> Decision:
    if light_shapes.blocking(scene.tables).any():
        return Decision("shadows.light_shapes", True, "shapes of lights block other lights")
    return Decision("shadows.light_shapes", False, "no light's shape blocks another light", fixed="the scene's lights")


def _ground_plane(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    lights = scene.tables.lights
    if not (ir.is_in(lights.kind, SKIES) & lights.shadows).any():
        return Decision("ground_plane", False, "no sky casts shadows")
    if light_links.selective(scene.tables).any():
        return Decision("ground_plane", False, "some shadow casters do not block every light", fixed="the scene's lights")
    row = ground(scene.tables)
    if row < 0:
        return Decision("ground_plane", False, "no plane has the whole scene on its upper side", fixed="the scene's planes")
    label = scene.names.instances[row] if row < len(scene.names.instances) else ""
    name = f"`{label}`" if label else "a plane"
    return Decision("ground_plane", True, f"{name} bounds the scene from below: the sky under it is not sampled")


def _caustics(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    value, reason, choices = caustic_casters.carrier(scene.tables, plan["transport"], plan["backend"], plan["motion_blur"])
    return Decision("transport.caustics", value, reason, choices, fixed="--backend" if plan["backend"] == "reference" else "")


def _caustics_in_media(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    value, reason, choices = caustic_casters.carrier_in_media(scene.tables, plan["transport.caustics"])
    return Decision("transport.caustics_in_media", value, reason, choices)


def _indoors(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    return Decision("indoors", *sky_visibility.indoors(scene, plan))


def _path_reuse(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    return Decision("transport.path_reuse", *path_reuse.by_groups(scene.tables, plan))


def _sky_visibility(scene: ir.Scene, settings: ir.Settings, plan: Plan) -> Decision:
    return Decision("transport.sky_visibility", *sky_visibility.learnt(scene, plan))


def _opacity(scene: ir.Scene, *_: Any) -> Decision:
    count = int(traits.partial(scene.tables)[scene.tables.instances.material].sum())
    if not count:
        return Decision("opacity", False, "everything is opaque", fixed="the scene's materials")
    objects = "one object has" if count == 1 else f"{count} objects have"
    reason = f"{objects} an opacity: rays pass where it is 0, and continue where it is below 1"
    return Decision("opacity", True, reason, fixed="the scene's materials")


LIGHTS: tuple[Rule, ...] = (_area_lights,)
INTEGRATOR: tuple[Rule, ...] = (
    _enclosed_bounces, _bounces, _interreflection, _monte_carlo, _transport, _mis, _precision, _shadows, _light_shapes,
)  # fmt: skip
VISIBILITY: tuple[Rule, ...] = (_ground_plane, _opacity)
CAUSTICS: tuple[Rule, ...] = (_caustics, _caustics_in_media, _indoors, _path_reuse, _sky_visibility)
