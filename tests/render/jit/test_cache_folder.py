"""The folder of compiled code: its size is bounded, and only its user can write to it."""

from __future__ import annotations

import os
import re
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


@pytest.mark.long
def test_a_wrong_size_is_an_error_of_the_command(tmp_path: Path) -> None:
    scene = tmp_path / "a.scene"
    scene.write_text("sphere()\n", encoding="utf-8")
    command = [sys.executable, "-m", "maquette", "render", str(scene), "-o", str(tmp_path / "a.png"), "--size", "8x6", "--quiet"]
    environment = {**os.environ, "MAQUETTE_CACHE": str(tmp_path / "cache"), "MAQUETTE_CACHE_SIZE": "much"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    message = "error: MAQUETTE_CACHE_SIZE is much, which is no size: write a number of bytes, or 500MB, or 2GB\n"
    assert (done.returncode, done.stderr) == (1, message)


def test_a_folder_that_was_removed_is_made_again(folder: Path) -> None:
    assert cache_folder.write(folder / "new" / "a", b"code") == ""
    assert cache_folder.read(folder / "new" / "a") == b"code"


@POSIX
def test_why_a_file_is_not_written(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / "file").write_bytes(b"")
    assert cache_folder.write(folder / "file" / "a", b"code") == "a file has its name"
    assert cache_folder.write(folder / "file" / "more" / "a", b"code") == "Not a directory"
    assert cache_folder.write(folder / "a", b"code") == ""

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(cache_folder, "replace_file", full)
        assert cache_folder.write(folder / "b", b"code") == "No space left on device"
    with monkeypatch.context() as patch:
        patch.setattr(os, "geteuid", lambda: folder.stat().st_uid + 1)
        assert cache_folder.write(folder / "b", b"code") == "it belongs to another user"
    folder.chmod(0o770)
    assert cache_folder.write(folder / "b", b"code") == "other users can write to it"
    monkeypatch.setenv("MAQUETTE_CACHE_SIZE", "1KB")
    assert cache_folder.write(folder / "b", bytes(1001)) == "MAQUETTE_CACHE_SIZE is 1KB"


WRITES = """
import pathlib, sys
from maquette.lang.diagnostics import render_text
from maquette.render import picture_notes
from maquette.render.jit import kernel_cache
from maquette.render.jit.kernel_file import Code
from maquette.render.jit.value_types import NONE
for k in range(int(sys.argv[1])):
    kernel_cache.write(f"a{k}.kernel", Code("a", "a", NONE, (), bytes(2000)))
for note in picture_notes.unkept_kernel_notes():
    print(render_text(note, lambda file: None).replace(str(kernel_cache.CACHE), "FOLDER"))
"""


@pytest.mark.long
@pytest.mark.parametrize(
    ("variables", "count", "note"),
    [
        ({"MAQUETTE_CACHE": "cache"}, 2, ""),
        ({"MAQUETTE_CACHE": "file/cache"}, 0, ""),
        (
            {"MAQUETTE_CACHE": "file/cache"}, 1,
            "note: 1 kernel was compiled and cannot be kept for the next run in FOLDER: Not a directory\n"
            "  MAQUETTE_CACHE names another folder\n",
        ),
        (
            {"MAQUETTE_CACHE": "cache", "MAQUETTE_CACHE_SIZE": "1KB"}, 2,
            "note: 2 kernels were compiled and cannot be kept for the next run in FOLDER: MAQUETTE_CACHE_SIZE is 1KB\n"
            "  MAQUETTE_CACHE_SIZE takes more\n",
        ),
    ],
)  # fmt: skip
def test_kernels_that_cannot_be_kept_are_told(tmp_path: Path, variables: dict[str, str], count: int, note: str) -> None:
    (tmp_path / "file").write_bytes(b"")
    command = [sys.executable, "-c", WRITES, str(count)]
    environment = {**os.environ, **variables, "MAQUETTE_CACHE": str(tmp_path / variables["MAQUETTE_CACHE"])}
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert (done.stdout, done.stderr) == (note, "")


@pytest.mark.long
def test_a_render_tells_of_kernels_that_cannot_be_kept(tmp_path: Path) -> None:
    scene = tmp_path / "a.scene"
    scene.write_text("sphere()\nsun()\ncamera([0, 1, 5])\n", encoding="utf-8")
    (tmp_path / "file").write_bytes(b"")
    command = [sys.executable, "-m", "maquette", "render", str(scene), "-o", str(tmp_path / "a.png"), "--size", "8x6", "--samples", "1"]
    environment = {**os.environ, "MAQUETTE_CACHE": str(tmp_path / "file" / "cache"), "MAQUETTE_PROGRESS": "off"}
    done = subprocess.run([*command, "--backend", "reference"], env=environment, capture_output=True, text=True)
    assert done.returncode == 0
    message = rf"compiled and cannot be kept for the next run in {re.escape(str(tmp_path))}/file/cache/kernels/\S+: Not a directory\n"
    assert re.search(rf"^note: (1 kernel was|\d+ kernels were) {message}  MAQUETTE_CACHE names another folder\n", done.stderr, re.MULTILINE)
    assert done.stderr.count("cannot be kept") == 1
