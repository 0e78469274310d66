"""√relMSE and differences with known answers, and the `compare` command on files."""

from __future__ import annotations

import json
import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import maquette
import numpy as np
import OpenImageIO as oiio
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from maquette.cli import terminal
from maquette.cli.main import cli
from maquette.render.image import image_files, image_reader, metrics
from maquette.render.image.image import Image
from PIL import Image as Pictures

PIXELS = arrays.arrays(np.float32, (3, 4, 3), elements=st.floats(0, 1000, width=32))


def flat(value: float, width: int = 4, height: int = 3) -> np.ndarray:
    return np.full((height, width, 3), value)


def saved(path: Path, rgb: np.ndarray) -> Path:
    rgba = np.concatenate([rgb, np.ones_like(rgb[..., :1])], axis=2).astype(np.float32)
    image_files.write(Image(rgb.shape[1], rgb.shape[0], {"rgba": rgba}, {}), path, image_files.Look(), {"version": "0"})
    return path


def run(*arguments: object) -> tuple[int, str, str]:
    done = CliRunner().invoke(cli, [str(a) for a in arguments])
    return done.exit_code, done.stdout, done.stderr


def test_a_constant_factor_is_the_relative_error() -> None:
    expected = 0.1 / np.sqrt(1 + 0.01**2)  # ε is 1 % of the reference's luminance, here 2
    assert metrics.root_relmse(flat(2.2), flat(2.0)) == pytest.approx(expected, rel=1e-12)


def test_dark_pixels_are_measured_against_one_percent_of_the_mean() -> None:
    reference = flat(0.0)
    reference[0, 0] = 12.0  # one pixel of twelve: the mean luminance is 1, ε = 0.01
    image = reference.copy()
    image[1, 1] = 0.01
    assert metrics.root_relmse(image, reference) == pytest.approx(np.sqrt(1 / 12), rel=1e-6)


def test_it_is_relative_to_the_second_picture() -> None:
    assert metrics.root_relmse(flat(1.0), flat(2.0)) == pytest.approx(0.5, rel=1e-3)
    assert metrics.root_relmse(flat(2.0), flat(1.0)) == pytest.approx(1.0, rel=1e-3)


@pytest.mark.long
@given(PIXELS)
def test_a_picture_is_no_distance_from_itself(image: np.ndarray) -> None:
    found = metrics.difference(image, image)
    assert (found.error, found.maximum, found.differing) == (0.0, 0.0, 0)


@pytest.mark.long
@given(PIXELS, PIXELS, st.integers(-40, 40))
def test_scaling_both_changes_nothing(image: np.ndarray, reference: np.ndarray, power: int) -> None:
    a, b = image.astype(float), reference.astype(float)
    assert metrics.root_relmse(a * 2.0**power, b * 2.0**power) == pytest.approx(metrics.root_relmse(a, b), rel=1e-9)


def test_the_largest_difference_and_its_pixel() -> None:
    image = flat(1.0)
    image[2, 3, 1] = 4.0
    image[0, 1, 0] = 0.5
    found = metrics.difference(image, flat(1.0))
    assert (found.maximum, found.at, found.differing, found.pixels) == (3.0, (3, 2), 2, 12)


def test_endless_and_undefined_pixels() -> None:
    image, reference = flat(1.0), flat(1.0)
    image[0, 0] = reference[0, 0] = np.inf
    image[0, 1] = reference[0, 1] = np.nan
    assert metrics.difference(image, reference).error == 0.0
    image[1, 1] = np.nan
    found = metrics.difference(image, reference)
    assert (found.error, found.maximum, found.at) == (np.inf, np.inf, (1, 1))


def test_black_references() -> None:
    assert metrics.root_relmse(flat(0.0), flat(0.0)) == 0.0
    assert metrics.root_relmse(flat(1.0), flat(0.0)) == np.inf


