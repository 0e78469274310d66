"""The language as a format that is written: text, names, places, losses, and the same scene after a way there and back."""

from __future__ import annotations

import json
import os
import tempfile
from pathlib import Path

import maquette
import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import example, given, settings
from hypothesis import strategies as st
from maquette.cli.main import cli
from maquette.compiler import ir
from maquette.compiler.exporters.language import formulas, identifiers, places, words
from maquette.compiler.formula.opcodes import Op
from maquette.compiler.formula.tape import X, Y, Z, load_tape
from maquette.compiler.load import load
from maquette.compiler.scene import transforms
from maquette.compiler.texture_graph import evaluate
from maquette.compiler.texture_graph.graph_builder import GraphBuilder
from maquette.compiler.texture_graph.opcodes import STREAMS, arity
from maquette.compiler.texture_graph.opcodes import Op as GraphOp
from maquette.lang.diagnostics import SceneError
from maquette.lang.elements import Euler
from maquette.lang.syntax import formatter
from PIL import Image

from ...files import write_image

ROOT = Path(__file__).resolve().parents[3]
STAGE = """#usda 1.0
(
    upAxis = "Z"
    metersPerUnit = 0.01
)
def Xform "Büro" {
    def Sphere "let" (
        prepend apiSchemas = ["MaterialBindingAPI"]
    ) {
        double radius = 50
        double3 xformOp:translate = (0, 0, 100)
        uniform token[] xformOpOrder = ["xformOp:translate"]
        rel material:binding = </Looks/sphere>
    }
    def Cube "mirrored" {
        double size = 100
        float3 xformOp:scale = (-1, 1, 1)
        uniform token[] xformOpOrder = ["xformOp:scale"]
    }
    def Cube "sheared" {
        matrix4d xformOp:transform = ((1, 0.5, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (300, 0, 0, 1))
        uniform token[] xformOpOrder = ["xformOp:transform"]
    }
}
def Scope "Looks" {
    def Material "sphere" {
        token outputs:surface.connect = </Looks/sphere/s.outputs:surface>
        def Shader "s" {
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor = (0.2, 0.4, 0.6)
            float inputs:roughness = 0.3
            token outputs:surface
        }
    }
}
def RectLight "panel" {
    float inputs:intensity = 3
    float inputs:width = 100
    float inputs:height = 50
    double3 xformOp:translate = (0, 0, 400)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def SphereLight "lamp" (
    prepend apiSchemas = ["ShapingAPI"]
) {
    float inputs:intensity = 5
    float inputs:radius = 5
    float inputs:shaping:cone:angle = 40
    double3 xformOp:translate = (200, 0, 300)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
"""


def converted(source: Path, *options: str) -> tuple[Path, str]:
    """The scene that `source` becomes, and what the command says."""
    out = source.with_name("out.scene")
    done = CliRunner().invoke(cli, ["convert", str(source), str(out), *options])
    assert done.exit_code == 0, done.stderr
    return out, done.stderr


