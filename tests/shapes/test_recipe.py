"""A shape is one file and one line: the recipe of docs/architecture.md is applied to a copy of the package, which then does everything."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("cli", "compiler", "lang", "live", "measure", "render", "shapes", "stdlib")
HEAD = re.compile(r"^# ([\w/]+\.py), (?:a new file|in \w+ before `([^`]+)`)$")
SCENE = """\
annulus(1, 0.5, rotate: [90deg, 0, 0], material: lambert(checker(#ff0000, #00ff00, size: 10cm)))
annulus(0.4, 0.2, rotate: [90deg, 0, 0], material: emissive(luminance: 2))
annulus(0.5, 0.2, center: [0, 1, 0], rotate: [90deg, 0, 0], material: lambert(0.5))
sun(from: [0, 1, 1])
camera(position: [0, 0, 4], look_at: [0, 0, 0])
"""
RUN = """
import sys
import maquette
from click.testing import CliRunner
from maquette.cli.main import cli
assert maquette.__file__.startswith(sys.argv[1]), maquette.__file__

def run(line, code=0):
    done = CliRunner().invoke(cli, line.split())
    assert done.exit_code == code, line + chr(10) + done.output + done.stderr
    return done.output + done.stderr
"""
QUICK = """
assert "no errors" in run("check a.scene")
said = run("check solid.scene", 1)
assert "`annulus` cannot be a part of a solid: an annulus has no inside" in said, said
assert "its measures are not finite, or not above 0" in run("check wrong.scene", 1)
for ending in ("npz", "xml", "pov", "glb", "usda", "usdc", "usdz", "stl", "3mf", "obj", "ply"):
    run(f"convert a.scene out.{ending}")
from pathlib import Path
from maquette.lang.reference_page import reference
assert "### annulus" in reference({}) and "annulus(1, 0.5)" in reference({})
run("inspect a.scene")
import numpy as np
run("render a.scene -o a.exr --size 32x24 --samples 1 --bounces 1 --backend reference -q")
from maquette.render.image import image_reader
alpha = image_reader.read(Path("a.exr")).channels["rgba"][..., 3]
assert alpha[12, 16] == 0.0 and alpha[12, 16 + 6] == 1.0, alpha[12]
"""
DRAWN = """
from pathlib import Path
import numpy as np
from maquette.render.image import image_reader
made = {}
for backend in ("ray", "raster", "reference"):
    run(f"render a.scene -o {backend}.exr --size 32x24 --samples 1 --bounces 1 --backend {backend} -q")
    made[backend] = image_reader.read(Path(f"{backend}.exr")).channels["rgba"]
assert np.abs(made["ray"] - made["reference"]).max() < 1e-4
assert ((made["raster"][..., 3] == made["reference"][..., 3]).mean()) > 0.95
"""


def changed_package(tmp_path_factory: pytest.TempPathFactory, recipe: str) -> Path:
    """A copy of the package with a recipe: it changes one line and adds one file."""
    copy = tmp_path_factory.mktemp("recipe") / "maquette"
    for name in FOLDERS:
        shutil.copytree(ROOT / name, copy / name)
    for path in (*ROOT.glob("*.py"), ROOT / "py.typed"):
        shutil.copy2(path, copy / path.name)
    blocks: list[tuple[str, str | None, list[str]]] = []
    for line in (Path(__file__).parent / recipe).read_text(encoding="utf-8").splitlines():
        head = HEAD.match(line)
        if head:
            blocks.append((head[1], head[2], []))
        else:
            blocks[-1][2].append(line)
    assert [(before is None) or len(lines) for _, before, lines in blocks] == [1, True]
    for file, before, lines in blocks:
        path = copy / file
        old = path.read_text(encoding="utf-8") if before else ""
        at = old.index(before) if before else 0
        at = old.rfind("\n", 0, at) + 1
        path.write_text(old[:at] + "\n".join(lines) + "\n" + old[at:], encoding="utf-8")
    return copy


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    copy = changed_package(tmp_path_factory, "annulus.recipe")
    (copy.parent / "a.scene").write_text(SCENE, encoding="utf-8")
    (copy.parent / "solid.scene").write_text("union { annulus(1, 0.5); sphere(1) }\n" + SCENE, encoding="utf-8")
    (copy.parent / "wrong.scene").write_text("annulus(0.5, 1)\n" + SCENE, encoding="utf-8")
    return copy


def run(package: Path, code: str) -> None:
    made = subprocess.run(
        [sys.executable, "-c", RUN + code, str(package.parent)], cwd=package.parent, capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": str(package.parent)},
    )  # fmt: skip
    assert made.returncode == 0, made.stdout + made.stderr


def test_a_new_shape_is_checked_exported_documented_and_drawn(package: Path) -> None:
    run(package, QUICK)


@pytest.mark.long
def test_a_new_shape_is_drawn_by_every_backend(package: Path) -> None:
    run(package, DRAWN)


SOLIDS = """\
difference { octahedron(1); sphere(0.6) }
octahedron(0.4, center: [2, 0, 0], material: glass())
octahedron(0.3, center: [-1.5, 0, 0], material: emissive(luminance: 2))
union(translate: [0, 1.5, 0]) { octahedron(0.4); mesh(points: [[0,0,0],[1,0,0],[0,1,0],[0,0,1]], faces: [[0,2,1],[0,1,3],[0,3,2],[1,2,3]]) }
sun(from: [0, 1, 1])
camera(position: [0, 0, 6], look_at: [0, 0, 0])
"""
AS_SOLID = """
assert "no errors" in run("check a.scene")
for ending in ("xml", "pov", "glb", "usda", "stl", "obj"):
    assert "do not have one triangle on each side" not in run(f"convert a.scene out.{ending}")
run("render a.scene -o a.exr --size 32x24 --samples 1 --bounces 1 --backend reference -q")
"""


@pytest.mark.long
def test_a_new_closed_shape_is_a_part_of_solids(tmp_path_factory: pytest.TempPathFactory) -> None:
    package = changed_package(tmp_path_factory, "octahedron.recipe")
    (package.parent / "a.scene").write_text(SOLIDS, encoding="utf-8")
    run(package, AS_SOLID)
