"""The library: every part evaluates with its defaults and fits its description."""

import itertools
import math
import re
from pathlib import Path

import maquette
import numpy as np
import pytest
from maquette.compiler.catalogue import CATALOGUE
from maquette.lang import formula_graph
from maquette.lang.diagnostics import Diagnostics, render_text
from maquette.lang.eval import suggestions
from maquette.lang.eval.evaluator import ReadError, Source, evaluate
from maquette.lang.stdlib_page import entries
from maquette.lang.syntax import ast, parser

LIBRARY = Path(maquette.__file__).parent / "stdlib"
MATERIALS = ("lambert", "phong", "blinn_phong", "mirror", "glass", "principled", "metal", "blend", "translucent", "subsurface", "openpbr")
FILES = sorted(LIBRARY.glob("*.scene"))


@pytest.mark.parametrize("file", suggestions.LIBRARY)
def test_parts_that_hints_name_exist_in_the_library(file):
    text = (LIBRARY / f"{file}.scene").read_text(encoding="utf-8")
    assert set(suggestions.LIBRARY[file].split()) <= set(re.findall(r"^let (\w+)\(", text, re.MULTILINE))


class Reader:
    """A Reader of library files only."""

    def scene(self, path, importer, span):
        file = LIBRARY / f"{path.removeprefix('std/')}.scene"
        if not file.is_file():
            raise ReadError(f"no file {path}")
        return Source(path, file.read_text(encoding="utf-8"), path)


def evaluated(text, time=0.0):
    """The document of a scene without errors."""
    diagnostics = Diagnostics()
    document = evaluate(Source("t.scene", text, "t.scene"), CATALOGUE, Reader(), diagnostics, time=time)
    assert [render_text(d, document.sources.get) for d in diagnostics.items] == []
    return document


GIVEN = {  # arguments of the library's functions that have no default
    "roughness": "0.5", "f0": "rgb(0.9, 0.8, 0.7)", "x": "0.3", "y": "0.3", "z": "0.3", "k": "1", "seed": "2",
    "at": "|u, v| [u, v, 0]", "first": "0", "across": "3", "t": "0.5", "degree": "1", "s": "1", "knots": "[0, 0, 1, 1]", "count": "4",
    "points": "[[0, 0, 0], [1, 0, 0]]", "rows": "[[[0, 0, 0], [1, 0, 0]], [[0, 1, 0], [1, 1, 0]]]", "profile": "[[1, 0], [1, 1]]",
    "u": "0.2", "v": "0.3", "row": "2", "size": "8mm", "column": "1", "angle": "0.3rad", "r": "2", "base": "1.8", "module": "0.2",
    "pressure": "0.35rad", "teeth": "12", "tooth": "3", "radius": "4", "pitch": "1", "length": "5", "height": "2", "n": "2.5",
    "weighted": "[[[i, j, 0, 1] for i in 0..3] for j in 0..3]", "is_full": "|x, y, z| x > 0",
    "scattering": "[1, 2, 3]", "absorption": "[1, 2, 3]", "temperature": "1900",
}  # fmt: skip


def parts(file):
    """Each function and part of a library file, with its example, or with a call that has only the required arguments.

    (call, whether it is a helper).
    """
    items = parser.parse(file.read_text(encoding="utf-8"), file.name, Diagnostics()).items
    prefix = "" if file.stem == "prelude" else f"{file.stem}."
    shown = {entry.name: entry.example for entry in entries(file.stem, file.read_text(encoding="utf-8"))}
    for item in items:
        if isinstance(item, ast.Let) and item.parameters is not None:
            missing = [p.name.id for p in item.parameters if p.default is None and item.name.id not in shown]
            needed = ", ".join(f"{name}: {GIVEN[name]}" for name in missing)
            yield shown.get(item.name.id) or f"{prefix}{item.name.id}({needed})", item.name.id not in shown


CALLS = [(file.stem, call, helper) for file in FILES for call, helper in parts(file)]


