"""Light of the sky: even from all directions, even above lit ground, or that of a day."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..compiler import ir
from ..lang.schema.argument_types import Arg
from . import daylight_sky
from .arguments import light_entry
from .contract import Color, Element, ExportedLight, Form, LightError, Lowering, Row, UsdLight

_LUMINANCE = "nit; for a daylight sky, that of the uniform sky with the same illuminance of level ground"
_GROUND = (
    "albedo of the matt ground below the horizon, which the sky lights; a daylight sky has it, and an even sky where `ground` is "
    "written, or where `color` is and `luminance` has a unit; other even skies shine from below, too"
)


def _lower(args: Mapping[str, Any], lowering: Lowering) -> Row:
    """An even sky, one above ground, or with a turbidity a dome of daylight."""
    ground = tuple(args["ground"])
    if args["turbidity"] is None:
        if lowering.is_given("sun"):
            lowering.error("an even sky has no `sun`", "give it a turbidity, like turbidity: 3, for the sky of a day")
        if lowering.is_given("ground") or (lowering.has_unit and lowering.is_given("color")):
            return _above_ground(tuple(args["color"]), args["luminance"], ground, lowering)
        return Row(KIND, args["luminance"])
    sun = lowering.direction(args["sun"])
    if sun is None or sun[1] < 0.0:
        raise LightError("the sun of this sky stands below the horizon", "give it a direction that goes up: sun: [1, 0.5, 0.5]")
    turbidity = float(args["turbidity"])
    key = ("daylight", turbidity, *sun.tolist(), *ground)
    image = lowering.image(key, "daylight", lambda: daylight_sky.picture(sun, turbidity, ground))
    return Row(ir.LightKind.DOME, args["luminance"], frame=np.eye(4), image=image)


def _above_ground(color: Color, luminance: float, ground: Color, lowering: Lowering) -> Row:
    """A dome of one color above the horizon. Below it lies ground in the white light of the luminance of that color."""
    below = float(daylight_sky.LUMINANCE @ np.array(color)) * np.array(ground)
    if np.allclose(below, color, rtol=1e-6, atol=0.0):
        return Row(KIND, luminance)
    rgba = np.ones((HEIGHT, WIDTH, 4), np.float32)
    rgba[: HEIGHT // 2, :, :3], rgba[HEIGHT // 2 :, :, :3] = color, below
    image = lowering.image(("even sky", *color, *ground), "even sky", lambda: rgba)
    return Row(ir.LightKind.DOME, luminance, frame=np.eye(4), image=image, color=(1.0, 1.0, 1.0))


HEIGHT, WIDTH = 256, 16  # of the picture of an even sky above ground
KIND = ir.LightKind.SKY
ELEMENTS = (
    Element(
        light_entry(
            "sky",
            "a sky, visible as the background: even, or with `turbidity` a daylight sky (Preetham 1999)",
            Arg("luminance", "luminance", 1.0, _LUMINANCE, aliases=("radiance",), minimum=0.0, keyword=True),
            Arg("turbidity", "number", None, "haze: 2 is clear, 6 hazy", minimum=1.8, maximum=10.0, keyword=True),
            Arg("sun", "direction", (1.0, 2.0, 1.5), "direction towards the sun of this sky; a `sun` adds its direct light", keyword=True),
            Arg("ground", "color", (0.2, 0.2, 0.2), _GROUND, keyword=True),
            example="sky(turbidity: 3, sun: [1, 0.5, 0.5])",
        ),
        _lower,
    ),
)
FORM, HAS_ANGLE, HAS_IMAGE = Form.SKY, False, False
profile = widest = source = gltf = povray = mitsuba = None


def usd(light: ExportedLight) -> UsdLight:
    return UsdLight("DomeLight", {})
