"""The schema's textures, camera and settings, and `ENTRIES`: the elements of this package."""

from __future__ import annotations

import math

from .argument_types import REQUIRED, Arg, Entry
from .picture_settings import RENDER_ARGUMENTS
from .shapes import BLOCKS, SHAPES, SOLIDS

_MAPPING = Arg(
    "mapping",
    "choice",
    "uv",
    "mapping from the surface to the texture",
    choices=("uv", "latlong", "projected", "box", "net"),
    keyword=True,
)
_TEXTURE = (
    _MAPPING,
    Arg("scale", "numbers2", (1.0, 1.0), "number of repetitions over u and v", keyword=True),
    Arg("offset", "numbers2", (0.0, 0.0), "offset in u and v", keyword=True),
)
_WRAPS = ("repeat", "clamp", "mirror", "black")
_SPACE = (
    "colour space of its values: srgb, linear, rec2020, acescg, raw, or a name of OpenUSD, MaterialX or the --ocio configuration; "
    "auto: sRGB for integers that are colours; linear for floats, of the file's chromaticities, and for numbers"
)
_COLORS = (
    Arg("a", "color", (0.8, 0.8, 0.8), "first colour"),
    Arg("b", "color", (0.2, 0.2, 0.2), "second colour"),
    Arg("size", "length", None, "width of a cell along the surface; default: 8 cells over u and over v", above=0.0, keyword=True),
)

TEXTURES = (
    Entry(
        "image",
        "texture",
        "an image file",
        (
            Arg("file", "string", REQUIRED, "file of the image, relative to the scene"),
            Arg("wrap", "choice", "repeat", "lookup outside of the image", choices=_WRAPS, keyword=True),
            Arg("filter", "choice", "linear", "interpolation between its pixels", choices=("linear", "nearest"), keyword=True),
            Arg("space", "string", "auto", _SPACE, keyword=True),
            *_TEXTURE,
            Arg("angle", "angle", 0.0, "rotation of the picture", keyword=True),
            Arg("wrap_v", "choice", None, "`wrap` along v; default: that along u", choices=_WRAPS, keyword=True),
            Arg(
                "channel", "choice", None, "one channel in place of all; default: all of a colour, r of a number", choices=tuple("rgba"),
                keyword=True,
            ),
            Arg("gain", "factors", (1.0, 1.0, 1.0), "factor of its values", keyword=True),
            Arg("bias", "factors", (0.0, 0.0, 0.0), "added to its values, after `gain`", keyword=True),
        ),
    ),
    Entry("checker", "texture", "a chessboard of two colours", (*_COLORS, *_TEXTURE), example="checker(#eeeeee, #888888, size: 50cm)"),
    Entry(
        "stripes",
        "texture",
        "stripes of two colours across u",
        (*_COLORS, Arg("angle", "angle", 0.0, "rotation of the stripes", keyword=True), *_TEXTURE),
    ),
    Entry(
        "pattern",
        "texture",
        "a formula of the point in the object's frame, or of texture coordinates: a number (grey), a truth value (1 or 0) or a colour",
        (
            Arg(
                "formula",
                "formula",
                REQUIRED,
                "its value at |x, y, z| in the file's unit, |u, v|, |x, y, z, u, v| or |x, y, z, u, v, nx, ny, nz| with the normal; "
                "image(…)(u, v) and other patterns have values in it",
            ),
        ),
        example="pattern(|x, y, z| 0.5 + 0.4 * noise(8 * x, 8 * y, 8 * z))",
    ),
    Entry(
        "flakes",
        "texture",
        "a `normal_map` of flakes that tilt the facets of a base, under its coat: car paint, glitter; filtered over a pixel",
        (
            Arg("size", "length", 0.001, "mean width of a flake, in the object's frame", above=0.0),
            Arg(
                "tilt", "number_map", 0.4, "roughness of the flakes' tilts: from far, they are facets of both roughnesses",
                minimum=0.0, maximum=1.0, keyword=True,
            ),
            Arg("coverage", "number_map", 1.0, "share of the surface that has flakes", minimum=0.0, maximum=1.0, keyword=True),
            Arg("seed", "int", 0, "number of the random places and tilts", minimum=0.0, maximum=1e6, keyword=True),
        ),
        example="sphere(1, material: openpbr(#3060a0, base_metalness: 1, coat_weight: 1, normal_map: flakes(1cm)))",
    ),
)

CAMERA = Entry(
    "camera",
    "camera",
    "the viewpoint and lens of the picture",
    (
        Arg("position", "point", REQUIRED, "its position"),
        Arg("look_at", "point", (0.0, 0.0, 0.0), "point that it aims at"),
        Arg("up", "direction", (0.0, 1.0, 0.0), "direction that is up in the picture", keyword=True),
        Arg(
            "fov",
            "angle",
            None,
            "vertical field of view (default 40deg)",
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
            "default: from the other arguments. Panoramic shows all directions, longitude by latitude, straight ahead in the middle",
            choices=("perspective", "orthographic", "panoramic"),
            keyword=True,
        ),
        Arg(
            "near",
            "length",
            None,
            "near clipping distance along its axis; a negative one of an orthographic camera shows objects behind it",
            keyword=True,
        ),
        Arg("far", "length", None, "far clipping distance along its axis", above=0.0, keyword=True),
        Arg("shift", "numbers2", (0.0, 0.0), "lens shift, as a share of the picture's width and height", keyword=True),
        Arg("exposure", "number", None, "stops (ev) for 8 and 16-bit pictures", keyword=True),
        Arg("view", "string", None, "view of 8 and 16-bit pictures: standard, rolloff, agx, aces, or a name of OpenColorIO", keyword=True),
        Arg(
            "white", "white", None, "white balance: kelvin of the light that becomes white, or \"auto\" for that of the scene's lights",
            keyword=True,
        ),
        Arg("name", "string", None, "for --camera", keyword=True),
        Arg(
            "aperture",
            "number",
            None,
            "f-number N: depth of field of a lens of diameter focal/N (with `fov`, the focal length on a film 24 mm high)",
            above=0.0,
            keyword=True,
        ),
        Arg("focus", "length", None, "depth in focus, with `aperture`; default: that of `look_at`", above=0.0, keyword=True),
        Arg("shutter", "time", None, "exposure time from `time` on; moving objects are blurred", minimum=0.0, keyword=True),
    ),
    exclusive=(("fov", "focal", "width"),),
    example="camera(position: [0, 1, 5], look_at: [0, 1, 0])",
)

SETTINGS = (
    Entry(
        "render",
        "setting",
        "settings of the picture; options of the command line override them",
        RENDER_ARGUMENTS,
    ),
    Entry(
        "animate",
        "setting",
        "duration and frame rate of an animation",
        (
            Arg("duration", "time", REQUIRED, "its duration", above=0.0, keyword=True),
            Arg("fps", "number", 24.0, "frames a second", above=0.0, keyword=True),
        ),
    ),
)

ENTRIES = (*SHAPES, *SOLIDS, *BLOCKS, *TEXTURES, CAMERA, *SETTINGS)
"""The elements that have no module of their own."""
