"""Writes a chart as one HTML page without external files: the drawing with tooltips, and a table of all points.

The drawing is the SVG file with its colours as CSS variables. The content comes from the chart alone.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from .. import formatting
from ..metric_table import METRICS
from . import palette, text_report

if TYPE_CHECKING:
    from ..records import Chart, Point

FOLDER = Path(__file__).parent


def html(chart: Chart, drawing: str) -> str:
    """The page of `chart`; `drawing` is its SVG file."""
    title = f"{formatting.title(chart)}: error against time"
    answers = "".join(f"<li>{escape(line)}</li>" for line in text_report.answers(chart))
    return f"""<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'">
<title>{escape(title)}</title>
<style>
{_colors()}
{(FOLDER / "page.css").read_text(encoding="utf-8")}</style>
<button id="theme" type="button">light / dark</button>
{_inline(drawing)}
<p id="said" role="status">A point shows its settings, time and error; a click copies its command.</p>
<ul>{answers}</ul>
{_point_table(chart)}
{_about(chart)}
<div id="tip"></div>
<script type="application/json" id="points">{_tooltip_data(chart)}</script>
<script>
{(FOLDER / "page.js").read_text(encoding="utf-8")}</script>
</html>
"""


def _colors() -> str:
    """The drawing's colours as CSS variables, for light and dark themes."""
    light = "".join(f"{name}:{value};" for name, value, _ in palette.variables())
    dark = "".join(f"{name}:{value};" for name, _, value in palette.variables())
    by_system = f"@media (prefers-color-scheme: dark) {{ :root:not([data-theme=light]) {{ {dark} }} }}"
    return f":root {{ {light} }}\n{by_system}\n:root[data-theme=dark] {{ {dark} }}"


def _inline(drawing: str) -> str:
    """The SVG element with colours as variables, without size and titles."""
    element = drawing[drawing.index("<svg") :]
    element = re.sub(r"<metadata>.*?</metadata>|<title>.*?</title>", "", element, flags=re.DOTALL)
    element = re.sub(r'(<svg [^>]*?)\s(?:width="[^"]*"\s+)(height="[^"]*"\s+)?', r"\1 ", element, count=1)
    element = re.sub(r'(<svg [^>]*?)\sheight="[^"]*"', r"\1", element, count=1)
    for name, light, _ in palette.variables():
        element = element.replace(light, f"var({name})")
    return element.strip()


def _tooltip_data(chart: Chart) -> str:
    """The data of the tooltips as JSON. `<` is escaped, so that it cannot end the script."""
    shown = [
        {
            "title": f"{p.setting.backend}, {formatting.setting(p.setting)}",
            "figures": _figures(p),
            "command": formatting.command(chart, p.setting),
        }
        for p in chart.points
    ]
    return json.dumps(shown, ensure_ascii=False).replace("<", "\\u003c")


def _figures(point: Point) -> list[tuple[str, str]]:
    """Names and values of all figures of a point."""
    runs = f"{point.seconds.count} run{'' if point.seconds.count == 1 else 's'}"
    figures = [("time", f"{formatting.spread(point.seconds, formatting.seconds)}, {runs}")]
    for name, spread in point.errors.items():
        figures.append(
            (METRICS[name].name if name in METRICS else name, formatting.spread(spread, formatting.formatter(name)))
        )
    figures += formatting.bias_and_noise(point)
    figures += [
        (stage.replace("_", " "), formatting.seconds(value)) for stage, value in point.stages.items() if stage != "render" and value > 0
    ]
    return [*figures, ("note", point.note)] if point.note else figures


def _point_table(chart: Chart) -> str:
    headings, rows = text_report.points(chart)
    head = "".join(f"<th>{escape(h)}</th>" for h in headings)
    body = ""
    for i, row in enumerate(rows):
        cells = "".join(f"<td>{escape(cell)}</td>" for cell in row)
        body += f'<tr data-point="{i}"{" class=front" if i in chart.front else ""}>{cells}</tr>\n'
    return f'<div class="wide"><table>\n<caption>Every point; those on the front in bold</caption>\n<tr>{head}</tr>\n{body}</table></div>'


def _about(chart: Chart) -> str:
    """The conditions of the measurement, and the contestants that are left out."""
    return f'<dl class="about">{"".join(f"<dt>{escape(name)}</dt><dd>{escape(text)}</dd>" for name, text in _conditions(chart))}</dl>'


def _conditions(chart: Chart) -> Iterable[tuple[str, str]]:
    yield "scene", f"{chart.scene}, {formatting.size(chart)}"
    yield "reference", chart.reference
    yield "its uncertainty", formatting.error(chart.metric, chart.floor) if chart.floor else "none"
    yield "machine", chart.machine
    yield "versions", ", ".join(f"{name} {version}" for name, version in chart.versions.items())
    for name, why in chart.left_out.items():
        yield f"without {name}", why
