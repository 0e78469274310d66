"""The chart read back from its SVG: points, bars, front, knee, floors, names, and labels without overlap."""

from __future__ import annotations

import dataclasses
import io
import itertools
import math
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from maquette.measure.metric_table import METRICS
from maquette.measure.records import Chart, Curve, Spread
from maquette.measure.report import palette, plot
from maquette.measure.report.label_placement import Box
from PIL import Image

from .. import charts

SVG = "{http://www.w3.org/2000/svg}"


def parsed(chart: Chart) -> ET.Element:
    return ET.fromstring(plot.svg(chart))


def by_id(tree: ET.Element, name: str) -> ET.Element:
    found = [element for element in tree.iter() if element.get("id") == name]
    assert len(found) == 1, f"{len(found)} of {name}"
    return found[0]


def place(tree: ET.Element, index: int) -> tuple[float, float]:
    use = next(by_id(tree, f"point-{index}").iter(f"{SVG}use"))
    return float(use.get("x", "")), float(use.get("y", ""))


def words(tree: ET.Element) -> list[str]:
    return ["".join(element.itertext()).replace("\N{NO-BREAK SPACE}", " ") for element in tree.iter(f"{SVG}text")]


def drawn(name: str, tree: ET.Element) -> list[tuple[float, float]]:
    """The corners of a line."""
    path = next(by_id(tree, name).iter(f"{SVG}path")).get("d", "")
    numbers = [float(word) for word in path.replace("M", " ").replace("L", " ").split()]
    return list(zip(numbers[::2], numbers[1::2], strict=True))


@pytest.mark.long
def test_every_point_is_where_its_logarithms_say() -> None:
    chart = charts.room()
    tree = parsed(chart)
    places = np.array([place(tree, i) for i in range(len(chart.points))])
    for axis, values in ((0, [p.seconds.median for p in chart.points]), (1, [p.error.median for p in chart.points])):
        logs = np.log(values)
        slope, start = np.polyfit(logs, places[:, axis], 1)
        assert np.allclose(places[:, axis], slope * logs + start, atol=1e-3)
        assert (slope > 0) == (axis == 0)  # later is right, and a larger error is up, where y is less


@pytest.mark.long
def test_each_point_says_what_it_is() -> None:
    chart = charts.room()
    title = by_id(parsed(chart), "point-3").find(f"{SVG}title")
    assert title is not None
    assert title.text == "ray, 64 samples: 670 ms (600 ms to 740 ms), 3.9 % (3.7 % to 4.1 %)\n--backend ray --samples 64"


@pytest.mark.long
def test_curves_bars_front_knee_and_floors_are_there() -> None:
    chart = charts.room()
    tree = parsed(chart)
    scale = Scale(chart, tree)
    for i, curve in enumerate(chart.curves):
        expected = [scale(p.seconds.median, p.error.median) for p in curve.points]
        assert np.allclose(drawn(f"curve-{i}", tree), expected, atol=2e-3)
    for i, p in enumerate(chart.points):
        x, y = scale(p.seconds.median, p.error.median)
        across, upright = drawn(f"time-{i}", tree), drawn(f"error-{i}", tree)
        assert np.allclose(across, [(scale(p.seconds.low, 1)[0], y), (scale(p.seconds.high, 1)[0], y)], atol=2e-3)
        assert np.allclose(upright, [(x, scale(1, p.error.low)[1]), (x, scale(1, p.error.high)[1])], atol=2e-3)
    corners = [scale(chart.points[i].seconds.median, chart.points[i].error.median) for i in chart.front]
    assert all(any(math.dist(corner, at) < 2e-3 for at in drawn("front", tree)) for corner in corners)
    assert drawn("bias-0", tree)[0][1] == pytest.approx(scale(1, 0.031)[1], abs=2e-3)
    assert min(y for _, y in drawn_box("floor", tree)) == pytest.approx(scale(1, 0.0012)[1], abs=2e-3)
    said = words(tree)
    for text in (
        "room.scene: error against time",
        "400×300, 2 threads of a machine. Medians of 5 runs, bars are quartiles.",
        "Measured against 262144 samples of ray, seeds 1000 to 1015",
        "knee: ray, 256 samples",
        "1.9 % in 2.6 s",
        "raster stops: no interreflection: bias 3.1 %",
        "the reference's own uncertainty, 0.12 %",
        "Not charted: povray: not installed: apt install povray.",
        *("ray by samples", "ray by error", "raster", "reference", "mitsuba"),
    ):
        assert text in said