def scene(name, call, helper):
    """A scene that uses a part of the library."""
    use = "" if name == "prelude" else f'use "std/{name}"\n'
    if helper or name == "profiles":
        return f"{use}let it = {call}"
    if name == "patterns":
        return f"{use}sphere(1, material: lambert({call}))"
    if name == "media":
        return f"{use}sphere(1, medium: {call})"
    return use + (f"sphere(1, material: {call})" if name in ("prelude", "materials") else call)


@pytest.mark.parametrize(("name", "call", "helper"), CALLS, ids=[call for _, call, _ in CALLS])
def test_every_part_evaluates_with_its_defaults(name, call, helper):
    document = evaluated(scene(name, call, helper))
    if name in ("prelude", "materials") and not helper:
        (sphere,) = document.elements
        assert sphere.args["material"].kind in MATERIALS
    elif name == "cameras":
        (camera,) = document.cameras
        assert camera.args["name"] == call.partition(".")[2].partition("(")[0]
    elif not helper and name != "profiles":
        assert len(document.elements) == 1


@pytest.mark.long
def test_every_part_has_a_line_of_documentation():
    for file in FILES:
        items = parser.parse(file.read_text(encoding="utf-8"), file.name, Diagnostics()).items
        missing = [i.name.id for i in items if isinstance(i, ast.Let) and i.parameters is not None and not i.before]
        assert missing == [], file.name


@pytest.mark.parametrize("name", ["hello", "room"])
def test_scenes_of_the_language_description_evaluate(name):
    text = (Path(__file__).parent / "scenes" / f"{name}.scene").read_text(encoding="utf-8")
    assert evaluated(text).elements


# --- materials ------------------------------------------------------------------------------------------------------


def material(call):
    return evaluated(f"sphere(1, material: {call})").elements[0].args["material"].args


@pytest.mark.parametrize(("roughness", "shininess"), [(1, 0), (0.5, 30), (0.1, 19998), (0, 19998)])
def test_shininess_follows_roughness(roughness, shininess):
    assert material(f"plastic(#fff, roughness: {roughness})")["shininess"] == pytest.approx(shininess)


@pytest.mark.parametrize("roughness", [0, 0.3, 1])
def test_metals_give_back_their_reflectance_and_no_more(roughness):
    gold = material(f"gold(roughness: {roughness})")
    for channel, f0 in enumerate((1.000, 0.782, 0.344)):
        assert gold["color"][channel] + gold["reflection"][channel] == pytest.approx(f0)
        assert gold["specular"][channel] == gold["reflection"][channel]
    assert gold["normalized"] is True


def test_names_of_the_scene_hide_those_of_the_prelude():
    assert evaluated("let gold() = lambert(#fff)\nsphere(1, material: gold())").elements[0].args["material"].kind == "lambert"


# --- shapes ---------------------------------------------------------------------------------------------------------


def subtract(a, b):
    return [x - y for x, y in zip(a, b, strict=True)]


def dot(a, b):
    return sum(x * y for x, y in zip(a, b, strict=True))


def normal(points):
    (ax, ay, az), (bx, by, bz) = subtract(points[1], points[0]), subtract(points[2], points[0])
    return (ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)


def test_walls_face_into_the_room():
    (box,) = evaluated('use "std/room"\nroom.box(size: [3, 2.5, 5], left: lambert(#f00))').elements
    assert [wall.args["name"] for wall in box.children] == ["floor", "ceiling", "back", "left", "right"]
    for wall in box.children:
        points = wall.args["points"]
        assert dot(normal(points), subtract((0, 1.25, 0), points[0])) > 0
    corners = {p for wall in box.children for p in wall.args["points"]}
    assert corners == set(itertools.product((-1.5, 1.5), (0.0, 2.5), (-2.5, 2.5)))
    red = box.children[3].args["material"]
    assert red.args["color"] == (1.0, 0.0, 0.0)


def test_unnamed_walls_have_the_material_wall():
    (box,) = evaluated('use "std/room"\nroom.box(wall: lambert(#000), floor: lambert(#fff))').elements
    assert [wall.args["material"].args["color"] for wall in box.children] == [(1.0,) * 3] + [(0.0,) * 3] * 4


