"""Imports USD lights: L = intensity · 2^exposure · color · blackbody, as UsdLux defines it."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pxr import UsdGeom, UsdLux

from ....lang.diagnostics import Span
from ... import ir
from ...scene.builder import SceneBuilder
from ...scene.row_records import Color, LightData, as_color
from .. import images
from . import stage
from .materials import Materials, asset
from .stage import Opened

KINDS = ("DistantLight", "SphereLight", "RectLight", "DiskLight", "DomeLight", "DomeLight_1", "CylinderLight")
# The IR's area lights lie in y = 0 of their frame and emit to +y; USD's lie in z = 0 and emit to −z.
_TURNED = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
_FULL_ANGLE = 90.0  # degrees; a cone of this angle or more has no effect
_HALF_TURN = 180.0


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
        written = stage.numbers(self.prim.GetAttribute("inputs:color"), self.opened.time, np.float64)
        color = np.maximum(written, 0.0) if len(written) == 3 else np.ones(3)
        if self.number("enableColorTemperature"):
            color = color * np.array(UsdLux.BlackbodyTemperatureAsRgb(self.number("colorTemperature", 6500.0)))
        exposure = min(max(self.number("exposure"), -60.0), 60.0)
        return color * self.number("intensity", 1.0) * 2.0**exposure * self.number("diffuse", 1.0)


def light(prim: Any, matrix: np.ndarray, unit: float, opened: Opened, builder: SceneBuilder, materials: Materials) -> None:
    """Adds the light of a light prim under the (4, 4) matrix. `unit` is the scale of the matrix for stage units.

    Unsupported features are reported by name. Cylinders become spheres of equal area; cones shape spheres and disks only.
    Textures of area lights, IES profiles, focus and light filters are left out.
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
    made = _MAKERS[kind](it, radiance, builder, materials)
    if made is not None:
        builder.light(replace(made, shadows=_casts_shadows(it)), it.span)


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
        materials.tell("mesh lights are not normalized by their area", prim)
    if not _casts_shadows(it):
        materials.tell("mesh lights cast shadows", prim)
    return as_color(radiance)


def _casts_shadows(it: _Light) -> bool:
    """Value of ShadowAPI's shadow:enable."""
    enabled = stage.value(it.prim.GetAttribute("inputs:shadow:enable"), it.opened.time)
    return enabled is not False


def _distant(it: _Light, radiance: np.ndarray, builder: SceneBuilder, materials: Materials) -> LightData:
    """A directional light of diameter `angle`: E = L π sin²(angle/2), or E = L if normalized or of zero angle."""
    half = math.radians(min(max(it.number("angle", 0.53), 0.0), 360.0)) / 2
    area = math.pi * math.sin(min(half, math.pi / 2)) ** 2
    irradiance = radiance if it.number("normalize") or area == 0 else radiance * area
    towards = it.matrix[:3, 2] / max(np.linalg.norm(it.matrix[:3, 2]), 1e-300)
    kind = ir.LightKind.SUN if half > 0 else ir.LightKind.DIRECTIONAL
    return LightData(kind, as_color(irradiance), direction=as_color(towards), angle=min(half, math.radians(89)), name=_name(it))


def _sphere(it: _Light, radiance: np.ndarray, builder: SceneBuilder, materials: Materials) -> LightData | None:
    radius = it.number("radius", 0.5)
    return _ball(it, radiance, radius, 4 * math.pi * radius**2, builder, materials)


def _cylinder(it: _Light, radiance: np.ndarray, builder: SceneBuilder, materials: Materials) -> LightData | None:
    length, radius = it.number("length", 1.0), it.number("radius", 0.5)
    materials.tell("cylinder lights are drawn as balls of the same area", it.prim)
    area = 2 * math.pi * radius * length
    return _ball(it, radiance, math.sqrt(area / (4 * math.pi)), area, builder, materials)


def _ball(it: _Light, radiance: np.ndarray, radius: float, area: float, builder: SceneBuilder, materials: Materials) -> LightData | None:
    """A sphere light; a point light for treatAsPoint, a spot light with a shaping cone."""
    size = float(it.scale.mean())
    if np.ptp(it.scale) > 1e-4 * size:
        materials.tell("an uneven scale of a ball light is drawn as an even one", it.prim)
    in_world = radius * size
    if it.number("normalize") and area > 0:
        radiance = radiance / (area * (size / it.unit) ** 2)
    intensity = radiance * math.pi * in_world**2
    if it.number("treatAsPoint") and it.number("normalize"):
        intensity = it.radiance() / 4 * it.unit**2
    position = as_color(it.matrix[:3, 3])
    if _shaped(it):
        return _spot(it, intensity, position)
    if it.prim.HasAPI("ShapingAPI") and _FULL_ANGLE < it.number("shaping:cone:angle", _FULL_ANGLE) < _HALF_TURN:
        materials.tell("a cone of more than 90 degrees is not drawn: this light shines to all sides", it.prim)
    if it.number("treatAsPoint") or in_world <= 0:
        return LightData(ir.LightKind.POINT, as_color(intensity), position=position, name=_name(it))
    row = builder.transform(_rigid(it.matrix), it.span)
    return LightData(ir.LightKind.SPHERE, as_color(radiance), position=position, transform=row, size=(in_world, 0.0), name=_name(it))


