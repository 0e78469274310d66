"""Imports USD lights: L = intensity · 2^exposure · color · blackbody, as UsdLux defines it."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from pxr import UsdGeom, UsdLux

from ....lang.diagnostics import Span
from ....lights import RECTANGLES, SURFACES
from ... import ir
from ...scene.builder import SceneBuilder
from ...scene.row_records import Color, LightData, as_color
from .. import images
from . import light_plates, light_shaping, links, stage
from .assets import Asset, asset, contents
from .light_plates import TURNED, rigid
from .materials import Materials
from .pictures import dome_pictures
from .shaders import materialx
from .stage import Opened

_LINE = 1e-3  # radius of a CylinderLight with treatAsLine, over its length
KINDS = ("DistantLight", "SphereLight", "RectLight", "DiskLight", "DomeLight", "DomeLight_1", "CylinderLight")


@dataclass(frozen=True, slots=True)
class _Light:
    """A light prim at one time, with access to its inputs."""

    prim: Any
    opened: Opened
    matrix: np.ndarray  # (4, 4) to world
    unit: float  # world units per stage unit

    def number(self, name: str, fallback: float = 0.0) -> float:
        attribute = self.prim.GetAttribute(f"inputs:{name}") or self.prim.GetAttribute(name)
        return stage.number(attribute, self.opened.time, fallback)

    @property
    def span(self) -> Span:
        return self.opened.span(self.prim)

    @property
    def scale(self) -> np.ndarray:
        return np.linalg.norm(self.matrix[:3, :3], axis=0)

    def radiance(self) -> np.ndarray:
        """Radiance L before normalization, (3,)."""
        attribute = self.prim.GetAttribute("inputs:color")
        written = stage.numbers(attribute, self.opened.time, np.float64)
        color = np.maximum(stage.linear(attribute, written), 0.0) if len(written) == 3 else np.ones(3)
        if self.number("enableColorTemperature"):
            color = color * np.array(UsdLux.BlackbodyTemperatureAsRgb(self.number("colorTemperature", 6500.0)))
        exposure = min(max(self.number("exposure"), -60.0), 60.0)
        return color * self.number("intensity", 1.0) * 2.0**exposure * self.number("diffuse", 1.0)


def light(
    prim: Any, matrix: np.ndarray, unit: float, opened: Opened, builder: SceneBuilder, materials: Materials, prefix: str = ""
) -> None:  # fmt: skip
    """Adds the light of a light prim under the (4, 4) matrix. `unit` is the scale of the matrix for stage units.

    `prefix` is that of the names of the stage's instances, to which light links refer.

    A cylinder is a prism of SIDES rectangles, a textured rectangle a grid of rectangles. Light filters are reported by name.
    """
    it = _Light(prim, opened, matrix, unit)
    kind = str(prim.GetTypeName())
    radiance = it.radiance()
    if not np.isfinite(radiance).all() or not np.isfinite(matrix).all():
        builder.diagnostics.warning("this light's strength is not finite: it is left out", it.span)
        return
    if (radiance < 0).any():
        builder.diagnostics.warning("this light's strength is negative: it is left out", it.span)
        return
    if (stage.numbers(prim.GetAttribute("inputs:color"), opened.time, np.float64) < 0).any():
        builder.diagnostics.warning("this light's colour has a negative component, which counts as 0", it.span)
    for data in _MAKERS[kind](it, radiance, builder, materials):
        if not _is_sound(data):
            materials.tell("the size or angle of this light is 0, negative or not finite: it is left out", prim)
            return
        builder.light(replace(data, shadows=_casts_shadows(it), links=links.light_links(prim, prefix, materials.warnings)), it.span)


def _is_sound(light: LightData) -> bool:
    """Whether a light's numbers are finite and it has the area of its kind."""
    sides = 2 if light.kind in RECTANGLES else int(light.kind in SURFACES)
    numbers = (*light.color, *light.position, *light.direction, *light.size, light.angle)
    return all(map(math.isfinite, numbers)) and min(light.color) >= 0 and all(side > 0 for side in light.size[:sides])


def mesh_radiance(prim: Any, matrix: np.ndarray, unit: float, opened: Opened, materials: Materials) -> Color | None:
    """The radiance of a mesh with MeshLightAPI, drawn as a diffuse emitter; None for other prims."""
    if not prim.HasAPI("MeshLightAPI"):
        return None
    it = _Light(prim, opened, matrix, unit)
    radiance = it.radiance()
    if not np.isfinite(radiance).all() or (radiance < 0).any():
        materials.tell("this light's strength is negative or not finite: it is left out", prim)
        return None
    if it.number("normalize"):
        area = _mesh_area(it)
        radiance = radiance / (area / unit**2) if area > 0 else radiance
    if not _casts_shadows(it):
        materials.tell("mesh lights cast shadows", prim)
    if links.light_links(prim, "", materials.warnings):
        materials.tell("mesh lights light every prim, and every prim casts their shadows: their links are not drawn", prim)
    return as_color(radiance)


