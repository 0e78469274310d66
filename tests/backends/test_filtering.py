"""Textures with more texels than pixels are averaged, on every backend, at a slant and across the seam."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from hypothesis import given
from hypothesis import strategies as st
from maquette.compiler import ir
from maquette.render.surface import texture_footprint

FLOOR = (
    "mesh(points: [[-40, 0, 6], [40, 0, 6], [40, 0, -4000], [-40, 0, -4000]], faces: [[0, 1, 2, 3]],\n"
    '  uv: [[0, 0], [10, 0], [10, 500], [0, 500]], material: lambert(image("checker.png")))\n'
    "directional(from: [0, 1, 0], irradiance: 3.14159265, shadows: false)\n"
    "camera(position: [0, 1.5, 8], look_at: [0, 1.0, 0], fov: 40deg)\n"
)


def write(path: Path, values: np.ndarray) -> None:
    """Write linear values (h, w) as a float image."""
    oiio.ImageBuf(np.repeat(values[..., None], 3, axis=2).astype(np.float32)).write(str(path))


def checker(path: Path, size: int = 128, cell: int = 8) -> None:
    y, x = np.mgrid[0:size, 0:size] // cell
    oiio.ImageBuf(np.repeat(((x + y) % 2 * 255).astype(np.uint8)[..., None], 3, axis=2)).write(str(path))


@pytest.mark.parametrize(("backend", "plan"), [("ray", {}), ("reference", {}), ("raster", {"raster.precision": "float32"})])
def test_a_checker_towards_the_horizon_becomes_its_mean(draw_on, tmp_path: Path, backend: str, plan: dict[str, str]):
    """Where a pixel spans a hundred cells, their mean is ½ within 1/255 (Heckbert 1989); near the eye it is not."""
    checker(tmp_path / "checker.png")
    picture = draw_on(backend, FLOOR, plan, size=(64, 64)).channels["rgba"]
    seen = picture[..., 3] > 0
    top = int(np.flatnonzero(seen.all(axis=1))[0])  # some hundred cells high a pixel
    far = picture[top, :, 0]
    assert np.abs(far - 0.5).max() <= 1.0 / 255.0
    assert np.ptp(picture[-4:, :, 0]) > 0.9
    sharp = draw_on(backend, FLOOR, {**plan, "texture_filter": "point"}, size=(64, 64)).channels["rgba"][top, :, 0]
    assert np.ptp(sharp) > 0.5


@pytest.mark.parametrize("backend", ["ray", "raster"])
@pytest.mark.parametrize("camera", ["width: 4", "fov: 30deg"])
def test_straight_on_a_pixel_sees_the_mean_of_what_it_covers(draw_on, tmp_path: Path, backend: str, camera: str):
    """A wave of 16 texels, 4 texels a pixel: sin(π/4)/(π/4) of its height, the mean over a pixel, less bilinear blur."""
    size = 256
    x = np.arange(size) + 0.5
    write(tmp_path / "wave.exr", np.tile(0.5 + 0.5 * np.sin(2 * np.pi * x / 64), (size, 1)))
    text = (
        "mesh(points: [[-2, -2, 0], [2, -2, 0], [2, 2, 0], [-2, 2, 0]], faces: [[0, 1, 2, 3]],\n"
        '  uv: [[0, 0], [1, 0], [1, 1], [0, 1]], material: lambert(image("wave.exr")))\n'
        "directional(from: [0, 0, 1], irradiance: 3.14159265, shadows: false)\n"
        f"camera({camera}, position: [0, 0, {2 / np.tan(np.radians(15)):.9f}], look_at: [0, 0, 0])\n"
    )
    row = draw_on(backend, text, size=(64, 64)).channels["rgba"][32, :, 0]
    mean = 0.5 + 0.5 * np.sinc(1 / 16) * np.sin(2 * np.pi * (np.arange(64) + 0.5) / 16)
    assert np.abs(row - mean)[2:-2].max() < 0.03


@pytest.mark.parametrize("backend", ["ray", "raster"])
def test_a_seam_is_not_seen(draw_on, tmp_path: Path, backend: str):
    """Where u jumps from 1 to 0, the footprint is as small as beside the seam."""
    size = 512
    wave = 0.5 + 0.5 * np.cos(2 * np.pi * (np.arange(size) + 0.5) / size)
    write(tmp_path / "round.exr", np.tile(wave, (size // 2, 1)))
    text = (
        'sphere(1, material: lambert(image("round.exr")))\nambient(#ffffff)\n'
        "camera(position: [0, 0, -4], look_at: [0, 0, 0], fov: 32deg)\n"
    )
    picture = draw_on(backend, text, size=(64, 64)).channels["rgba"]
    middle = picture[28:36, 30:34, 0]
    assert middle.min() > 0.99 * middle.max() > 0.0


@given(st.integers(1, 13), st.integers(1, 13), st.integers(0, 1000))
def test_smaller_sizes_keep_the_mean(width: int, height: int, seed: int):
    texels = np.random.default_rng(seed).random((width * height, 4)).astype(np.float32)
    images = ir.Images(np.zeros(1, np.int64), np.array([width], np.int32), np.array([height], np.int32), texels)
    made = texture_footprint.build_pyramids(images)
    last = made.levels[0] - 1
    assert (made.level_width[0, last], made.level_height[0, last]) == (1, 1)
    for level in range(last + 1):
        first, count = made.level_first[0, level], made.level_width[0, level] * made.level_height[0, level]
        assert np.allclose(made.texels[first : first + count].mean(axis=0), texels.mean(axis=0), atol=1e-6)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("size", [(8, 8), (7, 5)])
def test_smaller_sizes_of_the_largest_numbers_are_finite(size: tuple[int, int]):
    """Sums of two of these texels are beyond the largest float, and shares of odd sides may add up to more than 1."""
    height, width = size
    largest = np.finfo(np.float32).max
    texels = np.tile(np.array([largest, -largest, 0.9 * largest, 1], np.float32), (width * height, 1))
    images = ir.Images(np.zeros(1, np.int64), np.array([width], np.int32), np.array([height], np.int32), texels)
    made = texture_footprint.build_pyramids(images)
    assert np.allclose(made.texels, texels[0], rtol=1e-5)


# --- patterns -----------------------------------------------------------------------------------------------------------

EVERY = ["ray", "raster", "reference"]
PLAIN_LIGHT = "directional(from: [0, 1, 0], irradiance: 3.14159265, shadows: false)\n"
WALL = (
    "polygon([[-2, -2, 0], [2, -2, 0], [2, 2, 0], [-2, 2, 0]], material: lambert(pattern(|x, y, z| {})))\n"
    "directional(from: [0, 0, 1], irradiance: 3.14159265, shadows: false)\ncamera(width: 4, position: [0, 0, 5], look_at: [0, 0, 0])\n"
)


@pytest.mark.parametrize("backend", EVERY)
def test_a_pattern_towards_the_horizon_becomes_its_mean(draw_on, backend: str):
    """64 samples of a checker in a pixel: ½ within their spread, and 0 for noise; near the eye, unfiltered values."""
    text = (
        "plane(y: 0, material: lambert(pattern(|x, y, z| if mod(floor(x) + floor(z), 2) == 0 then 1 else 0)))\n"
        + PLAIN_LIGHT + "camera(position: [0, 1.5, 8], look_at: [0, 1.0, 0], fov: 40deg)\n"
    )  # fmt: skip
    picture = draw_on(backend, text, size=(48, 64)).channels["rgba"]
    top = int(np.flatnonzero((picture[..., 3] > 0).all(axis=1))[0])
    far = picture[top : top + 2, :, 0]
    assert np.abs(far - 0.5).max() < 0.3
    assert abs(far.mean() - 0.5) < 0.03
    assert np.ptp(picture[-4:, :, 0]) > 0.9
    sharp = draw_on(backend, text, {"texture_filter": "point"}, size=(48, 64)).channels["rgba"][top : top + 2, :, 0]
    assert np.abs(sharp - 0.5).max() == pytest.approx(0.5)


@pytest.mark.parametrize("backend", EVERY)
def test_an_edge_in_a_pattern_covers_a_share_of_its_pixels(draw_on, backend: str):
    """A slanted edge: each pixel's value is the bright share of its square, by one sample of 64 positions."""
    row = draw_on(backend, WALL.format("x + 0.25 * y <= 0.013"), size=(32, 32)).channels["rgba"][..., 0]
    fine = (np.arange(32 * 16) + 0.5) / (32 * 16) * 4 - 2
    x, y = np.meshgrid(fine, -fine)
    share = (x + 0.25 * y <= 0.013).reshape(32, 16, 32, 16).mean(axis=(1, 3))
    assert np.abs(row - share).max() < 0.05
    assert ((row > 0.05) & (row < 0.95)).sum() > 20


