"""Bloom: kept light, the halo of the source by angle, equal halos of reduced pictures, pictures by the command."""

from __future__ import annotations

import math
from pathlib import Path

import maquette
import numpy as np
import pytest
from click.testing import CliRunner
from maquette.cli.main import cli
from maquette.render.film import bloom
from maquette.render.image.image import Image

ANGLE = math.radians(0.1)


def spread(height: int, width: int, place: tuple[int, int], angle: float = ANGLE) -> np.ndarray:
    """A black picture with one pixel of 1000, after a bloom of 10 %."""
    rgba = np.zeros((height, width, 4), np.float32)
    rgba[place] = (1000.0, 500.0, 0.0, 1.0)
    image = Image(width, height, {"rgba": rgba}, {})
    bloom.add(image, 0.1, angle)
    return image.channels["rgba"]


def test_light_is_kept_but_for_what_leaves_the_picture() -> None:
    rgba = spread(301, 401, (150, 200))
    assert 995.0 < rgba[..., 0].sum(dtype=float) < 1000.0
    assert rgba[..., 1] == pytest.approx(0.5 * rgba[..., 0], rel=1e-3, abs=1e-6)
    assert not rgba[..., 2].any()
    assert rgba[..., 3].sum() == 1.0


def test_the_halo_is_that_of_the_source() -> None:
    """The ratio of two angles by the formula of Spencer and others, each part normalised over a hemisphere."""
    rgba = spread(301, 401, (150, 200))
    theta = np.linspace(0, 90, 9_000_001)[1:]
    ring = 2 * math.pi * np.sin(np.radians(theta)) * math.radians(theta[0])
    for pixels in (10, 100, 199):
        degrees = pixels * 0.1
        expected = sum(w / 0.616 / (degrees + 0.02) ** k / np.sum(ring / (theta + 0.02) ** k) for k, w in ((3, 0.478), (2, 0.138)))
        assert rgba[150, 200 + pixels, 0] == pytest.approx(100 * expected * ANGLE**2, rel=0.01)
    assert rgba[150, 100:200, 0] == pytest.approx(rgba[150, 300:200:-1, 0], rel=5e-3)


def test_large_pictures_have_the_same_halo(monkeypatch: pytest.MonkeyPatch) -> None:
    full = spread(300, 400, (150, 200))
    monkeypatch.setattr(bloom, "MOST_PIXELS", 10_000)
    reduced = spread(300, 400, (150, 200))
    assert reduced[..., 0].sum(dtype=float) == pytest.approx(full[..., 0].sum(dtype=float), rel=2e-3)
    assert reduced[150, 240:400:20, 0] == pytest.approx(full[150, 240:400:20, 0], rel=0.1)  # blocks are four pixels wide


@pytest.mark.parametrize("size", [(1, 1), (1, 7), (9, 1)])
def test_the_smallest_pictures(size: tuple[int, int]) -> None:
    rgba = spread(*size, (0, 0))
    assert np.isfinite(rgba).all()
    assert 900.0 < rgba[0, 0, 0] < 1000.0


def test_infinite_and_undefined_light_spreads_nothing() -> None:
    rgba = np.ones((5, 5, 4), np.float32)
    rgba[2, 2, 0], rgba[1, 1, 1] = np.inf, np.nan
    image = Image(5, 5, {"rgba": rgba}, {})
    bloom.add(image, 0.5, ANGLE)
    assert np.isinf(rgba[2, 2, 0])
    assert np.isnan(rgba[1, 1, 1])
    assert np.isfinite(rgba).sum() == rgba.size - 2


LAMP = "sphere(0.2, material: emissive(100))\ncamera(position: [0, 0, 4], look_at: [0, 0, 0]{})\n"


def test_the_option_draws_a_halo(tmp_path: Path) -> None:
    path = tmp_path / "a.scene"
    path.write_text(LAMP.format(""), encoding="utf-8")
    scene = maquette.load(path)
    clear, hazy = (scene.render(size=(64, 48), samples=4, bloom=share).channels["rgba"] for share in (None, 0.2))
    assert not clear[2, 2, :3].any()
    assert (hazy[2, 2, :3] > 0).all()
    assert hazy[24, 32, 0] < clear[24, 32, 0]


def test_cameras_without_a_lens_have_none(tmp_path: Path) -> None:
    path = tmp_path / "a.scene"
    path.write_text(LAMP.format(", width: 3m"), encoding="utf-8")
    options = ["-o", str(tmp_path / "a.png"), "--bloom", "5%", "--size", "8x8", "--samples", "1"]
    result = CliRunner().invoke(cli, ["render", str(path), *options])
    assert result.exit_code == 0
    assert "--bloom has no effect: only a perspective camera has a lens" in result.stderr


def test_a_share_is_below_one(tmp_path: Path) -> None:
    result = CliRunner().invoke(cli, ["render", "a.scene", "-o", str(tmp_path / "a.png"), "--bloom", "5"])
    assert result.exit_code == 2
    assert "write 5%" in result.stderr
