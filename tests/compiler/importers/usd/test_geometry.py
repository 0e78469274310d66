"""USD's meshes and shapes, each rule on a small stage: faces, primvars, orientation, holes, subsets, axes."""

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.importers.stage_options import StageOptions
from maquette.compiler.importers.usd.traverse import CAGES, REFINE

from .stages import SQUARE, attribute, corners, has, kinds, read, slot, world


def up(triangles):
    return np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])


def test_square(tmp_path):
    scene, messages = read(tmp_path, f'def Mesh "m" {{ {SQUARE} }}')
    assert messages == []
    assert corners(scene).tolist() == [[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]]
    assert scene.names.instances == ("/m",)
    assert scene.spans.sources[scene.spans.rows["instances"][0, 0]].endswith("x.usda</m>")
    assert not has(scene, "normals")  # flat


def test_left_handed_faces_are_turned_and_their_values_follow(tmp_path):
    text = SQUARE + 'uniform token orientation = "leftHanded"\n'
    text += 'texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "faceVarying")\n'
    scene, _ = read(tmp_path, f'def Mesh "m" {{ {text} }}')
    triangles = corners(scene)
    assert (up(triangles)[:, 2] == -1).all()
    assert np.array_equal(attribute(scene, "uvs"), triangles[..., :2])


def test_mirrored_transforms_flip(tmp_path):
    text = SQUARE + 'float3 xformOp:scale = (-1, 1, 1)\nuniform token[] xformOpOrder = ["xformOp:scale"]'
    scene, _ = read(tmp_path, f'def Mesh "m" {{ {text} }}')
    assert scene.tables.transforms.flips[scene.tables.instances.transform[0]]


