"""Fields of polygons: their sign is that of a point inside, their size at most the distance, each edge occurs once; swept likewise."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from maquette.compiler.formula import numpy_interpreter, polygon_fields
from maquette.compiler.formula.builder import Builder
from maquette.compiler.formula.tape import X, Y, Z
from maquette.compiler.mesh import profiles

whole = st.integers(0, 12)
polygons = st.lists(st.tuples(whole, whole), min_size=3, max_size=14, unique=True)


def untangled(points: list[tuple[int, int]]) -> np.ndarray:
    """A simple polygon of points: crossing edges are exchanged (2-opt) until none is left; else the example is left out."""
    order = [np.array(p, dtype=np.float64) for p in points]
    for _ in range(200):
        try:
            return profiles.outline([tuple(p) for p in order])
        except profiles.ProfileError:
            pass
        exchanged = False
        for i in range(len(order) - 1):
            for j in range(i + 2, len(order)):
                a, b, c, d = order[i], order[i + 1], order[j], order[(j + 1) % len(order)]
                if np.linalg.norm(a - c) + np.linalg.norm(b - d) < np.linalg.norm(a - b) + np.linalg.norm(c - d) - 1e-9:
                    order[i + 1 : j + 1] = order[i + 1 : j + 1][::-1]
                    exchanged = True
        if not exchanged:
            break
    assume(False)
    raise AssertionError


def plane_field(loop: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    b = Builder()
    made = polygon_fields.field(b, loop, lambda b, n, c: b.linear([(float(n[0]), X), (float(n[1]), Y)], -c))
    assert made is not None
    return numpy_interpreter.points(b.finish(made), x, y, 0.0)[0]


def insides(loop: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Whether points (n, 2) lie inside, by the edges that a ray along x crosses."""
    a, b = loop, np.roll(loop, -1, axis=0)
    x, y = points[:, :1], points[:, 1:]
    with np.errstate(divide="ignore", invalid="ignore"):
        at = a[:, 0] + (y - a[:, 1]) / (b[:, 1] - a[:, 1]) * (b[:, 0] - a[:, 0])
    return (((a[:, 1] > y) != (b[:, 1] > y)) & (at > x)).sum(axis=1) % 2 == 1


def distance(loop: np.ndarray, points: np.ndarray) -> np.ndarray:
    a, way = loop, np.roll(loop, -1, axis=0) - loop
    share = np.clip(((points[:, None] - a) * way).sum(axis=2) / (way**2).sum(axis=1), 0, 1)
    return np.linalg.norm(points[:, None] - a - share[..., None] * way, axis=2).min(axis=1)


@pytest.mark.long
@settings(deadline=None, max_examples=100)
@given(polygons)
def test_the_field_is_negative_inside_alone(points):
    loop = untangled(points)
    grid = np.stack(np.meshgrid(np.linspace(-2.03, 14.01, 41), np.linspace(-2.01, 14.03, 41)), axis=-1).reshape(-1, 2)
    edges = 0.5 * (loop + np.roll(loop, -1, axis=0))
    tests = np.concatenate([grid, *(edges + offset for offset in ([0.01, 0.003], [-0.01, 0.003], [0.002, -0.01]))])
    found, near = plane_field(loop, *tests.T), distance(loop, tests)
    inside = insides(loop, tests)
    clear = near > 1e-6
    assert ((found < 0) == inside)[clear].all()
    assert (np.abs(found) <= near + 1e-9).all()


@pytest.mark.long
@settings(deadline=None, max_examples=50)
@given(polygons)
def test_each_edge_occurs_once(points):
    loop = polygon_fields.without_straight_corners(untangled(points))

    def edges(node) -> list[int]:
        return [node.edge] if node.op is None else [k for part in node.parts for k in edges(part)]

    assert sorted(edges(polygon_fields.formula(loop))) == list(range(len(loop)))


@pytest.mark.long
@settings(deadline=None, max_examples=40)
@given(polygons, st.sampled_from([2 * math.pi, math.pi, 1.0, 4.5]))
def test_a_revolved_field(points, angle):
    """In the half plane at any angle it has the sign of the profile, within the turn; the axis is no surface."""
    loop = untangled(points)
    b = Builder()
    tape = b.finish(polygon_fields.revolved(b, loop, angle, (X, Y, Z)))
    axes = np.linspace(0.0, 14.0, 29), np.linspace(-1.01, 13.03, 29), np.arange(0.05, 6.2, 0.7)
    radius, y, turned = (g.ravel() for g in np.meshgrid(*axes))
    found = numpy_interpreter.points(tape, radius * np.cos(turned), y, -radius * np.sin(turned))[0]
    section = np.stack([radius, y], axis=1)
    edges = np.stack([loop, np.roll(loop, -1, axis=0)], axis=1)
    bounding = edges[(edges[:, :, 0] > 0).any(axis=1)]
    near = np.array([distance(edge, section) for edge in bounding]).min(axis=0)
    inside = insides(loop, np.maximum(section, (1e-9, -np.inf))) & (turned < angle)
    clear = (near > 1e-6) & ((radius > 0) | (angle >= 2 * math.pi))
    assert ((found < 0) == inside)[clear].all()
    assert (found != 0)[clear].all()


@pytest.mark.long
@settings(deadline=None, max_examples=25)
@given(polygons, st.sampled_from([0.0, 1.3]), st.sampled_from([0.5, 1.0, 2.0]))
def test_a_prism(points, twist, taper):
    """A point is inside where, turned back and scaled back, it is inside of the profile, and between the ends."""
    loop = untangled(points)
    b = Builder()
    tape = b.finish(polygon_fields.prism(b, polygon_fields.Prism((loop,), 1.0, 4.0, twist, taper), (X, Y, Z)))
    x, y, z = (g.ravel() for g in np.meshgrid(np.linspace(-25.03, 25.1, 23), np.linspace(0.3, 5.9, 9), np.linspace(-25.07, 25.01, 23)))
    share = (y - 1.0) / 4.0
    c, s = np.cos(twist * share), np.sin(twist * share)
    u, v = c * x - s * z, -(s * x + c * z)  # turned back about y, as [x, -z]
    scale = 1 + (taper - 1) * share
    section = np.stack([u / scale, v / scale], axis=1)
    inside = insides(loop, section) & (share > 0) & (share < 1)
    found = numpy_interpreter.points(tape, x, y, z)[0]
    clear = (distance(loop, section) > 1e-6) & (scale > 0)
    assert ((found < 0) == inside)[clear & (share > 0) & (share < 1)].all()
    assert (found > 0)[(share < 0) | (share > 1)].all()


def test_a_cylinder_and_a_cone_have_their_own_fields():
    b = Builder()
    tape = b.finish(polygon_fields.revolved(b, profiles.outline([(0, 0), (2, 0), (2, 1), (0, 1)]), 7.0, (X, Y, Z)))
    x, y, z = np.random.default_rng(1).uniform(-3, 3, (3, 200))
    expected = np.maximum(np.hypot(x, z) - 2, np.maximum(-y, y - 1))
    assert numpy_interpreter.points(tape, x, y, z)[0] == pytest.approx(expected)