def test_false_colours_are_white_red_and_blue() -> None:
    image = flat(1.0)
    image[0, 0], image[0, 1] = 2.0, 0.0
    colours = metrics.false_colour(image, flat(1.0), full=1.0)
    assert colours[0, 0].tolist() == pytest.approx([1, 0, 0], abs=1e-6)
    assert colours[0, 1].tolist() == pytest.approx([0, 0, 1], abs=1e-6)
    assert colours[1, 1].tolist() == [1, 1, 1]


def test_the_public_compare_takes_files_and_pictures(tmp_path: Path) -> None:
    a, b = saved(tmp_path / "a.exr", flat(1.1)), saved(tmp_path / "b.exr", flat(1.0))
    assert maquette.compare(a, image_reader.read(b)).error == pytest.approx(0.1, rel=1e-3)


def test_the_command_prints_figures(tmp_path: Path) -> None:
    image = flat(1.0)
    image[2, 3] = 1.5
    a, b = saved(tmp_path / "a.exr", image), saved(tmp_path / "b.exr", flat(1.0))
    code, out, err = run("compare", a, b)
    assert (code, err) == (0, "")
    assert (
        out
        == f"""\
A  {a}
B  {b}
√relMSE     0.14433 (14.4330%)
blocks      0.0416646 (4.1665%): √relMSE of means over 4 × 4 pixels
FLIP        0
maximum     0.5 at pixel 3,2
bias        red +4.17%, green +4.17%, blue +4.17%
silhouette  0 pixels apart
differing   1 of 12 pixels
"""
    )


def test_the_threshold_decides_the_exit_code(tmp_path: Path) -> None:
    a, b = saved(tmp_path / "a.exr", flat(1.02)), saved(tmp_path / "b.exr", flat(1.0))
    assert [run("compare", a, b, "--threshold", t)[0] for t in ("3%", "0.03", "1%", "0")] == [0, 0, 1, 1]
    assert run("compare", b, b, "--threshold", "0")[0] == 0


def test_pngs_are_compared_in_linear_light(tmp_path: Path) -> None:
    a, b = saved(tmp_path / "a.png", flat(0.5)), saved(tmp_path / "b.exr", flat(0.5))
    code, out, _ = run("compare", a, b, "--threshold", "1%")
    assert code == 0, out


def test_the_difference_picture(tmp_path: Path) -> None:
    image = flat(1.0)
    image[0, 0], image[2, 3] = 1.5, 0.5
    a, b = saved(tmp_path / "a.exr", image), saved(tmp_path / "b.exr", flat(1.0))
    assert run("compare", a, b, "-o", tmp_path / "d.exr")[0] == 0
    signed = image_reader.read(tmp_path / "d.exr").channels["rgba"]
    assert (signed[0, 0, 0], signed[2, 3, 0], signed[1, 1, 0]) == (0.5, -0.5, 0.0)
    assert run("compare", a, b, "-o", tmp_path / "d.png")[0] == 0
    colours = image_reader.read(tmp_path / "d.png").channels["rgba"]
    assert colours[0, 0, :3].tolist() == [1, 0, 0]
    assert colours[2, 3, :3].tolist() == [0, 0, 1]
    assert colours[1, 1, :3].tolist() == [1, 1, 1]


def test_sizes_that_differ(tmp_path: Path) -> None:
    a, b = saved(tmp_path / "a.exr", flat(1.0)), saved(tmp_path / "b.exr", flat(1.0, width=5))
    said = f"sizes differ: {a} is 4x3 and {b} is 5x3 pixels; render both with the same --size"
    assert run("compare", a, b) == (1, "", f"Error: {said}\n")


def test_a_file_that_is_no_picture(tmp_path: Path) -> None:
    a, text = saved(tmp_path / "a.exr", flat(1.0)), tmp_path / "notes.txt"
    text.write_text("not a picture\n", encoding="utf-8")
    code, out, err = run("compare", a, text)
    assert (code, out) == (1, "")
    assert err.startswith(f"Error: {text} is not a picture: ")
    assert run("compare", a, tmp_path / "none.exr")[0] == 2


def cut_off(path: Path) -> Path:
    """A JPEG whose second half is missing."""
    noise = np.random.default_rng(1).integers(0, 256, (48, 64, 3)).astype(np.uint8)
    Pictures.fromarray(noise).save(path)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    return path


