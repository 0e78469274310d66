"""Blends: weights of the parts, in every backend and for every kind of part; invalid blends."""

from __future__ import annotations

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.scene.row_records import Input, MaterialData
from maquette.render.material import principled
from maquette.render.surface import blend as surface_blend

from ...accuracy import radiometry as rm
from .. import tables as make

K = ir.GeometryKind
VIEW = "camera(position: [0, 2, 0], look_at: [0, 0, 0], up: [0, 0, -1], width: 1)\ndirectional(from: [0, 1, 0])\n"


def grey(value):
    return MaterialData(inputs={ir.Slot.DIFFUSE: Input((value,) * 3)})


def blend(first, second, weight):
    return MaterialData(ir.MaterialModel.BLEND, {ir.Slot.WEIGHT: Input.number(weight)}, first=first, second=second)


def test_parts_are_chosen_by_their_weight():
    """Of 0.3 · (0.25 a + 0.75 b) + 0.7 c."""
    parts = [grey(0.1), grey(0.2), grey(0.3), blend(0, 1, 0.75), blend(3, 2, 0.7)]
    tables = principled.tables_for(make.scene([(K.SPHERE, (1,), make.matrix(), 4)], materials=parts))
    assert tables.materials.blended.deep == 2  # pyright: ignore

    class Point:
        material = np.full(10_000, 4)
        offset = np.zeros(10_000)
        position = local = geometric = normal = local_normal = uv = metric = front = instance = color = None
        time = spread = lift = known = tangent = None

    point = surface_blend.choose_part(tables, Point, (np.arange(10_000) + 0.5) / 10_000)
    assert np.bincount(point.material, minlength=5).tolist() == [750, 2250, 7000, 0, 0]


def test_scenes_without_blends_keep_their_tables():
    tables = make.scene([(K.SPHERE, (1,), make.matrix(), 0)])
    assert isinstance(surface_blend.find_blends(tables), surface_blend.Unblended)
    assert principled.tables_for(tables) is tables


@pytest.mark.parametrize("backend", ["ray", "raster", "reference"])
def test_a_picture_of_a_blend(tmp_path, backend):
    """White and black by 0.25 with irradiance π have the mean 0.75; a weight of 0 or 1 gives one part."""
    text = VIEW + "plane(y: 0, material: blend(lambert(1), lambert(0), {}))\n"
    grey = rm.grey(rm.picture(tmp_path, text.format(0.25), backend, size=(24, 24), samples=16))
    assert abs(grey.mean() - 0.75) < 5 * 0.433 / (24 * 4)
    for weight, value in ((0, 1.0), (1, 0.0)):
        assert np.abs(rm.grey(rm.picture(tmp_path, text.format(weight), backend, size=(4, 4), samples=4)) - value).max() < 1e-6
