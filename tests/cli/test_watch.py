"""File watching: every way of saving builds again; created and removed files; corrected errors."""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from maquette.cli.main import cli
from maquette.live import watch
from maquette.render.image import image_reader

SCENE = """\
use "part.scene"
part()
point([2, 4, 3], intensity: 20)
camera(position: [0, 0, 5], look_at: [0, 0, 0], fov: 35deg)
render(size: [16, 12], samples: 1, background: #000000)
"""


def _interruptible() -> None:
    """Enable interrupts, which shells ignore in background processes, tests included."""
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


@pytest.mark.long
def test_a_save_builds_again_once(tmp_path: Path) -> None:
    file = tmp_path / "a.scene"
    file.write_text("1", encoding="utf-8")
    with Follower(lambda: [file]) as follower:
        for text in "2345":  # several writes of one save
            file.write_text(text, encoding="utf-8")
        wait(lambda: follower.count == 2)
        time.sleep(0.6)
        assert follower.count == 2


@pytest.mark.long
def test_editors_that_rename_over_the_file(tmp_path: Path) -> None:
    file, new = tmp_path / "a.scene", tmp_path / ".a.scene.new"
    file.write_text("1", encoding="utf-8")
    with Follower(lambda: [file]) as follower:
        new.write_text("2", encoding="utf-8")
        new.replace(file)
        wait(lambda: follower.count == 2)


@pytest.mark.long
def test_other_files_do_not_build(tmp_path: Path) -> None:
    file = tmp_path / "a.scene"
    file.write_text("1", encoding="utf-8")
    with Follower(lambda: [file]) as follower:
        (tmp_path / "a.png").write_text("picture", encoding="utf-8")
        time.sleep(0.8)
        assert follower.count == 1


@pytest.mark.long
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


@pytest.mark.long
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


@pytest.mark.long
def test_a_save_during_a_later_build_builds_once_more(tmp_path: Path) -> None:
    file = tmp_path / "a.scene"
    file.write_text("1", encoding="utf-8")
    seen: list[str] = []

    def slow() -> list[Path]:
        seen.append(file.read_text(encoding="utf-8"))
        if seen[-1] == "2":
            time.sleep(0.05)
            file.write_text("3", encoding="utf-8")
            time.sleep(0.05)
        return [file]

    with Follower(slow):
        file.write_text("2", encoding="utf-8")
        wait(lambda: seen[-1] == "3")
        time.sleep(0.8)
    assert seen == ["1", "2", "3"]


@pytest.mark.long
def test_an_unchanged_save_and_a_removed_file(tmp_path: Path) -> None:
    """A file renamed over another can have its time and size. Removal and creation are changes."""
    file, new = tmp_path / "a.scene", tmp_path / "b"
    for path, text in ((file, "1"), (new, "2")):
        path.write_text(text, encoding="utf-8")
        os.utime(path, ns=(0, 10**18))
    with Follower(lambda: [file]) as follower:
        new.replace(file)
        wait(lambda: follower.count == 2)
        file.unlink()
        wait(lambda: follower.count == 3)
        time.sleep(0.3)
        file.write_text("3", encoding="utf-8")
        wait(lambda: follower.count == 4)
        time.sleep(0.6)
        assert follower.count == 4


@pytest.mark.long
def test_files_are_polled_without_events(tmp_path: Path) -> None:
    """A folder created later is not watched, and network disks send no events."""
    file, part = tmp_path / "a.scene", tmp_path / "later" / "b.scene"
    file.write_text("1", encoding="utf-8")
    with Follower(lambda: [file, part]) as follower:
        part.parent.mkdir()
        part.write_text("1", encoding="utf-8")
        wait(lambda: follower.count == 2)
        part.write_text("22", encoding="utf-8")
        wait(lambda: follower.count == 3)


@pytest.mark.long
def test_the_command_follows_a_part_through_an_error(tmp_path: Path) -> None:
    scene, part, picture = tmp_path / "a.scene", tmp_path / "part.scene", tmp_path / "a.png"
    scene.write_text(SCENE, encoding="utf-8")
    part.write_text("sphere(1, material: lambert(#ff0000))\n", encoding="utf-8")

    def colour() -> list[bool]:
        return [c > 0.05 for c in image_reader.read(picture).channels["rgba"][6, 8, :3]]

    def said(text: str) -> bool:
        return text in (tmp_path / "log").read_text(encoding="utf-8")

    with command(tmp_path) as process:
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


EDITS = [f"x^2 + y^2 + z^2 < {0.3 + 0.05 * k:.2f}" for k in range(10)] + [
    "abs(abs(x^2 + y^2 + z^2 - 0.7) - 0.1) < 0.01", "max(abs(x), abs(y), abs(z)) < 0.6", "1 / x < y", "floor(3 * x) / 3 < y",
    "sqrt(x - 0.2) > y", "x^4 + y^4 + z^4 < 0.4", "min(x^2 + y^2, y^2 + z^2) < 0.1", "sin(9 * x) * sin(9 * y) < z", "y < 0.2",
    "x * y * z < 0.01",
]  # fmt: skip


