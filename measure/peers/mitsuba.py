"""Mitsuba 3 as a peer: its LLVM variant if LLVM is installed, else its scalar variant."""

from __future__ import annotations

import ctypes.util
import importlib.util
import json
import os
import re
import sys
import tempfile
from importlib import metadata
from pathlib import Path

import numpy as np

from ...compiler import ir
from ...compiler.exporters.mitsuba import scene as mitsuba_scene
from ...compiler.plan.plan import Plan
from ...render.tessellation import scene_meshes
from ..records import Run, Setting
from . import process

SAMPLES = (1, 4, 16, 64, 256, 1024, 4096)
RUNNER = Path(__file__).with_name("mitsuba_worker.py")
_LIBRARIES = ("/usr/lib", "/usr/lib64", "/usr/local/lib", "/opt/homebrew/opt/llvm/lib")


class Mitsuba:
    """Mitsuba 3 (https://mitsuba-renderer.org), a path tracer; Jakob et al. 2022."""

    name = "mitsuba"

    @property
    def missing(self) -> str:
        if importlib.util.find_spec("mitsuba") is None:
            return "Mitsuba is not installed: pip install mitsuba"
        return ""

    @property
    def version(self) -> str:
        return f"Mitsuba {metadata.version('mitsuba')} {variant()}"

    def unsupported(self, scene: ir.Scene, plan: Plan) -> list[str]:
        return mitsuba_scene.write(scene, plan, "scene", scene_meshes.make_tessellator(scene, plan)).lost

    def sweep(self, scene: ir.Scene, plan: Plan) -> tuple[Setting, ...]:
        return tuple(Setting(self.name, "samples", n, {"samples": n}) for n in SAMPLES)

    def run(self, scene: ir.Scene, plan: Plan, setting: Setting, seed: int) -> Run:
        request = {
            "variant": variant(), "samples": int(setting.options["samples"]), "seed": seed, "threads": process.threads(plan),
        }  # fmt: skip
        with tempfile.TemporaryDirectory(prefix="maquette-mitsuba-") as folder:
            exported = mitsuba_scene.write(scene, plan, "scene", scene_meshes.make_tessellator(scene, plan))
            exported.save(Path(folder) / "scene.xml")
            command = [sys.executable, "-P", str(RUNNER), "scene.xml", "out.npz", json.dumps(request)]  # -P: this file is not `mitsuba`
            process.run("Mitsuba", command, Path(folder), _environment())
            with np.load(Path(folder) / "out.npz", allow_pickle=False) as data:
                about = json.loads(str(data["about"]))
                return Run(data["rgb"], about["seconds"], float(about["cpu"]), seed)


def variant() -> str:
    """The fastest available variant; all are float32."""
    return "llvm_ad_rgb" if find_llvm() else "scalar_rgb"


def find_llvm() -> str:
    """The path of the newest LLVM library, or an empty string. DRJIT_LIBLLVM_PATH has precedence."""
    library = os.environ.get("DRJIT_LIBLLVM_PATH")
    if library:
        return library
    patterns = ("libLLVM*.so*", "*/libLLVM*.so*", "libLLVM*.dylib")
    libraries = [
        path for folder in _LIBRARIES for pattern in patterns for path in Path(folder).glob(pattern)
        if re.fullmatch(r"libLLVM[-.\d]*\.(so|dylib)[.\d]*", path.name)
    ]  # fmt: skip
    if libraries:
        return str(max(libraries, key=lambda path: [int(n) for n in re.findall(r"\d+", path.name)] or [0]))
    return ctypes.util.find_library("LLVM") or ""


def _environment() -> dict[str, str]:
    library = find_llvm()
    return {"DRJIT_LIBLLVM_PATH": library} if library else {}
