"""The Pareto front and its knee, by hand and by definition."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st
from maquette.measure.chart import pareto

SOME = st.lists(st.tuples(st.integers(1, 9), st.integers(0, 9)), min_size=1, max_size=20)


@given(SOME)
def test_the_front_is_what_no_point_beats(points: list[tuple[int, int]]) -> None:
    times, errors = [p[0] for p in points], [p[1] for p in points]
    front = pareto.front(times, errors)

    def beaten(i: int) -> bool:
        return any(
            times[j] <= times[i] and errors[j] <= errors[i] and (times[j], errors[j]) != (times[i], errors[i]) for j in range(len(points))
        )

    kept = {points[i] for i in front}
    assert kept == {p for i, p in enumerate(points) if not beaten(i)}
    assert len(kept) == len(front)  # of equals one
    assert [times[i] for i in front] == sorted(times[i] for i in front)


def test_the_knee_is_where_the_curve_bends() -> None:
    times, errors = [1.0, 10.0, 100.0, 1000.0], [1.0, 0.02, 0.015, 0.01]
    assert pareto.knee((0, 1, 2, 3), times, errors) == 1


def test_a_straight_line_and_too_few_points_have_no_knee() -> None:
    assert pareto.knee((0, 1, 2), [1.0, 4.0, 16.0], [1.0, 0.5, 0.25]) is None
    assert pareto.knee((0, 1), [1.0, 4.0], [1.0, 0.1]) is None


def test_a_line_that_bends_outwards_has_no_knee() -> None:
    assert pareto.knee((0, 1, 2), [1.0, 10.0, 100.0], [1.0, 0.9, 0.01]) is None


def test_errors_below_the_floor_count_as_it() -> None:
    times, errors = [1.0, 10.0, 100.0], [1.0, 0.01, 0.0001]
    assert pareto.knee((0, 1, 2), times, errors) is None  # straight
    assert pareto.knee((0, 1, 2), times, errors, floor=0.01) == 1
    assert pareto.knee((0, 1, 2), times, [1.0, 0.01, 0.0], floor=0.01) == 1
