"""Thirty edits of a scene while `watch` runs, and the first picture: seconds that a person waits for kernels.

The command runs in an environment of its own: maquette's wheel, an empty home, no cache.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import sysconfig
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
WHEEL = "MAQUETTE_WHEEL"  # the wheel to measure; else one is built
SECONDS = 600.0  # of an edit, at most
BASE = "plane(y: 0, material: {ground})\nsphere(1, center: [0, 1, 0], material: plastic(#d0402a))\n{more}{light}\n{camera}\n{settings}\n"
USUAL = {
    "ground": "lambert(#c8c8c8)",
    "light": "sun(from: [2, 4, 3], illuminance: 20000lx)\nsky(color: #87b5e0, luminance: 3000nit)",
    "camera": "camera(position: [0, 1.6, 6], look_at: [0, 1, 0], fov: 40deg)",
    "settings": "render(size: [320, 240], samples: 4)",
}
GLASS, LAMP = "sphere(0.5, center: [1.6, 0.5, 0.6], material: glass())", "point([-3, 4, 2], intensity: 40)"
ADDED = {  # the first edits: each adds a line to the scene
    "ball and ground": "",
    "glass ball": GLASS,
    "rough metal box": 'box(0.8, center: [-1.7, 0.4, 0.3], material: metal("gold", roughness: 0.3))',
    "mesh": 'mesh("wedge.obj", material: lambert(#4080c0))',
    "formula": "implicit(|x, y, z| (hypot(x + 2, z + 2) - 0.7)^2 + (y - 0.4)^2 <= 0.09, within: 4)",
    "principled ellipsoid": "ellipsoid([0.5, 0.3, 0.4], center: [1, 0.3, 2], material: principled(#40a060, roughness: 0.4, clearcoat: 1))",
    "mirror": "sphere(0.4, center: [-0.9, 0.4, 1.7], material: mirror())",
    "blended solid": "union(round: 0.1) { box(0.5, center: [2.4, 0.25, -0.5]); sphere(0.3, center: [2.4, 0.6, -0.5]) }",
    "lamp": "area(position: [0, 5, 2], look_at: [0, 0, 0], size: 1, luminance: 9000nit)",
    "shiny cone": "cone(radius: 0.3, height: 0.9, center: [-2.5, 0.45, -0.6], material: phong(#8040a0, specular: 0.4, shininess: 60))",
}
CHANGED: dict[str, dict[str, str]] = {  # the edits after them: each changes the first scene
    "checker": {"ground": "lambert(checker(#e8e8e8, #8a8a8a, size: 50cm))"},
    "motion": {"more": "sphere(0.4, center: [10 * time / 1s - 1.8, 0.4, 1])\n", "camera": "{usual}, shutter: 20ms)"},
    "depth of field": {"camera": "camera(position: [0, 1.6, 6], look_at: [0, 1, 0], focal: 50mm, aperture: 1.4, focus: 5)"},
    "photons": {"more": f"{GLASS}\n", "light": LAMP, "settings": "{usual}, bounces: 6)"},
    "opacity": {"more": "sphere(0.5, center: [1.6, 0.5, 0.6], material: lambert(#40a060, opacity: 40%))\n"},
    "curves": {"more": 'curve([[-2, 0, 0], [-1, 1, 0], [1, 2, 1], [2, 0, 1]], 0.1, kind: "catmull_rom")\n'},
    "interreflection": {"settings": "{usual}, bounces: 4)"},
    "area light alone": {"light": "area(position: [0, 5, 2], look_at: [0, 0, 0], size: 1, luminance: 9)"},
    "point light": {"light": LAMP},
    "spot light": {"light": "spot(position: [-3, 4, 2], look_at: [0, 1, 0], cone: 40deg, intensity: 60)"},
    "daylight": {"light": "sky(turbidity: 3)\nsun(from: [2, 4, 3])"},
    "absorbing glass": {"more": "sphere(0.5, center: [1.6, 0.5, 0.6], material: glass(inside: #3f9fd8, depth: 15cm))\n"},
    "emissive shape": {"more": "sphere(0.3, center: [1.6, 0.8, 0.6], material: emissive(#ffd890, luminance: 9000nit))\n"},
    "pattern": {"ground": "lambert(pattern(|x, y, z| lerp(#303030, #e0e0e0, 0.5 + 0.5 * noise(3 * x, y, 3 * z))))"},
    "text": {"more": 'text("maquette", size: 40cm, depth: 8cm, align: "center")\n'},
    "revolve": {"more": "translate([1.8, 0, 0.5]) { revolve([[0, 0], [0.5, 0], [0.3, 1], [0, 1]]) }\n"},
    "heightfield": {"more": "translate([0, 0.05, -2]) { heightfield(|x, z| 0.3 * noise(4 * x, 0, 4 * z), size: [4, 1]) }\n"},
    "many instances": {"more": "for (k in 0..40) { sphere(0.1, center: [0.3 * k - 6, 0.1, -2]) }\n"},
    "orthographic camera": {"camera": 'camera(position: [0, 1.6, 6], look_at: [0, 1, 0], projection: "orthographic", width: 5)'},
    "rasterizer": {"settings": '{usual}, backend: "raster")'},
}


def scenes() -> dict[str, str]:
    """The text of the scene after each edit, by the edit's name."""
    texts, lines = {}, ""
    for name, line in ADDED.items():
        lines += f"{line}\n" if line else ""
        texts[name] = BASE.format(**USUAL, more=lines)
    for name, change in CHANGED.items():
        parts = {part: text.replace("{usual}", USUAL[part][:-1]) if part in USUAL else text for part, text in change.items()}
        texts[name] = BASE.format(**{**USUAL, "more": "", **parts})
    return texts


