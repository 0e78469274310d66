"""chart.json: all numbers of a chart, and an equal chart read back."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from maquette.measure.records import Chart, Curve, Point, Setting, Spread
from maquette.measure.report import json_format

from .. import charts

NUMBERS = st.floats(allow_nan=False)
NAMES = st.text(max_size=8)
SPREADS = st.builds(Spread, NUMBERS, NUMBERS, NUMBERS, st.integers(0, 99))
VALUES = st.one_of(st.integers(), st.floats(allow_nan=False, allow_infinity=False), st.booleans(), NAMES, st.tuples(st.integers(), NAMES))
SETTINGS = st.builds(Setting, NAMES, NAMES, VALUES, st.dictionaries(NAMES, VALUES, max_size=3), st.dictionaries(NAMES, NAMES, max_size=3))
MAYBE = st.none() | NUMBERS
POINTS = st.builds(
    Point, SETTINGS, SPREADS, SPREADS, st.dictionaries(NAMES, SPREADS, max_size=2), MAYBE, MAYBE, MAYBE, MAYBE,
    stages=st.dictionaries(NAMES, NUMBERS, max_size=3), note=NAMES,
)  # fmt: skip
CURVES = st.builds(Curve, NAMES, NAMES, st.lists(POINTS, max_size=3).map(tuple), NAMES)
TEXTS = st.dictionaries(NAMES, NAMES, max_size=2)
CHARTS = st.builds(
    Chart, NAMES, st.tuples(st.integers(1), st.integers(1)), NAMES, NUMBERS, NAMES, st.lists(CURVES, max_size=3).map(tuple),
    st.lists(st.integers(0)).map(tuple), st.none() | st.integers(0), TEXTS, NAMES, TEXTS,
)  # fmt: skip


@pytest.mark.long
@given(CHARTS)
@settings(max_examples=60, deadline=None)
def test_what_is_written_is_read_equal(chart: Chart) -> None:
    assert json_format.read(json_format.dump(chart)) == chart


def test_every_number_is_there_by_name() -> None:
    chart = charts.room()
    data = json.loads(json_format.dump(chart))
    point = chart.curves[2].points[1]
    found = data["curves"][2]["points"][1]
    assert found["setting"] == {
        "backend": "raster", "knob": "samples", "value": 4, "options": {"samples": 4}, "plan": {},
        "arguments": "--backend raster --samples 4",
    }  # fmt: skip
    for name in ("seconds", "error"):
        assert found[name] == dataclasses.asdict(getattr(point, name))
    assert found["errors"] == {name: dataclasses.asdict(spread) for name, spread in point.errors.items()}
    assert [found[name] for name in ("bias", "bias_error", "noise", "noise_error")] == [0.031, point.bias_error, 0.06, point.noise_error]
    assert found["stages"] == {"build": 0.01, "render": 0.05}
    assert [data[name] for name in ("format", "floor", "front", "knee")] == ["maquette chart 1", 0.0012, list(chart.front), 4]


def test_numbers_of_numpy_are_numbers() -> None:
    chart = dataclasses.replace(charts.room(), floor=np.float32(0.5), knee=np.int64(3))
    again = json_format.read(json_format.dump(chart))
    assert (again.floor, again.knee) == (0.5, 3)


def test_endless_numbers_are_words() -> None:
    chart = dataclasses.replace(charts.room(), floor=math.inf)
    assert json.loads(json_format.dump(chart))["floor"] == "inf"
    assert json_format.read(json_format.dump(chart)).floor == math.inf
    assert math.isnan(json_format.read(json_format.dump(dataclasses.replace(chart, floor=math.nan))).floor)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "this is not JSON: Expecting property name enclosed in double quotes: line 1 column 2 (char 1)"),
        ("[1]", "this is not a chart: its `format` is not `maquette chart 1`"),
        ('{"format": "maquette chart 2"}', "this is not a chart: its `format` is not `maquette chart 1`"),
        ('{"format": "maquette chart 1"}', "the chart is not whole: 'size'"),
    ],
)
def test_what_is_no_chart_is_said(text: str, message: str) -> None:
    with pytest.raises(json_format.FormatError) as caught:
        json_format.read(text)
    assert str(caught.value) == message


def test_an_older_chart_is_read() -> None:
    data = json.loads(json_format.dump(charts.room()))
    for point in (p for curve in data["curves"] for p in curve["points"]):
        del point["note"], point["bias_error"]
    assert json_format.read(json.dumps(data)).curves[2].points[0].bias_error is None


def test_a_chart_with_a_part_missing_is_said() -> None:
    data = json.loads(json_format.dump(charts.room()))
    del data["curves"][0]["points"][0]["seconds"]["low"]
    with pytest.raises(json_format.FormatError, match=r"^the chart is not whole: 'low'$"):
        json_format.read(json.dumps(data))
