"""USD stages as scenes: transforms, composition, instancing, purposes, time, cameras, placing in a scene, and what is wrong."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

import math

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.importers.stage_options import StageOptions
from maquette.compiler.importers.usd import load as usd_load
from maquette.compiler.importers.usd.layers import prim_count
from maquette.compiler.io.sandbox import Files
from maquette.compiler.scene.builder import SceneBuilder
from maquette.lang.diagnostics import Diagnostics, Span
from pxr import Sdf

from .stages import SQUARE, corners, kinds, load, read, slot, world

MOVED = 'double3 xformOp:translate = ({})\nuniform token[] xformOpOrder = ["xformOp:translate"]'


def at(*numbers):
    return MOVED.format(", ".join(map(str, numbers)))


def positions(scene):
    return [world(scene, k)[:, 3].tolist() for k in range(len(scene.names.instances))]


# --- transforms ---


def test_transforms_compose_and_reset(tmp_path):
    text = f"""
    def Xform "a" {{ {at(1, 0, 0)}
        def Cube "b" {{ {at(0, 2, 0)} }}
        def Cube "c" {{ double3 xformOp:translate = (0, 0, 3)
            uniform token[] xformOpOrder = ["!resetXformStack!", "xformOp:translate"] }}
        def "untyped" {{ def Cube "d" {{}} }}
    }}
    """
    scene, messages = read(tmp_path, text)
    assert messages == []
    assert positions(scene) == [[1, 2, 0], [0, 0, 3], [1, 0, 0]]


def test_z_up_is_turned_to_y_up(tmp_path):
    scene, _ = read(tmp_path, f'def Cube "a" {{ {at(1, 2, 3)} }}', 'upAxis = "Z"\nmetersPerUnit = 0.01')
    assert positions(scene) == [[1, 3, -2]]  # and lengths stay as they are
    assert np.array_equal(world(scene)[:, :3], [[1, 0, 0], [0, 0, 1], [0, -1, 0]])


def test_a_flattened_prim_is_left_out_with_a_warning(tmp_path):
    text = 'def Cube "a" { float3 xformOp:scale = (1, 0, 1)\nuniform token[] xformOpOrder = ["xformOp:scale"] }\ndef Cube "b" {}'
    scene, messages = read(tmp_path, text)
    assert scene.names.instances == ("/b",)
    assert messages == [
        "x.usda</a>: warning: this is flattened to nothing by its transform (no inverse): it is not drawn\n"
        "  a scale must not be 0 along any axis"
    ]


# --- what is drawn ---


def test_what_is_not_there_is_not_drawn(tmp_path):
    text = """
    class Cube "klass" {}
    over "over" { def Cube "inside" {} }
    def Cube "off" (active = false) {}
    def Xform "hidden" { token visibility = "invisible"
        def Cube "inside" { token visibility = "inherited" } }
    def Cube "shown" {}
    """
    scene, messages = read(tmp_path, text)
    assert messages == []
    assert scene.names.instances == ("/shown",)


def test_purposes(tmp_path):
    text = """
    def Cube "a" {}
    def Xform "r" { uniform token purpose = "render"
        def Cube "b" {} }
    def Xform "p" { uniform token purpose = "proxy"
        def Cube "c" {}
        def Cube "d" { uniform token purpose = "default" } }
    def Cube "g" { uniform token purpose = "guide" }
    """
    assert read(tmp_path, text)[0].names.instances == ("/a", "/p/d", "/r/b")


def test_proxies_are_drawn_where_there_is_nothing_else(tmp_path):
    text = 'def Cube "a" { uniform token purpose = "proxy" }\ndef Cube "g" { uniform token purpose = "guide" }'
    assert read(tmp_path, text)[0].names.instances == ("/a",)


def test_what_cannot_be_drawn_is_said_once_by_name(tmp_path):
    kinds_ = ("ParticleField", "ParticleField", "GenerativeProcedural", "Volume", "Unheard", "Cube")
    text = "\n".join(f'def {kind} "{name}" {{}}' for kind, name in zip(kinds_, "pqgvuc", strict=True))
    scene, messages = read(tmp_path, text)
    assert scene.names.instances == ("/c",)
    assert messages == [
        "x.usda</p>: warning: ParticleField is not drawn",
        "x.usda</g>: warning: GenerativeProcedural is not drawn: its program is not run",
        "x.usda</v>: warning: Volume is not drawn: write its grid as an array (docs/media.md says how), and fill a box with "
        "medium(density: volume(…))",
        "x.usda</u>: warning: `Unheard` is not known: it is not drawn",
    ]


# --- composition ---


def test_references_and_variants(tmp_path):
    (tmp_path / "part.usda").write_text('#usda 1.0\n(defaultPrim = "p")\ndef Sphere "p" { double radius = 3\n}\n')
    text = """
    def "a" (references = @part.usda@) {}
    def Xform "v" (variants = { string shape = "ball" }
                   prepend variantSets = "shape") {
        variantSet "shape" = {
            "ball" { def Sphere "s" {} }
            "box" { def Cube "s" {} }
        }
    }
    """
    scene, messages = read(tmp_path, text)
    assert messages == []
    assert kinds(scene) == ["SPHERE", "SPHERE"]
    assert kinds(read(tmp_path, text, options=StageOptions(variants={"/v:shape": "box"}))[0]) == ["SPHERE", "BOX"]
    assert [f.rsplit("/", 1)[-1] for f in scene.files] == ["x.usda", "part.usda"]


@pytest.mark.parametrize(
    ("where", "choice", "expected"),
    [
        ("/v:shape", "bxo", "x.usda: error: the variant set `/v:shape` has no variant `bxo`\n  did you mean `box`?"),
        ("/v:shade", "box", "x.usda: error: `/v` has no variant set `shade`\n  did you mean `shape`?"),
        ("/w:shape", "box", "x.usda: error: the stage has no prim `/w`\n  prims with variants: /v"),
        ("shape", "box", "x.usda: error: `shape` names no variant set\n  write --variant /prim:set=name"),
    ],
)
def test_wrong_variants(tmp_path, where, choice, expected):
    text = 'def Xform "v" (prepend variantSets = "shape") { variantSet "shape" = { "box" { def Cube "s" {} } } }'
    assert read(tmp_path, text, options=StageOptions(variants={where: choice}))[1] == [expected]


def test_a_missing_reference_is_a_warning(tmp_path):
    scene, messages = read(tmp_path, 'def "a" (references = @gone.usda@) {}\ndef Cube "c" {}')
    assert kinds(scene) == ["BOX"]
    assert len(messages) == 1
    assert messages[0].startswith("x.usda: warning: ")
    assert "gone.usda" in messages[0]


# --- instancing ---


def test_native_instances_share_geometry_but_not_colour(tmp_path):
    text = f"""
    class Xform "proto" {{ def Mesh "m" {{ {SQUARE} }} }}
    def "a" (inherits = </proto>
             instanceable = true) {{ {at(1, 0, 0)} color3f[] primvars:displayColor = [(1, 0, 0)] }}
    def "b" (inherits = </proto>
             instanceable = true) {{ {at(2, 0, 0)} color3f[] primvars:displayColor = [(0, 1, 0)] }}
    """
    scene, messages = read(tmp_path, text.replace("] }", "]\n}").replace("] color", "]\ncolor"))
    assert messages == []
    assert scene.names.instances == ("/a/m", "/b/m")
    assert scene.tables.instances.geometry.tolist() == [0, 0]
    assert positions(scene) == [[1, 0, 0], [2, 0, 0]]
    assert [slot(scene, "DIFFUSE", k) for k in (0, 1)] == [[1, 0, 0], [0, 1, 0]]


INSTANCER = """
def PointInstancer "i" {
    rel prototypes = [</i/protos/a>, </i/protos/b>]
    int[] protoIndices = [0, 1, 0, 0]
    point3f[] positions = [(1, 0, 0), (2, 0, 0), (3, 0, 0), (4, 0, 0)]
    EXTRA
    def Scope "protos" {
        def Xform "a" { double3 xformOp:translate = (0, 5, 0)
            uniform token[] xformOpOrder = ["xformOp:translate"]
            def Mesh "m" { MESH } }
        def Sphere "b" {}
    }
}
"""


def instancer(extra=""):
    return INSTANCER.replace("EXTRA", extra).replace("MESH", SQUARE)


def test_ids_leave_instances_out(tmp_path):
    """`inactiveIds` of the prim's metadata and `invisibleIds`; ids count from 0 without an attribute `ids`."""
    text = instancer("int64[] invisibleIds = [3]").replace('def PointInstancer "i" {', 'def PointInstancer "i" (inactiveIds = [0]) {')
    scene, messages = read(tmp_path, text)
    assert messages == []
    assert scene.names.instances == ("/i[2]", "/i[1]")


