"""The distances that `convert` tells hold for random solids, measured by closed forms: of triangles from the surface, and the reverse."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st
from maquette.cli.main import cli
from maquette.compiler.mesh.nearest_triangle import TriangleTree, to_triangles

Points = np.ndarray
SEED = 7


class Solid(NamedTuple):
    """A solid as text, its signed distance, exact on its surface and never farther than the surface, and points that may be on that."""

    text: str
    field: Callable[[Points], np.ndarray]
    samples: Callable[[np.random.Generator], Points]


def placed(text: str, field: Callable, samples: Callable, turn: tuple[float, ...], at: tuple[float, ...]) -> Solid:
    """A primitive turned about x, y and z in this order (degrees), and moved."""
    matrix = np.eye(3)
    for axis, angle in enumerate(np.radians(turn)):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        one = np.eye(3)
        one[i, i] = one[j, j] = np.cos(angle)
        one[j, i], one[i, j] = np.sin(angle), -np.sin(angle)
        matrix = one @ matrix
    turned = f"rotate: [{turn[0]}deg, {turn[1]}deg, {turn[2]}deg], translate: [{at[0]}, {at[1]}, {at[2]}]"
    return Solid(
        f"{text}, {turned})",
        lambda p: field((p - at) @ matrix),
        lambda rng: samples(rng) @ matrix.T + at,
    )


def box(size: tuple[float, ...], turn: tuple[float, ...], at: tuple[float, ...]) -> Solid:
    half = 0.5 * np.array(size)

    def samples(rng: np.random.Generator) -> Points:
        """Faces and edges."""
        points = rng.uniform(-1, 1, (600, 3)) * half
        rows = np.arange(600)
        for k in (0, 1):
            axis = rng.integers(0, 3, 600)
            flat = rows[rows % 2 <= k] if k == 0 else rows[rows % 2 == 0]
            points[flat, axis[flat]] = (half * rng.choice([-1, 1], (600, 3)))[flat, axis[flat]]
        return points

    def field(p: Points) -> np.ndarray:
        q = np.abs(p) - half
        return np.linalg.norm(np.maximum(q, 0), axis=1) + np.minimum(q.max(axis=1), 0)

    return placed(f"box([{size[0]}, {size[1]}, {size[2]}]", field, samples, turn, at)


def sphere(radius: float, at: tuple[float, ...]) -> Solid:
    def samples(rng: np.random.Generator) -> Points:
        way = rng.normal(size=(600, 3))
        return radius * way / np.linalg.norm(way, axis=1, keepdims=True)

    return placed(f"sphere({radius}", lambda p: np.linalg.norm(p, axis=1) - radius, samples, (0, 0, 0), at)


def cylinder(radius: float, height: float, turn: tuple[float, ...], at: tuple[float, ...]) -> Solid:
    def samples(rng: np.random.Generator) -> Points:
        angle, y = rng.uniform(0, 2 * np.pi, 600), rng.uniform(-0.5, 0.5, 600)
        y[::3] = np.sign(y[::3]) / 2  # rims
        return np.stack([radius * np.cos(angle), height * y, radius * np.sin(angle)], axis=1)

    def field(p: Points) -> np.ndarray:
        q = np.stack([np.hypot(p[:, 0], p[:, 2]) - radius, np.abs(p[:, 1]) - height / 2], axis=1)
        return np.linalg.norm(np.maximum(q, 0), axis=1) + np.minimum(q.max(axis=1), 0)

    return placed(f"cylinder({radius}, {height}", field, samples, turn, at)


def combined(kind: str, parts: list[Solid]) -> Solid:
    def field(p: Points) -> np.ndarray:
        values = [part.field(p) for part in parts]
        if kind == "union":
            return np.min(values, axis=0)
        return np.maximum(values[0], np.max([v if kind == "intersection" else -v for v in values[1:]], axis=0))

    def samples(rng: np.random.Generator) -> Points:
        """Points of the parts, and some moved to where two parts meet."""
        found = [part.samples(rng) for part in parts]
        points = np.concatenate(found)[:: len(parts)]
        meet = points.copy()
        one, other = parts[0].field, parts[-1].field
        for _ in range(30):
            for distance in (one, other):
                meet = meet - distance(meet)[:, None] * gradient(distance, meet)
        return np.concatenate([np.concatenate(found), meet])

    return Solid(f"{kind} {{ {'; '.join(part.text for part in parts)} }}", field, samples)


def gradient(field: Callable, p: Points) -> Points:
    step = 1e-6
    return np.stack([(field(p + step * e) - field(p - step * e)) / (2 * step) for e in np.eye(3)], axis=1)


sizes, angles = st.floats(0.4, 2.0).map(lambda x: round(x, 3)), st.integers(-90, 90)
places = st.floats(-0.7, 0.7).map(lambda x: round(x, 3))
turns, positions = st.tuples(angles, angles, angles), st.tuples(places, places, places)
primitives = st.one_of(
    st.builds(box, st.tuples(sizes, sizes, sizes), turns, positions),
    st.builds(sphere, sizes.map(lambda x: x / 2), positions),
    st.builds(cylinder, sizes.map(lambda x: x / 2), sizes, turns, positions),
)
kinds = st.sampled_from(("union", "difference", "intersection"))
pairs = st.builds(combined, kinds, st.lists(primitives, min_size=2, max_size=2))
nested = st.builds(combined, kinds, st.tuples(st.one_of(primitives, pairs), primitives).map(list))


def converted(folder: Path, text: str, deviation: str, ending: str = "stl") -> tuple[Points, np.ndarray, str]:
    """(corners of triangles in metres, y up; whether there is a surface; what is told)"""
    (folder / "a.scene").write_text(text, encoding="utf-8")
    done = CliRunner().invoke(cli, ["convert", str(folder / "a.scene"), str(folder / f"a.{ending}"), "--deviation", deviation])
    if done.exit_code:
        assert "no bounded surface to write" in done.stderr or "nothing" in done.stderr, done.stderr
        return np.zeros((0, 3, 3)), np.zeros(0), done.stderr
    data = (folder / f"a.{ending}").read_bytes()
    rows = np.frombuffer(data[84:], np.dtype([("numbers", "<f4", (4, 3)), ("nothing", "<u2")]))
    corners = rows["numbers"][:, 1:].astype(np.float64) / 1000
    return corners[..., [0, 2, 1]] * [1, 1, -1], rows["nothing"], done.stderr


def told(err: str) -> tuple[float, float]:
    """(distance of triangles from the surface, of the surface from triangles), in metres."""
    off = re.search(r"distance from the true surface (\S+) mm at most", err)
    edges = re.search(r"edges and thin parts of it are (\S+) mm from the triangles at most", err)
    assert off is not None, err
    most = float(off[1]) / 1000
    return most, most if edges is None else float(edges[1]) / 1000


def check(solid: Solid, scale: float, share: float) -> None:
    """The told distances of a solid, in units of `scale` metres, that is asked for within `share` of its unit."""
    rng = np.random.default_rng(SEED)
    text = f"scale({scale!r}) {{ {solid.text} }}\n"
    with tempfile.TemporaryDirectory() as folder:
        corners, _, err = converted(Path(folder), text, f"{share * scale!r}m")
    if not len(corners):
        return
    off, edges = told(err)
    edges = max(edges, share * scale)  # nothing is told of edges within what was asked for
    weights = rng.dirichlet([0.7, 0.7, 0.7], (len(corners), 4))
    points = np.concatenate([np.einsum("mkc,mcx->mkx", weights, corners).reshape(-1, 3), corners.reshape(-1, 3)])
    assert scale * np.abs(solid.field(points / scale)).max() <= off * 1.0001
    surface = solid.samples(rng)
    surface = scale * surface[np.abs(solid.field(surface)) < 1e-9]
    tree = TriangleTree(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
    assert tree.distance(surface).max(initial=0.0) <= edges * 1.0001 + 1e-9 * scale


@settings(max_examples=3, deadline=None, derandomize=True)
@given(pairs, st.sampled_from((0.001, 1.0, 10.0)))
def test_told_distances_hold(solid: Solid, scale: float) -> None:
    check(solid, scale, 0.08)


@pytest.mark.long
@settings(max_examples=60, deadline=None, derandomize=True)
@given(nested, st.sampled_from((0.001, 0.1, 10.0)), st.sampled_from((0.03, 0.01, 0.004)))
def test_told_distances_hold_of_nested_solids(solid: Solid, scale: float, share: float) -> None:
    check(solid, scale, share)


def test_distance_of_triangles() -> None:
    """Against points of triangles: never farther than the nearest of many, and not nearer than their spacing allows."""
    rng = np.random.default_rng(SEED)
    corners = rng.normal(size=(60, 3, 3)) * [1, 1, 0.2]
    points = rng.normal(size=(50, 3)) * 2
    k = 60
    i, j = (x.ravel() for x in np.meshgrid(np.arange(k + 1), np.arange(k + 1)))
    i, j = i[i + j <= k] / k, j[i + j <= k] / k
    many = corners[:, :1] + i[:, None] * (corners[:, 1:2] - corners[:, :1]) + j[:, None] * (corners[:, 2:] - corners[:, :1])
    nearest = np.array([np.linalg.norm(many - p, axis=2).min() for p in points])
    tree = TriangleTree(corners.reshape(-1, 3), np.arange(180).reshape(-1, 3))
    found = tree.distance(points)
    one = np.array([to_triangles(np.repeat(p[None], 60, axis=0), corners).min() for p in points])
    assert found == pytest.approx(one, rel=1e-12)
    assert (found <= nearest + 1e-12).all()
    assert (found >= nearest - 0.1).all()
