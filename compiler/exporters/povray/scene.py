"""Exports a scene for POV-Ray 3.7: one .pov with images (16-bit PPM) beside it.

The target is Whitted ray tracing: lights without extent, mirrors, glass.
Coordinates are the scene's own: the camera's `right` makes the frame right-handed. POV-Ray surfaces reflect light colour · pigment ·
(diffuse cosine + phong lobe). These are our equations with the light's I = E⊥/π, so lights are divided by π.
https://www.povray.org/documentation/3.7.0/
"""

from __future__ import annotations

import numpy as np

from ....lights import AMBIENT, LIGHTS, SKIES
from ....lights.contract import ExportedLight, Form
from ... import ir
from ...mesh import shells
from ...plan.plan import Plan
from .. import camera_frames, number_text, placement
from ..export import Export
from ..export_job import ExportJob
from ..lights import LightFormat, exported
from ..media import without_fog
from ..placement import F64
from .materials import Finishes
from .shapes import PovrayText, bracket, objects

FADE = 1e-4  # metres: POV-Ray's 2 / (1 + (d / fade)²) is 1/d² to (fade / d)²
FAR = 1e5  # radii of the scene: distance of directional lights
_LIGHTS = LightFormat(
    "POV-Ray", ambient=True, extent=False, constant=True, profiled=False, lacking="POV-Ray draws lights without extent"
)


def export(job: ExportJob) -> Export:
    """The file of a scene."""
    return write(job.scene, job.plan, job.stem, job.tessellator())


def write(scene: ir.Scene, plan: Plan, name: str, tessellate: shells.Tessellate) -> Export:
    """Exports `scene` with the settings of `plan`. Images beside it are called `name`.0.ppm and so on.

    `tessellate` gives triangles for textured shapes. Losses are in its `diagnostics`.
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
    without_fog(out)
    diffuse = tables.materials.values[:, ir.Slot.DIFFUSE].max(axis=1, initial=0.0) > 0
    used = np.unique(tables.instances.material)
    if plan["interreflection"] and diffuse[used].any():
        out.cannot("matt surfaces light each other here, and not in POV-Ray", "materials", int(used[diffuse[used]][0]))


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
    sources, sky = [], np.zeros(3)
    diffuse = tables.materials.values[np.unique(tables.instances.material)][:, [ir.Slot.DIFFUSE, ir.Slot.SPECULAR]].max(initial=0.0) > 0
    for light in exported(out, np.flatnonzero(lights.color.max(axis=1, initial=0.0) > 0).tolist(), _LIGHTS):
        if light.kind in SKIES:
            plain = lights.image[light.row] < 0
            if plain:
                sky = sky + light.color
            if diffuse or not plain:
                out.cannot(f"a {light.kind.name.lower()} lights nothing in POV-Ray: it draws lights without extent", "lights", light.row)
        elif light.kind not in AMBIENT and (source := _light(out, light)) is not None:
            sources.append(source)
    background = plan["background"] if not isinstance(plan["background"], str) else sky
    if plan["background"] == "transparent" and sky.any():
        out.cannot("a transparent background is not carried where a sky is seen in mirrors", hint="--background sky")
    if not isinstance(plan["background"], str) and sky.any():
        out.cannot("a background's colour is not carried where a sky is seen in mirrors", hint="--background sky")
    return [f"background {{ rgb {bracket(background)} }}", *sources]


def _light(out: Export, light: ExportedLight) -> str | None:
    """The source of a light at a point or far away; None after a report."""
    kind, color, place, more = LIGHTS[light.kind], light.color / np.pi, light.position, ""
    if kind.povray is None:
        out.cannot(f"a {light.kind.name.lower()} light is not carried: POV-Ray has none", "lights", light.row)
        return None
    if kind.FORM == Form.DISTANT:
        middle, radius = placement.reach(out.scene.tables)
        place, more = middle + light.direction * radius * FAR, f" parallel point_at {bracket(middle)}"
    elif light.fades:
        color, more = color / (2.0 * FADE * FADE), f" fade_power 2 fade_distance {number_text.number(FADE)}"
    described = kind.povray(light, PovrayText())
    if described.loss:
        out.cannot(described.loss, "lights", light.row)
    return _light_source(out, light.row, place, color, more + described.more)


def _light_source(out: Export, row: int, position: F64, color: F64, more: str) -> str:
    shadowless = "" if out.scene.tables.lights.shadows[row] else " shadowless"
    if shadowless:
        out.cannot("a light without shadows is not carried: POV-Ray takes its highlights away, too", "lights", row)
    return f"light_source {{ {bracket(position)} rgb {bracket(color)}{more}{shadowless} }}"
