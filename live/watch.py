"""Watching: build, then build again whenever a file that the last build read is saved."""

from __future__ import annotations

import contextlib
import itertools
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import watchfiles

DEBOUNCE = 200  # milliseconds: an editor's several writes of one save count once
STEP = 50
LOOK = 1000  # milliseconds after which files are looked at even where nothing was told: network disks tell nothing

Stamp = tuple[int, int, int] | None  # what a save changes; None where there is no file


def follow(build: Callable[[], Iterable[Path]], stop: threading.Event | None = None) -> None:
    """Call `build`, which returns the files it read, and again once after each save of any of them, until `stop` or Ctrl-C.

    The folders are watched, not the files: editors save by renaming a new file over the old one. What is told of them only
    says when to look: whether to build is decided by comparing the files with what they were when they were last read, so that
    a save is neither lost between two watches nor built twice. Raises KeyboardInterrupt.
    """
    stop = stop or threading.Event()
    with _interrupted(stop):
        read = _build(build, {})
        while not stop.is_set():
            folders = {file.parent for file in read}
            for _ in itertools.chain([()], _told(folders, stop)):
                if {file: _stamp(file) for file in read} != read:
                    read = _build(build, read)
                if {file.parent for file in read} != folders:
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


def _build(build: Callable[[], Iterable[Path]], known: Iterable[Path]) -> dict[Path, Stamp | str]:
    """The files that were read, each as it was before: one that is saved meanwhile differs afterwards."""
    began = time.time_ns()
    before = {file: _stamp(file) for file in known}
    read = {Path(file).resolve() for file in build()}
    return {file: before[file] if file in before else _as_of(began, file) for file in read}


def _as_of(began: int, file: Path) -> Stamp | str:
    """A file that was not known before: if it is newer than that, nobody can say which of its texts was read."""
    stamp = _stamp(file)
    return "unknown" if stamp and stamp[0] > began else stamp


def _stamp(file: Path) -> Stamp:
    try:
        status = file.stat()
    except OSError:
        return None
    return status.st_mtime_ns, status.st_size, status.st_ino


def _told(folders: set[Path], stop: threading.Event) -> Iterable[object]:
    """Something each time that something happens in `folders`, and each second; folders that have gone are left out."""
    there = sorted(str(folder) for folder in folders if folder.is_dir())
    return watchfiles.watch(
        *there, watch_filter=None, recursive=False, debounce=DEBOUNCE, step=STEP, rust_timeout=LOOK, yield_on_timeout=True,
        stop_event=stop, raise_interrupt=True,
    )  # fmt: skip
