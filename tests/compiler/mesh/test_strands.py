"""Tubes, ribbons and spheres of many curves: distances from their axes, closed surfaces, mitres and colours."""

# pyright: reportOptionalMemberAccess=false

import numpy as np
import pytest
from maquette.compiler.mesh import strands
from maquette.compiler.mesh.polygon_mesh import assemble
from maquette.compiler.mesh.strands import Strands


def line(*points, radius=0.5, closed=False):
    made = np.array(points, float)
    return Strands(made, np.full(len(made), radius), np.array([len(made)]), np.array([closed]))


def volume(mesh):
    made, _ = assemble(mesh)
    corners = made.positions[made.triangles]
    return np.einsum("ti,ti->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6


def test_a_tube_is_a_prism_of_sixteen_sides():
    area = 8 * 0.25 * np.sin(np.pi / 8)
    for end in ((0, 3, 0), (3, 0, 0), (0, 0, -3), (1, 2, 2)):
        assert volume(strands.tubes(line((0, 0, 0), end))) == pytest.approx(3 * area)


def test_a_corner_is_mitred():
    """Two prisms cut by the bisecting plane have the volume of the length of their axes."""
    area = 8 * 0.01 * np.sin(np.pi / 8)
    mesh = strands.tubes(line((0, 0, 0), (2, 0, 0), (2, 2, 0), radius=0.1))
    assert volume(mesh) == pytest.approx(4 * area)


def test_a_closed_tube_has_no_ends():
    angle = np.arange(64) * 2 * np.pi / 64
    ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1) * 3
    mesh = strands.tubes(line(*ring, radius=0.2, closed=True))
    assert np.asarray(mesh.counts).tolist() == [4] * (64 * 16)
    distance = np.hypot(np.linalg.norm(mesh.points[:, :2], axis=1) - 3, mesh.points[:, 2])
    assert distance == pytest.approx(0.2, rel=0.01)
    assert volume(mesh) == pytest.approx(2 * np.pi * 3 * 8 * 0.04 * np.sin(np.pi / 8), rel=0.01)


def test_many_curves_are_one_mesh():
    one = line((0, 0, 0), (0, 1, 0), (0, 2, 1))
    two = line((5, 0, 0), (5, 1, 0))
    both = Strands(*map(np.concatenate, zip(one, two, strict=True)))  # pyright: ignore[reportArgumentType]
    colors = np.eye(3)[[0, 0, 0, 1, 1]]
    mesh = strands.tubes(both, colors=colors)
    assert volume(mesh) == pytest.approx(volume(strands.tubes(one)) + volume(strands.tubes(two)))
    assert (mesh.colors.values[mesh.points[:, 0] > 3] == [0, 1, 0]).all()


def test_ribbons_face_their_normals():
    mesh = strands.ribbons(line((0, 0, 0), (1, 0, 0), (2, 1, 0), radius=0.25), np.tile([0.0, 0, 1], (3, 1)))
    assert np.allclose(mesh.normals.values, [0, 0, 1])
    corners = mesh.points[mesh.indices].reshape(-1, 4, 3)
    assert (np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] > 0).all()
    assert np.linalg.norm(mesh.points[1] - mesh.points[0]) == pytest.approx(0.5)


@pytest.mark.parametrize(("count", "triangles"), [(3, 320), (3_000, 80), (60_000, 20)])
def test_balls_have_fewer_triangles_the_more_there_are(count, triangles):
    centers = np.arange(count)[:, None] * np.array([3.0, 0, 0])
    mesh = strands.balls(centers, np.full(count, 0.5))
    assert len(mesh.counts) == count * triangles
    first = mesh.points[: len(mesh.points) // count]
    assert np.linalg.norm(first, axis=1) == pytest.approx(0.5)
    corners = mesh.points[mesh.indices].reshape(-1, 3, 3)[:triangles]
    assert (np.linalg.det(corners) > 0).all()


def test_points_in_one_place_make_no_broken_numbers():
    mesh = strands.tubes(line((0, 0, 0), (0, 0, 0), (0, 1, 0), (0, 0, 0)))
    assert np.isfinite(mesh.points).all()


@pytest.mark.long
def test_tubes_do_not_twist():
    """The corners of a tube about a plane curve keep their heights above the plane, also over 100,000 points."""
    t = np.linspace(0, 300, 100_001)
    mesh = strands.tubes(line(*np.stack([t, np.sin(t), 0 * t], axis=1), radius=0.1))
    heights = mesh.points.reshape(len(t), -1, 3)[1:-1, :, 2]
    assert np.ptp(heights, axis=0).max() < 1e-9


@pytest.mark.long
def test_very_many_points_have_open_tubes_of_four_sides():
    t = np.linspace(0, 1000, 500_001)
    mesh = strands.tubes(line(*np.stack([t, 0 * t, 0 * t], axis=1), radius=0.1))
    assert (np.asarray(mesh.counts) == 4).all()
    assert len(mesh.points) == 4 * len(t)
    assert np.hypot(mesh.points[:, 1], mesh.points[:, 2]) == pytest.approx(0.1)
    assert np.einsum("ij,ij->i", mesh.normals.values[:, 1:], mesh.points[:, 1:]) == pytest.approx(0.1, abs=1e-6)


@pytest.mark.parametrize("closed", [False, True])
def test_sharp_corners_keep_the_width_of_the_curve(closed):
    """A zigzag of turns by 174 degrees: each segment has the volume of its tube, and no corner reaches farther than the radius."""
    n, radius = 20, 0.01
    points = np.array([(k % 2, 0.05 * k, 0.0) for k in range(n)])
    made = strands.tubes(strands.Strands(points, np.full(n, radius), np.array([n]), np.array([closed])), np.zeros((n, 2)))
    at = np.asarray(made.points)
    near = np.linalg.norm(at[:, None] - points, axis=2).min(axis=1)
    assert near.max() == pytest.approx(radius) if not closed else near.max() < 3 * radius
    assert len(made.uvs.values) == len(at)
    middle = strands.tubes(strands.Strands(points[:3], np.full(3, radius), np.array([3]), np.array([False])))
    rings = np.asarray(middle.points).reshape(4, -1, 3)
    along = (points[1] - points[0]) / np.linalg.norm(points[1] - points[0])
    assert np.abs((rings[:2] - points[:2, None]) @ along) == pytest.approx(0, abs=1e-12)
