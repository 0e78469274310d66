"""PNG files that several threads compress: the pixels of other readers, and the same bytes on any number of threads."""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest
from maquette.render.image import image_files, png_stream
from maquette.render.image.image import Image
from PIL import Image as Pillow

LOOKS = image_files.Look(), image_files.Look(bits=16), image_files.Look(alpha=True), image_files.Look(0.3, bits=16, alpha=True)
SIZES = (1, 1), (1, 700), (900, 1), (333, 517)


def picture(rows: int, columns: int, seed: int = 3) -> Image:
    rng = np.random.default_rng(seed)
    smooth = np.linspace(0.0, 1.0, columns)[None, :, None] + 0.1 * rng.random((rows, columns, 4))
    return Image(columns, rows, {"rgba": smooth.astype(np.float32)}, {})


@pytest.mark.parametrize("look", LOOKS)
@pytest.mark.parametrize("size", SIZES)
def test_pixels_are_read_as_they_were(size: tuple[int, int], look: image_files.Look, tmp_path: Path) -> None:
    image, path = picture(*size), tmp_path / "a.png"
    codes = image_files.display(image.channels["rgba"], look)
    files = []
    for threads in (1, 3):
        image_files.write(image, path, look, {"version": "1", "command": "a b"}, threads)
        files.append(path.read_bytes())
    assert files[0] == files[1]
    configuration = oiio.ImageSpec()
    configuration.attribute("oiio:UnassociatedAlpha", 1)
    source: Any = oiio.ImageInput.open(str(path), configuration)
    kind = oiio.UINT8 if look.bits == 8 else oiio.UINT16
    assert np.array_equal(source.read_image(0, 0, 0, codes.shape[2], kind), codes)
    assert source.spec().get_string_attribute("ImageDescription") == "a b"
    if look.bits == 8:
        with Pillow.open(path) as read:
            assert np.array_equal(np.asarray(read), codes)


def test_strips_make_one_picture(tmp_path: Path) -> None:
    image, path, other = picture(400, 300), tmp_path / "a.png", tmp_path / "b.png"
    image_files.write(image, path, image_files.Look(), {})
    with image_files.Strips(other, image_files.Look(), {}, 400, 2) as file:
        for top, bottom in ((0, 1), (1, 170), (170, 400)):
            file.add(Image(300, bottom - top, {"rgba": image.channels["rgba"][top:bottom]}, {}))
    with Pillow.open(path) as first, Pillow.open(other) as second:
        assert np.array_equal(np.asarray(first), np.asarray(second))


def test_an_unfinished_picture_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    image_files.write(picture(8, 8), path, image_files.Look(), {})
    old = path.read_bytes()
    with pytest.raises(OSError, match="it has no pixels"), image_files.Strips(path, image_files.Look(), {}, 20) as file:
        file.add(picture(8, 8))
    assert path.read_bytes() == old
    assert [each.name for each in tmp_path.iterdir()] == ["a.png"]


def test_sums_of_parts_make_that_of_the_whole() -> None:
    data = np.random.default_rng(1).bytes(200_000)
    for cut in (0, 1, 5552, 65521, 199_999, 200_000):
        assert png_stream.combine(zlib.adler32(data[:cut]), zlib.adler32(data[cut:]), len(data) - cut) == zlib.adler32(data)


def test_a_picture_is_written_by_as_many_threads_as_drew_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pools: list[int] = []
    pool = png_stream.ThreadPoolExecutor

    def counted(threads: int) -> Any:
        pools.append(threads)
        return pool(threads)

    monkeypatch.setattr(png_stream, "ThreadPoolExecutor", counted)
    for threads in (1, 2, 3):
        image = picture(900, 600)
        image.metadata["threads"] = threads
        image_files.write(image, tmp_path / "a.png", image_files.Look(), {})
    assert pools == [2, 3]
