"""Which files a scene may read: below its folder and nowhere else, whatever the name or the links say; and how refusals read."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from maquette.compiler.io import sandbox


@pytest.fixture
def home(tmp_path: Path) -> Path:
    """A scene's folder with a picture and a mesh in it, beside a secret outside."""
    (tmp_path / "secret.txt").write_text("secret")
    folder = tmp_path / "home"
    (folder / "sub").mkdir(parents=True)
    (folder / "oak.png").write_text("x")
    (folder / "sub" / "bunny.obj").write_text("x")
    return folder


def refusal(home: Path, name: str, **more: object) -> tuple[str, str]:
    with pytest.raises(sandbox.FileError) as caught:
        sandbox.Files(home).find(name, **more)  # type: ignore[arg-type]
    return caught.value.message, caught.value.hint


def test_files_below_the_scene_are_found_and_listed(home: Path) -> None:
    found = sandbox.Files(home)
    assert found.find("oak.png") == home / "oak.png"
    assert found.find("bunny.obj", home / "sub") == home / "sub" / "bunny.obj"
    assert found.find("../oak.png", home / "sub") == home / "oak.png"
    assert found.read == (str(home / "oak.png"), str(home / "sub" / "bunny.obj"))


@pytest.mark.parametrize("name", ["../secret.txt", "sub/../../secret.txt", "/etc/hostname", "../home2/x", "link.txt", "linked/secret.txt"])
def test_what_lies_outside_is_refused_whether_it_is_there_or_not(home: Path, name: str) -> None:
    (home / "link.txt").symlink_to("../secret.txt")
    (home / "linked").symlink_to("..")
    message, hint = refusal(home, name)
    how = "is a link that leads outside" if name.startswith("link") else "lies outside"
    assert message == f"`{name}` {how} of the scene's folder"
    assert hint.startswith("use --allow /")


def test_a_folder_whose_name_begins_alike_is_outside(home: Path) -> None:
    (home.parent / "home2").mkdir()
    (home.parent / "home2" / "a.obj").write_text("x")
    assert refusal(home, "../home2/a.obj")[0] == "`../home2/a.obj` lies outside of the scene's folder"


def test_allow_opens_a_folder(home: Path) -> None:
    found = sandbox.Files(home, allow=[home.parent])
    assert found.find("../secret.txt") == home.parent / "secret.txt"
    with pytest.raises(sandbox.FileError):
        found.find("../../x")


def test_the_hint_names_the_folder_to_allow(home: Path) -> None:
    assert refusal(home, "../secret.txt")[1] == f"use --allow {home.parent} to let scenes read it"


def test_a_link_that_stays_inside_is_followed(home: Path) -> None:
    (home / "wood.png").symlink_to("oak.png")
    assert sandbox.Files(home).find("wood.png") == home / "oak.png"


def test_a_scene_reached_by_a_link_reads_beside_its_target(home: Path) -> None:
    (home.parent / "shortcut").symlink_to("home")
    assert sandbox.Files(home.parent / "shortcut").find("oak.png") == home / "oak.png"


def test_a_main_file_reads_the_files_of_its_folder_as_it_is_named(home: Path) -> None:
    """A link at its name leads to another file of the folder, or is refused before the target is opened."""
    (home / "near.scene").symlink_to("sub/bunny.obj")
    files, path = sandbox.open_main(home / "near.scene")
    assert (files.root, path) == (home, home / "sub" / "bunny.obj")
    (home / "far.scene").symlink_to("../secret.txt")
    with pytest.raises(sandbox.FileError) as caught:
        sandbox.open_main(home / "far.scene")
    assert caught.value.message == "`far.scene` is a link that leads outside of the scene's folder"
    assert sandbox.open_main(home / "far.scene", [home.parent])[1] == home.parent / "secret.txt"


def test_refusals(home: Path) -> None:
    (home / "loop").symlink_to("loop")
    assert refusal(home, "oka.png", what="picture") == ("there is no picture `oka.png`", "did you mean `oak.png`?")
    assert refusal(home, "nothing.xyz") == ("there is no file `nothing.xyz`", f"looked in {home}")
    assert refusal(home, "pictures/oak.png") == ("there is no file `pictures/oak.png`", f"there is no folder {home / 'pictures'}")
    assert refusal(home, "sub", what="mesh") == ("`sub` is a folder, not a mesh", "")
    assert refusal(home, "") == ("a file's name cannot be empty", "")
    assert refusal(home, "a\0b") == ("a file's name cannot hold a zero byte", "")
    assert refusal(home, "https://example.org/a.obj") == (
        "`https://example.org/a.obj` is an address: a scene reads files only",
        "save it beside the scene",
    )
    assert refusal(home, "oak.png", limit=0) == ("`oak.png` is too big: 1 byte", "the limit is 0 bytes")
    assert refusal(home, "oak.png/x")[0].startswith("cannot open `oak.png/x`: ")
    assert refusal(home, "x" * 1000)[0].startswith("cannot open `xxx")
    assert refusal(home, "loop")[0].startswith(("`loop` leads round", "cannot open `loop`"))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_a_pipe_is_not_waited_for(home: Path) -> None:
    os.mkfifo(home / "pipe")
    assert refusal(home, "pipe") == ("`pipe` is not an ordinary file", "")


def test_text_must_be_text(home: Path) -> None:
    found = sandbox.Files(home)
    (home / "ok.scene").write_bytes(b"\xef\xbb\xbfsphere(1) // \xc3\xa9")
    assert found.text("ok.scene") == (home / "ok.scene", "sphere(1) // é")
    (home / "lines.scene").write_bytes(b"sphere(1)\r\nbox(1)\rbox(2)\n")
    assert found.text("lines.scene")[1] == "sphere(1)\nbox(1)\nbox(2)\n"
    (home / "latin.scene").write_bytes(b"sphere(1)\n// caf\xe9")
    (home / "binary.scene").write_bytes(b"\x7fELF\0\0")
    expected = {"latin.scene": "`latin.scene` is not UTF-8 text (line 2)", "binary.scene": "`binary.scene` is not a text file"}
    for name, message in expected.items():
        with pytest.raises(sandbox.FileError) as caught:
            found.text(name)
        assert caught.value.message == message
    for encoding in ("utf-16", "utf-16-le", "utf-16-be"):
        (home / "wide.scene").write_bytes("sphere(1)  // é".encode(encoding))
        assert found.text("wide.scene")[1] == "sphere(1)  // é"
        (home / "wide.scene").write_bytes("sphere(1)  // é".encode(encoding)[:-1])
        with pytest.raises(sandbox.FileError) as caught:
            found.text("wide.scene")
        assert (caught.value.message, caught.value.hint) == ("`wide.scene` is damaged text of UTF-16 or UTF-32", "save it as UTF-8")
    (home / "zero.scene").write_bytes(b"sphere(1)  // a zero byte\0")
    assert found.text("zero.scene")[1] == "sphere(1)  // a zero byte\0"


def test_sizes_as_people_read_them() -> None:
    assert [sandbox.size(n) for n in (0, 1, 999, 2048, 5 << 20, 3 << 30)] == ["0 bytes", "1 byte", "999 bytes", "2 kB", "5 MB", "3 GB"]