def _mesh_area(it: _Light) -> float:
    """Area of a mesh in the world: of each face the length of half the sum of its corners' cross products."""
    counts = stage.numbers(it.prim.GetAttribute("faceVertexCounts"), it.opened.time, np.int64)
    indices = stage.numbers(it.prim.GetAttribute("faceVertexIndices"), it.opened.time, np.int64)
    points = stage.numbers(it.prim.GetAttribute("points"), it.opened.time, np.float64, 3)
    if not len(counts) or (counts < 1).any() or counts.sum() != len(indices) or (indices < 0).any() or indices.max() >= len(points):
        return 0.0
    corners = points[indices] @ it.matrix[:3, :3].T
    firsts = np.cumsum(counts) - counts
    following = np.arange(len(indices)) + 1
    following[firsts + counts - 1] = firsts
    corners -= np.repeat(corners[firsts], counts, axis=0)
    return float(0.5 * np.linalg.norm(np.add.reduceat(np.cross(corners, corners[following]), firsts), axis=1).sum())


def _casts_shadows(it: _Light) -> bool:
    """Value of ShadowAPI's shadow:enable."""
    enabled = stage.value(it.prim.GetAttribute("inputs:shadow:enable"), it.opened.time)
    return enabled is not False


def _distant(it: _Light, radiance: np.ndarray, builder: SceneBuilder, materials: Materials) -> list[LightData]:
    """A directional light of diameter `angle`: E = L π sin²(angle/2), or E = L if normalized or of zero angle."""
    half = math.radians(min(max(it.number("angle", 0.53), 0.0), 360.0)) / 2
    area = math.pi * math.sin(min(half, math.pi / 2)) ** 2
    irradiance = radiance if it.number("normalize") or area == 0 else radiance * area
    towards = it.matrix[:3, 2] / max(np.linalg.norm(it.matrix[:3, 2]), 1e-300)
    kind = ir.LightKind.SUN if half > 0 else ir.LightKind.DIRECTIONAL
    return [LightData(kind, as_color(irradiance), direction=as_color(towards), angle=min(half, math.radians(89)), name=_name(it))]


def _sphere(it: _Light, radiance: np.ndarray, builder: SceneBuilder, materials: Materials) -> list[LightData]:
    """A sphere light; a point light for treatAsPoint and without a radius."""
    radius = it.number("radius", 0.5)
    area, size = 4 * math.pi * radius**2, float(it.scale.mean())
    if np.ptp(it.scale) > 1e-4 * size:
        materials.tell("an uneven scale of a ball light is drawn as an even one", it.prim)
    in_world = radius * size
    if it.number("normalize") and area > 0:
        radiance = radiance / (area * (size / it.unit) ** 2)
    intensity = radiance * math.pi * in_world**2
    if it.number("treatAsPoint") and it.number("normalize"):
        intensity = it.radiance() / 4 * it.unit**2
    position, profile = as_color(it.matrix[:3, 3]), _profile(it, builder, materials)
    row = builder.transform(rigid(it.matrix) @ TURNED if profile >= 0 else rigid(it.matrix), it.span)
    if it.number("treatAsPoint") or in_world <= 0:
        turned = row if profile >= 0 else 0
        return [LightData(ir.LightKind.POINT, as_color(intensity), position, transform=turned, image=profile, name=_name(it))]
    kind, size_ = ir.LightKind.SPHERE, (in_world, 0.0)
    return [LightData(kind, as_color(radiance), position, transform=row, size=size_, image=profile, name=_name(it))]


def _profile(it: _Light, builder: SceneBuilder, materials: Materials, side: np.ndarray | None = None) -> int:
    return light_shaping.profile(it.prim, it.opened.time, builder, materials, it.span, side)


def _rect(it: _Light, radiance: np.ndarray, builder: SceneBuilder, materials: Materials) -> list[LightData]:
    width, height = it.number("width", 1.0), it.number("height", 1.0)
    outline = light_plates.rectangle(it.matrix, width, height)
    if it.number("normalize") and outline.area > 0:
        radiance = radiance / (outline.area / it.unit**2)
    colors = light_plates.texture(it.prim, it.opened.time, builder, materials, it.span)
    plates = [outline] if colors is None else light_plates.grid(it.matrix, width, height, len(colors))
    tints = [np.ones(3)] if colors is None else colors.reshape(-1, 3)
    profile = _profile(it, builder, materials)
    return [
        LightData(
            ir.LightKind.RECTANGLE, as_color(radiance * tint), transform=builder.transform(plate.frame, it.span), size=plate.size,
            image=profile, name=_name(it),
        )
        for plate, tint in zip(plates, tints, strict=True) if tint.any()
    ]  # fmt: skip


