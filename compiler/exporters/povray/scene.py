"""Exports a scene for POV-Ray 3.7: one .pov with images (16-bit PPM) beside it.

The target is Whitted ray tracing: lights without extent, mirrors, glass.
Coordinates are the scene's own: the camera's `right` makes the frame right-handed. POV-Ray surfaces reflect light colour · pigment ·
(diffuse cosine + phong lobe). These are our equations with the light's I = E⊥/π, so lights are divided by π.
https://www.povray.org/documentation/3.7.0/
"""

from __future__ import annotations

import numpy as np

from ... import ir
from ...plan import scene_facts
from ...plan.plan import Plan
from .. import camera_frames, number_text, placement, shells
from ..export import Export
from ..export_job import ExportJob
from ..placement import F64
from .materials import Finishes
from .shapes import bracket, objects

FADE = 1e-4  # metres: POV-Ray's 2 / (1 + (d / fade)²) is 1/d² to (fade / d)²
FAR = 1e5  # radii of the scene: distance of directional lights
_SOFT = {
    ir.LightKind.SKY: "a sky lights nothing in POV-Ray", ir.LightKind.DOME: "a dome lights nothing in POV-Ray",
    ir.LightKind.RECTANGLE: "an area light is not carried", ir.LightKind.DISK: "an area light is not carried",
    ir.LightKind.SPHERE: "an area light is not carried",
}  # fmt: skip


def export(job: ExportJob) -> Export:
    """The file of a scene."""
    return write(job.scene, job.plan, job.stem, job.tessellator())


def write(scene: ir.Scene, plan: Plan, name: str, tessellate: shells.Tessellate) -> Export:
    """Exports `scene` with the settings of `plan`. Images beside it are called `name`.0.ppm and so on.

    `tessellate` gives triangles for textured shapes. Losses are in `found`.
    """
    out = Export(scene)
    _check_plan(out, plan)
    finishes = Finishes(out, plan, name)
    parts = [_settings(plan), _camera(out, plan), *_lights(out, plan), *objects(out, plan, finishes, tessellate)]
    out.text = "\n".join(parts) + "\n"
    return out


def _check_plan(out: Export, plan: Plan) -> None:
    tables = out.scene.tables
    if plan["filter"] != "box":
        out.cannot(f"the filter {plan['filter']} is not carried: POV-Ray's is a box", hint="--plan filter=box")
    out.without_opacity()
    out.without_links()
    matt = tables.materials.values[:, ir.Slot.DIFFUSE].max(axis=1, initial=0.0) > 0
    used = np.unique(tables.instances.material)
    if plan["interreflection"] and matt[used].any():
        out.cannot("matt surfaces light each other here, and not in POV-Ray", "materials", int(used[matt[used]][0]))


def _settings(plan: Plan) -> str:
    depth = int(plan["bounces"]) + 1
    return f"#version 3.7;\nglobal_settings {{ assumed_gamma 1.0 max_trace_level {depth} adc_bailout 0.0001 ambient_light rgb 1 }}"


def _camera(out: Export, plan: Plan) -> str:
    scene, row = out.scene, plan["camera"]
    seen = camera_frames.eye(scene, row, plan["size"])
    cameras = scene.tables.cameras
    if cameras.near[row] != 0.0 or np.isfinite(cameras.far[row]):
        out.cannot("near and far planes are not carried", "cameras", row)
    camera_frames.report_planes(out, row)
    if plan["lens"] != "pinhole":
        what = "panoramic cameras are" if plan["lens"] == "panorama" else "depth of field is"
        out.cannot(f"{what} not carried", "cameras", row)
    offset = seen.shift[0] * seen.right + seen.shift[1] * seen.up
    right, up = bracket(2 * seen.right), bracket(2 * seen.up)
    if seen.perspective:
        forward = bracket(seen.forward + offset)
        return f"camera {{ perspective location {bracket(seen.position)} direction {forward} right {right} up {up} }}"
    location = bracket(seen.position + offset)
    return f"camera {{ orthographic location {location} direction {bracket(seen.forward)} right {right} up {up} }}"


