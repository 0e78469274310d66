"""Tubes: closed, with the volumes of their closed forms; mitres, tips, caps, frames without twist, folds."""

from __future__ import annotations

import math

import numpy as np
import pytest
import trimesh
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from maquette.compiler.mesh import polygon_mesh, tubes

from .test_swept import of_scene

SIDES = 32
REST = "\ncamera([0, 1, 5])\nsun()\n"


def section(sides: int = SIDES) -> float:
    """The area of a regular polygon in the unit circle."""
    return 0.5 * sides * math.sin(2 * math.pi / sides)


def solid(points, radii, closed=False, caps="flat") -> trimesh.Trimesh:
    path = np.array(points, dtype=np.float64)
    made = tubes.tube(path, np.broadcast_to(np.asarray(radii, np.float64), len(path)), closed, caps, SIDES)
    assert made.fold is None
    data, dropped = polygon_mesh.assemble(made.mesh)
    assert dropped == 0
    return trimesh.Trimesh(data.positions, data.triangles, process=False)


def length(points, closed=False) -> float:
    path = np.array(points, dtype=np.float64)
    legs = np.roll(path, -1, axis=0) - path
    return float(np.linalg.norm(legs if closed else legs[:-1], axis=1).sum())


ELBOW = [(0, 0, 0), (0, 2, 0), (3, 2, 0), (3, 2, 1.5), (5, 4, 1.5)]
RING = [(2, 0, 0), (0, 1, 2), (-2, 0, 0), (0, -1, -2)]


@pytest.mark.parametrize(("points", "closed"), [(ELBOW[:2], False), (ELBOW, False), (RING, True)])
def test_a_mitred_tube_has_area_times_length(points, closed):
    """Each cut goes through the middle of its section: what it takes on one side it gives on the other."""
    made = solid(points, 0.2, closed)
    assert made.is_watertight
    assert made.volume == pytest.approx(section() * 0.2**2 * length(points, closed), rel=1e-9)
    assert made.euler_number == (0 if closed else 2)


def test_a_tip_makes_a_cone():
    made = solid([(0, 0, 0), (1, 2, 2)], [0.6, 0.0])
    assert made.is_watertight
    assert made.volume == pytest.approx(section() * 0.6**2 * 3 / 3, rel=1e-9)
    assert solid([(0, 0, 0), (1, 2, 2)], [0.0, 0.6]).volume == pytest.approx(made.volume)


def test_radii_are_a_frustum():
    made = solid([(0, 0, 0), (0, 0, -3)], [0.5, 0.2])
    assert made.volume == pytest.approx(section() * 3 / 3 * (0.25 + 0.1 + 0.04), rel=2e-3)  # quads of a cone are cut into triangles


def test_round_caps_are_half_spheres():
    made = solid([(0, 0, 0), (0, 3, 0)], 0.5, caps="round")
    assert made.is_watertight
    assert made.volume == pytest.approx(math.pi * 0.25 * 3 + 4 / 3 * math.pi * 0.125, rel=2e-2)
    assert made.bounds[:, 1] == pytest.approx([-0.5, 3.5])
    reach = np.linalg.norm(made.vertices - np.clip(made.vertices, [0, 0, 0], [0, 3, 0]), axis=1)
    assert reach == pytest.approx(0.5)


def test_open_ends():
    made = solid([(0, 0, 0), (0, 3, 0)], 0.5, caps="open")
    assert not made.is_watertight
    assert len(trimesh.grouping.group_rows(made.edges_sorted, require_count=1)) == 2 * SIDES


@pytest.mark.parametrize("vertical", [False, True])
def test_frames_do_not_turn_about_a_plane_curve(vertical):
    """In a plane curve the first line of the tube stays at one angle to the plane, also through a turn of its bend."""
    t = np.linspace(0, 12, 80)
    path = np.stack([t, np.sin(t), 0 * t], axis=1)
    if vertical:
        path = path[:, [1, 0, 2]]
    made = tubes.tube(path, np.full(len(path), 0.1), False, "flat", SIDES)
    lines = made.mesh.points.reshape(len(path), SIDES, 3) - path[:, None]
    assert np.abs(lines[:, 0, 2] - lines[0, 0, 2]).max() < 1e-9


def test_a_closed_tube_has_no_seam():
    """The lines along a closed space curve end where they begin: no quad turns by more than its share of the whole."""
    t = 2 * math.pi * np.arange(200) / 200
    path = np.stack([np.cos(t), np.sin(t), 0.5 * np.sin(2 * t)], axis=1)
    made = tubes.tube(path, np.full(len(path), 0.1), True, "flat", SIDES)
    rings = made.mesh.points.reshape(len(path) + 1, SIDES, 3)[:-1]
    steps = np.linalg.norm(np.roll(rings, -1, axis=0) - rings, axis=2)
    apart = np.linalg.norm(np.roll(path, -1, axis=0) - path, axis=1)
    assert (steps / apart[:, None]).max() < 1.3
    assert solid(path, 0.1, True).is_watertight


numbers = st.integers(-20, 20).map(lambda k: k / 4)


