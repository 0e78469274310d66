"""NurbsPatch, TetMesh and HermiteCurves of USD, against closed forms."""

import math

import numpy as np
import pytest

from .stages import attribute, corners, kinds, read

HALF = math.sqrt(0.5)
ARC = f"""def NurbsPatch "n" {{
    int uVertexCount = 3
    int uOrder = 3
    double[] uKnots = [0, 0, 0, 1, 1, 1]
    double2 uRange = (0, 1)
    int vVertexCount = 2
    int vOrder = 2
    double[] vKnots = [0, 0, 1, 1]
    double2 vRange = (0, 1)
    point3f[] points = [(1, 0, 0), (1, 0, -1), (0, 0, -1), (1, 2, 0), (1, 2, -1), (0, 2, -1)]
    double[] pointWeights = [1, {HALF}, 1, 1, {HALF}, 1]
    MORE }}"""


def test_a_rational_patch_is_a_quarter_of_a_cylinder(tmp_path):
    scene, messages = read(tmp_path, ARC.replace("MORE", ""))
    assert messages == []
    at = corners(scene)
    assert np.hypot(at[..., 0], at[..., 2]) == pytest.approx(1, abs=1e-6)
    assert (at[..., 1].min(), at[..., 1].max()) == (0, 2)
    normal = attribute(scene, "normals")
    assert normal == pytest.approx(np.stack([at[..., 0], 0 * at[..., 0], at[..., 2]], axis=-1), abs=1e-5)
    face = np.cross(at[:, 1] - at[:, 0], at[:, 2] - at[:, 0])
    assert (np.einsum("tk,tk->t", face, normal[:, 0]) > 0).all()
    uvs = attribute(scene, "uvs")
    assert uvs[..., 1] == pytest.approx(at[..., 1] / 2)
    assert (uvs.min(), uvs.max()) == (0, 1)


def test_a_left_handed_patch_faces_the_other_way(tmp_path):
    scene, _ = read(tmp_path, ARC.replace("MORE", 'uniform token orientation = "leftHanded"'))
    at = corners(scene)
    face = np.cross(at[:, 1] - at[:, 0], at[:, 2] - at[:, 0])
    assert (np.einsum("tk,tk->t", face, at[:, 0] * [1, 0, 1]) < 0).all()


def test_a_range_cuts_a_patch(tmp_path):
    scene, _ = read(tmp_path, ARC.replace("MORE", "").replace("double2 vRange = (0, 1)", "double2 vRange = (0.25, 0.5)"))
    assert (corners(scene)[..., 1].min(), corners(scene)[..., 1].max()) == pytest.approx((0.5, 1))


@pytest.mark.parametrize(
    "change", [("uOrder = 3", "uOrder = 4"), ("[0, 0, 0, 1, 1, 1]", "[0, 0, 0, 1, 1]"), ("(0, 2, -1)]", "(0, inf, -1)]")]
)
def test_a_patch_that_does_not_fit_is_named(tmp_path, change):
    scene, messages = read(tmp_path, ARC.replace("MORE", "").replace(*change) + '\ndef Cube "c" {}')
    fault = "the knots, orders (at most 64) and points of this NurbsPatch do not fit each other"
    assert messages == [f"x.usda</n>: warning: {fault}: it is not drawn"]
    assert kinds(scene) == ["BOX"]


def test_trim_curves_are_named(tmp_path):
    messages = read(tmp_path, ARC.replace("MORE", "int[] trimCurve:counts = [1]"))[1]
    assert messages == ["x.usda</n>: warning: `trimCurve:counts` of NurbsPatch is not drawn: the whole patch is drawn"]


TETS = """def TetMesh "t" {{
    point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)]
    int4[] tetVertexIndices = [{}]
    {} }}"""


@pytest.mark.parametrize(("tets", "count", "volume"), [("(0, 1, 2, 3)", 4, 1 / 6), ("(0, 1, 2, 3), (1, 2, 3, 4)", 6, 1 / 6 + 1 / 3)])
def test_the_surface_of_tetrahedra_is_closed_and_faces_outward(tmp_path, tets, count, volume):
    """The volume by the divergence theorem; the shared side is left out."""
    scene, messages = read(tmp_path, TETS.format(tets, ""))
    at = corners(scene)
    assert (messages, len(at)) == ([], count)
    assert np.einsum("tk,tk->t", at[:, 0], np.cross(at[:, 1], at[:, 2])).sum() / 6 == pytest.approx(volume)


def test_the_surface_that_a_tet_mesh_has(tmp_path):
    scene, _ = read(tmp_path, TETS.format("(0, 1, 2, 3)", "int3[] surfaceFaceVertexIndices = [(0, 2, 1)]"))
    assert corners(scene).tolist() == [[[0, 0, 0], [0, 1, 0], [1, 0, 0]]]


def test_hermite_curves(tmp_path):
    """x = t, y = t³ − t is the cubic through (0, 0) and (1, 0) with the slopes −1 and 2."""
    text = """def HermiteCurves "h" {
        int[] curveVertexCounts = [2]
        point3f[] points = [(0, 0, 0), (1, 0, 0)]
        vector3f[] tangents = [(1, -1, 0), (1, 2, 0)]
        float[] widths = [0.0001] (interpolation = "constant") }"""
    scene, messages = read(tmp_path, text)
    at = corners(scene).reshape(-1, 3)
    assert messages == []
    assert (at[:, 0].min(), at[:, 0].max()) == pytest.approx((0, 1), abs=1e-3)
    assert at[:, 1] == pytest.approx(at[:, 0] ** 3 - at[:, 0], abs=1e-3)


def test_hermite_curves_without_tangents_are_named(tmp_path):
    text = 'def HermiteCurves "h" { int[] curveVertexCounts = [2]\npoint3f[] points = [(0, 0, 0), (1, 0, 0)] }'
    assert read(tmp_path, text + '\ndef Cube "c" {}')[1] == [
        "x.usda</h>: warning: the tangents of this HermiteCurves do not fit its points: it is not drawn"
    ]


def plane(count: int, order: int) -> str:
    """A patch of count × count control points, in the plane z = x + 2 y."""
    knots = [0] * (order - 1) + list(range(count - order + 2)) + [count - order + 1] * (order - 1)
    axes = "".join(f"int {a}VertexCount = {count}\nint {a}Order = {order}\ndouble[] {a}Knots = {knots}\n" for a in "uv")
    points = ", ".join(f"({x}, {y}, {x + 2 * y})" for y in range(count) for x in range(count))
    return f'def NurbsPatch "n" {{ {axes} point3f[] points = [{points}] }}'


@pytest.mark.long
def test_a_patch_of_many_spans_has_fewer_faces_for_each(tmp_path):
    scene, messages = read(tmp_path, plane(400, 4))
    at = corners(scene)
    assert messages == []
    assert len(at) == 2 * (397 * 5) ** 2
    assert np.abs(at[..., 2] - at[..., 0] - 2 * at[..., 1]).max() < 1e-2


@pytest.mark.long
def test_orders_have_a_limit(tmp_path):
    assert read(tmp_path, plane(70, 64))[1] == []
    messages = read(tmp_path, plane(70, 65) + '\ndef Cube "c" {}')[1]
    assert len(messages) == 1
    assert "orders (at most 64)" in messages[0]
