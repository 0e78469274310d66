"""Uniform light of all surfaces, without occlusion: the L_a of Phong's model."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..compiler import ir
from ..lang.schema.argument_types import Arg, Entry
from .arguments import LIGHT
from .contract import Element, Form, Lowering, Row


def _lower(args: Mapping[str, Any], lowering: Lowering) -> Row:
    return Row(KIND, args["luminance"])


KIND = ir.LightKind.AMBIENT
ELEMENTS = (
    Element(
        Entry(
            "ambient",
            "light",
            "uniform ambient light without occlusion: the course's L_a",
            (
                Arg("color", "color", (1.0, 1.0, 1.0), "its colour"),
                Arg("luminance", "luminance", 0.1, "nit", aliases=("radiance",), minimum=0.0, keyword=True),
                *LIGHT[1:],
            ),
        ),
        _lower,
    ),
)
FORM, HAS_ANGLE, HAS_IMAGE = Form.AMBIENT, False, False
profile = widest = source = usd = gltf = povray = mitsuba = None
