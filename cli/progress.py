"""Shows the progress of a command on stderr: the stage, samples and error so far, and the time left.

A terminal has one line, rewritten four times a second; other streams get a line every ten seconds, if it has changed or
while kernels compile. Work that ends sooner shows nothing.
MAQUETTE_PROGRESS=off shows nothing at all.
"""

from __future__ import annotations

import math
import os
import shutil
import sys
import threading
import time
from collections import deque
from types import TracebackType

import click

from ..lang.plain_values import time_range
from ..render.film.progress import Progress
from ..render.jit import compile_events
from . import terminal

FIRST = 1.0  # seconds without a line on a terminal
TICK = 0.25  # seconds between two forms of the line on a terminal
EVERY = 10.0  # seconds between lines where there is no terminal
SETTLED = 2.0  # seconds of a stage before its time left is shown


class TimeLeft:
    """The time that a stage will still take, from the shares that it reached so far.

    Each share predicts an end twice: by the pace since the beginning, and by that of the second half of the elapsed time. The spread
    holds 8 of 10 predictions of that half, and the last ones.
    """

    def __init__(self) -> None:
        self._points: deque[tuple[float, float]] = deque()  # (seconds since the beginning, share)
        self._ends: deque[tuple[float, float]] = deque()  # (seconds since the beginning, predicted seconds of the stage)

    def add(self, elapsed: float, share: float) -> None:
        """Add a share, 0 to 1, reached after `elapsed` seconds."""
        self._points.append((elapsed, share))
        while len(self._points) > 2 and self._points[1][0] <= 0.5 * elapsed:
            self._points.popleft()
        if share <= 0.0:
            return
        self._ends.append((elapsed, elapsed / share))
        before, reached = self._points[0]
        if share > reached and elapsed > before:
            self._ends.append((elapsed, elapsed + (1.0 - share) * (elapsed - before) / (share - reached)))
        while self._ends and self._ends[0][0] < 0.5 * elapsed:
            self._ends.popleft()

    def between(self, elapsed: float) -> tuple[float, float] | None:
        """Seconds left after `elapsed`, at least and at most; None while nothing is known."""
        if not self._ends or elapsed < SETTLED:
            return None
        ends = sorted(end for _, end in self._ends)
        outside = len(ends) // 10
        last = [end for count, end in self._ends if count == self._ends[-1][0]]
        return max(min(ends[outside], *last) - elapsed, 0.0), max(max(ends[-1 - outside], *last) - elapsed, 0.0)


class Display:
    """A context that shows the progress of a command, unless `quiet`. Call it with a Progress, or `stage` with a name."""

    def __init__(self, quiet: bool, what: str = "") -> None:
        self.what = what  # put before the stage, as in "frame 3 (3 of 48)"
        self._rewrites = terminal.supports_color(sys.stderr)
        self._lock = threading.RLock()
        self._ended = threading.Event()
        quiet = quiet or os.environ.get("MAQUETTE_PROGRESS") == "off"
        self._thread = None if quiet else threading.Thread(target=self._tick, daemon=True)
        self._shown = False
        self._last = ""  # line where there is no terminal
        self._compiling: compile_events.Compiling | None = None
        self._stopped = 0.0  # when the compilation began
        self.stage("starting")

    def __enter__(self) -> Display:
        compile_events.LISTENERS.append(self.compiling)
        if self._thread is not None:
            self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        compile_events.LISTENERS.remove(self.compiling)
        self._ended.set()
        if self._thread is not None:
            self._thread.join()
        self.hide()

    def stage(self, name: str) -> None:
        """Begin a stage about which only its name is known."""
        with self._lock:
            self._name, self._began, self._left = name, time.monotonic(), TimeLeft()
            self._progress: Progress | None = None

    def __call__(self, progress: Progress) -> None:
        """Take a message of the renderer."""
        with self._lock:
            if progress.stage != self._name:
                self.stage(progress.stage)
            self._progress = progress
            self._left.add(time.monotonic() - self._began, progress.share)

    def compiling(self, event: compile_events.Compiling | None) -> None:
        """Take a message of the compiler. Its time does not count as time of the stage."""
        with self._lock:
            now = time.monotonic()
            if self._compiling is None:
                self._stopped = now
            if event is None:
                self._began += now - max(self._stopped, self._began)
            self._compiling = event

    def hide(self) -> None:
        """Remove the line from a terminal, before other text."""
        with self._lock:
            if self._shown:
                click.echo("\r\x1b[K", err=True, nl=False)
            self._shown = False

    def text(self) -> str:
        """The line for the current stage."""
        with self._lock:
            before = f"{self.what}: " if self.what else ""
            if self._compiling is not None:
                return f"{before}compiling kernel {self._compiling.number} of about {self._compiling.total}"
            return before + ", ".join((self._name, *self._figures()))

    def _figures(self) -> list[str]:
        progress, parts = self._progress, []
        if progress is None or (progress.share <= 0.0 and progress.samples <= 0.0):
            return parts
        if 0.0 < progress.share < 1.0:
            parts.append(f"{math.floor(100.0 * progress.share)} %")
        if progress.samples > 0.0 and progress.most != 1:
            limit = f" of {progress.most}" if progress.most else f" of at most {progress.limit}" if progress.limit else ""
            parts.append(f"{progress.samples:.{0 if progress.samples >= 10.0 else 1}f}{limit} samples")
        if progress.error is not None:
            part = " in the tiles drawn" if progress.most and progress.share < 1.0 else ""  # tiles may differ, such as those of the sky
            parts.append(f"noise {progress.error:.2%}{part}")
        elapsed = time.monotonic() - self._began
        between = self._left.between(elapsed)
        if between is not None and progress.share < 1.0 and progress.limit:
            parts.append(f"at most {time_range(elapsed * max(progress.limit / progress.samples - 1.0, 0.0))} left")
        elif between is not None and progress.share < 1.0:
            parts.append(f"{time_range(*between)} left")
        return parts

    def _tick(self) -> None:
        wait = FIRST if self._rewrites else EVERY
        while not self._ended.wait(wait):
            self._show()
            wait = TICK if self._rewrites else EVERY

    def _show(self) -> None:
        with self._lock:
            if not self._rewrites:
                text = self.text()
                if text != self._last:
                    click.echo(text, err=True)
                elif self._compiling is not None:  # a kernel may take minutes
                    click.echo(f"{text}, {time.monotonic() - self._stopped:.0f} s so far", err=True)
                self._last = text
                return
            width = shutil.get_terminal_size().columns - 1
            click.echo(f"\r\x1b[K{self.text()[:width]}", err=True, nl=False)
            self._shown = True