@pytest.mark.parametrize(
    ("interpolation", "values", "expected"),
    [
        ("constant", "[(0.25, 0.5)]", [[[0.25, 0.5]] * 3] * 2),
        ("uniform", "[(0.25, 0.5)]", [[[0.25, 0.5]] * 3] * 2),
        ("vertex", "[(0, 0), (1, 0), (1, 1), (0, 1)]", [[[0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [0, 1]]]),
        ("varying", "[(0, 0), (1, 0), (1, 1), (0, 1)]", [[[0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [0, 1]]]),
        ("faceVarying", "[(4, 0), (1, 0), (1, 1), (0, 1)]", [[[4, 0], [1, 0], [1, 1]], [[4, 0], [1, 1], [0, 1]]]),
    ],
)
def test_primvar_interpolation(tmp_path, interpolation, values, expected):
    text = f'{SQUARE} texCoord2f[] primvars:st = {values} (interpolation = "{interpolation}")'
    scene, messages = read(tmp_path, f'def Mesh "m" {{ {text} }}')
    assert messages == []
    assert attribute(scene, "uvs").tolist() == expected


def test_indexed_primvars(tmp_path):
    text = SQUARE + 'texCoord2f[] primvars:st = [(0, 0), (1, 1)] (interpolation = "vertex")\nint[] primvars:st:indices = [0, 1, 1, 0]'
    scene, _ = read(tmp_path, f'def Mesh "m" {{ {text} }}')
    assert attribute(scene, "uvs").tolist() == [[[0, 0], [1, 1], [1, 1]], [[0, 0], [1, 1], [0, 0]]]


def test_a_primvar_of_the_wrong_length_is_left_out(tmp_path):
    text = SQUARE + 'texCoord2f[] primvars:st = [(0, 0), (1, 1)] (interpolation = "vertex")'
    scene, messages = read(tmp_path, f'def Mesh "m" {{ {text} }}')
    assert messages == ["x.usda</m>: warning: `st` has 2 values where its interpolation `vertex` needs 4: it is left out"]
    assert not has(scene, "uvs")


def test_normals_primvar_goes_before_normals(tmp_path):
    text = SQUARE + 'normal3f[] normals = [(0, 0, 1)] (interpolation = "constant")\n'
    scene, _ = read(tmp_path, f'def Mesh "m" {{ {text} }}')
    assert attribute(scene, "normals")[0, 0].tolist() == [0, 0, 1]
    text += 'normal3f[] primvars:normals = [(0, 2, 0)] (interpolation = "constant")'
    scene, _ = read(tmp_path, f'def Mesh "m" {{ {text} }}')
    assert attribute(scene, "normals")[0, 0].tolist() == [0, 1, 0]


def test_subdivision_cages_have_smooth_normals_and_ignore_given_ones(tmp_path):
    text = """
    int[] faceVertexCounts = [4, 4]
    int[] faceVertexIndices = [0, 1, 2, 3, 1, 4, 5, 2]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (1, 0, -1), (1, 1, -1)]
    normal3f[] normals = [(0, 1, 0)] (interpolation = "constant")
    """
    scene, messages = read(tmp_path, f'def Mesh "m" {{ {text} }}\ndef Mesh "n" {{ {text} }}')
    assert messages == [f"x.usda</m>: note: {CAGES}\n  {REFINE}"]  # once for all
    normals, points = attribute(scene, "normals"), corners(scene)
    on_edge = points[..., 0] + points[..., 2] == 1
    assert np.abs(normals[on_edge & (points[..., 2] == 0)] - [0.5**0.5, 0, 0.5**0.5]).max() < 0.2
    assert np.abs(normals[points[..., 0] == 0] - [0, 0, 1]).max() < 1e-6


def test_holes_are_open(tmp_path):
    text = """
    int[] faceVertexCounts = [3, 3, 3]
    int[] faceVertexIndices = [0, 1, 2, 0, 2, 3, 0, 3, 1]
    int[] holeIndices = [1, 77]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    uniform token subdivisionScheme = "none"
    """
    scene, _ = read(tmp_path, f'def Mesh "m" {{ {text} }}')
    assert corners(scene).tolist() == [[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [0, 1, 0], [1, 0, 0]]]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (SQUARE.replace("[4]", "[5]"), [
            "x.usda</m>: warning: the face counts add up to 5 and there are 4 indices: 0 of 1 faces are drawn",
            "x.usda</m>: note: 1 of 1 faces have no area: they are left out"]),
        (SQUARE.replace("2, 3]", "2, 9]"), [
            "x.usda</m>: warning: 1 of 1 faces use points that do not exist or are not finite: they are left out"]),
        (SQUARE.replace("(1, 1, 0)", "(1, nan, 0)"), [
            "x.usda</m>: warning: 1 of 1 faces use points that do not exist or are not finite: they are left out"]),
        ("", []),
    ],
)  # fmt: skip
def test_broken_meshes_are_not_drawn(tmp_path, text, expected):
    scene, messages = read(tmp_path, f'def Mesh "m" {{ {text} }}\ndef Cube "c" {{}}')
    assert messages == expected
    assert kinds(scene) == ["BOX"]


def test_faces_whose_indices_are_there_are_drawn(tmp_path):
    text = SQUARE.replace("[4]", "[3, -1, 7]").replace("[0, 1, 2, 3]", "[0, 1, 2, 0, 2]")
    scene, messages = read(tmp_path, f'def Mesh "m" {{ {text} }}')
    assert messages[0] == "x.usda</m>: warning: the face counts add up to 9 and there are 5 indices: 1 of 3 faces are drawn"
    assert corners(scene).tolist() == [[[0, 0, 0], [1, 0, 0], [1, 1, 0]]]


def test_subsets_split_a_mesh_by_material(tmp_path):
    text = """
    def Material "red" { token outputs:surface.connect = </red/s.outputs:surface>
        def Shader "s" { uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor = (1, 0, 0)
            token outputs:surface } }
    def Material "blue" { token outputs:surface.connect = </blue/s.outputs:surface>
        def Shader "s" { uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor = (0, 0, 1)
            token outputs:surface } }
    def Mesh "m" (prepend apiSchemas = ["MaterialBindingAPI"]) {
        rel material:binding = </blue>
        int[] faceVertexCounts = [3, 3]
        int[] faceVertexIndices = [0, 1, 2, 0, 2, 3]
        point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
        uniform token subdivisionScheme = "none"
        def GeomSubset "a" (prepend apiSchemas = ["MaterialBindingAPI"]) {
            uniform token elementType = "face"
            uniform token familyName = "materialBind"
            int[] indices = [1]
            rel material:binding = </red>
        }
    }
    """
    scene, messages = read(tmp_path, text)
    assert messages == []
    assert scene.names.instances == ("/m/a", "/m")
    assert [slot(scene, "DIFFUSE", k) for k in (0, 1)] == [[1, 0, 0], [0, 0, 1]]
    assert corners(scene, 0).tolist() == [[[0, 0, 0], [1, 1, 0], [0, 1, 0]]]
    assert corners(scene, 1).tolist() == [[[0, 0, 0], [1, 0, 0], [1, 1, 0]]]


