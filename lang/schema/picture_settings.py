"""The settings of a picture, a row each. The scene's `render`, the options of commands and the keyword arguments in Python read them."""

from __future__ import annotations

from dataclasses import dataclass

from .. import color_spaces
from . import picture_channels
from . import setting_values as values
from .argument_types import Arg

BACKENDS = (  # modules of render/backends that have a class Renderer
    "ray",
    "raster",
    "reference",
)
FILTERS = ("box", "tent", "gaussian", "blackman-harris")
MAX_BOUNCES = 64  # that surfaces need at most
MOST_BOUNCES = 1024  # that a setting may ask for: collisions inside of media count, too
MAX_SAMPLES = 1 << 20
MAX_SEED = (1 << 63) - 1
MAX_THREADS = 1024
_BOUNCES = "surface interactions after the first hit; default: 8 with mirrors or glass, 8 or more where the camera is in a room, else 0"


@dataclass(frozen=True, slots=True)
class PictureSetting:
    """One setting."""

    name: str
    read: values.Reader  # of a text or a value of Python
    kind: str  # how an option names its value; "int", "choice" and "flag" are types of options
    help: str = ""  # of the option; none where it is empty
    arg: Arg | None = None  # the argument of `render` in a scene; None where scenes do not have it
    limits: tuple[int, int] | None = None  # of a whole number
    choices: tuple[str, ...] = ()


def _whole(name: str, minimum: int, maximum: int, doc: str, help: str) -> PictureSetting:
    arg = Arg(name, "int", None, doc, minimum=minimum, maximum=maximum, keyword=True) if doc else None
    return PictureSetting(name, values.whole_number(minimum, maximum), "int", help, arg, (minimum, maximum))


def _choice(name: str, choices: tuple[str, ...], doc: str, help: str) -> PictureSetting:
    arg = Arg(name, "choice", None, doc, choices=choices, keyword=True)
    return PictureSetting(name, values.choice(choices), "choice", help, arg, choices=choices)


_ROWS = (
    _choice("backend", ("auto", *BACKENDS), "rendering backend", "Rendering backend."),
    PictureSetting(
        "size", values.size, "WxH", "Size in pixels: 800x600, or 512 for a square.",
        Arg("size", "pixels", None, "width and height in pixels", keyword=True),
    ),
    PictureSetting("camera", values.name, "NAME", "Name of the camera."),
    _whole(
        "samples", 1, MAX_SAMPLES, "samples a pixel; default: until √relMSE is 3%, or 256",
        "Samples per pixel. Default: until √relMSE is 3%, or 256.",
    ),
    PictureSetting(
        "error", values.share, "share", "Render until √relMSE is below this: 1%. A warning says if it is not.",
        Arg("error", "number", None, "render until √relMSE is below this: 1%", above=0.0, below=1.0, keyword=True),
    ),
    PictureSetting(
        "budget", values.duration, "time", "Time from the start of the command to the written picture: 20s.",
        Arg("budget", "time", None, "render for this long", above=0.0, keyword=True),
    ),
    _whole("bounces", 0, MOST_BOUNCES, _BOUNCES, "Surface interactions after the first hit."),
    _whole("seed", 0, MAX_SEED, "seed of the random numbers", "Seed of the random numbers."),
    _whole("threads", 1, MAX_THREADS, "", "Default: one per core. The picture does not depend on it."),
    PictureSetting(
        "aov", values.names, "names", f"Additional channels of an .exr: {picture_channels.help_names()}.",
        Arg("aov", "strings", None, "additional channels", keyword=True),
    ),
    PictureSetting(
        "denoise", values.flag, "flag", "Remove noise with Open Image Denoise. Default: if 256 samples or a --budget leave it."
    ),
    PictureSetting(
        "tolerance", values.positive, "PIXELS",
        "Greatest distance of the rasterizer's triangles from the outlines of shapes. Default: 0.05.",
    ),
    PictureSetting(
        "crop", values.crop, "x0,y0,x1,y1", "Render only these pixels, counted from the top left.",
        Arg("crop", "numbers", None, "x0, y0, x1, y1 in pixels", keyword=True),
    ),
    PictureSetting(
        "background", values.background, "background", "Background: sky, transparent or #rrggbb.",
        Arg("background", "color", None, "a colour in place of the sky", keyword=True),
    ),
    PictureSetting("exposure", values.exposure, "ev", "Stops, for 8 and 16-bit pictures; +1 is twice as bright."),
    PictureSetting("view", values.name, "NAME", "View of 8 and 16-bit pictures: standard, rolloff, agx, aces or a name of OpenColorIO."),
    PictureSetting("ocio", values.file, "FILE", "Configuration of OpenColorIO: a file, or ocio://default. Default: $OCIO."),
    PictureSetting("display", values.name, "NAME", "Display of that configuration, whose views are shown. Default: its first."),
    PictureSetting("look", values.name, "NAME", "Look of that configuration, in place of the view's own."),
    _choice(
        "working_space", tuple(color_spaces.WORKING), "primaries in which light is computed; default: rec709",
        "Primaries in which light is computed.",
    ),
    PictureSetting("white", values.white, "KELVIN", "White balance: kelvin of the light that becomes white, as 4000K, or auto."),
    PictureSetting("bloom", values.share, "share", "Share of the light that the lens scatters around what is bright: 5%. Default: none."),
    _choice("filter", FILTERS, "pixel filter", ""),
)  # fmt: skip
PICTURE_SETTINGS = {row.name: row for row in _ROWS}
_IN_SCENES = ("size", "backend", "samples", "error", "budget", "bounces", "seed", "filter", "background", "crop", "aov", "working_space")
RENDER_ARGUMENTS = tuple(arg for name in _IN_SCENES if (arg := PICTURE_SETTINGS[name].arg))
