"""A disk that emits light to one side: the element `area` of rectangle.py with `shape: "disk"`."""

from __future__ import annotations

from ..compiler import ir
from .contract import ExportedLight, Form, UsdLight

KIND = ir.LightKind.DISK
ELEMENTS = ()
FORM, HAS_ANGLE, HAS_IMAGE = Form.DISK, False, False
profile = widest = source = gltf = povray = mitsuba = None


def usd(light: ExportedLight) -> UsdLight:
    return UsdLight("DiskLight", {"Radius": float(light.size[0])})
