"""Shapes that the rasterizer intersects by rays: formulas, quadrics, and shapes too near to the eye for triangles."""

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.plan import plan as planner
from maquette.compiler.scene.row_records import CameraData
from maquette.render.backends import prepare
from maquette.render.raster import view_geometry
from maquette.render.tessellation import analytic_shapes
from maquette.render.types import View

from .. import pictures, tables

K = ir.GeometryKind
RADIUS = 1e7


def planet(height: float = 2.0) -> ir.Tables:
    """A sphere of 10,000 km below the eye, which looks at the horizon, and a small sphere in front."""
    shapes = [(K.SPHERE, [RADIUS], tables.matrix((0, -RADIUS - height, 0)), 0), (K.SPHERE, [0.5], tables.matrix((0, 0, -5)), 0)]
    return tables.scene(shapes, camera=CameraData(0, 0.4))


def tessellations(scene: ir.Tables, tolerance: float) -> dict[int, analytic_shapes.Tessellation]:
    _, decided, view = pictures.planned(scene, "raster", tolerance=tolerance)
    return prepare.prepare(ir.Scene("test", scene, names=ir.Names(cameras=("",))), decided, view).tessellations


def test_the_horizon_of_a_planet():
    """From 2 m above, every pixel shows its ray's hit; a tessellation of 1024 chords would end 47 m below."""
    drawn = [pictures.picture(planet(), backend, aov=("id", "depth")).channels for backend in ("raster", "ray")]
    assert np.array_equal(drawn[0]["id"], drawn[1]["id"])
    is_hit = np.isfinite(drawn[1]["depth"])
    assert np.allclose(drawn[0]["depth"][is_hit], drawn[1]["depth"][is_hit], rtol=1e-6)
    assert 0.4 < is_hit.mean() < 0.6


def test_near_or_very_fine_shapes_have_no_triangles():
    assert list(tessellations(planet(), 0.05)) == [1]
    assert list(tessellations(planet(), 1e-9)) == []
    far = tables.scene([(K.SPHERE, [0.5], tables.matrix((0, 0, -5)), 0)], camera=CameraData(0, 0.4))
    around = [(K.SPHERE, [9.0], tables.matrix((0, 0, -5)), 0), (K.BOX, [9.0] * 3, tables.matrix(), 0)]
    inside = tables.scene(around, camera=CameraData(0, 0.4))
    assert list(tessellations(far, 0.05)) == [0]
    assert list(tessellations(inside, 0.05)) == [1]


def test_a_given_tolerance_holds_and_the_default_is_a_twentieth():
    far = tables.scene([(K.SPHERE, [0.5], tables.matrix((0, 0, -5)), 0)], camera=CameraData(0, 0.4))
    plans = {t: pictures.planned(far, "raster", tolerance=t)[1] for t in (None, 0.4)}
    assert plans[None]["tolerance"] == 0.05
    assert plans[0.4]["tolerance"] == 0.4
    assert pictures.planned(far, "raster", {"tolerance": "0.2"})[1]["tolerance"] == 0.2
    with pytest.raises(planner.PlanError, match="`tolerance` cannot be -1"):
        pictures.planned(far, "raster", {"tolerance": "-1"})
    coarse, fine = (len(tessellations(far, t)[0].triangles) for t in (0.4, 0.05))
    assert 6 < fine / coarse < 12  # a chord's sagitta falls with the square of their number


def test_boxes_of_pixels():
    """Shapes in front of the eye lie in their box plus four pixels; shapes that reach behind it may be anywhere."""
    before = (K.BOX, [1.0, 1.0, 1.0], tables.matrix((0, 0, -5)), 0)
    scene = tables.scene([before, (K.BOX, [9.0] * 3, tables.matrix(), 0), (K.PLANE, [], tables.matrix(), 0)], camera=CameraData(0, 1.0))
    boxes = view_geometry.pixel_boxes(scene, View(0, 80, 80), np.array([0, 1, 2]))
    assert boxes[0].tolist() == [40 - 10 - 4, 40 - 10 - 4, 40 + 10 + 4, 40 + 10 + 4]
    assert (boxes[1:, :2] < -(1 << 20)).all()
    assert (boxes[1:, 2:] > 1 << 20).all()