def animated(path: Path) -> Path:
    """A picture with two frames."""
    first, other = (Pictures.new("RGB", (64, 48), color) for color in ("#ff0000", "#00ff00"))
    first.save(path, save_all=True, append_images=[other])
    return path


def without_colors(path: Path) -> Path:
    """An EXR with a layer of colours, which is not the first."""
    spec = oiio.ImageSpec(64, 48, 4, "float")
    spec.channelnames = ("Z", "beauty.R", "beauty.G", "beauty.B")
    out = oiio.ImageOutput.create(str(path))
    assert out is not None
    assert out.open(str(path), spec)
    assert out.write_image(np.tile(np.array([9, 0.25, 0.5, 1], np.float32), (48, 64, 1)))
    out.close()
    return path


FAULTY = [
    (
        cut_off, "a.jpg", "the picture `{}` is cut off: its file ends early",
        "the missing part is read grey or blurred: copy or write the file again",
    ),
    (animated, "a.gif", "the picture `{}` has 2 frames: the first is read", "to read another, write it to a file of its own"),
    (
        without_colors, "a.exr",
        "the picture `{}` has no channels R, G and B: `beauty.R`, `beauty.G` and `beauty.B` are read as red, green and blue",
        "name the channels to read R, G and B",
    ),
]  # fmt: skip


@pytest.mark.parametrize(("make", "name", "message", "hint"), FAULTY)
def test_what_of_a_picture_is_not_read_is_told(tmp_path: Path, make: Any, name: str, message: str, hint: str) -> None:
    a, b = make(tmp_path / name), saved(tmp_path / "b.exr", flat(1.0, 64, 48))
    said = message.format(a)
    assert run("compare", a, b)[::2] == (0, f"warning: {said}\n  {hint}\n")
    assert run("compare", b, a)[::2] == (0, f"warning: {said}\n  {hint}\n")
    with pytest.warns(UserWarning, match=f"^{re.escape(said)}; {re.escape(hint)}$"):
        maquette.compare(a, b)


def test_colors_of_a_layer_are_compared(tmp_path: Path) -> None:
    rgba = image_reader.read(without_colors(tmp_path / "a.exr")).channels["rgba"]
    assert rgba[5, 7].tolist() == [0.25, 0.5, 1, 1]


SCENE = """\
param size = 1
sphere(0.5 * size, center: [-0.7, 0, 0], material: lambert(#c04030), name: "ball")
box(0.9, center: [0.8, 0, 0], material: MATERIAL)
directional(from: [1, 2, 3], illuminance: 3)
camera(position: [0, 0, 5], look_at: [0, 0, 0], fov: 30deg)
render(size: [32, 24], samples: 1)
"""


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """two.scene in the folder the command runs in."""
    monkeypatch.chdir(tmp_path)
    Path("two.scene").write_text(SCENE.replace("MATERIAL", "lambert(#3060c0)"), encoding="utf-8")
    return Path("two.scene")


def figures(*arguments: object) -> dict[str, Any]:
    code, out, err = run("compare", *arguments, "--json")
    assert (code, err) == (0, ""), err
    return json.loads(out)


BOTH = """\
A  two.scene, raster, 1 sample, seed 0
B  two.scene, reference, 1 sample, seed 0
√relMSE     0 (0.0000%)
blocks      0 (0.0000%): √relMSE of means over 4 × 4 pixels
FLIP        0
maximum     0 at pixel 0,0
bias        red 0%, green 0%, blue 0%
silhouette  0 pixels apart
differing   0 of 768 pixels
noise       A none, B none (estimated √relMSE of each)
"""


def test_one_scene_on_two_backends(scene: Path) -> None:
    assert run("compare", scene, "--backends", "raster,reference") == (0, BOTH, "")


