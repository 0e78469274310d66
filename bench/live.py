"""The live window in Chromium: milliseconds from an edit to the changed picture on screen, and frames a second of an orbit."""

from __future__ import annotations

import contextlib
import math
import os
import re
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ..compiler import ir, load
from ..live import scene_files, studio
from ..render.image import metrics
from . import chromium, meshes, report
from .chromium import Tab
from .harness import Effort

TEXT = """
`maquette watch` of a scene, 960 × 540 pixels, 16 samples a pixel, in a headless Chromium. Milliseconds from the edit to the frame of the
screen that shows the changed picture. An edit is a write of the file, a move of a slider, or a key in the source pane; it comes 0.2 s after
the finished picture of the edit before. *First*: the first changed picture, which may be coarse. *Whole*: the first one in full size, which
has one sample a pixel. The room has a mesh of 500,000 triangles.
"""
ORBIT_TEXT = """
*Orbit*: the mouse is dragged over the picture of 512², 4 samples a pixel, for some seconds: pictures on screen a second, and how many of
them have full size.
"""
REFINED_TEXT = """
*Refined*: the Cornell box, 8 bounces, 1,024 samples a pixel; its source gets another line. √relMSE of what the server has shown a time
after the edit, against the finished picture; no browser runs.
"""
REST = """\
point([2, 4, 3], intensity: 60)
camera(position: [0, 1, 6], look_at: [0, 0.5, 0], fov: 35deg)
render(size: [{w}, {h}], samples: 16)
"""
BALL = "let red = 0.{0}\nparam size = 1 in 0.5..1.5\nsphere(size, center: [0, 1, 0], material: plastic(rgb(red, 0.2, 0.1)))\nplane(0)\n"
FORMULA = "implicit(|x, y, z| x^2 + y^2 + z^2 + 0.2 * sin(5 * x) < 1.{0}, within: box(3))\nplane(-1.5)\n"
ROOM = """\
mesh("knot.ply", material: plastic(#4080c0), translate: [0, 1, 0])
sphere(0.3, center: [-0.{0}, 0.3, 1.2], material: plastic(#d0402a))
box([8, 6, 14], center: [0, 3, 0], material: lambert(#dddddd))
"""
MESH = 'mesh("knot.ply", material: plastic(#4080c0))\npoint([2, 4, 3], intensity: 60)\ncamera(position: [0, 1, 4], look_at: [0, 0, 0])\n'
EDITS = 50
PAUSE = 0.2  # seconds between a finished picture and the next edit
TIMEOUT = 600.0  # seconds of the first picture, which may wait for kernels
SCENES = Path(__file__).resolve().parent / "scenes"
EXAMPLES = Path(__file__).resolve().parent.parent / "examples"
CANVAS = "document.querySelector('#picture')"
SEEN = """new Promise((done) => {
  const began = performance.now(), times = [];
  const shown = () => { const port = new MessageChannel(); port.port1.onmessage = end; port.port2.postMessage(0); };
  const end = () => { times.push(performance.now() - began); if (whole()) done(times); else look(); };
  const canvas = CANVAS, changed = () => +canvas.dataset.version > AFTER;
  const whole = () => changed() && canvas.width === WIDTH && canvas.height === HEIGHT;
  const look = () => { if (changed() && (whole() || !times.length)) requestAnimationFrame(shown); else requestAnimationFrame(look); };
  look();
})"""  # milliseconds to the end of the frames that show the first and the whole picture of a later version; once, if they are the same


@dataclass(frozen=True, slots=True)
class Edited:
    """An open scene: its page, its file, the pattern of its text and the size of its picture."""

    tab: Tab
    scene: Path
    text: str
    size: tuple[int, int]

    def write(self, k: int) -> None:
        """Write the text with another number over the file, as editors do."""
        new = self.scene.with_name(".new")
        new.write_text(self.text.replace("{0}", f"{20 + k % 60}"), encoding="utf-8")
        new.replace(self.scene)

    def slide(self, k: int) -> None:
        """Move the slider of the first param."""
        self.tab.js(
            "(slider => { slider.value = " + f"{0.8 + 0.005 * k}" + "; slider.dispatchEvent(new Event('input')); })"
            "(document.querySelector('#params input[type=range]'))"
        )

    def type(self, k: int) -> None:
        """Type a digit after the number of the first line, or remove it."""
        if k == 0:
            self.tab.js("document.querySelector('#code .cm-content').focus()")
            self.tab.key("Home", 2)
            self.tab.key("End")
        if k % 2 == 0:
            self.tab.type("5")
        else:
            self.tab.key("Backspace")


