"""Draws a chart as SVG or PNG: error against seconds on logarithmic axes, with matplotlib but without pyplot.

Points are medians with quartiles (Hoefler and Belli 2015, "Scientific benchmarking of parallel computing systems"). The front is a step
line, as nothing between two of its points was measured.
"""

from __future__ import annotations

import io
import itertools
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any

import matplotlib
import matplotlib.figure
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from .. import formatting
from ..metric_table import METRICS
from . import text_report
from .label_placement import Box, LabelLayout
from .palette import FAINT, FLOOR, FRONT, GRID, INK, PAPER, Style, styles

if TYPE_CHECKING:
    from ..records import Chart, Curve, Point, Spread

LEFT, RIGHT = 0.085, 0.975  # of the axes, as shares of the width
TITLE, FOOT = 14, 8  # points
LINE_SPACING = 1.15
MAX_MISSING = 3  # lines on contestants that are not charted
SIZE = (9.6, 6.6)  # inches
FONT = "DejaVu Sans"  # comes with matplotlib
RC_PARAMS: dict[Any, Any] = {
    "font.family": FONT,
    "font.size": 10,
    "svg.fonttype": "none",
    "svg.hashsalt": "maquette",
    "path.simplify": False,
}
BAR_LIMIT = 1.7  # the largest factor by which a bar widens the chart; longer bars are cut at its edge
MIN_SPAN = (6.0, 8.0)  # a chart is at least this wide and high, as ratios


def png(chart: Chart, dpi: int = 150) -> bytes:
    """The chart as a PNG file."""
    with matplotlib.rc_context(RC_PARAMS):
        data = io.BytesIO()
        ChartPlot(chart).figure.savefig(data, format="png", dpi=dpi, metadata={"Software": "maquette"})
        return data.getvalue()


def svg(chart: Chart) -> str:
    """The chart as an SVG file. Point i is the group `point-i`, titled with its settings, time and error."""
    with matplotlib.rc_context(RC_PARAMS):
        data = io.StringIO()
        ChartPlot(chart).figure.savefig(data, format="svg", metadata={"Date": None, "Creator": "maquette"})
    text = data.getvalue().replace(f"'{FONT}'", f"'{FONT}', Verdana, sans-serif")
    titles = [f"{formatting.point(p, chart.metric)}\n{p.setting.arguments()}" for p in chart.points]
    return re.sub(r'<g id="point-(\d+)">', lambda m: f"{m[0]}<title>{escape(titles[int(m[1])])}</title>", text)


