"""Repair of meshes: closed forms of damaged solids, what stays, attributes, and any triangles at all."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st
from maquette.cli.main import cli
from maquette.compiler import ir
from maquette.compiler.mesh import repair, topology
from maquette.compiler.mesh.polygon_mesh import PolyMesh
from maquette.compiler.scene.row_records import MeshAttribute

BALL = trimesh.creation.icosphere(2)
BOX = trimesh.creation.box()


def mesh_of(points: np.ndarray, faces: np.ndarray, **attributes: Any) -> PolyMesh:
    faces = np.asarray(faces, np.int64)
    return PolyMesh(np.asarray(points, np.float64), np.full(len(faces), faces.shape[1]), faces.reshape(-1), **attributes)


def repaired(points: np.ndarray, faces: np.ndarray, **attributes: MeshAttribute) -> tuple[PolyMesh, repair.Repair]:
    made, _, said = repair.repaired(mesh_of(points, faces, **attributes))
    return made, said


def volume(mesh: PolyMesh) -> float:
    places, faces = topology.merged(mesh.points, mesh.indices.reshape(-1, 3))
    assert topology.topology(places, faces).closed
    return float(topology.moments(places, faces).volume)


@pytest.mark.long
@settings(deadline=None, max_examples=25)
@given(st.randoms(use_true_random=False))
def test_a_damaged_ball_is_mended(random: object) -> None:
    """Triangles turned, doubled, taken away and torn apart by rounding: closed again, with the volume of the ball but for the holes."""
    rng = np.random.default_rng(random.randrange(1 << 32))  # type: ignore[attr-defined]
    faces = np.array(BALL.faces)
    turned = rng.random(len(faces)) < rng.choice([0.0, 0.2, 1.0])
    faces[turned] = faces[turned][:, ::-1]
    faces = faces[rng.random(len(faces)) > rng.choice([0.0, 0.02])]
    faces = np.concatenate([faces, faces[: rng.integers(0, 5)]])
    points, faces = BALL.vertices[faces].reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3)
    made, said = repaired(points + rng.normal(size=points.shape) * 1e-8, faces)
    if not said.unrepaired:
        assert volume(made) == pytest.approx(BALL.volume, rel=0.02)
    assert said.done or not turned.any()


@pytest.mark.long
@settings(deadline=None, max_examples=60)
@given(st.lists(st.tuples(*[st.integers(0, 6)] * 3), max_size=14), st.randoms(use_true_random=False))
def test_any_triangles_are_taken(faces: list[tuple[int, int, int]], random: object) -> None:
    points = np.random.default_rng(random.randrange(1 << 32)).integers(0, 3, (7, 3)).astype(float)  # type: ignore[attr-defined]
    made, said = repaired(points, np.array(faces, np.int64).reshape(-1, 3))
    assert np.isfinite(made.points).all()
    assert len(made.indices) == 0 or made.indices.max() < len(made.points)
    _, _, more = repair.repaired(made)
    assert not more.done, (said.done, more.done)


@pytest.mark.parametrize(
    ("faces", "done", "left"),
    [
        (BOX.faces, [], []),
        (BOX.faces[:, ::-1], ["12 faces turned outwards"], []),
        (BOX.faces[1:], ["1 hole filled"], []),
        (np.concatenate([BOX.faces, BOX.faces[:1]]), ["1 doubled face removed"], []),
        (BOX.faces[:1], [], ["1 hole is left: it is larger than half of the surface"]),
        (np.concatenate([BOX.faces[:1, ::-1], BOX.faces[1:]]), ["1 face turned round to match its neighbours"], []),
    ],
    ids=["sound", "inwards", "hole", "doubled", "alone", "turned"],
)
def test_each_repair_is_named(faces: np.ndarray, done: list[str], left: list[str]) -> None:
    made, said = repaired(BOX.vertices, faces)
    assert (said.done, said.unrepaired) == (done, left)
    assert left or volume(made) == pytest.approx(1.0)


def test_a_mobius_strip_has_one_side() -> None:
    n = 12
    angle = 2 * np.pi * np.arange(n) / n
    half = np.stack([np.cos(angle / 2) * np.cos(angle), np.cos(angle / 2) * np.sin(angle), np.sin(angle / 2)], axis=1) * 0.3
    middle = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    points = np.concatenate([middle - half, middle + half])
    faces = [(k, k + 1, n + k + 1, n + k) for k in range(n - 1)] + [(n - 1, n, 0, 2 * n - 1)]
    made, said = repaired(points, np.array(faces))
    assert "1 surface has one side alone, as a Möbius strip" in said.unrepaired
    assert not any("turned" in word for word in said.done)
    assert len(made.counts)


def test_a_hollow_keeps_facing_inwards() -> None:
    """A ball with a hollow, all turned inside out: both surfaces turn, so that the hollow is one again."""
    inner = BALL.copy().apply_scale(0.5)
    points = np.concatenate([BALL.vertices, inner.vertices])
    faces = np.concatenate([BALL.faces[:, ::-1], inner.faces + len(BALL.vertices)])
    made, said = repaired(points, faces)
    assert said.done == ["640 faces turned outwards"]
    assert volume(made) == pytest.approx(BALL.volume * 0.875)


def test_holes_that_meet_in_a_point_are_filled_each() -> None:
    around = np.flatnonzero((BALL.faces == 20).any(axis=1))
    apart = [k for k in around if len({*BALL.faces[around[0]]} & {*BALL.faces[k]}) == 1]
    at = [around[0], apart[0]]
    made, said = repaired(BALL.vertices, np.delete(BALL.faces, at, axis=0))
    assert said.done == ["2 holes filled"]
    assert volume(made) == pytest.approx(BALL.volume)


def test_sheets_beside_each_other_stay_open() -> None:
    """Leaves of a tree: the outline of each is no hole, however small it is beside the whole."""
    offsets = np.repeat(np.arange(50.0) * 3.0, 3)[:, None] * [1.0, 0.0, 0.0]
    _, said = repaired(np.tile([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], (50, 1)) + offsets, np.arange(150).reshape(-1, 3))
    assert (said.done, said.unrepaired) == ([], ["50 holes are left: they are larger than half of the surface"])


def test_attributes_follow_their_corners() -> None:
    """Colours at corners that are each corner's position, and normals that point outwards."""
    faces = np.array(BALL.faces)
    faces[::3] = faces[::3, ::-1]
    colors = MeshAttribute(BALL.vertices[faces].reshape(-1, 3), ir.Interpolation.CORNER)
    made, _ = repaired(BALL.vertices, faces[2:], colors=MeshAttribute(colors.values[6:], ir.Interpolation.CORNER),
                       normals=MeshAttribute(-BALL.vertices))  # fmt: skip
    assert made.colors is not None
    assert made.normals is not None
    assert np.allclose(made.colors.values, made.points[made.indices])
    normals = np.asarray(made.normals.values)
    known = np.linalg.norm(normals, axis=1) > 0.5
    assert 3 * 2 <= (~known).sum() <= 3 * 4