def test_point_instancer(tmp_path):
    scene, messages = read(tmp_path, instancer())
    assert messages == []
    assert scene.names.instances == ("/i[0]", "/i[2]", "/i[3]", "/i[1]")
    assert positions(scene) == [[1, 5, 0], [3, 5, 0], [4, 5, 0], [2, 0, 0]]
    assert len(scene.tables.geometries.kind) == 2


def test_point_instancer_turns_scales_and_masks(tmp_path):
    extra = """
    quath[] orientations = [(1, 0, 0, 0), (1, 0, 0, 0), (0.70710678, 0, 0, 0.70710678), (1, 0, 0, 0)]
    float3[] scales = [(1, 1, 1), (2, 2, 2), (1, 1, 3), (1, 1, 1)]
    int64[] invisibleIds = [0]
    """
    scene, messages = read(tmp_path, instancer(extra))
    assert messages == []
    assert scene.names.instances == ("/i[2]", "/i[3]", "/i[1]")
    assert world(scene, 0) == pytest.approx(np.array([[0, -1, 0, -2], [1, 0, 0, 0], [0, 0, 3, 0]]), abs=2e-3)  # half floats
    assert world(scene, 2)[:, :3].tolist() == np.diag([2, 2, 2]).tolist()


def test_point_instancers_inside_of_each_other(tmp_path):
    text = """
    def PointInstancer "o" { rel prototypes = [</o/i>]
        int[] protoIndices = [0, 0]
        point3f[] positions = [(0, 10, 0), (0, 20, 0)]
        def PointInstancer "i" { rel prototypes = [</o/i/c>]
            int[] protoIndices = [0, 0]
            point3f[] positions = [(1, 0, 0), (2, 0, 0)]
            def Cube "c" {} } }
    """
    assert sorted(positions(read(tmp_path, text)[0])) == [[1, 10, 0], [1, 20, 0], [2, 10, 0], [2, 20, 0]]


