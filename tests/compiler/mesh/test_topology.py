"""Topology and moments of meshes against closed forms, and meshes that bound no volume."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from maquette.compiler.mesh import topology

BOX = trimesh.creation.box((1.0, 2.0, 3.0))
BALL = trimesh.creation.icosphere(2)
TORUS = trimesh.creation.torus(1.0, 0.25, major_sections=64, minor_sections=32)


def inverted(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    return trimesh.Trimesh(mesh.vertices, mesh.faces[:, ::-1], process=False)


def joined(*meshes: trimesh.Trimesh) -> Any:
    return trimesh.util.concatenate(list(meshes))


def moved(mesh: trimesh.Trimesh, offset: tuple[float, float, float], scale: float = 1.0) -> trimesh.Trimesh:
    return mesh.copy().apply_scale(scale).apply_translation(offset)


def of(mesh: trimesh.Trimesh) -> topology.Topology:
    return topology.topology(*topology.merged(mesh.vertices, mesh.faces))


def crossings(mesh: trimesh.Trimesh) -> int | None:
    return topology.crossings(*topology.merged(mesh.vertices, mesh.faces))


@pytest.mark.parametrize(
    ("mesh", "euler", "bodies"), [(BOX, 2, 1), (BALL, 2, 1), (TORUS, 0, 1), (joined(BALL, moved(TORUS, (9.0, 0.0, 0.0))), 2, 2)]
)
def test_closed_meshes(mesh: trimesh.Trimesh, euler: int, bodies: int) -> None:
    found = of(mesh)
    assert (found.closed, found.open_edges, found.euler_number, found.bodies) == (True, 0, euler, bodies)
    assert crossings(mesh) == 0


def test_a_missing_triangle_opens_three_edges() -> None:
    found = of(trimesh.Trimesh(BOX.vertices, BOX.faces[1:], process=False))
    assert (found.watertight, found.wound, found.open_edges, found.euler_number) == (False, True, 3, 1)


def test_a_turned_triangle_is_told_from_a_missing_one() -> None:
    faces = np.array(BOX.faces)
    faces[3] = faces[3, ::-1]
    found = of(trimesh.Trimesh(BOX.vertices, faces, process=False))
    assert (found.watertight, found.wound, found.closed) == (True, False, False)


def test_three_triangles_at_an_edge_are_not_closed() -> None:
    points = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 0], [0, 1, 0], [-1, 0, 0]], float)
    assert not of(trimesh.Trimesh(points, [[0, 1, 2], [0, 1, 3], [0, 1, 4]], process=False)).watertight


def test_no_triangles() -> None:
    assert topology.topology(np.zeros((0, 3)), np.zeros((0, 3), np.int64)) == (0, 0, False, False, 0, 0)
    assert topology.crossings(np.zeros((0, 3)), np.zeros((0, 3), np.int64)) == 0


@settings(deadline=None, max_examples=20)
@given(st.tuples(*[st.floats(-1e3, 1e3)] * 3), st.floats(0.1, 10.0))
def test_moments_of_a_box_anywhere(at: tuple[float, float, float], scale: float) -> None:
    mesh = moved(BOX, at, scale)
    volume, center, inertia = topology.moments(mesh.vertices, mesh.faces)
    assert float(volume) == pytest.approx(6.0 * scale**3, rel=1e-9)
    assert np.allclose(center, at, atol=1e-9 * 1e3)
    about = 6.0 * scale**5 / 12.0 * np.array([4.0 + 9.0, 1.0 + 9.0, 1.0 + 4.0])
    assert np.allclose(inertia, np.diag(about), rtol=1e-8, atol=1e-8 * about.max())


def test_moments_of_a_torus_of_chords() -> None:
    """Pappus on polygons: the ring's section has area A and its middle goes along a polygon of the ring."""
    section = 0.5 * 32 * 0.25**2 * math.sin(2 * math.pi / 32)
    assert float(topology.moments(TORUS.vertices, TORUS.faces).volume) == pytest.approx(
        section * 64 * math.sin(2 * math.pi / 64), rel=1e-3
    )
    assert float(topology.moments(TORUS.vertices, TORUS.faces[:, ::-1]).volume) < 0.0


def test_surfaces_that_pass_through_each_other_are_found() -> None:
    assert crossings(joined(BALL, moved(BALL, (1.0, 0.013, 0.007)))) > 0  # type: ignore[operator]
    assert crossings(joined(BALL, moved(BALL, (2.5, 0.0, 0.0)))) == 0
    assert crossings(joined(BOX, moved(BOX, (1.0, 0.0, 0.0)))) == 0  # a face in common


def test_a_mesh_with_too_many_triangles_is_not_searched(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(topology, "MOST_CROSSED", 100)
    assert crossings(BALL) is None


def test_bodies_in_others() -> None:
    small = moved(BALL, (0.1, 0.0, 0.0), 0.5)
    for mesh, count in ((joined(BALL, small), 1), (joined(BALL, inverted(small)), 0), (joined(BALL, moved(BALL, (3.0, 0.0, 0.0))), 0)):
        assert topology.counted_twice(*topology.merged(mesh.vertices, mesh.faces)) == count
    island = joined(BALL, inverted(small), moved(BALL, (0.1, 0.0, 0.0), 0.2))
    assert topology.counted_twice(*topology.merged(island.vertices, island.faces)) == 0
