"""Pictures of small tables for the tests of rendering: preparation, a backend and the film in one call."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from maquette.compiler import ir
from maquette.compiler.plan import plan
from maquette.render.backends import kernel_choice
from maquette.render.film import film
from maquette.render.image.image import Image
from maquette.render.types import View


def planned(tables: ir.Tables, backend: str, overrides: dict[str, str] | None = None, **settings: Any) -> tuple[ir.Scene, plan.Plan, View]:
    """A scene of these tables, its plan and the view of its first camera; one sample at the centre on black unless said."""
    complete = {"size": (96, 96), "samples": 1, "background": (0.0, 0.0, 0.0), "threads": 1, **settings}
    scene = ir.Scene("test", tables, names=ir.Names(cameras=("",)))
    decided = plan.make_plan(scene, ir.Settings(backend=backend, **complete), overrides)
    return scene, decided, View(0, *complete["size"])


def renderer(tables: ir.Tables, backend: str, overrides: dict[str, str] | None = None, **settings: Any) -> Any:
    """A backend ready to draw."""
    scene, decided, view = planned(tables, backend, overrides, **settings)
    return kernel_choice.make_renderer(scene, decided, view, general())


def general() -> bool:
    """Whether the tests take general kernels, as users do."""
    return os.environ[kernel_choice.VARIABLE] == "general"


def picture(tables: ir.Tables, backend: str = "raster", overrides: dict[str, str] | None = None, **settings: Any) -> Image:
    """The picture a backend makes."""
    scene, decided, view = planned(tables, backend, overrides, **settings)
    return film.run(kernel_choice.make_renderer(scene, decided, view, general()), decided, view)


def aov(tables: ir.Tables, name: str, backend: str = "raster", overrides: dict[str, str] | None = None, **settings: Any) -> np.ndarray:
    """(h, w) or (h, w, k) of one channel."""
    channel = picture(tables, backend, overrides, aov=(name,), **settings).channels[name]
    return channel[..., 0] if channel.shape[-1] == 1 else channel