def _lights(out: Export, plan: Plan) -> list[str]:
    tables = out.scene.tables
    lights = tables.lights
    profiled = scene_facts.profiled(tables)
    made, sky = [], np.zeros(3)
    matt = tables.materials.values[np.unique(tables.instances.material)][:, [ir.Slot.DIFFUSE, ir.Slot.SPECULAR]].max(initial=0.0) > 0
    for row in np.flatnonzero(lights.color.max(axis=1, initial=0.0) > 0).tolist():
        kind = ir.LightKind(int(lights.kind[row]))
        plain_sky = kind == ir.LightKind.SKY or (kind == ir.LightKind.DOME and lights.image[row] < 0)
        if plain_sky:
            sky = sky + lights.color[row]
        if profiled[row]:
            out.cannot("a light whose emission depends on the direction is not carried", "lights", row)
        elif kind in _SOFT and (matt or not plain_sky):
            out.cannot(f"{_SOFT[kind]}: it draws lights without extent", "lights", row)
        elif kind in (ir.LightKind.POINT, ir.LightKind.SPOT):
            made.append(_point_light(out, row))
        elif kind in (ir.LightKind.DIRECTIONAL, ir.LightKind.SUN):
            made.append(_directional(out, row))
    background = plan["background"] if not isinstance(plan["background"], str) else sky
    if plan["background"] == "transparent" and sky.any():
        out.cannot("a transparent background is not carried where a sky is seen in mirrors", hint="--background sky")
    if not isinstance(plan["background"], str) and sky.any():
        out.cannot("a background's colour is not carried where a sky is seen in mirrors", hint="--background sky")
    return [f"background {{ rgb {bracket(background)} }}", *made]


def _point_light(out: Export, row: int) -> str:
    lights = out.scene.tables.lights
    color, fade = lights.color[row] / np.pi, f" fade_power 2 fade_distance {number_text.number(FADE)}"
    a, b, c = lights.coefficients[row]
    inverse_square = 1.0 / (2.0 * FADE * FADE)
    if lights.falloff[row] == ir.FalloffKind.POLYNOMIAL and a == b == 0.0:
        color = color / c * inverse_square
    elif lights.falloff[row] == ir.FalloffKind.POLYNOMIAL and b == c == 0.0:
        color, fade = color / a, ""
    else:
        if lights.falloff[row] != ir.FalloffKind.INVERSE_SQUARE:
            out.cannot("a fall-off other than 1/d² or none is not carried", "lights", row)
        color = color * inverse_square
    spot = ""
    if lights.kind[row] == ir.LightKind.SPOT:
        full, cone = (float(np.degrees(np.arccos(np.clip(k[row], -1, 1)))) for k in (lights.cos_full, lights.cos_cone))
        at = bracket(lights.position[row] + lights.direction[row])
        spot = f" spotlight point_at {at} radius {number_text.number(full)} falloff {number_text.number(cone)} tightness 0"
    return _light_source(out, row, lights.position[row], color, fade + spot)


def _directional(out: Export, row: int) -> str:
    lights = out.scene.tables.lights
    if lights.kind[row] == ir.LightKind.SUN and lights.angle[row] > 0.0:
        out.cannot("a sun's size is not carried: POV-Ray draws lights without extent", "lights", row, "angle: 0deg")
    middle, radius = placement.reach(out.scene.tables)
    at = middle + lights.direction[row] * radius * FAR
    return _light_source(out, row, at, lights.color[row] / np.pi, f" parallel point_at {bracket(middle)}")


def _light_source(out: Export, row: int, at: F64, color: F64, more: str) -> str:
    shadowless = "" if out.scene.tables.lights.shadows[row] else " shadowless"
    if shadowless:
        out.cannot("a light without shadows is not carried: POV-Ray takes its highlights away, too", "lights", row)
    return f"light_source {{ {bracket(at)} rgb {bracket(color)}{more}{shadowless} }}"