def test_instances_without_a_position_or_prototype_are_left_out(tmp_path):
    text = instancer().replace("(3, 0, 0), (4, 0, 0)", "(3, 0, 0)")
    scene, messages = read(tmp_path, text)
    assert messages[0] == "x.usda</i>: warning: the instancer has 4 instances and 3 positions: the rest is left out"
    assert len(scene.tables.instances.geometry) == 3
    scene, messages = read(tmp_path, instancer().replace("[0, 1, 0, 0]", "[0, 1, 0, 7]"))
    assert messages[0] == "x.usda</i>: warning: 1 instances have none of the 2 prototypes of this instancer: they are left out"
    assert len(scene.tables.instances.geometry) == 3


# --- time ---


def test_velocities_move_points_and_instances(tmp_path):
    text = """
    def PointInstancer "i" { rel prototypes = [</i/a>]
        int[] protoIndices = [0, 0]
        quatf[] orientationsf = [(1, 0, 0, 0), (0, 1, 0, 0)]
        float3[] scales = [(1, 1, 1), (1, 2, 3)]
        point3f[] positions.timeSamples = {
            1: [(0, 0, 0), (2, 0, 0)],
            2: [(9, 9, 9), (8, 8, 8)],
        ENDvector3f[] velocities.timeSamples = {
            1: [(0, 24, 0), (0, 0, 48)],
            2: [(0, 0, 0), (0, 0, 0)],
        ENDdef Sphere "a" {} }
    def Points "p" { float[] widths = [1]
        point3f[] points.timeSamples = {
            1: [(5, 0, 0)],
            2: [(9, 9, 9)],
        ENDvector3f[] velocities.timeSamples = {
            1: [(0, 24, 0)],
            2: [(0, 0, 0)],
        END}
    """
    scene, messages = read(tmp_path, text.replace("END", "}\n"), code=1.5)
    assert messages == []
    assert positions(scene) == [[0, 0.5, 0], [2, 0, 1], [5, 0.5, 0]]
    assert np.allclose(world(scene, 1)[:, :3], np.diag([1, -2, -3]))
    assert positions(read(tmp_path, text.replace("END", "}\n"))[0]) == [[0, 0, 0], [2, 0, 0], [5, 0, 0]]


