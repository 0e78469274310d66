"""The VS Code extension: its manifest names what is there, its grammar is that of the language, its script parses."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
from maquette.lang import file_types
from maquette.lang.syntax import lexer
from maquette.live import server

FOLDER = Path(__file__).resolve().parents[2] / "tools" / "vscode"
MANIFEST = json.loads((FOLDER / "package.json").read_text(encoding="utf-8"))
GRAMMAR = json.loads((FOLDER / "syntaxes" / "scene.tmLanguage.json").read_text(encoding="utf-8"))


def test_the_manifest_names_what_is_there() -> None:
    given = MANIFEST["contributes"]
    paths = [MANIFEST["main"], *(one["configuration"] for one in given["languages"]), *(one["path"] for one in given["grammars"])]
    paths += [path for path in MANIFEST["files"] if path != "node_modules"]
    assert [path for path in paths if not (FOLDER / path).exists()] == []
    assert [extension for one in given["languages"] for extension in one["extensions"]] == list(file_types.SCENE)
    assert {one["scopeName"] for one in given["grammars"]} == {GRAMMAR["scopeName"]}
    script = (FOLDER / "extension.js").read_text(encoding="utf-8")
    commands = {one["command"] for one in given["commands"]}
    assert commands == set(re.findall(r'registerCommand\("([\w.]+)"', script))
    settings = {name.removeprefix("maquette.") for name in given["configuration"]["properties"]}
    assert settings == set(re.findall(r'setting\("([\w.]+)"\)', script))
    used = set(re.findall(r'require\("(vscode-[\w-]+)', script))
    assert used == set(MANIFEST["dependencies"])
    shown = next(one["when"] for one in given["menus"]["editor/title"])
    assert set(re.findall(r"\w+", shown.partition("(")[2])) == {kind[1:] for kind in (*file_types.USD, *file_types.MESH)}


def token(text: str) -> list[tuple[str, str]]:
    """The scopes of a line's tokens by the grammar's first rule that matches at each place."""
    found, at = [], 0
    while at < len(text):
        for rule in GRAMMAR["patterns"]:
            one = re.compile(rule.get("match") or rule["begin"]).match(text, at)
            if one and one.end() > at:
                end = one.end() if "match" in rule else re.compile(rule["end"]).search(text, one.end()).end()  # type: ignore[union-attr]
                found.append((rule.get("name", "number").split(".scene")[0], text[at:end]))
                at = end
                break
        else:
            at += 1
    return found


def test_the_grammar_is_that_of_the_language() -> None:
    line = 'param size = 2.5cm in 1..9 "the size"  // doc'
    assert token(line) == [
        ("keyword.control", "param"), ("variable.other", "size"), ("keyword.operator", "="), ("number", "2.5cm"),
        ("keyword.control", "in"), ("number", "1"), ("keyword.operator", ".."), ("number", "9"), ("string.quoted.double", '"the size"'),
        ("comment.line.double-slash", "// doc"),
    ]  # fmt: skip
    assert token("sphere(1, material: lambert(#ff8000))")[0] == ("entity.name.function", "sphere")
    assert ("constant.other.color", "#ff8000") in token("lambert(#ff8000)")
    rules = [rule for rule in GRAMMAR["patterns"] if rule.get("name", "").startswith(("keyword.control", "keyword.operator.l"))]
    keywords: Any = [rule["match"] for rule in rules]
    named = {word for match in keywords for word in re.findall(r"[a-z]{2,}", match)}
    assert named == lexer.KEYWORDS


def test_the_page_may_stand_in_the_preview_alone() -> None:
    assert "frame-ancestors vscode-file: vscode-webview:" in server.POLICY


@pytest.mark.skipif(shutil.which("node") is None, reason="no node: the script of the extension is not parsed")
def test_the_script_parses() -> None:
    subprocess.run(["node", "--check", str(FOLDER / "extension.js")], check=True, timeout=60)
