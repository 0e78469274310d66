"""The folder of compiled code: its size is bounded, and only its user can write to it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from maquette.compiler.io.environment import SettingError
from maquette.render.jit import cache_folder

POSIX = pytest.mark.skipif(os.name == "nt", reason="modes of folders")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder in a cache of its own."""
    monkeypatch.setenv("MAQUETTE_CACHE", str(tmp_path / "cache"))
    return cache_folder.prepare("here")


@POSIX
def test_the_folder_is_the_users_alone(folder: Path) -> None:
    assert [each.stat().st_mode & 0o777 for each in (folder, folder.parent)] == [0o700, 0o700]


@POSIX
def test_what_others_can_write_is_not_read(folder: Path) -> None:
    cache_folder.write(folder / "a", b"code")
    assert cache_folder.read(folder / "a") == b"code"
    for mode in (0o770, 0o702):
        folder.chmod(mode)
        assert cache_folder.read(folder / "a") is None
        cache_folder.write(folder / "b", b"code")
        assert not (folder / "b").exists()
    assert cache_folder.prepare("here") == folder
    assert folder.stat().st_mode & 0o777 == 0o700
    assert cache_folder.read(folder / "a") is None  # it may have been another's


@POSIX
def test_the_folder_of_another_user_is_not_read(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cache_folder.write(folder / "a", b"code")
    monkeypatch.setattr(os, "geteuid", lambda: folder.stat().st_uid + 1)
    assert cache_folder.read(folder / "a") is None
    assert cache_folder.prepare("here") == folder
    assert (folder / "a").exists()


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_the_files_unused_for_longest_go_first(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MAQUETTE_CACHE_SIZE", "3000")
    other = cache_folder.prepare("there")
    for k, path in enumerate((folder / "a", other / "b", folder / "c")):
        cache_folder.write(path, bytes(1000))
        os.utime(path, (1e9 + 1e6 * k, 1e9 + 1e6 * k))
    assert cache_folder.read(folder / "a") == bytes(1000)  # is used now
    cache_folder.write(folder / "d", bytes(500))
    assert (names(folder), names(other)) == (["a", "c", "d"], [])
    cache_folder.write(folder / "e", bytes(2000))
    assert names(folder) == ["d", "e"]
    cache_folder.write(folder / "f", bytes(3001))
    assert "f" not in names(folder)


@pytest.mark.parametrize(
    ("text", "size"), [("", 10**9), ("5000", 5000), ("500MB", 5 * 10**8), ("1.5 gb", 15 * 10**8), ("2KB", 2000), ("1TB", 10**12)]
)
def test_sizes(monkeypatch: pytest.MonkeyPatch, text: str, size: int) -> None:
    monkeypatch.setenv("MAQUETTE_CACHE_SIZE", text)
    assert cache_folder.largest_size() == size


@pytest.mark.parametrize("text", ["much", "-1", "1 PB", "5B", "GB"])
def test_what_is_no_size(monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    monkeypatch.setenv("MAQUETTE_CACHE_SIZE", text)
    with pytest.raises(SettingError) as caught:
        cache_folder.largest_size()
    assert str(caught.value) == f"MAQUETTE_CACHE_SIZE is {text}, which is no size: write a number of bytes, or 500MB, or 2GB"


def test_a_wrong_size_is_an_error_of_the_command(tmp_path: Path) -> None:
    scene = tmp_path / "a.scene"
    scene.write_text("sphere()\n", encoding="utf-8")
    command = [sys.executable, "-m", "maquette", "render", str(scene), "-o", str(tmp_path / "a.png"), "--size", "8x6", "--quiet"]
    environment = {**os.environ, "MAQUETTE_CACHE": str(tmp_path / "cache"), "MAQUETTE_CACHE_SIZE": "much"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    message = "error: MAQUETTE_CACHE_SIZE is much, which is no size: write a number of bytes, or 500MB, or 2GB\n"
    assert (done.returncode, done.stderr) == (1, message)


def test_a_read_only_folder_costs_the_cache_alone(folder: Path) -> None:
    cache_folder.write(folder / "nothing" / "a", b"code")
    assert cache_folder.read(folder / "nothing" / "a") is None
