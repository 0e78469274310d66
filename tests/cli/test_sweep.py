"""The `sweep` command: values, the sheet, and messages."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from maquette.cli.commands import sweep
from maquette.cli.main import cli
from PIL import Image

from ..files import standing_by

SCENE = """\
param shade = 0.5 in 0..1
param wide = 1m in 10cm..3m
assert(wide < 2.5m, "it fits")
box([wide, 10, 1], material: emissive(rgb(shade, shade, shade), luminance: 1))
camera(position: [0, 0, 5], look_at: [0, 0, 0], projection: "orthographic", width: 4)
render(size: [400, 200], samples: 1, bounces: 1)
"""


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    standing_by(tmp_path, monkeypatch, SCENE)
    return Path("a.scene")


def run(*arguments: object) -> tuple[int, str, str]:
    done = CliRunner().invoke(cli, ["sweep", *map(str, arguments)])
    return done.exit_code, done.stdout, done.stderr


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("1..5/3", ("1", "3", "5")),
        ("1cm..2cm/3", ("1cm", "1.5cm", "2cm")),
        ("0..90deg/2", ("0deg", "90deg")),
        ("-1..1/3", ("-1", "0", "1")),
        ("#f00,#0f0", ("#f00", "#0f0")),
        ("[1,2],[3, 4]", ("[1,2]", "[3, 4]")),
        ('"a,b",rgb(1,0,0)', ('"a,b"', "rgb(1,0,0)")),
        ("3", ("3",)),
        ("1..5", ("1..5",)),
    ],
)
def test_values(text: str, values: tuple[str, ...]) -> None:
    assert sweep.values_of(text) == values


def test_the_sheet_has_each_picture_in_its_place(scene: Path) -> None:
    """Bars of two widths, in two shades; the third axis goes down, too."""
    code, out, err = run(scene, "--set", "shade=0.1,0.9", "--set", "wide=1m..2m/2", "--size", "80x40", "--exposure", "0")
    assert (code, out, err) == (0, "a.sweep.png: 4 pictures\n", "")
    sheet = np.asarray(Image.open("a.sweep.png").convert("L")).astype(int)
    dark, bright = (round(255 * (1.055 * value ** (1 / 2.4) - 0.055)) for value in (0.1, 0.9))
    bars = [[np.count_nonzero(np.abs(row - shade) < 3) for shade in (dark, bright)] for row in (sheet[29 + 20], sheet[29 + 48 + 20])]
    assert bars == [[20, 20], [40, 40]]


def test_a_picture_with_an_error_is_left_blank(scene: Path) -> None:
    code, out, err = run(scene, "--set", "wide=1m,2.6m", "--size", "80x40")
    assert (code, out) == (1, "a.sweep.png: 2 pictures, 1 of them with errors\n")
    assert err.startswith("a.scene:3:8: error: the assertion fails: it fits\n")
    assert Image.open("a.sweep.png").size == (8 + 2 * 88, 29 + 48)


def test_pictures_have_the_aspect_of_the_scene(scene: Path) -> None:
    assert run(scene, "--set", "shade=0,1", "-o", "b.jpg", "-q") == (0, "", "")
    assert Image.open("b.jpg").size == (8 + 2 * 248, 29 + 128)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--set", "shade=1"), "no param has several values: write --set radius=0.4..1.6/4 or --set teeth=8,12,16"),
        (("--set", "shade=0..1/300", "--set", "wide=1,2"), "that would be 600 pictures: a sheet has at most 400"),
        (("--set", "wide=1cm..2m/3"), "1cm..2m/3 has two units: write 1cm..5cm/5"),
        (("--set", "shade=0..1/1"), "0..1/1 has 1 values: a range has 2 to 400"),
        (
            ("--set", "shade=0,1", "-o", "a.exr"),
            "cannot tell the picture format of a.exr: its name must end in one of .png, .jpg, .jpeg, .webp",
        ),
    ],
)
def test_messages(scene: Path, options: tuple[str, ...], message: str) -> None:
    code, _, err = run(scene, *options)
    assert (code, err.splitlines()[-1]) == (2, f"Error: {message}")
    assert not Path("a.sweep.png").exists()
