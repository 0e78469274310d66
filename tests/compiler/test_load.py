"""The door: every kind of file becomes a validated scene, and what is wrong is said in whole messages."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from maquette.compiler import ir, load
from maquette.compiler.importers.stage_options import StageOptions
from maquette.compiler.scene import dump, serialize
from maquette.lang.diagnostics import Diagnostics, SceneError

HELLO = """param radius = 1 in 0.2..2  "sphere radius"
let grey = checker(#e8e8e8, #8a8a8a, size: 50cm)
plane(y: 0, material: lambert(grey))
sphere(center: [0, radius, 0], radius: radius)
sun(from: [2, 4, 3], illuminance: 20000lx)
camera(position: [0, 1.6, 5 - time / 1s], look_at: [0, 1, 0], fov: 35deg)
"""


@pytest.fixture
def hello(tmp_path: Path) -> Path:
    path = tmp_path / "hello.scene"
    path.write_text(HELLO)
    return path


def refused(path: Path, **more: object) -> list[tuple[str, str]]:
    with pytest.raises(SceneError) as caught:
        load.load(path, **more)  # type: ignore[arg-type]
    return [(d.message, d.hint) for d in caught.value.diagnostics if d.severity == "error"]


def test_a_scene(hello: Path) -> None:
    seconds: dict[str, float] = {}
    scene = load.load(hello, seconds=seconds)
    assert scene.name == str(hello)
    assert scene.files == (str(hello),)
    assert [p.name for p in scene.params] == ["radius"]
    assert {"parse", "evaluate", "lower", "validate"} == seconds.keys()
    assert all(s > 0 for s in seconds.values())


def test_a_scene_reached_by_a_link_has_its_own_files(tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "real" / "a.scene").write_text('use "b.scene"\nb()\n')
    (tmp_path / "real" / "b.scene").write_text("sphere(1)\n")
    (tmp_path / "link.scene").symlink_to("real/a.scene")
    assert len(load.load(tmp_path / "link.scene").tables.instances.geometry) == 1
    (tmp_path / "loop.scene").symlink_to("loop.scene")
    assert refused(tmp_path / "loop.scene")[0][0].endswith("leads round in a circle of links")


def test_sets_and_time(hello: Path) -> None:
    scene = load.load(hello, sets={"radius": "1.5"}, time=2.0)
    assert scene.tables.geometries.parameters[1, 0] == 1.5
    assert scene.tables.transforms.matrix[scene.tables.cameras.transform[0], 2, 3] == 3
    assert refused(hello, sets={"radios": "1"}) == [("the scene has no param `radios`; did you mean `radius`?", "it has radius")]


def test_a_mesh_file_is_a_scene(tmp_path: Path) -> None:
    path = tmp_path / "tri.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    scene = load.load(path)
    assert len(scene.tables.instances.geometry) == len(scene.tables.cameras.extent) == 1
    assert scene.names.materials == ("default",)
    assert [d.split(":")[0] for d in scene.defaults] == ["camera", "sun", "sky"]
    assert scene.files == (str(path),)


def test_a_stage_is_a_scene(tmp_path: Path) -> None:
    path = tmp_path / "ball.usda"
    path.write_text('#usda 1.0\n(upAxis = "Y")\ndef Sphere "Ball" {\n double radius = 2\n}\n')
    scene = load.load(path)
    assert scene.tables.geometries.kind.tolist() == [ir.GeometryKind.SPHERE]
    assert len(scene.tables.cameras.extent) >= 1


def test_a_stage_in_a_scene(compiled, tmp_path: Path) -> None:
    stage = '#usda 1.0\n(upAxis = "Y"\nmetersPerUnit = 0.01)\ndef Sphere "Ball" {\n double radius = 50\n}\n'
    (tmp_path / "ball.usda").write_text(stage)
    scene = compiled('usd("ball.usda", translate: [0, 3, 0])\ncamera([0,0,5])\nsun()')
    t = scene.tables
    m = t.transforms.matrix[t.instances.transform[0]]
    half = t.geometries.parameters[0, 0] * m[0, 0]
    assert half == pytest.approx(0.5)
    assert m[:, 3].tolist() == [0, 3, 0]


def test_a_saved_scene_is_a_scene(hello: Path, tmp_path: Path) -> None:
    scene = load.load(hello)
    serialize.save(scene, tmp_path / "hello.npz")
    again = load.load(tmp_path / "hello.npz")
    assert serialize.content_hash(again) == serialize.content_hash(scene)
    assert dump.text(again) == dump.text(scene)
    assert again.params == scene.params


KNOWN = ".scene, .usd, .usda, .usdc, .usdz, .mtlx, .obj, .ply, .stl, .glb, .gltf, .off, .3mf, .xyz, .npz"


VARIANT = StageOptions(variants={"/a:b": "c"})


@pytest.mark.parametrize(
    ("name", "text", "more", "expected"),
    [
        ("a.scnee", "x", {}, [("`a.scnee` is not a known kind of scene", "did you mean `.scene`?")]),
        ("a.zzz", "x", {}, [("`a.zzz` is not a known kind of scene", f"scenes are {KNOWN}")]),
        ("a.fbx", "x", {}, [("`a.fbx` is not a known kind of scene", "Blender imports it, and exports .glb or .usdc")]),
        ("a.npz", "x", {}, [("cannot read the saved scene: it is damaged, or something else", "")]),
        ("a.obj", "v 0 0 0", {"sets": {"n": "1"}}, [("there is no param `n`: only .scene files have params", "leave out --set")]),
        ("a.obj", "v 0 0 0", {"time": 1.0}, [("nothing moves in this kind of file: it has no time", "leave out --time")]),
        ("a.scene", "sphere(1)", {"stage": VARIANT}, [("only USD stages have variants", "leave out --variant")]),
    ],
)
def test_refusals(tmp_path: Path, name: str, text: str, more: dict, expected: list) -> None:
    (tmp_path / name).write_text(text)
    found = refused(tmp_path / name, **more)
    assert found[: len(expected)] == expected


def test_a_missing_scene(tmp_path: Path) -> None:
    (tmp_path / "hello.scene").write_text("sphere(1)")
    assert refused(tmp_path / "helo.scene") == [("there is no scene `helo.scene`", "did you mean `hello.scene`?")]
    (tmp_path / "d.scene").mkdir()
    assert refused(tmp_path / "d.scene") == [("`d.scene` is a folder, not a scene", "")]


def test_a_binary_scene_and_an_empty_one(tmp_path: Path) -> None:
    (tmp_path / "b.scene").write_bytes(bytes(range(256)))
    assert refused(tmp_path / "b.scene") == [("`b.scene` is not a text file", "")]
    (tmp_path / "z.scene").write_bytes(b"sphere(1)\nsun()\ncamera([0, 1, 5])\n\0\n")
    found = Diagnostics()
    with pytest.raises(SceneError):
        load.load(tmp_path / "z.scene", diagnostics=found)
    assert [(str(d.span), d.message, d.hint) for d in found.items] == [
        (f"{tmp_path}/z.scene:4:1", "the language has no invisible character U+0000", "delete it")
    ]
    (tmp_path / "e.scene").write_text("")
    found = Diagnostics()
    scene = load.load(tmp_path / "e.scene", diagnostics=found)
    assert [d.message for d in found.items] == ["there is nothing to draw: the picture will be empty"]
    assert len(scene.tables.cameras.extent) == 1


def test_a_file_that_uses_itself(said, tmp_path: Path) -> None:
    (tmp_path / "b.scene").write_text('use "a.scene"\nsphere(1)\n')
    first = said('use "b.scene"\nb()\ncamera([0,0,5])\nsun()\n').splitlines()[0]
    assert first == "b.scene:1:5: error: a.scene uses itself: a.scene → b.scene → a.scene"


def test_a_used_file_must_be_there_and_inside(said) -> None:
    assert said('use "c.scene"\nsphere(1)\n').splitlines()[0] == "a.scene:1:5: error: there is no scene `c.scene`"
    assert said('use "../c.scene"\nsphere(1)\n').splitlines()[0] == "a.scene:1:5: error: `../c.scene` lies outside of the scene's folder"
    assert said('use "std/rom"\nsphere(1)\n').splitlines() == [
        "a.scene:1:5: error: the library has no `std/rom`",
        '   1 | use "std/rom"',
        "     |     ^^^^^^^^^ did you mean `std/room`?",
    ]


def test_allow_opens_a_folder(compiled, tmp_path: Path) -> None:
    shared = tmp_path.parent / f"{tmp_path.name}-shared"
    shared.mkdir()
    (shared / "ball.scene").write_text("sphere(3)\n")
    scene = compiled(f'use "../{shared.name}/ball.scene"\nball()\ncamera([0,0,5])\nsun()', allow=[shared])
    assert scene.tables.geometries.parameters[0, 0] == 3
    assert str(shared / "ball.scene") in scene.files


def test_errors_of_every_stage_come_together(said) -> None:
    text = 'sphere(radios: 1)\nquadric([1])\nbox(1, material: lambert(image("x.png")))\nsphere(\n'
    lines = [line for line in said(text).splitlines() if ": error: " in line]
    assert len(lines) == 4
    assert lines[0].startswith("a.scene:1:8: error: sphere has no `radios`")
    assert lines[1] == "a.scene:2:1: error: a quadric has the ten coefficients A … J, got 1"
    assert lines[2] == "a.scene:3:26: error: there is no picture `x.png`"


def test_no_two_tables_share_memory_that_can_be_written(hello: Path) -> None:
    scene = load.load(hello)
    arrays = [column for name in ir.TABLES for column in getattr(scene.tables, name)]
    assert not any(a.flags.writeable for a in arrays)
    with pytest.raises(ValueError, match="read-only"):
        np.asarray(arrays[0])[...] = 0


LARGE = """box(size: [200, 2, 20])
point([100, 200, 100], flux: 800lm)
camera([0, 150, 500], look_at: [0, 50, 0])
"""


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (LARGE, ["the scene is 200 m across: lengths without a unit are in metres"]),
        (LARGE.replace("200, 2", "99, 2"), []),
        ("unit m\n" + LARGE, []),
        ("unit cm\n" + LARGE, []),
        (LARGE.replace("200, 2", "200m, 2"), []),
        ("plane(y: 0)\n" + LARGE.replace("box(size: [200, 2, 20])", "sphere(1)"), []),
        (LARGE.replace("150, 500", "20, 40"), []),  # as a wide floor
        ("camera([0, 0, 5])\nsun()", []),
    ],
)
def test_a_scene_of_the_size_of_a_town(tmp_path: Path, text: str, told: list[str]) -> None:
    path = tmp_path / "a.scene"
    path.write_text(text)
    diagnostics = Diagnostics()
    load.load(path, diagnostics=diagnostics)
    assert [d.message for d in diagnostics.items if "across" in d.message] == told
