"""The work of an edit: how often each stage of a compilation and of a picture ran for it."""

from __future__ import annotations

import time
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

from ..compiler.io.stage_cache import StageCache
from ..lang.eval import modules
from ..render.accel.bvh_build import tree_cache
from ..render.jit import compile_events

READ = ("meshes read", "meshes triangulated", "images read")  # stages of StageCache


@dataclass(eq=False, slots=True)
class Work:
    """Counts the work between `begin` and `end`."""

    stages: StageCache
    counted: Counter[str] = field(default_factory=Counter)  # "scenes evaluated", "pictures drawn", "pixels drawn"
    number: int = 0
    _before: Counter[str] = field(default_factory=Counter)
    _began: float = 0.0
    _seconds: dict[str, float] = field(default_factory=dict)

    def begin(self) -> None:
        """An edit begins."""
        self._before, self._began, self._seconds = self._total(), time.monotonic(), {}

    def reach(self, what: str) -> None:
        """Note the time since the edit began, once for each name: "compiled", "first picture", "whole picture", "finished"."""
        self._seconds.setdefault(what, time.monotonic() - self._began)

    def end(self) -> dict[str, Any]:
        """The edit ends: its number, the seconds from its begin to what it reached, and its counts."""
        self.number += 1
        now = self._total()
        return {"number": self.number, "seconds": self._seconds, "work": {name: now[name] - self._before[name] for name in now}}

    def _total(self) -> Counter[str]:
        """All counts so far; a name for each, also where it is 0."""
        counts = {name: self.counted[name] for name in ("scenes evaluated", "pictures drawn", "pixels drawn")}
        trees = {f"mesh BVHs {how}": tree_cache.COUNTS[how] for how in ("built", "refitted", "read")}
        read = {name: self.stages.made[name] for name in READ}
        return Counter({"sources parsed": modules.parsed(), **read, **trees, "kernels compiled": compile_events.compiled(), **counts})
