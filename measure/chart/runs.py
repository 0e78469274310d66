"""Times one render of a setting: wall seconds by stage, and CPU seconds of the process."""

from __future__ import annotations

import functools
import platform
import re
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from importlib import metadata
from pathlib import Path
from typing import Any

from ...compiler import ir
from ...compiler.io import child_process
from ...compiler.plan import plan as planner
from ...lang.distribution import VERSION
from ...render import render_scene
from ...render.film.progress import Progress
from ...render.jit import cancellation
from ...render.simd.target import cores
from ..cost_model import Seconds
from ..records import Run, Setting

VERSIONED_PACKAGES = ("numpy", "numba", "flip-evaluator")


class Stop(threading.Event):
    """Set when another event is, or when a time is over."""

    def __init__(self, cancel: threading.Event, is_over: Callable[[], bool]) -> None:
        super().__init__()
        self._cancel, self._is_over = cancel, is_over

    def is_set(self) -> bool:
        """Whether work is to end."""
        return self._cancel.is_set() or self._is_over()


class Cancelled(Exception):
    """The render was cancelled."""


def make_plan(scene: ir.Scene, settings: ir.Settings, setting: Setting, seed: int) -> planner.Plan:
    """The plan of a step: shared settings overridden by its own. Raises planner.PlanError."""
    options: Mapping[str, Any] = {**setting.options, "backend": setting.backend, "seed": seed, "aov": ()}
    if "error" in options:
        options = {"samples": None, **options}
    return planner.make_plan(scene, replace(settings, **options), setting.plan)


def run(scene: ir.Scene, plan: planner.Plan, cancel: threading.Event | None = None) -> Run:
    """Render once. CPU seconds cover building and rendering. Raises Cancelled."""
    before = time.process_time()
    try:
        image = render_scene.draw(scene, plan, None, cancel)
    except cancellation.Cancelled:
        raise Cancelled from None
    cpu = time.process_time() - before
    if image.metadata["partial"]:
        raise Cancelled
    rgba = image.channels["rgba"]
    notes = tuple(dict.fromkeys(message for message, _, _ in image.metadata["notes"]))
    return Run(rgba[..., :3], dict(image.metadata["seconds"]), cpu, plan["seed"], rgba[..., 3], notes, image.metadata["samples_mean"])


class Stages:
    """The time of a picture and of its denoising, in wall and CPU seconds; `report` is that of render_scene.draw."""

    def __init__(self) -> None:
        self._began, self._marks = _clocks(), dict[str, tuple[float, float]]()

    def report(self, progress: Progress) -> None:
        """Note when a stage begins."""
        self._marks.setdefault(progress.stage, _clocks())

    def spent(self) -> Seconds:
        """The time so far."""
        return _between(self._began, _clocks())

    def denoising(self) -> Seconds:
        """The time of denoising a finished picture."""
        marks = self._marks
        return _between(marks["denoising"], marks["finishing"]) if "denoising" in marks and "finishing" in marks else Seconds()


def _clocks() -> tuple[float, float]:
    return time.perf_counter(), time.process_time()


def _between(before: tuple[float, float], after: tuple[float, float]) -> Seconds:
    return Seconds(after[0] - before[0], after[1] - before[1])


def threads(settings: ir.Settings) -> int:
    """The number of threads of every contestant."""
    return settings.threads or cores()


@functools.cache
def import_seconds() -> float:
    """Seconds to import the renderer in a new process; 0 if none can be started."""
    code = "import time; t = time.perf_counter(); import maquette.render.render_scene; print(time.perf_counter() - t)"
    try:
        done = child_process.run(
            child_process.python(code), timeout=60, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
            text=True, check=True,
        )  # fmt: skip
        return float(done.stdout)
    except (OSError, subprocess.SubprocessError, ValueError):
        return 0.0


def machine(settings: ir.Settings) -> str:
    """The measuring machine, as in "4 threads of 8, AMD EPYC …, Linux"."""
    used, all_ = threads(settings), cores()
    return f"{used} thread{'' if used == 1 else 's'} of {all_}, {_processor()}, {platform.system()}"


def versions() -> dict[str, str]:
    """Versions of the packages that the figures depend on."""
    return {"python": platform.python_version(), "maquette": VERSION, **{name: metadata.version(name) for name in VERSIONED_PACKAGES}}


def _processor() -> str:
    if sys.platform == "linux":
        named = re.search(r"^model name\s*: (.*)$", Path("/proc/cpuinfo").read_text(encoding="utf-8"), re.MULTILINE)
        if named:
            return named[1].strip()
    return platform.processor() or platform.machine()
