"""Fixtures of the backends' tests: render a scene text on one backend, or on each."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from maquette.compiler import ir, load
from maquette.compiler.plan import plan as planner
from maquette.lang.diagnostics import Diagnostics
from maquette.render.image.image import Image
from maquette.render.render_scene import draw as draw_scene

from . import scenes

BACKENDS = ("reference", "ray", "raster")
EXPECTED = ("there is nothing to draw: ", "the camera ", "two shapes ")  # begin messages of scenes that are meant so

Draw = Callable[..., Image]


@pytest.fixture(params=BACKENDS)
def backend(request: pytest.FixtureRequest) -> str:
    """Each backend."""
    return request.param


@pytest.fixture(params=("reference", "ray"))
def tracer(request: pytest.FixtureRequest) -> str:
    """The backends that follow reflected and refracted rays."""
    return request.param


@pytest.fixture
def draw_on(tmp_path: Path) -> Draw:
    """Render a scene text on a backend, beside its files; 48 × 48 pixels and one sample at each pixel's centre by default."""

    def run(backend: str, text: str, plan: Mapping[str, str] | None = None, **settings: Any) -> Image:
        path = tmp_path / "a.scene"
        path.write_text(text, encoding="utf-8")
        found = Diagnostics()
        scene = load.load(path, diagnostics=found)
        assert [d.message for d in found.items if not d.message.startswith(EXPECTED)] == []
        asked = ir.Settings(**{"size": (48, 48), "samples": 1, "threads": 1, **settings, "backend": backend})
        image = draw_scene(scene, planner.make_plan(scene, asked, plan))
        assert image.metadata["issues"] == 0
        assert np.isfinite(image.channels["rgba"]).all()
        return image

    return run


@pytest.fixture
def draw(backend: str, draw_on: Draw) -> Draw:
    """`draw_on` each backend."""
    return partial(draw_on, backend)


@pytest.fixture
def trace(tracer: str, draw_on: Draw) -> Draw:
    """`draw_on` each backend that follows rays."""
    return partial(draw_on, tracer)


@pytest.fixture
def picture(tmp_path: Path) -> Callable[..., None]:
    """Write an image file, (height, width, 3) from the top, for scenes to read."""

    def write(name: str, pixels: Any, kind: str = "float") -> None:
        import OpenImageIO as oiio

        values = np.ascontiguousarray(pixels, {"float": np.float32, "uint8": np.uint8}[kind])
        out = oiio.ImageOutput.create(str(tmp_path / name))
        assert out is not None
        out.open(str(tmp_path / name), oiio.ImageSpec(values.shape[1], values.shape[0], values.shape[2], kind))
        assert out.write_image(values), out.geterror()
        out.close()

    return write


@pytest.fixture
def files(tmp_path: Path, picture: Callable[..., None]) -> None:
    """Write the image, the mesh and the stage that `scenes` refer to."""
    v, u = np.mgrid[0:12, 0:16]
    picture("a.exr", np.stack([0.1 + 0.05 * u, 0.1 + 0.07 * v, 0.5 + 0.4 * np.sin(u + v)], axis=-1))
    (tmp_path / "a.obj").write_text(scenes.OBJ, encoding="utf-8")
    (tmp_path / "a.usda").write_text(scenes.USD, encoding="utf-8")
