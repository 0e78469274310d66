"""What the failing places share: loading a text, and drawing it on a backend, by the public door."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import maquette
import numpy as np
import pytest
from maquette.compiler import ir
from maquette.lang.diagnostics import Diagnostics
from maquette.render.image import Image

EXPECTED = (  # said of scenes that are meant so
    "this shines, but lights other things only where bounces are followed",
    "there is nothing to draw: the picture will be empty",
)


@pytest.fixture
def load(tmp_path: Path) -> Callable[[str], tuple[ir.Scene, list[str]]]:
    """A scene of a text, files beside it, and what was said about it."""

    def run(text: str) -> tuple[ir.Scene, list[str]]:
        path = tmp_path / "a.scene"
        path.write_text(text, encoding="utf-8")
        found = Diagnostics()
        scene = maquette.load(path, diagnostics=found)
        return scene, [d.message for d in found.items if d.message not in EXPECTED]

    return run


@pytest.fixture
def draw(load: Callable[[str], tuple[ir.Scene, list[str]]]) -> Callable[..., Image]:
    """A picture of a text on a backend; 48 by 48 pixels and one sample at each pixel's centre if not said. All of it is finite."""

    def run(text: str, backend: str, plan: Mapping[str, str] | None = None, **settings: Any) -> Image:
        image = maquette.render(load(text)[0], plan=plan, **{"size": (48, 48), "samples": 1, "threads": 1, **settings, "backend": backend})
        assert image.metadata["issues"] == 0
        assert np.isfinite(image.channels["rgba"]).all()
        return image

    return run


class M:
    def place(self, number, name, naive="", ours="", bound="", note=""):
        print(f"PLACE {number:>2} | {name} | naive: {naive} | ours: {ours} | bound: {bound} | {note}")


@pytest.fixture
def measured():
    return M()
