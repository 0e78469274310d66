"""The one schema: every element, its arguments, their types, defaults and a line of documentation each."""

from __future__ import annotations

import math
from typing import Any

from .argument_types import REQUIRED, Arg, Entry
from .materials import MATERIALS

MAX_BOUNCES = 64  # that can be asked for

_PLACED = (
    Arg("name", "string", None, "its name in messages and the id channel", keyword=True),
    Arg("translate", "point", None, "moves it, after scale and rotate", keyword=True),
    Arg("rotate", "rotation", None, "turns it about the origin of its frame", keyword=True),
    Arg("scale", "scale3", None, "stretches it from the origin of its frame", keyword=True),
)
_SHAPE = (Arg("material", "material", None, "what it is made of; inherited from the block around it", keyword=True), *_PLACED)
_CENTER = Arg("center", "point", (0.0, 0.0, 0.0), "where its middle is")
_RADIUS = Arg("radius", "length", 1.0, "radius", above=0.0)
_CAPPED = Arg("capped", "bool", True, "closed by disks", keyword=True)
_LIGHT = (
    Arg("color", "color", (1.0, 1.0, 1.0), "multiplies its strength", keyword=True),
    Arg("group", "string", None, "its light group: --aov light:NAME shows what the lamps of one bring", keyword=True),
    Arg("name", "string", None, "its name in messages", keyword=True),
)
_SKY_LUMINANCE = "nit; of a day's sky what an even one would have that lights level ground as much"
_SHADOWS = Arg("shadows", "bool", True, "whether things block it", keyword=True)
_FALLOFF = Arg("falloff", "falloff", None, "how it fades with distance; 1/d² when not given", keyword=True)
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


def _shape(name: str, doc: str, *args: Arg, **more: Any) -> Entry:
    return Entry(name, "shape", doc, (*args, *_SHAPE), **more)


def _planned(category: str, *names: str) -> tuple[Entry, ...]:
    return tuple(Entry(n, category, "not built yet", planned=True, children=category == "solid") for n in names)


SHAPES = (
    _shape("sphere", "all points at `radius` from `center`", _RADIUS, _CENTER, example="sphere(1, center: [0, 1, 0])"),
    _shape("box", "a rectangular box", Arg("size", "size3", (1.0, 1.0, 1.0), "its edges", above=0.0), _CENTER, example="box([1, 2, 1])"),
    _shape(
        "plane",
        "an endless plane",
        Arg("y", "length", None, "its height, when it is level"),
        Arg("normal", "direction", None, "its normal, with `point`", keyword=True),
        Arg("point", "point", None, "a point of it, with `normal`", keyword=True),
        Arg("a", "number", None, "a of a x + b y + c z + d = 0", keyword=True),
        Arg("b", "number", None, "b of a x + b y + c z + d = 0", keyword=True),
        Arg("c", "number", None, "c of a x + b y + c z + d = 0", keyword=True),
        Arg("d", "length", None, "d of a x + b y + c z + d = 0", keyword=True),
        exclusive=(("y", "normal", "a"), ("y", "point", "b"), ("y", "c")),
        example="plane(y: 0)",
    ),
    _shape("disk", "a flat disk", _RADIUS, _CENTER, Arg("normal", "direction", (0.0, 1.0, 0.0), "where it faces"), example="disk(1)"),
    _shape(
        "cylinder",
        "a cylinder about its y axis",
        _RADIUS,
        Arg("height", "length", 2.0, "its height", above=0.0),
        _CENTER,
        _CAPPED,
        example="cylinder(0.5, 2)",
    ),
    _shape(
        "cone",
        "a cone about its y axis, its tip up",
        _RADIUS,
        Arg("height", "length", 2.0, "its height", above=0.0),
        _CENTER,
        Arg("top", "length", 0.0, "radius at the top, for a truncated cone", minimum=0.0, keyword=True),
        _CAPPED,
        example="cone(0.5, 1)",
    ),
    _shape(
        "torus",
        "a ring about its y axis",
        Arg("radius", "length", 1.0, "from the axis to the middle of the tube", above=0.0),
        Arg("tube", "length", 0.25, "radius of the tube", above=0.0),
        _CENTER,
        example="torus(1, 0.25)",
    ),
    _shape(
        "capsule",
        "a cylinder about its y axis with half spheres for ends",
        Arg("radius", "length", 0.5, "radius", above=0.0),
        Arg("height", "length", 1.0, "height of the cylinder between the half spheres", above=0.0),
        _CENTER,
        example="capsule(0.3, 1)",
    ),
    _shape("ellipsoid", "a sphere stretched along the axes", Arg("radii", "size3", (1.0, 1.0, 1.0), "its half axes", above=0.0), _CENTER),
    _shape(
        "quadric",
        "A x² + B y² + C z² + D xy + E yz + F xz + G x + H y + I z + J = 0, in metres",
        Arg("coefficients", "numbers", REQUIRED, "the ten numbers A … J"),
        Arg("within", "size3", None, "edges of the box about the origin that cuts it; endless without", above=0.0),
        example="quadric([1, -1, 1, 0, 0, 0, 0, 0, 0, -0.2], within: 2)",
    ),
    _shape(
        "triangle",
        "one triangle, counter-clockwise from its front",
        Arg("points", "points", REQUIRED, "its three corners"),
        Arg("normals", "vectors3", None, "a normal for each corner", keyword=True),
        Arg("uv", "vectors2", None, "texture coordinates for each corner", keyword=True),
        example="triangle([[0, 0, 0], [1, 0, 0], [0, 1, 0]])",
    ),
    _shape(
        "polygon",
        "one flat polygon, convex or not, counter-clockwise from its front",
        Arg("points", "points", REQUIRED, "its corners in order"),
        Arg("holes", "point_lists", None, "the corners of each hole", keyword=True),
        Arg("uv", "vectors2", None, "texture coordinates for each corner of the outline, then of each hole", keyword=True),
    ),
    _shape(
        "mesh",
        "polygons from a file (.obj, .ply, .stl, .glb, .off), or from points and faces",
        Arg("file", "string", None, "file of the mesh, beside the scene"),
        Arg("points", "points", None, "the vertices", keyword=True),
        Arg("faces", "faces", None, "for each face its vertices, counter-clockwise from outside", keyword=True),
        Arg("normals", "vectors3", None, "a normal for each vertex", keyword=True),
        Arg("uv", "vectors2", None, "texture coordinates for each vertex", keyword=True),
        Arg("colors", "vectors3", None, "a linear colour for each vertex", keyword=True),
        Arg(
            "height",
            "length",
            None,
            "scaled evenly to this height and set with its base at y = 0, its middle at x = z = 0",
            above=0.0, keyword=True,
        ),
        exclusive=(("file", "points"),),
        example='mesh("bunny.obj", height: 35cm)',
    ),
    _shape(
        "usd",
        "everything a USD file holds but its cameras and settings",
        Arg("file", "string", REQUIRED, "file of the stage, beside the scene"),
        Arg("prim", "string", None, "only what lies below this prim", keyword=True),
    ),
    _shape(
        "implicit",
        "where a relation between x, y and z holds: a solid for <= and the like, a sheet for ==",
        Arg("formula", "formula", REQUIRED, "the relation; x, y and z are plain numbers in the file's unit, in its own frame"),
        Arg(
            "within",
            "within",
            None,
            "what cuts it: a length (from minus to plus, each way), three of them, two corners, a sphere or a box; found when not given",
        ),
        example="implicit(|x, y, z| x^4 + y^4 + z^4 <= 1)",
    ),
    *_planned("shape", "heightfield", "surface", "bezier", "nurbs", "subdivision", "curve", "revolve", "extrude", "voxels"),
)

