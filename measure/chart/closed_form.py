"""Recognizes scenes whose picture has a closed form. A recognizer is certain, or returns None."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...compiler import ir
from ...compiler.plan.plan import Plan
from ...lights import AMBIENT, DISTANT, SUNS
from ...materials import traits
from ...materials.contract import Lobes
from ...render import camera
from ...render.types import View

MARGIN = 2.0  # pixels: the largest reach of a filter beyond the picture
CONSTANT_LIGHTS = {*DISTANT, *AMBIENT} - {*SUNS}  # their irradiance is constant over a plane


@dataclass(frozen=True, slots=True)
class ConstantPicture:
    """One radiance and coverage for all pixels, and the reason."""

    rgb: tuple[float, float, float]
    alpha: float
    how: str


def recognize(scene: ir.Scene, plan: Plan) -> ConstantPicture | None:
    """The closed form of a planned picture; None where none is known."""
    return next((picture for recognise in RECOGNISERS if (picture := recognise(scene, plan)) is not None), None)


def _empty_scene(scene: ir.Scene, plan: Plan) -> ConstantPicture | None:
    """A scene without visible instances and with a background of one colour."""
    visible = scene.tables.instances.visible & ir.Visibility.CAMERA != 0
    if visible.any() or plan["background"] == "sky":
        return None
    colour = (0.0, 0.0, 0.0) if plan["background"] == "transparent" else plan["background"]
    red, green, blue = map(float, colour)
    return ConstantPicture((red, green, blue), 0.0, "closed form: nothing is there but the background")


def _single_plane(scene: ir.Scene, plan: Plan) -> ConstantPicture | None:
    """An untextured Lambertian plane that fills the picture, in directional and ambient light.

    L = k_a L_a + k_d/π Σ E⊥ max(0, n·l) with n towards the camera. A plane neither shadows nor lights itself.
    """
    tables = scene.tables
    instances, materials, lights = tables.instances, tables.materials, tables.lights
    if len(instances.geometry) != 1 or not set(lights.kind.tolist()) <= CONSTANT_LIGHTS:
        return None
    material = int(instances.material[0])
    values = materials.values[material]
    sends_on = values[[ir.Slot.REFLECTION, ir.Slot.TRANSMISSION]].max() > 0
    shines = values[ir.Slot.EMISSION].max() > 0
    diffuse = traits.has(tables, Lobes.CLASSIC)[material] and values[ir.Slot.SPECULAR].max() == 0
    if not diffuse or sends_on or shines or (materials.textures[material] >= 0).any() or instances.light[0] >= 0:
        return None
    seen = _visible_side(tables, plan)
    if seen == 0:
        return None
    up = tables.transforms.inverse[instances.transform[0], 1, :3] * seen  # rows of the inverse are normals of the frame's coordinate planes
    normal = up / np.linalg.norm(up)
    distant = ir.is_in(lights.kind, DISTANT)
    facing = np.maximum(lights.direction[distant] @ normal, 0.0)
    irradiance = facing @ lights.color[distant]
    ambient = lights.color[~distant].sum(axis=0)
    rgb = values[ir.Slot.AMBIENT] * ambient + values[ir.Slot.DIFFUSE] * irradiance / np.pi
    return ConstantPicture(tuple(rgb.tolist()), 1.0, "closed form: one matt plane in directional and ambient light, ρE/π + k_a L_a")


def _visible_side(tables: ir.Tables, plan: Plan) -> int:
    """1 or -1, the visible side of a plane that fills the picture; else 0.

    The visible part of a plane is convex: it fills the picture if the rays of the corners hit it.
    """
    g = int(tables.instances.geometry[0])
    if tables.geometries.kind[g] != ir.GeometryKind.PLANE or not tables.instances.visible[0] & ir.Visibility.CAMERA:
        return 0
    if plan["lens"] != "pinhole":
        return 0
    x0, y0, x1, y1 = plan["crop"]
    x = np.array([x0 - MARGIN, x1 + MARGIN, x0 - MARGIN, x1 + MARGIN])
    y = np.array([y0 - MARGIN, y0 - MARGIN, y1 + MARGIN, y1 + MARGIN])
    ray = camera.generate_pinhole_ray(tables, View(plan["camera"], *plan["size"]), x, y)
    inverse = tables.transforms.inverse[tables.instances.transform[0]]
    origin = inverse[:, :3] @ np.array([np.broadcast_to(c, x.shape) for c in ray.origin]) + inverse[:, 3:]
    direction = inverse[:, :3] @ np.array([np.broadcast_to(c, x.shape) for c in ray.direction])
    with np.errstate(divide="ignore", invalid="ignore"):
        t = -origin[1] / direction[1]
    hit = np.isfinite(t) & (t > ray.t_min) & (t < ray.t_max)
    sides = np.sign(-direction[1])
    return int(sides[0]) if hit.all() and (sides == sides[0]).all() else 0


RECOGNISERS: tuple[Callable[[ir.Scene, Plan], ConstantPicture | None], ...] = (_empty_scene, _single_plane)
