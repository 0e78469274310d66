"""A scene file with the options for reading it: its scene at a time, its frames and their rate."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ..lang import file_types
from ..lang.diagnostics import Diagnostics

if TYPE_CHECKING:
    from ..compiler import ir
    from ..compiler.importers.stage_options import StageOptions


@dataclass(frozen=True, slots=True)
class Source:
    """A scene file with the options for reading it."""

    path: Path
    sets: Mapping[str, str]
    time: float | None
    allow: tuple[Path, ...]
    stage: StageOptions
    max_elements: int | None = None

    def load(self, seconds: dict[str, float], time: float | None = None, code: float | None = None) -> tuple[ir.Scene, Diagnostics]:
        """The scene at `time` seconds or at a USD time code (default: --time), and its diagnostics. Raises SceneError."""
        with measure_time(seconds, "import"):
            from ..compiler import load

        found = Diagnostics()
        scene = load.load(
            self.path, sets=self.sets, time=self.time if time is None else time, code=code, allow=self.allow, variants=self.stage.variants,
            stage=self.stage, max_elements=self.max_elements, diagnostics=found, seconds=seconds,
        )  # fmt: skip
        return scene, found

    def summary(self) -> list[str]:
        """Lines about the file itself, of a USD stage; empty for other kinds."""
        if self.path.suffix.lower() not in file_types.USD:
            return []
        from ..compiler.importers.usd import stage

        return stage.summary(self.path, self.stage)

    def frames(self, asked: tuple[float, ...]) -> tuple[float, ...]:
        """The frames asked for; for `all`, which is (), those from the start to the end of the stage or animation."""
        if asked:
            return asked
        if self.path.suffix.lower() in file_types.USD:
            from ..compiler.importers.usd import stage

            found = stage.time_codes(self.path)
        else:
            scene, _ = self.load({})
            found = (0.0, scene.duration * scene.fps) if scene.duration else None
        if found is None:
            raise click.UsageError(f"{self.path} has no range of frames: name them, as in --frames 1..24")
        return tuple(found[0] + k for k in range(int(found[1] - found[0] + 1e-6) + 1))

    def rate(self) -> float:
        """Frames a second: of a USD stage, time codes a second."""
        if self.path.suffix.lower() in file_types.USD:
            from ..compiler.importers.usd import stage

            return stage.time_codes_per_second(self.path)
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