_ROUND = Arg("round", "length", 0.0, "radius of the arcs that blend its parts where their surfaces meet", minimum=0.0, keyword=True)


def _solid(name: str, doc: str, *args: Arg, example: str = "") -> Entry:
    return Entry(name, "solid", doc, (*args, *_SHAPE), children=True, example=example)


SOLIDS = (
    _solid("union", "all of its children as one solid", _ROUND, example="union(round: 10cm) { sphere(1); box(1.5) }"),
    _solid("intersection", "what lies in all of its children", _ROUND, example="intersection { sphere(1); box(1.5) }"),
    _solid("difference", "its first child without the others", _ROUND, example="difference(round: 5cm) { box(2); cylinder(0.5, 3) }"),
    _solid("shell", "the outermost part of its children, hollow", Arg("thickness", "length", REQUIRED, "how thick", above=0.0)),
    _solid("offset", "its children grown, or shrunk by less than 0", Arg("by", "length", REQUIRED, "how far the surface moves outwards")),
    _solid(
        "twist",
        "its children turned about the y axis, more the higher they reach",
        Arg("angle", "angle", REQUIRED, "how far"),
        Arg("over", "length", 1.0, "over what height", above=0.0),
        example="twist(90deg, over: 2) { box([1, 2, 1]) }",
    ),
    _solid(
        "bend",
        "its children bent from the x axis upwards, towards +y",
        Arg("angle", "angle", REQUIRED, "how far"),
        Arg("over", "length", 1.0, "over what length of x", above=0.0),
    ),
    _solid(
        "repeat",
        "its children again and again, each further by a step",
        Arg("step", "point", REQUIRED, "from each to the next"),
        Arg("count", "int", REQUIRED, "how many there are", minimum=1),
    ),
    _solid("mirrored", "its children and their image in a mirror through the origin", Arg("normal", "direction", REQUIRED, "the mirror's")),
    _solid("morph", "between its two children", Arg("share", "number", 0.5, "0: the first, 1: the second", minimum=0.0, maximum=1.0)),
)

BLOCKS = (
    Entry("group", "block", "its children together", _SHAPE, children=True, example="group(translate: [1, 0, 0]) { sphere(1) }"),
    Entry(
        "transform",
        "block",
        "its children scaled, then rotated, then translated; or by a matrix",
        (Arg("matrix", "matrix", None, "applied instead of translate, rotate and scale"), *_SHAPE),
        children=True,
        exclusive=(("matrix", "translate"), ("matrix", "rotate"), ("matrix", "scale")),
    ),
    Entry("translate", "block", "its children moved", (Arg("by", "point", REQUIRED, "how far"),), children=True),
    Entry("rotate", "block", "its children turned", (Arg("by", "rotation", REQUIRED, "how"),), children=True),
    Entry("scale", "block", "its children stretched", (Arg("by", "scale3", REQUIRED, "how much"),), children=True),
)

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
            "near", "length", None,
            "what is nearer along its axis is cut away; an orthographic camera with a negative one also sees what lies so far behind it",
            keyword=True,
        ),
        Arg("far", "length", None, "what is farther along its axis is cut away", above=0.0, keyword=True),
        Arg("shift", "numbers2", (0.0, 0.0), "moves the picture by this share of its width and height", keyword=True),
        Arg("exposure", "number", None, "stops (ev) for 8 and 16-bit pictures", keyword=True),
        Arg("view", "string", None, "view transform", keyword=True),
        Arg("name", "string", None, "for --camera", keyword=True),
        Arg(
            "aperture", "number", None,
            "f-stop N: what is out of focus blurs as through a lens focal/N wide (with `fov`, of the focal length on a film 24 mm high)",
            above=0.0, keyword=True,
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
