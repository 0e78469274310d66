"""A rectangle that emits light to one side."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..compiler import ir
from ..lang.schema.argument_types import REQUIRED, Arg
from .arguments import PROFILE, light_entry
from .contract import Element, ExportedLight, Form, LightError, Lowering, Row, UsdLight

_KINDS = {"rectangle": ir.LightKind.RECTANGLE, "disk": ir.LightKind.DISK, "sphere": ir.LightKind.SPHERE}
EVEN = 1e-6  # relative difference of scales, or skew, that still counts as uniform


def lower(args: Mapping[str, Any], lowering: Lowering) -> Row | None:
    """A rectangle, a disk or a sphere as its `shape` says. Elements of other lights need no `profile`."""
    position = np.array(args["position"])
    towards = (0.0, -1.0, 0.0) if args["look_at"] is None else tuple(np.array(args["look_at"]) - position)
    frame = lowering.facing(tuple(position), towards, args["up"])
    if frame is None:
        raise LightError("the area light looks at where it is: it has no direction", "give it another look_at")
    shape = args["shape"]
    disk = shape != "rectangle"
    if disk and args["size"][0] != args["size"][1]:
        raise LightError(f"a {shape} has one diameter, got two sizes", 'write size: 1m, or shape: "rectangle"')
    frame, scale, even = lowering.rigid(lowering.block @ frame)
    half = (args["size"][0] / 2 * scale[0], args["size"][1] / 2 * scale[2])
    if not even or (disk and abs(half[0] - half[1]) > EVEN * half[0]):
        lowering.warn("the block around it skews or squeezes this area light: it is drawn even", "use an even scale")
    if disk:
        half = (math.sqrt(half[0] * half[1]), 0.0)
    area = (4.0 if shape == "sphere" else 1.0) * math.pi * half[0] ** 2 if disk else 4 * half[0] * half[1]
    radiance = args["luminance"] if args["flux"] is None else args["flux"] / (math.pi * area)
    profile = args.get("profile")
    image = -1 if profile is None else lowering.image_file(profile)
    return Row(_KINDS[shape], radiance, frame=frame, size=half, image=image) if image >= 0 or profile is None else None


KIND = ir.LightKind.RECTANGLE
ELEMENTS = (
    Element(
        light_entry(
            "area",
            "a rectangle or disk that emits light towards `look_at`, or a sphere; it is visible and casts shadows",
            Arg("position", "point", REQUIRED, "its center"),
            Arg("look_at", "point", None, "point that it faces; straight down by default", keyword=True),
            Arg("size", "size2", (1.0, 1.0), "its edge lengths, or the diameter of the disk or sphere", above=0.0, keyword=True),
            Arg("shape", "choice", "rectangle", "its form; a sphere shines all around", choices=tuple(_KINDS), keyword=True),
            Arg("visible", "bool", True, "whether it is seen and casts shadows; others light what is there alone", keyword=True),
            Arg("up", "direction", None, "direction of its second edge", keyword=True),
            Arg("luminance", "luminance", 1.0, "nit", aliases=("radiance",), minimum=0.0, keyword=True),
            Arg("flux", "flux", None, "total lumen", minimum=0.0, keyword=True),
            PROFILE,
            exclusive=(("luminance", "flux"),),
        ),
        lower,
    ),
)
FORM, HAS_ANGLE, HAS_IMAGE = Form.RECTANGLE, False, False
profile = widest = source = gltf = povray = mitsuba = None


def usd(light: ExportedLight) -> UsdLight:
    return UsdLight("RectLight", {"Width": 2.0 * float(light.size[0]), "Height": 2.0 * float(light.size[1])})
