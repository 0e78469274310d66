"""Statistics of the redraws of `watch`: seconds from the save to the picture, and CPU seconds, by part."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import click

from . import render_job as jobs

MAX_ROWS = 1000  # redraws in the file
CHANGED = "st_ctime_ns" if os.name == "posix" else "st_mtime_ns"  # renaming a file over another keeps its st_mtime


@dataclass(slots=True)
class Edits:
    """Statistics of the edits in a window."""

    stats: Path
    rows: list[dict[str, Any]] = field(default_factory=list)
    total: dict[str, int] = field(default_factory=dict)

    def note(self, row: dict[str, Any]) -> None:
        """Add the counts of an edit, see live/edit_counts.py, and write the file."""
        self.rows = [*self.rows, row][-MAX_ROWS:]
        self.total = {name: self.total.get(name, 0) + count for name, count in row["work"].items()}
        jobs.write_json(self.stats, {"edits": self.rows, "total": self.total})


@dataclass(slots=True)
class Redraws:
    """A job that renders at every save, with its statistics. A render with errors changes neither picture nor statistics."""

    job: jobs.Job
    stats: Path | None = None
    rows: list[dict[str, Any]] = field(default_factory=list)
    number: int = 0
    began: int = 0  # nanoseconds since 1970 of the last redraw, whether it succeeded or not
    idle_since: float = field(default_factory=time.process_time)

    def build(self) -> tuple[Path, ...]:
        """Render once. Returns the files to watch. Raises KeyboardInterrupt."""
        before, self.began = self.began, time.time_ns()
        waited = (self.began - self._save_time(before)) * 1e-9
        idle = time.process_time() - self.idle_since
        figures = self.job.build()
        if figures is not None:
            self._note(figures, waited, idle)
        self.idle_since = time.process_time()
        return self.job.files or (self.job.source.path,)

    def _save_time(self, before: int) -> int:
        """The time of the save: the newest change of a file since the start of the last redraw, or now without a change."""
        changes = [getattr(file.stat(), CHANGED) for file in self.job.files if file.exists()]
        return max((time for time in changes if before < time <= self.began), default=self.began)

    def _note(self, figures: Mapping[str, Any], waited: float, idle: float) -> None:
        laps = self.job.laps
        self.number += 1
        row = {
            "number": self.number,
            "total": waited + sum(laps.seconds.values()),
            "seconds": {"wait": waited, **laps.seconds},
            "cpu_total": sum(laps.cpu.values()),
            "cpu_seconds": {"idle": idle, **laps.cpu},
        }
        self.rows = [*self.rows, row][-MAX_ROWS:]
        if not self.job.quiet:
            after = f"; {row['total']:.2f} s after the save" if self.number > 1 else ""
            click.echo(jobs.summary(self.job.output, figures) + after)
        if self.stats:
            jobs.write_json(self.stats, {**figures, "redraw": row, "redraws": self.rows})
