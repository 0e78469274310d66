"""Pictures whose peak memory is compared with the estimate of cli/memory.py.

    python tests/render/memory_cases.py [NAME …]

Each is rendered in a process of its own, twice: kernels are compiled by the first, and the second is measured.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import maquette
import numpy as np

EXAMPLES = Path(maquette.__file__).parent / "examples"
RAY, RASTER = ("--plan", "transport=whitted", "--backend", "ray"), ("--backend", "raster")
CAMERA = "camera(position: [0, 1.5, 4], look_at: [0, 0, 0])\n"
AREA = f"area(position: [2, 4, 3], look_at: [0, 0, 0], size: 2, luminance: 20)\n{CAMERA}"
LIT = f"plane(y: -1)\nsphere(1)\n{AREA}"


class Case(NamedTuple):
    """`make` writes what is rendered into a folder and returns its path."""

    make: Callable[[Path], Path]
    options: tuple[str, ...]
    suffix: str = ".png"


def example(name: str) -> Callable[[Path], Path]:
    """A file of examples/."""
    return lambda _: EXAMPLES / name


def text(source: str) -> Callable[[Path], Path]:
    """A scene."""

    def make(folder: Path) -> Path:
        path = folder / "a.scene"
        path.write_text(source, encoding="utf-8")
        return path

    return make


def mesh(suffix: str, side: int = 707) -> Callable[[Path], Path]:
    """A wavy surface of 2 side² triangles in a file of its own."""

    def make(folder: Path) -> Path:
        import trimesh

        x, z = (each.reshape(-1) for each in np.meshgrid(*(np.linspace(-1.0, 1.0, side + 1),) * 2))
        first = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).reshape(-1)
        quads = first[:, None] + np.array([0, side + 1, side + 2, 1])
        faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
        points = np.stack([x, 0.1 * np.sin(9.0 * x) * np.cos(7.0 * z), z], axis=1)
        trimesh.Trimesh(points, faces, process=False).export(folder / f"waves.{suffix}")
        return text(f'mesh("waves.{suffix}")\n{AREA}')(folder)

    return make


def pictures(count: int, side: int, suffix: str = "png") -> Callable[[Path], Path]:
    """Spheres with a picture of side² texels each."""

    def make(folder: Path) -> Path:
        import OpenImageIO as oiio

        rng = np.random.default_rng(1)
        for k in range(count):
            texels = np.repeat(np.repeat(rng.integers(0, 256, (side // 8, side // 8, 3), np.uint8), 8, axis=0), 8, axis=1)
            image = oiio.ImageBuf(oiio.ImageSpec(side, side, 3, oiio.UINT8))
            image.set_pixels(oiio.ROI(), texels)
            image.write(str(folder / f"{k}.{suffix}"))
        spheres = (f'sphere(0.6, center: [{k}, 0, 0], material: lambert(image("{k}.{suffix}")))\n' for k in range(count))
        return text("".join(spheres) + AREA)(folder)

    return make


def dome(folder: Path) -> Path:
    """A sphere under a dome light of a picture in floats."""
    import OpenImageIO as oiio

    image = oiio.ImageBuf(oiio.ImageSpec(4096, 2048, 3, oiio.FLOAT))
    oiio.ImageBufAlgo.checker(image, 64, 64, 1, (0.1, 0.2, 0.3), (0.9, 0.5, 0.4))
    image.write(str(folder / "sky.hdr"))
    return text(f'sphere(1)\ndome("sky.hdr")\n{CAMERA}')(folder)


CASES = {
    "hello 200": Case(example("hello.scene"), ("--size", "200")),
    "room 400": Case(example("room.scene"), ("--size", "400", "--samples", "16")),
    "room 2000": Case(example("room.scene"), ("--size", "2000", "--samples", "4", "--no-denoise")),
    "chess 800": Case(example("chess.scene"), ("--size", "800", "--samples", "4")),
    "glass 1200": Case(example("glass.scene"), ("--size", "1200", "--samples", "4")),
    "caustic 400": Case(example("caustic.scene"), ("--size", "400", "--samples", "16")),
    "vase 1000 raster": Case(example("vase.scene"), ("--size", "1000", "--samples", "4", *RASTER)),
    "fillets 600": Case(example("fillets.scene"), ("--size", "600", "--samples", "4")),
    "instancing 800": Case(example("instancing.scene"), ("--size", "800", "--samples", "4")),
    "textures 800": Case(example("textures.scene"), ("--size", "800", "--samples", "4")),
    "motion 600": Case(example("motion.scene"), ("--size", "600", "--samples", "8")),
    "lens 600 raster": Case(example("lens.scene"), ("--size", "600", "--samples", "8", *RASTER)),
    "pavilion 600": Case(example("pavilion.usda"), ("--size", "600", "--samples", "8")),
    "falloff 60 reference": Case(example("falloff.scene"), ("--size", "60", "--samples", "1", "--backend", "reference")),
    "ball 4000 one sample": Case(text(LIT), ("--size", "4000", "--samples", "1", "--no-denoise")),
    "ball 4000": Case(text(LIT), ("--size", "4000", "--samples", "2", "--no-denoise")),
    "ball 4000 whitted": Case(text(LIT), ("--size", "4000", "--samples", "2", "--no-denoise", *RAY)),
    "ball 4000 raster": Case(text(LIT), ("--size", "4000", "--samples", "2", "--no-denoise", *RASTER)),
    "ball 3000 raster exr": Case(text(LIT), ("--size", "3000", "--samples", "2", *RASTER, "--aov", "depth,normal"), ".exr"),
    "ball 3000 denoised": Case(text(LIT), ("--size", "3000", "--samples", "2", "--denoise")),
    "ball 1000 denoised": Case(text(LIT), ("--size", "1000", "--samples", "2", "--denoise")),
    "ball 2000 error": Case(text(LIT), ("--size", "2000", "--error", "10%", "--no-denoise")),
    "ball 2000 aovs": Case(text(LIT), ("--size", "2000", "--samples", "2", "--aov", "depth,normal,position,albedo,uv,variance"), ".exr"),
    "ball 2000 mattes": Case(text(LIT), ("--size", "2000", "--samples", "2", "--aov", "cryptomatte,lights"), ".exr"),
    "mesh ply": Case(mesh("ply"), ("--size", "400", "--samples", "4")),
    "mesh obj": Case(mesh("obj"), ("--size", "400", "--samples", "4", *RAY)),
    "mesh glb raster": Case(mesh("glb"), ("--size", "400", "--samples", "4", *RASTER)),
    "mesh stl": Case(mesh("stl"), ("--size", "400", "--samples", "4")),
    "texture 4096": Case(pictures(1, 4096), ("--size", "600", "--samples", "4")),
    "texture 4096 whitted": Case(pictures(1, 4096), ("--size", "600", "--samples", "4", *RAY)),
    "textures 2048": Case(pictures(5, 2048, "jpg"), ("--size", "600", "--samples", "4", *RASTER)),
    "dome 4096": Case(dome, ("--size", "600", "--samples", "4")),
}

_MEASURE = """
import resource, subprocess, sys
subprocess.run([sys.executable, "-P", "-m", "maquette", "render", *sys.argv[1:]], check=True, stdout=subprocess.DEVNULL)
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024)
"""  # a small process: the peak of a new one begins at the memory of the one that starts it


def measure(case: Case, folder: Path, warm: bool = True) -> tuple[int, int]:
    """(bytes that were expected, peak bytes) of a case."""
    stats = folder / "stats.json"
    command = [str(case.make(folder)), *case.options, "-o", str(folder / f"a{case.suffix}"), "--stats", str(stats), "-q"]
    peak = 0
    for _ in range(1 + warm):
        done = subprocess.run([sys.executable, "-c", _MEASURE, *command], check=True, capture_output=True, text=True)
        peak = int(done.stdout)
    return json.loads(stats.read_text(encoding="utf-8"))["memory_expected"], peak


def main() -> None:
    """Print expected and measured memory of the cases named on the command line, or all."""
    for name in sys.argv[1:] or CASES:
        with tempfile.TemporaryDirectory() as folder:
            expected, peak = measure(CASES[name], Path(folder))
        print(f"{name:24} expected {expected / 1e6:7.0f} MB, took {peak / 1e6:7.0f} MB: {expected / peak:.2f}", flush=True)


if __name__ == "__main__":
    main()
