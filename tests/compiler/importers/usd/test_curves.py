"""BasisCurves, NurbsCurves and Points: known points of each basis and wrap, widths, colours, and what does not fit."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

import numpy as np
import pytest
from maquette.compiler.importers.usd import curves
from maquette.lang.diagnostics import Diagnostics, Span
from pxr import Usd, UsdGeom

from .stages import attribute, corners, has, kinds, read, slot

ZIGZAG = [(0, 0, 0), (1, 2, 0), (3, 2, 1), (4, 0, 0), (6, 1, 0), (7, 3, 2)]


def curve(points=ZIGZAG, counts=None, basis="bezier", wrap="nonperiodic", kind="cubic", more=""):
    return f"""def BasisCurves "c" {{ uniform token type = "{kind}"
        uniform token basis = "{basis}"
        uniform token wrap = "{wrap}"
        int[] curveVertexCounts = {counts or [len(points)]}
        point3f[] points = {points}
        {more} }}"""


def axis(text):
    """The points on the axis of a curve: means of the rings of its thin tube, in order."""
    stage = Usd.Stage.CreateInMemory()
    stage.GetRootLayer().ImportFromString("#usda 1.0\n" + text.replace("{", "{\n").replace("}", "\n}\n"))
    found = Diagnostics()
    made = curves.mesh(stage.GetPrimAtPath("/c"), Usd.TimeCode.Default(), None, None, found, Span("x"))
    assert made is not None
    assert found.items == []
    return made.points.reshape(-1, 16, 3).mean(axis=1)


THIN = "float[] widths = [0.001]"


def test_bezier():
    p = np.array(ZIGZAG[:4], float)
    found = axis(curve(ZIGZAG[:4], more=THIN))
    assert np.allclose(found[[0, 8, -1]], [p[0], (p[0] + 3 * p[1] + 3 * p[2] + p[3]) / 8, p[3]], atol=1e-6)


def test_bspline():
    p = np.array(ZIGZAG, float)
    found = axis(curve(basis="bspline", more=THIN))
    assert np.allclose(found[::16], (p[:-2] + 4 * p[1:-1] + p[2:]) / 6, atol=1e-6)
    pinned = axis(curve(basis="bspline", wrap="pinned", more=THIN))
    assert np.allclose(pinned[[0, 16, -1]], [p[0], (p[0] + 4 * p[1] + p[2]) / 6, p[-1]], atol=1e-6)
    periodic = axis(curve(basis="bspline", wrap="periodic", more=THIN))
    assert len(periodic) == 6 * 16
    ends = np.roll(p, -1, axis=0)
    assert np.allclose(periodic[::16], (p + 4 * ends + np.roll(p, -2, axis=0)) / 6, atol=1e-6)


def test_catmull_rom_goes_through_its_points():
    p = np.array(ZIGZAG, float)
    assert np.allclose(axis(curve(basis="catmullRom", more=THIN))[::16], p[1:-1], atol=1e-6)
    assert np.allclose(axis(curve(basis="catmullRom", wrap="pinned", more=THIN))[::16], p, atol=1e-6)
    two = axis(curve(ZIGZAG[:2], basis="catmullRom", wrap="pinned", more=THIN))
    assert np.allclose(two[8], (p[0] + p[1]) / 2, atol=1e-6)


def test_linear():
    assert np.allclose(axis(curve(kind="linear", more=THIN)), ZIGZAG, atol=1e-6)
    assert len(axis(curve(kind="linear", wrap="periodic", more=THIN))) == len(ZIGZAG)


def test_a_nurbs_circle_is_round():
    h, points = 0.5**0.5, [(1, 0, 0), (1, 1, 0), (0, 1, 0), (-1, 1, 0), (-1, 0, 0), (-1, -1, 0), (0, -1, 0), (1, -1, 0), (1, 0, 0)]
    found = axis(f"""def NurbsCurves "c" {{ int[] curveVertexCounts = [9]
        int[] order = [3]
        double[] knots = [0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4]
        double2[] ranges = [(0, 4)]
        double[] pointWeights = {[1, h, 1, h, 1, h, 1, h, 1]}
        point3f[] points = {points}
        {THIN} }}""")
    assert np.linalg.norm(found, axis=1) == pytest.approx(1, abs=1e-5)
    assert found[len(found) // 2] == pytest.approx([-1, 0, 0], abs=1e-5)


@pytest.mark.parametrize(
    ("interpolation", "widths", "radii"),
    [("constant", [2], (1, 1)), ("uniform", [2, 4], (1, 2)), ("varying", [2, 2, 4, 4], (1, 2)), ("vertex", [2] * 4 + [4] * 4, (1, 2))],
)
def test_widths(tmp_path, interpolation, widths, radii):
    points = [(0, k, 0) for k in range(4)] + [(9, k, 0) for k in range(4)]
    scene, messages = read(tmp_path, curve(points, [4, 4], more=f'float[] widths = {widths} (interpolation = "{interpolation}")'))
    assert messages == []
    found = corners(scene).reshape(-1, 3)
    for side, radius in ((found[found[:, 0] < 4.5], radii[0]), (found[found[:, 0] > 4.5] - [9, 0, 0], radii[1])):
        assert np.hypot(side[:, 0], side[:, 2]).max() == pytest.approx(radius)


def test_curves_have_a_width_of_one_and_colours_of_vertices(tmp_path):
    colors = 'color3f[] primvars:displayColor = [(1, 0, 0), (0, 1, 0)] (interpolation = "varying")'
    scene, messages = read(tmp_path, curve([(0, 0, 0), (0, 1, 0), (0, 2, 0), (0, 3, 0)], more=colors))
    assert messages == []
    points, tints = corners(scene), attribute(scene, "colors")
    assert np.abs(points[..., 0]).max() == pytest.approx(0.5)
    assert np.allclose(tints[..., 1], points[..., 1] / 3, atol=1e-6)
    assert slot(scene, "DIFFUSE") == [1, 1, 1]


def test_curves_with_normals_are_ribbons(tmp_path):
    flat = 'normal3f[] normals = [(0, 0, 1)] (interpolation = "constant")'
    scene, messages = read(tmp_path, curve([(0, 0, 0), (0, 1, 0), (0, 2, 0), (0, 3, 0)], more=flat))
    assert messages == []
    assert np.abs(corners(scene)[..., 2]).max() == 0
    assert len(corners(scene)) == 32


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (curve(counts=[4]), "the vertex counts of the curves add up to 4 and there are 6 points: 1 of 1 curves are drawn"),
        (curve(ZIGZAG[:3]), "the curves of this BasisCurves have too few points: they are not drawn"),
        (curve(ZIGZAG[:4], more='float[] widths = [1, 2, 3] (interpolation = "varying")'),
            "`widths` has 3 values, which do not fit its interpolation `varying`: it is left out"),
        (curve([(0, 0, 0), (float("nan"), 0, 0), (0, 1, 0), (1, 1, 0)]),
            "1 of 1 curves have points that are not finite: they are left out"),
        ('def NurbsCurves "c" { int[] curveVertexCounts = [2]\nint[] order = [3]\npoint3f[] points = [(0, 0, 0), (0, 1, 0)] }',
            "the knots, counts or orders (at most 64) of this NurbsCurves do not fit its points: it is not drawn"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_said(tmp_path, text, expected):
    messages = read(tmp_path, text + '\ndef Cube "d" {}')[1]
    assert messages[0] == f"x.usda</c>: warning: {expected}"


def test_damaged_curves_are_left_out_alone(tmp_path):
    points = [(0, 0, 0), (0, 1, 0), (1, 0, 0), (1, float("nan"), 0), (2, 0, 0), (2, 1, 0)]
    scene, messages = read(tmp_path, curve(points, counts=[2, 2, 2, 9], more='uniform token type = "linear"\nfloat[] widths = [0.1]'))
    assert messages == [
        "x.usda</c>: warning: the vertex counts of the curves add up to 15 and there are 6 points: 3 of 4 curves are drawn",
        "x.usda</c>: warning: 1 of 3 curves have points that are not finite: they are left out".replace("of 3", "of 4"),
    ]
    assert set(np.round(corners(scene)[..., 0]).ravel()) == {0, 2}


def test_points_are_spheres(tmp_path):
    text = 'def Points "p" {{ point3f[] points = [(1, 0, 0), (5, 0, 0)]\nfloat[] widths = [1, 3] (interpolation = "vertex")\n{} }}'
    scene, messages = read(tmp_path, text.format("color3f[] primvars:displayColor = [(1, 0, 0)]"))
    t = scene.tables
    assert (messages, kinds(scene), slot(scene, "DIFFUSE")) == ([], ["SPHERE", "SPHERE"], [1, 0, 0])
    assert t.geometries.parameters[t.instances.geometry, 0].tolist() == [0.5, 1.5]
    varied = 'color3f[] primvars:displayColor = [(1, 0, 0), (0, 1, 0)] (interpolation = "vertex")'
    broken = text.format(varied).replace("(1, 0, 0), (5", "(nan, 0, 0), (5")
    assert read(tmp_path, broken)[1] == ["x.usda</p>: warning: 1 of 2 points are not finite or have no width: they are left out"]
    scene, messages = read(tmp_path, text.format(varied))
    assert (messages, kinds(scene), has(scene, "colors")) == ([], ["MESH"], True)
    assert corners(scene).reshape(-1, 3)[:, 0].max() == pytest.approx(6.5)


@pytest.mark.long
def test_a_hundred_thousand_strands_are_read(tmp_path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "fur.usdc"))
    n = 100_000
    roots = np.random.default_rng(1).random((n, 1, 3))
    points = (roots + np.linspace(0, 0.1, 4)[None, :, None] * np.array([0.2, 1, 0.1])).reshape(-1, 3)
    prim = UsdGeom.BasisCurves.Define(stage, "/c")
    prim.CreatePointsAttr(points.astype(np.float32))
    prim.CreateCurveVertexCountsAttr([4] * n)
    prim.CreateWidthsAttr([0.001])
    found = curves.mesh(prim.GetPrim(), Usd.TimeCode.Default(), None, None, Diagnostics(), Span("x"))
    assert found is not None
    assert len(found.points) == n * 9 * 4


def test_curves_and_patches_without_knots_are_clamped(tmp_path):
    """As a Bezier curve, whose knots are 0, 0, 0, 0, 1, 1, 1, 1."""
    text = """def NurbsCurves "c" { int[] curveVertexCounts = [4]
        ORDER
        point3f[] points = [(0, 0, 0), (0, 2, 0), (2, 2, 0), (2, 0, 0)]
        float[] widths = [0.01] (interpolation = "constant") }"""
    no_knots = "x.usda</c>: warning: this NurbsCurves has no knots: clamped uniform ones are taken"
    scene, messages = read(tmp_path, text.replace("ORDER", "int[] order = [4]"))
    assert messages == [no_knots]
    at = corners(scene).reshape(-1, 3)
    assert at[:, 1].max() == pytest.approx(1.505, abs=1e-3)  # the middle is at (1, 1.5)
    assert (at[:, 0].min(), at[:, 0].max()) == (pytest.approx(-0.005, abs=1e-3), pytest.approx(2.005, abs=1e-3))
    messages = read(tmp_path, text.replace("ORDER", ""))[1]
    assert messages == ["x.usda</c>: warning: this NurbsCurves has no order: its curves are cubic, or as their points allow", no_knots]
    points = [(x, y, 0) for y in range(2) for x in range(3)]
    patch = (
        f'def NurbsPatch "p" {{ int uVertexCount = 3\nint vVertexCount = 2\nint uOrder = 3\nint vOrder = 2\npoint3f[] points = {points} }}'
    )
    scene, messages = read(tmp_path, patch)
    assert messages == [f"x.usda</p>: warning: this NurbsPatch has no knots along {a}: clamped uniform ones are taken" for a in "uv"]
    assert corners(scene).reshape(-1, 3).max(axis=0).tolist() == [2, 1, 0]
