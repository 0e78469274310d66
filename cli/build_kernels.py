"""Compiles the general kernels: `python -m maquette.cli.build_kernels`. Two processes share the work.

Small scenes stand for all others: general kernels are the same for every scene, and differ only by the integrator, by what the first
hits of camera rays are found with, and by precision. See render/backends/kernel_choice.py.
"""

from __future__ import annotations

import os
import queue
import subprocess
import sys
import tempfile
from collections import deque
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

from ..compiler import ir, load
from ..compiler.io import child_process
from ..compiler.plan import plan
from ..render import render_scene
from ..render.backends import kernel_choice
from ..render.jit import kernel_cache

WORKERS = 2
_THIS = f"{__package__}.build_kernels"  # __name__ may be __main__
SIZES = (24, 16), (72, 40)  # one tile, and several tiles, whose arrays are parts of larger ones
_BALL = "plane(y: 0)\nsphere(1, center: [0, 1, 0], material: {0})\ncamera(position: [0, 2, 6], look_at: [0, 1, 0])\n"
_TORUS = _BALL + "union(round: 0.1, material: {0}) {{ box(1, center: [1, 1, 0]); torus(radius: 1, tube: 0.2) }}\n"
_LENS = _BALL.replace("look_at: [0, 1, 0]", "look_at: [0, 1, 0], focal: 50mm, aperture: 0.7, focus: 5m")
_GROUP = 'directional(from: [1, 1, 0], group: "key")\n'
_FORMULA = _TORUS + "implicit(|x, y, z| x * x + y * y + z * z + 0.1 * sin(9 * x) <= 1, material: {0})\n"
_MESH_ALONE = 'mesh("kernels.obj")\n'
_MESH = 'mesh("kernels.obj", material: {0})\ncamera(position: [0, 2, 6], look_at: [0, 1, 0])\n'
_MANY = _MESH + 'mesh("more.obj", material: {0})\n' + "".join(f"sphere(0.1, center: [{k}, 0, {k % 7}])\n" for k in range(80))
_TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
_SUN, _AREA, _SKY = "directional(from: [1, 1, 0])\n", "area(position: [0, 5, 2], look_at: [0, 0, 0], size: 1, luminance: 9)\n", "sky()\n"
_MATT, _SHINY, _GLASS = "lambert(#808080)", "phong(#808080, specular: 0.3, shininess: 40)", "glass()"
_LINKED = 'directional(from: [1, 1, 0], receivers: ["left"], blockers: ["!left"])\nsphere(1, center: [9, 0, 0], name: "left")\n'
_MILK = "sphere(1, center: [3, 1, 0], medium: medium(#fff))\nfog()\n"
_CLOUD = "sphere(1, center: [3, 1, 0], medium: medium(#fff, density: |x, y, z| 1 - z))\n"
_SMOOTH = 'lambert(#808080, shading: "gouraud")'
_SMOOTH_MESH = f'mesh("kernels.obj", material: {_SMOOTH})\n'


class Variant(NamedTuple):
    """A small scene that needs some of the general kernels."""

    text: str
    settings: dict[str, Any]
    overrides: dict[str, str] | None = None  # of the plan


