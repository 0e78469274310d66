"""Pictures as textures: every format to linear float32 r, g, b, a; alpha unassociated; from disk as from memory; refusals."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from maquette.compiler.importers import images
from maquette.compiler.scene import builder as scene_builder
from maquette.lang.diagnostics import Diagnostics
from PIL import Image, ImageCms
from PIL.PngImagePlugin import PngInfo

from ...files import write_image


def linear(value: float) -> float:
    return value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4


def read(path: Path, space: str = "auto", odd: int = 0) -> np.ndarray:
    """Read from disk, checked to be the same from memory; `odd` pixels are not finite."""
    made, found, faults, _ = images.read(str(path), path.name, space)
    held, again, _, _ = images.read(path.read_bytes(), path.name, space)
    assert np.array_equal(made, held)
    assert found == again == odd
    assert faults == ()
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
    texels, _, _, _ = images.read(str(tmp_path / "a.exr"), "a.exr")
    assert texels[..., 0].tolist() == expected
    assert texels[..., 3].tolist() == expected


def write_exr(path: Path, names: tuple[str, ...], pixels: np.ndarray | None = None) -> Path:
    """An EXR of 2 by 1 pixels: the channels are 1, 2, 3 … in the order of `names`."""
    spec = oiio.ImageSpec(2, 1, len(names), "float")
    spec.channelnames = names
    out = oiio.ImageOutput.create(str(path))
    assert out is not None
    assert out.open(str(path), spec)
    assert out.write_image(np.tile(np.arange(1, len(names) + 1, dtype=np.float32), (1, 2, 1)) if pixels is None else pixels)
    out.close()
    return path


def told(path: Path) -> list[tuple[str, str, str]]:
    """Severity, message and hint of all diagnostics of an image, the same from disk and from memory."""
    made = []
    for add in (
        lambda builder: images.row(builder, path),
        lambda builder: images.row_from_bytes(builder, path.read_bytes(), path.name),
    ):
        found = Diagnostics()
        add(scene_builder.SceneBuilder(found))
        made.append([(d.severity, d.message, d.hint) for d in found.items])
    assert made[0] == made[1]
    return made[0]


OTHERS = "to draw them, write them to files of their own"
ANOTHER = "to draw another, write it to a file of its own"
NO_RGB, NAME_THEM = "the picture `a.exr` has no channels R, G and B: ", "name the channels to draw R, G and B"


@pytest.mark.parametrize(
    ("names", "color", "messages"),
    [
        (("R", "G", "B"), [1, 2, 3, 1], []),
        (("R", "G", "B", "A"), [1 / 4, 2 / 4, 3 / 4, 4], []),
        (("Y",), [1, 1, 1, 1], []),
        (("Y", "A"), [1 / 2, 1 / 2, 1 / 2, 2], []),
        (("R", "G"), [1, 2, 0, 1], []),
        (
            ("R", "G", "B", "A", "depth.Z", "mask"),
            [1 / 4, 2 / 4, 3 / 4, 4],
            [("of the picture `a.exr`, the channels `mask`, `depth.Z` are not drawn", OTHERS)],
        ),
        (("R", "G", "B", "mask"), [1, 2, 3, 1], [("of the picture `a.exr`, the channel `mask` is not drawn", OTHERS)]),
        (("Z",), [1, 1, 1, 1], [(f"{NO_RGB}`Z` is drawn as grey", NAME_THEM)]),
        (("u", "v"), [1, 2, 0, 1], [(f"{NO_RGB}`u` and `v` are drawn as red and green", NAME_THEM)]),
        (("X", "Y", "Z"), [1, 2, 3, 1], [(f"{NO_RGB}`X`, `Y` and `Z` are drawn as red, green and blue", NAME_THEM)]),
        (("A",), [1, 1, 1, 1], [(f"{NO_RGB}it is drawn white, with its alpha", NAME_THEM)]),
        (
            ("diffuse.R", "diffuse.G", "diffuse.B", "diffuse.A"),
            [1 / 4, 2 / 4, 3 / 4, 4],
            [(f"{NO_RGB}`diffuse.R`, `diffuse.G` and `diffuse.B` are drawn as red, green and blue", NAME_THEM)],
        ),
        (
            ("albedo.R", "albedo.G", "albedo.B", "v.Combined.R", "v.Combined.G", "v.Combined.B", "v.Depth.Z"),
            [4, 5, 6, 1],
            [
                (f"{NO_RGB}`v.Combined.R`, `v.Combined.G` and `v.Combined.B` are drawn as red, green and blue", NAME_THEM),
                ("of the picture `a.exr`, the channels `albedo.R`, `albedo.G`, `albedo.B`, `v.Depth.Z` are not drawn", OTHERS),
            ],
        ),
    ],
)  # fmt: skip
def test_channels_of_an_exr_are_selected_by_name(tmp_path, names, color, messages):
    path = write_exr(tmp_path / "a.exr", names)
    assert images.read(str(path), "a.exr").texels[0, 0] == pytest.approx(color)
    assert told(path) == [("warning", *message) for message in messages]


@pytest.mark.parametrize("names", list(itertools.permutations(["G", "B", "A", "z"], 4)))
def test_an_exr_without_red_is_drawn_wherever_its_alpha_is(tmp_path: Path, names: tuple[str, ...]) -> None:
    path = write_exr(tmp_path / "a.exr", names)
    opened = oiio.ImageInput.open(str(path))
    assert opened is not None
    stored = [str(name) for name in opened.spec().channelnames]
    inks = [name for name in stored if name != "A"]
    shown = f"{NO_RGB}`{inks[0]}`, `{inks[1]}` and `{inks[2]}` are drawn as red, green and blue"
    assert told(path) == [("warning", shown, NAME_THEM)]
    value = dict(zip(names, (1, 2, 3, 4), strict=True))
    assert images.read(str(path), "a.exr").texels[0, 0] == pytest.approx([*(value[k] / value["A"] for k in inks), value["A"]])


def test_names_of_channels_and_messages_that_are_not_utf_8(tmp_path: Path) -> None:
    path = write_exr(tmp_path / "a.exr", ("R", "G", "B", "tiefeX"))
    path.write_bytes(path.read_bytes().replace(b"tiefeX", b"tief\xe9\xff"))
    assert told(path) == [("warning", "of the picture `a.exr`, the channel `tieféÿ` is not drawn", OTHERS)]
    path.write_bytes(path.read_bytes().replace(b"channels\0chlist", b"chan\xe9\xffls\0ch\xe9\xffst"))
    with pytest.raises(images.ImageError) as caught:
        told(path)
    assert caught.value.message == "cannot read the picture `a.exr`"


def test_further_parts_of_an_exr_are_counted(tmp_path: Path) -> None:
    path, specs = tmp_path / "a.exr", []
    for name in ("one", "two", "three"):
        specs.append(oiio.ImageSpec(2, 1, 3, "half"))
        specs[-1].attribute("oiio:subimagename", name)
    out = oiio.ImageOutput.create(str(path))
    assert out is not None
    assert out.open(str(path), tuple(specs))
    for k, spec in enumerate(specs):
        assert k == 0 or out.open(str(path), spec, "AppendSubimage")
        assert out.write_image(np.ones((1, 2, 3), np.float32))
    out.close()
    assert told(path) == [("warning", "of the picture `a.exr`, 2 further parts are not drawn", OTHERS)]


def test_pixels_that_are_not_finite_are_counted(tmp_path: Path) -> None:
    path = write_exr(tmp_path / "a.exr", ("R", "G", "B"), np.array([[[np.nan, np.inf, 1.0], [0.5, 0.5, 0.5]]], np.float32))
    hint = "they are drawn as 3.4e+38 and as 0; half floats end at 65504: write it as float"
    assert told(path) == [("warning", "1 of 2 pixels of the picture `a.exr` are infinite or no numbers", hint)]


@pytest.mark.parametrize(("name", "noun"), [("a.gif", "frames"), ("a.webp", "frames"), ("a.png", "frames"), ("a.tif", "pages")])
def test_further_frames_and_pages_are_counted(tmp_path: Path, name: str, noun: str) -> None:
    first, *others = (Image.new("RGB", (4, 4), color) for color in ("#ff0000", "#00ff00", "#0000ff"))
    first.save(tmp_path / name, save_all=True, append_images=others)
    assert told(tmp_path / name) == [("warning", f"the picture `{name}` has 3 {noun}: the first is drawn", ANOTHER)]
    assert images.read(str(tmp_path / name), name).texels[0, 0] == pytest.approx([1, 0, 0, 1], abs=0.02)


def test_sizes_of_an_icon_are_counted(tmp_path: Path) -> None:
    Image.new("RGB", (32, 32)).save(tmp_path / "a.ico", sizes=[(16, 16), (32, 32)])
    assert told(tmp_path / "a.ico") == [("warning", "the picture `a.ico` has 2 sizes: the first is drawn", ANOTHER)]


def test_smaller_copies_are_no_pages(tmp_path: Path) -> None:
    """MIP maps that OpenImageIO writes, and copies with bit 0 of NewSubfileType."""
    pixels = np.random.default_rng(1).integers(0, 256, (16, 16, 3)).astype(np.uint8)
    source = oiio.ImageBuf(str(write_image(tmp_path / "p.png", pixels)))
    for name in ("mip.tif", "mip.exr"):
        assert oiio.ImageBufAlgo.make_texture(oiio.MakeTxTexture, source, str(tmp_path / name))
        assert told(tmp_path / name) == []
    small = Image.new("RGB", (2, 2))
    small.encoderinfo = {"tiffinfo": {254: 1}}
    Image.new("RGB", (4, 4)).save(tmp_path / "copy.tif", save_all=True, append_images=[small])
    assert told(tmp_path / "copy.tif") == []


@pytest.mark.parametrize("progressive", [False, True])
def test_a_jpeg_that_is_cut_off(tmp_path: Path, progressive: bool) -> None:
    noise = np.random.default_rng(1).integers(0, 256, (64, 64, 3)).astype(np.uint8)
    path = tmp_path / "a.jpg"
    Image.fromarray(noise).save(path, progressive=progressive)
    assert told(path) == []
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    hint = "the missing part is drawn grey or blurred: copy or write the file again"
    assert told(path) == [("warning", "the picture `a.jpg` is cut off: its file ends early", hint)]


def test_a_jpeg_whose_thumbnail_is_whole_is_cut_off(tmp_path: Path) -> None:
    """The thumbnail in the EXIF segment has an end of its own."""
    noise = Image.fromarray(np.random.default_rng(1).integers(0, 256, (64, 64, 3)).astype(np.uint8))
    noise.resize((16, 16)).save(tmp_path / "small.jpg")
    noise.save(tmp_path / "a.jpg", exif=b"Exif\0\0" + (tmp_path / "small.jpg").read_bytes())
    data = (tmp_path / "a.jpg").read_bytes()
    assert told(tmp_path / "a.jpg") == []
    (tmp_path / "a.jpg").write_bytes(data[:-100])
    assert [message for _, message, _ in told(tmp_path / "a.jpg")] == ["the picture `a.jpg` is cut off: its file ends early"]


@pytest.mark.parametrize("name", ["a.png", "a.tif", "a.webp", "a.bmp", "a.tga", "a.gif", "a.hdr", "a.exr", "a.ppm"])
def test_half_a_picture_of_other_formats_is_refused(tmp_path: Path, name: str) -> None:
    noise = np.random.default_rng(1).integers(0, 256, (64, 64, 3)).astype(np.uint8)
    if name in ("a.exr", "a.hdr"):
        data = write_image(tmp_path / name, noise.astype(np.float32)).read_bytes()
    else:
        Image.fromarray(noise).save(tmp_path / name)
        data = (tmp_path / name).read_bytes()
    with pytest.raises(images.ImageError) as caught:
        images.read(data[: len(data) // 2], name)
    assert caught.value.message in (f"the picture `{name}` is damaged", f"cannot read the picture `{name}`")
    assert caught.value.hint


def test_an_orientation_is_left_out(tmp_path: Path) -> None:
    exif = Image.Exif()
    exif[0x112] = 6
    Image.new("RGB", (4, 2)).save(tmp_path / "a.jpg", exif=exif)
    message = "the picture `a.jpg` is drawn as it is stored: its orientation 6 is left out"
    assert told(tmp_path / "a.jpg") == [("warning", message, "turn it and write it again")]


def profile(name: str) -> bytes:
    """The ICC profile of sRGB under a name of as many letters."""
    made = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    return made.replace("sRGB built-in".encode("utf-16-be"), name.encode("utf-16-be"))


@pytest.mark.parametrize("ending", ["png", "jpg", "tif", "webp"])
def test_a_profile_of_another_space_is_left_out(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"a.{ending}"
    Image.new("RGB", (4, 4)).save(path, icc_profile=profile("sRGB built-in"))
    assert told(path) == []
    Image.new("RGB", (4, 4)).save(path, icc_profile=profile("Display P3 (D"))
    message = f"the colours of the picture `{path.name}` are drawn as sRGB, and not by its profile `Display P3 (D`"
    assert told(path) == [("warning", message, "convert it to sRGB and write it again")]
    assert images.read(str(path), path.name, "linear").faults == ()


@pytest.mark.parametrize(
    ("gamma", "red", "chunk", "instead"),
    [
        (45455, 64000, b"", ""), (45000, 64000, b"", ""), (100000, 64000, b"", "its gamma of 1"), (55556, 64000, b"", "its gamma of 1.8"),
        (45455, 70800, b"", "its primaries"), (100000, 70800, b"sRGB", ""),
    ],
)  # fmt: skip
def test_gamma_and_primaries_of_a_png_are_left_out(tmp_path: Path, gamma: int, red: int, chunk: bytes, instead: str) -> None:
    info = PngInfo()
    if chunk:
        info.add(chunk, b"\0")
    info.add(b"gAMA", gamma.to_bytes(4, "big"))
    info.add(b"cHRM", b"".join(n.to_bytes(4, "big") for n in (31270, 32900, red, 33000, 30000, 60000, 15000, 6000)))
    Image.new("RGB", (4, 4)).save(tmp_path / "a.png", pnginfo=info)
    message = f"the colours of the picture `a.png` are drawn as sRGB, and not by {instead}"
    assert told(tmp_path / "a.png") == ([("warning", message, "convert it to sRGB and write it again")] if instead else [])


def test_a_gif_keeps_its_holes(tmp_path: Path) -> None:
    Image.fromarray(np.array([[[255, 0, 0, 255], [0, 0, 0, 0]]], np.uint8), "RGBA").save(tmp_path / "a.gif")
    assert read(tmp_path / "a.gif")[0].tolist() == [[1, 0, 0, 1], [0, 0, 0, 0]]


@pytest.mark.parametrize(
    ("mode", "ink", "seen"),
    [("CMYK", (0, 255, 255, 0), (1.0, 0.0, 0.0)), ("CMYK", (0, 0, 0, 255), (0.0, 0.0, 0.0)), ("L", 255, (1.0, 1.0, 1.0))],
)
def test_jpeg_in_inks_or_grey_is_read_as_light(tmp_path: Path, mode: str, ink: int | tuple[int, ...], seen: tuple[float, ...]) -> None:
    Image.new(mode, (8, 8), ink).save(tmp_path / "a.jpg", quality=100)
    assert read(tmp_path / "a.jpg")[..., :3].reshape(-1, 3) == pytest.approx(np.tile(seen, (64, 1)), abs=0.02)