@pytest.mark.long
@settings(deadline=None, max_examples=50)
@given(
    st.lists(st.tuples(numbers, numbers, numbers), min_size=3, max_size=8, unique=True), st.booleans(), st.sampled_from(["flat", "round"])
)
def test_every_path_is_closed(points, closed, caps):
    path = np.array(points)
    try:
        made = tubes.tube(path, np.full(len(path), 0.02), closed, caps, 12)
    except tubes.TubeError:
        assume(False)
        raise
    data, _ = polygon_mesh.assemble(made.mesh)
    whole = trimesh.Trimesh(data.positions, data.triangles, process=False)
    assert whole.is_watertight
    if made.fold is None and caps == "flat":
        # The quads of a closed tube turn a little, to meet without a seam.
        assert whole.volume == pytest.approx(section(12) * 0.02**2 * length(points, closed), rel=1e-2 if closed else 1e-6)


def test_a_tight_bend_is_told():
    made = tubes.tube(np.array([(0.0, 0, 0), (1, 0, 0), (1, 0.3, 0), (0, 0.3, 0)]), np.full(4, 0.5), False, "flat", SIDES)
    assert made.fold is not None
    assert made.fold.tolist() == [0, 0, 0] or made.fold.tolist() == [1, 0, 0]


def test_a_torus_of_a_spline(compiled):
    """Through 36 points of a circle: Pappus, (π r²) (2π R)."""
    made = of_scene(compiled('curve([[cos(k * 10deg), 0, sin(k * 10deg)] for k in 0..35], 0.2, kind: "catmull_rom", closed: true)' + REST))
    assert made.is_watertight
    assert made.volume == pytest.approx(math.pi * 0.04 * 2 * math.pi, rel=5e-3)


def test_a_tube_is_a_part_of_solids(compiled):
    made = of_scene(compiled("difference { box([2, 1, 1]); curve([[-2, 0, 0], [2, 0, 0]], 0.25) }" + REST))
    assert made.is_watertight
    assert made.volume == pytest.approx(2 - math.pi * 0.0625 * 2, rel=2e-3)  # the tube has 24 sides


BACK = 'add a point beside the corner, or write kind: "catmull_rom"'


@pytest.mark.parametrize(
    ("text", "message", "hint"),
    [
        ("curve([[0, 0, 0]], 1)", "error: a curve has two points or more, got 1", ""),
        ("curve([[0, 0, 0], [0, 0, 0]], 1)", "error: the points are the same: a curve has two different ones or more", ""),
        ("curve([], 1)", "error: a curve has two points or more, got 0", ""),
        ("curve([[0, 0, 0], [0, 0, 0]], 1, kind: \"bspline\")",
         "error: the points are the same: a curve has two different ones or more", ""),
        ("curve([[0, 0, 0], [1, 0, 0]], 1, closed: true)", "error: a closed curve has three points or more, got 2", ""),
        ("curve([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [1, 2])", "error: the curve has 3 points and 2 radii",
         "give one radius for each point, or one for all"),
        ("curve([[0, 0, 0], [1, 0, 0]], 0)", "error: `radius` must be more than 0, got 0", ""),
        ("curve([[0, 0, 0], [1, 0, 0]], [0, 0])", "error: the radii of both ends are 0: the tube has no volume",
         "give one of them a radius"),
        ("curve([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [1, 0, 1])", "error: radius 2 is 0",
         "a tip is at an end: only the first and the last may be 0"),
        ("curve([[0, 0, 0], [1, 0, 0], [2, 1, 0]], [0, 1, 1], closed: true)", "error: radius 1 is 0", "a closed tube has no tip"),
        ("curve([[0, 0, 0], [1, 0, 0], [1, 0, 0], [2, 0, 0]], [1, 1, 2, 2])", "error: points 2 and 3 are the same and have two radii",
         "move one of them a little"),
        ("curve([[0, 0, 0], [1, 0, 0], [0, 0.1, 0]], 1cm)",
         "error: the curve turns back by 174° at [1, 0, 0] m: no corner joins these tubes",
         BACK),
        ("curve([[0, 0, 0], [1, 0, 0], [2, 0, 0]], 1cm, closed: true)",
         "error: the curve turns back by 180° at [0, 0, 0] m: no corner joins these tubes", BACK),
        ("curve([[0, 0, 0], [1, 0, 0], [1, 0.3, 0], [0, 0.3, 0]], 0.5)",
         "warning: the tube folds into itself near [1, 0, 0] m: its bend is tighter than its radius", "a smaller radius, or a wider bend"),
        ("curve([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 3, 0], [5, 5, 5]], 0.1, kind: \"bezier\")",
         "error: a Bézier curve has 2, 3, 4, 7, 10, 13, … points, got 5",
         "pieces share their ends: a point on the curve, two handles, a point on the curve, …"),
    ],
)  # fmt: skip
def test_messages(said, text, message, hint):
    found = said(text + REST + "sphere(1)").splitlines()
    assert found[0] == f"a.scene:1:1: {message}"
    assert found[2].endswith(f"^ {hint}" if hint else "^")
    assert len(found) == 3


def test_a_negative_radius(said):
    found = said("curve([[0, 0, 0], [1, 0, 0]], [1, -2])" + REST).splitlines()
    assert found[0] == "a.scene:1:35: error: `radius` must be 0 or more, got -2"
