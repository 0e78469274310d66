"""A rectangle that emits light to one side."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..compiler import ir
from ..lang.schema.argument_types import REQUIRED, Arg
from .arguments import light_entry
from .contract import Element, ExportedLight, Form, LightError, Lowering, Row, UsdLight

EVEN = 1e-6  # relative difference of scales, or skew, that still counts as uniform


def lower(args: Mapping[str, Any], lowering: Lowering) -> Row:
    """A rectangle, or a disk as its `shape` says."""
    position = np.array(args["position"])
    towards = (0.0, -1.0, 0.0) if args["look_at"] is None else tuple(np.array(args["look_at"]) - position)
    frame = lowering.facing(tuple(position), towards, args["up"])
    if frame is None:
        raise LightError("the area light looks at where it is: it has no direction", "give it another look_at")
    disk = args["shape"] == "disk"
    if disk and args["size"][0] != args["size"][1]:
        raise LightError("a disk has one diameter, got two sizes", 'write size: 1m, or shape: "rectangle"')
    frame, scale, even = lowering.rigid(lowering.block @ frame)
    half = (args["size"][0] / 2 * scale[0], args["size"][1] / 2 * scale[2])
    if not even or (disk and abs(half[0] - half[1]) > EVEN * half[0]):
        lowering.warn("the block around it skews or squeezes this area light: it is drawn even", "use an even scale")
    if disk:
        half = (math.sqrt(half[0] * half[1]), 0.0)
    area = math.pi * half[0] ** 2 if disk else 4 * half[0] * half[1]
    radiance = args["luminance"] if args["flux"] is None else args["flux"] / (math.pi * area)
    return Row(ir.LightKind.DISK if disk else KIND, radiance, frame=frame, size=half)


KIND = ir.LightKind.RECTANGLE
ELEMENTS = (
    Element(
        light_entry(
            "area",
            "a rectangle or disk that emits light towards `look_at`; it is visible and casts shadows",
            Arg("position", "point", REQUIRED, "its center"),
            Arg("look_at", "point", None, "point that it faces; straight down by default", keyword=True),
            Arg("size", "size2", (1.0, 1.0), "its edge lengths, or the diameter of the disk", above=0.0, keyword=True),
            Arg("shape", "choice", "rectangle", "its outline", choices=("rectangle", "disk"), keyword=True),
            Arg("up", "direction", None, "direction of its second edge", keyword=True),
            Arg("luminance", "luminance", 1.0, "nit", aliases=("radiance",), minimum=0.0, keyword=True),
            Arg("flux", "flux", None, "total lumen", minimum=0.0, keyword=True),
            exclusive=(("luminance", "flux"),),
        ),
        lower,
    ),
)
FORM, HAS_ANGLE, HAS_IMAGE = Form.RECTANGLE, False, False
profile = widest = gltf = povray = mitsuba = None


def usd(light: ExportedLight) -> UsdLight:
    return UsdLight("RectLight", {"Width": 2.0 * float(light.size[0]), "Height": 2.0 * float(light.size[1])})
