"""A Dask scheduler and workers as processes of their own, which tests kill and stop."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import distributed

CODE = "import sys; sys.argv[0] = 'dask'; from distributed.cli.{0} import main; main()"


class Processes:
    """A scheduler on this machine, and its workers by name."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.workers = folder, dict[str, subprocess.Popen[bytes]]()
        self._number = 0
        file = folder / "scheduler.json"
        self.scheduler = self._start("dask_scheduler", "--port", "0", "--scheduler-file", str(file), "--no-dashboard", name="scheduler")
        self.address = str(until(lambda: _address(file), "a scheduler"))

    def _start(self, command: str, *options: str, name: str, **environment: str) -> subprocess.Popen[bytes]:
        with open(self.folder / f"{name}.log", "wb") as log:
            return subprocess.Popen(
                [sys.executable, "-c", CODE.format(command), "--host", "127.0.0.1", *options], stdout=log, stderr=log,
                env={**os.environ, "DASK_DISTRIBUTED__WORKER__DAEMON": "False", **environment}, start_new_session=True,
            )  # fmt: skip

    def start(self, count: int = 1, preload: str = "", **environment: str) -> list[str]:
        """Start workers with environment variables, and run the Python code `preload` in them first. Returns their names."""
        options = ["--nthreads", "1", "--no-nanny", "--no-dashboard", "--memory-limit", "0", "--local-directory", str(self.folder)]
        names = []
        for _ in range(count):
            self._number += 1
            names.append(f"w{self._number}")
            file = self.folder / f"{names[-1]}_preload.py"
            file.write_text(preload, encoding="utf-8")
            more = ["--preload", str(file)] if preload else []
            every = (self.address, "--name", names[-1], *options, *more)
            self.workers[names[-1]] = self._start("dask_worker", *every, name=names[-1], **environment)
        return names

    def wait(self, count: int) -> None:
        """Wait until the scheduler has so many workers."""
        with distributed.Client(self.address, set_as_default=False) as client:
            client.wait_for_workers(count, timeout=60)

    def send(self, name: str, number: int) -> None:
        """Send a signal to a worker."""
        self.workers[name].send_signal(number)
        if number == signal.SIGKILL:
            self.workers.pop(name).wait()

    def close(self) -> None:
        """Kill all."""
        for process in (*self.workers.values(), self.scheduler):
            with contextlib.suppress(OSError):
                process.kill()
            process.wait()


def until(found: Any, what: str, seconds: float = 60.0) -> Any:
    """The first true answer of `found`."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if answer := found():
            return answer
        time.sleep(0.02)
    raise TimeoutError(f"no {what} after {seconds} s")


def _address(file: Path) -> str | None:
    try:
        return json.loads(file.read_text(encoding="utf-8"))["address"]
    except (OSError, ValueError, KeyError):
        return None