def test_equal_points_alone_need_no_repair() -> None:
    points = BOX.vertices[BOX.faces].reshape(-1, 3)
    mesh = mesh_of(points, np.arange(36).reshape(-1, 3))
    made, source, said = repair.repaired(mesh)
    assert made is mesh
    assert (source, said.done, said.unrepaired) == (None, [], [])


CUBE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n"
SIDES = "usemtl a\nf 4 3 2 1\nf 5 6 7 8\nf 2 1 5 6\nusemtl b\nf 2 3 7 6\nf 3 4 8 7\n"  # one turned, one missing


@pytest.mark.parametrize("scene", [None, 'mesh("a.obj", repair: true)\nsun()\n'], ids=["option", "argument"])
def test_an_object_of_two_materials_is_repaired_as_a_whole(tmp_path: Path, scene: str | None) -> None:
    folder = tmp_path
    (folder / "a.obj").write_text(CUBE + SIDES)
    (folder / "a.scene").write_text(scene or "")
    told = CliRunner().invoke(cli, ["check", str(folder / "a.scene")] if scene else ["check", "--repair", str(folder / "a.obj")])
    assert "a.obj: note: repaired the mesh: 1 face turned round to match its neighbours" not in told.stderr  # two triangles
    assert "note: repaired the mesh: 2 faces turned round to match their neighbours, 1 hole filled" in told.stderr
    assert "note: 12 triangles: closed, 1 body, Euler number 2" in told.stderr


def test_points_and_faces_are_repaired(tmp_path: Path) -> None:
    path = tmp_path / "a.scene"
    path.write_text("mesh(points: [[0,0,0],[1,0,0],[0,1,0],[0,0,1]], faces: [[0,1,3],[0,3,2],[1,2,3]], repair: true)\nsun()\n")
    told = CliRunner().invoke(cli, ["measure", str(path)])
    assert "1:1: note: repaired the mesh: 1 hole filled" in told.stderr
    assert "  volume   0.1666666667 m³" in told.stdout.splitlines()


@pytest.mark.parametrize(("name", "text"), [("a.scene", "sphere(1)\nsun()\n"), ("a.usda", "#usda 1.0\n")])
def test_other_files_refuse_the_option(tmp_path: Path, name: str, text: str) -> None:
    path = tmp_path / name
    path.write_text(text)
    told = CliRunner().invoke(cli, ["check", "--repair", str(path)])
    assert told.exit_code == 1
    assert "error: only mesh files take --repair" in told.stderr
