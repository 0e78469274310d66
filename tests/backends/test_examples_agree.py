"""Examples and sample files, rasterized and ray traced: equal light inside outlines; outlines differ by a pixel at most."""

from __future__ import annotations

from pathlib import Path

import maquette
import numpy as np
import pytest
from maquette.render.image.image import Image

from ..conftest import ASSETS
from .views import rgb

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
QUICK = ("clipping.scene", "transforms.scene", "lighthouse.obj")
APART = ("lens.scene", "motion.scene", "panorama.scene")  # whose rays start at other places and times, or of which there is no raster
FILES = [p for p in sorted(EXAMPLES.iterdir()) if p.suffix in (".scene", ".usda", ".obj") and p.name not in APART]
LENSES = ("cameraMoving.usda",)
FOUND = sorted([*ASSETS.glob("mesh/*/*.obj"), *ASSETS.glob("mesh/*/*.ply"), *ASSETS.glob("usd/*/*.usd*")])
SAMPLES = [p for p in FOUND if p.name not in LENSES]


def shown(path: Path, backend: str) -> Image:
    """Direct light at pixel centres; mirrors are black, because the rasterizer would look up the sky."""
    plan = {"raster.secondary_rays": "trace"}
    return maquette.render(maquette.load(path), backend=backend, size=(120, 80), samples=1, bounces=0, aov=("id", "depth"), plan=plan)


def inside(*images: Image) -> np.ndarray:
    """(h, w) pixels around which every picture shows one instance of smooth depth: no outline passes."""
    h, w = images[0].height, images[0].width
    found = np.ones((h, w), bool)
    for image in images:
        ids = np.pad(image.channels["id"][..., 0], 1, mode="edge")
        with np.errstate(divide="ignore", invalid="ignore"):
            key = np.nan_to_num(1.0 / image.channels["depth"][..., 0], posinf=0.0, neginf=0.0)
        for dy, dx in np.ndindex(3, 3):
            found &= ids[dy : dy + h, dx : dx + w] == image.channels["id"][..., 0]
        near = np.pad(key, 1, mode="edge")
        for across, middle in (((near[1:-1, :-2], near[1:-1, 2:]), key), ((near[:-2, 1:-1], near[2:, 1:-1]), key)):
            found &= np.abs(across[0] + across[1] - 2.0 * middle) <= 0.02 * np.abs(middle)
    return found


def beside(a: Image, b: Image) -> np.ndarray:
    """(h, w) whether b shows the instance of a within a pixel."""
    ids = a.channels["id"][..., 0]
    near = np.pad(b.channels["id"][..., 0], 1, mode="edge")
    return np.any([near[dy : dy + b.height, dx : dx + b.width] == ids for dy, dx in np.ndindex(3, 3)], axis=0)


def check(path: Path) -> None:
    a, b = shown(path, "raster"), shown(path, "ray")
    calm = inside(a, b)
    size = np.maximum(np.abs(rgb(b)).max(-1), 1e-3 * np.abs(rgb(b)).max())
    off = calm & (np.abs(rgb(a) - rgb(b)).max(-1) > 1e-3 * np.where(size > 0.0, size, 1.0))
    assert off.sum() <= 5, f"{off.sum()} of {calm.sum()} pixels, first {np.argwhere(off)[:5].tolist()}"  # where a shadow ends
    far = ~(beside(a, b) & beside(b, a))
    assert far.sum() <= 5, f"outlines at {np.argwhere(far)[:5].tolist()}"  # what is narrower than a pixel


@pytest.mark.parametrize("name", QUICK)
def test_an_example_is_alike(name):
    check(EXAMPLES / name)


@pytest.mark.long
@pytest.mark.parametrize("path", [p for p in FILES if p.name not in QUICK], ids=lambda p: p.name)
def test_examples_are_alike(path):
    check(path)


@pytest.mark.long
@pytest.mark.assets
@pytest.mark.parametrize("path", SAMPLES, ids=lambda p: p.name)
def test_sample_files_are_alike(path):
    check(path)
