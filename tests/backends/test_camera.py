"""Near and far planes, corners behind the eye, and crops, on every backend; tests/accuracy tests projections."""

from __future__ import annotations

import math

import numpy as np
import pytest
from maquette.compiler.plan import plan as planner

from .views import alpha, centres, channel

TAN20 = math.tan(math.radians(20))
LIT = "ambient(#ffffff, luminance: 1)\n"
FACING = LIT + "camera(position: [0, 0, 0], look_at: [0, 0, -1], {})\n"


def test_the_near_plane_opens_what_it_cuts(draw):
    """A box from depth 2 m to 4 m, near plane at 3 m: its back wall shows where its front was, and nothing nearer."""
    text = "box(2, center: [0, 0, -3])\n"
    whole = draw(FACING.format("fov: 40deg") + text, aov=("depth",))
    cut = draw(FACING.format("fov: 40deg, near: 3") + text, aov=("depth",))
    assert channel(whole, "depth")[24, 24] == pytest.approx(2.0, rel=1e-6)
    assert channel(cut, "depth")[24, 24] == pytest.approx(4.0, rel=1e-6)
    assert channel(cut, "depth").min() >= 3.0


def test_the_far_plane_ends_the_floor(draw):
    """An unbounded floor 1 m below the eye, far plane at 5 m: rows with depth below 5 m are covered, others not."""
    image = draw(FACING.format("fov: 40deg, far: 5") + "plane(y: -1)\n", aov=("depth",))
    _, y = centres(image)
    f = 48 / (2 * TAN20)
    z = np.where(y > 24, f / np.maximum(y - 24, 1e-9), np.inf)
    assert np.array_equal(alpha(image) == 1.0, z < 5)
    assert np.allclose(channel(image, "depth")[z < 5], z[z < 5], rtol=1e-6)
    assert np.isinf(channel(image, "depth")[z > 5]).all()


def test_a_triangle_that_passes_the_eye_is_drawn_where_rays_meet_it(draw, draw_on):
    """Corners at depths −1, 0.01 and 5: division by w without clipping gives garbage."""
    text = FACING.format("fov: 60deg") + "triangle([[0.3, -0.5, 1], [-0.004, 0.001, -0.01], [1.5, 2, -5]])\n"
    here, exact = draw(text, aov=("depth",)), draw_on("reference", text, aov=("depth",))
    assert 50 < alpha(exact).sum() < 48 * 48 - 50
    assert np.count_nonzero(alpha(here) != alpha(exact)) <= 2  # a corner snapped to 1/256 pixel may take or give an edge's sample
    both = (alpha(here) == 1) & (alpha(exact) == 1)
    assert np.allclose(channel(here, "depth")[both], channel(exact, "depth")[both], rtol=1e-5)


def test_ids_are_rows_of_instances_and_materials(draw):
    text = FACING.format("fov: 40deg") + (
        "box(1, center: [-1, 0, -4], material: lambert(#ff0000))\nbox(1, center: [1, 0, -4], material: lambert(#00ff00))\n"
    )
    image = draw(text, aov=("id", "albedo", "depth"))
    ids, albedo = channel(image, "id"), channel(image, "albedo")
    assert ids[24, 14].tolist() == [0, 0]
    assert ids[24, 34].tolist() == [1, 1]
    assert ids[0, 0].tolist() == [-1, -1]
    assert albedo[24, 14].tolist() == [1, 0, 0]
    assert albedo[24, 34].tolist() == [0, 1, 0]
    assert math.isinf(channel(image, "depth")[0, 0])


def test_a_crop_outside_the_picture_is_refused(draw):
    with pytest.raises(planner.PlanError, match="does not lie inside"):
        draw(FACING.format("fov: 40deg") + "sphere(1)\n", crop=(0, 0, 99, 99))