@pytest.mark.long
def test_stats_hold_the_cost_of_each_redraw(tmp_path: Path) -> None:
    scene, stats, picture = tmp_path / "a.scene", tmp_path / "cost.json", tmp_path / "a.png"

    def save(formula: str) -> None:
        surface = f"implicit(|x, y, z| {formula}, within: box(2), material: lambert(#ff0000))"
        scene.write_text(SCENE.replace('use "part.scene"\npart()', surface), encoding="utf-8")

    def told() -> dict[str, Any]:  # never half a file
        return json.loads(stats.read_text(encoding="utf-8")) if stats.exists() else {"redraw": {"number": 0}}

    save(EDITS[0])
    with command(tmp_path, "--stats", "cost.json", "--backend", "ray"):
        wait(lambda: told()["redraw"]["number"] == 1, 300)
        time.sleep(1)
        for number, formula in enumerate(EDITS[1:], 2):
            if number == 8:
                before = stats.read_bytes(), picture.read_bytes()
                save("x^2 + y^2 + z^2 <")
                wait(lambda: "a.scene:1:" in (tmp_path / "log").read_text(encoding="utf-8"))
                time.sleep(0.3)
                assert (stats.read_bytes(), picture.read_bytes()) == before
            save(formula)
            wait(lambda number=number: told()["redraw"]["number"] == number, 120)
        figures = told()
    assert list(figures)[:6] == ["scene", "backend", "size", "samples", "samples_mean", "seconds"]
    assert figures["warnings"] == []
    assert figures["redraw"] == figures["redraws"][-1]
    assert [row["number"] for row in figures["redraws"]] == list(range(1, 21))
    for row in figures["redraws"]:
        assert list(row) == ["number", "total", "seconds", "cpu_total", "cpu_seconds"]
        assert list(row["seconds"]) == ["wait", "read", "draw", "write"]
        assert list(row["cpu_seconds"]) == ["idle", "read", "draw", "write"]
        assert row["total"] == pytest.approx(sum(row["seconds"].values()))
        assert row["cpu_total"] > 0
        assert min(row["seconds"].values()) >= 0
        assert (row["number"] == 1 or 0 < row["seconds"]["wait"] < 10)
    lines = (tmp_path / "log").read_text(encoding="utf-8").splitlines()
    assert sum(line.endswith(" s after the save") for line in lines) == 19
    assert not any("Traceback" in line for line in lines)


@pytest.mark.long
def test_the_window_serves_and_writes_the_saved_scene(tmp_path: Path) -> None:
    scene, picture = tmp_path / "a.scene", tmp_path / "a.png"
    text = SCENE.replace('use "part.scene"\npart()', "sphere(1)").replace("samples: 1", 'samples: 1, backend: "reference"')
    scene.write_text(text, encoding="utf-8")

    def log() -> str:
        return (tmp_path / "log").read_text(encoding="utf-8")

    with command(tmp_path, "--window", "--no-browser", "--exposure", "1", "--stats", "a.json") as process:
        wait(picture.exists)
        address = re.search(r"a\.scene: (http://127\.0\.0\.1:\d+/[\w-]+/) \(Ctrl-C ends\)\n", log())
        assert address, log()
        with urllib.request.urlopen(address[1]) as answer:
            assert b"<title>maquette</title>" in answer.read()
        before = picture.read_bytes()
        time.sleep(0.5)
        scene.write_text(text.replace("sphere(1)", "sphere(0.5)"), encoding="utf-8")
        wait(lambda: picture.read_bytes() != before)
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=20) == 0
    figures = json.loads((tmp_path / "a.json").read_text(encoding="utf-8"))
    assert [edit["number"] for edit in figures["edits"]] == list(range(1, len(figures["edits"]) + 1))
    assert figures["total"]["scenes evaluated"] == sum(edit["work"]["scenes evaluated"] for edit in figures["edits"]) == 2
    assert "Traceback" not in log()
    assert log().count("a.png: 16x12, reference, 1 samples a pixel\n") == 2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--no-window",), "--no-window needs a picture file: -o FILE"),
        (("--stats", "a.scene"), "--stats a.scene would replace a.scene: choose another file, such as a.json"),
        (("-o", "a.png", "--port", "8000"), "--port is for the window: leave it out, or add --window"),
        (("-o", "a.gif"), "cannot tell the picture format of a.gif: its name must end in one of .exr, .png, .tif, .tiff, .jpg, .jpeg"),
    ],
)
def test_options_that_exclude_each_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], message: str
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    Path("a.scene").write_text("sphere(1)\n", encoding="utf-8")
    done = CliRunner().invoke(cli, ["watch", "a.scene", *arguments])
    assert (done.exit_code, done.output.splitlines()[-1]) == (2, f"Error: {message}")


@contextlib.contextmanager
def command(folder: Path, *more: str) -> Iterator[subprocess.Popen[bytes]]:
    """`maquette watch a.scene -o a.png` in a folder, with its output in `log`."""
    line = [sys.executable, "-c", "from maquette.cli.main import main; main()", "watch", "a.scene", "-o", "a.png", *more]
    with (folder / "log").open("w") as log:
        environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
        process = subprocess.Popen(line, cwd=folder, stdout=log, stderr=subprocess.STDOUT, env=environment, preexec_fn=_interruptible)
        try:
            yield process
        finally:
            process.kill()
            process.wait()


def test_a_dropped_interrupt_ends_the_watch(tmp_path: Path) -> None:
    """An interrupt during a finalizer is dropped."""
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