EDITS_OF: Sequence[tuple[str, str, Callable[[Edited, int], None]]] = (
    ("material, file", BALL, Edited.write), ("material, key", BALL, Edited.type), ("parameter, slider", BALL, Edited.slide),
    ("formula, file", FORMULA, Edited.write), ("transform in a room, file", ROOM, Edited.write),
)  # fmt: skip


REFINED_AT = (0.15, 0.3, 0.6, 1.2)  # seconds after an edit
NAMES = ("edits", "orbit", "refined")  # parts


def section(quick: bool, effort: Effort, only: str = "") -> report.Section:
    """Measure latency of edits and frames of orbits, on every core."""
    result = report.Section("live", "The live window", TEXT + ORBIT_TEXT + REFINED_TEXT)
    if only in ("", "refined"):
        result.blocks.append(_refined(quick))
    path = chromium.executable()
    if path is None and only != "refined":
        result.missing = ["Chromium is not installed (apt install chromium, or name it in MAQUETTE_CHROMIUM)"]
    if path is None or only == "refined":
        return result
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as name:
        folder = Path(name)
        with chromium.running(folder / "profile") as browser:
            result.versions = {"Chromium": browser.version()}
            if only in ("", "edits"):
                result.blocks.append(_edits(browser, folder, quick))
            if only in ("", "orbit"):
                result.blocks.append(_orbits(browser, folder, quick))
    return result


def _edits(browser: chromium.Browser, folder: Path, quick: bool) -> str:
    """The table of latencies."""
    size, count = ((96, 54), 5) if quick else ((960, 540), EDITS)
    meshes.write_ply(folder / "knot.ply", meshes.knot(*((40, 20) if quick else (1000, 250))))
    rows = []
    for name, text, edit in EDITS_OF:
        full = (text + REST).replace("{w}", str(size[0])).replace("{h}", str(size[1]))
        scene = folder / "edited.scene"
        scene.write_text(full.replace("{0}", "19"), encoding="utf-8")
        with opened(browser, scene) as tab:
            first, complete = latencies(Edited(tab, scene, full, size), edit, count)
        rows.append((name, *(f"{value:.0f}" for times in (first, complete) for value in quantiles(times))))
    return report.grid(("", "first, ms, median", "95 %", "whole, ms, median", "95 %"), rows)


def _orbits(browser: chromium.Browser, folder: Path, quick: bool) -> str:
    """The table of orbits."""
    side, seconds = (64, 0.5) if quick else (512, 4.0)
    meshes.write_ply(folder / "knot.ply", meshes.knot(*((40, 20) if quick else (500, 100))))
    mesh = folder / "mesh.scene"
    mesh.write_text(MESH, encoding="utf-8")
    rows = []
    for name, scene in (("hello", EXAMPLES / "hello.scene"), ("gear", EXAMPLES / "gear.scene"), ("mesh of 100,000 triangles", mesh)):
        with opened(browser, scene, "--size", f"{side}x{side}", "--samples", "4") as tab:
            shown, complete = frames(tab, seconds, side)
        rows.append((name, f"{shown:.1f}", f"{complete:.1f}"))
    return report.grid(("orbit", "pictures a second", "in full size"), rows)


def _refined(quick: bool) -> str:
    """The table of errors after edits."""
    sizes, samples = (((64, 48),), 16) if quick else (((320, 240), (960, 540)), 1024)
    rows = [(f"{width} × {height}", *(f"{e:.1%}" for e in errors_after_edits((width, height), samples))) for width, height in sizes]
    return report.grid(("refined, √relMSE after", *(f"{1e3 * seconds:.0f} ms" for seconds in REFINED_AT)), rows)


