"""Places 43 to 45: sums that stall, squares that overflow, half floats, and pictures with more numbers than int32 counts."""

from __future__ import annotations

import math
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from maquette.compiler import ir
from maquette.compiler.scene.builder import SceneBuilder
from maquette.compiler.scene.row_records import CameraData, Input, MaterialData, TextureData
from maquette.render.image import image, image_files, image_reader, metrics
from maquette.render.types import Film, Tile

from ..files import write_image
from ..render import pictures
from ..render.closed import K
from ..render.tables import grey, phong, scene
from . import naive

FLAT = CameraData(transform=0, extent=0.5, projection=ir.Projection.ORTHOGRAPHIC, near=1.0)


def rgb(picture: image.Image) -> np.ndarray:
    return picture.channels["rgba"][..., :3].astype(np.float64)


# --- 43: sums and squares --------------------------------------------------------------------------------------------------------


def shining(color: float) -> ir.Tables:
    """A wall of cells that shine with 1 and with `color`, seen whole by a picture of one pixel."""

    def material(builder: SceneBuilder) -> list[MaterialData]:
        checker = TextureData(ir.TextureKind.CHECKER, color_a=grey(color), color_b=grey(1.0))
        return [phong(0.0, emission=Input((1.0, 1.0, 1.0), builder.texture(checker)))]

    wall = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, -3], [0, 0, 0, 1]])
    return scene([(K.RECTANGLE, [2.0, 2.0], wall, 0)], camera=FLAT, prepare=material)


def summed(color: float, samples: int, backend: str) -> float:
    """The sum that a backend makes of one pixel's samples, before anything is rounded to float32."""
    film = Film(np.zeros((1, 1, 3)), np.zeros((1, 1)), np.zeros((1, 1), np.int64))
    first, count = np.zeros((1, 1), np.int64), np.full((1, 1), samples)
    pictures.renderer(shining(color), backend, size=(1, 1), samples=samples).sample(Tile(0, 0, 1, 1), first, count, samples, film)
    return float(film.color[0, 0, 0])


@pytest.mark.long
@pytest.mark.parametrize("backend", ["ray", "raster"])
def test_a_sum_of_large_and_small_samples(measured, backend):
    """Half of 4096 samples are 2²⁵ or, in the other picture, 0: what differs is the sum of the small ones, to the last of them."""
    large, small = summed(2.0**25, 4096, backend), summed(0.0, 4096, backend)
    count = 4096 - small
    stalled = naive.film_sum(1.0, 2**24 + 1000) - 2**24
    values = np.where(np.arange(4096) % 2 == 0, np.float32(2**25), np.float32(1))
    lost = 2048 - (float(np.add.accumulate(values, dtype=np.float32)[-1]) - 2048 * 2.0**25)
    if backend == "ray":
        measured.place(
            43, "many samples, large and small",
            naive=f"f32: {stalled:g} of 1000 samples after 2²⁴ others count; {lost:g} of 2048 ones among 2²⁵ are lost",
            ours=f"float64: {large - count * 2.0**25:g} of {small:g} kept", bound="all of them",
        )  # fmt: skip
    assert stalled == 0
    assert 0 < small < 4096
    assert large == count * 2.0**25 + small


LIT = """
camera(position: [0, 2, 5], look_at: [0, 0.5, 0])
plane(y: 0, material: lambert(checker(#ccc, #333)))
sphere(0.5, center: [0, 0.8, 0], material: phong(#a55, specular: 0.5))
box(0.4, center: [0.9, 0.2, 0], material: mirror())
point([1, 3, 0], intensity: {0!r})
area([-1, 3, 1], look_at: [0, 0, 0], size: 1, luminance: {1!r})
spot([0, 3, 2], look_at: [0, 0, 0], cone: 20deg, intensity: {2!r})
sky(color: #89a, luminance: {3!r})
sphere(0.2, center: [-0.9, 1.2, 0.3], material: emissive(#fda, luminance: {1!r}))
sphere(0.2, center: [-0.5, 0.3, 0.9], material: phong(#5a5, specular: 0.3, shading: "gouraud"))
sun(from: [2, 3, 1], illuminance: {3!r}, angle: 2deg)
directional(from: [-2, 3, 1], illuminance: {3!r})
render(bounces: {4})
"""


def lit(draw, backend: str, factor: float, bounces: int, **how: object) -> image.Image:
    text = LIT.format(0.7 * factor, 0.2 * factor, 0.4 * factor, 0.01 * factor, bounces)
    if backend == "reference":  # which tries every triangle of what is shaded at vertices
        text = text.replace(', shading: "gouraud"', "")
    return draw(text, backend, size=(20, 20), **how)


