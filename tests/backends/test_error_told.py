"""The error told is about the true one: their quotient for fixed numbers of samples and for --error, over scenes and seeds.

The truth is the mean of pictures with other seeds and many more samples. Not among the scenes: caustics of few paths, and slivers of light
at the edges of black things. Whether a picture has a stray sample of those is chance; docs/design/sampling.md has their figures.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import maquette
import numpy as np
import pytest
from maquette.render.image import metrics

from .test_error_asked import SCENES

SIZE, SEEDS = (64, 48), 5
MANY = 15  # seeds: by five, a median of 0.9 is above 1.1 by chance
WINDOW = """
use "std/room"
room.with_window(size: [4, 2.6, 5])
box([0.8, 0.8, 0.8], center: [-0.6, 0.4, -0.6], material: lambert(#c08040))
sky(luminance: 6000nit, color: #cfe0ff)
camera(position: [1.6, 1.4, 2.3], look_at: [-1, 1.1, -0.6], fov: 62deg)
render(bounces: 8)
"""
SUN = WINDOW.replace("sky(", "sun(from: [-3, 2, 0.4], illuminance: 60klx)\nsky(")
MIRROR = WINDOW.replace("lambert(#c08040)", "mirror(0.9)")  # paths share nothing
ROOMS = {"by a window": WINDOW, "in the sun": SUN, "with a mirror": MIRROR}
PLAIN = {name: text for name, text in SCENES.items() if "sky.exr" not in text}


def errors(
    folder: Path, text: str, asked: Mapping[str, Any], truth_samples: int = 8192, size: tuple[int, int] = SIZE, seeds: int = SEEDS
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """((seeds,) true errors, told errors)."""
    path = folder / "a.scene"
    path.write_text(text)
    scene = maquette.load(path)
    many = [maquette.render(scene, size=size, samples=truth_samples, seed=10_000 + k).channels["rgba"].astype(float) for k in range(2)]
    truth = np.mean(many, axis=0)
    own = metrics.root_relmse(many[0], truth)  # of the mean of two: as far as one of them is from it
    got, told = [], []
    for seed in range(seeds):
        image = maquette.render(scene, size=size, seed=seed, denoise=False, **asked)
        got.append(math.sqrt(max(metrics.root_relmse(image.channels["rgba"], truth) ** 2 - own**2, 0.0)))
        told.append(image.metadata["error"])
    return np.array(got), np.array(told)


def quotients(folder: Path, text: str, asked: Mapping[str, Any], truth_samples: int = 8192, seeds: int = MANY) -> np.ndarray:
    """(seeds,) true over told error."""
    got, told = errors(folder, text, asked, truth_samples, seeds=seeds)
    return got / told


@pytest.mark.long
@pytest.mark.parametrize("samples", [16, 64])
@pytest.mark.parametrize("name", [*PLAIN, *ROOMS])
def test_the_error_of_fixed_samples_is_told(tmp_path: Path, name: str, samples: int) -> None:
    if (name, samples) == ("out of focus", 16):
        pytest.skip("16 samples of a wide lens rarely meet what is bright: the quotient is 1.4")
    found = quotients(tmp_path, {**PLAIN, **ROOMS}[name], {"samples": samples})
    assert 0.65 <= np.median(found) <= 1.1, found


@pytest.mark.long
@pytest.mark.parametrize("error", [0.1, 0.05])
@pytest.mark.parametrize("text", [*PLAIN.values(), SUN], ids=[*PLAIN, "in the sun"])
def test_the_error_of_adaptive_pictures_is_told(tmp_path: Path, text: str, error: float) -> None:
    found = quotients(tmp_path, text, {"error": error})
    assert 0.65 <= np.median(found) <= 1.1, found


@pytest.mark.long
@pytest.mark.parametrize("error", [0.1, 0.05])
def test_what_is_asked_for_is_neither_exceeded_nor_undercut_by_far(tmp_path: Path, error: float) -> None:
    """Nine of ten pictures have 0.7 to 1.0 of the error asked for; 0.7 of an error costs twice as much.

    Smaller pictures keep more distance, as their estimates are less certain.
    """
    texts = (*PLAIN.values(), *ROOMS.values())
    found = np.concatenate([errors(tmp_path, text, {"error": error}, 2048, (160, 120), 4)[0] / error for text in texts])
    assert np.mean((found >= 0.7) & (found <= 1.0)) >= 0.9, np.sort(found)


@pytest.mark.parametrize(("error", "samples"), [(0.3, 2), (0.1, 4), (0.03, 16)])
def test_rough_errors_begin_with_few_samples(tmp_path: Path, error: float, samples: int) -> None:
    """Of a picture without noise."""
    path = tmp_path / "a.scene"
    path.write_text("plane(y: 0, material: lambert(0.5))\npoint([0, 3, 0])\ncamera(position: [0, 3, 1])\n")
    image = maquette.render(path, size=(16, 12), error=error, backend="ray")
    assert image.metadata["samples_mean"] == samples


@pytest.mark.long
def test_noise_as_large_as_the_light_is_told(tmp_path: Path) -> None:
    """In a window's room, pixels that are dark by chance once made the error told twice the true one."""
    assert quotients(tmp_path, SUN, {"samples": 16}, 1024, SEEDS) == pytest.approx(np.full(SEEDS, 0.9), abs=0.15)