def test_options_of_one_side_alone(scene: Path) -> None:
    found = figures(scene, "--backends", "ray:samples=2:seed=3:filter=box,ray:samples=8", "--bounces", "1")
    plans = [found[side]["plan"] for side in "ab"]
    assert [(p["samples"], p["seed"], p["filter"], p["bounces"]) for p in plans] == [(2, 3, "box", 1), (8, 0, "gaussian", 1)]
    assert found["noise"]["shared"] is False
    code, out, _ = run("compare", scene, "--backends", "ray:filter=box,ray")
    assert out.splitlines()[0] == "A  two.scene filter=box, ray, 1 sample, seed 0"
    assert code == 0


def test_a_scene_against_a_picture_is_drawn_at_its_size(scene: Path) -> None:
    run("render", scene, "-o", "whole.exr", "--size", "20x16", "-q")
    run("render", scene, "-o", "part.exr", "--size", "20x16", "--crop", "4,2,12,10", "-q")
    for name, size in (("whole.exr", [20, 16]), ("part.exr", [8, 8])):
        found = figures(scene, name)
        assert (found["relmse"], found["a"]["size"]) == (0.0, size)
    assert figures("whole.exr", scene)["relmse"] == 0.0


def test_two_versions_of_a_scene(scene: Path) -> None:
    Path("other.scene").write_text(scene.read_text().replace("lambert(#3060c0)", "lambert(#304090)"), encoding="utf-8")
    code, out, _ = run("compare", scene, "other.scene")
    assert code == 0
    head, _, changes = out.partition("\n\nchanges from A to B\n")
    ambient = "[0.029557 0.11697 0.52712] → [0.029557 0.051269 0.27889]"
    assert changes == f"  changed material lambert other.scene:3:41: ambient {ambient}; diffuse {ambient}\n"
    table = head.partition("\n\n")[2].splitlines()
    assert [line.split("  ")[0] for line in table] == ["object at the pixel's centre", "box other.scene:3:1"]
    assert table[1].split()[2] == "100%"


def test_params_and_moments_are_of_both(scene: Path) -> None:
    found = figures(scene, "two.scene", "--set", "size=0.8")
    assert found["relmse"] == 0.0
    text = scene.read_text().replace("0.5 * size", "0.4")
    Path("small.scene").write_text(text, encoding="utf-8")
    assert figures(scene, "small.scene", "--set", "size=0.8")["relmse"] == 0.0


def test_features_that_a_backend_lacks(scene: Path) -> None:
    scene.write_text(SCENE.replace("MATERIAL", "glass(ior: 1.4)"), encoding="utf-8")
    code, out, _ = run("compare", scene, "--backends", "raster,ray")
    assert code == 0
    told = "raster draws glass without refraction: the sky and the ground's mean light show (two.scene:3:41)"
    assert out.endswith(f"\nnot rendered\n  A: {told}\n")
    (note,) = figures(scene, "--backends", "raster,ray")["a"]["not_drawn"]
    assert note["span"]["line"] == 3


def test_json_has_every_figure(scene: Path) -> None:
    found = figures(scene, "--backends", "ray:samples=4,ray:samples=4:seed=1")
    assert set(found) == {
        "a", "b", "relmse", "blocks", "flip", "maximum", "at", "at_object", "differing", "pixels", "silhouette", "exposure", "bias",
        "bias_standard_error", "bias_significance", "biased", "noise", "within_noise", "outline", "interior", "objects", "changes",
    }  # fmt: skip
    assert found["outline"]["pixels"] + found["interior"]["pixels"] == found["pixels"] == 32 * 24
    assert sum(row["share"] for row in found["objects"]) == pytest.approx(1.0)
    assert {row["label"] for row in found["objects"]} == {"sphere `ball`", "box", "background"}
    assert {row["place"] for row in found["objects"]} == {"two.scene:2:1", "two.scene:3:1", ""}
    a, b = (maquette.render("two.scene", samples=4, seed=seed) for seed in (0, 1))
    assert found["relmse"] == maquette.compare(a, b).error
    assert found["a"]["noise"] == pytest.approx(a.metadata["error"])