@pytest.mark.long
@pytest.mark.parametrize("power", [60, -60, 17])
@pytest.mark.parametrize(("backend", "bounces"), [("ray", 0), ("ray", 2), ("raster", 0), ("reference", 2)])
def test_lights_by_powers_of_two(measured, draw, backend, bounces, power):
    plain, bright = (rgb(lit(draw, backend, f, bounces, samples=4)) for f in (1.0, 2.0**power))
    differ = int(np.sum(bright * 2.0**-power != plain))
    if (backend, power, bounces) == ("ray", 60, 2):
        with np.errstate(over="ignore"):
            square = np.float32(1e30) * np.float32(1e30)
        measured.place(
            43, "all lights 2⁶⁰ times as strong", naive=f"1e30² = {square} in f32",
            ours=f"{differ} of {plain.size} numbers are not exactly that", bound="exact",
        )  # fmt: skip
    assert plain.max() > 0
    assert differ == 0


def test_very_bright_pictures_have_an_error():
    """Squares of 1e30 in the metric: float64 has room for them."""
    picture, reference = np.full((4, 4, 3), 1.01e30, np.float32), np.full((4, 4, 3), 1e30, np.float32)
    assert metrics.root_relmse(picture, reference) == pytest.approx(0.01, rel=1e-3)


@pytest.mark.parametrize("power", [-60, -80])
def test_the_estimated_error_of_dim_lights(measured, draw, power):
    plain, dim = (lit(draw, "ray", f, 0, samples=16).metadata["error"] for f in (1.0, 2.0**power))
    if power == -60:
        measured.place(
            43, "the error estimated for lights 2⁻⁶⁰ times as strong", naive="f32 squares vanish below 1e-45",
            ours=f"{dim:.4%} instead of {plain:.4%}", bound="the same: it is relative"
        )  # fmt: skip
    assert dim == pytest.approx(plain, rel=1e-6)


# --- 44: half floats -----------------------------------------------------------------------------------------------------------------


def written(tmp_path: Path, values: np.ndarray) -> tuple[np.ndarray, str]:
    """What a picture of these grey values holds after it has been written and read, and the file's number type."""
    rgba = np.repeat(values.astype(np.float32)[None, :, None], 4, axis=2)
    rgba[..., 3] = 1
    path = tmp_path / "a.exr"
    image_files.write(image.Image(len(values), 1, {"rgba": rgba}, {}), path, image_files.Look(), {"version": "0"})
    source = oiio.ImageInput.open(str(path))
    assert source is not None
    kind = str(source.spec().format)
    source.close()
    return image_reader.read(path).channels["rgba"][0, :, 0], kind


def test_values_beyond_half_floats(measured, tmp_path):
    values = np.array([65504.0, 65520.0, 1e6, 3e38, 6e-8, 1e-30], np.float32)
    with np.errstate(over="ignore"):
        half = values.astype(np.float16)
    kept, kind = written(tmp_path, values)
    measured.place(
        44, "65520, 10⁶ and 10⁻³⁰ in a picture file", naive=f"half: {half[1]}, {half[2]}, {half[5]}",
        ours=f"{kind}: {kept[1]:g}, {kept[2]:g}, {kept[5]:g}", bound="unchanged",
    )  # fmt: skip
    assert np.isinf(half[1])
    assert kind == "float"
    assert np.array_equal(kept, values)


@given(st.lists(st.floats(0, 2.0**127, width=32), min_size=1, max_size=20))
@settings(max_examples=15, deadline=None)
def test_any_float_survives_its_file(tmp_path_factory, values):
    kept, _ = written(tmp_path_factory.mktemp("exr"), np.array(values, np.float32))
    assert np.array_equal(kept, np.array(values, np.float32))


def test_what_overflowed_in_others_halves_is_flagged(measured, load, tmp_path):
    """A texture whose half floats are infinite."""
    with np.errstate(over="ignore"):
        pixels = np.full((2, 2, 3), 65520.0).astype(np.float16)
    out = oiio.ImageOutput.create(str(tmp_path / "a.exr"))
    assert out is not None
    assert out.open(str(tmp_path / "a.exr"), oiio.ImageSpec(2, 2, 3, "half"))
    assert out.write_image(pixels)
    out.close()
    loaded, said = load('camera(position: [0, 0, 3])\nsphere(1, material: emissive(image("a.exr")))\n')
    measured.place(
        44, "a picture file whose halves have overflowed", naive="infinite pixels",
        ours=f"drawn as {loaded.tables.images.texels[0, 0]:.2g}; message: {'; '.join(said) or 'nothing'}", bound="flagged",
    )  # fmt: skip
    assert said == ["4 of 4 pixels of the picture `a.exr` are infinite or no numbers"]


