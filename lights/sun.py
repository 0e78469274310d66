"""Parallel light from a disk in the sky."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from ..compiler import ir
from ..lang.schema.argument_types import Arg
from . import directional
from .arguments import ILLUMINANCE, light_entry
from .contract import Element, ExportedLight, Form, GltfLight, Lowering, Row, UsdLight


def _lower(args: Mapping[str, Any], lowering: Lowering) -> Row:
    parallel, angle = directional.lower(args, lowering, "sun"), args["angle"] / 2
    return parallel._replace(kind=KIND, angle=angle) if angle > 0 else parallel


KIND = ir.LightKind.SUN
ELEMENTS = (
    Element(
        light_entry(
            "sun",
            "sunlight: parallel light from a small disk in the sky",
            Arg("from", "direction", (1.0, 2.0, 1.5), "direction towards the light"),
            ILLUMINANCE,
            Arg("angle", "angle", math.radians(0.53), "its angular diameter", minimum=0.0, maximum=math.pi / 2, keyword=True),
        ),
        _lower,
    ),
)
FORM, HAS_ANGLE, HAS_IMAGE = Form.DISTANT, True, False
profile = widest = None
povray, mitsuba = directional.povray, directional.mitsuba


def source(lights: ir.Lights, row: int) -> Mapping[str, float]:
    return {"angle": 2.0 * float(lights.angle[row])}


def usd(light: ExportedLight) -> UsdLight:
    return UsdLight("DistantLight", {"Angle": 2.0 * math.degrees(light.angle), "Normalize": True})


def gltf(light: ExportedLight) -> GltfLight:
    return GltfLight({"type": "directional"}, "the size of a sun is not carried: its shadows are sharp" if light.angle > 0 else "")