@pytest.mark.parametrize(
    ("metric", "said"),
    [
        ("relmse", "√relMSE is 50%, above the threshold of 1%\n"),
        ("blocks", "√relMSE of 4 × 4 blocks is 50%, above the threshold of 1%\n"),
        ("flip", "FLIP is 53.1%, above the threshold of 1%\n"),
        ("maximum", "the maximum is 0.5, above the threshold of 0.01\n"),
        ("bias", "the bias is 50%, above the threshold of 1%\n"),
    ],
)
def test_any_metric_may_decide(tmp_path: Path, metric: str, said: str) -> None:
    a, b = saved(tmp_path / "a.exr", flat(0.5)), saved(tmp_path / "b.exr", flat(1.0))
    code, out, err = run("compare", a, b, "--metric", metric, "--threshold", "1%")
    assert (code, err) == (1, said)
    assert out.startswith(f"A  {a}\nB  {b}\n")
    assert run("compare", a, b, "--metric", metric, "--threshold", "0.9")[0] == 0


def test_noise_may_decide(scene: Path) -> None:
    """A difference within the noise passes, a larger one fails; unknown noise is reported."""
    soft = SCENE.replace("MATERIAL", "lambert(#3060c0)") + "sky(luminance: 0.5)\n"
    scene.write_text(soft, encoding="utf-8")
    Path("dim.scene").write_text(soft.replace("illuminance: 3", "illuminance: 2.8"), encoding="utf-8")
    alike = [scene, "--backends", "ray:samples=16,ray:samples=16:seed=1", "--threshold", "4"]
    unlike = ["dim.scene", scene, "--samples", "16", "--threshold", "4"]
    for metric in ("noise", "significance"):
        assert run("compare", *alike, "--metric", metric)[0] == 0
    code, _, err = run("compare", *unlike, "--metric", "significance")
    assert code == 1
    assert err.startswith("the difference of the means in standard errors is ")
    assert err.endswith(", above the threshold of 4\n")
    saved(Path("a.exr"), flat(1.0))
    for metric, said in (
        ("noise", "the noise of a.exr is unknown: only a render with several samples has it"),
        ("significance", "the variance of a.exr is unknown: only a render with several samples has it: compare scenes"),
    ):
        assert run("compare", "a.exr", "a.exr", "--metric", metric, "--threshold", "1")[2] == f"Error: {said}; choose another --metric\n"


def test_nan_is_above_every_threshold(tmp_path: Path) -> None:
    image = flat(1.0)
    image[0, 0] = np.nan
    a, b = saved(tmp_path / "a.exr", image), saved(tmp_path / "b.exr", flat(1.0))
    for metric in ("relmse", "maximum", "bias"):
        assert run("compare", a, b, "--metric", metric, "--threshold", "100")[0] == 1
    assert json.loads(run("compare", a, b, "--json")[1])["relmse"] is None


def test_a_picture_without_alpha_has_no_silhouette(tmp_path: Path) -> None:
    a, b = saved(tmp_path / "a.png", flat(0.5)), saved(tmp_path / "b.exr", flat(0.5))
    said = f"Error: {a} has no alpha channel, which the silhouette needs: compare an .exr; choose another --metric\n"
    assert run("compare", a, b, "--metric", "silhouette", "--threshold", "1")[2] == said


def test_side_by_side(scene: Path) -> None:
    """Three enlarged panels with labels; the third is red where A is brighter."""
    image = image_reader.read(drawn_to(scene, "a.exr")).channels["rgba"][..., :3].copy()
    image[20:, 28:] += 0.5
    saved(Path("b.exr"), image)
    assert run("compare", "b.exr", "a.exr", "-o", "both.png", "--side-by-side")[0] == 0
    sheet = image_reader.read(Path("both.png")).channels["rgba"][..., :3]
    times, strip, gap = 8, 22, 4
    assert sheet.shape == (24 * times + strip, 3 * 32 * times + 2 * gap, 3)
    panels = [sheet[strip:, k * (32 * times + gap) :][:, : 32 * times] for k in range(3)]
    np.testing.assert_allclose(
        panels[1][::times, ::times], np.clip(image_reader.read(Path("a.exr")).channels["rgba"][..., :3], 0, 1), atol=0.01
    )
    np.testing.assert_allclose(panels[2][-1, -1], [1, 0, 0], atol=1e-6)
    np.testing.assert_allclose(panels[2][0, 0], [1, 1, 1], atol=1e-6)
    for k in range(3):
        assert sheet[:strip, k * (32 * times + gap) :][:, : 32 * times].max() > 0.5  # there is writing


