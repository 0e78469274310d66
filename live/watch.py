"""File watcher: builds again after each save of a file that the last build read."""

from __future__ import annotations

import contextlib
import itertools
import os
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import watchfiles

from ..lang import file_types

STEP = 5  # milliseconds between looks for events, and without an event until those that came count as one
QUIET = 0.05  # seconds without a change after which a file counts as complete
LONGEST = 0.2  # seconds that a file is waited for
POLL = 1000  # milliseconds between checks without events, for network disks, which send none

Stamp = tuple[int, int, int] | None  # modification time, size and inode; None for a missing file


def follow(
    build: Callable[[], Iterable[Path]], stop: threading.Event | None = None, stale: Callable[[], bool] = lambda: False,
    at_once: bool = False,
) -> None:  # fmt: skip
    """Call `build`, which returns the files it read, and again once after each save of any of them, until `stop` or Ctrl-C.

    Several writes count as one save until the files are quiet; with `at_once`, a source with text is read at once, for builds that the
    next write cancels. Also calls `build` again where `stale()` says so, which is asked at each event and each second.

    Watches the folders, not the files, because editors save by renaming a new file over the old one. An event only triggers a
    comparison of each file's stamp with that of its last read. So no save is lost between two watches or built twice.
    Raises KeyboardInterrupt.
    """
    stop = stop or threading.Event()
    with _stop_on_interrupt(stop):
        read = _build(build, {})
        while not stop.is_set():
            folders = {file.parent for file in read}
            for _ in itertools.chain([()], _events(folders, stop)):
                if _changed(read) or stale():
                    _settle(read, stop, at_once)
                    read = _build(build, read)
                if {file.parent for file in read} != folders:
                    break


@contextlib.contextmanager
def _stop_on_interrupt(stop: threading.Event) -> Iterator[None]:
    """Make Ctrl-C set `stop` too, because Python drops an interrupt during a finalizer, and a library may do so."""
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


def _build(build: Callable[[], Iterable[Path]], files: Iterable[Path]) -> dict[Path, Stamp | str]:
    """The files that were read, with their stamps before the build, so that a save during the build is detected."""
    began = time.time_ns()
    before = {file: _stamp(file) for file in files}
    named = {Path(os.path.abspath(file)) for file in build()}
    read = named | {Path(os.path.realpath(file)) for file in named}  # a link may become a file, and its target may change
    return {file: before[file] if file in before else _stamp_before(began, file) for file in read}


def _stamp_before(began: int, file: Path) -> Stamp | str:
    """The stamp of a new file; "unknown" if it changed after `began`, because either version may have been read."""
    stamp = _stamp(file)
    return "unknown" if stamp and stamp[0] > began else stamp


def _changed(read: Mapping[Path, Stamp | str]) -> dict[Path, Stamp]:
    """The files whose stamps differ from those of the last build."""
    now = {file: _stamp(file) for file in read}
    return {file: stamp for file, stamp in now.items() if stamp != read[file]}


def _settle(read: Mapping[Path, Stamp | str], stop: threading.Event, at_once: bool) -> None:
    """Wait until the changed files are complete: with `at_once` a source with text is so, as editors write it in one piece."""
    end, before = time.monotonic() + LONGEST, None
    while (changed := _changed(read)) != before and time.monotonic() < end:
        if at_once and all(stamp and stamp[1] and file.suffix.lower() in file_types.SCENE for file, stamp in changed.items()):
            return
        before = changed
        stop.wait(QUIET)


def _stamp(file: Path) -> Stamp:
    try:
        status = file.stat()
    except OSError:
        return None
    return status.st_mtime_ns, status.st_size, status.st_ino


def _events(folders: set[Path], stop: threading.Event) -> Iterable[object]:
    """An item for each event in `folders`, and one each second. Missing folders are skipped."""
    existing = sorted(str(folder) for folder in folders if folder.is_dir())
    return watchfiles.watch(
        *existing, watch_filter=None, recursive=False, debounce=10 * STEP, step=STEP, rust_timeout=POLL, yield_on_timeout=True,
        stop_event=stop, raise_interrupt=True,
    )  # fmt: skip