@pytest.mark.parametrize(("name", "vertices", "faces", "edge"), [
    ("tetrahedron", 4, 4, math.sqrt(8 / 3)),
    ("octahedron", 6, 8, math.sqrt(2)),
    ("icosahedron", 12, 20, 1 / math.sin(math.radians(72))),
])  # fmt: skip
def test_regular_solids(name, vertices, faces, edge):
    (mesh,) = evaluated(f'use "std/shapes"\nshapes.{name}(radius: 2)').elements
    points, corners = mesh.args["points"], mesh.args["faces"]
    assert (len(points), len(corners)) == (vertices, faces)
    assert all(math.hypot(*p) == pytest.approx(2) for p in points)
    edges = {frozenset(pair) for f in corners for pair in zip(f, (*f[1:], f[0]), strict=True)}
    assert vertices - len(edges) + faces == 2
    assert all(math.dist(*[points[int(i)] for i in e]) == pytest.approx(2 * edge) for e in edges)
    for f in corners:
        triangle = [points[int(i)] for i in f]
        assert dot(normal(triangle), triangle[0]) > 0


def extent(element):
    """Lowest and highest y of boxes and cylinders without rotation."""
    spans = []
    for e in element.children or (element,):
        height = e.args["size"][1] if e.kind == "box" else e.args["height"]
        spans.append((e.args["center"][1] - height / 2, e.args["center"][1] + height / 2))
    return pytest.approx((min(low for low, _ in spans), max(high for _, high in spans)))


@pytest.mark.parametrize(
    ("call", "height"), [("column(height: 3)", 3), ("table(size: [1, 0.7, 2])", 0.7), ("stairs(count: 5)", 0.85), ("crate([1, 2, 3])", 2)]
)
def test_shapes_stand_on_the_ground(call, height):
    (element,) = evaluated(f'use "std/shapes"\nshapes.{call}').elements
    assert (0, height) == extent(element)


# --- lights and cameras ---------------------------------------------------------------------------------------------


def test_three_point_lights_show_white_as_their_strength():
    (rig,) = evaluated('use "std/lights"\nlights.three_point(target: [1, 2, 3], distance: 2, key: 0.8, fill: 0.5, rim: 0.3)').elements
    for light, strength in zip(rig.children, (0.8, 0.5, 0.3), strict=True):
        assert math.dist(light.args["position"], (1, 2, 3)) == pytest.approx(2)
        assert light.args["intensity"] / 2**2 / math.pi == pytest.approx(strength)


def test_a_softbox_shows_white_as_its_strength():
    (light,) = evaluated('use "std/lights"\nlights.softbox(target: [0, 0, 0], distance: 10, size: 50cm, strength: 0.7)').elements
    illuminance = light.args["luminance"] * 0.5**2 / 10**2
    assert illuminance / math.pi == pytest.approx(0.7)


def test_the_sun_dims_towards_the_horizon():
    suns = [evaluated(f'use "std/lights"\nlights.daylight(elevation: {e}deg)').elements[0].children[0].args for e in (90, 30, 5)]
    assert suns[0]["illuminance"] == pytest.approx(100_000)
    assert [s["illuminance"] for s in suns] == sorted((s["illuminance"] for s in suns), reverse=True)
    red_over_blue = [s["color"][0] / s["color"][2] for s in suns]
    assert red_over_blue == sorted(red_over_blue)
    assert suns[1]["from"][1] == pytest.approx(0.5)


def test_a_product_fills_three_quarters():
    (camera,) = evaluated('use "std/cameras"\ncameras.product(target: [0, 1, 0], size: 2, fov: 40deg)').cameras
    distance = math.dist(camera.args["position"], (0, 1, 0))
    assert 2 / (2 * distance * math.tan(math.radians(20))) == pytest.approx(0.75)


def test_bare_numbers_are_in_the_unit_of_the_scene():
    (camera,) = evaluated('unit mm\nuse "std/cameras"\ncameras.front(width: 400, distance: 1000)').cameras
    assert camera.args["width"] == pytest.approx(0.4)
    assert camera.args["position"] == pytest.approx((0, 0, 1))