def _disk(it: _Light, radiance: np.ndarray, builder: SceneBuilder, materials: Materials) -> list[LightData]:
    plate = light_plates.disk(it.matrix, it.number("radius", 0.5))
    if it.number("normalize") and plate.area > 0:
        radiance = radiance / (plate.area / it.unit**2)
    row = builder.transform(plate.frame, it.span)
    profile = _profile(it, builder, materials)
    return [LightData(ir.LightKind.DISK, as_color(radiance), transform=row, size=plate.size, image=profile, name=_name(it))]


def _cylinder(it: _Light, radiance: np.ndarray, builder: SceneBuilder, materials: Materials) -> list[LightData]:
    """A prism of rectangles with the perimeter of the cylinder; its ends do not shine. With treatAsLine it is thin, of the same power."""
    radius, length = it.number("radius", 0.5), it.number("length", 1.0)
    plates = light_plates.prism(it.matrix, radius, length)
    area = sum(plate.area for plate in plates)
    if it.number("normalize") and area > 0:
        radiance = radiance / (area / it.unit**2)
    if it.number("treatAsLine") and radius > (thin := _LINE * length) > 0:
        plates, radiance = light_plates.prism(it.matrix, thin, length), radiance * (radius / thin)
    return [
        LightData(
            ir.LightKind.RECTANGLE, as_color(radiance), transform=builder.transform(plate.frame, it.span), size=plate.size,
            image=_profile(it, builder, materials, plate.turn), name=_name(it),
        )
        for plate in plates
    ]  # fmt: skip


def _dome(it: _Light, radiance: np.ndarray, builder: SceneBuilder, materials: Materials) -> list[LightData]:
    """A dome light; its image is latitude–longitude with the top at the dome's +y."""
    value = stage.value(it.prim.GetAttribute("inputs:texture:file"), it.opened.time)
    image = -1
    if getattr(value, "path", "") and (picture := asset(value, materials.warnings, it.prim)):
        try:
            image = _dome_image(it, picture, builder, materials)
        except (images.ImageError, OSError) as failure:
            builder.diagnostics.warning(str(failure), it.span, getattr(failure, "hint", ""))
    if image < 0:
        return [LightData(ir.LightKind.SKY, as_color(radiance), name=_name(it))]
    row = builder.transform(rigid(it.matrix @ _pole(it)), it.span)
    return [LightData(ir.LightKind.DOME, as_color(radiance), transform=row, image=image, name=_name(it))]


def _dome_image(it: _Light, file: Asset, builder: SceneBuilder, materials: Materials) -> int:
    """The row of a dome's picture, resampled if its layout is not latitude–longitude; `automatic` is. Raises ImageError and OSError."""
    attribute = it.prim.GetAttribute("inputs:texture:format")
    layout = str(attribute.Get(it.opened.time)) if attribute else "automatic"
    space = materialx.attribute_space(it.prim.GetAttribute("inputs:texture:file"), builder.files.colors, materials.tell)
    if layout not in dome_pictures.LAYOUTS:
        if layout not in ("automatic", "latlong", "None"):
            materials.tell(f"the dome's format `{layout}` is read as latlong", it.prim)
        return file.row(builder, space, span=it.span)
    decoded = images.read(contents(file.path), Path(file.path).name, space, config=builder.files.colors)
    decoded.warn(Path(file.path).name, builder.diagnostics, it.span)
    builder.is_wide |= decoded.is_wide
    image = dome_pictures.latitude_longitude(decoded.texels, layout)
    return builder.shared(("dome", file.path, layout), lambda: builder.image(image, file.path))


def _pole(it: _Light) -> np.ndarray:
    """The pole of a dome. DomeLight_1 may have it along z; the older DomeLight has it along y."""
    attribute = it.prim.GetAttribute("poleAxis")
    pole = str(attribute.Get(it.opened.time)) if attribute else "Y"
    if pole == "scene":
        pole = str(UsdGeom.GetStageUpAxis(it.opened.stage))
    return np.linalg.inv(TURNED) if pole == "Z" else np.eye(4)


_MAKERS = {
    "DistantLight": _distant, "SphereLight": _sphere, "CylinderLight": _cylinder, "RectLight": _rect, "DiskLight": _disk,
    "DomeLight": _dome, "DomeLight_1": _dome,
}  # fmt: skip


def _name(it: _Light) -> str:
    return str(it.prim.GetPath())
