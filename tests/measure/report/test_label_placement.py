"""Label placement: boxes, clipped lengths, and labels without overlap."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from maquette.measure.report.label_placement import Box, LabelLayout

AREA = Box(0, 0, 100, 100)
AT = st.floats(-50, 150)


def test_shared_area() -> None:
    assert Box(0, 0, 4, 3).overlap_area(Box(2, 1, 9, 9)) == 4
    assert Box(0, 0, 4, 3).overlap_area(Box(4, 0, 5, 3)) == 0


@given(AT, AT, AT, AT)
def test_length_inside_is_that_of_many_small_steps(x0: float, y0: float, x1: float, y1: float) -> None:
    steps = 2000
    inside = 0
    for i in range(steps):
        t = (i + 0.5) / steps
        x, y = x0 + t * (x1 - x0), y0 + t * (y1 - y0)
        inside += 0 <= x <= 100 and 0 <= y <= 100
    length = math.hypot(x1 - x0, y1 - y0)
    assert AREA.clipped_length((x0, y0), (x1, y1)) == pytest.approx(inside / steps * length, abs=2 * length / steps + 1e-9)


def test_the_first_label_goes_right_above() -> None:
    room = LabelLayout(AREA)
    placed = room.place((20, 10), [(50, 50)], gap=10)
    assert placed is not None
    box, anchor = placed
    assert anchor == (50, 50)
    assert (box.x0, box.y0) == pytest.approx((50 + 10 * math.sqrt(0.5),) * 2)


def test_labels_about_one_point_keep_clear_of_each_other_and_of_it() -> None:
    room = LabelLayout(AREA, points=[Box(44, 44, 56, 56)])
    boxes = [placed[0] for _ in range(8) if (placed := room.place((18, 8), [(50, 50)], gap=9))]
    assert len(boxes) == 8
    for i, a in enumerate(boxes):
        assert a.overlap_area(room.points[0]) == 0
        assert AREA.contains(a)
        assert all(a.overlap_area(b) == 0 for b in boxes[:i])


def test_a_label_keeps_off_lines() -> None:
    line = ((0.0, 60.0), (100.0, 60.0))
    placed = LabelLayout(AREA, lines=[line]).place((30, 10), [(50, 55)], gap=8)
    assert placed is not None
    assert placed[0].clipped_length(*line) == 0


def test_no_place_is_none() -> None:
    full = LabelLayout(AREA, labels=[AREA])
    assert full.place((30, 10), [(50, 50)], gap=8, most=2) is None
    assert full.labels == [AREA]


def test_reach_limits_how_far_a_label_goes() -> None:
    room = LabelLayout(AREA, points=[Box(30, 30, 70, 70)])
    assert room.place((10, 6), [(50, 50)], gap=8, most=1, reach=10) is None
    assert room.place((10, 6), [(50, 50)], gap=8, most=3) is not None
