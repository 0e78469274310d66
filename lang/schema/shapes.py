"""The schema's shapes, solids and blocks."""

from __future__ import annotations

import math
from typing import Any

from .. import file_types
from .argument_types import REQUIRED, Arg, Entry
from .media import INSIDE

_PLACED = (
    Arg("name", "string", None, "its name in messages and the id channel", keyword=True),
    Arg("translate", "point", None, "translation, after scale and rotation", keyword=True),
    Arg("rotate", "rotation", None, "rotation about the origin of its frame", keyword=True),
    Arg("scale", "scale3", None, "scale about the origin of its frame", keyword=True),
)
_MATERIAL = Arg("material", "material", None, "its material; inherited from the enclosing block", keyword=True)
_SHAPE = (_MATERIAL, *_PLACED, INSIDE)
CENTER = Arg("center", "point", (0.0, 0.0, 0.0), "its center")
RADIUS = Arg("radius", "length", 1.0, "radius", above=0.0)
CAPPED = Arg("capped", "bool", True, "whether disks close its ends", keyword=True)
_KIND = Arg(
    "kind",
    "choice",
    "linear",
    "curve of its points: straight lines, cubic Bézier pieces, or a spline through them (catmull_rom) or near them (bspline)",
    choices=("linear", "bezier", "catmull_rom", "bspline"),
    keyword=True,
)
_HEIGHT = Arg(
    "height",
    "length",
    None,
    "scales it uniformly to this height, as `rotate` turns it, and centers its base at the origin",
    above=0.0,
    keyword=True,
)
_MATERIALS = Arg(
    "materials",
    "materials",
    None,
    "materials in place of those that the file names; `material` is in place of all others",
    keyword=True,
)
_CREASE = Arg(
    "crease", "angle", math.radians(30), "angle between faces from which an edge is sharp", minimum=0.0, maximum=math.pi, keyword=True
)


def shape_entry(name: str, doc: str, *args: Arg, **more: Any) -> Entry:
    return Entry(name, "shape", doc, (*args, *_SHAPE), **more)


def _planned(category: str, *names: str) -> tuple[Entry, ...]:
    return tuple(Entry(n, category, "not built yet", planned=True, children=category == "solid") for n in names)


