"""Each format that is written has a row, from which messages, help and the documentation come."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner
from maquette.cli.main import cli
from maquette.compiler import format_pages
from maquette.compiler.exporters import writers

ROOT = Path(__file__).resolve().parents[3]
ENDINGS = [ending for writer in writers.WRITERS for ending in writer.endings]


def convert(folder: Path, *arguments: str) -> tuple[int, str]:
    (folder / "a.scene").write_text("sphere(1)\n", encoding="utf-8")
    done = CliRunner().invoke(cli, ["convert", str(folder / "a.scene"), *arguments])
    return done.exit_code, done.stderr


def test_each_ending_has_one_writer() -> None:
    assert len(set(ENDINGS)) == len(ENDINGS)
    assert writers.writer_of(".fbx") is None


def test_the_page_has_the_table_of_writers() -> None:
    page = (ROOT / "docs" / "export.md").read_text(encoding="utf-8")
    assert writers.table() in page, "run `make reference`"
    assert format_pages.with_writers(page.replace("| `.stl` (STL) |", "| `.stl` (old) |")) == page


def test_the_help_names_each_ending() -> None:
    said = CliRunner().invoke(cli, ["convert", "--help"]).stdout
    assert all(ending in said for ending in ENDINGS)


@pytest.mark.parametrize("ending", ENDINGS)
def test_a_ball_is_written(tmp_path: Path, ending: str) -> None:
    code, said = convert(tmp_path, str(tmp_path / f"b{ending}"))
    assert code == 0, said
    assert (tmp_path / f"b{ending}").stat().st_size > 100


@pytest.mark.parametrize("ending", ENDINGS)
def test_options_that_a_format_lacks_are_refused(tmp_path: Path, ending: str) -> None:
    writer = writers.writer_of(ending)
    assert writer is not None
    for applies, option, refusal in (
        (writer.planned, ("--size", "8x8"), writer.refusal),
        (writer.deviation, ("--deviation", "1mm"), f"--deviation applies to triangles: OUT ends in {writers.with_deviation()}"),
    ):
        code, said = convert(tmp_path, str(tmp_path / f"b{ending}"), *option)
        assert (code == 0) == applies
        assert applies or said.endswith(f"Error: {refusal}\n")


def test_an_unknown_ending_lists_all(tmp_path: Path) -> None:
    code, said = convert(tmp_path, "b.fbx")
    assert code == 2
    assert said.endswith(f"Error: writing .fbx is not built yet: OUT ends in {writers.known_endings()}\n")


def test_an_empty_scene_makes_no_file_of_triangles(tmp_path: Path) -> None:
    (tmp_path / "a.scene").write_text("plane(y: 0)\n", encoding="utf-8")
    done = CliRunner().invoke(cli, ["convert", str(tmp_path / "a.scene"), str(tmp_path / "b.stl")])
    assert done.exit_code == 1
    assert done.stderr.endswith("Error: the scene has no bounded surface to write\n")
    assert not (tmp_path / "b.stl").exists()


def test_a_file_beside_the_output_never_replaces_one_of_the_scene(tmp_path: Path) -> None:
    (tmp_path / "b.mtl").write_text("newmtl red\nKd 1 0 0\n", encoding="utf-8")
    (tmp_path / "a.obj").write_text("mtllib b.mtl\nusemtl red\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", encoding="utf-8")
    done = CliRunner().invoke(cli, ["convert", str(tmp_path / "a.obj"), str(tmp_path / "b.obj")])
    assert done.exit_code == 1
    assert "b.mtl" in done.stderr
    assert not (tmp_path / "b.obj").exists()
