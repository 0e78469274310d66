"""POV-Ray 3.7 as a peer, for Whitted ray tracing. It is float64 and writes half floats (EXR), about three digits."""

from __future__ import annotations

import re
import shutil
import tempfile
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.exporters.povray import scene as povray_scene
from ...compiler.io import child_process
from ...compiler.plan.plan import Plan
from ...render.image import image_reader
from ...render.tessellation import scene_meshes
from ..records import Run, Setting
from . import process

GRID_SIZES = (1, 2, 3, 4, 6, 8)  # samples across a pixel: 1, 4, 9, 16, … in all
_TRACE = re.compile(r"Trace Time:.*?\(([\d.]+) seconds\)", re.S)
_PARSE = re.compile(r"Parse Time:.*?\(([\d.]+) seconds\)", re.S)
_CPU = re.compile(r"using \d+ thread\(s\) with ([\d.]+) CPU-seconds total")


class PovRay:
    """POV-Ray (https://www.povray.org), a Whitted ray tracer."""

    name = "povray"

    @property
    def missing(self) -> str:
        return "" if shutil.which("povray") else "POV-Ray is not installed: apt install povray"

    @property
    def version(self) -> str:
        output = child_process.run(["povray", "--version"], capture_output=True, text=True, check=False)
        match = re.search(r"POV-Ray ([\w.]+)", output.stdout + output.stderr)
        return f"POV-Ray {match.group(1) if match else '(version unknown)'}"

    def unsupported(self, scene: ir.Scene, plan: Plan) -> list[str]:
        return povray_scene.write(scene, plan, "scene", scene_meshes.make_tessellator(scene, plan)).lost

    def sweep(self, scene: ir.Scene, plan: Plan) -> tuple[Setting, ...]:
        return tuple(Setting(self.name, "samples", n * n, {"samples": n * n}) for n in GRID_SIZES)

    def run(self, scene: ir.Scene, plan: Plan, setting: Setting, seed: int) -> Run:
        across = max(round(int(setting.options["samples"]) ** 0.5), 1)
        with tempfile.TemporaryDirectory(prefix="maquette-povray-") as name:
            folder = Path(name)
            povray_scene.write(scene, plan, "scene", scene_meshes.make_tessellator(scene, plan)).save(folder / "scene.pov")
            started = time.perf_counter()
            output = process.run("POV-Ray", ["povray", *arguments(plan, across)], folder)
            total = time.perf_counter() - started
            rgb = _read(folder / "out.exr", plan)
        render, parse = _seconds(_TRACE, output), _seconds(_PARSE, output)
        cpu = re.findall(_CPU, output)
        stages = {"import": max(total - render - parse, 0.0), "build": parse, "compile_kernels": 0.0, "render": render}
        return Run(rgb, stages, float(cpu[-1]) if cpu else render, seed)


def arguments(plan: Plan, across: int) -> list[str]:
    """The command line: linear EXR, a grid of `across` × `across` samples a pixel without jitter, and the crop."""
    width, height = plan["size"]
    x0, y0, x1, y1 = plan["crop"]
    words = ["+Iscene.pov", "+Oout.exr", "+FE", f"+W{width}", f"+H{height}", f"+WT{process.threads(plan)}", "-D", "-P", "-C"]
    words += ["+AM1", "+A0.0", f"+R{across}", "-J"] if across > 1 else ["-A"]
    if (x0, y0, x1, y1) != (0, 0, width, height):
        words += [f"+SC{x0 + 1}", f"+SR{y0 + 1}", f"+EC{x1}", f"+ER{y1}"]
    return words


def _read(path: Path, plan: Plan) -> NDArray[np.float32]:
    if not path.is_file():
        raise process.PeerError("POV-Ray wrote no picture")
    rgb = image_reader.read(path).channels["rgba"][..., :3]
    x0, y0, x1, y1 = plan["crop"]
    if rgb.shape[:2] != (y1 - y0, x1 - x0):
        rgb = rgb[y0:y1, x0:x1]
    return np.ascontiguousarray(rgb, np.float32)


def _seconds(pattern: re.Pattern[str], output: str) -> float:
    times = pattern.findall(output)
    return float(times[-1]) if times else 0.0
