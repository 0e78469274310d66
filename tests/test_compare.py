"""√relMSE and differences by hand-made answers, and the `compare` command on real files."""

from __future__ import annotations

from pathlib import Path

import maquette
import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from maquette.cli import cli
from maquette.render import metrics, output
from maquette.render.image import Image

PIXELS = arrays.arrays(np.float32, (3, 4, 3), elements=st.floats(0, 1000, width=32))


def flat(value: float, width: int = 4, height: int = 3) -> np.ndarray:
    return np.full((height, width, 3), value)


def saved(path: Path, rgb: np.ndarray) -> Path:
    rgba = np.concatenate([rgb, np.ones_like(rgb[..., :1])], axis=2).astype(np.float32)
    output.write(Image(rgb.shape[1], rgb.shape[0], {"rgba": rgba}, {}), path, output.Look(), {"version": "0"})
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


@given(PIXELS)
def test_a_picture_is_no_distance_from_itself(image: np.ndarray) -> None:
    found = metrics.difference(image, image)
    assert (found.error, found.maximum, found.differing) == (0.0, 0.0, 0)


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
    assert maquette.compare(a, output.read(b)).error == pytest.approx(0.1, rel=1e-3)


def test_the_command_prints_figures(tmp_path: Path) -> None:
    image = flat(1.0)
    image[2, 3] = 1.5
    a, b = saved(tmp_path / "a.exr", image), saved(tmp_path / "b.exr", flat(1.0))
    code, out, err = run("compare", a, b)
    assert (code, err) == (0, "")
    assert out == f"""\
A  {a}
B  {b}
√relMSE     0.14433 (14.4330%)
FLIP        0
maximum     0.5 at pixel 3,2
bias        red +4.17%, green +4.17%, blue +4.17%
silhouette  0 pixels apart
differing   1 of 12 pixels
"""


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
    signed = output.read(tmp_path / "d.exr").channels["rgba"]
    assert (signed[0, 0, 0], signed[2, 3, 0], signed[1, 1, 0]) == (0.5, -0.5, 0.0)
    assert run("compare", a, b, "-o", tmp_path / "d.png")[0] == 0
    colours = output.read(tmp_path / "d.png").channels["rgba"]
    assert colours[0, 0, :3].tolist() == [1, 0, 0]
    assert colours[2, 3, :3].tolist() == [0, 0, 1]
    assert colours[1, 1, :3].tolist() == [1, 1, 1]


def test_sizes_that_differ(tmp_path: Path) -> None:
    a, b = saved(tmp_path / "a.exr", flat(1.0)), saved(tmp_path / "b.exr", flat(1.0, width=5))
    said = f"sizes differ: {a} is 4x3 and {b} is 5x3 pixels; render both with the same --size"
    assert run("compare", a, b) == (1, "", f"Error: {said}\n")


def test_what_is_not_a_picture_is_said(tmp_path: Path) -> None:
    a, text = saved(tmp_path / "a.exr", flat(1.0)), tmp_path / "notes.txt"
    text.write_text("not a picture\n", encoding="utf-8")
    code, out, err = run("compare", a, text)
    assert (code, out) == (1, "")
    assert err.startswith(f"Error: {text} is not a picture: ")
    assert run("compare", a, tmp_path / "none.exr")[0] == 2