SHAPES = (
    shape_entry(
        "triangle",
        "one triangle, counter-clockwise from its front",
        Arg("points", "points", REQUIRED, "its three corners"),
        Arg("normals", "vectors3", None, "a normal for each corner", keyword=True),
        Arg("uv", "vectors2", None, "texture coordinates for each corner", keyword=True),
        example="triangle([[0, 0, 0], [1, 0, 0], [0, 1, 0]])",
    ),
    shape_entry(
        "polygon",
        "one flat polygon, convex or not, counter-clockwise from its front",
        Arg("points", "points", REQUIRED, "its corners in order"),
        Arg("holes", "point_lists", None, "the corners of each hole", keyword=True),
        Arg("uv", "vectors2", None, "texture coordinates for each corner of the outline, then of each hole", keyword=True),
    ),
    shape_entry(
        "mesh",
        f"polygons from a file ({', '.join(file_types.MESH)}), or from points and faces",
        Arg("file", "string", None, "file of the mesh, relative to the scene"),
        Arg("points", "points", None, "the vertices", keyword=True),
        Arg("faces", "faces", None, "vertex indices of each face, counter-clockwise seen from outside", keyword=True),
        Arg("normals", "vectors3", None, "a normal for each vertex", keyword=True),
        Arg("uv", "vectors2", None, "texture coordinates for each vertex", keyword=True),
        Arg("colors", "vectors3", None, "a linear colour for each vertex", keyword=True),
        _HEIGHT,
        _MATERIALS,
        Arg(
            "unit", "choice", None, f"what 1 is in the file; by default as the file says, {file_types.assumed('unit')}",
            choices=tuple(file_types.UNITS), keyword=True,
        ),
        Arg(
            "up", "choice", None, f"the axis of the file that points up; by default as the file says, {file_types.assumed('up')}",
            choices=file_types.AXES, keyword=True,
        ),
        Arg("repair", "bool", False, "merge vertices of the file, wind its faces one way and outwards, fill its holes", keyword=True),
        Arg("single_sided", "bool", False, "whether a camera does not see its faces from behind, as those of glTF files", keyword=True),
        exclusive=(("file", "points"),),
        example='mesh("bunny.obj", height: 35cm)',
    ),
    Entry(
        "usd",
        "shape",
        "the contents of a USD file without its cameras and settings",
        (
            Arg("file", "string", REQUIRED, "file of the stage, relative to the scene"),
            Arg("prim", "string", None, "only the subtree of this prim", keyword=True),
            _HEIGHT,
            _MATERIALS,
            Arg("unit", "choice", None, "what 1 is in the stage, in place of what it says", choices=tuple(file_types.UNITS), keyword=True),
            Arg("up", "choice", None, "the axis of the stage that points up, in place of what it says", choices=("y", "z"), keyword=True),
            _MATERIAL,
            *_PLACED,
        ),
        example='usd("lamp.usdz", height: 40cm, materials: [["Shade", lambert(#e0d0b0)], ["Metal*", gold()]])',
    ),
    shape_entry(
        "implicit",
        "the points where a relation between x, y and z holds: a solid for an inequality, a surface for ==",
        Arg("formula", "formula", REQUIRED, "the relation; x, y and z are plain numbers in the file's unit, in its own frame"),
        Arg(
            "within",
            "within",
            None,
            "clips it: a length (half the extent along each axis), three of them, two corners, a sphere or a box; default: its bounds",
        ),
        example="implicit(|x, y, z| x^4 + y^4 + z^4 <= 1)",
    ),
    shape_entry(
        "revolve",
        "a profile turned about the y axis",
        Arg("profile", "points2", REQUIRED, "points [radius, y] in order around the area"),
        Arg("angle", "angle", 2 * math.pi, "angle of the turn, from +x towards -z", above=0.0, maximum=2 * math.pi),
        _KIND,
        Arg("closed", "bool", True, "whether the last point joins the first, which makes a solid; else a surface", keyword=True),
        _CREASE,
        example="revolve([[0, 0], [0.5, 0], [0.3, 1], [0, 1]])",
    ),
    shape_entry(
        "extrude",
        "a prism: a profile drawn along the y axis",
        Arg("profile", "points2", REQUIRED, "points [x, z] in order around the area"),
        Arg("height", "length", 1.0, "its height, from y = 0", above=0.0),
        Arg("holes", "point2_lists", None, "the points of each hole", keyword=True),
        Arg("twist", "angle", 0.0, "turn of the top about the y axis, counter-clockwise from above", keyword=True),
        Arg("taper", "numbers2", (1.0, 1.0), "size of the top over that of the base, in x and z; 0: a point", minimum=0.0, keyword=True),
        Arg("centered", "bool", False, "whether its middle is at y = 0, not its base", keyword=True),
        _KIND,
        _CREASE,
        example="extrude([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]], 0.5)",
    ),
    shape_entry(
        "curve",
        "a round tube along a curve of points",
        Arg("points", "points", REQUIRED, "the points of the curve"),
        Arg("radius", "lengths", REQUIRED, "radius of the tube, or one for each point; 0 at an end makes a tip", minimum=0.0),
        _KIND,
        Arg("closed", "bool", False, "whether the curve returns to its first point", keyword=True),
        Arg("caps", "choice", "flat", "its ends", choices=("flat", "round", "open"), keyword=True),
        _CREASE,
        example='curve([[0, 0, 0], [1, 1, 0], [2, 0, 0], [3, 1, 1]], 0.1, kind: "catmull_rom")',
    ),
    shape_entry(
        "text",
        "letters in the plane z = 0, read from +z, and extruded to z = `depth`",
        Arg("string", "string", REQUIRED, r"the text; \n begins a line"),
        Arg("size", "length", 1.0, "height of a capital letter", above=0.0),
        Arg("depth", "length", None, "depth of the letters; 0: flat; default: a fifth of `size`", minimum=0.0),
        Arg("font", "string", "DejaVu Sans", "a font of the package, or a file (.ttf, .otf, .ttc) relative to the scene", keyword=True),
        Arg("align", "choice", "left", "the point of each line at x = 0", choices=("left", "center", "right"), keyword=True),
        Arg(
            "vertical",
            "choice",
            "baseline",
            "the height at y = 0: the baseline of the first line, that of the last (bottom), or the top or center of the capitals",
            choices=("baseline", "bottom", "center", "top"),
            keyword=True,
        ),
        Arg("spacing", "number", 1.0, "distance of letters, times that of the font", above=0.0, maximum=1000.0, keyword=True),
        Arg("line_spacing", "number", 1.0, "distance of lines, times that of the font", above=0.0, maximum=1000.0, keyword=True),
        _CREASE,
        example='text("maquette", size: 20cm, depth: 4cm, align: "center")',
    ),
    shape_entry(
        "heightfield",
        "heights over a rectangle of the plane y = 0 about the origin",
        Arg(
            "heights",
            "heights",
            REQUIRED,
            "a picture's file (black is 0, white is `height`), a formula |x, z| … in the file's unit, or rows of heights towards +x,"
            " the first at -z",
        ),
        Arg("size", "size2", (1.0, 1.0), "its extent along x and z", above=0.0),
        Arg("height", "length", 1.0, "height of white, for a picture", above=0.0),
        Arg("steps", "int", 256, "cells along the longer side, for a formula", minimum=1, maximum=2048, keyword=True),
        Arg("base", "length", None, "depth of a base below y = 0, which makes a solid; default: a surface", above=0.0, keyword=True),
        example="heightfield(|x, z| 0.1 * noise(4 * x, 0, 4 * z), size: [2, 1])",
    ),
    *_planned("shape", "surface", "bezier", "nurbs", "subdivision", "voxels"),
)