def test_what_halves_cannot_hold_is_no_trouble_in_floats(load, tmp_path):
    write_image(tmp_path / "a.exr", np.full((2, 2, 3), 65520.0, np.float32))
    loaded, said = load('camera(position: [0, 0, 3])\nsphere(1, material: emissive(image("a.exr")))\n')
    assert said == []
    assert (loaded.tables.images.texels[:, :3] == 65520).all()


# --- 45: empty and enormous pictures -----------------------------------------------------------------------------------------------------

DISC = "camera(position: [0, 0, 5], look_at: [0, 0, 0], width: 2)\nsphere(1, material: emissive(1))\n"
BLUE = (0.25, 0.5, 0.75)


@pytest.mark.parametrize("size", [32768, 65536])
@pytest.mark.parametrize("backend", ["raster", "ray", "reference"])
def test_crops_of_an_enormous_picture(measured, draw, size, backend):
    """At the edge of a ball that fills it: the sample set of its equation, in whole numbers; far from it the background, exactly."""
    j, i = np.mgrid[size - 16 : size, size // 2 - 4 : size // 2 + 12]
    inside = (2 * i + 1 - size) ** 2 + (2 * j + 1 - size) ** 2 <= size * size
    edge = draw(DISC, backend, size=(size, size), crop=(size // 2 - 4, size - 16, size // 2 + 12, size), background=BLUE)
    corner = draw(DISC, backend, size=(size, size), crop=(size - 8, size - 8, size, size), background=BLUE, samples=4)
    wrong = int(np.sum((edge.channels["rgba"][..., 3] == 1) != inside))
    if (backend, size) == ("ray", 32768):
        measured.place(
            45, "the last pixels of a picture of 32768²", naive=f"int32: pixel {naive.pixel_index(size - 1, size - 1, size, 3)}",
            ours=f"{wrong} of 256 samples at the ball's edge wrong; background exact", bound="0",
        )  # fmt: skip
    assert naive.pixel_index(32767, 32767, 32768, 3) < 0
    assert inside.any()
    assert wrong <= (2 if backend == "raster" else 0)
    assert (corner.channels["rgba"] == np.array([*BLUE, 0], np.float32)).all()


@pytest.mark.parametrize("backend", ["raster", "ray", "reference"])
def test_nothing_in_pictures_of_any_size(draw, backend):
    for size in ((1, 1), (1, 77), (65, 3)):
        drawn = draw("camera(position: [0, 0, 5], look_at: [0, 0, 0])\n", backend, size=size, background=BLUE, samples=2)
        assert drawn.channels["rgba"].shape == (size[1], size[0], 4)
        assert (drawn.channels["rgba"] == np.array([*BLUE, 0], np.float32)).all()


def in_little_memory(tmp_path: Path, side: int, gigabytes: float) -> str:
    """The last line that drawing an empty picture of side² says with that much address space, '' when it succeeds."""
    (tmp_path / "a.scene").write_text("camera(position: [0, 0, 5], look_at: [0, 0, 0])\n", encoding="utf-8")
    program = f"""
        import resource, sys
        resource.setrlimit(resource.RLIMIT_AS, ({int(gigabytes * 2**30)},) * 2)
        from maquette.cli.main import main
        sys.argv[1:] = "render a.scene --size {side}x{side} --samples 1 --backend raster --quiet -o a.exr".split()
        main()
    """
    command = [sys.executable, "-c", textwrap.dedent(program)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=1200, cwd=tmp_path)
    return "" if done.returncode == 0 else (done.stderr.strip().splitlines() or ["it ended"])[-1]


@pytest.mark.long
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="address space is limited as Linux does it")
def test_an_enormous_picture_in_little_memory(measured, tmp_path):
    said = in_little_memory(tmp_path, 16384, 4.0)
    measured.place(
        45, "an empty picture of 16384² in 4 GB", naive="held as a whole, RGBA float32: 4.3 GB", bound="drawn",
        ours=said or "drawn strip by strip into its file",
    )  # fmt: skip
    assert not said
    source = oiio.ImageInput.open(str(tmp_path / "a.exr"))
    assert source is not None
    assert (source.spec().width, source.spec().height) == (16384, 16384)
    last = np.asarray(source.read_scanlines(16380, 16384, 0, 0, 4, oiio.FLOAT))
    assert (last == np.array([0.25, 0.25, 0.25, 0.0], np.float32)).all()  # the sky that lights what has no light
    source.close()


def test_what_a_picture_of_32768_takes():
    """The naive count overflows int32, ours is Python's and numpy's own."""
    assert 3 * 32768**2 > 2**31 - 1
    assert pytest.approx(17.2e9, rel=0.01) == 4 * 4 * 32768**2
    assert math.log2(32768 * 32768) == 30