@pytest.mark.parametrize("backend", EVERY)
def test_where_a_pattern_hardly_changes_it_is_what_it_is_at_points(draw_on, backend: str):
    """Long waves: means over pixels differ from values at centres by less than the curvature allows."""
    text = WALL.format("0.5 + 0.4 * sin(2 * x) * cos(3 * y)")
    over, at = (draw_on(backend, text, plan, size=(32, 32)).channels["rgba"][..., 0] for plan in ({}, {"texture_filter": "point"}))
    assert 0 < np.abs(over - at).max() < 0.4 * 13 / 24 * (4 / 32) ** 2 * 1.5


def test_every_slot_takes_a_filtered_pattern(draw_on):
    """Roughness, opacity, emission, bumps and weights: backends agree with one sample of each."""
    fine = "pattern(|x, y, z| 0.5 + 0.5 * sign(sin(90 * x + 40 * y)))"
    text = (
        f"sphere(0.5, center: [-1.2, 0, 0], material: principled(#888, roughness: {fine}))\n"
        f"sphere(0.5, material: lambert(#a53, bump_map: {fine}, bump_height: 1cm))\n"
        f"sphere(0.5, center: [1.2, 0, 0], material: blend(lambert(#fff), lambert(#000), {fine}))\n"
        f"sphere(0.5, center: [-0.6, 1, 0], material: emissive({fine}))\n"
        f"sphere(0.5, center: [0.6, 1, 0], material: lambert(#48c, opacity: {fine}))\n"
        "directional(from: [1, 2, 3], irradiance: 3, shadows: false)\ncamera(position: [0, 0.5, 6], look_at: [0, 0.5, 0], fov: 32deg)\n"
    )
    plan = {"interreflection": "off", "texture_filter": "footprint"}  # paths look at points, and find what shiny things mirror by chance
    ray, other = (draw_on(backend, text, plan, size=(40, 30)).channels["rgba"] for backend in ("ray", "reference"))
    close = np.abs(ray - other).max(axis=2) < 1e-6
    assert close.mean() > 0.995