def _shaped(it: _Light) -> bool:
    return it.prim.HasAPI("ShapingAPI") and it.number("shaping:cone:angle", 90.0) < _FULL_ANGLE


def _spot(it: _Light, intensity: np.ndarray, position: Color) -> LightData:
    """A spot light. `softness` is the fraction of the cone over which intensity falls off."""
    cone = math.radians(max(it.number("shaping:cone:angle", 90.0), 0.0))
    soft = min(max(it.number("shaping:cone:softness"), 0.0), 1.0)
    along = -it.matrix[:3, 2] / max(np.linalg.norm(it.matrix[:3, 2]), 1e-300)
    return LightData(
        ir.LightKind.SPOT, as_color(intensity), position=position, direction=as_color(along), cos_cone=math.cos(cone),
        cos_full=math.cos(cone * (1.0 - soft)), name=_name(it),
    )  # fmt: skip


def _rect(it: _Light, radiance: np.ndarray, builder: SceneBuilder, materials: Materials) -> LightData | None:
    scale = it.scale
    width, height = it.number("width", 1.0) * scale[0], it.number("height", 1.0) * scale[1]
    if it.number("normalize") and width * height > 0:
        radiance = radiance / (width * height / it.unit**2)
    if _shaped(it):
        materials.tell("cones shape balls and disks only: this light shines into its whole side", it.prim)
    row = builder.transform(_rigid(it.matrix) @ _TURNED, it.span)
    return LightData(ir.LightKind.RECTANGLE, as_color(radiance), transform=row, size=(width / 2, height / 2), name=_name(it))


def _disk(it: _Light, radiance: np.ndarray, builder: SceneBuilder, materials: Materials) -> LightData | None:
    radius = it.number("radius", 0.5) * float(it.scale[:2].mean())
    if np.ptp(it.scale[:2]) > 1e-4 * it.scale[:2].max():
        materials.tell("a disk light with an uneven scale is drawn as a circle", it.prim)
    area = math.pi * radius**2
    if it.number("normalize") and area > 0:
        radiance = radiance / (area / it.unit**2)
    if _shaped(it):
        return _spot(it, radiance * area, as_color(it.matrix[:3, 3]))
    row = builder.transform(_rigid(it.matrix) @ _TURNED, it.span)
    return LightData(ir.LightKind.DISK, as_color(radiance), transform=row, size=(radius, 0.0), name=_name(it))


def _dome(it: _Light, radiance: np.ndarray, builder: SceneBuilder, materials: Materials) -> LightData | None:
    """A dome light; its image is latitude–longitude with the top at the dome's +y."""
    layout = it.prim.GetAttribute("inputs:texture:format")
    written = str(layout.Get(it.opened.time)) if layout else "automatic"
    value = stage.value(it.prim.GetAttribute("inputs:texture:file"), it.opened.time)
    image = -1
    if getattr(value, "path", ""):
        if written not in ("automatic", "latlong", "None"):
            materials.tell(f"the dome's format `{written}` is read as latlong", it.prim)
        found = asset(value, materials, it.prim)
        try:
            image = found.row(builder, "auto", span=it.span) if found else -1
        except images.ImageError as failure:
            builder.diagnostics.warning(failure.message, it.span, failure.hint)
    if image < 0:
        return LightData(ir.LightKind.SKY, as_color(radiance), name=_name(it))
    row = builder.transform(_rigid(it.matrix @ _pole(it)), it.span)
    return LightData(ir.LightKind.DOME, as_color(radiance), transform=row, image=image, name=_name(it))


def _pole(it: _Light) -> np.ndarray:
    """The pole of a dome. DomeLight_1 may have it along z; the older DomeLight has it along y."""
    attribute = it.prim.GetAttribute("poleAxis")
    pole = str(attribute.Get(it.opened.time)) if attribute else "Y"
    if pole == "scene":
        pole = str(UsdGeom.GetStageUpAxis(it.opened.stage))
    return np.linalg.inv(_TURNED) if pole == "Z" else np.eye(4)


_MAKERS = {
    "DistantLight": _distant, "SphereLight": _sphere, "CylinderLight": _cylinder, "RectLight": _rect, "DiskLight": _disk,
    "DomeLight": _dome, "DomeLight_1": _dome,
}  # fmt: skip


def _rigid(matrix: np.ndarray) -> np.ndarray:
    """The matrix without scale: z keeps its direction, x stays as near as possible; right-handed even for a mirroring matrix."""
    made = np.eye(4)
    z = matrix[:3, 2] / max(np.linalg.norm(matrix[:3, 2]), 1e-300)
    x = matrix[:3, 0] - (matrix[:3, 0] @ z) * z
    length = np.linalg.norm(x)
    x = x / length if length > 0 else np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
    made[:3, 0], made[:3, 1], made[:3, 2] = x, np.cross(z, x), z
    made[:3, 3] = matrix[:3, 3]
    return made


def _name(it: _Light) -> str:
    return str(it.prim.GetPath())