def errors_after_edits(size: tuple[int, int], samples: int, edits: int = 9) -> list[float]:
    """Medians over edits of the error at each of REFINED_AT; inf while nothing of the new version is shown."""
    scene = SCENES / "cornell.scene"
    text, done = scene.read_text(encoding="utf-8"), threading.Event()
    shown: list[tuple[float, Any]] = []

    def tell(message: dict[str, Any]) -> None:
        if message["type"] == "progress" and message["stage"] == "done":
            done.set()

    def show(about: dict[str, Any], _: bytes) -> None:
        if about["version"] > version:
            shown.append((time.perf_counter(), drawn.current.shown.rgba[..., :3].copy() if drawn.current else None))

    version = 0
    settings = ir.Settings(size=size, samples=samples)
    drawn = studio.Studio(scene_files.Opened(scene, partial(load.load, scene), settings), tell, show)
    drawn.start()
    try:
        if not done.wait(TIMEOUT) or drawn.current is None:
            raise RuntimeError("the picture was not finished")
        truth, errors = drawn.current.shown.rgba[..., :3].copy(), []
        for k in range(edits):
            shown.clear()
            version, began = drawn.current.version, time.perf_counter()
            drawn.change(lambda state, k=k: state.with_text(str(scene), f"{text}\nlet added = {k}\n"))
            time.sleep(REFINED_AT[-1] + PAUSE)
            last = [[rgb for when, rgb in shown if when - began <= limit and rgb.shape == truth.shape][-1:] for limit in REFINED_AT]
            errors.append([metrics.root_relmse(rgb[0], truth) if rgb else math.inf for rgb in last])
        return [float(value) for value in np.median(errors, axis=0)]
    finally:
        drawn.stop()


def quantiles(times: Sequence[float]) -> tuple[float, float]:
    """Median and 95th percentile."""
    return statistics.median(times), statistics.quantiles(times, n=20, method="inclusive")[-1]


@contextlib.contextmanager
def opened(browser: chromium.Browser, scene: Path, *options: str) -> Iterator[Tab]:
    """A page of `maquette watch`, with the finished picture of a scene."""
    command = [sys.executable, "-P", "-m", "maquette", "watch", str(scene), "--no-browser", *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env={**os.environ, "PYTHONUNBUFFERED": "1"}) as process:
        try:
            assert process.stdout is not None
            address = re.search(r"http://\S+", process.stdout.readline())
            if address is None:
                raise RuntimeError("maquette watch printed no address")
            tab = browser.tab(address[0])
            tab.size(1600, 900)
            finished(tab)
            yield tab
            tab.close()
        finally:
            process.kill()


def finished(tab: Tab) -> None:
    """Wait for the finished picture. Raises RuntimeError for a scene with errors."""
    failed = "document.querySelector('#stage')?.classList.contains('failed')"
    tab.wait(f"{failed} || {CANVAS}?.dataset.finished === 'true'", TIMEOUT)
    if tab.js(failed):
        raise RuntimeError(tab.js("document.querySelector('#messages').innerText"))
    time.sleep(PAUSE)


def latencies(edited: Edited, edit: Callable[[Edited, int], None], edits: int) -> tuple[list[float], list[float]]:
    """Milliseconds to the first and to the whole picture of each edit."""
    first: list[float] = []
    complete: list[float] = []
    width, height = edited.size
    for k in range(edits):
        finished(edited.tab)
        before = edited.tab.js(f"+{CANVAS}.dataset.version")
        look = SEEN.replace("CANVAS", CANVAS).replace("AFTER", str(before)).replace("WIDTH", str(width)).replace("HEIGHT", str(height))
        edited.tab.js(f"window.seen = {look}, 0")
        began = time.perf_counter()
        edit(edited, k)
        times = edited.tab.js("window.seen")
        complete.append(1e3 * (time.perf_counter() - began))
        first.append(complete[-1] - (times[-1] - times[0]))
    return first, complete


def frames(tab: Tab, seconds: float, side: int) -> tuple[float, float]:
    """Changed pictures on screen a second while the mouse is dragged, and those in full size."""
    tab.js(
        "window.counted = { shown: 0, whole: 0, last: 0 };"
        f"(function look() {{ const c = {CANVAS}, w = window.counted;"
        " if (c.dataset.count !== w.last) { w.last = c.dataset.count; w.shown += 1; w.whole += c.width === " + str(side) + " ? 1 : 0; }"
        " if (!w.done) requestAnimationFrame(look); })(), 0"
    )
    x, y = tab.place("#picture")
    tab.mouse("mousePressed", x, y, buttons=1)
    began = time.perf_counter()
    while (passed := time.perf_counter() - began) < seconds:
        tab.mouse("mouseMoved", x + 150.0 * math.sin(2.0 * passed), y + 40.0 * math.sin(3.0 * passed), buttons=1)
        time.sleep(0.008)
    counted = tab.js("window.counted.done = true, window.counted")
    tab.mouse("mouseReleased", x, y)
    return counted["shown"] / passed, counted["whole"] / passed