_ROUND = Arg("round", "length", 0.0, "radius of the fillets where surfaces of different children meet", minimum=0.0, keyword=True)
_SEAMS = Arg(
    "seams", "choice", "sharp", "materials of parts meet at a line, or mix over the fillet", choices=("sharp", "blended"), keyword=True
)


def _solid(name: str, doc: str, *args: Arg, example: str = "") -> Entry:
    return Entry(name, "solid", doc, (*args, *_SHAPE), children=True, example=example)


SOLIDS = (
    _solid("union", "the union of its children", _ROUND, _SEAMS, example="union(round: 10cm) { sphere(1); box(1.5) }"),
    _solid("intersection", "the intersection of its children", _ROUND, _SEAMS, example="intersection { sphere(1); box(1.5) }"),
    _solid(
        "difference",
        "its first child without the others",
        _ROUND,
        _SEAMS,
        example="difference(round: 5cm) { box(2); cylinder(0.5, 3) }",
    ),
    _solid(
        "shell", "its children as a hollow shell", Arg("thickness", "length", REQUIRED, "thickness inwards from the surface", above=0.0)
    ),
    _solid(
        "offset",
        "its children grown, or shrunk for a negative distance",
        Arg("by", "length", REQUIRED, "distance that the surface moves outwards"),
    ),
    _solid(
        "twist",
        "its children twisted about the y axis",
        Arg("angle", "angle", REQUIRED, "angle of twist over the height `over`"),
        Arg("over", "length", 1.0, "height of one twist by `angle`", above=0.0),
        example="twist(90deg, over: 2) { box([1, 2, 1]) }",
    ),
    _solid(
        "bend",
        "its children bent from the x axis towards +y",
        Arg("angle", "angle", REQUIRED, "angle of bend over the length `over`"),
        Arg("over", "length", 1.0, "length along x of one bend by `angle`", above=0.0),
    ),
    _solid(
        "repeat",
        "copies of its children at a constant step",
        Arg("step", "point", REQUIRED, "offset from one copy to the next"),
        Arg("count", "int", REQUIRED, "number of copies", minimum=1),
    ),
    _solid(
        "mirrored",
        "its children and their mirror image in a plane through the origin",
        Arg("normal", "direction", REQUIRED, "normal of the plane"),
    ),
    _solid(
        "morph",
        "interpolation between its two children",
        Arg("share", "number", 0.5, "0: the first, 1: the second", minimum=0.0, maximum=1.0),
    ),
)

GROUP = Entry("group", "block", "a group of its children", _SHAPE, children=True, example="group(translate: [1, 0, 0]) { sphere(1) }")
"""The element that a call of a part makes of the elements in it."""
BLOCKS = (
    GROUP,
    Entry(
        "transform",
        "block",
        "its children scaled, then rotated, then translated; or transformed by a matrix",
        (Arg("matrix", "matrix", None, "applied instead of translate, rotate and scale"), *_SHAPE),
        children=True,
        exclusive=(("matrix", "translate"), ("matrix", "rotate"), ("matrix", "scale")),
    ),
    Entry("translate", "block", "its children translated", (Arg("by", "point", REQUIRED, "the translation"),), children=True),
    Entry("rotate", "block", "its children rotated", (Arg("by", "rotation", REQUIRED, "the rotation"),), children=True),
    Entry("scale", "block", "its children scaled", (Arg("by", "scale3", REQUIRED, "the factors"),), children=True),
)
