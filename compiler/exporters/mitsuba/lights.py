"""Exports lights as Mitsuba emitters. Units agree: intensity in cd, irradiance in lx, radiance in nit, scene-linear."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ....lights import LIGHTS, PICTURED, SKIES, SURFACES
from ....lights.contract import ExportedLight
from ....materials import traits
from ... import ir
from ...plan import light_shapes
from ...plan.plan import Plan
from .. import camera_frames, placement, texture_values
from ..export import Export
from ..lights import LightFormat, exported
from ..placement import F64
from .materials import pfm
from .shapes import Shapes
from .xml import Node, node, rgb, value, vector

SUN_DISTANCE = 1e4  # radii of the scene


def lights(out: Export, plan: Plan, shapes: Shapes) -> list[Node]:
    """Emitters, and the shapes of area lights."""
    tables = out.scene.tables
    shining = [row for row in range(len(tables.lights.kind)) if tables.lights.color[row].max() > 0]
    blocks = light_shapes.blocking(tables) | (len(shining) < 2)
    nodes: list[Node] = []
    form = LightFormat("Mitsuba", unshadowed=not plan["shadows"], profiled=False)
    for light in exported(out, shining, form):
        if light.kind in SURFACES:
            nodes += _area(out, shapes, light.row, blocks)
        elif light.angle > 0.0:
            nodes.append(_sun(out, plan, shapes, light))
        elif light.kind not in SKIES and (emitter := _light(out, shapes.name, light)) is not None:
            nodes.append(emitter)
    nodes += _sky(out, plan, shapes.name, shining)
    return nodes


def _area(out: Export, shapes: Shapes, row: int, blocks: NDArray[np.bool_]) -> list[Node]:
    """An area light. `blocks`: result of light_shapes.blocking, or true if there is nothing to block."""
    tables = out.scene.tables
    instance = int(tables.lights.instance[row])
    if instance < 0:
        out.cannot("an area light that is not seen is not carried", "lights", row)
        return []
    if not blocks[instance]:
        out.cannot("an area light's own shape blocks other lights in Mitsuba, and this one does not here", "lights", row)
    return shapes.of_light(instance, rgb("radiance", tables.lights.color[row]))


def _light(out: Export, name: str, light: ExportedLight) -> Node | None:
    """The emitter of a light without an extent; None after a report."""
    describe = LIGHTS[light.kind].mitsuba
    if describe is None:
        out.cannot(f"a {light.kind.name.lower()} light is not carried: Mitsuba has none", "lights", light.row)
        return None
    described = describe(light)
    if described.loss:
        out.cannot(described.loss, "lights", light.row)
    parameters = dict(described.parameters)
    if described.is_turned:
        frame = np.eye(4)
        frame[:3, :3], frame[:3, 3] = placement.frame_along(light.direction), light.position
        parameters["to_world"] = frame
    vectors = [Node(tag, vector(key, values).attributes) for key, (tag, values) in described.vectors.items()]
    emitter = node("emitter", described.plugin, **parameters).with_(*vectors, rgb(described.color, light.color))
    if described.texture is None:
        return emitter
    file = f"{name}.{len(out.files)}.pfm"
    out.files[file] = pfm(described.texture)
    return emitter.with_(value("texture", node("texture", "bitmap", filename=file, raw=True, wrap_mode="clamp")))


def _sun(out: Export, plan: Plan, shapes: Shapes, light: ExportedLight) -> Node:
    """A sun with an angular size: a bright, distant disk, which must not be visible to the camera."""
    tables, row, direction, angle = out.scene.tables, light.row, light.direction, light.angle
    if traits.specular(tables)[np.unique(tables.instances.material)].any() and plan["bounces"] > 0:
        out.cannot("a sun's disk is seen in mirrors and glass in Mitsuba, and not here", "lights", row, "angle: 0deg")
    if _in_view(camera_frames.eye(out.scene, plan["camera"], plan["size"]), direction, angle):
        out.cannot("the sun's disk is in the picture in Mitsuba, and not here", "lights", row, "angle: 0deg")
    distance = SUN_DISTANCE * shapes.radius
    if (tables.geometries.kind == ir.GeometryKind.PLANE).any():
        distance = 1e6 * shapes.radius  # beyond the end of planes
    frame = np.eye(4)
    frame[:3, :3] = placement.frame_along(-direction) * [distance * np.tan(angle), distance * np.tan(angle), 1.0]
    frame[:3, 3] = shapes.middle + distance * direction
    radiance = tables.lights.color[row] / (np.pi * np.sin(angle) ** 2)
    out.note("a sun with a size is carried as a bright disk far away", "lights", row)
    emitter = node("emitter", "area").with_(rgb("radiance", radiance))
    return node("shape", "disk", to_world=frame).with_(node("bsdf", "diffuse").with_(rgb("reflectance", texture_values.BLACK)), emitter)


def _in_view(seen: camera_frames.Eye, direction: F64, angle: float) -> bool:
    along = float(direction @ seen.forward)
    if not seen.perspective:
        return along > np.cos(angle)
    if along <= 0.0:
        return False
    offsets = [float(direction @ axis / (axis @ axis)) / along for axis in (seen.right, seen.up)]
    reach = [float(np.tan(angle) / np.linalg.norm(axis)) / along**2 for axis in (seen.right, seen.up)]
    return all(abs(offsets[k] - seen.shift[k]) <= 1.0 + reach[k] for k in range(2))


def _sky(out: Export, plan: Plan, name: str, shining: list[int]) -> list[Node]:
    """The environment emitter, of which Mitsuba supports one: the sum of the skies as a constant, or a dome as an envmap."""
    tables = out.scene.tables
    skies = [row for row in shining if tables.lights.kind[row] in SKIES]
    pictures = [row for row in skies if tables.lights.kind[row] in PICTURED and tables.lights.image[row] >= 0]
    if not pictures:
        total = tables.lights.color[skies].sum(axis=0)
        return [node("emitter", "constant").with_(rgb("radiance", total))] if skies else []
    for row in pictures[1:]:
        out.cannot("a second dome is not carried: Mitsuba has one", "lights", row)
    constant = tables.lights.color[[row for row in skies if row not in pictures]].sum(axis=0)
    row = pictures[0]
    matrix = placement.square(tables.transforms.matrix[tables.lights.transform[row]])
    if placement.even_scale(matrix) is None:
        out.cannot("a dome under a transform that stretches it is not carried", "lights", row)
    matrix = matrix.copy()
    matrix[:3, 3] = 0.0
    file = f"{name}.{len(out.files)}.pfm"
    radiance = texture_values.pixels(tables.images, int(tables.lights.image[row]))[..., :3] * tables.lights.color[row] + constant
    out.files[file] = pfm(envmap_rows(radiance))
    return [node("emitter", "envmap", filename=file, to_world=matrix)]


def envmap_rows(pixels: np.ndarray) -> np.ndarray:
    """Resamples a latitude–longitude image to Mitsuba's rows: first and last at the poles, two for each of ours.

    Mitsuba interpolates between rows, which gives the same values.
    """
    below = np.concatenate([pixels, pixels[-1:]])
    above = np.concatenate([pixels[:1], pixels])
    rows = np.empty((2 * len(pixels) + 1, *pixels.shape[1:]), np.float32)
    rows[1::2], rows[0::2] = pixels, (above + below) / 2
    return rows
