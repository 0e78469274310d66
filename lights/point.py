"""A point that shines equally in all directions."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from ..compiler import ir
from ..lang.schema.argument_types import REQUIRED, Arg
from .arguments import FALLOFF, INTENSITY, PROFILE, light_entry
from .contract import Element, ExportedLight, Form, GltfLight, Lowering, MitsubaLight, PovrayLight, Row, Text, UsdLight


def _lower(args: Mapping[str, Any], lowering: Lowering) -> Row | None:
    intensity = args["intensity"] if args["flux"] is None else args["flux"] / (4 * math.pi)
    position = lowering.point(args["position"])
    if args["profile"] is None:
        if args["rotate"] is not None:
            lowering.error("`rotate` turns a `profile`, and this light has none", "leave it out")
        return Row(KIND, intensity, position=position)
    image = lowering.image_file(args["profile"])
    frame, _, _ = lowering.rigid(lowering.block if args["rotate"] is None else lowering.block @ lowering.rotation(args["rotate"]))
    frame[:3, 3] = position
    return Row(KIND, intensity, position=position, frame=frame, image=image) if image >= 0 else None


KIND = ir.LightKind.POINT
ELEMENTS = (
    Element(
        light_entry(
            "point",
            "a point light that shines equally in all directions",
            Arg("position", "point", REQUIRED, "its position"),
            INTENSITY,
            Arg("flux", "flux", None, "total lumen", minimum=0.0, keyword=True),
            FALLOFF,
            PROFILE,
            Arg("rotate", "rotation", None, "rotation of its `profile`", keyword=True),
            exclusive=(("intensity", "flux"),),
            example="point([2, 3, 1], intensity: 40cd)",
        ),
        _lower,
    ),
)
FORM, HAS_ANGLE, HAS_IMAGE = Form.POINT, False, False
profile = widest = source = None


def usd(light: ExportedLight) -> UsdLight:
    return UsdLight("SphereLight", {"TreatAsPoint": True, "Normalize": True}, 4.0)  # a quarter of a ball's normalized intensity


def gltf(light: ExportedLight) -> GltfLight:
    return GltfLight({"type": "point"})


def povray(light: ExportedLight, text: Text) -> PovrayLight:
    return PovrayLight()


def mitsuba(light: ExportedLight) -> MitsubaLight:
    return MitsubaLight("point", "intensity", vectors={"position": ("point", light.position)})