@pytest.mark.parametrize(("code", "x"), [(1, 0), (1.5, 0.5), (2.5, 5.5), (3, 5), (30, 5)])
def test_velocities_end_after_the_last_sample(tmp_path, code, x):
    """Between samples and less than a time code later; else a mesh would leave the picture that other viewers hold."""
    text = """def Points "p" { float[] widths = [1]
        point3f[] points.timeSamples = {
            1: [(0, 0, 0)],
            2: [(5, 0, 0)],
        ENDvector3f[] velocities.timeSamples = {
            1: [(24, 0, 0)],
            2: [(24, 0, 0)],
        END}"""
    scene, _ = read(tmp_path, text.replace("END", "}\n"), code=code)
    assert world(scene)[:, 3].tolist() == [x, 0, 0]


TIMED = """
def Cube "c" {
    double3 xformOp:translate.timeSamples = { 1: (1, 0, 0), 25: (3, 0, 0) }
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
"""
CODES = "startTimeCode = 1\nendTimeCode = 25\ntimeCodesPerSecond = 24"


@pytest.mark.parametrize(("more", "x"), [({}, 1), ({"time": 0.5}, 2), ({"time": 1.0}, 3), ({"time": 9.0}, 3), ({"code": 7}, 1.5)])
def test_time(tmp_path, more, x):
    scene, _ = read(tmp_path, TIMED.replace("{ 1:", "{\n1:"), CODES, **more)
    assert positions(scene) == [[x, 0, 0]]
    assert (scene.duration, scene.fps) == (1.0, 24.0)


# --- cameras and light ---

CAMERA = """
def Camera "NAME" {
    float focalLength = 50
    float horizontalAperture = 36
    float verticalAperture = 24
    float horizontalApertureOffset = 3.6
    float2 clippingRange = (0.5, 100)
    EXTRA
}
"""


def camera(name, extra=""):
    return CAMERA.replace("NAME", name).replace("EXTRA", extra)


def test_main_cam_comes_first(tmp_path):
    scene, _ = read(tmp_path, camera("other") + camera("main_cam") + 'def Cube "c" {}')
    assert scene.names.cameras == ("/main_cam", "/other")
    c = scene.tables.cameras
    assert c.extent[0] == 0.24
    assert c.aspect[0] == 1.5
    assert c.shift[0] == pytest.approx([0.1, 0])
    assert (c.near[0], c.far[0], c.projection[0], c.fit[0]) == (0.5, 100, ir.Projection.PERSPECTIVE, ir.Fit.VERTICAL)


