"""Watching: a save builds again, whatever the editor's way of saving; files that come and go; errors that are mended."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

from maquette.live import watch
from maquette.render import output

SCENE = """\
use "part.scene"
part()
point([2, 4, 3], intensity: 20)
camera(position: [0, 0, 5], look_at: [0, 0, 0], fov: 35deg)
render(size: [16, 12], samples: 1, background: #000000)
"""


def _interruptible() -> None:
    """Shells start what runs in their background with interrupts ignored, tests too."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def wait(condition: Callable[[], bool], seconds: float = 30.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not happen in time"
        time.sleep(0.02)


class Follower:
    """`watch.follow` in a thread, counting builds."""

    def __init__(self, files: Callable[[], list[Path]]) -> None:
        self.count = 0
        self._files = files
        self._stop = threading.Event()
        self._thread = threading.Thread(target=watch.follow, args=(self._build, self._stop))

    def _build(self) -> list[Path]:
        self.count += 1
        return self._files()

    def __enter__(self) -> Follower:
        self._thread.start()
        wait(lambda: self.count == 1)
        time.sleep(0.5)  # the watcher itself needs a moment
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join(timeout=10)
        assert not self._thread.is_alive()


def test_a_save_builds_again_once(tmp_path: Path) -> None:
    file = tmp_path / "a.scene"
    file.write_text("1", encoding="utf-8")
    with Follower(lambda: [file]) as follower:
        for text in "2345":  # several writes of one save
            file.write_text(text, encoding="utf-8")
        wait(lambda: follower.count == 2)
        time.sleep(0.6)
        assert follower.count == 2


def test_editors_that_rename_over_the_file(tmp_path: Path) -> None:
    file, new = tmp_path / "a.scene", tmp_path / ".a.scene.new"
    file.write_text("1", encoding="utf-8")
    with Follower(lambda: [file]) as follower:
        new.write_text("2", encoding="utf-8")
        new.replace(file)
        wait(lambda: follower.count == 2)


def test_other_files_do_not_build(tmp_path: Path) -> None:
    file = tmp_path / "a.scene"
    file.write_text("1", encoding="utf-8")
    with Follower(lambda: [file]) as follower:
        (tmp_path / "a.png").write_text("picture", encoding="utf-8")
        time.sleep(0.8)
        assert follower.count == 1


def test_files_that_come_later_are_watched(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    file, part = tmp_path / "a.scene", tmp_path / "parts" / "b.scene"
    file.write_text("alone", encoding="utf-8")
    part.write_text("1", encoding="utf-8")

    def files() -> list[Path]:
        return [file, part] if "part" in file.read_text(encoding="utf-8") else [file]

    with Follower(files) as follower:
        part.write_text("2", encoding="utf-8")
        time.sleep(0.6)
        assert follower.count == 1
        file.write_text("with a part", encoding="utf-8")
        wait(lambda: follower.count == 2)
        time.sleep(0.5)
        part.write_text("3", encoding="utf-8")
        wait(lambda: follower.count == 3)


def test_a_save_during_the_build_is_not_lost(tmp_path: Path) -> None:
    file = tmp_path / "a.scene"
    file.write_text("1", encoding="utf-8")
    seen: list[str] = []

    def slow() -> list[Path]:
        seen.append(file.read_text(encoding="utf-8"))
        if len(seen) == 1:
            time.sleep(0.05)
            file.write_text("2", encoding="utf-8")
            time.sleep(0.05)
        return [file]

    with Follower(slow):
        wait(lambda: seen[-1] == "2")


def test_the_command_follows_a_part_through_an_error(tmp_path: Path) -> None:
    scene, part, picture = tmp_path / "a.scene", tmp_path / "part.scene", tmp_path / "a.png"
    scene.write_text(SCENE, encoding="utf-8")
    part.write_text("sphere(1, material: lambert(#ff0000))\n", encoding="utf-8")
    command = [sys.executable, "-c", "from maquette import cli; cli.main()", "watch", "a.scene", "-o", "a.png"]
    log = (tmp_path / "log").open("w")
    process = subprocess.Popen(
        command, cwd=tmp_path, stdout=log, stderr=subprocess.STDOUT, env={**os.environ, "PYTHONUNBUFFERED": "1"}, preexec_fn=_interruptible
    )

    def colour() -> list[bool]:
        return [c > 0.05 for c in output.read(picture).channels["rgba"][6, 8, :3]]

    def said(text: str) -> bool:
        return text in (tmp_path / "log").read_text(encoding="utf-8")

    try:
        wait(picture.exists, 90)
        assert colour() == [True, False, False]
        time.sleep(1)
        part.write_text("sphere(1, material: lamber(#00ff00))\n", encoding="utf-8")
        wait(lambda: said("part.scene:1:21: error: "))
        assert colour() == [True, False, False]
        time.sleep(0.5)
        part.write_text("sphere(1, material: lambert(#00ff00))\n", encoding="utf-8")
        wait(lambda: colour() == [False, True, False])
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=20) == 0
        assert not said("Traceback")
    finally:
        process.kill()
        log.close()


def test_an_interrupt_that_is_dropped_ends_it_all_the_same(tmp_path: Path) -> None:
    """As one is that comes while a finalizer runs."""
    file = tmp_path / "a.scene"
    file.write_text("sphere(1)", encoding="utf-8")
    builds = []

    def build() -> list[Path]:
        builds.append(1)
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        return [file]

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        watch.follow(build)
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)
    assert builds == [1]
