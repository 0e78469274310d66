"""The schema's lights."""

from __future__ import annotations

import math

from .argument_types import REQUIRED, Arg, Entry

_LIGHT = (
    Arg("color", "color", (1.0, 1.0, 1.0), "multiplies its light", keyword=True),
    Arg(
        "receivers",
        "strings",
        None,
        "names of the objects that it lights, with `*` and `?`; `!name` leaves one out; default all",
        keyword=True,
    ),
    Arg("group", "string", None, "its light group; --aov light:NAME renders the light of one group", keyword=True),
    Arg("name", "string", None, "its name in messages", keyword=True),
)
_SKY_LUMINANCE = "nit; for a daylight sky, that of the uniform sky with the same illuminance of level ground"
_SHADOWS = (
    Arg("shadows", "bool", True, "whether objects cast shadows in its light", keyword=True),
    Arg("blockers", "strings", None, "names of the objects that cast shadows in its light, as `receivers`; default all", keyword=True),
)
_FALLOFF = Arg("falloff", "falloff", None, "attenuation with distance; default 1/d²", keyword=True)

LIGHTS = (
    Entry(
        "point",
        "light",
        "a point light that shines equally in all directions",
        (
            Arg("position", "point", REQUIRED, "its position"),
            Arg(
                "intensity",
                "intensity",
                9 * math.pi,
                "candela; by default white at a distance of 3 m renders as 1",
                minimum=0.0,
                keyword=True,
            ),
            Arg("flux", "flux", None, "total lumen", minimum=0.0, keyword=True),
            _FALLOFF,
            *_SHADOWS,
            *_LIGHT,
        ),
        exclusive=(("intensity", "flux"),),
        example="point([2, 3, 1], intensity: 40cd)",
    ),
    Entry(
        "spot",
        "light",
        "a point light that shines into a cone",
        (
            Arg("position", "point", REQUIRED, "its position"),
            Arg("look_at", "point", (0.0, 0.0, 0.0), "point that it aims at", keyword=True),
            Arg("cone", "angle", math.radians(30), "half angle of the cone", above=0.0, maximum=math.pi, keyword=True),
            Arg("soft", "angle", math.radians(5), "angle inside the edge of the cone over which it fades", minimum=0.0, keyword=True),
            Arg("intensity", "intensity", 9 * math.pi, "candela along its axis", minimum=0.0, keyword=True),
            Arg("flux", "flux", None, "total lumen in the cone", minimum=0.0, keyword=True),
            _FALLOFF,
            *_SHADOWS,
            *_LIGHT,
        ),
        exclusive=(("intensity", "flux"),),
    ),
    Entry(
        "directional",
        "light",
        "parallel light from one direction",
        (
            Arg("from", "direction", (0.0, 1.0, 0.0), "direction towards the light"),
            Arg(
                "illuminance", "illuminance", math.pi, "lux on a surface that faces it", aliases=("irradiance",), minimum=0.0, keyword=True
            ),
            *_SHADOWS,
            *_LIGHT,
        ),
    ),
    Entry(
        "sun",
        "light",
        "sunlight: parallel light from a small disk in the sky",
        (
            Arg("from", "direction", (1.0, 2.0, 1.5), "direction towards the light"),
            Arg(
                "illuminance", "illuminance", math.pi, "lux on a surface that faces it", aliases=("irradiance",), minimum=0.0, keyword=True
            ),
            Arg("angle", "angle", math.radians(0.53), "its angular diameter", minimum=0.0, maximum=math.pi / 2, keyword=True),
            *_SHADOWS,
            *_LIGHT,
        ),
    ),
    Entry(
        "sky",
        "light",
        "a sky in all directions, visible as the background: uniform, or with `turbidity` a daylight sky (Preetham 1999)",
        (
            Arg("luminance", "luminance", 1.0, _SKY_LUMINANCE, aliases=("radiance",), minimum=0.0, keyword=True),
            Arg("turbidity", "number", None, "haze: 2 is clear, 6 hazy", minimum=1.8, maximum=10.0, keyword=True),
            Arg("sun", "direction", (1.0, 2.0, 1.5), "direction towards the sun of this sky; a `sun` adds its direct light", keyword=True),
            Arg("ground", "color", (0.2, 0.2, 0.2), "albedo of the ground below the horizon of a daylight sky", keyword=True),
            *_SHADOWS,
            *_LIGHT,
        ),
        example="sky(turbidity: 3, sun: [1, 0.5, 0.5])",
    ),
    Entry(
        "dome",
        "light",
        "an environment map: a latitude-longitude image or a formula of the direction, visible as the background",
        (
            Arg("file", "string", None, "file of the image"),
            Arg(
                "pattern",
                "formula",
                None,
                "in place of `file`: the light from the unit direction x, y, z, a number or a colour",
                keyword=True,
            ),
            Arg("luminance", "luminance", 1.0, "nit where the image is 1", aliases=("radiance",), minimum=0.0, keyword=True),
            Arg("rotate", "rotation", None, "its rotation", keyword=True),
            *_SHADOWS,
            *_LIGHT,
        ),
    ),
    Entry(
        "area",
        "light",
        "a rectangle or disk that emits light towards `look_at`; it is visible and casts shadows",
        (
            Arg("position", "point", REQUIRED, "its center"),
            Arg("look_at", "point", None, "point that it faces; straight down by default", keyword=True),
            Arg("size", "size2", (1.0, 1.0), "its edge lengths, or the diameter of the disk", above=0.0, keyword=True),
            Arg("shape", "choice", "rectangle", "its outline", choices=("rectangle", "disk"), keyword=True),
            Arg("up", "direction", None, "direction of its second edge", keyword=True),
            Arg("luminance", "luminance", 1.0, "nit", aliases=("radiance",), minimum=0.0, keyword=True),
            Arg("flux", "flux", None, "total lumen", minimum=0.0, keyword=True),
            *_SHADOWS,
            *_LIGHT,
        ),
        exclusive=(("luminance", "flux"),),
    ),
    Entry(
        "ambient",
        "light",
        "uniform ambient light without occlusion: the course's L_a",
        (
            Arg("color", "color", (1.0, 1.0, 1.0), "its colour"),
            Arg("luminance", "luminance", 0.1, "nit", aliases=("radiance",), minimum=0.0, keyword=True),
            *_LIGHT[1:],
        ),
    ),
)
