"""The element catalogue: `SCHEMA` holds every element by name; textures, camera and settings are defined here."""

from __future__ import annotations

import math

from .argument_types import REQUIRED, Arg, Entry
from .lights import LIGHTS
from .materials import MATERIALS
from .shapes import BLOCKS, SHAPES, SOLIDS

MAX_BOUNCES = 64  # that can be asked for

_MAPPING = Arg(
    "mapping",
    "choice",
    "uv",
    "how a point of the surface finds its place in the texture",
    choices=("uv", "latlong", "projected", "box", "net"),
    keyword=True,
)
_TEXTURE = (
    _MAPPING,
    Arg("scale", "numbers2", (1.0, 1.0), "repeats over u and v", keyword=True),
    Arg("offset", "numbers2", (0.0, 0.0), "moves it over u and v", keyword=True),
)
_COLORS = (
    Arg("a", "color", (0.8, 0.8, 0.8), "first colour"),
    Arg("b", "color", (0.2, 0.2, 0.2), "second colour"),
    Arg("size", "length", None, "width of a cell along the surface; without it there are 8 over u and over v", above=0.0, keyword=True),
)

TEXTURES = (
    Entry(
        "image",
        "texture",
        "a picture from a file",
        (
            Arg("file", "string", REQUIRED, "file of the picture, beside the scene"),
            Arg("wrap", "choice", "repeat", "what lies outside of it", choices=("repeat", "clamp", "mirror", "black"), keyword=True),
            Arg("filter", "choice", "linear", "between its pixels", choices=("linear", "nearest"), keyword=True),
            Arg(
                "space",
                "choice",
                "auto",
                "how its values are stored; auto: sRGB for colours, linear for numbers",
                choices=("auto", "srgb", "linear"),
                keyword=True,
            ),
            *_TEXTURE,
        ),
    ),
    Entry("checker", "texture", "a chessboard of two colours", (*_COLORS, *_TEXTURE), example="checker(#eeeeee, #888888, size: 50cm)"),
    Entry(
        "stripes",
        "texture",
        "stripes of two colours across u",
        (*_COLORS, Arg("angle", "angle", 0.0, "turns them", keyword=True), *_TEXTURE),
    ),
    Entry(
        "pattern",
        "texture",
        "a formula of the point, in the thing's own frame: a number (grey), a truth value (1 or 0) or a colour",
        (Arg("formula", "formula", REQUIRED, "its value; x, y and z are plain numbers in the file's unit"),),
        example="pattern(|x, y, z| 0.5 + 0.4 * noise(8 * x, 8 * y, 8 * z))",
    ),
)

CAMERA = Entry(
    "camera",
    "camera",
    "where the picture is taken from",
    (
        Arg("position", "point", REQUIRED, "where it is"),
        Arg("look_at", "point", (0.0, 0.0, 0.0), "what it is turned to"),
        Arg("up", "direction", (0.0, 1.0, 0.0), "what is up in the picture", keyword=True),
        Arg(
            "fov",
            "angle",
            None,
            "vertical field of view (40deg when nothing is given)",
            above=0.0,
            maximum=math.radians(179.9),
            keyword=True,
        ),
        Arg("focal", "length", None, "focal length, with `film`", above=0.0, keyword=True),
        Arg("film", "size2", (0.036, 0.024), "width and height of the film, with `focal`", above=0.0, keyword=True),
        Arg("width", "length", None, "makes it orthographic, with this horizontal extent", above=0.0, keyword=True),
        Arg(
            "projection",
            "choice",
            None,
            "kind of picture; told from the rest when not given. Panoramic: all around, longitude by latitude, its middle straight ahead",
            choices=("perspective", "orthographic", "panoramic"),
            keyword=True,
        ),
        Arg(
            "near",
            "length",
            None,
            "what is nearer along its axis is cut away; an orthographic camera with a negative one also sees what lies so far behind it",
            keyword=True,
        ),
        Arg("far", "length", None, "what is farther along its axis is cut away", above=0.0, keyword=True),
        Arg("shift", "numbers2", (0.0, 0.0), "moves the picture by this share of its width and height", keyword=True),
        Arg("exposure", "number", None, "stops (ev) for 8 and 16-bit pictures", keyword=True),
        Arg("view", "string", None, "view transform", keyword=True),
        Arg("name", "string", None, "for --camera", keyword=True),
        Arg(
            "aperture",
            "number",
            None,
            "f-stop N: what is out of focus blurs as through a lens focal/N wide (with `fov`, of the focal length on a film 24 mm high)",
            above=0.0,
            keyword=True,
        ),
        Arg("focus", "length", None, "depth that is in focus, with `aperture`; that of `look_at` when not given", above=0.0, keyword=True),
        Arg("shutter", "time", None, "how long it stays open from `time` on: what moves meanwhile blurs", minimum=0.0, keyword=True),
    ),
    exclusive=(("fov", "focal", "width"),),
)

SETTINGS = (
    Entry(
        "render",
        "setting",
        "how the picture is made; the command line goes before it",
        (
            Arg("size", "pixels", None, "width and height in pixels", keyword=True),
            Arg("backend", "choice", None, "which backend draws", choices=("auto", "ray", "raster", "reference"), keyword=True),
            Arg("samples", "int", None, "samples a pixel", minimum=1, maximum=1 << 20, keyword=True),
            Arg("error", "number", None, "render until √relMSE is below this: 1%", above=0.0, below=1.0, keyword=True),
            Arg("budget", "time", None, "render for this long", above=0.0, keyword=True),
            Arg("bounces", "int", None, "surface interactions after the first hit", minimum=0, maximum=MAX_BOUNCES, keyword=True),
            Arg("seed", "int", None, "of the random numbers", minimum=0, keyword=True),
            Arg("filter", "choice", None, "pixel filter", choices=("box", "tent", "gaussian", "blackman-harris"), keyword=True),
            Arg("background", "color", None, "a colour in place of the sky", keyword=True),
            Arg("crop", "numbers", None, "x0, y0, x1, y1 in pixels", keyword=True),
            Arg("aov", "strings", None, "channels beside the picture", keyword=True),
        ),
    ),
    Entry(
        "animate",
        "setting",
        "how long `time` runs",
        (
            Arg("duration", "time", REQUIRED, "how long", above=0.0, keyword=True),
            Arg("fps", "number", 24.0, "frames a second", above=0.0, keyword=True),
        ),
    ),
)

SCHEMA: dict[str, Entry] = {e.name: e for e in (*SHAPES, *SOLIDS, *BLOCKS, *LIGHTS, *MATERIALS, *TEXTURES, CAMERA, *SETTINGS)}