def drawn_to(scene: Path, name: str) -> Path:
    assert run("render", scene, "-o", name, "-q")[0] == 0
    return Path(name)


USAGE = "Usage: cli compare [OPTIONS] A [B]\nTry 'cli compare --help' for help.\n\nError: "


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ("two.scene", "two.scene needs a second input B: --backends raster,ray renders it in two ways"),
        ("a.exr", "a.exr needs a second input B: a second picture, or a scene"),
        ("two.scene a.exr --backends raster,ray", "--backends renders one scene in two ways: give one scene, or leave out --backends"),
        ("a.exr --backends raster,ray", "--backends renders a scene, but a.exr is a picture"),
        ("two.scene --backends raster,ray --backend ray", "--backend and --backends exclude each other"),
        (
            "two.scene --backends rastr,ray",
            "Invalid value for '--backends': no backend is called `rastr`; there are auto, ray, raster, reference. did you mean `raster`?",
        ),
        (
            "two.scene --backends ray",
            "Invalid value for '--backends': 'ray': give two backends, as in raster,ray; the second is the reference",
        ),
        (
            "two.scene --backends ray,ray:samples",
            "Invalid value for '--backends': 'samples' in 'ray:samples': write it as name=value, as in ray:samples=4",
        ),
        (
            "two.scene --backends ray,ray:error=-1",
            "Invalid value for '--backends': 'error=-1' in 'ray:error=-1': '-1': a share is written 1% or 0.01, and is more than 0",
        ),
        ("two.scene --backends ray,ray:sample=4", "no decision is called `sample`; did you mean `samples`?"),
        (
            "a.png a.png --exposure 1",
            "--exposure is for linear light, but both a.png and a.png were exposed when they were written",
        ),
        ("two.scene --backends ray,ray:seed=1:seed=2", "Invalid value for '--backends': `seed` is given twice in 'ray:seed=1:seed=2'"),
        ("a.exr a.exr --size 40", "--size is for scenes, but both a.exr and a.exr are pictures"),
        ("a.exr a.exr --set size=2", "--set is for scenes, but both a.exr and a.exr are pictures"),
        ("a.exr a.exr --metric flip", "--metric selects the metric of --threshold: give --threshold too"),
        ("a.exr a.exr --side-by-side", "--side-by-side writes a picture: give its file with -o"),
        ("a.exr a.exr --side-by-side -o d.exr", "--side-by-side writes a picture for viewing: d.exr cannot be an .exr; write a .png"),
    ],
)
def test_wrong_usage(scene: Path, arguments: str, said: str) -> None:
    saved(Path("a.exr"), flat(1.0))
    saved(Path("a.png"), flat(1.0))
    assert run("compare", *arguments.split()) == (2, "", f"{USAGE}{said}\n")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (
            "two.scene wide.scene",
            "sizes differ: two.scene is rendered at 32x24 and wide.scene is rendered at 40x24 pixels; --size 32x24 makes both equal",
        ),
        (
            "two.scene a.exr --size 8",
            "sizes differ: two.scene is rendered at 8x8 and a.exr is 4x3 pixels; leave out --size and --crop, "
            "and the scene is rendered at the picture's size",
        ),
        ("two.scene broken.exr", "broken.exr is not a picture: "),
    ],
)
def test_sides_that_cannot_be_compared(scene: Path, arguments: str, said: str) -> None:
    saved(Path("a.exr"), flat(1.0))
    Path("broken.exr").write_bytes(b"nothing of the kind")
    Path("wide.scene").write_text(scene.read_text().replace("[32, 24]", "[40, 24]"), encoding="utf-8")
    code, out, err = run("compare", *arguments.split())
    assert (code, out) == (1, "")
    assert err.startswith(f"Error: {said}")


