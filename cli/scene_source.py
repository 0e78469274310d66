"""A scene file with the options for reading it: its scene at a time, its frames and their rate."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ..lang import file_types
from ..lang.diagnostics import Diagnostics
from .option_types import MAX_FRAMES

if TYPE_CHECKING:
    from ..compiler import ir
    from ..compiler.importers.common.mesh_options import MeshOptions
    from ..compiler.importers.stage_options import StageOptions


@dataclass(frozen=True, slots=True)
class Source:
    """A scene file with the options for reading it."""

    path: Path
    sets: Mapping[str, str]
    time: float | None
    allow: tuple[Path, ...]
    stage: StageOptions
    mesh: MeshOptions
    max_elements: int | None = None
    ocio: str | None = None  # configuration of OpenColorIO
    fps: float | None = None  # pictures a second of a file that has no rate of its own

    def load(self, seconds: dict[str, float], time: float | None = None, code: float | None = None) -> tuple[ir.Scene, Diagnostics]:
        """The scene at `time` seconds or at a USD time code (default: --time), and its diagnostics. Raises SceneError."""
        with measure_time(seconds, "import"):
            from ..compiler import load

        diagnostics = Diagnostics()
        scene = load.load_with_colors(
            self.ocio, self.path, sets=self.sets, time=self.time if time is None else time, code=code, allow=self.allow,
            stage=self.stage, mesh=self.mesh, max_elements=self.max_elements, diagnostics=diagnostics, seconds=seconds,
        )  # fmt: skip
        return scene, diagnostics

    def summary(self) -> list[str]:
        """Lines about the file itself, of a USD stage; empty for other kinds."""
        if self.path.suffix.lower() not in file_types.USD:
            return []
        from ..compiler.importers.usd import stage
        from ..compiler.io import sandbox

        return stage.summary(self.path, self.stage, sandbox.open_main(self.path, self.allow)[0])

    def frames(self, chosen: tuple[float, ...]) -> tuple[float, ...]:
        """The frames asked for; for `all`, which is (), those of the stage or animation.

        A stage has the frames from its start to its end code. A duration is half-open: 1 s at 4 frames a second has the frames 0 to 3,
        since frame 4 is the moment at which a loop begins again.
        """
        if chosen:
            return chosen
        if self.path.suffix.lower() in file_types.USD:
            from ..compiler.importers.usd import stage

            codes = stage.time_codes(self.path)
            first, count = (None, 0.0) if codes is None else (codes[0], codes[1] - codes[0] + 1 + 1e-6)
        else:
            scene, _ = self.load({})
            first, count = (0.0, math.ceil(scene.duration * self.rate() - 1e-6)) if scene.duration else (None, 0.0)
        if first is None:
            raise click.UsageError(f"{self.path} has no range of frames: name them, as in --frames 1..24")
        if not (math.isfinite(first) and count <= MAX_FRAMES):
            raise click.UsageError(f"{self.path} has more than {MAX_FRAMES:,} frames: name some, as in --frames 1..24")
        return tuple(first + k for k in range(max(int(count), 1)))

    def rate(self) -> float:
        """Frames a second: of a USD stage, time codes a second; of a glTF file, those asked for."""
        if self.path.suffix.lower() in file_types.USD:
            from ..compiler.importers.usd import stage

            return stage.time_codes_per_second(self.path)
        if self.fps is not None:
            return self.fps
        scene, _ = self.load({})
        return scene.fps

    def moments(self, frames: tuple[float, ...]) -> list[dict[str, float]]:
        """The arguments of `load` for each frame: time codes for a USD stage, else times at the frame rate of the scene."""
        if self.path.suffix.lower() in file_types.USD:
            return [{"code": float(number)} for number in frames]
        rate = self.rate()
        return [{"time": number / rate} for number in frames]


@contextmanager
def measure_time(seconds: dict[str, float], stage: str) -> Iterator[None]:
    """Add the duration of the `with` block to `seconds[stage]`."""
    began = time.perf_counter()
    try:
        yield
    finally:
        seconds[stage] = seconds.get(stage, 0.0) + time.perf_counter() - began


class Laps:
    """Seconds, and CPU seconds of all threads, of consecutive parts."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.cpu: dict[str, float] = {}
        self._last = time.perf_counter(), time.process_time()

    def end(self, part: str) -> None:
        """Record the time since the end of the last part."""
        (seconds, cpu), now = self._last, (time.perf_counter(), time.process_time())
        self.seconds[part], self.cpu[part] = now[0] - seconds, now[1] - cpu
        self._last = now