def written(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def test_numbers_are_short_and_the_same_in_single_precision() -> None:
    assert [words.number(v) for v in (0.1, float(np.float32(0.1)), 2.0, -0.0, 1 / 3, 1e-7)] == [
        "0.1",
        "0.1",
        "2",
        "0",
        "0.333333333333",
        "1e-07",
    ]
    assert words.color((1.0, 0.0, 0.0)) == "#ff0000"
    assert words.color((2.0, 0.5, 0.25)) == "rgb(2, 0.5, 0.25)"
    assert words.string('a "b" \\ \n') == '"a \\"b\\" \\\\  "'


def test_names_are_identifiers_that_nothing_else_has() -> None:
    names = identifiers.Identifiers(("gold",))
    sources = ("let", "sphere", "gold", "1abc", "Ünï", "a/b/Leg 1", "a/b/Leg 1", "", "!?")
    assert [names.new(each, "part") for each in sources] == [
        "let_2", "sphere_2", "gold_2", "part_1abc", "Ünï", "Leg_1", "Leg_1_2", "part", "part_2",
    ]  # fmt: skip
    files = identifiers.FileNames()
    assert [files.new(each, "mesh", ".ply") for each in ("Ünï", "UNI", "con", "雪")] == ["uni.ply", "uni_2.ply", "con_2.ply", "mesh.ply"]


@pytest.mark.parametrize(
    ("angles", "scale", "expected"),
    [
        ((0, 30, 0), (1, 1, 1), ("[0deg, 30deg, 0deg]", "")), ((-90, 0, 0), (0.01,) * 3, ("[-90deg, 0deg, 0deg]", "0.01")),
        ((10, 90, 0), (1, 2, 3), ("[10deg, 90deg, 0deg]", "[1, 2, 3]")), ((0, 0, 0), (-1, 1, 1), ("", "[-1, 1, 1]")),
    ],
)  # fmt: skip
def test_matrices_are_turns_and_factors(angles: tuple[float, ...], scale: tuple[float, ...], expected: tuple[str, str]) -> None:
    turn = transforms.rotation(Euler(tuple(np.radians(angles).tolist())))[:3, :3]  # type: ignore[arg-type]
    assert places.decomposed(turn @ np.diag(scale)) == expected


def test_any_matrix_is_written_as_it_is() -> None:
    rng = np.random.default_rng(1)
    for _ in range(200):
        matrix = np.eye(4)
        matrix[:3] = rng.normal(size=(3, 4)) * 10.0 ** rng.integers(-3, 4)
        assert places.place(matrix).matrix, "a random matrix is sheared"
        turn = transforms.rotation(Euler(tuple(rng.uniform(-3, 3, 3).tolist())))[:3, :3]  # type: ignore[arg-type]
        rotation, _ = places.decomposed(turn * 2.5) or ("", "")
        angles = [float(text.removesuffix("deg")) for text in rotation.strip("[]").split(", ")]
        again = transforms.rotation(Euler(tuple(np.radians(angles).tolist())))[:3, :3] * 2.5  # type: ignore[arg-type]
        assert np.abs(again - turn * 2.5).max() <= 2.5 * places.CLOSE


def same(first: ir.Scene, second: ir.Scene) -> None:
    """Whether instances, materials and lights of two scenes agree to single precision."""
    a, b = first.tables, second.tables
    assert len(a.instances.geometry) == len(b.instances.geometry)
    for i in range(len(a.instances.geometry)):
        placed, again = (t.transforms.matrix[t.instances.transform[i]] for t in (a, b))
        np.testing.assert_allclose(placed, again, atol=2e-7 * np.abs(placed).max())
        g, h = a.instances.geometry[i], b.instances.geometry[i]
        assert a.geometries.kind[g] == b.geometries.kind[h]
        p, q = (t.geometries.parameters[k] for t, k in ((a, g), (b, h)))
        if a.geometries.kind[g] != ir.GeometryKind.MESH:
            np.testing.assert_allclose(p, q, rtol=1e-6)
        m, n = a.instances.material[i], b.instances.material[i]
        assert a.materials.model[m] == b.materials.model[n]
        np.testing.assert_allclose(a.materials.values[m], b.materials.values[n], rtol=1e-6, atol=1e-7)
        assert a.instances.visible[i] == b.instances.visible[i]
    np.testing.assert_allclose(_lights(a), _lights(b), rtol=1e-6)


def _lights(tables: ir.Tables) -> np.ndarray:
    """Kind, color, whether there is an image and an instance of each light, in order of these."""
    lights = tables.lights
    rows = np.column_stack([lights.kind, lights.image >= 0, lights.instance >= 0, lights.color])
    return rows[np.lexsort(rows.round(6).T)]


def test_a_stage_in_centimetres_with_odd_names_comes_back(tmp_path: Path) -> None:
    stage = written(tmp_path, "in.usda", STAGE)
    out, said = converted(stage)
    text = out.read_text(encoding="utf-8")
    assert "let sphere_2 = principled(rgb(0.2, 0.4, 0.6), roughness: 0.3" in text
    assert 'group(name: "Büro") {' in text
    assert 'sphere(50, name: "let", translate: [0, 100, 0]' in text
    assert 'box(100, name: "mirrored", rotate: [-90deg, 0deg, 0deg], scale: [-1, 1, 1], ' in text
    assert "transform([[" in text, "a sheared box has a matrix"
    assert "visible: false" in text
    assert "profile:" in text
    assert formatter.lay_out(text) == text
    assert "not carried" not in said
    same(load(stage), load(out))


@pytest.mark.parametrize("name", ["principled", "metals", "lights", "prism", "hello", "bubbles"])
def test_examples_come_back(tmp_path: Path, name: str) -> None:
    source = ROOT / "examples" / f"{name}.scene"
    out = tmp_path / "out.scene"
    done = CliRunner().invoke(cli, ["convert", str(source), str(out)])
    assert done.exit_code == 0
    assert "not carried" not in done.stderr
    same(load(source), load(out))


def test_the_picture_is_the_same(tmp_path: Path) -> None:
    stage = written(tmp_path, "in.usda", STAGE)
    out, _ = converted(stage)
    first, second = (np.array(maquette.load(path).render(size=(24, 16), samples=2, denoise=False)) for path in (stage, out))
    assert np.abs(first - second).mean() < 1e-5 * first.mean()


@pytest.mark.parametrize("count", [100, pytest.param(10_000, marks=pytest.mark.long)])
def test_copies_are_a_loop(tmp_path: Path, count: int) -> None:
    rng = np.random.default_rng(3)
    points = ", ".join(f"({x:.4f}, {y:.4f}, {z:.4f})" for x, y, z in rng.normal(size=(count, 3)).tolist())
    stage = written(
        tmp_path, "in.usda",
        f'#usda 1.0\ndef PointInstancer "stones" {{\nint[] protoIndices = [{", ".join(["0"] * count)}]\npoint3f[] positions = [{points}]\n'
        'rel prototypes = </stones/p>\ndef Cube "p" {\ndouble size = 0.01\n}\n}\n',
    )  # fmt: skip
    out, _ = converted(stage)
    text = out.read_text(encoding="utf-8")
    assert text.count("box(") == 1
    same(load(stage), load(out))


def test_meshes_keep_normals_coordinates_and_colors(tmp_path: Path) -> None:
    stage = written(
        tmp_path, "in.usda",
        """#usda 1.0
def Mesh "leaf" {
    int[] faceVertexCounts = [4, 3]
    int[] faceVertexIndices = [0, 1, 2, 3, 1, 4, 2]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0.2), (0, 1, 0), (2, 0, 1)]
    normal3f[] normals = [(0, 0, 1), (0, 0, 1), (0, 1, 1), (0, 0, 1), (1, 0, 1), (0, 0, 1), (0, 1, 0)] ( interpolation = "faceVarying" )
    texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1), (0.5, 0), (0.7, 2), (0.1, 0.2)] ( interpolation = "faceVarying" )
    color3f[] primvars:displayColor = [(0.1, 0.2, 0.3), (1, 0, 0), (0, 1, 0), (0, 0, 1), (0.5, 0.5, 0.5)] ( interpolation = "vertex" )
    uniform token subdivisionScheme = "none"
}
""",
    )  # fmt: skip
    out, _ = converted(stage)
    first, second = load(stage), load(out)
    assert (tmp_path / "out.parts" / "leaf.ply").is_file()
    for column in ("normals", "uvs", "colors"):
        values = []
        for scene in (first, second):
            row = int(getattr(scene.tables.geometries, column)[0])
            attributes, width = scene.tables.attributes, int(scene.tables.attributes.width[row])
            flat = scene.tables.pools.values[attributes.first[row] :][: attributes.count[row] * width].reshape(-1, width)
            triangles = ir.mesh_arrays(scene.tables, 0)[1].reshape(-1)
            values.append(flat if attributes.interpolation[row] == ir.Interpolation.CORNER else flat[triangles])
        np.testing.assert_allclose(values[0], values[1], atol=1e-6)


def test_levels_of_pictures_come_back(tmp_path: Path) -> None:
    Image.new("RGB", (2, 2), (200, 100, 50)).save(tmp_path / "a.png")
    levels = ["gain: 0.5, bias: -0.25", "gain: rgb(3, 2, 1)", "bias: rgb(0, 0.5, 0)", "gain: kelvin(2000)"]
    shapes = [f'sphere(1, material: principled(image("a.png", {text}), roughness: image("a.png", {text})))\n' for text in levels]
    source = written(tmp_path, "a.scene", "".join(shapes))
    target, warnings = converted(source)
    assert "error" not in warnings
    first, again = load(source).tables.textures, load(target).tables.textures
    for column in ("gain", "bias"):
        before, after = (np.unique(np.round(getattr(table, column)[:, 0], 6)) for table in (first, again))
        np.testing.assert_allclose(before, after, atol=1e-6)


@pytest.mark.parametrize("texture", ["checker()", "stripes(rgb(0.5, 0.4, 1), rgb(0.6, 0.5, 0.9))", "pattern(|x, y, z| rgb(0.5, y, 1))"])
@pytest.mark.parametrize("material", ["lambert(normal_map: {})", "openpbr(coat_weight: 1, geometry_coat_normal: {})"])
def test_normal_maps_by_checkers_and_formulas_come_back(tmp_path: Path, material: str, texture: str) -> None:
    source = written(tmp_path, "a.scene", f"sphere(1, material: {material.format(texture)})\n")
    target, warnings = converted(source)
    assert warnings.splitlines() == [line for line in warnings.splitlines() if "triangles" in line]
    first, again = load(source).tables.textures, load(target).tables.textures
    for column in ("kind", "color_a", "color_b", "gain", "bias"):
        np.testing.assert_allclose(getattr(first, column), getattr(again, column), atol=1e-6)


@pytest.mark.parametrize("light", ["ambient(color: #000000)", "point([0, 3, 0], intensity: 0)", "sky(luminance: 0)"])
def test_a_dark_scene_stays_dark(tmp_path: Path, light: str) -> None:
    target, _ = converted(written(tmp_path, "a.scene", f"sphere(1)\n{light}\n"))
    assert not load(target).tables.lights.color.any()


def test_light_links_come_back(tmp_path: Path) -> None:
    text = """group(name: "room") { sphere(1, name: "left") sphere(1, translate: [3, 0, 0], name: "right [new]") }
        box(1, translate: [0, 3, 0], name: "top")
        point([0, 5, 0], receivers: ["room/left", "top"], blockers: ["!*"], name: "lamp")
        sun([0, 1, 1], blockers: ["!top"])
        """.replace(") sphere", "); sphere")
    source = written(tmp_path, "in.scene", text)
    out, said = converted(source)
    assert "not carried" not in said
    same(load(source), load(out))


def test_what_moves_is_a_loss(tmp_path: Path) -> None:
    scene = written(tmp_path, "in.scene", "sphere(1, translate: [time / 1s, 0, 0])\nanimate(duration: 2s)\n")
    _, said = converted(scene)
    assert "motion is not carried" in said


def test_an_empty_scene_is_written(tmp_path: Path) -> None:
    stage = written(tmp_path, "in.usda", "#usda 1.0\n")
    out, _ = converted(stage)
    assert not load(out).tables.instances.geometry.size
    assert not (tmp_path / "out.parts").exists()


def test_input_and_folders_are_not_replaced(tmp_path: Path) -> None:
    scene = written(tmp_path, "in.scene", "mesh(points: [[0, 0, 0], [1, 0, 0], [0, 1, 0]], faces: [[0, 1, 2]])\n")
    same_file = CliRunner().invoke(cli, ["convert", str(scene), str(scene)])
    assert same_file.exit_code == 1
    assert "would replace" in same_file.stderr
    written(tmp_path, "out.parts", "a file")
    taken = CliRunner().invoke(cli, ["convert", str(scene), str(tmp_path / "out.scene")])
    assert taken.exit_code == 1
    assert "is a file, and a folder of this name is needed" in taken.stderr
    assert not (tmp_path / "out.scene").exists()
    os.unlink(tmp_path / "out.parts")
    (tmp_path / "out.parts").symlink_to(tmp_path, target_is_directory=True)
    linked = CliRunner().invoke(cli, ["convert", str(scene), str(tmp_path / "out.scene")])
    assert linked.exit_code == 1
    assert "is a link" in linked.stderr


def test_options_of_the_picture_are_written(tmp_path: Path) -> None:
    out, _ = converted(written(tmp_path, "in.scene", "sphere(1)\n"), "--size", "32x16", "--samples", "7")
    assert "render(size: [32, 16], samples: 7" in out.read_text(encoding="utf-8")


def test_glass_without_thickness_and_single_sides_of_gltf(tmp_path: Path) -> None:
    positions = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4").tobytes()
    (tmp_path / "a.bin").write_bytes(positions)
    document = {
        "asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": "sail", "rotation": [0, 0, 0.70710678, 0.70710678]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": 0}]}],
        "materials": [{"name": "1 glass", "extensions": {"KHR_materials_transmission": {"transmissionFactor": 1}}}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}], "buffers": [{"uri": "a.bin", "byteLength": 36}],
        "extensionsUsed": ["KHR_materials_transmission"],
    }  # fmt: skip
    source = written(tmp_path, "in.gltf", json.dumps(document))
    out, _ = converted(source)
    text = out.read_text(encoding="utf-8")
    assert "single_sided: true" in text
    assert "rotate: [0deg, 0deg, 90deg]" in text
    assert "material: material_1_glass" in text
    same(load(source), load(out))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("sphere(1, medium: medium(scattering: 2, droplet: 12um))\n", "droplet: 12um"),
        ("sphere(1)\nfog(droplet: 5um)\n", "droplet: 5um"),
        ("sphere(1)\nfog(droplet: 49.123456um)\n", "droplet: 49.123456um"),
        ("sphere(1)\nfog(phase: 0)\n", "phase: 0"),
        ("sphere(1)\nfog(phase: 0.5, alpha: 1)\n", "alpha: 1"),
        ("sphere(1)\nfog(visibility: 1e-9)\n", "scattering: 3912000000"),
        ("sphere(1)\ncamera([0, 1, 5], shutter: 10ms)\n", "shutter: 0.01s"),
        ("sphere(1)\ncamera([0, 1, 5], fov: 1e-12rad)\n", "fov: 5.7"),
        ("sphere(1)\ncamera([0, 1, 5], fov: 1e-12rad, aperture: 2)\n", "aperture: 2"),
    ],
)
def test_media_and_cameras_come_back_as_they_were(tmp_path: Path, text: str, expected: str) -> None:
    source = written(tmp_path, "in.scene", text)
    out, messages = converted(source)
    assert expected in out.read_text(encoding="utf-8")
    assert "warning" not in messages
    same(load(source), load(out))
    tables, again = load(source).tables, load(out).tables
    for column in ("anisotropy", "draine", "scattering", "absorption"):
        np.testing.assert_allclose(getattr(again.media, column), getattr(tables.media, column), rtol=1e-8)
    for column in ("extent", "shutter", "lens", "focus"):
        np.testing.assert_allclose(getattr(again.cameras, column), getattr(tables.cameras, column), rtol=1e-8)