class ChartPlot:
    """The figure of a chart, its axes, and the layout of its labels."""

    def __init__(self, chart: Chart) -> None:
        self.chart = chart
        self.points = chart.points
        self.styles = styles(chart.curves)
        self.figure = matplotlib.figure.Figure(figsize=SIZE, dpi=100, facecolor=PAPER)
        self.canvas = FigureCanvasAgg(self.figure)
        self._frame()
        self._scales()
        self._floor()
        self._front()
        for curve, style in zip(chart.curves, self.styles, strict=True):
            self._curve(curve, style)
        self._stops()
        self._labels()

    def _frame(self) -> None:
        """Draw the texts above and below, and add the axes between them."""
        inch = 1 / SIZE[1]
        y = 1 - 0.06 * inch
        for text, size, weight, color in _heading(self.chart):
            for line in self._wrapped(text, size, weight):
                y -= (0.0215 * size if size < TITLE else 0.30) * inch
                self.figure.text(LEFT, y, line, fontsize=size, fontweight=weight, color=color, va="baseline")
        top, y = y - 0.12 * inch, 0.10 * inch
        for line in reversed([line for text in _footing(self.chart) for line in self._wrapped(text, FOOT)]):
            self.figure.text(LEFT, y, line, fontsize=FOOT, color=FAINT, va="baseline")
            y += 0.17 * inch
        bottom = y + 0.55 * inch
        self.axes = self.figure.add_axes((LEFT, bottom, RIGHT - LEFT, top - bottom))

    def _wrapped(self, text: str, size: float, weight: str = "normal", width: float = 1.0) -> list[str]:
        """The text in lines of at most the share `width` of the axes' width."""
        limit = width * (RIGHT - LEFT) * SIZE[0] * self.figure.dpi
        lines: list[str] = []
        for word in text.replace(" %", "\N{NO-BREAK SPACE}%").split(" "):
            longer = f"{lines[-1]} {word}" if lines else word
            if lines and self._extent(longer, size, weight)[0] <= limit:
                lines[-1] = longer
            else:
                lines.append(word)
        return lines

    def _extent(self, text: str, size: float, weight: str) -> tuple[float, float]:
        """Width and height of a text in pixels."""
        artist = self.figure.text(0, 0, text, fontsize=size, fontweight=weight, linespacing=LINE_SPACING)
        extent = artist.get_window_extent(self.canvas.get_renderer())
        artist.remove()
        return extent.width, extent.height

    def _scales(self) -> None:
        axes, metric = self.axes, self.chart.metric
        times = [min(max(v, p.seconds.median / BAR_LIMIT), p.seconds.median * BAR_LIMIT) for p in self.points for v in _ends(p.seconds)]
        far = [v for p in self.points for v in _ends(p.error) if v > 0]
        middles = [p.error.median for p in self.points if p.error.median > 0]
        far += [bias for _, curves in formatting.stopped_curves(self.chart) if (bias := bias_floor(curves))]
        low, high = (min(middles) / 8, max(far)) if middles else (1e-4, 1e-1)
        low = max(low, min(far, default=low))
        if self.chart.floor > 0 and low / 30 < self.chart.floor < high:
            low = min(low, self.chart.floor / 1.6)
        self.x = _padded(min(times), max(times), MIN_SPAN[0], 1.25, 1.6)
        self.y = _padded(low, high, MIN_SPAN[1], 1.9 if any(p.error.median == 0 for p in self.points) else 1.4, 1.9)
        axes.set(xscale="log", yscale="log", xlim=self.x, ylim=self.y)
        axes.set_xlabel("seconds of rendering, wall clock", color=INK, labelpad=4)
        axes.set_ylabel(METRICS[metric].axis, color=INK, labelpad=4)
        for axis, span, say in (
            (axes.xaxis, self.x, formatting.seconds_exactly),
            (axes.yaxis, self.y, lambda v: formatting.target(metric, v)),
        ):
            decades = math.log10(span[1] / span[0])
            axis.set_major_locator(LogLocator(subs=(1.0,) if decades > 3.4 else (1.0, 3.0) if decades > 2 else (1.0, 2.0, 5.0)))
            axis.set_minor_locator(LogLocator(subs=tuple(range(2, 10)), numticks=99))
            axis.set_major_formatter(FuncFormatter(lambda v, _, say=say: say(v)))
            axis.set_minor_formatter(NullFormatter())
        axes.grid(True, which="major", color=GRID, linewidth=0.8)
        axes.tick_params(which="both", color=GRID, labelcolor=INK, labelsize=9)
        axes.set_axisbelow(True)
        for side, spine in axes.spines.items():
            spine.set_visible(side in ("left", "bottom"))
            spine.set_color(FRONT)

    def _floor(self) -> None:
        """Shade the uncertainty of the reference: errors in it are not distinguishable from 0."""
        if self.chart.floor > self.y[0]:
            band = self.axes.axhspan(self.y[0], self.chart.floor, color=FLOOR, zorder=0.5, linewidth=0)
            band.set_gid("floor")

    def _front(self) -> None:
        """Draw the front as a step line through its measured points."""
        front = sorted((self.points[i] for i in self.chart.front), key=lambda p: p.seconds.median)
        if not front:
            return
        xs, ys = [p.seconds.median for p in front], [self._height(p) for p in front]
        until = ([*xs, self.x[1]], [*ys, ys[-1]])
        stairs = self.axes.plot(*until, drawstyle="steps-post", color=FRONT, linewidth=5, alpha=0.55, zorder=1.5)[0]
        stairs.set_gid("front")
        stairs.set_solid_joinstyle("round")
        rings = self.axes.plot(xs, ys, "o", markersize=13, markerfacecolor="none", markeredgecolor=FAINT, markeredgewidth=1, zorder=2.5)[0]
        rings.set_gid("front-points")

    def _height(self, point: Point) -> float:
        """The height of a point on the axis; a point without error stands at the lower edge."""
        return max(point.error.median, self.y[0] * 1.12)

    def _curve(self, curve: Curve, style: Style) -> None:
        axes = self.axes
        xs, ys = [p.seconds.median for p in curve.points], [self._height(p) for p in curve.points]
        line = axes.plot(xs, ys, linestyle=style.dash, color=style.color, linewidth=1.7, zorder=3)[0]
        line.set_gid(f"curve-{self.chart.curves.index(curve)}")
        for point, x, y in zip(curve.points, xs, ys, strict=True):
            time, far = point.seconds, point.error
            if time.high > time.low:
                self._bar([max(time.low, self.x[0]), min(time.high, self.x[1])], [y, y], style, f"time-{self._index(point)}")
            if far.high > far.low:
                self._bar([x, x], [max(far.low, self.y[0]), min(far.high, self.y[1])], style, f"error-{self._index(point)}")
            fill = PAPER if style.hollow else style.color
            exact = far.median == 0
            mark = axes.plot(
                [x], [y], marker="v" if exact else style.marker, markersize=7, markerfacecolor=fill, markeredgecolor=style.color,
                markeredgewidth=1.4, zorder=4, linestyle="none", clip_on=False,
            )[0]  # fmt: skip
            mark.set_gid(f"point-{self._index(point)}")

    def _stops(self) -> None:
        """Draw dashed lines at biases, below which more time does not lead."""
        for i, (_, curves) in enumerate(formatting.stopped_curves(self.chart)):
            if bias := bias_floor(curves):
                start = min(p.seconds.median for curve in curves for p in curve.points)
                style = self._of_all(curves)
                color = style.color if style else FAINT
                line = self.axes.plot([start, self.x[1]], [bias, bias], linestyle=(0, (6, 4)), color=color, linewidth=1, zorder=2)[0]
                line.set_gid(f"bias-{i}")

    def _bar(self, xs: list[float], ys: list[float], style: Style, name: str) -> None:
        """Draw the quartiles of a point in one direction."""
        bar = self.axes.plot(xs, ys, color=style.color, linewidth=1.1, alpha=0.8, zorder=2.8, solid_capstyle="butt")[0]
        bar.set_gid(name)

    def _index(self, point: Point) -> int:
        return next(i for i, other in enumerate(self.points) if other is point)

    # Labels are placed in pixels and stored as fractions of the axes, so that they have the same place in all formats.

    def _labels(self) -> None:
        box = self.axes.get_window_extent()
        self.layout = LabelLayout(Box(box.x0 + 3, box.y0 + 3, box.x1 + 4, box.y1 + 14))
        for point in self.points:
            x, y = self._pixel(point)
            self.layout.points.append(Box(x - 6, y - 6, x + 6, y + 6))
            for spread, across in ((point.seconds, True), (point.error, False)):
                self.layout.lines += self._occupied(spread, (x, y), across)
        for curve in self.chart.curves:
            pixels = [self._pixel(p) for p in curve.points]
            self.layout.lines += list(itertools.pairwise(pixels))
        for _, curves in formatting.stopped_curves(self.chart):
            if bias := bias_floor(curves):
                y = self._to_pixels(self.x[0], bias)[1]
                self.layout.lines.append(((box.x0, y), (box.x1, y)))
        for label in (*self._knee(), *self._names(), *self._floors(), *self._values()):
            self._write(label)

    def _occupied(self, spread: Spread, pixel: tuple[float, float], across: bool) -> list[tuple[tuple[float, float], tuple[float, float]]]:
        if spread.high <= spread.low:
            return []
        low, high = ((max(v, (self.x if across else self.y)[0])) for v in (spread.low, spread.high))
        if across:
            return [((self._to_pixels(low, 1)[0], pixel[1]), (self._to_pixels(high, 1)[0], pixel[1]))]
        return [((pixel[0], self._to_pixels(self.x[0], low)[1]), (pixel[0], self._to_pixels(self.x[0], high)[1]))]

    def _to_pixels(self, x: float, y: float) -> tuple[float, float]:
        px, py = self.axes.transData.transform((x, y))
        return float(px), float(py)

    def _pixel(self, point: Point) -> tuple[float, float]:
        return self._to_pixels(point.seconds.median, self._height(point))

    def _knee(self) -> Iterator[_Label]:
        if self.chart.knee is None:
            return
        point = self.points[self.chart.knee]
        style = self._style_of(point)
        far, time = formatting.error(self.chart.metric, point.error.median), formatting.seconds(point.seconds.median)
        text = f"knee: {point.setting.backend}, {formatting.setting(point.setting)}\n{far} in {time}"
        yield _Label(text, [self._pixel(point)], style.text_color, "knee", fontsize=9.5, weight="bold", gap=26, leader=True)

    def _names(self) -> Iterator[_Label]:
        """The names of curves, preferably at the expensive end, then at the cheap end, then along the curve."""
        for i, (curve, style) in enumerate(zip(self.chart.curves, self.styles, strict=True)):
            pixels = [self._pixel(p) for p in curve.points]
            anchors = [pixels[-1], pixels[0], *pixels[-2:0:-1]]
            yield _Label(formatting.curve(curve, self.chart), anchors, style.text_color, f"name-{i}", fontsize=11, weight="bold", gap=11)

    def _floors(self) -> Iterator[_Label]:
        right = self.x[1] / 1.03
        for i, (name, curves) in enumerate(formatting.stopped_curves(self.chart)):
            style = self._of_all(curves)
            color = style.text_color if style else FAINT
            height = bias_floor(curves) or min(p.error.median for curve in curves for p in curve.points)
            text = "\n".join(self._wrapped(f"{name}: {curves[0].stops}", 8.5, width=0.5))
            yield _Label(text, self._along(height), color, f"stops-{i}", fontsize=8.5, gap=4)
        if self.chart.floor > self.y[0]:
            text = f"the reference's own uncertainty, {formatting.error(self.chart.metric, self.chart.floor)}"
            yield _Label(text, self._along(self.chart.floor), FAINT, "floor-label", fontsize=8.5, gap=4)
        if self.chart.front:
            last = max((self.points[i] for i in self.chart.front), key=lambda p: p.seconds.median)
            if self._to_pixels(right, 1)[0] - self._pixel(last)[0] > 90:
                y = self._pixel(last)[1]
                places = [(self._pixel(last)[0] + 50 + 15 * k, y) for k in range(8)]
                yield _Label("Pareto front", places, FAINT, "front-label", fontsize=8.5, gap=6)

    def _along(self, y: float) -> list[tuple[float, float]]:
        """Places along a horizontal line, from the right."""
        box, height = self.axes.get_window_extent(), self._to_pixels(self.x[0], y)[1]
        return [(box.x0 + (box.x1 - box.x0) * share, height) for share in np.arange(0.9, 0.05, -0.05)]

    def _values(self) -> Iterator[_Label]:
        """The values of settings beside their points where space allows; the ends of a curve first."""
        for style, curve in zip(self.styles, self.chart.curves, strict=True):
            ends = [curve.points[0], *curve.points[-1:], *curve.points[1:-1]][: len(curve.points)]
            for point in ends:
                yield _Label(
                    formatting.value(point.setting), [self._pixel(point)], style.text_color, "", fontsize=7.5, gap=8, reach=20, most=2.5
                )

    def _of_all(self, curves: Sequence[Curve]) -> Style | None:
        """The common style of curves of one backend; None for several backends."""
        return self.styles[self.chart.curves.index(curves[0])] if len({curve.backend for curve in curves}) == 1 else None

    def _style_of(self, point: Point) -> Style:
        return next(s for c, s in zip(self.chart.curves, self.styles, strict=True) if any(p is point for p in c.points))

    def _write(self, label: _Label) -> None:
        artist = self.axes.text(
            0, 0, label.text, transform=self.axes.transAxes, fontsize=label.fontsize, fontweight=label.weight, color=label.color,
            va="bottom", linespacing=LINE_SPACING, zorder=3.5,
            bbox={"facecolor": PAPER, "edgecolor": "none", "alpha": 0.7, "pad": 0.5},
        )  # fmt: skip
        spot = self.layout.place(self._extent(label.text, label.fontsize, label.weight), label.anchors, label.gap, label.most, label.reach)
        if spot is None:
            artist.remove()
            return
        box, anchor = spot
        artist.set_position(self._fraction(box.x0, box.y0))
        if label.gid:
            artist.set_gid(label.gid)
        if label.leader:
            near = (min(max(anchor[0], box.x0), box.x1), min(max(anchor[1], box.y0), box.y1))
            length = math.dist(near, anchor)
            share = min(9 / length, 1.0) if length else 1.0
            start = (anchor[0] + (near[0] - anchor[0]) * share, anchor[1] + (near[1] - anchor[1]) * share)
            (x0, y0), (x1, y1) = self._fraction(*start), self._fraction(*near)
            self.layout.lines.append((start, near))
            self.axes.plot([x0, x1], [y0, y1], transform=self.axes.transAxes, color=label.color, linewidth=1, zorder=5)

    def _fraction(self, x: float, y: float) -> tuple[float, float]:
        fx, fy = self.axes.transAxes.inverted().transform((x, y))
        return float(fx), float(fy)


