"""A sphere that emits light: a `sphere` with an emissive material of one color."""

from __future__ import annotations

from ..compiler import ir
from .contract import ExportedLight, Form, UsdLight

KIND = ir.LightKind.SPHERE
ELEMENTS = ()
FORM, HAS_ANGLE, HAS_IMAGE = Form.SPHERE, False, False
profile = widest = source = gltf = povray = mitsuba = None


def usd(light: ExportedLight) -> UsdLight:
    return UsdLight("SphereLight", {"Radius": float(light.size[0])})
