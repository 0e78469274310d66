"""The schema's shapes, solids and blocks."""

from __future__ import annotations

from typing import Any

from .argument_types import REQUIRED, Arg, Entry

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
            above=0.0,
            keyword=True,
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