def test_without_main_cam_everything_is_framed(tmp_path):
    scene, _ = read(tmp_path, camera("other") + f'def Cube "c" {{ double size = 2\n{at(4, 0, 0)} }}\ndef Cube "d" {{}}')
    assert scene.names.cameras == ("frame", "/other")
    eye = scene.tables.transforms.matrix[scene.tables.cameras.transform[0]]
    distance = math.hypot(6, 2) / 2 / (20.955 / 2 / 50) + 1
    assert eye == pytest.approx(np.array([[1, 0, 0, 2], [0, 1, 0, 0], [0, 0, 1, distance]]))
    assert scene.tables.cameras.aspect[0] == pytest.approx(20.955 / 15.2908)
    assert scene.defaults[0] == f"camera: none is called main_cam; one at [2, 0, {distance:.4g}] frames everything, as usdrecord does"


def test_orthographic(tmp_path):
    c = read(tmp_path, camera("main_cam", 'token projection = "orthographic"') + 'def Cube "c" {}')[0].tables.cameras
    assert (c.projection[0], c.extent[0]) == (ir.Projection.ORTHOGRAPHIC, pytest.approx(1.2))


def test_apertures_and_focus(tmp_path):
    """Focal lengths are tenths of a unit, distances are units; without a distance there is no depth of field."""
    c = read(tmp_path, camera("main_cam", "float fStop = 2\n float focusDistance = 30") + 'def Cube "c" {}')[0].tables.cameras
    assert (c.lens[0], c.focus[0]) == (pytest.approx(5.0 / 2 / 2), pytest.approx(30))
    assert read(tmp_path, camera("main_cam", "float fStop = 2") + 'def Cube "c" {}')[0].tables.cameras.lens[0] == 0


def test_clipping_planes(tmp_path):
    """They are in the camera's frame; d is a length."""
    header, planes = "metersPerUnit = 0.01", "float4[] clippingPlanes = [(1, 0, 0, 20), (0, 0.5, -2, -3)]"
    scene, messages = read(tmp_path, camera("main_cam", planes) + 'def Cube "c" {}', header)
    expected = np.zeros((ir.CLIP_PLANES, 4))
    expected[:2] = [(1, 0, 0, 20), (0, 0.5, -2, -3)]
    assert (scene.tables.cameras.planes[0].tolist(), messages) == (expected.tolist(), [])


def test_clipping_planes_that_cannot_be_drawn_are_named(tmp_path):
    planes = ", ".join(["(0, 0, 0, 1)", *["(0, 0, -1, 1)"] * 9])
    messages = read(tmp_path, camera("main_cam", f"float4[] clippingPlanes = [{planes}]") + 'def Cube "c" {}')[1]
    assert messages == [
        "x.usda</main_cam>: warning: a clipping plane of this camera has no direction: it is left out",
        "x.usda</main_cam>: warning: only the first 8 of this camera's 9 clipping planes are drawn",
    ]


def test_a_camera_without_film_is_left_out(tmp_path):
    scene, messages = read(tmp_path, 'def Camera "k" { float focalLength = 0\n}\ndef Cube "c" {}')
    assert scene.names.cameras == ("frame",)
    assert messages == ["x.usda</k>: warning: this camera has no aperture or focal length: it is left out"]


def test_a_stage_without_lights_is_lit_from_its_camera(tmp_path):
    scene, _ = read(tmp_path, camera("main_cam", at(0, 0, 7)) + 'def Cube "c" {}')
    lights = scene.tables.lights
    assert [ir.LightKind(k).name for k in lights.kind] == ["POINT"]
    assert lights.position[0].tolist() == [0, 0, 7]
    assert (lights.falloff[0], lights.coefficients[0].tolist()) == (ir.FalloffKind.POLYNOMIAL, [1, 0, 0])
    assert scene.defaults == ("light: the stage has none; it is lit from its first camera, as usdrecord does",)


# --- placing in a scene ---


def place(path, matrix=None, **more):
    found = Diagnostics()
    builder = SceneBuilder(found, Files(path.parent))
    usd_load.place(builder, usd_load.Placed(path, np.eye(4) if matrix is None else matrix, **more), Span("a.scene", 3, 1, 3, 9))
    return builder.finish(), [f"{d.span}: {d.severity}: {d.message} {d.hint}".strip() for d in found.items]


