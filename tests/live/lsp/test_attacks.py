"""The language server against hostile editors and files: each request has an answer, soon."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from .editor import Editor

SOON = 30.0  # seconds for an answer on a busy machine; without limits the answers take minutes


@pytest.fixture
def editor(tmp_path: Path) -> Iterator[Editor]:
    editor = Editor(tmp_path.resolve())
    yield editor
    assert editor.end() == 0


def hover(editor: Editor, name: str, line: int, character: int) -> Any:
    """The answer to a hover, which comes soon."""
    started = time.monotonic()
    position = {"line": line, "character": character}
    answer = editor.ask("textDocument/hover", {"textDocument": {"uri": editor.uri(name)}, "position": position})
    assert time.monotonic() - started < SOON
    return answer


@pytest.mark.parametrize("header", [b"Content-Length: abc", b"Content-Length: -5", b"Content-Length: " + b"9" * 5000, b"Length 7"])
def test_the_message_after_a_wrong_header_is_read(editor: Editor, header: bytes) -> None:
    assert editor.process.stdin is not None
    editor.process.stdin.write(header + b'\r\n\r\n{"jsonrpc": "2.0", "method": "nothing"}')
    editor.open("a.scene", "sphere(1)\n")
    assert "sphere" in hover(editor, "a.scene", 0, 2)["contents"]["value"]


@pytest.mark.long
def test_many_unknown_names_delay_no_answer(editor: Editor) -> None:
    text = "".join(f"sphere(name{i})\n" for i in range(100_000))
    editor.open("a.scene", f"box()\n{text}")
    assert "box" in hover(editor, "a.scene", 0, 1)["contents"]["value"]
    note, *messages = editor.checked("a.scene")
    assert "100,000 characters" in note["message"]
    assert len(messages) == 200


@pytest.mark.long
def test_the_last_of_500_edits_is_checked(editor: Editor) -> None:
    for k in range(500):
        editor.open("a.scene", f"sphere({k}, raduis: 1)\n" if k < 499 else "sphere(499)\nsphre(1)\n")
    assert [d["message"] for d in editor.checked("a.scene")] == ["there is no `sphre` here; did you mean `sphere`?"]


@pytest.mark.long
@pytest.mark.parametrize(
    "text",
    ["let a = " + "[" * 100_000 + "]" * 100_000, "let a = " + "(" * 100_000, "let " + "a" * 5_000_000 + " = 1\n",
     "let a = " + "b" * 3_000_000 + "\n", "a" * 90_000 + "()\n"],
    ids=["nested", "open", "long name", "long unknown name", "long call"],
)  # fmt: skip
def test_odd_texts_have_short_diagnostics(editor: Editor, text: str) -> None:
    editor.open("a.scene", text)
    hover(editor, "a.scene", 0, 5)
    messages = [d["message"] for d in editor.checked("a.scene")]
    assert messages
    assert max(map(len, messages)) < 2100
    assert not [message for message in messages if "internal error" in message]
    editor.open("a.scene", "sphere(1)\n")
    assert "sphere" in hover(editor, "a.scene", 0, 2)["contents"]["value"]


@pytest.mark.long
def test_files_that_are_none_are_told(editor: Editor, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "fifo.scene")
    (tmp_path / "device.scene").symlink_to("/dev/zero")
    (tmp_path / "out.scene").symlink_to("/etc/hostname")
    (tmp_path / "folder.scene").mkdir()
    (tmp_path / "loop.scene").symlink_to("loop.scene")
    names = ("fifo", "device", "out", "folder", "loop")
    editor.open("a.scene", "".join(f'use "{name}.scene"\n' for name in names) + "sphere(1)\n")
    assert [d["range"]["start"]["line"] for d in editor.checked("a.scene")] == [*range(len(names))]
    for name in names:
        editor.tell(
            "textDocument/didOpen",
            {"textDocument": {"uri": editor.uri(f"{name}.scene"), "languageId": "scene", "version": 1, "text": "box("}},
        )
        hover(editor, f"{name}.scene", 0, 1)
        editor.tell("textDocument/didClose", {"textDocument": {"uri": editor.uri(f"{name}.scene")}})
        hover(editor, f"{name}.scene", 0, 1)
    assert "sphere" in hover(editor, "a.scene", len(names), 2)["contents"]["value"]
