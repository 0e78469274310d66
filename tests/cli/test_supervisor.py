"""The process that waits for the command: signals end the command in time, crashes are told, and the status is that of the command."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from maquette.cli.process import supervisor

from ..files import standing_by

pytestmark = pytest.mark.skipif(not hasattr(signal, "sigtimedwait"), reason="this system runs the command without a supervisor")

SCENE = "sphere(1)\ndirectional(from: [1, 1, 1])\ncamera(position: [0, 0, 4])\nrender(size: [64, 48], samples: 2, bounces: 2)\n"
BEGIN = """
import os, signal, sys, time
from maquette.cli import terminal
from maquette.cli.process import supervisor
for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):  # shells ignore SIGINT in background processes, nohup SIGHUP
    signal.signal(number, signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL)
sys.argv = ["maquette", "render", "a.scene", "-o", "my picture.png"]
"""
STUCK = """
with terminal.catch_interrupt() as event:
    print("ready", flush=True)
    sum(range(10**12))  # one operation of hours, which keeps Python's lock
"""
CRASHED = """\
internal error: maquette crashed ({0})
This is a bug in maquette, not an error in the scene. To report it, send
  the scene a.scene, with the files that it reads
  the output of  MAQUETTE_CHECKED=1 maquette render a.scene -o 'my picture.png'
  the output of  maquette doctor
MAQUETTE_CHECKED=1 names the line of a wrong access. It compiles kernels first, which takes minutes.
"""


@pytest.fixture(autouse=True)
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A small scene as a.scene in the current folder."""
    standing_by(tmp_path, monkeypatch, SCENE)


def start(text: str, settings: str = "", **options: bool) -> subprocess.Popen[str]:
    """A process that runs `text` under supervision."""
    code = f"{BEGIN}{settings}\nsupervisor.supervise()\n{text}"
    return subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options)  # type: ignore[call-overload]


def child_of(process: int) -> int:
    return int(Path(f"/proc/{process}/task/{process}/children").read_text(encoding="ascii").split()[0])


def is_alive(process: int) -> bool:
    with contextlib.suppress(OSError):
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    return False


@pytest.mark.parametrize(
    ("number", "told"),
    [
        (signal.SIGSEGV, CRASHED.format("SIGSEGV: an access outside of its memory")),
        (signal.SIGBUS, CRASHED.format("SIGBUS: an access outside of its memory")),
        (signal.SIGABRT, CRASHED.format("SIGABRT: a check that failed")),
        (signal.SIGFPE, CRASHED.format("SIGFPE: an impossible division")),
        (signal.SIGILL, CRASHED.format("SIGILL: an instruction that this processor lacks")),
        (
            signal.SIGKILL,
            "error: the system ended maquette (SIGKILL), as it does when memory is short\n"
            "  a smaller --size, or --memory with less than is free, takes less\n",
        ),
        (signal.SIGTERM, ""),
        (signal.SIGPIPE, ""),
    ],
)
def test_a_crash_is_told(number: int, told: str) -> None:
    """The exit status is that of the signal."""
    process = start(f"signal.signal({number}, signal.SIG_DFL) if {number} != 9 else None; os.kill(os.getpid(), {number})")
    assert process.communicate(timeout=60) == ("", told)
    assert process.returncode == -number


def test_a_crash_without_a_scene() -> None:
    told = supervisor.crash_message(signal.SIGSEGV, ["render", "missing.scene"])
    assert "\n  the scene, with the files that it reads\n" in told


@pytest.mark.parametrize("code", [0, 1, 2, 130])
def test_exit_codes(code: int) -> None:
    process = start(f"print('out'); sys.stdout.flush(); os._exit({code})")
    assert process.communicate(timeout=60) == ("out\n", "")
    assert process.returncode == code


@pytest.mark.long
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_a_signal_ends_a_call_that_hears_nothing(number: int) -> None:
    process = start(STUCK, "supervisor.GRACE = 0.5")
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    child = child_of(process.pid)
    process.send_signal(number)
    assert process.wait(timeout=30) == 130
    assert not is_alive(child)


def test_a_library_that_aborts_at_an_interrupt_is_no_crash() -> None:
    text = "with terminal.catch_interrupt() as event:\n    print('ready', flush=True)\n    event.wait()\nos.abort()"
    process = start(text)
    assert process.stdout is not None
    process.stdout.readline()
    process.send_signal(signal.SIGINT)
    assert process.communicate(timeout=30) == ("", "")
    assert process.returncode == 130


@pytest.mark.long
def test_a_second_signal_ends_it_sooner() -> None:
    process = start(STUCK, "supervisor.GRACE = 60.0; supervisor.AGAIN = 0.2")
    assert process.stdout is not None
    process.stdout.readline()
    process.send_signal(signal.SIGINT)
    time.sleep(2 * supervisor.APART)
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=30) == 130


@pytest.mark.long
def test_what_is_being_written_is_finished() -> None:
    text = "with terminal.catch_interrupt() as event:\n    print('ready', flush=True)\n    event.wait()\n"
    process = start(f"{text}supervisor.finishing()\ntime.sleep(1.5)\nprint('written', flush=True)\nos._exit(130)", "supervisor.GRACE = 0.3")
    assert process.stdout is not None
    process.stdout.readline()
    process.send_signal(signal.SIGTERM)
    assert process.communicate(timeout=30) == ("written\n", "")
    assert process.returncode == 130


@pytest.mark.long
def test_a_signal_to_the_group_counts_once() -> None:
    """As `timeout` sends it: to the process, and to its group."""
    text = (
        "with terminal.catch_interrupt() as event:\n    print('ready', flush=True)\n    event.wait()\n    time.sleep(0.2)\n"
        "print('once', flush=True)\nos._exit(130)"
    )
    process = start(text, start_new_session=True)
    assert process.stdout is not None
    process.stdout.readline()
    process.send_signal(signal.SIGTERM)
    os.killpg(process.pid, signal.SIGTERM)
    assert process.communicate(timeout=30) == ("once\n", "")
    assert process.returncode == 130


def test_the_command_ends_with_its_supervisor() -> None:
    process = start("print('ready', flush=True); time.sleep(60)")
    assert process.stdout is not None
    process.stdout.readline()
    child = child_of(process.pid)
    process.kill()
    process.wait()
    end = time.monotonic() + 10.0
    while is_alive(child) and time.monotonic() < end:
        time.sleep(0.01)
    assert not is_alive(child)


@pytest.mark.long
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
@pytest.mark.parametrize("options", [(), ("--sandbox",)], ids=["open", "sandbox"])
@pytest.mark.parametrize("seconds", [0.05, 0.5, 2.0, 5.0, 15.0])
def test_a_signal_ends_a_render_that_compiles(number: int, options: tuple[str, ...], seconds: float) -> None:
    """With an empty cache, at several moments; nothing is left beside the scene."""
    environment = {**os.environ, "MAQUETTE_CACHE": str(Path("cache").absolute()), "MAQUETTE_KERNELS": "auto"}
    command = [sys.executable, "-m", "maquette", "render", "a.scene", "-o", "a.png", *options]
    process = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True, preexec_fn=_interruptible)
    time.sleep(seconds)
    began = time.monotonic()
    process.send_signal(number)
    process.communicate(timeout=60)
    assert time.monotonic() - began < 5.5
    assert process.returncode in (130, -number)
    assert {path.name for path in Path().iterdir()} - {"cache"} == {"a.scene"}


def _interruptible() -> None:
    signal.signal(signal.SIGINT, signal.SIG_DFL)
