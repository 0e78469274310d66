"""The live window: seconds from the write of a file to the changed picture at a page."""

from __future__ import annotations

import json
import os
import re
import statistics
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import IO, Any

from websockets.sync.client import ClientConnection, connect

from . import report
from .harness import Effort

TEXT = """
`maquette watch` of a scene, 960 × 540 pixels, 16 samples a pixel; each edit changes a number and writes the file over the old one. Seconds
from the write to the end of the message that brings the picture to a page. *First*: the first changed picture, which may be coarse.
*Whole*: the first one in full size. The watch waits 50 to 200 ms for further writes of the same save.
"""
SCENES = {
    "a ball": "sphere(1, center: [{0}, 1, 0], material: plastic(#d0402a))\nplane(0)\n",
    "a formula": "implicit(|x, y, z| x^2 + y^2 + z^2 + 0.2 * sin(5 * x) < {0} + 1, within: box(3))\nplane(-1.5)\n",
}
REST = """\
point([2, 4, 3], intensity: 60)
camera(position: [0, 1, 6], look_at: [0, 0.5, 0], fov: 35deg)
render(size: [{w}, {h}], samples: 16)
"""
EDITS = 50
TIMEOUT = 600.0  # seconds of the first picture, which may wait for kernels


def section(quick: bool, effort: Effort, only: str = "") -> report.Section:
    """Measure the latency of edits, on every core."""
    found = report.Section("live", "The live window", TEXT)
    width, height, edits = (96, 54, 5) if quick else (960, 540, EDITS)
    rows = []
    for name, text in SCENES.items():
        first, whole = latencies(text + REST.replace("{w}", str(width)).replace("{h}", str(height)), (width, height), edits)
        rows.append((name, *(f"{1e3 * value:.0f}" for times in (first, whole) for value in quantiles(times))))
    found.blocks.append(report.grid(("", "first, ms, median", "95 %", "whole, ms, median", "95 %"), rows))
    return found


def quantiles(times: list[float]) -> tuple[float, float]:
    """Median and 95th percentile."""
    return statistics.median(times), statistics.quantiles(times, n=20, method="inclusive")[-1]


def latencies(text: str, size: tuple[int, int], edits: int) -> tuple[list[float], list[float]]:
    """Seconds to the first and to the whole picture of each edit of a scene with a place `{0}` for a number."""
    with tempfile.TemporaryDirectory() as name:
        scene, new = Path(name) / "a.scene", Path(name) / ".new"
        scene.write_text(text.replace("{0}", "0"), encoding="utf-8")
        command = [sys.executable, "-P", "-m", "maquette", "watch", str(scene), "--no-browser"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env={**os.environ, "PYTHONUNBUFFERED": "1"}) as process:
            try:
                assert process.stdout is not None
                return _edit(_address(process.stdout), scene, new, text, size, edits)
            finally:
                process.kill()


def _address(output: IO[str]) -> str:
    found = re.search(r"http://\S+", output.readline())
    if found is None:
        raise RuntimeError("maquette watch printed no address")
    return found[0]


def _edit(address: str, scene: Path, new: Path, text: str, size: tuple[int, int], edits: int) -> tuple[list[float], list[float]]:
    origin: Any = address[: address.index("/", 7)]
    first: list[float] = []
    whole: list[float] = []
    with connect(address.replace("http", "ws", 1) + "socket", origin=origin, max_size=None, compression=None) as socket:
        socket.send(json.dumps({"type": "hello", "boot": None}))
        about = _picture(socket, 0)
        for k in range(edits):
            while not about["finished"]:
                about = _picture(socket, 0)
            time.sleep(0.3)
            new.write_text(text.replace("{0}", f"{0.01 * (k + 1):.2f}"), encoding="utf-8")
            began, before = time.perf_counter(), about["version"]
            new.replace(scene)
            about = _picture(socket, before)
            first.append(time.perf_counter() - began)
            while (about["width"], about["height"]) != size:
                about = _picture(socket, before)
            whole.append(time.perf_counter() - began)
    return first, whole


def _picture(socket: ClientConnection, after: int) -> dict[str, Any]:
    """The description of the next picture of a later version."""
    while True:
        data = socket.recv(timeout=TIMEOUT)
        if isinstance(data, bytes):
            about = json.loads(data[4 : 4 + struct.unpack_from("<I", data)[0]])
            if about["version"] > after:
                return about
