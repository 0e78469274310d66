"""The progress that commands show on stderr: stages, figures, the time left and its spread."""

from __future__ import annotations

import os
import pty
import re
import select
import subprocess
import sys
import time
from pathlib import Path

import pytest
from maquette.cli import progress as shown
from maquette.cli.progress import Display, TimeLeft, time_range
from maquette.render.film.progress import Progress
from maquette.render.jit import compile_events

from ..files import standing_by

SCENE = "sphere(1)\npoint([2, 4, 3], intensity: 20)\ncamera(position: [0, 1, 5], look_at: [0, 0, 0])\nrender(size: [32, 24], samples: 1)\n"


class Clock:
    """A clock that a test moves."""

    def __init__(self) -> None:
        self.now = 100.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    made = Clock()
    monkeypatch.setattr(shown, "time", made)
    return made


def test_a_steady_pace_has_no_spread() -> None:
    left = TimeLeft()
    for second in range(1, 11):
        left.add(second, second / 40)
    assert left.between(10) == (pytest.approx(30), pytest.approx(30))


def test_a_slower_pace_widens_the_spread() -> None:
    """Half the work in 10 s, then a fifth of that pace: the end lies between the mean pace so far and the present one."""
    left = TimeLeft()
    for second in range(1, 11):
        left.add(second, second / 20)
    for second in range(11, 21):
        left.add(second, 0.5 + (second - 10) / 100)
    least, most = left.between(20) or (0, 0)
    assert least < 20 * 0.4 / 0.6 < 40 == pytest.approx(most, rel=0.1)


def test_nothing_is_told_of_an_unknown_end() -> None:
    left = TimeLeft()
    left.add(5.0, 0.0)
    assert left.between(5.0) is None
    left.add(shown.SETTLED / 2, 0.5)
    assert left.between(shown.SETTLED / 2) is None


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        ((0.2, 0.7), "1 s"), ((7.9, 8.0), "8 s"), ((8.0, 11.2), "8 to 12 s"), ((50, 70), "0:50 to 1:10 min"), ((130, 130), "2:10 min"),
        ((3500, 7300), "0:58 to 2:02 h"),
    ],
)  # fmt: skip
def test_times_are_rounded(seconds: tuple[float, float], text: str) -> None:
    assert time_range(*seconds) == text


def test_the_line_names_stage_samples_error_and_time(clock: Clock) -> None:
    display = Display(quiet=True, what="frame 3 (2 of 5)")
    assert display.text() == "frame 3 (2 of 5): starting"
    display = Display(quiet=True)
    display.stage("reading")
    assert display.text() == "reading"
    display(Progress("rendering"))
    assert display.text() == "rendering"
    for _ in range(10):
        clock.now += 1.0
        display(Progress("rendering", (clock.now - 100.0) / 40.0, 1.6 * (clock.now - 100.0), 64, 0.034))
    assert display.text() == "rendering, 25 %, 16 of 64 samples, noise 3.40% in the tiles drawn, 30 s left"
    clock.now += 5.0
    assert display.text().endswith("25 s left")
    display(Progress("rendering", 1.0, 64.0, 64, 0.017))
    assert display.text() == "rendering, 64 of 64 samples, noise 1.70%"  # never 100 %
    display(Progress("finishing"))
    assert display.text() == "finishing"


def test_an_error_asked_for_has_no_number_of_samples(clock: Clock) -> None:
    display = Display(quiet=True)
    display(Progress("rendering", 0.0, 4.5))
    assert display.text() == "rendering, 4.5 samples"
    display(Progress("rendering", 0.5, 24.0, 0, 0.02))
    assert display.text() == "rendering, 50 %, 24 samples, noise 2.00%"


def test_the_default_tells_how_long_it_takes_at_most(clock: Clock) -> None:
    """By the pace so far, as the error may end the rendering before the limit of samples."""
    display = Display(quiet=True)
    display(Progress("rendering", 0.0, 4.0, limit=256))
    assert display.text() == "rendering, 4.0 of at most 256 samples"
    clock.now += 4.0
    display(Progress("rendering", 0.3, 32.0, 0, 0.05, limit=256))
    assert display.text() == "rendering, 30 %, 32 of at most 256 samples, noise 5.00%, at most 28 s left"


def test_compiling_is_shown_and_takes_none_of_the_stages_time(clock: Clock) -> None:
    with Display(quiet=True) as display:
        display(Progress("rendering"))
        clock.now += 2.0
        display(Progress("rendering", 0.1))
        compile_events.expect(7)
        compile_events.ready()
        with compile_events.compiling("light"):
            assert display.text() == "compiling kernel 2 of about 7"
            with compile_events.compiling("dark"):
                assert display.text() == "compiling kernel 2 of about 7"
                compile_events.ready()
            clock.now += 60.0
        compile_events.ready()
        assert display.text() == "rendering, 10 %, 18 s left"
        compile_events.expect(0)
        with compile_events.compiling("late"):
            assert display.text() == "compiling kernel 1 of about 1"
    assert compile_events.LISTENERS == []


@pytest.mark.long
def test_quick_work_shows_nothing_and_slow_work_a_line_at_times(capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MAQUETTE_PROGRESS")
    with Display(quiet=False) as display:
        display.stage("reading")
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(shown, "EVERY", 0.05)
    with Display(quiet=False) as display:
        for stage in ("reading", "building"):
            display.stage(stage)
            time.sleep(0.3)
    assert capsys.readouterr().err.splitlines() == ["reading", "building"]  # a line that has not changed is not repeated
    with Display(quiet=False) as display:
        display.compiling(compile_events.Compiling("a", 1, 10))
        time.sleep(0.3)
    first, *rest = capsys.readouterr().err.splitlines()
    assert first == "compiling kernel 1 of about 10"
    assert rest
    assert set(rest) == {"compiling kernel 1 of about 10, 0 s so far"}  # a kernel may take minutes
    with Display(quiet=True) as display:
        time.sleep(0.2)
    assert capsys.readouterr().err == ""


@pytest.mark.long
def test_a_terminal_has_one_line_that_is_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    standing_by(tmp_path, monkeypatch, SCENE)
    code = "from maquette.cli import progress; progress.FIRST = progress.TICK = 0.01; from maquette.cli.main import main; main()"
    ours, theirs = pty.openpty()
    command = [sys.executable, "-c", code, "render", "a.scene", "-o", "a.exr"]
    environment = {**os.environ, "TERM": "xterm"}
    environment.pop("NO_COLOR", None)
    del environment["MAQUETTE_PROGRESS"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=theirs, env=environment)
    os.close(theirs)
    seen = b""
    while select.select([ours], [], [], 120)[0]:
        try:
            seen += os.read(ours, 4096)
        except OSError:  # the other end is closed
            break
    assert process.wait(60) == 0
    lines = [line for line in re.split(r"\r\x1b\[K", seen.decode()) if line]
    names = [line.split(",")[0].split(" kernel")[0] for line in lines]
    assert "reading" in names
    assert set(names) <= {"starting", "reading", "building", "compiling", "rendering", "finishing", "writing"}
    assert "100 %" not in seen.decode()
    assert seen.endswith(b"\r\x1b[K")
    assert b"\n" not in seen
