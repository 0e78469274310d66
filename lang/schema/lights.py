"""The schema's lights."""

from __future__ import annotations

import math

from .argument_types import REQUIRED, Arg, Entry

_LIGHT = (
    Arg("color", "color", (1.0, 1.0, 1.0), "multiplies its strength", keyword=True),
    Arg("group", "string", None, "its light group: --aov light:NAME shows what the lamps of one bring", keyword=True),
    Arg("name", "string", None, "its name in messages", keyword=True),
)
_SKY_LUMINANCE = "nit; of a day's sky what an even one would have that lights level ground as much"
_SHADOWS = Arg("shadows", "bool", True, "whether things block it", keyword=True)
_FALLOFF = Arg("falloff", "falloff", None, "how it fades with distance; 1/d² when not given", keyword=True)

LIGHTS = (
    Entry(
        "point",
        "light",
        "light from a point to all sides",
        (
            Arg("position", "point", REQUIRED, "where it is"),
            Arg("intensity", "intensity", 9 * math.pi, "candela; the default shows white 3 m away as 1", minimum=0.0, keyword=True),
            Arg("flux", "flux", None, "lumen to all sides together", minimum=0.0, keyword=True),
            _FALLOFF,
            _SHADOWS,
            *_LIGHT,
        ),
        exclusive=(("intensity", "flux"),),
        example="point([2, 3, 1], intensity: 40cd)",
    ),
    Entry(
        "spot",
        "light",
        "light from a point into a cone",
        (
            Arg("position", "point", REQUIRED, "where it is"),
            Arg("look_at", "point", (0.0, 0.0, 0.0), "what it is turned to", keyword=True),
            Arg("cone", "angle", math.radians(30), "half angle where its light ends", above=0.0, maximum=math.pi, keyword=True),
            Arg("soft", "angle", math.radians(5), "width inside the cone over which it fades", minimum=0.0, keyword=True),
            Arg("intensity", "intensity", 9 * math.pi, "candela along its axis", minimum=0.0, keyword=True),
            Arg("flux", "flux", None, "lumen in the cone together", minimum=0.0, keyword=True),
            _FALLOFF,
            _SHADOWS,
            *_LIGHT,
        ),
        exclusive=(("intensity", "flux"),),
    ),
    Entry(
        "directional",
        "light",
        "parallel light from one direction",
        (
            Arg("from", "direction", (0.0, 1.0, 0.0), "where it comes from"),
            Arg(
                "illuminance", "illuminance", math.pi, "lux on a surface that faces it", aliases=("irradiance",), minimum=0.0, keyword=True
            ),
            _SHADOWS,
            *_LIGHT,
        ),
    ),
    Entry(
        "sun",
        "light",
        "sunlight: parallel light from a small disk in the sky",
        (
            Arg("from", "direction", (1.0, 2.0, 1.5), "where it comes from"),
            Arg(
                "illuminance", "illuminance", math.pi, "lux on a surface that faces it", aliases=("irradiance",), minimum=0.0, keyword=True
            ),
            Arg("angle", "angle", math.radians(0.53), "its angular diameter", minimum=0.0, maximum=math.pi / 2, keyword=True),
            _SHADOWS,
            *_LIGHT,
        ),
    ),
    Entry(
        "sky",
        "light",
        "a sky all around, seen as the background: even, or, with a turbidity, that of a day (Preetham 1999)",
        (
            Arg("luminance", "luminance", 1.0, _SKY_LUMINANCE, aliases=("radiance",), minimum=0.0, keyword=True),
            Arg("turbidity", "number", None, "haze: 2 is clear, 6 hazy", minimum=1.8, maximum=10.0, keyword=True),
            Arg("sun", "direction", (1.0, 2.0, 1.5), "where this sky's sun stands, whose own light is a `sun`", keyword=True),
            Arg("ground", "color", (0.2, 0.2, 0.2), "matt ground below a day's horizon", keyword=True),
            _SHADOWS,
            *_LIGHT,
        ),
        example="sky(turbidity: 3, sun: [1, 0.5, 0.5])",
    ),
    Entry(
        "dome",
        "light",
        "a latitude-longitude picture all around, or a formula of the direction, seen as the background",
        (
            Arg("file", "string", None, "file of the picture"),
            Arg("pattern", "formula", None, "instead: what comes from direction x, y, z (of length 1), a number or a colour", keyword=True),
            Arg("luminance", "luminance", 1.0, "nit where the picture is 1", aliases=("radiance",), minimum=0.0, keyword=True),
            Arg("rotate", "rotation", None, "turns it", keyword=True),
            _SHADOWS,
            *_LIGHT,
        ),
    ),
    Entry(
        "area",
        "light",
        "a shining rectangle or disk, seen as it is, that blocks the light of others; it shines to the side it looks at",
        (
            Arg("position", "point", REQUIRED, "its middle"),
            Arg("look_at", "point", None, "what it is turned to; straight down when not given", keyword=True),
            Arg("size", "size2", (1.0, 1.0), "its edges, or the disk's diameter", above=0.0, keyword=True),
            Arg("shape", "choice", "rectangle", "its outline", choices=("rectangle", "disk"), keyword=True),
            Arg("up", "direction", None, "which way its second edge points", keyword=True),
            Arg("luminance", "luminance", 1.0, "nit", aliases=("radiance",), minimum=0.0, keyword=True),
            Arg("flux", "flux", None, "lumen together", minimum=0.0, keyword=True),
            _SHADOWS,
            *_LIGHT,
        ),
        exclusive=(("luminance", "flux"),),
    ),
    Entry(
        "ambient",
        "light",
        "light that is everywhere, unoccluded: the course's L_a",
        (
            Arg("color", "color", (1.0, 1.0, 1.0), "its colour"),
            Arg("luminance", "luminance", 0.1, "nit", aliases=("radiance",), minimum=0.0, keyword=True),
            *_LIGHT[1:],
        ),
    ),
)