@pytest.mark.parametrize("text", ["fog(visibility: 1e-30)", "sphere(1, medium: medium(depth: 1e-30))"])
def test_media_too_dense_are_refused(tmp_path: Path, text: str) -> None:
    source = written(tmp_path, "in.scene", f"sphere(1)\n{text}\n")
    with pytest.raises(SceneError, match=r"must be 0\.001um or more"):
        load(source)


# --- patterns -----------------------------------------------------------------------------------------------------------


_OPS = [int(op) for op in (*Op, *GraphOp) if op not in (Op.ARC, Op.QUARTER_ARC, GraphOp.LOOK_UP, GraphOp.CHANNEL)]
_INPUTS = (X, Y, Z, *STREAMS)


_ROW = st.tuples(st.sampled_from([*_OPS, GraphOp.LOOK_UP]), st.lists(st.integers(0, 60), min_size=3, max_size=3))


@given(st.lists(_ROW, min_size=1, max_size=40), st.lists(st.floats(-3.0, 3.0, width=32), min_size=4, max_size=4), st.booleans())
@example([(int(Op.DIVIDE), [0, 8, 0]), (int(Op.MOD), [13, 8, 0])], [0.0, -1.0, 1.0, 2.0], False)
@example([(int(Op.SQRT), [9, 0, 0]), (int(Op.LOG), [8, 0, 0]), (int(Op.POWER), [8, 9, 0])], [0.0, -1.0, 1.0, 2.0], True)
@settings(deadline=None, max_examples=60)
def test_any_graph_comes_back(rows: list[tuple[int, list[int]]], numbers: list[float], is_color: bool) -> None:
    """The text of a tape has its values at all points, where these are defined and steps do not fall on them."""
    builder = GraphBuilder()
    names = [*_INPUTS, *(builder.constant(number) for number in numbers)]
    for op, operands in rows:
        chosen = [names[k % len(names)] for k in operands]
        names += builder.look_up(0, *chosen[:2]) if op == GraphOp.LOOK_UP else [builder.op(op, *chosen[: arity(op)])]
    tape = builder.finish(*names[-3:]) if is_color else builder.finish(names[-1])
    text = formulas.pattern(tape, [(1.0, 0.0)] * 3, lambda row, alpha: "alpha" if alpha else "picture")
    assert text is not None
    with tempfile.TemporaryDirectory() as folder:
        write_image(Path(folder, "p.exr"), np.ones((1, 1, 4), np.float32))
        path = Path(folder, "a.scene")
        lets = 'let picture = image("p.exr")\nlet alpha = image("p.exr", channel: "a")\n'
        path.write_text(
            f"{lets}assert(len([picture, alpha]) == 2)\nlet p = {text}\nsphere(1, material: lambert(p))\ncamera([0, 0, 5])\n",
            encoding="utf-8",
        )
        scene = load(path)
    tables = scene.tables
    back = load_tape(tables, int(tables.textures.tape[tables.materials.textures[0, ir.Slot.DIFFUSE]]))
    points = np.random.default_rng(len(rows)).uniform(-2.0, 2.0, (8, 64))

    def look(texture: int, s: object, t: object) -> list[np.ndarray]:
        return [np.sin(3.0 * np.asarray(s) + k) * np.cos(2.0 * np.asarray(t) - k) for k in range(4)]

    with np.errstate(all="ignore"):
        first, again = (np.array(evaluate.results(each, list(points), look)) for each in (tape, back))
    is_same = np.isclose(first, again, rtol=1e-4, atol=1e-5) | (~np.isfinite(first) & ~np.isfinite(again)) | (np.abs(first) > 1e6)
    assert is_same.mean() > 0.95, (text, first, again)
