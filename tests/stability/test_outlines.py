"""Place 50: outlines of tessellated shapes, whose chords lie inside of the true ones."""

from __future__ import annotations

import math

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.scene.row_records import CameraData
from maquette.shapes import surfaces

from ..render import pictures
from ..render.closed import K
from ..render.tables import looking, matrix, scene
from . import naive

DEFAULT = 0.05  # pixels


def on_screen(angle: float, distance: float, radius: float, size: int) -> tuple[float, float]:
    """(area, radius of a disc of it) in pixels of a sphere seen off the axis by `angle`, 90° wide (ORACLES 6).

    With sin α = R/d and Δ = cos²θ − sin²α the outline is an ellipse of semiaxes sin α cos α/Δ and sin α/√Δ on the plane at 1.
    """
    sine = radius / distance
    delta = math.cos(angle) ** 2 - sine**2
    area = math.pi * sine * math.sqrt(1 - sine**2) / delta * sine / math.sqrt(delta) * (size / 2) ** 2
    return area, math.sqrt(area / math.pi)


def covered(backend: str, angle: float, distance: float, size: int, tolerance: float | None = None) -> float:
    """Pixels a unit ball covers there, by 64 samples each."""
    away = distance * np.array([math.sin(angle), 0.0, -math.cos(angle)])
    eye = CameraData(1, 1.0)
    tables = scene([(K.SPHERE, [1.0], matrix(away), 0)], camera=eye, frame=looking((0, 0, 0), (0, 0, -1)))
    overrides = None if tolerance is None else {"tolerance": str(tolerance)}
    image = pictures.picture(tables, backend, overrides, size=(size, size), samples=64, filter="box")
    return float(image.channels["rgba"][..., 3].sum(dtype=np.float64))


@pytest.mark.long
@pytest.mark.parametrize(("angle", "distance", "size"), [(0.5, 4.0, 128), (0.0, 3.0, 96), (0.3, 12.0, 200)])
def test_the_outline_of_a_ball(measured, angle, distance, size):
    """Short by a share of 4/3 · tolerance / R at most; what 64 samples a pixel leave of noise is below a thousandth."""
    area, radius = on_screen(angle, distance, 1.0, size)
    short = 1 - covered("raster", angle, distance, size) / area
    by_rays = 1 - covered("ray", angle, distance, size) / area
    plain = 1 - naive.polygon_area(16, 1.0) / math.pi
    bound = 4 / 3 * DEFAULT / radius
    if size == 128:
        measured.place(
            50, f"the outline of a ball of radius {radius:.0f} pixels, off the axis", naive=f"16 segments: {plain:.1%} of its area short",
            ours=f"to the pixel: {short:.3%} short, by rays {by_rays:+.3%}", bound=f"4/3 · 0.05 px / R = {bound:.2%}, and 10⁻³ of noise",
        )  # fmt: skip
    assert plain > 0.02
    assert -1e-3 < short < bound + 1e-3
    assert abs(by_rays) < 1e-3


@pytest.mark.parametrize("tolerance", [0.8, 0.2])
def test_a_coarser_tolerance_keeps_its_own_bound(tolerance):
    area, radius = on_screen(0.4, 3.0, 1.0, 96)
    assert -1e-3 < 1 - covered("raster", 0.4, 3.0, 96, tolerance) / area < 4 / 3 * tolerance / radius + 1e-3


@pytest.mark.parametrize("radius", [1e-3, 1.0, 250.0])
@pytest.mark.parametrize("share", [0.2, 0.02, 0.002])
def test_chords_keep_the_tolerance(radius, share):
    """The number of segments: a regular polygon's area is short by 4/3 · tolerance / R at most."""
    n = surfaces.segments(radius, share * radius)
    assert 1 - naive.polygon_area(n, radius) / (math.pi * radius**2) <= 4 / 3 * share
    assert isinstance(ir.GeometryKind.SPHERE, ir.GeometryKind)
