"""Surfaces on which the gradient vanishes: hits lie on the surface, have its normal, and do not shadow themselves.

Each surface is also the zero set of a function without vanishing gradient, which gives the expected values.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest
from maquette.compiler import ir, load
from maquette.compiler.plan import plan as planner
from maquette.render import render_scene
from maquette.render.accel import ray_queries
from maquette.render.formula import tape_jit
from maquette.render.surface import interaction
from maquette.render.types import Hit, Ray

from .test_packets import packet_hits
from .test_surfaces import scene_of

FIRST, RATIO = 0.1, 10.0**-0.5  # how high the pictures are, at the distance of what they look at
PICTURES = 16


class Singular(NamedTuple):
    """A formula, a function of points (3, n) with the same zero set and its gradient, the eye, the crease, and whether that is an edge."""

    text: str
    smooth: Any
    eye: tuple[float, float, float]
    crease: Any
    edged: bool = False


def heart(p):
    x, y, z = p
    c = np.cbrt(0.9 * x * x + 0.1125 * z * z)
    k = y / (3 * c * c)
    return x * x + 2.25 * z * z + y * y - 1 - c * y, np.array([2 * x - 1.8 * k * x, 2 * y - c, 4.5 * z - 0.225 * k * z])


def ball(p):
    return (p * p).sum(axis=0) - 0.64, 2 * p


def cusp(p):
    """x² = y³ for y ≥ 0; without a gradient at the edge itself."""
    x, y, _ = p
    return abs(x) - np.maximum(y, 0) ** 1.5, np.array([np.sign(x), -1.5 * np.sqrt(np.maximum(y, 0)), 0 * x])


def cone(p):
    x, y, z = p
    rho = np.hypot(x, z)
    return rho + y, np.array([x / rho, 1 + 0 * y, z / rho])


SURFACES = {
    "heart": Singular(
        "implicit(|x, y, z| (x^2 + 2.25 * z^2 + y^2 - 1)^3 <= 0.9 * x^2 * y^3 + 0.1125 * z^2 * y^3, within: 1.5)",
        heart, (0, 0.8, 3), lambda a: (np.cos(1 + a), 0, np.sin(1 + a) / 1.5),
    ),
    "ball": Singular(
        "implicit(|x, y, z| atan((x^2 + y^2 + z^2 - 0.64)^3) <= 0, within: 1)",
        ball, (0.3, 0.8, 3), lambda a: (0.8 * np.sin(a), 0.0, 0.8 * np.cos(a)),
    ),
    "cusp": Singular("implicit(|x, y, z| x^2 <= y^3, within: 1)", cusp, (0.7, -1.1, 2), lambda a: (0, 0, a), edged=True),
    "cone": Singular("implicit(|x, y, z| x^2 + z^2 <= y^2 and y <= 0, within: 1)", cone, (0.3, 0.8, 2), lambda a: (0, 0, 0), edged=True),
}  # fmt: skip


def toward(seen: Singular) -> list[tuple[np.ndarray, np.ndarray]]:
    """Rays of pictures of points of the crease, each picture smaller than the one before."""
    x, y = np.meshgrid((np.arange(64) + 0.5) / 32 - 1, (np.arange(64) + 0.5) / 32 - 1)
    order = np.arange(4096).reshape(4, 4, 4, 4, 4, 4).transpose(0, 3, 1, 4, 2, 5).ravel()
    eye, rays = np.array(seen.eye, float), []
    for k in range(PICTURES):
        size = FIRST * RATIO**k
        d = np.array(seen.crease(0.03 * k)) - eye + np.stack([size * x.ravel(), size * (y + 0.3 * x).ravel(), 0 * x.ravel()], axis=1)[order]
        rays.append((np.tile(eye, (len(d), 1)), d))
    return rays


def hits(trees: Any, o: np.ndarray, d: np.ndarray, packet: bool) -> tuple[np.ndarray, ...]:
    """(t, spacing, u, v) of hits, by a packet or ray by ray."""
    if packet:
        return packet_hits(trees, o, d)
    alone = ray_queries.closest(trees, o, d)
    return alone.t, alone.primitive, alone.u, alone.v


@pytest.mark.long
@pytest.mark.parametrize("packet", [True, False], ids=["packet", "single"])
@pytest.mark.parametrize("name", SURFACES)
def test_hits_lie_on_the_surface_have_its_normal_and_do_not_shadow_themselves(tmp_path, name, packet):
    seen, random = SURFACES[name], np.random.default_rng(1)
    tables = scene_of(tmp_path, seen.text).tables
    trees = ray_queries.build(tables, closed=False)
    tape_jit.finish()
    for o, d in toward(seen):
        t, spacing, u, v = hits(trees, o, d, packet)
        hit = np.isfinite(t)
        ray = Ray(tuple(o[hit].T), tuple(d[hit].T), 0.0, np.inf, None)
        records = Hit(t[hit], np.zeros(hit.sum(), int), spacing[hit], u[hit], v[hit])
        place, normal, offset = interaction.formula_point(tables, 0, ray, records)
        place, normal, way = np.array(place), np.array(normal), d[hit].T
        value, gradient = seen.smooth(place)
        steep = np.linalg.norm(gradient, axis=0)
        sure = abs(place[1]) > 1e-9 if seen.edged else abs(place[1]) > 1e-11  # nearer to edges, rounding exceeds the distance of the sides
        assert sure.any()
        assert (abs(value) <= offset * steep)[sure].all()
        expected = gradient / steep * np.where((gradient * way).sum(axis=0) > 0, -1, 1)
        assert np.linalg.norm(normal - expected, axis=0)[sure].max() < 5e-3
        away = random.normal(size=place.shape)
        away /= np.linalg.norm(away, axis=0)
        away *= np.where((away * expected).sum(axis=0) < 0, -1, 1)
        free = sure & ((away * expected).sum(axis=0) > 0.2)
        hidden = ray_queries.occluded(trees, (place + offset * normal).T, away.T, 0.0, 0.005)
        assert not hidden[free].any()


@pytest.mark.long
def test_a_heart_does_not_shadow_itself_along_the_crease(tmp_path):
    """Lit from the front, each pixel is as bright as the smooth function's normal gives."""
    path = tmp_path / "heart.scene"
    look = "camera(position: [0, 0.3, 3], look_at: [0, 0, 0.6667], fov: 1deg)\ndirectional(from: [1, 2, 1.5], illuminance: 1)\n"
    path.write_text(look + SURFACES["heart"].text[:-1] + ", material: phong(#fff, specular: #000))\n", encoding="utf-8")
    scene = load.load(path)
    settings = ir.Settings(size=(256, 256), samples=4, threads=1, backend="ray", aov=("position",))
    drawn = render_scene.draw(scene, planner.make_plan(scene, settings)).channels
    gradient = heart(np.moveaxis(drawn["position"].astype(float), 2, 0).reshape(3, -1))[1]
    light = np.array([1, 2, 1.5]) / np.linalg.norm([1, 2, 1.5])
    lit = (light @ (gradient / np.linalg.norm(gradient, axis=0))).reshape(256, 256)
    share = drawn["rgba"][..., 0] / lit
    assert share.min() > 0.99 * share.max()