def test_placed_stages_are_in_metres_and_bring_no_camera(tmp_path):
    read(tmp_path, camera("main_cam") + f'def Mesh "m" {{ {SQUARE} {at(1, 2, 3)} }}', 'upAxis = "Z"\nmetersPerUnit = 0.01')
    moved = np.eye(4)
    moved[:3, 3] = (10, 0, 0)
    scene, messages = place(tmp_path / "x.usda", moved, name="robot")
    assert messages == []
    assert scene.names.cameras == ()
    assert scene.names.instances == ("robot/m",)
    assert corners(scene)[0, 0] == pytest.approx([10.01, 0.03, -0.02])
    assert scene.tables.lights.kind.tolist() == []


def test_one_prim_of_a_stage(tmp_path):
    read(
        tmp_path,
        f'def Xform "a" {{ {at(5, 0, 0)} def Cube "b" {{}} }}\ndef Sphere "s" {{}}'.replace("] def", "]\ndef"),
        "metersPerUnit = 1",
    )
    scene, messages = place(tmp_path / "x.usda", prim="/a")
    assert messages == []
    assert scene.names.instances == ("/a/b",)
    _, messages = place(tmp_path / "x.usda", prim="/a/c")
    assert messages == ["a.scene:3:1: error: the stage has no prim `/a/c` did you mean `/a/b`?"]
    _, messages = place(tmp_path / "x.usda", prim="b")
    assert messages == ["a.scene:3:1: error: the stage has no prim `b` it has /a, /s"]


def test_the_scene_s_material_is_for_what_has_none(tmp_path):
    from maquette.compiler.scene.row_records import lambert

    read(tmp_path, 'def Cube "a" {}\ndef Cube "b" { color3f[] primvars:displayColor = [(1, 0, 0)] }')
    builder = SceneBuilder(Diagnostics(), Files(tmp_path))
    row = builder.material(lambert((0, 0, 1), name="blue"))
    usd_load.place(builder, usd_load.Placed(tmp_path / "x.usda", np.eye(4), material=row), Span("a.scene"))
    scene = builder.finish()
    assert [slot(scene, "DIFFUSE", k) for k in (0, 1)] == [[0, 0, 1], [1, 0, 0]]


# --- what is wrong ---


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"#usda 1.0\ndef Cube {",
        b'#usda 1.0\ndef Cube "a" { double size = "x" }',
        b"\x00\x01\x02" * 99,
        b"PXR-USDC" + bytes(range(200)),
    ],
    ids=["empty", "unfinished", "wrong-type", "binary", "broken-crate"],
)
@pytest.mark.parametrize("suffix", [".usda", ".usdc", ".usdz"])
def test_broken_stages_are_one_short_error(tmp_path, data, suffix, capfd):
    path = tmp_path / f"x{suffix}"
    path.write_bytes(data)
    _, messages = load(path)
    errors = [m for m in messages if ": error: " in m]
    assert len(errors) == 1
    place = ":2:1" if suffix == ".usda" and data.endswith(b"{") else ""  # where usd-core says what stands where
    assert errors[0].startswith(f"x{suffix}{place}: error: cannot read the stage `x{suffix}`")
    assert all(len(line) < 420 for line in "\n".join(messages).splitlines())
    out, err = capfd.readouterr()
    assert (out, err) == ("", "")  # usd-core prints nothing of its own


def test_values_of_types_that_nobody_expects(tmp_path):
    text = """
    def Sphere "s" { string radius = "big" }
    def Mesh "m" { string points = "none"
        int[] faceVertexCounts = [3]
        int[] faceVertexIndices = [0, 1, 2] }
    def Cube "c" { string[] primvars:displayColor = ["red"] }
    def SphereLight "l" { string inputs:intensity = "strong"
        string inputs:color = "red" }
    """
    scene, messages = read(tmp_path, text)
    assert kinds(scene) == ["SPHERE", "BOX"]
    assert "x.usda: warning: the value of </s.radius> is not of the type double: its default is drawn" in messages
    assert "x.usda: warning: the value of </m.points> is not of the type point3f[]: its default is drawn" in messages
    assert slot(scene, "DIFFUSE") == [0.18] * 3
    assert scene.tables.lights.color.tolist() == [[1, 1, 1]]