class Scale:
    """From seconds and error to the drawing, by two of its points."""

    def __init__(self, chart: Chart, tree: ET.Element) -> None:
        a, b = chart.points[0], chart.points[6]
        (ax, ay), (bx, by) = place(tree, 0), place(tree, 6)
        self.x = (bx - ax) / math.log(b.seconds.median / a.seconds.median)
        self.y = (by - ay) / math.log(b.error.median / a.error.median)
        self.at = ax - self.x * math.log(a.seconds.median), ay - self.y * math.log(a.error.median)

    def __call__(self, seconds: float, error: float) -> tuple[float, float]:
        return self.at[0] + self.x * math.log(seconds), self.at[1] + self.y * math.log(error)


def drawn_box(name: str, tree: ET.Element) -> list[tuple[float, float]]:
    path = next(by_id(tree, name).iter(f"{SVG}path")).get("d", "").replace("z", "")
    numbers = [float(word) for word in path.replace("M", " ").replace("L", " ").split()]
    return list(zip(numbers[::2], numbers[1::2], strict=True))


@pytest.mark.long
def test_the_same_chart_is_the_same_file() -> None:
    assert plot.svg(charts.room()) == plot.svg(charts.room())


def test_without_a_floor_a_front_or_spread_nothing_is_drawn_for_them() -> None:
    points = tuple(dataclasses.replace(p, seconds=once(p.seconds), error=once(p.error)) for p in charts.sweep("ray", 0.1, 0.1, 0.2, 3))
    ids = {element.get("id") for element in parsed(charts.chart(Curve("ray", "samples", points))).iter()}
    assert not ids & {"floor", "front", "front-points", "knee", "bias-0", "time-0", "error-0", "stops-0"}
    assert {"point-0", "point-1", "point-2", "curve-0", "name-0"} <= ids


def once(spread: Spread) -> Spread:
    return Spread(spread.median, spread.median, spread.median, 1)


def test_one_point_is_a_chart() -> None:
    only = charts.chart(Curve("raster", "samples", charts.sweep("raster", 0.1, 0, 0.2, 1)), front=(0,), knee=0)
    assert "knee: raster, 1 sample" in words(parsed(only))


def test_no_error_at_all_stands_at_the_lower_edge() -> None:
    first, second = charts.sweep("raster", 0.1, 0.1, 0.2, 2)
    second = dataclasses.replace(second, error=Spread(0, 0, 0, 5))
    chart = charts.chart(Curve("raster", "samples", (first, second)))
    tree = parsed(chart)
    bottom = max(y for _, y in drawn_box("patch_2", tree))
    assert place(tree, 0)[1] < place(tree, 1)[1] < bottom
    assert bottom - place(tree, 1)[1] < 30
    assert words(tree)[-1].endswith("; triangle at the lower edge: no error at all.")


def test_all_exact_is_drawn() -> None:
    exact = dataclasses.replace(charts.point("raster", "samples", 1, 0.1, 1.0), error=Spread(0, 0, 0, 5))
    assert len([e for e in parsed(charts.chart(Curve("raster", "samples", (exact,)))).iter() if e.get("id") == "point-0"]) == 1


@pytest.mark.long
def test_png_is_a_picture_of_the_size_asked_for() -> None:
    image = Image.open(io.BytesIO(plot.png(charts.room(), dpi=100)))
    assert image.size == (960, 660)
    assert image.convert("RGB").getpixel((0, 0)) == (255, 255, 255)


@pytest.mark.long
@pytest.mark.parametrize("metric", list(METRICS))
def test_each_metric_has_its_axis(metric: str) -> None:
    ray = Curve("ray", "samples", charts.sweep("ray", 0.03, 0.01, 0.31, 7))
    said = words(parsed(dataclasses.replace(charts.chart(ray), metric=metric)))
    assert METRICS[metric].axis in said
    assert any(text.endswith(" %") for text in said) == METRICS[metric].share


