"""The edits of the benchmark of start-up: scenes without errors, and a session in which each has its picture."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import maquette
import pytest
from maquette.bench import edit_session
from maquette.bench.edit_session import Environment
from maquette.lang.diagnostics import Diagnostics


@pytest.fixture
def environment(tmp_path: Path) -> Environment:
    """This environment, with its cache."""
    return Environment(tmp_path, dict(os.environ), sys.executable)


@pytest.mark.long
def test_thirty_scenes_have_no_errors(tmp_path: Path) -> None:
    texts = edit_session.scenes()
    assert len(texts) == len(set(texts.values())) == 30
    (tmp_path / "wedge.obj").write_text(edit_session.WEDGE, encoding="utf-8")
    for name, text in texts.items():
        (tmp_path / "a.scene").write_text(text, encoding="utf-8")
        found = Diagnostics()
        maquette.load(tmp_path / "a.scene", diagnostics=found)
        assert not found.items, name


@pytest.mark.long
def test_each_edit_of_a_session_has_a_picture(environment: Environment) -> None:
    texts = {"one": "sphere(1)\nrender(size: [8, 8], samples: 1, backend: \"reference\")\n"}
    texts["two"] = texts["one"].replace("sphere(1)", "sphere(0.5)")
    found = list(edit_session.session(environment, texts))
    assert [name for name, _, _ in found] == ["one", "two"]
    assert all(0.0 <= kernels <= total + 0.05 for _, kernels, total in found)


@pytest.mark.long
def test_a_session_ends_at_a_scene_with_errors(environment: Environment, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(edit_session, "SECONDS", 6.0)
    with pytest.raises(RuntimeError, match=r"(?s)no picture of edit 1:.*sphere has no `radios`"):
        list(edit_session.session(environment, {"wrong": "sphere(radios: 1)\n"}))


def test_nothing_can_be_written_in_the_locked_home(environment: Environment) -> None:
    home = environment.read_only_home()["HOME"]
    with pytest.raises(OSError, match=r"."):
        (Path(home) / "new").mkdir()