@pytest.mark.parametrize(
    ("prim", "kind", "parameters", "half"),
    [
        ('Cube "c" { double size = 3 }', "BOX", [1.5] * 3, [1.5] * 3),
        ('Cube "c" {}', "BOX", [1] * 3, [1] * 3),
        ('Sphere "c" { double radius = 2 }', "SPHERE", [2], [2] * 3),
        ('Cylinder "c" { double height = 4 }', "CYLINDER", [1, 2, 1], [1, 1, 2]),
        ('Cylinder "c" { double height = 4\nuniform token axis = "X" }', "CYLINDER", [1, 2, 1], [2, 1, 1]),
        ('Cylinder "c" { double height = 4\nuniform token axis = "Y" }', "CYLINDER", [1, 2, 1], [1, 2, 1]),
        ('Capsule "c" { double height = 4 }', "CAPSULE", [0.5, 2], [0.5, 0.5, 2.5]),
        ('Plane "c" { double width = 4 }', "RECTANGLE", [2, 1], [2, 1, 0]),
        ('Plane "c" { double width = 4\nuniform token axis = "X" }', "RECTANGLE", [1, 2], [0, 1, 2]),
        ('Plane "c" { double width = 4\nuniform token axis = "Y" }', "RECTANGLE", [2, 1], [2, 0, 1]),
        ('Cylinder_1 "c" { double radiusTop = 2\ndouble radiusBottom = 2\n}', "CYLINDER", [2, 1, 1], [2, 2, 1]),
        ('Cylinder_1 "c" { double radiusTop = 0.5\ndouble radiusBottom = 2\n}', "CONE", [2, 0.5, 1, 1], [2, 2, 1]),
        ('Capsule_1 "c" { double radiusTop = 2\ndouble radiusBottom = 2\ndouble height = 1\n}', "CAPSULE", [2, 0.5], [2, 2, 2.5]),
    ],
)  # fmt: skip
def test_shapes(tmp_path, prim, kind, parameters, half):
    scene, messages = read(tmp_path, f"def {prim}")
    t = scene.tables
    assert messages == []
    assert kinds(scene) == [kind]
    assert t.geometries.parameters[0, : len(parameters)].tolist() == parameters
    m = world(scene)
    box = np.abs(m[:, :3]) @ t.geometries.bounds[0, 1]
    assert box.tolist() == half


@pytest.mark.parametrize(("axis", "tip"), [("X", [1, 0, 0]), ("Y", [0, 1, 0]), ("Z", [0, 0, 1])])
def test_a_cone_points_along_its_axis(tmp_path, axis, tip):
    scene, _ = read(tmp_path, f'def Cone "c" {{ uniform token axis = "{axis}" }}')
    assert scene.tables.geometries.parameters[0, :4].tolist() == [1, 0, 1, 1]  # the radius at −y comes first
    assert (world(scene)[:, :3] @ [0, 1, 0]).tolist() == tip


CUBE = """
    int[] faceVertexCounts = [4, 4, 4, 4, 4, 4]
    int[] faceVertexIndices = [0, 1, 3, 2, 4, 6, 7, 5, 0, 4, 5, 1, 2, 3, 7, 6, 0, 2, 6, 4, 1, 5, 7, 3]
    point3f[] points = [(-1, -1, -1), (-1, -1, 1), (-1, 1, -1), (-1, 1, 1), (1, -1, -1), (1, -1, 1), (1, 1, -1), (1, 1, 1)]
"""


FACE_LIMIT = (16 + 4 * 4 * 0.75 + 4 * 5 / 9) / 36  # of the center of a side, from the edge and vertex points beside it