@pytest.mark.long
def test_labels_do_not_cover_each_other_or_leave_the_picture() -> None:
    picture = plot.ChartPlot(charts.room())
    for a, b in itertools.combinations(picture.layout.labels, 2):
        assert a.overlap_area(b) == 0
    width, height = picture.figure.get_size_inches() * picture.figure.dpi
    assert all(Box(0, 0, width, height).contains(label) for label in picture.layout.labels)


@pytest.mark.long
def test_long_words_stay_on_the_picture() -> None:
    long = "a reason that goes on and on, " * 12
    curve = Curve("raster", "samples", charts.sweep("raster", 0.1, 0.1, 0.2, 4, bias=0.1), f"{long}: bias 10 %")
    machine = " ".join(["a machine with a long name"] * 9)
    left_out = dict.fromkeys(("mitsuba", "povray", "ray", "reference"), long)
    chart = charts.chart(curve, machine=machine, left_out=left_out)
    chart = dataclasses.replace(chart, scene=f"room.scene --set text='{long}'")
    picture = plot.ChartPlot(chart)
    renderer = picture.canvas.get_renderer()
    width, height = picture.figure.get_size_inches() * picture.figure.dpi
    boxes = [text.get_window_extent(renderer) for text in picture.figure.texts]
    assert all(box.x0 >= 0 and box.x1 <= width and box.y0 >= 0 and box.y1 <= height for box in boxes)
    axes = picture.axes.get_window_extent()
    assert axes.height > 100
    assert not any(box.y0 < axes.y1 and box.y1 > axes.y0 for box in boxes)


@pytest.mark.long
def test_points_are_not_hidden_by_names() -> None:
    picture = plot.ChartPlot(charts.room())
    assert max(label.overlap_area(point) for label in picture.layout.labels for point in picture.layout.points) < 5  # of 144 square pixels


# --- colours ---------------------------------------------------------------------------------------------------------------

# Viénot, Brettel and Mollon (1999): linear sRGB as people without L cones (protanopia) or M cones (deuteranopia) see it.
DICHROMATS = {
    "protanopia": [[0.11238, 0.88762, 0.0], [0.11238, 0.88762, 0.0], [0.00401, -0.00401, 1.0]],
    "deuteranopia": [[0.29275, 0.70725, 0.0], [0.29275, 0.70725, 0.0], [-0.02234, 0.02234, 1.0]],
}


def linear(color: str) -> np.ndarray:
    v = np.array([int(color[i : i + 2], 16) / 255 for i in (1, 3, 5)])
    return np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)


def luminance(color: str) -> float:
    return float(linear(color) @ [0.2126, 0.7152, 0.0722])


def contrast(a: str, b: str) -> float:
    """WCAG 2: (lighter + 0.05) / (darker + 0.05)."""
    high, low = sorted((luminance(a), luminance(b)), reverse=True)
    return (high + 0.05) / (low + 0.05)


def test_words_can_be_read_on_both_papers() -> None:
    dark = palette.ON_DARK
    for name, on_light, on_dark in palette.variables():
        if name.startswith("--w"):
            assert contrast(on_light, palette.PAPER) >= 4.5, on_light
            assert contrast(on_dark, dark[palette.PAPER]) >= 4.5, on_dark
    for words_color in (palette.INK, palette.FAINT):
        assert contrast(words_color, palette.PAPER) >= 4.5
        assert contrast(dark[words_color], dark[palette.PAPER]) >= 4.5


@pytest.mark.parametrize("kind", list(DICHROMATS))
def test_backends_differ_to_the_colour_blind(kind: str) -> None:
    """By colour or by marker; between our own backends by colour too."""
    curves = [Curve(name, "samples", ()) for name in ("ray", "raster", "reference", "mitsuba", "povray")]
    styles = palette.styles(curves)
    assert len({style.marker for style in styles}) == len(styles)
    seen = [np.clip(np.array(DICHROMATS[kind]) @ linear(style.color), 0, 1) ** (1 / 2.2) for style in styles[:3]]
    assert min(float(np.linalg.norm(a - b)) for a, b in itertools.combinations(seen, 2)) > 0.15


def test_a_backends_second_curve_differs_from_its_first() -> None:
    first, second, other = palette.styles([Curve("ray", "samples", ()), Curve("ray", "error", ()), Curve("raster", "samples", ())])
    assert first.color == second.color != other.color
    assert (first.dash, first.hollow) != (second.dash, second.hollow)