WEDGE = "v -1 0 -3\nv 1 0 -3\nv 0 2 -3\nv 0 0 -2\nf 1 2 3\nf 2 4 3\nf 4 1 3\n"


@dataclass
class Environment:
    """A folder with maquette's wheel and an empty home; other packages are those of this environment."""

    folder: Path
    variables: dict[str, str] = field(default_factory=dict)
    python: str = ""

    def install(self) -> None:
        """Install the wheel of MAQUETTE_WHEEL, or one that is built from this checkout. Raises CalledProcessError."""
        wheel = os.environ.get(WHEEL)
        pip = [sys.executable, "-P", "-m", "pip"]
        if not wheel:
            subprocess.run([*pip, "wheel", "-q", "--no-deps", "--no-build-isolation", "-w", self.folder, ROOT], check=True)
            wheel = str(next(self.folder.glob("*.whl")))
        subprocess.run([sys.executable, "-P", "-m", "venv", "--without-pip", self.folder / "venv"], check=True)
        self.python = str(self.folder / "venv/bin/python")
        code = "import sysconfig; print(sysconfig.get_path('purelib'))"
        site = Path(subprocess.run([self.python, "-c", code], capture_output=True, text=True, check=True).stdout.strip())
        subprocess.run([*pip, "install", "-q", "--no-deps", "--target", site, wheel], check=True)
        (site / "others.pth").write_text(sysconfig.get_path("purelib") + "\n", encoding="utf-8")
        home = self.folder / "home"
        home.mkdir()
        unset = ("MAQUETTE_CACHE", "XDG_CACHE_HOME", "PYTHONPATH", "PYTHONDONTWRITEBYTECODE")
        self.variables = {name: value for name, value in os.environ.items() if name not in unset} | {"HOME": str(home)}
        # bytecode is compiled by an installer, not at the first start
        subprocess.run([self.python, "-m", "compileall", "-q", site], check=False, env=self.variables)

    def read_only_home(self) -> dict[str, str]:
        """Variables with a home in which nothing can be written."""
        home = self.folder / "locked"
        home.mkdir(mode=0o500, exist_ok=True)
        return {"HOME": "/proc" if os.access(home, os.W_OK) else str(home)}  # root may write everywhere else

    def command(self, *words: str) -> list[str]:
        """The command line of `maquette`."""
        return [self.python, "-P", "-m", "maquette", *words]

    def run(self, *words: str, **variables: str) -> None:
        """Run the command. Raises CalledProcessError."""
        environment = {**self.variables, **variables}
        subprocess.run(self.command(*words), check=True, cwd=self.folder, env=environment, capture_output=True, timeout=SECONDS)

    def render(self, scene: Path, *options: str, **variables: str) -> tuple[float, float]:
        """(seconds of a process that renders a scene, seconds that it waits for kernels). Raises CalledProcessError."""
        stats, began = self.folder / "stats.json", time.perf_counter()
        self.run("render", str(scene), "-o", str(self.folder / "first.png"), "--stats", str(stats), "--quiet", *options, **variables)
        spent = time.perf_counter() - began
        return spent, json.loads(stats.read_text(encoding="utf-8"))["seconds"]["compile_kernels"]


@contextmanager
def watching(environment: Environment, scene: Path, stats: Path) -> Iterator[subprocess.Popen[bytes]]:
    """A process that runs `maquette watch`."""
    words = environment.command("watch", str(scene), "-o", str(scene.with_suffix(".png")), "--stats", str(stats))
    with open(scene.with_suffix(".log"), "wb") as log:
        process = subprocess.Popen(words, cwd=scene.parent, env=environment.variables, stdout=log, stderr=log)
        try:
            yield process
        finally:
            process.send_signal(signal.SIGINT)
            try:
                process.wait(30)
            except subprocess.TimeoutExpired:
                process.kill()


def session(environment: Environment, texts: Mapping[str, str]) -> Iterator[tuple[str, float, float]]:
    """For each edit (name, seconds that its redraw waits for kernels, seconds of the redraw). Raises RuntimeError without a picture."""
    folder = Path(tempfile.mkdtemp(dir=environment.folder))
    scene, stats = folder / "edited.scene", folder / "stats.json"
    (folder / "wedge.obj").write_text(WEDGE, encoding="utf-8")
    names = iter(texts)
    name = next(names)
    scene.write_text(texts[name], encoding="utf-8")
    with watching(environment, scene, stats) as process:
        for number in range(1, len(texts) + 1):
            figures = _await(stats, number, process, scene.with_suffix(".log"))
            yield name, figures["seconds"]["compile_kernels"], figures["redraw"]["total"]
            if number < len(texts):
                name = next(names)
                scene.write_text(texts[name], encoding="utf-8")


def _await(stats: Path, number: int, process: subprocess.Popen[bytes], log: Path) -> dict[str, Any]:
    """The statistics once they count this many redraws."""
    until = time.monotonic() + SECONDS
    while time.monotonic() < until and process.poll() is None:
        if stats.exists():
            figures = json.loads(stats.read_text(encoding="utf-8"))  # replaced as a whole
            if figures["redraw"]["number"] >= number:
                return figures
        time.sleep(0.05)
    raise RuntimeError(f"no picture of edit {number}:\n{log.read_text(encoding='utf-8', errors='replace')[-2000:]}")