def test_complexity_refines_subdivision_surfaces(tmp_path):
    for level, more, farthest in (
        (1, "", FACE_LIMIT), (3, "", FACE_LIMIT), (2, "int[] cornerIndices = [7]\nfloat[] cornerSharpnesses = [10]", 1),
        (2, "int[] creaseIndices = [0, 1, 3, 2, 0]\nint[] creaseLengths = [5]\nfloat[] creaseSharpnesses = [10]", 1),
        (2, 'uniform token subdivisionScheme = "bilinear"', 1),
    ):  # fmt: skip
        scene, messages = read(tmp_path, f'def Mesh "m" {{ {CUBE} {more} }}', options=StageOptions(complexity=level))
        assert messages == []
        assert np.abs(corners(scene)).max() == pytest.approx(farthest)
        assert len(corners(scene)) == 12 * 4**level
        triangles = corners(scene)
        assert (np.einsum("ti,ti->t", up(triangles), triangles.mean(axis=1)) > 0).all()


def test_refined_holes_subsets_and_left_handed_faces(tmp_path):
    text = (
        CUBE
        + """int[] holeIndices = [0]
        uniform token orientation = "leftHanded"
        color3f[] primvars:displayColor = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (1, 0, 1), (0, 1, 1)] (interpolation = "uniform")
    """
    )
    scene, messages = read(tmp_path, f'def Mesh "m" {{ {text} }}', options=StageOptions(complexity=2))
    triangles = corners(scene)
    assert messages == []
    assert len(triangles) == 5 * 2 * 16
    normals = attribute(scene, "normals")
    assert (np.einsum("ti,ti->t", up(triangles), triangles.mean(axis=1)) < 0).all()
    assert (np.einsum("tci,ti->tc", normals, up(triangles)) > 0).all()
    assert not (attribute(scene, "colors") == [1, 0, 0]).all(axis=2).any()  # the hole's


def test_loop_wants_triangles(tmp_path):
    scene, messages = read(
        tmp_path, f'def Mesh "m" {{ {CUBE} uniform token subdivisionScheme = "loop" }}', options=StageOptions(complexity=2)
    )
    assert messages[0] == (
        "x.usda</m>: warning: the scheme loop subdivides triangles alone, and this mesh has other faces: its cage is drawn"
    )
    assert len(corners(scene)) == 12


def test_a_capsule_of_two_radii_is_the_hull_of_two_balls(tmp_path):
    scene, _ = read(tmp_path, 'def Capsule_1 "c" { double radiusTop = 0.5\ndouble radiusBottom = 1\ndouble height = 3\n}')
    points, normals = corners(scene).reshape(-1, 3), attribute(scene, "normals").reshape(-1, 3) @ world(scene)[:, :3].T
    assert (points[:, 2].min(), points[:, 2].max()) == pytest.approx((-2.5, 2))
    inside = np.minimum(np.linalg.norm(points - [0, 0, -1.5], axis=1) - 1, np.linalg.norm(points - [0, 0, 1.5], axis=1) - 0.5)
    assert inside.max() < 1e-6
    triangles = corners(scene)
    outward = np.einsum("ti,ti->t", up(triangles), normals.reshape(-1, 3, 3).sum(axis=1))
    assert outward.min() > -1e-9


def test_a_shape_without_size_is_not_drawn(tmp_path):
    scene, messages = read(tmp_path, 'def Sphere "c" { double radius = 0 }\ndef Cube "d" {}')
    assert messages == ["x.usda</c>: warning: this Sphere has no size: it is not drawn"]
    assert kinds(scene) == ["BOX"]


