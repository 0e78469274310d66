"""The public door: load, render and compare from Python, as the package's own docstring shows them."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

import re
import warnings
from pathlib import Path

import maquette
import numpy as np
import pytest
import trimesh
from click.testing import CliRunner
from maquette.cli.main import cli
from maquette.compiler.plan.plan import PlanError
from maquette.lang.diagnostics import Diagnostics, SceneError, SceneWarning, sort_diagnostics
from maquette.render.image import image_files, image_reader
from maquette.render.image.image import Image
from PIL import Image as pillow
from pxr import Usd, UsdGeom

SCENE = """\
param radius = 1 in 0.2..2
sphere(radius, material: lambert(#d0402a))
point([2, 4, 3], intensity: 20)
camera(position: [0, 0, 5], look_at: [0, 0, 0], fov: 35deg)
render(size: [32, 24], samples: 1)
"""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    (tmp_path / "a.scene").write_text(SCENE, encoding="utf-8")
    return tmp_path / "a.scene"


def test_load_then_render(path: Path) -> None:
    scene = maquette.load(path, sets={"radius": "0.5"})
    assert [param.value for param in scene.params] == [0.5]
    image = maquette.render(scene, size=(16, 12), backend="reference", aov=("depth",))
    assert isinstance(image, Image)
    assert (image.width, image.height) == (16, 12)
    assert image.channels["depth"][6, 8, 0] == pytest.approx(4.5, rel=1e-2)


PARAMS = """\
param radius = 1m in 10cm..2m
param paint: color = #ffffff
param at = [0, 0, 0]
param round = false
param label = "a"
sphere(if round then radius else 2 * radius, center: at, material: lambert(paint), name: label)
"""


def test_params_are_python_values(tmp_path: Path) -> None:
    path = tmp_path / "b.scene"
    path.write_text(PARAMS, encoding="utf-8")
    given = {"radius": np.float32(0.25), "paint": "#ff0000", "at": np.array([1.0, -2.0, 1e-6]), "round": True, "label": "ball"}
    scene = maquette.load(path, **given)
    assert scene.names.instances == ("ball",)
    assert scene.tables.geometries.parameters[0, 0] == 0.25
    assert scene.tables.transforms.matrix[scene.tables.instances.transform[0], :, 3].tolist() == [1.0, -2.0, 1e-6]
    assert maquette.load(path, radius="20cm", round=True).tables.geometries.parameters[0, 0] == pytest.approx(0.2)
    with pytest.raises(SceneError) as error:
        maquette.load(path, radios=1)
    assert error.value.diagnostics[0].message == "the scene has no param `radios`; did you mean `radius`?"


def test_the_text_of_a_scene(tmp_path: Path) -> None:
    (tmp_path / "part.scene").write_text("sphere(0.5)\n", encoding="utf-8")
    scene = maquette.load_text('use "part.scene"\nparam n: int = 2\nfor (k in 1..n) { part() }\n', tmp_path, n=3)
    assert len(scene.tables.instances.geometry) == 3
    assert not (tmp_path / "text.scene").exists()
    with pytest.raises(SceneError) as error:
        maquette.load_text("sphere(1,\n")
    assert [(str(d.span.file), d.span.line) for d in error.value.diagnostics if d.span] == [("text.scene", 1)]


def test_render_takes_a_file_and_overrides(path: Path) -> None:
    first = maquette.render(path, backend="reference")
    second = maquette.render(str(path), backend="reference", plan={"shadows": "off"})
    assert maquette.compare(first, second).error == 0.0  # one ball alone: nothing stands in its light but itself
    with pytest.raises(PlanError, match="no decision is called `shadow`"):
        maquette.render(path, plan={"shadow": "off"})


def test_what_is_wrong_is_raised_whole(path: Path) -> None:
    path.write_text("sphere(radius: 1, colour: #ff0000)\nspher(1)\n", encoding="utf-8")
    with pytest.raises(SceneError) as error:
        maquette.load(path)
    assert [d.span.line for d in sort_diagnostics(error.value.diagnostics) if d.span] == [1, 2]


def test_warnings_are_handed_over(path: Path) -> None:
    found = Diagnostics()
    maquette.load(path, diagnostics=found)
    assert found.items == []


def test_the_name_render_is_the_function() -> None:
    from maquette.render import render_scene

    assert callable(maquette.render)
    assert callable(render_scene.draw)


def test_an_image_is_an_array_and_says_what_it_is(path: Path) -> None:
    image = maquette.render(path, backend="reference", aov=("depth",))
    pixels = np.asarray(image)
    assert pixels.dtype == np.float32
    np.testing.assert_array_equal(pixels, image.channels["rgba"])
    assert np.asarray(image, dtype=np.float64).dtype == np.float64
    assert repr(image) == "<Image 32x24, reference, 1 samples a pixel, channels rgba depth>"
    assert image._repr_png_().startswith(b"\x89PNG")


def test_an_image_is_saved_by_its_name(path: Path, tmp_path: Path) -> None:
    image = maquette.render(path, backend="reference", aov=("depth",))
    image.save(tmp_path / "a.exr")
    image.save(str(tmp_path / "a.png"), exposure=1, bits=16)
    linear = image_reader.read(tmp_path / "a.exr")
    np.testing.assert_array_equal(linear.channels["depth"], image.channels["depth"])
    shown = image_reader.read(tmp_path / "a.png")
    covered = image.channels["rgba"][..., 3] == 1
    twice = np.minimum(2 * image.channels["rgba"][covered][:, :3], 1)
    assert shown.channels["rgba"][covered][:, :3] == pytest.approx(twice, abs=1e-3)
    with pytest.raises(image_files.FormatError, match=r"cannot tell the picture format of a\.what"):
        image.save("a.what")


@pytest.mark.long
def test_the_page_on_python_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    root = Path(maquette.__file__).resolve().parent
    (tmp_path / "examples").symlink_to(root / "examples")
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for block in re.findall(r"```python\n(.*?)```", (root / "docs/python.md").read_text(encoding="utf-8"), re.DOTALL):
        exec(block, names)
    printed = capsys.readouterr().out.splitlines()
    assert printed[0] == "<Image 160x120, ray, 4 samples a pixel, channels rgba>"
    assert (tmp_path / "hello.png").is_file()


def test_a_scene_draws_itself(path: Path) -> None:
    scene = maquette.load(path)
    assert repr(scene) == f"<Scene {scene.name}, 1 instance, 1 light, 1 camera>"
    image = scene.render(size=(16, 12), backend="reference")
    np.testing.assert_array_equal(np.asarray(image), np.asarray(maquette.render(path, size=(16, 12), backend="reference")))


def test_an_open_stage_and_trimesh_objects_are_scenes(tmp_path: Path) -> None:
    """A cube of 2 m as each: the same bounds, and the depth of its front in the middle."""
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    stage.SetDefaultPrim(UsdGeom.Cube.Define(stage, "/cube").GetPrim())
    camera = UsdGeom.Camera.Define(stage, "/main_cam")
    UsdGeom.XformCommonAPI(camera).SetTranslate((0, 0, 5))
    image = maquette.load(stage).render(size=(16, 12), samples=1, backend="reference", aov=("depth",))
    assert image.channels["depth"][6, 8, 0] == pytest.approx(4.0)
    box = trimesh.creation.box((2, 2, 2))
    for source in (box, trimesh.Scene([box])):
        scene = maquette.load(source)
        assert len(scene.tables.pools.triangles) == 12
        assert np.ptp(scene.tables.pools.positions, axis=0).tolist() == [2, 2, 2]
    with pytest.raises(TypeError, match=r"load takes a file, a pxr\.Usd\.Stage, or a mesh or scene of trimesh, not builtins\.int"):
        maquette.load(3)


def test_textures_of_an_open_stage_are_found(tmp_path: Path) -> None:
    """A picture beside the layer, named relative to it, or elsewhere: the program chose the stage."""
    pillow.new("RGB", (4, 4), (255, 0, 0)).save(tmp_path / "red.png")
    scene = tmp_path / "a.scene"
    scene.write_text('box(1, material: lambert(image("red.png")))\ncamera(position: [0, 0, 5], look_at: [0, 0, 0])\n', encoding="utf-8")
    assert CliRunner().invoke(cli, ["convert", str(scene), str(tmp_path / "a.usda")]).exit_code == 0
    loaded = maquette.load(Usd.Stage.Open(str(tmp_path / "a.usda")))
    assert len(loaded.tables.images.width) == 1
    (tmp_path / "sub").mkdir()
    (tmp_path / "a.usda").rename(tmp_path / "sub" / "a.usda")
    text = (tmp_path / "sub" / "a.usda").read_text(encoding="utf-8")
    (tmp_path / "sub" / "b.usda").write_text(text.replace("@./", "@../"), encoding="utf-8")
    assert len(maquette.load(Usd.Stage.Open(str(tmp_path / "sub" / "b.usda"))).tables.images.width) == 1


# --- params, settings and warnings ---


def test_render_and_sweep_take_params_as_load_does(path: Path) -> None:
    assert maquette.render(path, radius=0.5, size=(8, 6), backend="raster").width == 8
    found = maquette.sweep(path, radius=[0.5, 1.5], size=(8, 6), backend="raster", sets={})
    assert [picture.values for picture in found] == [{"radius": 0.5}, {"radius": 1.5}]
    covered = [float(np.asarray(picture.image)[..., 3].sum()) for picture in found]
    assert covered[0] < covered[1]
    assert len(maquette.sweep(path, radius=np.array([0.5, 1.5]), size=(4, 3), backend="raster")) == 2
    with pytest.raises(ValueError, match=r"^no param has several values: write maquette\.sweep\(file, radius=\[0\.4, 0\.8, 1\.6\]\)$"):
        maquette.sweep(path, radius=0.5)


def test_names_that_are_neither_params_nor_settings(path: Path) -> None:
    with pytest.raises(SceneError) as error:
        maquette.render(path, sample=4)
    assert error.value.diagnostics[0].message == "the scene has no param `sample`"
    assert error.value.__notes__ == ["nor has render a setting `sample`; did you mean `samples`?"]
    scene = maquette.load(path)
    with pytest.raises(TypeError) as misspelt:
        scene.render(sample=4)
    assert str(misspelt.value) == (
        "render has no setting `sample`; did you mean `samples`?: it has size, backend, samples, error, budget, bounces, seed, filter, "
        "background, crop, aov, exposure, view, white, bloom, working_space, ocio, display, look, camera, threads, denoise, tolerance"
    )
    with pytest.raises(TypeError) as refused:
        maquette.render(scene, radius=0.4)
    message = "`radius` is a param of this scene, which is compiled: give it to maquette.load, or to render with the file"
    assert str(refused.value) == message


@pytest.mark.parametrize("paint", [[1, 0.5, 0], (1.0, 0.5, 0.0), np.array([1, 0.5, 0], np.float32), "rgb(1, 0.5, 0)"])
def test_a_colour_is_a_list_of_three_linear_numbers(tmp_path: Path, paint: object) -> None:
    path = tmp_path / "b.scene"
    path.write_text(PARAMS, encoding="utf-8")
    scene = maquette.load(path, paint=paint)
    assert scene.tables.materials.values[0, 1].tolist() == [1.0, 0.5, 0.0]
    assert [param.value for param in scene.params if param.name == "paint"] == [(1.0, 0.5, 0.0)]


@pytest.mark.parametrize("paint", [[1, 0.5], [1, 0.5, 0, 1], [1, -1, 0], ["a", 1, 1]])
def test_other_lists_are_no_colours(tmp_path: Path, paint: list) -> None:
    path = tmp_path / "b.scene"
    path.write_text(PARAMS, encoding="utf-8")
    with pytest.raises(SceneError):
        maquette.load(path, paint=paint)


def test_a_list_is_no_colour_inside_of_a_scene(tmp_path: Path) -> None:
    (tmp_path / "part.scene").write_text("param paint: color = #ffffff\nsphere(1, material: lambert(paint))\n", encoding="utf-8")
    with pytest.raises(SceneError) as error:
        maquette.load_text('use "part.scene"\npart(paint: [1, 0, 0])\n', tmp_path)
    assert error.value.diagnostics[0].message == "expected colour, got a list of 3"


def test_warnings_and_notes_reach_python(path: Path) -> None:
    path.write_text(SCENE + "let unused = 3\n", encoding="utf-8")
    with pytest.warns(SceneWarning, match=r"a\.scene:6:5: `unused` is never used"):
        scene = maquette.load(path)
    assert [(told.severity, told.message) for told in scene.diagnostics] == [("warning", "`unused` is never used")]
    found = Diagnostics()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        maquette.load(path, diagnostics=found)
    assert [told.message for told in found.items] == ["`unused` is never used"]


def test_notes_about_a_picture_reach_python(path: Path) -> None:
    black = "sphere(1, material: lambert(0))\nsky(luminance: 0)\ncamera([0, 0, 5])\nrender(size: [8, 6], samples: 1)\n"
    path.write_text(black, encoding="utf-8")
    image = maquette.render(path, backend="raster")
    assert "the picture is black: no light reaches what the camera sees" in [told.message for told in image.diagnostics]