def test_a_transform_that_cannot_be_read_takes_its_prim_away(tmp_path):
    text = """
    def Xform "a" { float xformOp:translate = 3
        uniform token[] xformOpOrder = ["xformOp:translate"]
        def Cube "inside" {} }
    def Cube "c" {}
    """
    scene, messages = read(tmp_path, text)
    assert scene.names.instances == ("/c",)
    assert messages[0].startswith("x.usda</a>: warning: this prim and its descendants are left out: ")


@pytest.mark.parametrize("far", ["1e308", "-1e40"])
def test_what_is_out_of_reach_is_left_out(tmp_path, far):
    matrix = f"matrix4d xformOp:transform = ((1,0,0,0),(0,1,0,0),(0,0,1,0),({far},0,0,1))"
    text = f'def Cube "a" {{ {matrix}\nuniform token[] xformOpOrder = ["xformOp:transform"] }}\ndef Cube "b" {{ }}'
    scene, messages = read(tmp_path, text)
    assert len(scene.tables.instances.geometry) == 1
    assert messages == ["x.usda</a>: warning: this is placed or scaled beyond 1e+30: it is not drawn"]


def test_a_matrix_is_divided_by_its_last_component(tmp_path):
    matrix = "matrix4d xformOp:transform = ((2,0,0,0),(0,2,0,0),(0,0,2,0),(6,0,0,2))"
    scene, _ = read(tmp_path, f'def Cube "a" {{ {matrix}\nuniform token[] xformOpOrder = ["xformOp:transform"] }}')
    assert world(scene).tolist() == [[1, 0, 0, 3], [0, 1, 0, 0], [0, 0, 1, 0]]


# --- limits ---


def chain(folder, depth, more=""):
    """Files x0 … x`depth`, each of which references the next twice: 2^(depth + 1) prims and as many again."""
    for k in range(depth):
        text = f'def "A" (\n{more}references = @x{k + 1}.usda@\n) {{\ndef "c" (\n{more}references = @x{k + 1}.usda@\n) {{\n}}\n}}\n'
        (folder / f"x{k}.usda").write_text(f'#usda 1.0\n(\ndefaultPrim = "A"\n)\n{text}')
    (folder / f"x{depth}.usda").write_text('#usda 1.0\n(\ndefaultPrim = "A"\n)\ndef Sphere "A" {\n}\n')
    return folder / "x0.usda"


def test_references_that_multiply_are_refused_before_they_are_composed(tmp_path):
    messages = load(chain(tmp_path, 24))[1]
    assert len(messages) == 1
    assert messages[0].startswith("x0.usda: error: the stage has about 50,331,646 prims, more than 4,000,000\n")


def extent(path):
    return prim_count.estimate(Sdf.Layer.FindOrOpen(str(path)), {})


def test_the_estimate_of_prims(tmp_path):
    for depth in (7, 3):  # n(k) = 2 n(k − 1) + 2, n(0) = 1
        folder = tmp_path / str(depth)
        folder.mkdir()
        assert extent(chain(folder, depth)) == (3 * 2**depth - 2, depth + 1)
    (tmp_path / "shared").mkdir()
    shared = chain(tmp_path / "shared", 9, "instanceable = true\n")
    assert extent(shared).prims == 2  # instances share their prims
    (tmp_path / "a.usda").write_text('#usda 1.0\ndef "A" (\nreferences = @a.usda@</A>\n) {\n}\n')
    assert extent(tmp_path / "a.usda") == (2, 1)
    (tmp_path / "b.usda").write_text('#usda 1.0\ndef "A" {\ndef "B" {\n}\n}\n')
    assert extent(tmp_path / "b.usda") == (0, 0)  # nothing multiplies


