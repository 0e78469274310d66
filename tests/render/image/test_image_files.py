"""Tests of image files: sRGB, bit depths, alpha, channels, metadata, metering and atomic writes."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest
from hypothesis import given
from hypothesis import strategies as st
from maquette.lang import colors
from maquette.render.image import image_files, image_reader, srgb
from maquette.render.image.image import Image

ABOUT = {"command": "maquette render a.scene", "version": "1.2.3", "seed": 7, "samples": 16, "backend": "ray", "exposure": 0.5}


def picture(rgba: object, **channels: object) -> Image:
    array = np.asarray(rgba, dtype=np.float32)
    more = {name: np.asarray(values, dtype=np.float32) for name, values in channels.items()}
    return Image(array.shape[1], array.shape[0], {"rgba": array, **more}, {})


def raw(path: Path) -> tuple[oiio.ImageSpec, np.ndarray]:
    """The numbers as they stand in the file."""
    configuration = oiio.ImageSpec()
    configuration.attribute("oiio:UnassociatedAlpha", 1)
    source = oiio.ImageInput.open(str(path), configuration)
    assert source is not None
    spec = source.spec()
    values = np.asarray(source.read_image(spec.format)).reshape(spec.height, spec.width, -1)
    source.close()
    return spec, values


def test_what_a_picture_is_about_comes_back(tmp_path: Path) -> None:
    """Channels, the place of a crop and the attributes: what compares pictures asks for them."""
    ids = np.array([[[0, 1], [2, -1]]])
    drawn = Image(2, 1, picture([[[1, 1, 1, 1], [0, 0, 0, 0]]], id=ids).channels, {"size": (10, 8), "crop": (3, 4, 5, 5)})
    image_files.write(drawn, tmp_path / "a.exr", image_files.Look(), ABOUT)
    image_files.write(drawn, tmp_path / "a.png", image_files.Look(bits=16), ABOUT)
    exr, png = (image_reader.read(tmp_path / name) for name in ("a.exr", "a.png"))
    assert exr.channels["id"].tolist() == ids.tolist()
    assert (exr.metadata["size"], exr.metadata["crop"], exr.metadata["bits"]) == ((10, 8), (3, 4, 5, 5), 0)
    assert (exr.metadata["alpha"], png.metadata["alpha"]) == (True, False)
    assert (exr.metadata["alpha"], png.metadata["alpha"]) == (True, False)
    assert (png.metadata["size"], png.metadata["crop"], png.metadata["bits"]) == ((2, 1), (0, 0, 2, 1), 16)
    assert (exr.metadata["about"]["seed"], float(png.metadata["about"]["exposure"])) == ("7", 0.5)


def test_all_256_codes_come_back(tmp_path: Path) -> None:
    codes = np.arange(256)
    grey = srgb.decode_srgb(codes / 255).reshape(16, 16, 1)
    rgba = np.concatenate([np.repeat(grey, 3, axis=2), np.ones((16, 16, 1))], axis=2)
    image_files.write(picture(rgba), tmp_path / "codes.png", image_files.Look(), ABOUT)
    _, values = raw(tmp_path / "codes.png")
    assert np.array_equal(values[..., 0].ravel(), codes)
    again = image_reader.read(tmp_path / "codes.png")
    image_files.write(again, tmp_path / "again.png", image_files.Look(), ABOUT)
    assert np.array_equal(raw(tmp_path / "again.png")[1], values)


@given(st.floats(0, 1))
def test_decoding_undoes_encoding(value: float) -> None:
    assert srgb.decode_srgb(srgb.encode_srgb(np.array([value])))[0] == pytest.approx(value, abs=1e-7)


def test_light_that_is_no_number_is_not_white_noise(tmp_path: Path) -> None:
    rgba = [[[np.nan, np.inf, -np.inf, 1.0], [-1.0, 2.0, 1e30, 1.0]]]
    image_files.write(picture(rgba), tmp_path / "odd.png", image_files.Look(), ABOUT)
    assert raw(tmp_path / "odd.png")[1].tolist() == [[[0, 255, 0], [0, 255, 255]]]


@pytest.mark.parametrize(("bits", "grey"), [(8, 188), (16, 48192)])
@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_depths(tmp_path: Path, suffix: str, bits: int, grey: int) -> None:
    path = tmp_path / f"half{suffix}"
    image_files.write(picture([[[0.5, 0.5, 0.5, 1.0]]]), path, image_files.Look(bits=bits), ABOUT)
    spec, values = raw(path)
    assert spec.format.basesize() * 8 == bits
    assert values.tolist() == [[[grey] * 3]]


def test_exposure_is_in_stops(tmp_path: Path) -> None:
    for stops, code in ((0.0, 188), (1.0, 255), (-1.0, 137)):
        image_files.write(picture([[[0.5, 0.5, 0.5, 1.0]]]), tmp_path / "x.png", image_files.Look(exposure=stops), ABOUT)
        assert raw(tmp_path / "x.png")[1][0, 0, 0] == code


def test_png_alpha_is_unassociated_and_only_there_when_asked(tmp_path: Path) -> None:
    half = picture([[[0.25, 0.25, 0.25, 0.5], [0.0, 0.0, 0.0, 0.0]]])
    image_files.write(half, tmp_path / "with.png", image_files.Look(alpha=True), ABOUT)
    assert raw(tmp_path / "with.png")[1].tolist() == [[[188, 188, 188, 128], [0, 0, 0, 0]]]
    image_files.write(half, tmp_path / "without.png", image_files.Look(), ABOUT)
    assert raw(tmp_path / "without.png")[1].tolist() == [[[137, 137, 137], [0, 0, 0]]]
    back = image_reader.read(tmp_path / "with.png").channels["rgba"]
    np.testing.assert_allclose(back[0, 0], [0.2523, 0.2523, 0.2523, 128 / 255], atol=1e-3)


def test_png_rows_are_differences(tmp_path: Path) -> None:
    """All by the same filter, which is what makes them quick to write: trying five for each row takes longer than packing them."""
    image_files.write(picture(np.random.default_rng(1).random((9, 8, 4))), tmp_path / "x.png", image_files.Look(), ABOUT)
    data = (tmp_path / "x.png").read_bytes()
    offset, packed = 8, b""
    while offset < len(data):
        size, kind = int.from_bytes(data[offset : offset + 4]), data[offset + 4 : offset + 8]
        packed += data[offset + 8 : offset + 8 + size] if kind == b"IDAT" else b""
        offset += 12 + size
    assert set(zlib.decompress(packed)[:: 1 + 3 * 8]) == {1}


def test_jpeg_is_over_black(tmp_path: Path) -> None:
    image_files.write(picture(np.full((8, 8, 4), 0.25)), tmp_path / "x.jpg", image_files.Look(alpha=True), ABOUT)
    spec, values = raw(tmp_path / "x.jpg")
    assert spec.nchannels == 3
    assert abs(int(values[4, 4, 0]) - 137) <= 1


def test_exr_is_linear_float_with_named_channels(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    h, w = 3, 5
    widths = {"rgba": 4, "depth": 1, "normal": 3, "position": 3, "albedo": 3, "uv": 2, "id": 2}
    channels = {name: rng.normal(size=(h, w, k)).astype(np.float32) for name, k in widths.items()}
    channels["depth"][0, 0] = np.inf
    channels["rgba"][0, 0, 0] = 70000.0  # more than half floats hold
    image = Image(w, h, dict(reversed(channels.items())), {})
    image_files.write(image, tmp_path / "x.exr", image_files.Look(exposure=3.0, view="sRGB"), ABOUT)
    spec, values = raw(tmp_path / "x.exr")
    names = ["R", "G", "B", "A", "depth.Z", "normal.X", "normal.Y", "normal.Z", "position.X", "position.Y", "position.Z"]
    names += ["albedo.R", "albedo.G", "albedo.B", "uv.U", "uv.V", "id.instance", "id.material"]
    assert sorted(spec.channelnames) == sorted(names)
    assert spec.format == oiio.FLOAT
    stacked = np.concatenate(list(channels.values()), axis=2)
    for i, name in enumerate(names):
        assert np.array_equal(values[..., list(spec.channelnames).index(name)], stacked[..., i]), name
    assert np.array_equal(image_reader.read(tmp_path / "x.exr").channels["rgba"], channels["rgba"])


def test_a_crop_stands_at_its_place(tmp_path: Path) -> None:
    image = Image(3, 2, {"rgba": np.ones((2, 3, 4), np.float32)}, {"crop": (4, 5, 7, 7), "size": (32, 24)})
    image_files.write(image, tmp_path / "x.exr", image_files.Look(), ABOUT)
    spec, _ = raw(tmp_path / "x.exr")
    assert (spec.x, spec.y, spec.width, spec.height) == (4, 5, 3, 2)
    assert (spec.full_x, spec.full_y, spec.full_width, spec.full_height) == (0, 0, 32, 24)
    assert image_reader.read(tmp_path / "x.exr").width == 3


@pytest.mark.parametrize("suffix", [".exr", ".png", ".tif"])
def test_metadata_says_how_it_was_made(tmp_path: Path, suffix: str) -> None:
    image_files.write(picture(np.ones((2, 2, 4))), tmp_path / f"x{suffix}", image_files.Look(), ABOUT)
    spec, _ = raw(tmp_path / f"x{suffix}")
    assert spec.getattribute("Software") == "maquette 1.2.3"
    assert spec.getattribute("ImageDescription") == ABOUT["command"]
    if suffix != ".tif":
        assert {key: str(spec.getattribute(f"maquette:{key}")) for key in ABOUT} == {key: str(value) for key, value in ABOUT.items()}
    if suffix == ".exr":
        assert spec.getattribute("maquette:seed") == 7


@pytest.mark.parametrize("suffix", [".exr", ".png", ".jpg", ".tif"])
def test_one_pixel(tmp_path: Path, suffix: str) -> None:
    image_files.write(picture([[[1.0, 1.0, 1.0, 1.0]]]), tmp_path / f"one{suffix}", image_files.Look(), ABOUT)
    again = image_reader.read(tmp_path / f"one{suffix}")
    assert (again.width, again.height) == (1, 1)
    np.testing.assert_allclose(again.channels["rgba"], 1.0, atol=0.02)


def test_a_failed_write_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "x.png"
    image_files.write(picture([[[0.5, 0.5, 0.5, 1.0]]]), path, image_files.Look(), ABOUT)
    before = path.read_bytes()

    def broken(*_: object) -> None:
        raise OSError("the disk is full")

    monkeypatch.setattr(Path, "replace", broken)
    with pytest.raises(OSError, match="the disk is full"):
        image_files.write(picture([[[1.0, 1.0, 1.0, 1.0]]]), path, image_files.Look(), ABOUT)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["x.png"]


def test_metering_brings_the_log_average_to_middle_grey() -> None:
    rng = np.random.default_rng(2)
    rgba = np.concatenate([np.repeat(rng.lognormal(7, 1, (32, 32, 1)), 3, axis=2), np.ones((32, 32, 1))], axis=2)
    exposed = rgba[..., 0] * 2.0 ** image_files.auto_exposure(rgba)
    assert np.exp(np.log(exposed).mean()) == pytest.approx(0.18, rel=0.04)  # random pixels have no middle
    rgba[:16] = 0.0  # what is black says nothing about the light
    assert np.exp(np.log(rgba[16:, :, 0] * 2.0 ** image_files.auto_exposure(rgba)).mean()) == pytest.approx(0.18, rel=0.04)
    assert image_files.auto_exposure(np.zeros((4, 4, 4))) == 0.0


def test_metering_looks_at_what_matters() -> None:
    wall = np.ones((40, 60, 4))
    assert image_files.auto_exposure(wall) == pytest.approx(np.log2(0.18), abs=0.01)
    window = wall.copy()
    window[2:12, 4:16, :3] = 4000.0  # 5 % of the picture, 12 stops brighter
    old = np.log2(0.18) - np.log2(window[..., 0]).mean()
    assert old < -3.0
    assert image_files.auto_exposure(window) > -2.65
    edge = wall.copy()
    edge[:, :20] = 0.0  # nothing, of a picture without a background
    edge[:, 20] = 0.001, 0.001, 0.001, 0.001  # a silhouette that covers a thousandth of its pixels
    assert image_files.auto_exposure(edge) == image_files.auto_exposure(wall)


def test_views_by_closed_forms_roll_highlights_off() -> None:
    for view in ("rolloff", "agx", "aces"):
        grey = np.ones((1, 6, 4), np.float32)
        grey[0, :, :3] = np.array([0.0, 0.18, 1.0, 2.0, 8.0, np.inf])[:, None]
        shown = image_files.display(grey, image_files.Look(view=view))[0, :, 0].astype(int)
        assert shown[0] == 0
        assert (np.diff(shown[:5]) > 0).all()
        assert shown[3] < 254  # not clipped
        assert shown[5] >= 254
    middle = image_files.display(np.full((1, 1, 4), 0.18, np.float32), image_files.Look(view="agx", bits=16))
    assert middle / 65535 == pytest.approx(0.5, abs=0.01)
    same = np.random.default_rng(1).random((4, 4, 4)).astype(np.float32)
    dim = 0.79 * same
    assert (image_files.display(dim, image_files.Look(view="rolloff")) == image_files.display(dim, image_files.Look())).all()
    assert (image_files.display(same, image_files.Look(view="standard")) == image_files.display(same, image_files.Look())).all()


def test_white_balance_makes_the_light_of_its_temperature_white() -> None:
    light = np.ones((1, 1, 4), np.float32)
    light[0, 0, :3] = 0.5 * np.array(colors.kelvin(2700.0))
    r, g, b = image_files.display(light, image_files.Look(white=2700.0))[0, 0]
    assert r == g == b == 188  # sRGB of 0.5: luminance stays
    unbalanced = image_files.display(light, image_files.Look())[0, 0]
    assert unbalanced[0] > unbalanced[2]


def test_other_views_come_from_opencolorio(tmp_path: Path) -> None:
    raw_view = image_files.Look(view="Raw")
    assert "Raw" in image_files.views()
    image_files.write(picture([[[0.5, 0.25, 1.0, 1.0]]]), tmp_path / "raw.png", raw_view, ABOUT)
    assert raw(tmp_path / "raw.png")[1].tolist() == [[[128, 64, 255]]]
    image_files.check(tmp_path / "x.png", look=raw_view)


@pytest.mark.parametrize(
    ("name", "more", "message"),
    [
        ("x.gif", {}, "cannot tell the picture format of x.gif: its name must end in one of .exr, .png, .tif, .tiff, .jpg, .jpeg"),
        ("x", {}, "cannot tell the picture format of x: its name must end in one of .exr, .png, .tif, .tiff, .jpg, .jpeg"),
        ("x.exr", {"bits": 16}, "x.exr holds 32-bit floats: --bits is for 8 and 16-bit pictures"),
        ("x.jpg", {"bits": 16}, ".jpg files have 8 bits a channel, not 16; .png and .tif have 16"),
        ("x.png", {"aov": ("depth", "id")}, "x.png has no room for the channels depth, id: write an .exr"),
    ],
)
def test_what_no_file_can_hold(name: str, more: dict[str, object], message: str) -> None:
    with pytest.raises(image_files.FormatError) as error:
        image_files.check(Path(name), **more)  # type: ignore[arg-type]
    assert str(error.value) == message


def test_an_unknown_view_is_answered_with_the_known_ones() -> None:
    with pytest.raises(image_files.FormatError) as error:
        image_files.check(Path("x.png"), look=image_files.Look(view="Agx"))
    assert str(error.value) == f"no view is called `Agx`; there are: {', '.join(image_files.views())}"


def test_what_is_not_a_picture(tmp_path: Path) -> None:
    with pytest.raises(image_files.FormatError, match="there is no file"):
        image_reader.read(tmp_path / "none.png")
    (tmp_path / "text.png").write_text("no picture", encoding="utf-8")
    with pytest.raises(image_files.FormatError, match=r"text\.png is not a picture"):
        image_reader.read(tmp_path / "text.png")


@pytest.mark.parametrize("gain", [2.0**-60, 2.0**60])
def test_far_from_one_the_numbers_stay(tmp_path: Path, gain: float) -> None:
    values = np.random.default_rng(3).random((4, 4, 4)).astype(np.float32)
    image_files.write(picture(values * gain), tmp_path / "x.exr", image_files.Look(), ABOUT)
    assert np.array_equal(image_reader.read(tmp_path / "x.exr").channels["rgba"], values * np.float32(gain))


@pytest.mark.long
@pytest.mark.parametrize("name", ["a.png", "a.tif", "a.exr", "a.jpg"])
def test_a_file_cut_short_is_an_error_and_the_old_one_stays(tmp_path: Path, name: str) -> None:
    """As on a full disk: libraries that write pictures do not all tell of it."""
    (tmp_path / name).write_bytes(b"old")
    program = f"""
        import resource, numpy as np
        from pathlib import Path
        from maquette.render.image import image_files, image_reader
        from maquette.render.image.image import Image
        pixels = np.random.default_rng(0).random((64, 64, 4), dtype=np.float32)
        resource.setrlimit(resource.RLIMIT_FSIZE, (2048, 2048))
        try:
            image_files.write(Image(64, 64, {{"rgba": pixels}}, {{}}), Path({name!r}), image_files.Look(), {{}})
        except OSError as error:
            print(error)
    """
    done = subprocess.run([sys.executable, "-c", textwrap.dedent(program)], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert done.stdout.startswith(f"cannot write {name}: ")
    assert len(done.stdout.splitlines()) == 1
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_bytes() == b"old"


def test_names_and_commands_need_not_be_utf8(tmp_path: Path) -> None:
    path = tmp_path / os.fsdecode(b"a\xff.exr")
    image_files.write(picture([[[0.5, 0.5, 0.5, 1]]]), path, image_files.Look(), {**ABOUT, "command": os.fsdecode(b"render a\xff.scene")})
    assert path.is_file()
    path.rename(tmp_path / "a.exr")
    assert image_reader.read(tmp_path / "a.exr").metadata["about"]["command"] == "render a\\xff.scene"


@pytest.mark.long
@pytest.mark.parametrize("name", ["a.png", "a.exr", "a.jpg"])
def test_a_full_disk_is_the_reason(tmp_path: Path, name: str) -> None:
    """The messages of libraries do not say it: the free space does."""
    program = f"""
        import resource, shutil, numpy as np
        from pathlib import Path
        from types import SimpleNamespace
        from maquette.render.image import image_files
        from maquette.render.image.image import Image
        pixels = np.random.default_rng(0).random((64, 64, 4), dtype=np.float32)
        resource.setrlimit(resource.RLIMIT_FSIZE, (2048, 2048))
        shutil.disk_usage = lambda path: SimpleNamespace(free=0, total=1)
        try:
            image_files.write(Image(64, 64, {{"rgba": pixels}}, {{}}), Path({name!r}), image_files.Look(), {{}})
        except OSError as error:
            print(error)
    """
    done = subprocess.run([sys.executable, "-c", textwrap.dedent(program)], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert done.stdout == f"cannot write {name}: the disk is full\n"
    assert not list(tmp_path.iterdir())


def test_the_time_of_writing_grows_with_pixels_depth_and_channels() -> None:
    def seconds(name: str, pixels: int, bits: int = 8, **more: Any) -> float:
        return image_files.writing_time(Path(name), pixels, image_files.Look(bits=bits), **more)

    million = 1_000_000
    assert seconds("a.png", 1) < 0.2
    assert seconds("a.png", 27 * million) > 20 * seconds("a.png", million) / 2
    assert seconds("a.png", million) < seconds("a.exr", million) < seconds("a.png", million, 16)
    assert seconds("a.exr", million) < seconds("a.exr", million, aovs=2)
    assert seconds("a.png", million) < seconds("a.png", million, metered=True)