@dataclass(slots=True)
class _Label:
    """A label with its possible anchors in pixels."""

    text: str
    anchors: Sequence[tuple[float, float]]
    color: str
    gid: str
    fontsize: float
    gap: float
    weight: str = "normal"
    leader: bool = False
    most: float = math.inf
    reach: float = math.inf


def bias_floor(curves: Sequence[Curve]) -> float:
    """The least bias of these curves' most expensive points, which more time does not reduce; 0 if none is known."""
    return min((bias for curve in curves if (bias := curve.points[-1].bias)), default=0.0)


def _ends(spread: Spread) -> tuple[float, float, float]:
    return spread.low, spread.median, spread.high


def _padded(low: float, high: float, least: float, below: float, above: float) -> tuple[float, float]:
    """Limits of a logarithmic axis around low..high with the factors `below` and `above`, and a ratio of at least `least`."""
    wider = math.sqrt(max(least / (high / low), 1.0))
    return low / wider / below, high * wider * above


def _heading(chart: Chart) -> list[tuple[str, float, str, str]]:
    """Title, conditions and reference, each as (text, size, weight, colour)."""
    counts = sorted({p.error.count for p in chart.points})
    runs = f"{counts[0]}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
    return [
        (f"{formatting.title(chart)}: error against time", TITLE, "bold", INK),
        (
            f"{formatting.size(chart)}, {chart.machine}. Medians of {runs} run{'' if runs == '1' else 's'}, bars are quartiles.",
            9,
            "normal",
            FAINT,
        ),
        (f"Measured against {chart.reference}", 9, "normal", FAINT),
        *[(text_report.first_line([one]), 9, "normal", INK) for one in text_report.answers_of(chart) if one.setting is not None],
    ]


def _footing(chart: Chart) -> list[str]:
    """The legend of the marks, and contestants that are not charted."""
    marks = ["ring and grey stairs: the Pareto front of what was measured"]
    if any(bias_floor(curves) for _, curves in formatting.stopped_curves(chart)):
        marks.append("dashed: bias, which more time does not take away")
    if any(p.error.median == 0 for p in chart.points):
        marks.append("triangle at the lower edge: no error at all")
    missing = formatting.left_out(chart, brief=True)
    more = [f"and {len(missing) - MAX_MISSING} more, listed in the .json"] if len(missing) > MAX_MISSING else []
    return [f"{text[0].upper()}{text[1:]}." for text in ("; ".join(marks), *missing[:MAX_MISSING], *more)]
