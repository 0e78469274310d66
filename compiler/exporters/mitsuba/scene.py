"""Exports a scene as Mitsuba 3 XML, with meshes (PLY) and images (EXR) beside it.

Plugin reference: https://mitsuba.readthedocs.io/en/stable/src/plugin_reference.html. Mitsuba's cameras look along +z with +x to the
left. Its rectangles and disks face +z. v = 0 is the top row of an image.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ....lights import POINTS, SKIES
from ....materials import losses, traits
from ....materials.contract import Lobes
from ... import ir
from ...mesh import shells
from ...plan.plan import Plan
from .. import camera_frames, placement
from ..export import Export
from ..export_job import ExportJob
from ..media import without_fog
from . import lights
from .shapes import Shapes
from .xml import Node, node, value

FILTERS = {"box": "box", "tent": "tent"}
SAMPLER = "multijitter"
NO_ROULETTE = 1 << 20  # a depth that no path reaches
NEAR = 1e-4  # metres; Mitsuba requires a near distance
FAR = 1e7


def export(job: ExportJob) -> Export:
    """The file of a scene."""
    return write(job.scene, job.plan, job.stem, job.tessellator())


def write(scene: ir.Scene, plan: Plan, name: str, tessellate: shells.Tessellate) -> Export:
    """Exports `scene` with the settings of `plan`. Files beside the XML are called `name`.0.ply and so on.

    `tessellate` gives triangles for shapes that Mitsuba lacks. Losses are in its `diagnostics`.
    """
    out = Export(scene)
    _check_plan(out, plan)
    shapes = Shapes(out, plan, name, tessellate)
    placed = [*shapes.nodes(), *lights.lights(out, plan, shapes)]
    nodes = [_integrator(out, plan), _sensor(out, plan), *shapes.materials.definitions, *placed]
    out.text = str(Node("scene", {"version": "3.0.0"}, nodes)) + "\n"
    return out


def _check_plan(out: Export, plan: Plan) -> None:
    tables = out.scene.tables
    if plan["filter"] not in FILTERS:
        other = "Mitsuba cuts its gaussian at four deviations, not three" if plan["filter"] == "gaussian" else "Mitsuba has none"
        out.cannot(f"the filter {plan['filter']} is not carried: {other}", hint="--plan filter=box")
    out.without_opacity()
    out.without_links()
    without_fog(out)
    used = np.unique(tables.instances.material)
    specular = (traits.clear(tables) | traits.mirrors(tables))[used]
    diffuse = tables.materials.values[used, ir.Slot.DIFFUSE].max(axis=1, initial=0.0) > 0
    if specular.any() and plan["bounces"] == 0:
        out.cannot("mirrors and glass are black without bounces here, and not in Mitsuba", "materials", int(used[specular][0]))
    elif diffuse.any() and plan["bounces"] > 0 and not plan["interreflection"]:
        out.cannot(
            "rays go on at mirrors and glass only: Mitsuba's paths go on at matt surfaces too", "materials", int(used[diffuse][0]),
            "--bounces makes matt surfaces light each other here, too",
        )  # fmt: skip
    _check_inside_glass(out, plan)
    if not plan["shadows"]:
        out.cannot("no light casts shadows here; in Mitsuba all do")


def _check_inside_glass(out: Export, plan: Plan) -> None:
    """Reports cameras and lights inside glass.

    Mitsuba scales radiance by the squared index at entry, ours does not. Both agree if light enters from outside and leaves again.
    """
    tables = out.scene.tables
    glass = (traits.has(tables, Lobes.GLASS) | (tables.materials.medium >= 0))[tables.instances.material]
    places = [("cameras", plan["camera"], tables.transforms.matrix[tables.cameras.transform[plan["camera"]], :, 3])]
    for row in range(len(tables.lights.kind)):
        if tables.lights.kind[row] in POINTS:
            places.append(("lights", row, tables.lights.position[row]))
        elif tables.lights.instance[row] >= 0:
            places.append(("lights", row, placement.world(tables, int(tables.lights.instance[row]))[:3, 3]))
    for i in np.flatnonzero(glass).tolist():
        low, high = tables.geometries.bounds[tables.instances.geometry[i]]
        inverse = tables.transforms.inverse[tables.instances.transform[i]]
        for table, row, place in places:
            p = inverse @ [*place, 1.0]
            if np.all((low < p) & (p < high)) and tables.materials.medium[tables.instances.material[i]] >= 0:
                out.cannot(losses.INSIDE_OF_MEDIUM, table, row)
            elif np.all((low < p) & (p < high)):
                out.cannot("a light or a camera inside glass is not carried: Mitsuba scales its light by the index", table, row)


def _integrator(out: Export, plan: Plan) -> Node:
    """The path integrator. Mitsuba's max_depth counts edges: the camera's, one for each bounce, and the last to a light."""
    sky = ir.is_in(out.scene.tables.lights.kind, SKIES).any()
    hidden = bool(sky) and plan["background"] == "transparent"
    if hidden and (out.scene.tables.instances.light >= 0).any():
        out.cannot("a transparent background is not carried: Mitsuba would hide the area lights with the sky", hint="--background sky")
    if not isinstance(plan["background"], str):
        out.cannot("the background's colour is not carried: Mitsuba would light the scene with it", hint="--background sky")
    media = (out.scene.tables.materials.medium[out.scene.tables.instances.material] >= 0).any()
    path = node("integrator", "volpath" if media else "path", max_depth=int(plan["bounces"]) + 2, rr_depth=NO_ROULETTE)
    return path.with_(value("hide_emitters", True)) if hidden else path


def _sensor(out: Export, plan: Plan) -> Node:
    scene, camera = out.scene, plan["camera"]
    width, height = plan["size"]
    if plan["lens"] == "panorama":
        out.cannot("panoramic cameras are not carried", "cameras", camera)
    camera_frames.report_planes(out, camera)
    if scene.tables.cameras.pixel_aspect[camera] != 1.0:
        out.cannot("pixels that are not square are not carried", "cameras", camera)
    seen = camera_frames.eye(scene, camera, (width, height))
    if not seen.regular:
        out.cannot("the camera's frame is stretched or sheared: not carried", "cameras", camera)
    near, far = float(scene.tables.cameras.near[camera]), float(scene.tables.cameras.far[camera])
    half_x, half_y = float(np.linalg.norm(seen.right)), float(np.linalg.norm(seen.up))
    right_axis, up = -seen.right / half_x, seen.up / half_y
    position = seen.position
    if seen.perspective:
        frame = placement.square(np.stack([right_axis, up, seen.forward, position], axis=1))
        # the offsets are fractions of the picture's width and height; +x to the right, +y down
        lens = float(scene.tables.cameras.lens[camera])
        more: dict[str, Any] = {"principal_point_offset_x": float(seen.shift[0] / 2), "principal_point_offset_y": float(-seen.shift[1] / 2)}
        if lens > 0.0:
            more = {"aperture_radius": lens, "focus_distance": float(scene.tables.cameras.focus[camera])}
            if seen.shift.any():
                out.cannot("the camera's shift is not carried where it has an aperture", "cameras", camera)
        sensor = node(
            "sensor", "thinlens" if lens > 0.0 else "perspective", fov=float(2 * np.degrees(np.arctan(half_x))), fov_axis="x", **more,
            near_clip=near or NEAR, far_clip=far if np.isfinite(far) else FAR, to_world=frame,
        )  # fmt: skip
    else:
        position = position + seen.shift[0] * seen.right + seen.shift[1] * seen.up
        back = max(-near, 0.0)  # a negative near distance includes objects behind the camera
        frame = placement.square(np.stack([right_axis * half_x, up * half_x, seen.forward, position - back * seen.forward], axis=1))
        sensor = node("sensor", "orthographic", near_clip=max(near, NEAR), far_clip=far + back if np.isfinite(far) else FAR, to_world=frame)
    return sensor.with_(_film(plan), node("sampler", SAMPLER, sample_count=int(plan["samples"]), seed=int(plan["seed"]) & 0x7FFFFFFF))


def _film(plan: Plan) -> Node:
    (width, height), (x0, y0, x1, y1) = plan["size"], plan["crop"]
    film = node("film", "hdrfilm", width=width, height=height, pixel_format="rgb", component_format="float32", file_format="openexr")
    if (x0, y0, x1, y1) != (0, 0, width, height):
        for name, size in (("crop_offset_x", x0), ("crop_offset_y", y0), ("crop_width", x1 - x0), ("crop_height", y1 - y0)):
            film = film.with_(value(name, size))
    chosen = FILTERS.get(plan["filter"], "box")
    if chosen != "box":
        film = film.with_(value("sample_border", True))  # the filter includes samples just outside the picture, as here
    return film.with_(node("rfilter", chosen))
