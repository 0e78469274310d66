"""Parallel light from one direction."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..compiler import ir
from ..lang.schema.argument_types import Arg
from .arguments import ILLUMINANCE, light_entry
from .contract import Element, ExportedLight, Form, GltfLight, LightError, Lowering, MitsubaLight, PovrayLight, Row, Text, UsdLight


def lower(args: Mapping[str, Any], lowering: Lowering, name: str = "directional") -> Row:
    """The row of a light from the direction `from`."""
    direction = lowering.direction(args["from"])
    if direction is None:
        raise LightError(f"the {name}'s direction is 0", "give it a direction, like from: [1, 2, 1]")
    return Row(KIND, args["illuminance"], direction=direction.tolist())


KIND = ir.LightKind.DIRECTIONAL
ELEMENTS = (
    Element(
        light_entry(
            "directional",
            "parallel light from one direction",
            Arg("from", "direction", (0.0, 1.0, 0.0), "direction towards the light"),
            ILLUMINANCE,
        ),
        lower,
    ),
)
FORM, HAS_ANGLE, HAS_IMAGE = Form.DISTANT, False, False
profile = widest = source = None


def usd(light: ExportedLight) -> UsdLight:
    return UsdLight("DistantLight", {"Angle": 0.0, "Normalize": True})


def gltf(light: ExportedLight) -> GltfLight:
    return GltfLight({"type": "directional"})


def povray(light: ExportedLight, text: Text) -> PovrayLight:
    return PovrayLight()


def mitsuba(light: ExportedLight) -> MitsubaLight:
    return MitsubaLight("directional", "irradiance", vectors={"direction": ("vector", -light.direction)})
