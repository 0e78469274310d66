"""Ordinary files are read up to a size; devices, pipes, sockets and folders are refused at once."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import pytest
from maquette.compiler.io import regular_files


def reason(path: Path, limit: int = 100) -> str:
    with pytest.raises(OSError) as caught:
        regular_files.read_bytes(path, limit)
    assert caught.value.filename == str(path)
    return str(caught.value.strerror)


def test_a_file_is_read_up_to_the_limit(tmp_path: Path) -> None:
    (path := tmp_path / "a.txt").write_bytes(b"a\r\nb")
    assert regular_files.read_bytes(path, 4) == b"a\r\nb"
    assert regular_files.read_text(path) == "a\nb"
    assert reason(path, 3) == "too big: 4 bytes, and the limit is 3 bytes"
    (tmp_path / "empty").touch()
    assert regular_files.read_bytes(tmp_path / "empty", 0) == b""


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_other_files_are_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "zero").symlink_to("/dev/zero")
    with socket.socket(socket.AF_UNIX) as made:
        made.bind(str(tmp_path / "socket"))
    for name in ("pipe", "zero", "socket"):
        assert reason(tmp_path / name) == "not an ordinary file"
        assert not regular_files.is_regular(tmp_path / name)
    assert reason(tmp_path) == "Is a directory"
    assert reason(tmp_path / "missing") == "No such file or directory"


@pytest.mark.skipif(not Path("/proc/self/smaps").is_file(), reason="this system has no /proc")
def test_a_file_that_does_not_tell_its_size_is_limited_too() -> None:
    assert Path("/proc/self/smaps").stat().st_size == 0
    assert reason(Path("/proc/self/smaps"), 1000).endswith("and the limit is 1000 bytes")
