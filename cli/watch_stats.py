"""What each redraw of `watch` costs: seconds from the save to the picture, CPU seconds, part by part; --stats keeps them in a file."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import click

from . import render_job as jobs

KEPT = 1000  # redraws that the file tells of
CHANGED = "st_ctime_ns" if os.name == "posix" else "st_mtime_ns"  # renaming a file over another keeps what st_mtime says


@dataclass(slots=True)
class Redraws:
    """A job that is done again at every save, and what each time cost. What cannot be drawn changes neither picture nor figures."""

    job: jobs.Job
    stats: Path | None = None
    rows: list[dict[str, Any]] = field(default_factory=list)
    number: int = 0
    began: int = 0  # nanoseconds since 1970 of the last redraw, whether it succeeded or not
    idle_since: float = field(default_factory=time.process_time)

    def build(self) -> tuple[Path, ...]:
        """Render once; returns the files to watch. Raises KeyboardInterrupt."""
        before, self.began = self.began, time.time_ns()
        waited = (self.began - self._saved(before)) * 1e-9
        idle = time.process_time() - self.idle_since
        figures = self.job.build()
        if figures is not None:
            self._note(figures, waited, idle)
        self.idle_since = time.process_time()
        return self.job.files or (self.job.source.path,)

    def _saved(self, before: int) -> int:
        """When what is drawn now was saved: the newest change of a file since the last redraw began, or now where none tells."""
        changes = [getattr(file.stat(), CHANGED) for file in self.job.files if file.exists()]
        return max((at for at in changes if before < at <= self.began), default=self.began)

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
        self.rows = [*self.rows, row][-KEPT:]
        if not self.job.quiet:
            after = f"; {row['total']:.2f} s after the save" if self.number > 1 else ""
            click.echo(jobs.summary(self.job.output, figures) + after)
        if self.stats:
            jobs.write_json(self.stats, {**figures, "redraw": row, "redraws": self.rows})
