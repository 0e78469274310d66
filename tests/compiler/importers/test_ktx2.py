"""Pictures in KTX 2 with Basis Universal's codecs, of glTF's KHR_texture_basisu."""

from __future__ import annotations

import base64
import contextlib
import struct

import numpy as np
import pytest
from maquette.compiler.importers import images
from maquette.compiler.importers.images import ImageError
from maquette.compiler.importers.khronos import ktx2
from maquette.lang.distribution import install_command

from ...files import write_image
from .test_gltf_pictures import PICTURE
from .test_mesh_files import glb, read, square

# 12 by 8 pixels in blocks of 4 by 4: red, green, blue, and below a half clear grey and white; sRGB. Encoded by basisu 2.5.
ETC1S = (
    "q0tUWCAyMLsNChoKAAAAAAEAAAAMAAAACAAAAAAAAAAAAAAAAQAAAAEAAAABAAAAaAAAADwAAACkAAAAJAAAAMgAAAAAAAAAnAAAAAAAAABkAQAAAAAAAAcA"
    "AAAAAAAAAAAAAAAAAAA8AAAAAAAAAAIAOACjAQIAAwMAAAgIAAAAAAAAAAA/AAAAAAAAAAAA/////0AAPw8AAAAAAAAAAP////8fAAAAS1RYd3JpdGVyAEJh"
    "c2lzIFVuaXZlcnNhbCAyLjEwAAAGAAIAOAAAAAkAAAAzAAAAAAAAAAAAAAAAAAAAAwAAAAMAAAAEAAAAGEDUgAEAAEDQNBg8ACqAOQEDAACAMExBw8EogCkA"
    "AwAAgCAsfGYDB0AMAAAAAAAIAveaJecvMQCsqqqqUlVVVQUAQYQAAQAAAMhoN5VJDIAJAAIAAIAgaOGGgMgBAgAAQMCUPDyNcKMIACYAAAAAAAAQQADvhDAk"
    "3BsD"
)
UASTC = (
    "q0tUWCAyMLsNChoKAAAAAAEAAAAMAAAACAAAAAAAAAAAAAAAAQAAAAEAAAAAAAAAaAAAACwAAACUAAAALAAAAAAAAAAAAAAAAAAAAAAAAADAAAAAAAAAAGAA"
    "AAAAAAAAYAAAAAAAAAAsAAAAAAAAAAIAKACmAQIAAwMAABAAAAAAAAAAAAB/AwAAAAAAAAAA/////x8AAABLVFh3cml0ZXIAQmFzaXMgVW5pdmVyc2FsIDIu"
    "MTAAAAQAAAB/fwAAV5/C43/6gwAAAAAAAAAAAJcCGeU/BXYAAAAAAAAAAADXg4f7fxxHAwAAAAAAAAAAFxAQEBBACAEAAAAAAAAAABceHv4fdM4BAAAAAAAA"
    "AAAXHh7+H3TOAQAAAAAAAAAA"
)
SAMPLES = {"ETC1S": base64.b64decode(ETC1S), "UASTC": base64.b64decode(UASTC)}
CORNERS = np.array([[250, 20, 30, 255], [30, 60, 220, 255], [128, 128, 128, 128], [240, 240, 240, 255]])  # top left, top right, …
needs_package = pytest.mark.skipif(bool(ktx2.missing()), reason="opengl_basisu has no wheel for this system")


def turned(data: bytes, orientation: bytes) -> bytes:
    """The file with KTXorientation in place of its key/value data, which have room for it."""
    pair = b"KTXorientation\0" + orientation + b"\0"
    values = struct.pack("<I", len(pair)) + pair + bytes(-len(pair) % 4)
    first, room = struct.unpack_from("<II", data, 56)
    assert len(values) <= room
    return data[:60] + struct.pack("<I", len(values)) + data[64:first] + values.ljust(room, b"\0") + data[first + room :]


def corners(texels):
    return np.stack([texels[0, 0], texels[0, -1], texels[-1, 0], texels[-1, -1]])


@needs_package
@pytest.mark.parametrize("codec", SAMPLES)
def test_pixels_lie_as_they_were_encoded(codec):
    pixels = ktx2.decode(SAMPLES[codec], "a.ktx2", 1000)
    assert (pixels.texels.shape, pixels.is_srgb, pixels.others) == ((8, 12, 4), True, 0)
    assert corners(pixels.texels.astype(int)) == pytest.approx(CORNERS, abs=4)


