"""Pictures as textures: every format to linear float32 r, g, b, a; alpha unassociated; from disk as from memory; refusals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from maquette.compiler.importers import images
from maquette.compiler.scene import builder as scene_builder
from maquette.lang.diagnostics import Diagnostics
from PIL import Image

from ...files import write_image


def linear(value: float) -> float:
    return value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4


def read(path: Path, space: str = "auto", odd: int = 0) -> np.ndarray:
    """Read from disk, checked to be the same from memory; `odd` pixels are not finite."""
    made, found, unread = images.read(str(path), path.name, space)
    held, again, _ = images.read(path.read_bytes(), path.name, space)
    assert np.array_equal(made, held)
    assert found == again == odd
    assert unread == ""
    assert (made.dtype, made.shape[2]) == (np.float32, 4)
    return made


def test_eight_bits_are_srgb(tmp_path: Path) -> None:
    levels = np.arange(256, dtype=np.uint8).reshape(16, 16, 1).repeat(3, axis=2)
    made = read(write_image(tmp_path / "a.png", levels))
    expected = np.array([linear(v / 255) for v in range(256)])
    assert made[..., 1].reshape(-1) == pytest.approx(expected, rel=1e-6, abs=1e-9)
    assert (made[..., 3] == 1).all()
    assert read(tmp_path / "a.png", "linear")[..., 0].reshape(-1) == pytest.approx(np.arange(256) / 255, rel=1e-6)


def test_sixteen_bits_are_srgb(tmp_path: Path) -> None:
    made = read(write_image(tmp_path / "a.png", np.full((1, 1, 3), 20000, dtype=np.uint16)))
    assert made[0, 0, 0] == pytest.approx(linear(20000 / 65535), rel=1e-6)


@pytest.mark.parametrize("ending", ["exr", "hdr", "tif"])
def test_floats_are_linear_and_may_be_above_one(tmp_path: Path, ending: str) -> None:
    pixels = np.tile(np.array([0.25, 1.0, 8.0], dtype=np.float32), (2, 3, 1))
    assert read(write_image(tmp_path / f"a.{ending}", pixels))[1, 2].tolist() == [0.25, 1, 8, 1]


@pytest.mark.parametrize("ending", ["png", "tga", "tif"])
def test_alpha_does_not_darken_the_colour(tmp_path: Path, ending: str) -> None:
    """Written as associated by OpenImageIO where the format has no such thing: the file holds 200 200 200 51."""
    pixels = np.tile(np.array([200, 200, 200, 51], dtype=np.uint8), (2, 2, 1))
    made = read(write_image(tmp_path / f"a.{ending}", pixels, oiio__UnassociatedAlpha=1))
    assert made[0, 0] == pytest.approx([linear(200 / 255)] * 3 + [0.2], rel=1e-5)


def test_associated_alpha_is_divided_out(tmp_path: Path) -> None:
    pixels = np.array([[[0.25, 0.5, 0.0, 0.5], [0.25, 0.5, 0.0, 0.0]]], dtype=np.float32)
    made = read(write_image(tmp_path / "a.exr", pixels))
    assert made.tolist() == [[[0.5, 1, 0, 0.5], [0.25, 0.5, 0, 0]]]


def test_grey_and_grey_with_alpha(tmp_path: Path) -> None:
    assert read(write_image(tmp_path / "a.png", np.full((1, 1, 1), 255, np.uint8)))[0, 0].tolist() == [1, 1, 1, 1]
    spec = np.array([[[255, 51]]], dtype=np.uint8)
    made = read(write_image(tmp_path / "b.png", spec, oiio__UnassociatedAlpha=1))
    assert made[0, 0] == pytest.approx([1, 1, 1, 0.2])


def test_what_is_not_finite_is_made_finite(tmp_path: Path) -> None:
    pixels = np.array([[[np.nan, np.inf, 1.0], [0.5, 0.5, 0.5]]], dtype=np.float32)
    made = read(write_image(tmp_path / "a.exr", pixels), odd=1)
    assert made[0, 0].tolist() == [0, images.LARGEST, 1, 1]


def test_the_top_row_is_row_zero(tmp_path: Path) -> None:
    pixels = np.zeros((2, 1, 3), dtype=np.uint8)
    pixels[0] = 255
    assert read(write_image(tmp_path / "a.bmp", pixels))[:, 0, 0].tolist() == [1, 0]


@pytest.mark.parametrize("data", [b"", b"not a picture", b"\x89PNG\r\n\x1a\n" + b"\0" * 40])
def test_what_is_no_picture_is_refused(tmp_path: Path, data: bytes) -> None:
    (tmp_path / "a.png").write_bytes(data)
    for source in (str(tmp_path / "a.png"), data):
        with pytest.raises(images.ImageError) as caught:
            images.read(source, "a.png")
        assert caught.value.message in ("cannot read the picture `a.png`", "the picture `a.png` is damaged")
        assert "/proc" not in caught.value.hint


def test_half_a_picture_is_refused(tmp_path: Path) -> None:
    noise = np.random.default_rng(1).integers(0, 256, (64, 64, 3)).astype(np.uint8)
    data = write_image(tmp_path / "a.png", noise).read_bytes()
    with pytest.raises(images.ImageError, match=r"the picture `a\.png` is damaged"):
        images.read(data[: len(data) // 2], "a.png")


def test_too_big_a_picture_is_refused_before_it_is_read(tmp_path: Path) -> None:
    path = write_image(tmp_path / "a.png", np.zeros((8, 8, 3), dtype=np.uint8))
    with pytest.raises(images.ImageError, match=r"the picture `a\.png` is too big: 8 by 8 pixels"):
        images.read(str(path), "a.png", limit=63)


def test_rows_are_shared_by_file_and_space(tmp_path: Path) -> None:
    path = write_image(tmp_path / "a.png", np.zeros((1, 2, 3), dtype=np.uint8))
    builder = scene_builder.SceneBuilder()
    assert images.row(builder, path) == images.row(builder, path, "auto", color=True) == 0
    assert images.row(builder, path, color=False) == images.row(builder, path, "linear") == 1
    assert images.row_from_bytes(builder, path.read_bytes(), "robot.usdz[a.png]") == 2
    assert builder.finish().names.images == (str(path), str(path), "robot.usdz[a.png]")


@pytest.mark.parametrize(
    ("window", "expected"),
    [
        ((0, 0, 2, 4), [[1, 1, 0, 0]] * 4),  # the left half has data
        ((1, 2, 2, 1), [[0] * 4, [0] * 4, [0, 1, 1, 0], [0] * 4]),
        ((-2, -1, 8, 6), [[1] * 4] * 4),  # overscan is cut
        ((9, 9, 2, 2), [[0] * 4] * 4),
    ],
)
def test_the_data_window_of_an_exr_lies_in_its_display_window(tmp_path, window, expected):
    x, y, width, height = window
    spec = oiio.ImageSpec(width, height, 3, "float")
    spec.x, spec.y, spec.full_x, spec.full_y, spec.full_width, spec.full_height = x, y, 0, 0, 4, 4
    out = oiio.ImageOutput.create(str(tmp_path / "a.exr"))
    assert out is not None
    assert out.open(str(tmp_path / "a.exr"), spec)
    assert out.write_image(np.ones((height, width, 3), np.float32))
    out.close()
    texels, _, _ = images.read(str(tmp_path / "a.exr"), "a.exr")
    assert texels[..., 0].tolist() == expected
    assert texels[..., 3].tolist() == expected


def test_channels_that_are_not_read_are_named(tmp_path: Path) -> None:
    spec = oiio.ImageSpec(2, 2, 6, "float")
    spec.channelnames = ("R", "G", "B", "A", "depth.Z", "mask")
    out = oiio.ImageOutput.create(str(tmp_path / "a.exr"))
    assert out is not None
    assert out.open(str(tmp_path / "a.exr"), spec)
    assert out.write_image(np.ones((2, 2, 6), np.float32))
    out.close()
    found = Diagnostics()
    builder = scene_builder.SceneBuilder(found)
    images.row(builder, tmp_path / "a.exr")
    assert [d.message for d in found.items] == ["of the picture `a.exr`, the channels `mask`, `depth.Z` are not drawn"]


@pytest.mark.parametrize(
    ("mode", "ink", "seen"),
    [("CMYK", (0, 255, 255, 0), (1.0, 0.0, 0.0)), ("CMYK", (0, 0, 0, 255), (0.0, 0.0, 0.0)), ("L", 255, (1.0, 1.0, 1.0))],
)
def test_jpeg_in_inks_or_grey_is_read_as_light(tmp_path: Path, mode: str, ink: int | tuple[int, ...], seen: tuple[float, ...]) -> None:
    Image.new(mode, (8, 8), ink).save(tmp_path / "a.jpg", quality=100)
    assert read(tmp_path / "a.jpg")[..., :3].reshape(-1, 3) == pytest.approx(np.tile(seen, (64, 1)), abs=0.02)