# --- in mirrors and behind glass ---

MIRRORED = (
    "directional(from: [0, 1, 0], irradiance: 3.14159265, shadows: false)\n"
    "plane(y: 0, material: lambert({texture}))\n{what}\n"
    "camera(position: [0, 1.2, {z}], look_at: [0, 0.6, {at}], fov: 50deg)\n"
)
TILES = {
    "pattern": "pattern(|x, y, z| if mod(floor(5 * x) + floor(5 * z), 2) < 1 then 1 else 0)",
    "checker": "checker(#ffffff, #000000, size: 0.2)",
}
SIDE = "box([40, 9, 0.2], center: [0, 4.5, -2.1], material: mirror())"


@pytest.mark.parametrize("texture", TILES)
def test_a_mirror_shows_what_an_eye_behind_it_would_see(draw_on, texture: str):
    """The floor in a mirror at z = −2 equals the floor from the eye's image, except for anisotropic pixels."""
    size = {"size": (64, 48), "samples": 1}
    mirrored = draw_on("reference", MIRRORED.format(texture=TILES[texture], what=SIDE, z=4, at=0), {}, **size).channels["rgba"][..., 0]
    image = draw_on("reference", MIRRORED.format(texture=TILES[texture], what="", z=-8, at=-4), {}, **size).channels["rgba"][:, ::-1, 0]
    rows = slice(17, 26)  # of the wall, below the horizon
    apart = (mirrored - image)[rows]
    assert np.sqrt((apart**2).mean()) < 0.05
    assert abs(apart.mean()) < 5e-3
    assert np.ptp(mirrored[rows][-3:]) > 0.2


@pytest.mark.long
@pytest.mark.parametrize("texture", TILES)
@pytest.mark.parametrize(
    "what",
    [
        SIDE,
        "sphere(0.9, center: [0, 0.9, 0], material: mirror())",
        pytest.param("box([9, 3, 0.1], center: [0, 1.5, 0], material: glass())", marks=pytest.mark.long),
    ],
)
def test_one_sample_of_what_is_mirrored_is_near_the_mean_of_many(draw_on, texture: str, what: str):
    text, size = MIRRORED.format(texture=TILES[texture], what=what, z=4, at=0), {"size": (64, 48)}
    many = draw_on("reference", text, {}, samples=64, **size).channels["rgba"][..., 0]
    plans = ({}, {"texture_filter": "point"})
    one, sharp = (draw_on("reference", text, plan, samples=1, **size).channels["rgba"][..., 0] for plan in plans)
    part = (slice(17, 26), slice(24, 40))
    error, before = (float(np.sqrt(((seen - many)[part] ** 2).mean())) for seen in (one, sharp))
    assert error < 0.4 * before
    assert abs((one - many)[part].mean()) < 0.02


def test_rays_and_the_reference_filter_what_is_mirrored_alike(draw_on):
    things = SIDE + "\nsphere(0.6, center: [-1, 0.6, 0], material: mirror())\nbox([0.8, 1.2, 0.1], center: [1, 0.6, 0], material: glass())"
    text = MIRRORED.format(texture=TILES["pattern"], what=things, z=4, at=0)
    ray, reference = (draw_on(backend, text, {}, size=(64, 48), samples=1).channels["rgba"] for backend in ("ray", "reference"))
    assert np.abs(ray - reference).max() < 1e-5