def test_colours_of_vertices_are_the_mesh_own(tmp_path):
    text = SQUARE + 'color3f[] primvars:displayColor = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)] (interpolation = "vertex")'
    scene, _ = read(tmp_path, f'def Mesh "m" {{ {text} }}')
    assert attribute(scene, "colors")[0].tolist() == [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
    assert slot(scene, "DIFFUSE") == [1, 1, 1]


def test_one_colour_is_the_material_and_is_inherited(tmp_path):
    text = """
    def Xform "x" { color3f[] primvars:displayColor = [(1, 0, 0)]
        def Cube "a" {}
        def Cube "b" { color3f[] primvars:displayColor = [(0, 1, 0)] } }
    """
    scene, _ = read(tmp_path, text)
    assert [slot(scene, "DIFFUSE", k) for k in (0, 1)] == [[1, 0, 0], [0, 1, 0]]
    assert scene.tables.instances.geometry.tolist() == [0, 0]


def test_without_a_colour_things_are_grey_18(tmp_path):
    scene, _ = read(tmp_path, 'def Cube "a" {}')
    assert slot(scene, "DIFFUSE") == [0.18] * 3
    assert ir.MaterialModel(scene.tables.materials.model[0]) == ir.MaterialModel.LAMBERT


def test_display_opacity_lets_light_through(tmp_path):
    scene, _ = read(tmp_path, 'def Cube "a" { color3f[] primvars:displayColor = [(1, 1, 0)]\nfloat[] primvars:displayOpacity = [0.25] }')
    assert slot(scene, "DIFFUSE") == [1, 1, 0]
    assert slot(scene, "OPACITY") == [0.25, 0, 0]


def test_an_element_size_of_primvars_is_read_as_1(tmp_path):
    """Some exporters write the length of the array, with indices and without."""
    size = '(interpolation = "vertex"\nelementSize = 4)'
    more = f"texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] {size}\nint[] primvars:st:indices = [3, 2, 1, 0]\n"
    more += f"normal3f[] primvars:normals = [(1, 0, 0), (1, 0, 0), (1, 0, 0), (0, 1, 0)] {size}"
    scene, messages = read(tmp_path, f'def Mesh "m" {{ {SQUARE}\n{more} }}')
    assert [m.partition("warning: ")[2] for m in messages] == [
        f"the primvar `{name}` of </m> has an elementSize of 4: it is read as 1" for name in ("normals", "st")
    ]
    assert attribute(scene, "uvs")[0].tolist() == [[0, 1], [1, 1], [1, 0]]
    assert attribute(scene, "normals")[0].tolist() == [[1, 0, 0]] * 3


COORDINATES = 'texCoord2f[] primvars:st = [(0, 0), (3, 0), (3, 3), (0, 3)] (interpolation = "faceVarying")'


@pytest.mark.parametrize(
    ("axis", "corner"), [("X", [0, 1.5, 1]), ("Y", [-1, 0, 1.5]), ("Z", [1, 1.5, 0])]
)  # fmt: skip
def test_authored_coordinates_of_planes(tmp_path, axis, corner):
    plane = f'def Plane "p" {{ double width = 2\ndouble length = 3\nuniform token axis = "{axis}"\n{COORDINATES} }}'
    scene, messages = read(tmp_path, plane)
    assert (messages, kinds(scene)) == ([], ["MESH"])
    assert attribute(scene, "uvs")[0].tolist() == [[0, 0], [3, 0], [3, 3]]
    assert corners(scene)[0, 0].tolist() == corner
    a, b, c = corners(scene)[0]
    normal = np.cross(b - a, c - a)
    assert normal[("X", "Y", "Z").index(axis)] == np.linalg.norm(normal)


def test_colors_of_the_faces_of_a_cube(tmp_path):
    colors = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (0, 1, 1), (1, 0, 1)]
    text = f'def Cube "c" {{ double size = 4\ncolor3f[] primvars:displayColor = {colors} (interpolation = "uniform") }}'
    scene, messages = read(tmp_path, text)
    assert (messages, kinds(scene)) == ([], ["MESH"])
    at, found = corners(scene), attribute(scene, "colors")
    outward = np.cross(at[:, 1] - at[:, 0], at[:, 2] - at[:, 0])
    assert (np.einsum("ij,ij->i", outward, at[:, 0]) > 0).all()
    assert found[(at[..., 2] == 2).all(axis=1)][0][0].tolist() == [1, 0, 0]
    assert np.abs(at).max() == 2


def test_authored_coordinates_of_other_shapes_are_named(tmp_path):
    scene, messages = read(tmp_path, f'def Sphere "s" {{ {COORDINATES} }}')
    assert kinds(scene) == ["SPHERE"]
    assert messages == ["x.usda</s>: warning: the primvar `st` of this Sphere is not drawn: it has the coordinates of an exact shape"]
