"""Colours of vertices survive `convert` between the formats that hold them, and their loss is told elsewhere."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from maquette.cli.main import cli

PLACES = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
COLORS = np.array([[255, 0, 0], [0, 200, 30], [40, 60, 255], [250, 240, 10]])
FACES = ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2))
FORMATS = ("ply", "obj", "3mf", "glb", "usda")


def run(*arguments: object) -> str:
    done = CliRunner().invoke(cli, [str(a) for a in arguments])
    assert done.exit_code == 0, done.stderr
    return done.stderr


def write_ply(path: Path) -> None:
    lines = ["ply", "format ascii 1.0", "element vertex 4", *(f"property float {x}" for x in "xyz")]
    lines += [*(f"property uchar {c}" for c in ("red", "green", "blue"))]
    lines += ["element face 4", "property list uchar int vertex_indices", "end_header"]
    lines += [" ".join(map(str, (*place, *color))) for place, color in zip(PLACES, COLORS, strict=True)]
    lines += [f"3 {a} {b} {c}" for a, b, c in FACES]
    path.write_text("\n".join(lines) + "\n", encoding="ascii")


def read_ply(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """(places (n, 3), colours (n, 3) from 0 to 255) of a PLY file of `convert`."""
    head, _, body = path.read_bytes().partition(b"end_header\n")
    count = re.search(rb"element vertex (\d+)", head)
    assert count is not None
    rows = np.frombuffer(body, np.dtype([("place", "<f4", 3), ("color", "u1", 3)]), int(count[1]))
    return rows["place"].astype(np.float64), rows["color"].astype(np.int64)


@pytest.mark.parametrize("ending", FORMATS)
def test_colours_of_vertices_come_back(tmp_path: Path, ending: str) -> None:
    """From PLY to a format, and from that to PLY."""
    write_ply(tmp_path / "a.ply")
    run("convert", tmp_path / "a.ply", tmp_path / f"b.{ending}")
    run("convert", tmp_path / f"b.{ending}", tmp_path / "c.ply")
    places, colors = read_ply(tmp_path / "c.ply")
    for place, color in zip(places, colors, strict=True):
        apart = np.linalg.norm(PLACES - place, axis=1)
        assert apart.min() < 1e-5
        assert np.abs(COLORS[apart.argmin()] - color).max() <= 3, ending


def test_colours_of_a_tinted_mesh_are_its_product(tmp_path: Path) -> None:
    """The material's colour is a factor of those of vertices, as in pictures."""
    write_ply(tmp_path / "a.ply")
    (tmp_path / "a.scene").write_text('mesh("a.ply", material: lambert(rgb(1, 0.5, 0)))\n', encoding="utf-8")
    for ending in ("ply", "usda", "glb"):
        run("convert", tmp_path / "a.scene", tmp_path / f"b.{ending}")
    run("convert", tmp_path / "b.usda", tmp_path / "d.ply")
    run("convert", tmp_path / "b.glb", tmp_path / "e.ply")
    one, *others = (read_ply(tmp_path / f"{name}.ply") for name in "bde")
    assert one[1][:, 2].max() == 0
    for places, colors in others:
        nearest = np.linalg.norm(one[0][:, None] - places[None], axis=2).argmin(axis=1)
        assert np.abs(colors[nearest] - one[1]).max() <= 3


def test_the_loss_in_stl_is_told(tmp_path: Path) -> None:
    write_ply(tmp_path / "a.ply")
    err = run("convert", tmp_path / "a.ply", tmp_path / "b.stl")
    assert "warning: colours of vertices are not carried: a .stl file has none\n  .ply, .obj and .3mf hold colours" in err
