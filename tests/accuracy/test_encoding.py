"""Known answers 32 and 35 to 37: patterns finer than pixels, light between vertices, fall-off with distance, and sRGB."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.render.image import image_files, image_reader, srgb
from maquette.render.surface import texture_footprint

from ..files import write_image
from . import radiometry as rm

Array = rm.Array
ABOVE = "camera(position: [0, 10, 0], look_at: [0, 0, 0], up: [0, 0, -1], width: {})\n"
BEFORE = "camera(position: [0, 0, 5], look_at: [0, 0, 0], width: 2)\n"
SQUARE = "[[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]"
EXACT = 1e-10  # relative, in double precision

every = pytest.mark.parametrize("backend", rm.EVERY)


# --- 32: patterns finer than pixels --------------------------------------------------------------------------------------------------


def fine_checker(folder: Path, backend: str, samples: int, textures: str = "footprint") -> Array:
    """(48, 48) pixels of 1.37 m on a black and white checker of 1 cm."""
    text = ABOVE.format(48 * 1.37) + "plane(y: 0, material: emissive(checker(#fff, #000, size: 1cm)))\n"
    return rm.grey(rm.picture(folder, text, backend, samples=samples, plan={"texture_filter": textures}))


@pytest.mark.long
@every
@pytest.mark.parametrize("samples", [1, 64])
def test_a_pixel_that_sees_thousands_of_cells(tmp_path, measured, backend, samples):
    off = float(np.abs(fine_checker(tmp_path, backend, samples) - 0.5).max())
    measured.answer(32, "checker finer than a pixel: ½ in every pixel", backend, off * 255, 1.0, "of 255", "of 1 and 64 samples")


@pytest.mark.long
@every
def test_the_mean_of_a_fine_checker(tmp_path, measured, backend):
    """Samples that look at points: only noise, no bias."""
    values = fine_checker(tmp_path, backend, 128, "point")
    rm.within_error(measured, 32, "checker finer than a pixel: ½ in the mean", backend, values, 0.5, note="relative")


@pytest.mark.long
@every
@pytest.mark.parametrize("width", [366, 300, 197])
def test_the_mean_of_stripes_over_a_pixel(tmp_path, measured, backend, width):
    """A pixel from a to b sees (F(b) − F(a))/(b − a), F the integral of the stripes, which are 1 and 0 by turns.

    They are `width`/256 of a pixel wide, and their edges between the places that samples have, 1/256 apart. How strongly the
    picture's differences from ½ follow those of the answers, Σ (p − ½)(q − ½)/Σ (q − ½)², is 1, row by row. One sample that knows
    what its pixel spans is the answer itself.
    """
    start = 0.5 / 256  # pixels, of the first stripe that has begun before the picture does
    uv = f"[[{start / 48!r}, 0], [{1 + start / 48!r}, 0], [{1 + start / 48!r}, 1], [{start / 48!r}, 1]]"
    stripes = f"emissive(stripes(#fff, #000, size: {width / 256 * 2 / 48!r}))"
    text = f"{BEFORE}polygon({SQUARE}, uv: {uv}, material: {stripes})\n"
    found, once = (
        rm.grey(rm.picture(tmp_path, text, backend, samples=n, plan={"texture_filter": how}))
        for n, how in ((64, "point"), (1, "footprint"))
    )

    def integral(x: Array) -> Array:
        """Of stripes of width 1: a half over each pair, and more for the first of the pair that has begun."""
        pairs = np.floor(x / 2)
        return pairs + np.minimum(x - 2 * pairs, 1)

    edges = (np.arange(49) + start) * 256 / width
    answer = np.diff(integral(edges)) * width / 256 - 0.5
    off = float(np.abs(once - 0.5 - answer).max())
    measured.answer(32, "stripes: a pixel's mean, by one sample", backend, off, 2e-5, note="the worst pixel")
    strength = (found - 0.5) @ answer / (answer @ answer)
    rm.within_error(measured, 32, "stripes: a pixel's mean over its interval", backend, strength, 1.0, note="relative")


@pytest.mark.parametrize("size", [(64, 64), (37, 81), (1, 100)])
def test_mip_levels(measured, size):
    """Each is made of the one before; sides that are odd share texels out. The last is one texel: the mean."""
    texels = np.random.default_rng(1).uniform(0, 1, (size[0] * size[1], 4)).astype(np.float32)
    images = ir.Images(np.zeros(1, np.int64), np.array([size[1]], np.int32), np.array([size[0]], np.int32), texels)
    last = texture_footprint.build_pyramids(images).texels[-1]
    off = float(np.abs(last / texels.astype(np.float64).mean(axis=0) - 1).max())
    measured.answer(32, "mip levels keep the mean of a picture", "functions", off, 1e-6, note="relative")


# --- 35: light between vertices ------------------------------------------------------------------------------------------------------


def roof(shading: str, model: str) -> str:
    """A square with normals 30° to the left at its left edge and 30° to the right at its right one, and light from where the eye is."""
    left, right = rm.written([-0.5, 0, math.sqrt(0.75)]), rm.written([0.5, 0, math.sqrt(0.75)])
    return (
        f"{BEFORE}mesh(points: {SQUARE}, faces: [[0, 1, 2, 3]], normals: [{left}, {right}, {right}, {left}], "
        f'material: {model[:-1]}, shading: "{shading}"))\ndirectional(from: [0, 0, 1])\n'
    )


@every
@pytest.mark.parametrize(("shading", "middle"), [("gouraud", math.sqrt(0.75)), ("phong", 1.0), ("flat", 1.0)])
def test_gouraud_interpolates_light_and_phong_normals(tmp_path, measured, backend, shading, middle):
    """Both vertices show cos 30° = 0.866025, and so does the middle between them; its own normal shows 1."""
    found = rm.grey(rm.picture(tmp_path, roof(shading, "lambert(1)"), backend, size=(33, 33)))[16, 16]
    off = abs(float(found) - middle)
    measured.answer(35, f"diffuse, normals at ±30°: the middle, {shading} shading", backend, off, 2e-6, note=f"of {middle:.6f}")


@every
@pytest.mark.parametrize(("shading", "middle"), [("gouraud", 0.75**16), ("phong", 1.0)])
def test_gouraud_misses_a_highlight_between_vertices(tmp_path, measured, backend, shading, middle):
    """(N·H)³² is cos³² 30° = 0.01002 at the vertices and 1 in the middle."""
    text = roof(shading, "blinn_phong(0, specular: 1, shininess: 32)")
    found = rm.grey(rm.picture(tmp_path, text, backend, size=(33, 33)))[16, 16]
    off = abs(float(found) / middle - 1)
    name = f"highlight, normals at ±30°: the middle, {shading} shading"
    measured.answer(35, name, backend, off, rm.SINGLE, note=f"relative to {middle:.5f}")


# --- 36: fall-off --------------------------------------------------------------------------------------------------------------------

FALLOFFS: dict[str, Callable[[Array], Array]] = {  # of d in metres
    "[1, 0, 0]": lambda d: 1 + 0 * d,
    "[0, 1, 0]": lambda d: 1 / d,
    "[0, 0, 1]": lambda d: 1 / d**2,
    "[0.5, 0.25, 2]": lambda d: 1 / (0.5 + 0.25 * d + 2 * d**2),
    "ramp(2.2m, 3m)": lambda d: np.clip((3 - d) / 0.8, 0, 1),
}


@every
@pytest.mark.parametrize("falloff", FALLOFFS)
def test_each_fall_off(tmp_path, measured, backend, falloff):
    """E = I cos θ/(kc + kl d + kq d²), or I cos θ on a ramp, from 1 to 0 between two distances."""
    text = ABOVE.format(6) + f"plane(y: 0, material: lambert(#ffffff))\npoint([0, 2, 0], intensity: 3, falloff: {falloff})\n"
    image = rm.picture(tmp_path, text, backend, aov=("position",))
    x, z = rm.position(image)
    d = np.sqrt(4 + x**2 + z**2)
    expected = 3 * (2 / d) / math.pi * FALLOFFS[falloff](d)
    ramp = falloff.startswith("ramp")
    off = float(np.max(np.abs(rm.grey(image) - expected) / (expected + (0.01 if ramp else 0))))  # a ramp ends in 0
    name = "fall-off on a ramp" if ramp else "fall-off 1/(kc + kl d + kq d²)"
    measured.answer(36, name, backend, off, rm.SINGLE, note="relative, the worst pixel")


# --- 37: sRGB ------------------------------------------------------------------------------------------------------------------------


def test_the_codes_of_light(measured):
    """1.055 v^(1/2.4) − 0.055, of 255; below 0.0031308 12.92 v (IEC 61966-2-1)."""
    known = {0.0: 0.0, 0.0031308: 10.31475, 0.18: 117.646, 0.5: 187.516, 1.0: 255.0}
    found = image_files.encode_srgb(np.array(list(known))) * 255
    closed = [255 * (12.92 * v if v <= 0.0031308 else 1.055 * v ** (1 / 2.4) - 0.055) for v in known]
    assert closed == pytest.approx(list(known.values()), abs=5e-4)
    off = float(np.abs(found - closed).max())
    measured.answer(37, "sRGB: 0.5 → 187.516, 0.18 → 117.646", "functions", off, 255 * EXACT, "of 255")


def test_every_code_comes_back_from_light(measured):
    codes = np.arange(256)
    wrong = np.count_nonzero(np.rint(image_files.encode_srgb(srgb.decode_srgb(codes / 255)) * 255) != codes)
    measured.answer(37, "sRGB: 256 codes there and back", "functions", wrong, 0, "codes wrong")


@every
def test_every_code_comes_back_from_a_picture(tmp_path, measured, backend):
    """A picture of all 256 codes, shown as it is, pixel by pixel, and written again."""
    codes = np.arange(256, dtype=np.uint8).reshape(16, 16, 1).repeat(3, axis=2)
    write_image(tmp_path / "a.png", codes)
    text = f'{BEFORE}polygon({SQUARE}, uv: [[0, 0], [1, 0], [1, 1], [0, 1]], material: emissive(image("a.png", filter: "nearest")))\n'
    image = rm.picture(tmp_path, text, backend, size=(16, 16))
    image_files.write(image, tmp_path / "b.png", image_files.Look(), {})
    again = np.rint(image_files.encode_srgb(image_reader.read(tmp_path / "b.png").channels["rgba"][..., :3]) * 255)
    measured.answer(37, "sRGB: 256 codes there and back", backend, np.count_nonzero(again[..., 0] != codes[..., 0]), 0, "codes wrong")


@every
@pytest.mark.parametrize("space", ["auto", "srgb", "linear"])
def test_numbers_are_read_as_they_are_and_colours_as_srgb(tmp_path, measured, backend, space):
    """sRGB 188/255 is 0.5029 linear; the same file as a number (an exponent's, say) is 188/255."""
    write_image(tmp_path / "a.png", np.full((2, 2, 3), 188, np.uint8))
    text = f'{BEFORE}box([2, 2, 2], material: emissive(image("a.png", space: "{space}")))\n'
    answer = 188 / 255 if space == "linear" else ((188 / 255 + 0.055) / 1.055) ** 2.4
    off = float(np.abs(rm.grey(rm.picture(tmp_path, text, backend, size=(8, 8))) / answer - 1).max())
    name = "a picture read as numbers" if space == "linear" else "a picture read as sRGB: 188 → 0.5029"
    measured.answer(37, name, backend, off, 1e-6, note="relative")