@needs_package
@pytest.mark.parametrize(("written", "order"), [(b"rd", [0, 1, 2, 3]), (b"ru", [2, 3, 0, 1]), (b"ld", [1, 0, 3, 2])])
def test_the_orientation_of_a_file(written, order):
    texels = ktx2.decode(turned(SAMPLES["UASTC"], written), "a.ktx2", 1000).texels
    assert corners(texels.astype(int)).tolist() == CORNERS[order].tolist()


@needs_package
def test_colours_are_decoded_and_data_are_not():
    color, data = (images.read(SAMPLES["UASTC"], "a.ktx2", space, color=space == "auto") for space in ("auto", "linear"))
    assert color.faults == ()
    assert color.texels[0, 0, 0] == pytest.approx(((250 / 255 + 0.055) / 1.055) ** 2.4, rel=1e-5)
    assert color.texels[-1, 0, 3] == pytest.approx(128 / 255)  # alpha is not encoded, and colours are not divided by it
    assert color.texels[-1, 0, 0] == pytest.approx(((128 / 255 + 0.055) / 1.055) ** 2.4, rel=1e-5)
    assert data.texels[0, 0, 0] == pytest.approx(250 / 255)
    assert data.faults == (("the picture `a.ktx2` says that it is sRGB: it is drawn as data", ""),)


@needs_package
def test_damage_is_said():
    content = SAMPLES["ETC1S"]
    for end in (*range(12, 80, 4), *range(80, len(content), 7)):
        with pytest.raises(ImageError, match=r"the picture `a\.ktx2` (is damaged|has no codec)"):
            images.read(content[:end], "a.ktx2")
    generator = np.random.default_rng(7)
    for _ in range(300):  # a changed byte is an error of ours, or changes pixels
        changed = bytearray(content)
        changed[generator.integers(12, len(content))] ^= int(generator.integers(1, 256))
        with contextlib.suppress(ImageError):
            assert np.isfinite(images.read(bytes(changed), "a.ktx2", limit=4096).texels).all()


@needs_package
def test_a_picture_that_is_too_big_is_not_decoded():
    with pytest.raises(ImageError, match=r"the picture `a\.ktx2` is too big: 12 by 8 pixels"):
        images.read(SAMPLES["UASTC"], "a.ktx2", limit=95)


def textured(tmp_path, codec, beside=False):
    """(texels of the first row's picture, messages) of a square whose colour is in KTX 2; `beside` it is a black PNG."""
    document, binary = square(materials=[{"pbrMetallicRoughness": {"baseColorTexture": PICTURE}}])
    pictures = [SAMPLES[codec], write_image(tmp_path / "p.png", np.zeros((2, 2, 3), np.uint8)).read_bytes()]
    for data in pictures:
        document["bufferViews"].append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(data)})
        binary += data
    document["images"] = [{"bufferView": 3, "mimeType": "image/ktx2"}, {"bufferView": 4}]
    document["textures"] = [{"extensions": {"KHR_texture_basisu": {"source": 0}}, **({"source": 1} if beside else {})}]
    document["extensionsUsed"] = ["KHR_texture_basisu"]
    scene, _, messages = read(glb(document, binary), "a.glb")
    return scene.tables.images, messages


@needs_package
@pytest.mark.parametrize("codec", SAMPLES)
def test_a_gltf_with_pictures_in_ktx2(tmp_path, codec):
    pictures, messages = textured(tmp_path, codec, beside=True)
    assert (messages, int(pictures.width[0]), int(pictures.height[0])) == ([], 12, 8)


@pytest.mark.parametrize("beside", [False, True])
def test_without_the_package_the_message_says_how_to_install_it(tmp_path, monkeypatch, beside):
    monkeypatch.setattr(ktx2.importlib.util, "find_spec", lambda name: None)
    pictures, messages = textured(tmp_path, "UASTC", beside)
    reason = f"the package opengl_basisu reads pictures in KTX 2 ({install_command('basisu')})"
    if beside:
        assert messages == [f"a.glb: warning: the pictures beside those in KTX 2 are drawn: {reason}"]
        assert int(pictures.width[0]) == 2
    else:
        assert messages == [f"a.glb: warning: the picture `a.glb[0]` is left out: {reason}"]