def test_a_turntable_makes_one_turn():
    places = [evaluated('use "std/cameras"\ncameras.turntable(period: 8s)', time=t).cameras[0].args["position"] for t in (0, 2, 8)]
    assert places[0] == pytest.approx(places[2])
    assert places[1] == pytest.approx((4, 2, 0))


@pytest.mark.parametrize(
    "call",
    ["marble()", "wood(ring: 2cm)", "bricks(size: [20cm, 6cm])", "dots(size: 5cm, radius: 1cm)", "granite(grain: 5mm, seed: 4)",
     "cubes(size: 3cm)", "clouds(size: 9mm)", "tiles(size: 3cm, gap: 8mm)", "hexagons(size: 4cm)", "boards(size: [9cm, 1cm])",
     "herringbone(width: 1cm)", "weave(size: 3mm)"],
)
def test_patterns_give_colours_of_their_own(call):
    """At random points each value is between the two colours, and both occur."""
    (element,) = evaluated(f'use "std/patterns"\nunit cm\nsphere(1, material: lambert(patterns.{call}))').elements
    made = element.args["material"].args["color"].args["formula"]
    random = np.random.default_rng(7)
    found = np.array([formula_graph.evaluate(made, place) for place in random.uniform(-1, 1, (400, 3))])
    assert found.shape == (400, 3)
    assert (found >= 0).all()
    assert (found <= 1).all()
    assert np.ptp(found.sum(axis=1)) > 0.3


# --- surfaces -------------------------------------------------------------------------------------------------------


def mesh(call):
    """The points of the mesh of a call, in rows of equal v."""
    waiting = list(evaluated(f'use "std/surfaces"\n{call}').elements)
    while waiting[0].kind != "mesh":
        waiting = [*waiting[0].children, *waiting[1:]]
    assert len(waiting) == 1
    return waiting[0].args["points"]


def test_quadrilaterals_of_a_surface_are_counter_clockwise_from_u_to_v():
    points = mesh("surfaces.parametric(|u, v| [u, v, 0], steps: 2)")
    (made,) = evaluated('use "std/surfaces"\nsurfaces.parametric(|u, v| [u, v, 0], steps: 2)').elements
    assert list(points) == [(u / 2, v / 2, 0.0) for v in range(3) for u in range(3)]
    assert list(made.args["faces"]) == [(0, 1, 4, 3), (1, 2, 5, 4), (3, 4, 7, 6), (4, 5, 8, 7)]
    assert list(made.args["uv"]) == [(u / 2, v / 2) for v in range(3) for u in range(3)]


def test_a_bezier_patch_is_the_sum_of_bernstein_polynomials():
    heights = [[0, 2, -1, 1], [3, 0, 1, 2], [1, 1, 4, -2]]  # of degree 3 along u and 2 along v
    rows = [[[i / 3, j / 2, h] for i, h in enumerate(row)] for j, row in enumerate(heights)]
    for k, (x, y, z) in enumerate(mesh(f"surfaces.bezier({rows}, steps: 4)")):
        u, v = k % 5 / 4, k // 5 / 4
        wanted = sum(
            math.comb(3, i) * u**i * (1 - u) ** (3 - i) * math.comb(2, j) * v**j * (1 - v) ** (2 - j) * heights[j][i]
            for j in range(3)
            for i in range(4)
        )
        assert (x, y, z) == pytest.approx((u, v, wanted), abs=1e-12)


def test_an_even_cubic_spline_at_its_knots_is_a_sixth_of_one_four_and_one():
    """Four spans of a uniform cubic B-spline, whose knots run on beyond its ends."""
    heights = [0, 5, -2, 7, 1, 3, 4]
    rows = [[[i, j, h, 1] for i, h in enumerate(heights)] for j in range(2)]
    points = mesh(f"surfaces.nurbs({rows}, degree: [3, 1], u_knots: {list(range(11))}, steps: 4)")
    for k in range(5):
        wanted = (heights[k] + 4 * heights[k + 1] + heights[k + 2]) / 6
        assert points[k] == pytest.approx((k + 1, 0, wanted), abs=1e-12)