def test_the_estimate_of_prims_of_variants_and_sublayers(tmp_path):
    variants = "".join(f'"v{k}" (\nreferences = </T>\n) {{\ndef "{k}" {{\n}}\n}}\n' for k in range(3))
    text = f'#usda 1.0\n(\nsubLayers = [@t.usda@]\n)\ndef "A" (\nprepend variantSets = "s"\n) {{\nvariantSet "s" = {{\n{variants}}}\n}}\n'
    (tmp_path / "x.usda").write_text(text.replace('def "0"', 'def "p"').replace('def "1"', 'def "p"').replace('def "2"', 'def "p"'))
    (tmp_path / "t.usda").write_text('#usda 1.0\ndef "T" {\n' + "".join(f'def "c{k}" {{\n}}\n' for k in range(9)) + "}\n")
    assert extent(tmp_path / "x.usda") == (1 + 1 + 10 + 10, 2)  # A, p, T in one of the variants, and T


@pytest.mark.parametrize("arc", ["references = <{}>", "payload = <{}>", "inherits = <{}>", "specializes = <{}>", "add references = <{}>"])
@pytest.mark.parametrize("split", [False, True])
def test_prims_of_one_layer_that_multiply_are_refused(tmp_path, arc, split):
    count = 26
    texts = ["#usda 1.0\n(\nsubLayers = [@y.usda@]\n)\n" if split else "#usda 1.0\n", "#usda 1.0\n"]
    for k in range(count):
        below = "".join(f'def "{name}" (\n{arc.format(f"/P{k + 1}")}\n) {{\n}}\n' for name in "ab") if k < count - 1 else ""
        texts[k % 2 if split else 0] += f'def "P{k}" {{\n{below}}}\n'
    (tmp_path / "x.usda").write_text(texts[0])
    (tmp_path / "y.usda").write_text(texts[1])
    messages = load(tmp_path / "x.usda")[1]
    hint = "make the prims that are referenced often instanceable, or read a part by --mask"
    assert messages == [f"x.usda: error: the stage has about 268,435,374 prims, more than 4,000,000\n  {hint}"]


@pytest.mark.long
def test_prims_that_nest_by_references_are_refused(tmp_path):
    text = "#usda 1.0\n"
    for k in range(50):
        arc = f"(\nreferences = </P{k + 1}>\n)" if k < 49 else ""
        text += f'def "P{k}" {{\n' + 'def "a" {\n' * 98 + f'def "a" {arc} {{\n' + "}\n" * 100
    (tmp_path / "x.usda").write_text(text)
    messages = load(tmp_path / "x.usda")[1]
    assert messages == ["x.usda: error: the prims of the stage nest in more than 4,000 levels\n  read a part by --mask"]


@pytest.mark.parametrize("order", [1, -1])
def test_chains_of_references_have_a_limit(tmp_path, order):
    fault = "references of the stage lead from one prim to the next more than 120 times"
    hint = "flatten the stage, as by `usdcat --flatten`, or read a part by --mask"
    for length, expected in ((118, []), (121, [f"x.usda: error: {fault}\n  {hint}"])):
        prims = [f'class "P{k}" (\nreferences = </P{k + 1}>\n) {{\n}}\n' for k in range(length)]
        last = f'class "P{length}" {{\ndef Sphere "s" {{\n}}\n}}\ndef "x" (\nreferences = </P0>\n) {{\n}}\n'
        (tmp_path / "x.usda").write_text("#usda 1.0\n" + "".join(prims[::order]) + last)
        scene, messages = load(tmp_path / "x.usda")
        assert messages == expected
        assert scene.names.instances == (() if expected else ("/x/s",))


def test_a_prototype_that_is_not_there_is_said(tmp_path):
    text = """def PointInstancer "i" { int[] protoIndices = [0, 0]
        point3f[] positions = [(0, 0, 0), (1, 0, 0)]
        rel prototypes = </gone> }
    def Cube "c" {}"""
    expected = "the prototype /gone of this instancer does not exist: its 2 instances are left out"
    assert read(tmp_path, text)[1] == [f"x.usda</i>: warning: {expected}"]
