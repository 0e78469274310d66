"""The `maquette` process: limits of the shell, closed and full streams, Ctrl-C while it is loaded."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

import pytest
from click.testing import CliRunner
from maquette.cli import main, memory

from ..files import standing_by

SCENE = """\
sphere(1, material: lambert(#d0402a))
point([2, 4, 3], intensity: 20)
camera(position: [0, 1.6, 5], look_at: [0, 0, 0], fov: 35deg)
render(size: [8, 6], samples: 1, backend: "reference")
"""
MAQUETTE = f"{sys.executable} -m maquette"
INTERRUPTED = """
import os, signal, sys
from maquette.__main__ import start

signal.signal(signal.SIGINT, signal.default_int_handler)  # background processes of a shell ignore it

class Finder:
    def find_spec(self, name, *_):
        if name == "maquette.cli.main":
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Finder())
start()
"""


@pytest.fixture(autouse=True)
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A small scene as a.scene in the current folder."""
    standing_by(tmp_path, monkeypatch, SCENE)


def shell(command: str) -> tuple[int, str, str]:
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True)
    return done.returncode, done.stdout, done.stderr


@pytest.mark.parametrize(
    ("limit", "why"),
    [
        ("-s 200", "stack to 200 kB, and 1024 are needed: ulimit -s 8192"),
        ("-d 100000", "data to 100000 kB, and 300000 are needed: ulimit -d unlimited"),
    ],
)
def test_limits_under_which_libraries_end_the_process(limit: str, why: str) -> None:
    assert shell(f"ulimit {limit}; exec {MAQUETTE} check a.scene") == (1, "", f"error: this shell limits the {why}\n")


def test_a_limit_of_threads_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """As `ulimit -u` gives it to others than root."""
    begin, begun = threading.Thread.start, []

    def start(thread: threading.Thread) -> None:
        if len(begun) == 2:
            raise RuntimeError("can't start new thread")
        begun.append(thread)
        begin(thread)

    monkeypatch.setattr(threading.Thread, "start", start)
    why = memory.refused_limits()
    assert why.startswith("the system allows 2 more threads, and ")
    assert why.endswith(" are needed: end other processes, or raise ulimit -u")
    monkeypatch.undo()
    assert memory.refused_limits() == ""


@pytest.mark.long
def test_a_limit_of_file_sizes_is_told() -> None:
    code, out, told = shell(f"ulimit -f 1; exec {MAQUETTE} render a.scene -q -o a.exr --size 64")
    assert (code, out) == (1, "")
    why = "the shell limits files to 1 kB: raise it by ulimit -f"
    lost = rf"; its pixels are lost: cannot write {tempfile.gettempdir()}/a\.\w+\.rescued\.exr: "
    assert re.fullmatch(f"error: cannot write a.exr: {why}{lost}{why}\n", told)
    assert not [*Path().glob("*.rescued.exr")]
    assert not Path("a.exr").exists()


@pytest.mark.long
def test_closed_streams() -> None:
    """No file takes their numbers."""
    assert shell(f"{MAQUETTE} render a.scene -o a.png <&- >&- 2>&-; echo $?") == (0, "0\n", "")
    assert Path("a.png").is_file()


@pytest.mark.long
def test_a_reader_that_ends_is_no_error() -> None:
    assert shell(f"{{ {MAQUETTE} inspect a.scene --ir; echo ${{PIPESTATUS[0]}} >&2; }} | true") == (0, "", "1\n")


@pytest.mark.long
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="Linux has it")
def test_a_full_disk_behind_stdout() -> None:
    assert shell(f"{MAQUETTE} inspect a.scene > /dev/full") == (1, "", "error: cannot print: No space left on device\n")


@pytest.mark.long
def test_stdin_that_does_not_end() -> None:
    why = "stdin: error: stdin is too big\n  the limit is 16 MB\n"
    assert shell(f"yes 'let a = 1' | {MAQUETTE} format -") == (1, "", why)


def test_too_few_files_may_be_open(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object) -> None:
        raise OSError(24, "Too many open files", "a.scene")

    monkeypatch.setattr("maquette.cli.common_options.load", refused)
    done = CliRunner().invoke(main.cli, ["inspect", "a.scene"])
    assert (done.exit_code, done.stderr) == (
        1, "error: Too many open files: raise the limit of this shell, such as by ulimit -n 1024\n"
    )  # fmt: skip


def test_ctrl_c_while_modules_load_prints_no_traceback() -> None:
    done = subprocess.run([sys.executable, "-c", INTERRUPTED], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (-signal.SIGINT, "", "")