@pytest.mark.long
def test_a_surface_of_revolution_is_exactly_round():
    points = mesh("surfaces.revolved([[2, 0], [2, 1], [2, 5]], steps: 12)")
    assert [math.hypot(x, z) for x, _, z in points] == pytest.approx([2] * len(points), abs=1e-12)
    assert sorted({round(y, 9) for _, y, _ in points})[0] == 0
    assert max(y for _, y, _ in points) == pytest.approx(5)
    outward = normal([points[0], points[1], points[14]])  # of the first quadrilateral
    assert dot(outward, (points[0][0], 0, points[0][2])) > 0


def test_voxels_are_the_cubes_that_satisfy_the_condition():
    (made,) = evaluated('use "std/surfaces"\nsurfaces.voxels(|x, y, z| x > 0 and y > 0, count: 4, size: 2)').elements
    centres = sorted(box.args["center"] for box in made.children)
    assert centres == sorted(itertools.product((0.25, 0.75), (0.25, 0.75), (-0.75, -0.25, 0.25, 0.75)))
    assert {box.args["size"] for box in made.children} == {(0.5, 0.5, 0.5)}


def profile_area(call: str, unit: str = "m") -> float:
    """The area of a profile in square metres, positive if it is counter-clockwise."""
    (element,) = evaluated(f'unit {unit}\nuse "std/profiles"\nextrude(profiles.{call})').elements
    x, y = np.array(element.args["profile"]).T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


@pytest.mark.parametrize(
    ("call", "area"),
    [
        ("circle(2, count: 720)", 4 * math.pi),
        ("ellipse([2, 1], count: 720)", 2 * math.pi),
        ("arc(1, from: 0deg, to: 180deg, count: 720)", math.pi / 2),
        ("arc(2, from: 30deg, to: 90deg, at: [1, 1], count: 720)", 4 * (math.pi / 6 - math.sqrt(3) / 4)),
        ("rectangle([3, 2])", 6),
        ("rectangle([3, 2], round: 0.5)", 6 - 4 * 0.25 * (1 - 4 * math.sin(math.pi / 16))),
        ("slot(2, 0.5)", 2 * 1 + 16 * 0.25 * math.sin(math.pi / 16)),
        ("regular(6, 2)", 6 * math.sqrt(3)),
        ("star(5, outer: 2, inner: 1)", 5 * 2 * math.sin(math.pi / 5)),
    ],
)
def test_areas_of_profiles(call, area):
    assert profile_area(call) == pytest.approx(area, rel=1e-4)
    assert profile_area(call, "mm") == pytest.approx(area * 1e-6, rel=1e-4)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (
            "sphere(1, material: gold(#888888))",
            """\
t.scene:1:21: error: gold cannot be made with these arguments: cannot raise a colour to a number
   1 | sphere(1, material: gold(#888888))
     |                     ^^^^ it takes roughness = 0.1""",
        ),
        (
            'let mine(r) = paint(roughness: r)\nsphere(1, material: mine("rough"))',
            """\
t.scene:1:15: error: paint cannot be made with these arguments: expected number, got the string "rough"
   1 | let mine(r) = paint(roughness: r)
     |               ^^^^^ it takes color = #e8e4dc, roughness = 0.6
  in mine, called at t.scene:2:21""",
        ),
        (
            'use "std/materials"\nsphere(1, material: materials.clay("red"))',
            """\
t.scene:2:21: error: materials.clay cannot be made with these arguments: expected colour, number or texture, got the string "red"
   2 | sphere(1, material: materials.clay("red"))
     |                     ^^^^^^^^^^^^^^ it takes color = #b5654a""",
        ),
    ],
)
def test_errors_inside_the_library_are_reported_once_at_the_call(text, told):
    diagnostics = Diagnostics()
    document = evaluate(Source("t.scene", text, "t.scene"), CATALOGUE, Reader(), diagnostics)
    assert [render_text(d, document.sources.get) for d in diagnostics.items] == [told]
