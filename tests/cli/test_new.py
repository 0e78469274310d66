"""`maquette new`: its scenes have no errors, are formatted, render, and overwrite nothing."""

from __future__ import annotations

from pathlib import Path

import maquette
import numpy as np
import pytest
from click.testing import CliRunner
from maquette.cli.commands.new import KINDS
from maquette.cli.main import cli
from maquette.lang.diagnostics import Diagnostics
from maquette.lang.syntax.formatter import format_text

OBJ = "v 0 0 0\nv 1 0 0\nv 0 2 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
USD = '#usda 1.0\n(\n    defaultPrim = "Ball"\n    upAxis = "Y"\n)\n\ndef Sphere "Ball"\n{\n    double radius = 0.4\n}\n'


def run(*arguments: object) -> tuple[int, str, str]:
    done = CliRunner().invoke(cli, [str(a) for a in arguments], prog_name="maquette")
    return done.exit_code, done.stdout, done.stderr


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("models").mkdir()
    Path("models/a b.obj").write_text(OBJ, encoding="utf-8")
    Path("ball.usda").write_text(USD, encoding="utf-8")


@pytest.mark.parametrize("source", [*KINDS, "models/a b.obj", "ball.usda"])
def test_scenes_are_right(source: str) -> None:
    assert run("new", "mine", "--from", source) == (0, "mine.scene: see it with  maquette watch mine.scene -o mine.png\n", "")
    text = Path("mine.scene").read_text(encoding="utf-8")
    assert "NAME" not in text
    assert "FILE" not in text
    assert format_text(text, "mine.scene", Diagnostics()) == text
    told = f"{source}: note: 4 triangles: closed, 1 body, Euler number 2\n" if source.endswith(".obj") else ""
    assert run("check", "mine.scene") == (0, "mine.scene: no errors\n", told)


@pytest.mark.long
@pytest.mark.parametrize("backend", ["ray", "raster"])
@pytest.mark.parametrize("source", [*KINDS, "models/a b.obj", "ball.usda"])
def test_scenes_draw_something(source: str, backend: str) -> None:
    run("new", "mine", "--from", source)
    image = maquette.render("mine.scene", size=(32, 24), samples=1, backend=backend).channels["rgba"][..., :3]
    assert np.isfinite(image).all()
    assert image.std() > 0.1 * image.mean() > 0.0


def test_existing_files_are_not_overwritten() -> None:
    Path("mine.scene").write_text("sphere(1)\n", encoding="utf-8")
    assert run("new", "mine.scene") == (1, "", "error: mine.scene exists already: choose another name\n")
    assert Path("mine.scene").read_text(encoding="utf-8") == "sphere(1)\n"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("a", "--from", "none.obj"), "error: there is no file none.obj\n"),
        (("no/a",), "error: there is no folder no to write a.scene into\n"),
        (
            ("models/a", "--from", "ball.usda"),
            "error: a scene reads files below its own folder: put a.scene in the folder of ball.usda or above\n",
        ),
    ],
)
def test_errors_of_new(arguments: tuple[str, ...], message: str) -> None:
    assert run("new", *arguments) == (1, "", message)
    assert not list(Path().rglob("*.scene"))


def test_other_kinds_are_named() -> None:
    code, _, said = run("new", "a", "--from", "chair")
    assert code == 2
    kinds = "still, room, part, formula, or a file that ends in .obj .ply .stl .glb .gltf .off .3mf .xyz .usd .usda .usdc .usdz .mtlx"
    assert said.endswith(f"Error: --from is one of {kinds}\n")
