"""What the tests of the compiler share: a scene from text, and its diagnostics as a user reads them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from maquette.compiler import ir, load
from maquette.lang.diagnostics import Diagnostics, SceneError, render_text, sort_diagnostics

Compile = Callable[..., ir.Scene]


@pytest.fixture
def compiled(tmp_path: Path) -> Compile:
    """The scene in a text that has nothing wrong with it, beside the test's own files; keywords go to load."""

    def run(text: str, **more: object) -> ir.Scene:
        found = Diagnostics()
        path = tmp_path / "a.scene"
        path.write_text(text, encoding="utf-8")
        scene = load.load(path, diagnostics=found, **more)  # type: ignore[arg-type]
        assert [d.message for d in found.items] == []
        return scene

    return run


@pytest.fixture
def said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., str]:
    """Everything that is said about a text, errors and warnings, as it is printed."""

    def run(text: str, **more: object) -> str:
        monkeypatch.chdir(tmp_path)
        Path("a.scene").write_text(text, encoding="utf-8")
        found = Diagnostics()
        try:
            load.load("a.scene", diagnostics=found, **more)  # type: ignore[arg-type]
        except SceneError as error:
            found = Diagnostics(list(error.diagnostics))
        return "\n".join(render_text(d, lambda name: Path(name).read_text(encoding="utf-8")) for d in sort_diagnostics(found.items))

    return run
