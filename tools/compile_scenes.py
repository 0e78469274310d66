"""Compiles the kernels of scenes, or loads them: draws parts of each by both backends. Arguments: files of scenes."""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from pathlib import Path

from maquette.compiler import load
from maquette.compiler.plan import plan
from maquette.render import render_scene
from maquette.render.backends import kernel_choice

PARTS = (24, 24), (72, 40)
"""Pixels of the drawn parts: one tile, and several tiles, whose arrays are parts of larger ones."""


def main() -> None:
    os.environ[kernel_choice.VARIABLE] = "special"
    for file in sys.argv[1:]:
        scene = load.load(Path(file))
        for backend in ("ray", "raster"):
            settings = replace(scene.settings, threads=1, backend=backend)
            try:
                width, height = plan.make_plan(scene, settings)["size"]
            except plan.PlanError as error:
                print(f"{file}: {backend}: nothing to compile, {error}", flush=True)
                continue
            for part in PARTS:
                size = min(part[0], width), min(part[1], height)
                x, y = (width - size[0]) // 2, (height - size[1]) // 2
                crop = x, y, x + size[0], y + size[1]
                render_scene.draw(scene, plan.make_plan(scene, replace(settings, crop=crop)))  # its size decides about textures and shadows
            print(f"{file}: {backend}", flush=True)


if __name__ == "__main__":
    main()