def test_errors_of_a_scene_are_reported(scene: Path) -> None:
    Path("wrong.scene").write_text("spher(1)\n", encoding="utf-8")
    code, out, err = run("compare", scene, "wrong.scene")
    assert (code, out) == (1, "")
    assert err.startswith("wrong.scene:1:1: error: ")


def test_the_pages_python_runs(scene: Path) -> None:
    root = Path(__file__).resolve().parents[2]
    Path("examples").mkdir()
    Path("examples/hello.scene").write_text((root / "examples" / "hello.scene").read_text(encoding="utf-8"), encoding="utf-8")
    saved(Path("out.exr"), flat(1.1))
    saved(Path("reference.exr"), flat(1.0))
    (code,) = re.findall(r"```python\n(.*?)```", (root / "docs" / "compare.md").read_text(encoding="utf-8"), re.S)
    names: dict[str, Any] = {}
    exec(code, names)
    assert names["found"].interior.error < 1e-3


def test_the_page_tells_every_figure_of_the_json(scene: Path) -> None:
    page = (Path(__file__).resolve().parents[2] / "docs" / "compare.md").read_text(encoding="utf-8")
    found = figures(scene, "--backends", "ray,ray")
    missing = [key for key in (*found, *found["noise"]) if f"`{key}`" not in page]
    assert missing == []


def test_an_interrupt_ends_the_comparison(scene: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C while a side is drawn ends the command with 130 and leaves no picture."""

    @contextmanager
    def pressed() -> Iterator[threading.Event]:
        event = threading.Event()
        event.set()
        yield event

    monkeypatch.setattr(terminal, "catch_interrupt", pressed)
    assert run("compare", scene, "--backends", "raster,ray", "-o", "d.png") == (130, "", "")
    assert not Path("d.png").exists()


def test_the_verdict_on_noise(scene: Path) -> None:
    soft = SCENE.replace("MATERIAL", "lambert(#3060c0)") + "sky(luminance: 0.5)\n"
    scene.write_text(soft, encoding="utf-8")
    Path("dim.scene").write_text(soft.replace("illuminance: 3", "illuminance: 2.8"), encoding="utf-8")

    def told(*arguments: object) -> list[str]:
        _, out, _ = run("compare", *arguments)
        lines = out.splitlines()
        after = next(k for k, line in enumerate(lines) if line.startswith("noise")) + 1
        return [re.sub(r"[\d.]+(?= times| standard)", "N", line.strip()) for line in lines[after : lines.index("", after)]]

    times, means = "the difference is N times what noise alone makes", "the means differ by N standard errors"
    same = f"{times}; the random numbers are the same: the rest is a rendering difference"
    noise = ["--backends", "ray:samples=16,ray:samples=16:seed=1"]
    assert told(scene, *noise) == [f"{times}: within the noise", f"{means}: no significant bias"]
    assert told("dim.scene", scene, "--samples", "16") == [same, f"{means}: a bias"]


def test_a_warning_of_both_sides_is_printed_once(scene: Path) -> None:
    scene.write_text(SCENE.replace("MATERIAL", "lambert(#3060c0)") + "ambient(luminance: 0.1)\n", encoding="utf-8")
    _, _, err = run("compare", scene, "--backends", "ray,ray:seed=1", "--bounces", "1")
    said = "ambient light stands for interreflection, and bounces compute it: it is counted twice; leave out one"
    assert err == f"warning: {said}\n"


def test_two_files_tell_their_objects_by_number(scene: Path) -> None:
    for name, backend in (("a.exr", "raster"), ("b.exr", "ray")):
        run("render", scene, "-o", name, "--samples", "32", "--aov", "id,depth", "--backend", backend, "-q")
    found = figures("a.exr", "b.exr")
    assert {row["label"] for row in found["objects"]} == {"instance 0", "instance 1", "background"}
    assert found["interior"]["error"] < 1e-6
    assert found["noise"]["a"] > 0
    assert run("compare", "a.exr", "b.exr")[1].splitlines()[0] == "A  a.exr, raster, 32 samples, seed 0"