_ALONE = {"transport.path_reuse": "none"}
VARIANTS = {
    "paths of formulas": Variant(_FORMULA.format(_SHINY) + _AREA, {"bounces": 2}, _ALONE),
    "paths": Variant(_BALL.format(_SHINY) + _AREA, {"bounces": 2}, _ALONE),
    "photons": Variant(_BALL.format(_GLASS) + _AREA, {"bounces": 4}),
    "photons of formulas": Variant(_FORMULA.format(_GLASS) + _AREA, {"bounces": 4}),
    "photons of meshes and formulas": Variant(_FORMULA.format(_GLASS) + _MESH_ALONE + "sun(from: [1, 1, 0])\n" + _SKY, {"bounces": 4}),
    "paths lit at vertices": Variant(_MESH.format(_SMOOTH) + _SUN, {"bounces": 2}, _ALONE),
    "paths of formulas lit at vertices": Variant(_FORMULA.format(_MATT) + _SMOOTH_MESH + _SUN, {"bounces": 2}, _ALONE),
    "shared paths": Variant(_BALL.format(_MATT) + _AREA, {"bounces": 2}),
    "shared paths of formulas": Variant(_FORMULA.format(_MATT) + _AREA, {"bounces": 2}),
    "media": Variant(_BALL.format(_SHINY) + _MILK + _AREA, {"bounces": 2}),
    "media of formulas": Variant(_FORMULA.format(_SHINY) + _CLOUD + _AREA, {"bounces": 2, "aov": ("transmittance",)}),
    "rays": Variant(_BALL.format(_MATT) + _SUN, {}),
    "meshes": Variant(_MESH.format(_SMOOTH) + _SUN, {}),
    "many objects": Variant(_MANY.format(_MATT) + _SUN, {}),  # build kernels of several meshes and many instances
    "formulas": Variant(_FORMULA.format(_MATT) + _SUN, {}),
    "formulas and meshes": Variant(_FORMULA.format(_MATT) + _MESH_ALONE + _SUN, {}),
    "formulas in skies": Variant(_FORMULA.format(_MATT) + _SKY, {}),
    "rays of one sample": Variant(_BALL.format(_MATT) + _SUN, {"samples": 1}),
    "triangles in skies of one sample": Variant(_BALL.format(_MATT) + _SKY, {"backend": "raster", "samples": 1}),
    "formulas of one sample": Variant(_FORMULA.format(_MATT) + _SUN, {"samples": 1}),
    "formulas in large tiles": Variant(_FORMULA.format(_MATT) + _SUN, {"samples": 1, "size": (512, 512)}),
    "light groups": Variant(_BALL.format(_MATT) + _GROUP, {"aov": ("lights",)}),
    "light groups of formulas": Variant(_FORMULA.format(_MATT) + _GROUP, {"aov": ("lights",)}),
    "a lens of triangles": Variant(_LENS.format(_MATT) + _SUN, {"backend": "raster"}),
    "formulas in skies of one sample": Variant(_FORMULA.format(_MATT) + _SKY, {"samples": 1}),
    "light links": Variant(_MESH.format(_SHINY) + _LINKED, {}),
    "light links of formulas": Variant(_FORMULA.format(_SHINY) + _LINKED, {}),
    "paths of light links": Variant(_MESH.format(_SHINY) + _LINKED + _SKY, {"bounces": 2}),
    "paths of light links of formulas": Variant(_FORMULA.format(_SHINY) + _LINKED + _SKY, {"bounces": 2}),
    "triangles": Variant(_BALL.format(_MATT) + _SUN, {"backend": "raster"}, {"shadows": "off"}),
    "triangles lit at vertices": Variant(_MESH.format(_SMOOTH) + _SUN, {"backend": "raster"}),
    "triangles in shadow": Variant(_FORMULA.format(_MATT) + _SUN, {"backend": "raster"}),
    "mirrors of triangles": Variant(_BALL.format(_SHINY) + _SUN, {"backend": "raster", "bounces": 2}, {"raster.secondary_rays": "trace"}),
    "mirrors of light links": Variant(
        _BALL.format(_SHINY) + _LINKED, {"backend": "raster", "bounces": 2}, {"raster.secondary_rays": "trace"}
    ),
    "light links of triangles": Variant(_MESH.format(_SHINY) + _LINKED, {"backend": "raster"}),
    "light links of triangles in skies": Variant(_MESH.format(_SHINY) + _LINKED + _SKY, {"backend": "raster"}),
    "triangles with shadow maps": Variant(_FORMULA.format(_SHINY) + _SUN, {"backend": "raster"}, {"raster.shadows": "map"}),
    "triangles by tiles": Variant(_FORMULA.format(_MATT) + _AREA, {"backend": "raster", "error": 0.5}),
    "channels": Variant(_FORMULA.format(_MATT) + _SUN, {"aov": ("depth", "normal", "issues")}),
    "channels of paths": Variant(_FORMULA.format(_SHINY) + _AREA, {"bounces": 2, "aov": ("depth",), "denoise": True}),
    "channels of triangles": Variant(_FORMULA.format(_MATT) + _SUN, {"backend": "raster", "aov": ("depth",)}),
}


def compile_variant(name: str) -> None:
    """Compile or load the general kernels of a variant."""
    os.environ[kernel_choice.VARIABLE] = "general"
    variant = VARIANTS[name]
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "kernels.obj").write_text(_TRIANGLE, encoding="utf-8")
        Path(folder, "more.obj").write_text(_TRIANGLE.replace("1", "2", 1), encoding="utf-8")
        scene = Path(folder, "kernels.scene")
        scene.write_text(variant.text, encoding="utf-8")
        loaded = load.load(scene)
        for size in SIZES:
            settings = ir.Settings(**{"size": size, "samples": 2, "threads": 1, **variant.settings})
            render_scene.draw(loaded, plan.make_plan(loaded, settings, variant.overrides))


def is_compiled(name: str) -> bool:
    """Whether the kernels of a variant are on disk."""
    try:
        with kernel_cache.compiled_only():
            compile_variant(name)
    except kernel_cache.NotCompiled:
        return False
    return True


def compile_named() -> None:
    """Compile the variants whose names come from the standard input, a line each, and answer each with a line."""
    for line in sys.stdin:
        compile_variant(line.rstrip("\n"))
        print(flush=True)


def main() -> int:
    """Compile missing kernels; returns the exit code.

    A process compiles several variants, and takes up to 2.5 GB: kernels share most of their functions, which Numba types and lowers once in
    a process. Measured: 210 s of CPU for four variants in one process, of which two take 210 s in two processes.
    """
    from rich.console import Console
    from rich.progress import track

    missing = deque(name for name in VARIANTS if not is_compiled(name))
    if not missing:
        return 0
    total, answers = len(missing), queue.SimpleQueue[bool]()
    with ThreadPoolExecutor(WORKERS) as pool:
        for take in (missing.popleft, missing.pop)[:total]:  # from both ends: neighbours have more in common
            pool.submit(_compile, take, answers)
        succeeded = track((answers.get() for _ in range(total)), "compiling kernels", total, console=Console(stderr=True))
        return 0 if all(list(succeeded)) else 1


def _compile(take: Callable[[], str], answers: queue.SimpleQueue[bool]) -> None:
    """Compile what `take` returns, in one process, until it raises IndexError. Answer whether each succeeded."""
    process = None
    while True:
        try:
            name = take()
        except IndexError:
            break
        try:
            if process is None or process.poll() is not None:  # the first, or after a crash
                command = child_process.python(f"from {_THIS} import compile_named\ncompile_named()")
                process = child_process.start(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
            answers.put(_succeeds(process, name))
        except OSError:
            answers.put(False)
    if process is not None:
        process.communicate()


def _succeeds(process: subprocess.Popen[str], name: str) -> bool:
    """Let a process of `compile_named` compile a variant; False after its end."""
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.write(name + "\n")
    process.stdin.flush()
    if process.stdout.readline():
        return True
    process.wait()
    return False


if __name__ == "__main__":
    if len(sys.argv) > 1:
        compile_variant(sys.argv[1])
    else:
        sys.exit(main())
