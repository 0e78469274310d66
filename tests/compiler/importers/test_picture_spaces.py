"""Tests of the colour spaces of pictures: by name, by the chromaticities of an EXR, for colours and for numbers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest
from maquette.compiler.importers import images
from maquette.compiler.scene.builder import SceneBuilder
from maquette.lang import color_spaces

from ...files import write_image

CODES = (128, 200, 64)


def stored(folder: Path) -> Path:
    return write_image(folder / "a.png", np.full((2, 2, 3), CODES, np.uint8))


def exr(folder: Path, color: tuple[float, ...], places: tuple[float, ...]) -> str:
    path = folder / "a.exr"
    spec = oiio.ImageSpec(2, 2, len(color), "float")
    spec.attribute("chromaticities", oiio.TypeDesc("float[8]"), places)
    out: Any = oiio.ImageOutput.create(str(path))
    out.open(str(path), spec)
    out.write_image(np.full((2, 2, len(color)), color, np.float32))
    out.close()
    return str(path)


def srgb(values: np.ndarray) -> np.ndarray:
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


@pytest.mark.parametrize(
    ("space", "decode", "primaries"),
    [
        ("srgb", srgb, color_spaces.REC709), ("linear", lambda v: v, color_spaces.REC709), ("raw", lambda v: v, color_spaces.REC709),
        ("acescg", lambda v: v, color_spaces.AP1), ("ACEScg", lambda v: v, color_spaces.AP1),
        ("rec2020", lambda v: v, color_spaces.REC2020),
        ("g22_rec709", lambda v: v**2.2, color_spaces.REC709), ("srgb_displayp3", srgb, color_spaces.P3),
        ("adobergb", lambda v: v ** (563 / 256), color_spaces.ADOBE), ("aces2065_1", lambda v: v, color_spaces.AP0),
    ],
)  # fmt: skip
def test_spaces_of_integers(tmp_path: Path, space: str, decode: object, primaries: color_spaces.Chromaticities) -> None:
    path = stored(tmp_path)
    values = decode(np.array(CODES) / 255.0)  # type: ignore[operator]
    expected = np.array(color_spaces.matrix(primaries, color_spaces.REC709)) @ values
    read = images.read(str(path), "a.png", space)
    assert read.texels[0, 0, :3] == pytest.approx(expected, abs=2e-6)
    assert read.is_wide == bool((expected < 0.0).any())
    as_numbers = images.read(str(path), "a.png", space, color=False)
    assert as_numbers.texels[0, 0, :3] == pytest.approx(values, abs=1e-6)


def test_an_exr_has_the_colours_of_its_chromaticities(tmp_path: Path) -> None:
    path = exr(tmp_path, (0.5, 0.4, 0.1), color_spaces.AP1)
    expected = np.array(color_spaces.matrix(color_spaces.AP1, color_spaces.REC709)) @ np.array([0.5, 0.4, 0.1])
    assert images.read(path, "a.exr").texels[0, 0, :3] == pytest.approx(expected, abs=1e-6)
    for space, color in (("linear", True), ("raw", True), ("auto", False)):  # as they are
        how = "linear" if space == "auto" else space
        assert images.read(path, "a.exr", how, color=color).texels[0, 0, :3].tolist() == np.array([0.5, 0.4, 0.1], np.float32).tolist()


def test_associated_alpha_and_rec709_keep_their_values(tmp_path: Path) -> None:
    path = exr(tmp_path, (0.25, 0.2, 0.05, 0.5), color_spaces.AP1)
    expected = np.array(color_spaces.matrix(color_spaces.AP1, color_spaces.REC709)) @ np.array([0.5, 0.4, 0.1])
    assert images.read(path, "a.exr").texels[0, 0] == pytest.approx([*expected, 0.5], abs=1e-6)
    rounded = tuple(round(v, 4) for v in color_spaces.REC709)
    plain = exr(tmp_path, (0.3, 0.2, 0.1), rounded)
    assert images.read(plain, "a.exr").texels[0, 0, :3].tolist() == np.array([0.3, 0.2, 0.1], np.float32).tolist()


@pytest.mark.parametrize("odd", [(0.0,) * 8, (0.3127, 0.329) * 4, (1e30,) * 8, (float("nan"),) * 8])
def test_odd_chromaticities(tmp_path: Path, odd: tuple[float, ...]) -> None:
    read = images.read(exr(tmp_path, (0.3, 0.2, 0.1), odd), "a.exr")
    assert read.texels[0, 0, :3].tolist() == np.array([0.3, 0.2, 0.1], np.float32).tolist()
    assert read.faults == (
        ("the chromaticities of the picture `a.exr` are not of a colour space: its colours are drawn as Rec.709",
         "write them as x and y of red, green, blue and white"),
    )  # fmt: skip


def test_an_unknown_space(tmp_path: Path) -> None:
    with pytest.raises(images.ImageError) as unknown:
        images.read(str(stored(tmp_path)), "a.png", "acesgc")
    assert (unknown.value.message, unknown.value.hint) == ("no colour space is called `acesgc`", "did you mean `acescg`?")


def test_rows_are_shared_where_colours_and_numbers_are_the_same(tmp_path: Path) -> None:
    builder, path = SceneBuilder(), stored(tmp_path)
    assert images.row(builder, path, "srgb", True) == images.row(builder, path, "srgb", False)
    assert images.row(builder, path, "acescg", True) != images.row(builder, path, "acescg", False)
