"""A file is replaced as a whole: its permissions and links stay, and an error leaves the old one."""

from __future__ import annotations

import errno
import os
import socket
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest
from maquette.compiler.io.replace_file import Replacement, as_utf8, make_folder, replace_file, replacing

LINK = "{} is a link, and nothing is written through links: remove it, or choose another name"
NOT_UTF8 = os.fsdecode(b"a\xff")


def test_the_new_file_has_the_permissions_of_the_old_one(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text("old")
    path.chmod(0o600)
    replace_file(path, b"new")
    assert path.read_bytes() == b"new"
    assert path.stat().st_mode & 0o777 == 0o600
    assert list(tmp_path.iterdir()) == [path]


def test_nothing_is_written_through_a_link(tmp_path: Path) -> None:
    """One that is there is refused; one that comes there while the file is written is replaced itself."""
    target, link = tmp_path / "secret.json", tmp_path / "a.json"
    target.write_text("old")
    link.symlink_to(target)
    with pytest.raises(OSError) as caught:
        replace_file(link, b"new")
    assert str(caught.value) == f"{link} is a link, and nothing is written through links: remove it, or choose another name"
    link.unlink()
    with replacing(link) as partial:
        partial.write_bytes(b"new")
        link.symlink_to(target)
    assert (target.read_text(), link.is_symlink(), link.read_bytes()) == ("old", False, b"new")


def test_a_link_that_comes_and_goes_leads_nowhere(tmp_path: Path) -> None:
    """Another process plants it again and again while files are replaced."""
    secret, path, stop = tmp_path / "secret", tmp_path / "a.png", threading.Event()
    secret.write_text("secret")

    def plant() -> None:
        while not stop.is_set():
            with suppress(OSError):
                os.symlink(secret, tmp_path / "b")
                os.replace(tmp_path / "b", path)

    thread = threading.Thread(target=plant)
    thread.start()
    for _ in range(200):
        with suppress(OSError):
            replace_file(path, b"new")
    stop.set()
    thread.join()
    assert secret.read_text() == "secret"
    assert sorted(each.name for each in tmp_path.iterdir() if each.name != "b") == ["a.png", "secret"]


def test_folders_are_made_and_links_among_them_refused(tmp_path: Path) -> None:
    make_folder(tmp_path / "a" / "b", tmp_path)
    assert (tmp_path / "a" / "b").is_dir()
    (tmp_path / "a" / "link").symlink_to(tmp_path)
    for folder, base in ((tmp_path / "a" / "link" / "c", tmp_path), (tmp_path / "a" / "link", None)):
        with pytest.raises(OSError) as caught:
            make_folder(folder, base)
        assert str(caught.value).startswith(f"{tmp_path}/a/link is a link, and nothing is written through links")
    make_folder(tmp_path / "a" / "link" / "c", tmp_path / "a" / "link")
    assert (tmp_path / "c").is_dir()


@pytest.mark.parametrize("name", ["b", NOT_UTF8])
def test_names_need_not_be_utf8(tmp_path: Path, name: str) -> None:
    folder = tmp_path / name
    folder.mkdir()
    new = Replacement(folder / f"{name}.txt")
    str(new.partial).encode()
    new.partial.write_bytes(b"new")
    new.place(folder / f"{name}.txt")
    assert (folder / f"{name}.txt").read_bytes() == b"new"


def test_what_is_not_good_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text("old")
    new = Replacement(path)
    new.partial.write_bytes(b"ne")
    new.place(path, good=False)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_bytes_that_are_not_utf8_are_written_out() -> None:
    assert as_utf8(f"{NOT_UTF8} é") == "a\\xff é"


def test_files_of_killed_processes_are_removed(tmp_path: Path) -> None:
    """Those of a process of this host that has ended, a minute after their last change; others stay."""
    program = f"""
from pathlib import Path
from maquette.compiler.io.replace_file import Replacement
print(Replacement(Path({str(tmp_path / "a.png")!r})).partial)
"""
    left = Path(subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.strip())
    host, process = left.name.split("-")[1:3]
    fresh, mine, foreign, other = (
        tmp_path / name
        for name in (
            f".maquette-{host}-{process}-1.png",
            f".maquette-{host}-{os.getpid()}-2.png",
            f".maquette-0-{process}-3.png",
            ".hidden",
        )
    )
    for path in (left, fresh, mine, foreign, other):
        path.write_bytes(b"half")
        if path != fresh:
            os.utime(path, (0, 0))
    replace_file(tmp_path / "b.png", b"whole")
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([fresh.name, mine.name, foreign.name, other.name, "b.png"])


def _pipe(path: Path) -> None:
    os.mkfifo(path)


def _socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as made:
        made.bind(str(path))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (Path.mkdir, "{} is a folder"),
        (_pipe, "{} is a device, a pipe or a socket: choose the name of a file"),
        (_socket, "{} is a device, a pipe or a socket: choose the name of a file"),
        (lambda path: path.symlink_to(os.devnull), LINK),
        (lambda path: path.symlink_to(path), LINK),
        (lambda path: path.symlink_to(path.parent / "no" / "b.json"), LINK),
    ],
)
def test_what_is_no_file_is_not_replaced(tmp_path: Path, make: Callable[[Path], None], message: str) -> None:
    path = tmp_path / "a.json"
    make(path)
    kind = path.lstat().st_mode
    with pytest.raises(OSError) as caught:
        replace_file(path, b"new")
    assert str(caught.value) == message.format(path)
    assert path.lstat().st_mode == kind
    assert list(tmp_path.iterdir()) == [path]


def test_the_new_file_is_there_and_has_the_extension(tmp_path: Path) -> None:
    """Writers choose a format by it. Nobody can plant a link at a name that is taken."""
    new = Replacement(tmp_path / "a.png")
    assert (new.partial.suffix, new.partial.read_bytes(), new.partial.is_symlink()) == (".png", b"", False)


def test_an_error_of_the_disk_names_the_file(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    with pytest.raises(OSError) as caught, replacing(path):
        raise OSError(errno.ENOSPC, "No space left on device")
    assert (caught.value.filename, caught.value.errno) == (str(path), errno.ENOSPC)
    with pytest.raises(FileNotFoundError) as caught:
        replace_file(tmp_path / "no" / "a.json", b"new")
    assert caught.value.filename == str(tmp_path / "no" / "a.json")
