"""Uniform light from all directions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..compiler import ir
from ..lang.schema.argument_types import Arg
from . import daylight_sky
from .arguments import light_entry
from .contract import Element, ExportedLight, Form, LightError, Lowering, Row, UsdLight

_LUMINANCE = "nit; for a daylight sky, that of the uniform sky with the same illuminance of level ground"


def _lower(args: Mapping[str, Any], lowering: Lowering) -> Row:
    """An even sky, or with a turbidity a dome of daylight."""
    if args["turbidity"] is None:
        for name in ("sun", "ground"):
            if lowering.is_given(name):
                lowering.error(f"an even sky has no `{name}`", "give it a turbidity, like turbidity: 3, for the sky of a day")
        return Row(KIND, args["luminance"])
    sun = lowering.direction(args["sun"])
    if sun is None or sun[1] < 0.0:
        raise LightError("the sun of this sky stands below the horizon", "give it a direction that goes up: sun: [1, 0.5, 0.5]")
    turbidity, ground = float(args["turbidity"]), tuple(args["ground"])
    key = ("daylight", turbidity, *sun.tolist(), *ground)
    image = lowering.image(key, "daylight", lambda: daylight_sky.picture(sun, turbidity, ground))
    return Row(ir.LightKind.DOME, args["luminance"], frame=np.eye(4), image=image)


KIND = ir.LightKind.SKY
ELEMENTS = (
    Element(
        light_entry(
            "sky",
            "a sky in all directions, visible as the background: uniform, or with `turbidity` a daylight sky (Preetham 1999)",
            Arg("luminance", "luminance", 1.0, _LUMINANCE, aliases=("radiance",), minimum=0.0, keyword=True),
            Arg("turbidity", "number", None, "haze: 2 is clear, 6 hazy", minimum=1.8, maximum=10.0, keyword=True),
            Arg("sun", "direction", (1.0, 2.0, 1.5), "direction towards the sun of this sky; a `sun` adds its direct light", keyword=True),
            Arg("ground", "color", (0.2, 0.2, 0.2), "albedo of the ground below the horizon of a daylight sky", keyword=True),
            example="sky(turbidity: 3, sun: [1, 0.5, 0.5])",
        ),
        _lower,
    ),
)
FORM, HAS_ANGLE, HAS_IMAGE = Form.SKY, False, False
profile = widest = gltf = povray = mitsuba = None


def usd(light: ExportedLight) -> UsdLight:
    return UsdLight("DomeLight", {})
