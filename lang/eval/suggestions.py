"""Suggestions for unknown names, arguments and units: words of other tools and their equivalents."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping

from .. import units
from ..diagnostics import MAX_WORD, suggest

# Equivalents of an argument name, the likeliest first. Those that the element lacks are skipped.
_ARGUMENTS: dict[str, tuple[str, ...]] = {
    "pos": ("position", "center", "translate"),
    "position": ("center", "translate"),
    "location": ("position", "center", "translate"),
    "origin": ("center", "position", "translate"),
    "centre": ("center", "centered", "translate"),
    "center": ("position", "centered", "translate"),
    "at": ("position", "center", "translate"),
    "eye": ("position",),
    "target": ("look_at",),
    "to": ("look_at",),
    "direction": ("from", "normal", "look_at"),
    "dir": ("from", "normal", "look_at"),
    "r": ("radius", "round"),
    "radius": ("round", "r"),
    **dict.fromkeys(("diameter", "d"), ("radius",)),
    **dict.fromkeys(("lens", "focal_length"), ("focal",)),
    **dict.fromkeys(("f_stop", "fstop", "f_number", "dof"), ("aperture",)),
    **dict.fromkeys(("focus_distance", "focal_distance"), ("focus",)),
    "engine": ("backend",),
    "transmission": ("opacity",),
    "h": ("height",),
    "width": ("size",),
    "height": ("size", "over", "h"),
    "length": ("over",),
    "by": ("over",),
    "depth": ("size", "height"),
    "valign": ("vertical",),
    **dict.fromkeys(("points", "outline", "polygon", "shape", "path"), ("profile", "points")),
    **dict.fromkeys(("x", "y", "z"), ("center", "position")),
    **dict.fromkeys(("bounds", "bbox", "bounding_box"), ("within",)),
    "dimensions": ("size",),
    "resolution": ("size",),
    "angle": ("cone", "fov", "rotate"),
    "rotation": ("rotate", "look_at"),
    **dict.fromkeys(("sun_direction", "sun_elevation", "elevation", "azimuth"), ("sun", "from")),
    "offset": ("translate",),
    **dict.fromkeys(("smooth", "blend", "fillet", "k", "rounding"), ("round",)),
    "spp": ("samples",),
    "strength": ("intensity", "illuminance", "luminance"),
    "brightness": ("intensity", "illuminance", "luminance"),
    "power": ("flux", "intensity", "illuminance", "luminance"),
    "energy": ("flux", "intensity", "illuminance", "luminance"),
    "intensity": ("illuminance", "luminance"),
    "emission": ("luminance",),
    "albedo": ("color",),
    "colour": ("color", "material"),
    "color": ("material",),
    "texture": ("material", "color"),
    "exponent": ("shininess",),
    "roughness": ("shininess",),
    "label": ("name",),
    "id": ("name",),
}

_ARGUMENT_HINTS = {
    "axis": "a turn about an axis is axis(v, angle)",
    **dict.fromkeys(("segments", "facets", "fn", "slices"), "round shapes are drawn round: leave it out"),
}
_COLORED = "write material: lambert(…), with the colour as argument"
_TEXTURED = "write material: lambert(…), with the texture as argument"
_ANGLE = "the direction to it: [cos(e), sin(e), 0] at an elevation of e"
_NEAR_HINTS: dict[str, dict[str, str]] = {  # by suggestion, then by the word in the source
    "did you mean `material`?": {"color": _COLORED, "colour": _COLORED, "texture": _TEXTURED},
    "did you mean `radius`?": dict.fromkeys(("diameter", "d"), "half of the diameter"),
    "did you mean `focal`?": dict.fromkeys(("lens", "focal_length"), "a length: 50mm"),
    "did you mean `opacity`?": {"transmission": "clear solids are made of glass(…)"},
    "did you mean `look_at`?": {"rotation": "a camera is turned by the point it looks at"},
    "did you mean `by`?": dict.fromkeys(("x", "y", "z", "dx", "dy", "dz"), "three in a list: translate([x, y, z]), rotate([0, 45deg, 0])"),
    "did you mean `sun`?": dict.fromkeys(("sun_elevation", "elevation", "azimuth"), _ANGLE),
    "did you mean `from`?": dict.fromkeys(("sun_elevation", "elevation", "azimuth"), _ANGLE),
}

METAL = "a metal of any colour is principled(color, metallic: 1)"

AXES = {"x": "[1, 0, 0]", "y": "[0, 1, 0]", "z": "[0, 0, 1]"}

# Replacements of names that are not in the language.
_NAMES: dict[str, str] = {
    "range": "write 0..n",
    **dict.fromkeys(("color", "colour"), "write #rrggbb or rgb(r, g, b); for several shapes group(material: lambert(#c83232)) { … }"),
    "vec2": "write [x, y]",
    "vec3": "write [x, y, z]",
    "vector": "write [x, y, z]",
    "light": "lights are point, spot, directional, sun, sky, dome, area and ambient",
    **dict.fromkeys(("subtract", "minus"), "write difference { … }"),
    "intersect": "write intersection { … }",
    **dict.fromkeys(("smooth_union", "smin", "smooth_min", "soft_union"), "write union(round: 10cm) { … }"),
    "sqr": "write x^2",
    "square": "write x^2 for a power, profiles.rectangle(…) of std/profiles for a shape to extrude",
    "hull": "a hull of two balls is capsule(…) or curve([a, b], radius)",
    "minkowski": "write offset(radius) { … } to round outwards",
    "resize": "write scale([2, 1, 1]) { … }",
    **dict.fromkeys(("echo", "print"), "nothing is printed; `maquette inspect` lists the params"),
    **dict.fromkeys(("lamp", "Light"), "lights are point, spot, directional, sun, sky, dome, area and ambient"),
    **dict.fromkeys(("area_light", "AreaLight", "RectAreaLight"), "write area(position: …, look_at: …, size: 1)"),
    **dict.fromkeys("world hdri environment skybox envmap background_image".split(), 'write dome("…") for a picture, sky() for a colour'),
    **dict.fromkeys(("PerspectiveCamera", "Camera"), "write camera(position: …, look_at: …, fov: 50deg)"),
    "OrthographicCamera": 'write camera(position: …, look_at: …, projection: "orthographic")',
    **dict.fromkeys(("model", "load", "load_mesh", "loader", "GLTFLoader", "OBJLoader"), 'write mesh("…") or usd("…")'),
    **dict.fromkeys(("monkey", "suzanne", "teapot"), 'write mesh("…") with a file of it'),
    **dict.fromkeys(("Mesh", "scene", "Scene"), "an element is placed by writing it: sphere(1, material: …)"),
    **dict.fromkeys("MeshStandardMaterial MeshPhysicalMaterial".split(), "write principled(…)"),
    **dict.fromkeys("MeshLambertMaterial MeshBasicMaterial".split(), "write lambert(…)"),
    "MeshPhongMaterial": "write phong(…)",
    **dict.fromkeys(("None", "undefined", "undef", "nil"), "leave the argument out"),
    **dict.fromkeys(("p", "pos", "point3"), "a formula's parameters are numbers: write |x, y, z| …"),
    **dict.fromkeys(("trunc", "int"), "write floor(x)"),
    "cbrt": "write sign(x) * abs(x)^(1 / 3)",
    **dict.fromkeys(("sinh", "cosh", "tanh"), "write it by exp: cosh(x) is (exp(x) + exp(-x)) / 2"),
    **dict.fromkeys(("sec", "csc", "cot"), "write 1 / cos(x), 1 / sin(x) or 1 / tan(x)"),
    **dict.fromkeys(("combine", "merge", "unite"), "write union { … }"),
    "cube": "write box()",
    **dict.fromkeys(("light_source", "pointlight", "PointLight", "point_light"), "write point(position, intensity: 100cd)"),
    **dict.fromkeys(("DirectionalLight", "directional_light"), "write directional(from: [1, 2, 1])"),
    **dict.fromkeys(("pigment", "finish"), "write material: lambert(color) or material: plastic(color)"),
    **dict.fromkeys(("THREE", "bpy"), "elements have no prefix: write sphere(1)"),
    **dict.fromkeys(("linear_extrude", "prism", "ExtrudeGeometry"), "write extrude(profile, height)"),
    **dict.fromkeys(("rotate_extrude", "lathe", "sor", "LatheGeometry"), "write revolve([[radius, y], …])"),
    **dict.fromkeys(("sphere_sweep", "sweep", "tube", "pipe", "TubeGeometry"), "write curve(points, radius)"),
    **dict.fromkeys(("height_field", "terrain"), 'write heightfield("…") for a picture, or heightfield(|x, z| …)'),
    **dict.fromkeys(("TextGeometry", "label"), 'write text("…")'),
    "polyhedron": "write mesh(points: […], faces: […])",
    "cuboid": "write box()",
    "ball": "write sphere()",
    "background": "write render(background: …)",
    "settings": "write render(…)",
    "material": "materials are lambert, phong, blinn_phong, principled, metal, mirror, glass, translucent, subsurface, emissive and blend",
    **dict.fromkeys(("matte", "matt", "diffuse", "lambertian", "oren_nayar"), "write lambert(color)"),
    **dict.fromkeys(("glossy", "shiny", "specular"), "write plastic(color, roughness: 0.2)"),
    **dict.fromkeys(("metallic", "aluminum"), "write metal(color, roughness: 0.1)"),
    **dict.fromkeys(("dielectric", "transparent"), "write glass(ior: 1.5)"),
    **dict.fromkeys(("reflective", "reflection"), "write mirror()"),
    **dict.fromkeys(("pbr", "disney", "standard", "bsdf", "principled_bsdf"), "write principled(…)"),
    **dict.fromkeys(("emit", "emitter", "glow", "luminous"), "write emissive(color, luminance: 1000nit)"),
    **dict.fromkeys(("mist", "atmosphere", "Fog", "global_fog"), "write fog(visibility: 200m)"),
    **dict.fromkeys(("interior", "participating_medium", "Volume"), "write medium: medium(color, depth) as an argument of a closed shape"),
    **dict.fromkeys(("sss", "subsurface_scattering", "subsurface_bsdf", "bssrdf"), "write subsurface(color, radius: 1cm)"),
    "texture": 'write image("…")',
    "import": 'write mesh("…") for a mesh, use "…" for a scene',
    "include": 'write use "…"',
    "var": "write let name = …",
    "def": "write let name(…) = …",
    "function": "write let name(…) = …",
    "null": "leave the argument out",
    "none": "leave the argument out",
    "degrees": "write 30deg",
    "radians": "write 0.5rad",
    "PI": "write pi",
    "tau": "write 2 * pi",
    "e": "write exp(x) for a power of e",
    **dict.fromkeys(("Math", "math", "np"), "functions have no prefix: write sin(x)"),
    "lambda": "a function is written |x| x + 1",
    **{axis: f"a formula begins with its parameters: write |x, y, z| before it; an axis is {AXES[axis]}" for axis in "xyz"},
    "mix": "write lerp(a, b, t)",
    "fract": "write mod(x, 1)",
    "saturate": "write clamp(x, 0, 1)",
    "norm": "write length(v)",
    "distance": "write length(a - b)",
    "ln": "write log(x)",
    "log10": "write log(x) / log(10)",
    "hsl": "write hsv(hue, saturation, value)",
    "simplex": "write noise(x, y, z)",
    **dict.fromkeys(("random", "rand", "rands"), "noise(x, y, z, seed) is the same each time, and 0 where x, y and z are whole"),
    "checkerboard": "write checker(a, b)",
    "fresnel": "principled, glass and metal have it",
    **dict.fromkeys(
        "red green blue yellow orange purple pink brown white black grey gray cyan magenta".split(), "colours are written #rrggbb"
    ),
}


_COLOR_NAMES = {
    "red": "#ff0000", "green": "#008000", "blue": "#0000ff", "yellow": "#ffff00", "orange": "#ffa500", "purple": "#800080",
    "pink": "#ffc0cb", "brown": "#a52a2a", "white": "#ffffff", "black": "#000000", "gray": "#808080", "grey": "#808080",
    "cyan": "#00ffff", "magenta": "#ff00ff",
}  # fmt: skip


def color(text: str) -> str:
    """The hint for a string in place of a colour."""
    if text.startswith("#"):
        return f"write {text if re.fullmatch('#([0-9a-fA-F]{3}){1,2}', text) else '#rrggbb'} without quotes"
    if text.rpartition(".")[2].lower() in FILES:
        return f'write image("{text}")'
    return f"write {_COLOR_NAMES.get(text.lower(), '#rrggbb')}"


# File name extensions of images, meshes and scenes.
FILES = frozenset("png jpg jpeg tif tiff exr hdr obj ply stl off 3mf xyz glb gltf usd usda usdc usdz scene".split())

_SUPERSCRIPTS = {"²": 2, "³": 3}
NO_POINT = "a formula's parameters are numbers: write |x, y, z| …, and [x, y, z] for a point"
BY_CORNERS = "a box from corner a to corner b has size b - a and center (a + b) / 2"  # for a negative size in a list
_BY_POSITION = {  # for surplus arguments, by function
    **{name: f"write {name}([x, y, z])" for name in ("translate", "scale")},
    "atan": "the angle of a direction is atan2(y, x)",
    "render": "write render(size: [640, 480])",
}

# Parts of the library, by file.
LIBRARY = {
    "patterns": "wood marble bricks dots granite turbulence hexagons boards herringbone weave clouds",
    "materials": "clay plaster paper slate asphalt grey_card porcelain lacquer enamel tiles planks striped_cloth squared_cloth water ice "
    "crown_glass flint_glass acrylic sapphire diamond bottle_glass amber_glass silver_mirror bronze_mirror grey_mirror brick concrete sand "
    "snow charcoal skin leather cherry maple pine walnut nylon car_paint chocolate obsidian terrazzo tungsten ruby emerald amber honey",
    "media": "milk skim_milk cream tea espresso beer wine ketchup wax soap haze smoke cloud flame",
    "lights": "softbox three_point studio daylight overcast moonlight rim_only ring_light golden_hour blue_hour candle",
    "cameras": "isometric product standing turntable full_frame portrait telephoto macro",
    "room": "panel bulb window downlight standing_lamp table_lamp pendant ceiling_lamp table picture chair books curtains wall",
    "furniture": "sofa armchair cushion stool bed nightstand drawers wardrobe bookshelf rug plant fridge tap",
    "shapes": "crate slab stairs column arch roof vessel rounded_box soft_box pillow tetrahedron octahedron dodecahedron "
    "icosahedron knot chain mountains",
    "mechanics": "gear thread hex_bolt hex_nut washer spring bearing pulley",
    "surfaces": "parametric revolved voxels",
    "profiles": "circle arc ellipse rectangle slot regular star",
}
_LIBRARY_FILE = {word: file for file, words in LIBRARY.items() for word in words.split()}

# Library equivalents of elements that are not built yet.
_PLANNED = {
    "surface": "surfaces.parametric(|u, v| [x, y, z])",
    "bezier": "surfaces.bezier([[…], …])",
    "nurbs": "surfaces.nurbs([[…], …])",
    "voxels": "surfaces.voxels(|x, y, z| …)",
}


# Replacements of units that are not in the language; {} is the number before the unit.
_WATT = "light is in photometric units: a light bulb has 800lm (15 lm for each watt, 100 for a watt of LED)"
_UNITS: dict[str, str] = {
    "K": "write kelvin({})",
    **dict.fromkeys(("W", "w", "watt", "kW", "mW"), _WATT),
    **dict.fromkeys(("lux", "Lux"), "write {}lx"),
    **dict.fromkeys(("lumen", "lumens"), "write {}lm"),
    **dict.fromkeys(("candela", "candelas"), "write {}cd"),
    "nits": "write {}nit",
    **dict.fromkeys(("degree", "degrees", "d"), "write {}deg"),
    **dict.fromkeys(("radian", "radians"), "write {}rad"),
    **dict.fromkeys(("meter", "meters", "metre", "metres", "M"), "write {}m"),
    **dict.fromkeys(("inch", "inches"), "write {}in"),
    **dict.fromkeys(("foot", "feet"), "write {}ft"),
    **dict.fromkeys(("sec", "second", "seconds"), "write {}s"),
    **dict.fromkeys(("px", "pixel", "pixels"), "sizes of pictures are plain numbers: write {}"),
    "f": "numbers have no types: write {}",
}


def unit(word: str, number: str, names: Iterable[str]) -> str:
    """The hint for a unit that is not among `names`, after `number` as written."""
    return _UNITS[word].format(number) if word in _UNITS else suggest(word, names) or units.listed()


def planned_hint(word: str) -> str:
    """The hint for an element that is not built yet."""
    return f'the library has it: use "std/surfaces", then {_PLANNED[word]}' if word in _PLANNED else ""


def argument(callee: str, word: str, names: Mapping[str, str]) -> tuple[str, str]:
    """The message and the hint for an argument that is not among `names`, a map of names and aliases to arguments."""
    message = f"{callee} has no `{word}`"
    near = next((n for n in _ARGUMENTS.get(word, ()) if n in names), "")
    near = f"did you mean `{near}`?" if near else suggest(word, names)
    if near:
        return f"{message}; {near}", _NEAR_HINTS.get(near, {}).get(word, "")
    canonical = [n for n in names if n == names[n]]
    listed = ", ".join(canonical[:12]) + (", …" if len(canonical) > 12 else "")
    return message, _ARGUMENT_HINTS.get(word) or f"it takes {listed or 'no arguments'}"


def surplus_hint(callee: str, keywords: Iterable[str]) -> str:
    """The hint for a surplus positional argument of a callable with the keyword arguments `keywords`."""
    named = ", ".join(keywords)
    return _BY_POSITION.get(callee) or (f"by name it takes {named}" if named else "")


def choice(argument: str, word: str) -> str:
    """The hint for a word that is not a choice of an argument."""
    return f"write {word}() in its place" if argument == "kind" and word in ("brass", "platinum") else ""


def name(word: str, names: Iterable[str]) -> tuple[str, str]:
    """The message and the hint for a name that is not among `names`."""
    hint = _NAMES.get(word, "")
    if not hint and word in _LIBRARY_FILE:
        hint = f'write use "std/{_LIBRARY_FILE[word]}" first, then {_LIBRARY_FILE[word]}.{word}(…)'
    if not hint and word in LIBRARY:
        hint = f'write use "std/{word}" first'
    if word[-1] in _SUPERSCRIPTS and word[:-1]:
        hint = f"write {word[:-1]}^{_SUPERSCRIPTS[word[-1]]}"
    names = list(names)
    near = "" if hint else suggest(word, names) or (suggest(word.lower(), names) if word != word.lower() else "")
    word = word if len(word) <= MAX_WORD else f"{word[:MAX_WORD]}…"
    if near:
        return f"there is no `{word}` here; {near}", ""
    return f"there is no `{word}` here", hint or "let, param or use define a name"
