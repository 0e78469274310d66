"""A confined process opens the files it may, no others, no network, and takes no more memory than allowed."""

from __future__ import annotations

import subprocess
import sys
import textwrap
from pathlib import Path

import pytest
from maquette.compiler.io import landlock

pytestmark = pytest.mark.skipif(not landlock.version(), reason="this system has no Landlock")


@pytest.fixture
def folders(tmp_path: Path) -> Path:
    for name in ("read", "write", "other"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "a.txt").write_text(name, encoding="utf-8")
    return tmp_path


def confined(folder: Path, program: str, memory: str = "None") -> str:
    """What a confined process prints; the name of the exception where one is raised."""
    body = textwrap.indent(textwrap.dedent(program), "    ")
    text = f"""
import os, socket, tempfile
from pathlib import Path
from maquette.compiler.io import confinement
folder = Path({str(folder)!r})
confinement.confine([folder / "read"], [folder / "write"], {memory})
try:
{body}
except BaseException as error:
    print(type(error).__name__)
"""
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.mark.parametrize(
    ("program", "result"),
    [
        ("print((folder / 'read' / 'a.txt').read_text())", "read"),
        ("print(os.listdir(folder / 'read'))", "['a.txt']"),
        ("(folder / 'read' / 'a.txt').write_text('new')", "PermissionError"),
        ("(folder / 'write' / 'b.txt').write_text('new'); print((folder / 'write' / 'b.txt').read_text())", "new"),
        ("os.replace(folder / 'write' / 'a.txt', folder / 'write' / 'c.txt'); print('done')", "done"),
        ("print((folder / 'other' / 'a.txt').read_text())", "PermissionError"),
        ("print(os.listdir(folder / 'other'))", "PermissionError"),
        ("(folder / 'other' / 'b.txt').write_text('new')", "PermissionError"),
        ("os.symlink(folder / 'other' / 'a.txt', folder / 'write' / 'link')", "PermissionError"),
        ("print(Path(tempfile.gettempdir()).name)", "write"),
        ("socket.create_connection(('127.0.0.1', 9), 1)", "PermissionError"),
        ("import numpy; print(numpy.ones(3).sum())", "3.0"),
    ],
)
def test_what_a_confined_process_may(folders: Path, program: str, result: str) -> None:
    if "socket" in program and landlock.version() < 4:
        pytest.skip("this Landlock does not confine TCP")
    assert confined(folders, program) == result


def test_memory_is_limited(folders: Path) -> None:
    assert confined(folders, "bytes(2 << 30)", memory="100_000_000") == "MemoryError"


def test_threads_and_processes_are_confined_as_well(folders: Path) -> None:
    program = "import subprocess; print(subprocess.run(['cat', str(folder / 'other' / 'a.txt')], capture_output=True).returncode)"
    assert confined(folders, program) == "1"
