"""Watching: build, then build again whenever a file that the last build read is saved."""

from __future__ import annotations

import contextlib
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import watchfiles

DEBOUNCE = 200  # milliseconds: an editor's several writes of one save count once
STEP = 50


def follow(build: Callable[[], Iterable[Path]], stop: threading.Event | None = None) -> None:
    """Call `build`, which returns the files it read, and again after each change to one of them, until `stop` or Ctrl-C.

    The folders are watched, not the files: editors save by renaming a new file over the old one. Raises KeyboardInterrupt.
    """
    stop = stop or threading.Event()
    files: set[Path] = set()
    with _interrupted(stop):
        _build(build, files)
        while not stop.is_set():
            folders = {file.parent for file in files}
            for _ in _changes(folders, files, stop):
                _build(build, files)
                if {file.parent for file in files} != folders:
                    break


@contextlib.contextmanager
def _interrupted(stop: threading.Event) -> Iterator[None]:
    """Let Ctrl-C set `stop`, too: Python drops an interrupt that comes while a finalizer runs, and so might a library."""
    before = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(before):
        yield
        return
    interrupt = before

    def interrupted(number: int, frame: Any) -> None:
        stop.set()
        interrupt(number, frame)

    signal.signal(signal.SIGINT, interrupted)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _build(build: Callable[[], Iterable[Path]], files: set[Path]) -> None:
    """Build until no file read was saved while the build ran, so that no save falls between building and watching."""
    while True:
        began = time.time_ns()
        read = {Path(file).resolve() for file in build()}
        files.clear()
        files.update(read)
        ended = time.time_ns()
        if not any(file.exists() and began < file.stat().st_mtime_ns < ended for file in files):
            return


def _changes(folders: set[Path], files: set[Path], stop: threading.Event) -> Iterable[object]:
    """Saves of any of `files`, which may grow and shrink meanwhile; folders that have gone are left out."""

    def wanted(_: watchfiles.Change, path: str) -> bool:
        return Path(path).resolve() in files

    there = sorted(str(folder) for folder in folders if folder.is_dir())
    return watchfiles.watch(
        *there, watch_filter=wanted, recursive=False, debounce=DEBOUNCE, step=STEP, stop_event=stop, raise_interrupt=True
    )
