"""Soak: `maquette watch` with an edit a second and a page that follows. Its memory does not grow without bound."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
import time
from itertools import count
from pathlib import Path

import numpy as np
import pytest
from websockets.sync.client import connect

SECONDS = float(os.environ.get("MAQUETTE_SOAK", "180"))
WARM_UP = 0.4  # of the time, in which kernels are loaded and memory is taken once
MOST = 50e6  # bytes an hour
NOISE = 8e6  # bytes
SCENE = """\
use "part.scene"
param radius = 1 in 0.2..2
plane(y: -1, material: lambert(checker(#e0e0e0, #606060, size: {size})))
part.ball(radius, {x})
mesh("block.obj", material: {material})
implicit(|x, y, z| x^2 + y^2 + z^2 <= {size}, within: 2)
point([2, 4, 3], intensity: {light})
sky(color: #87b5e0, luminance: 3000nit)
camera(position: [{x}, 1, 6], look_at: [0, 0, 0], fov: 35deg)
render(size: [96, 72], samples: 2)
"""
# the last is an error
MATERIALS = ("lambert(#c04030)", "plastic(#3060c0)", "mirror()", "glass()", 'metal("gold", roughness: 0.2)', "box(")
BLOCK = "v 0 0 0\nv 1 0 0\nv 0 {height} 0\nv 0 0 1\nf 1 2 3\nf 1 3 4\nf 1 4 2\nf 2 4 3\n"


def edit(folder: Path, number: int) -> None:
    """Another scene, with values that were not there before; now and then another mesh or another part."""
    fraction = number * 0.618 % 1.0
    text = SCENE.format(size=0.2 + fraction, x=fraction, light=20 + 10 * fraction, material=MATERIALS[number % len(MATERIALS)])
    if number % 5 == 0:
        (folder / "block.obj").write_text(BLOCK.format(height=0.5 + fraction), encoding="utf-8")
    if number % 7 == 0:
        ball = f"let ball(radius, x) = sphere(radius, center: [x, {fraction}, 0], material: lambert(#40{number % 90 + 10}40))\n"
        (folder / "part.scene").write_text(ball, encoding="utf-8")
    (folder / "new").write_text(text, encoding="utf-8")
    (folder / "new").replace(folder / "a.scene")


def memory(process: int) -> int:
    """Resident bytes of a process without the pages of files."""
    pages = Path(f"/proc/{process}/statm").read_text(encoding="ascii").split()
    return (int(pages[1]) - int(pages[2])) * os.sysconf("SC_PAGE_SIZE")


def command_of(process: int) -> int:
    """The process of the command, which its supervisor waits for."""
    return int(Path(f"/proc/{process}/task/{process}/children").read_text(encoding="ascii").split()[0])


def interruptible() -> None:
    """Enable interrupts, which shells ignore in background processes, tests included."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@pytest.mark.long
@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="this system has no /proc/PID/statm")
def test_memory_of_a_window_does_not_grow(tmp_path: Path) -> None:
    """MAQUETTE_SOAK seconds, 180 by default. An hour is the goal: MAQUETTE_SOAK=3600."""
    edit(tmp_path, 0)
    command = [sys.executable, "-m", "maquette", "watch", str(tmp_path / "a.scene"), "--no-browser"]
    own = os.environ | {"MAQUETTE_KERNELS": "general"}  # an edit compiles nothing
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, preexec_fn=interruptible, env=own)
    assert process.stdout is not None
    found = re.search(r"http://(127\.0\.0\.1:\d+/\S+/) ", process.stdout.readline())
    assert found, "watch has printed no address"
    pictures = count()
    done = threading.Event()

    def follow() -> None:
        with connect(f"ws://{found[1]}socket", origin=f"http://{found[1].split('/')[0]}", max_size=None) as page:  # type: ignore[arg-type]
            while not done.is_set():
                try:
                    page.recv(timeout=1.0)
                    next(pictures)
                except TimeoutError:
                    pass

    page = threading.Thread(target=follow)
    page.start()
    samples: list[tuple[float, int]] = []
    start = time.monotonic()
    try:
        while (now := time.monotonic() - start) < SECONDS:
            edit(tmp_path, len(samples))
            samples.append((now, memory(command_of(process.pid))))
            time.sleep(max(0.0, start + len(samples) - time.monotonic()))
    finally:
        done.set()
        page.join(timeout=10)
        process.send_signal(signal.SIGINT)
        assert process.wait(30) == 0
    assert next(pictures) > SECONDS / 4, "the page got no pictures"
    times, sizes = np.array([sample for sample in samples if sample[0] > WARM_UP * SECONDS]).T
    slope = float(np.polyfit(times, sizes, 1)[0])
    print(f"{len(samples)} edits: {sizes.min() / 1e6:.0f} to {sizes.max() / 1e6:.0f} MB, {slope * 3600 / 1e6:+.1f} MB an hour")
    if log := os.environ.get("MAQUETTE_SOAK_LOG"):
        Path(log).write_text("\n".join(f"{t:.1f} {size}" for t, size in samples), encoding="utf-8")
    assert slope * np.ptp(times) < max(MOST * np.ptp(times) / 3600, NOISE)
