"""Tests of Cryptomatte: the published hash, ids, ranks, and mattes read back from a file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import maquette
import numpy as np
import OpenImageIO as oiio
import pytest
from hypothesis import given
from hypothesis import strategies as st
from maquette.render.image import cryptomatte, image_files

SCENE = """
camera(position: [0, 0, 10], look_at: [0, 0, 0], width: 4m)
let red = lambert(#ff0000)
box([2.11, 6, 1], center: [-1.045, 0, 0], material: red, name: "left")
box([1, 6, 1], center: [0.5625, 0, 0], material: lambert(#00ff00), name: "middle")
point([0, 0, 9], intensity: 50)
"""


@pytest.mark.parametrize(
    ("data", "seed", "value"),
    [
        (b"", 0, 0), (b"", 1, 0x514E28B7), (b"", 0xFFFFFFFF, 0x81F16F39), (b"\xff\xff\xff\xff", 0, 0x76293B50),
        (b"\x21\x43\x65\x87", 0, 0xF55B516B), (b"\x21\x43\x65", 0, 0x7E4A8634), (b"\x21\x43", 0, 0xA0F7B07A), (b"\x21", 0, 0x72661CF4),
        (b"hello", 0, 0x248BFA47), (b"test", 0x9747B28C, 0x704B81DC),
    ],
)  # fmt: skip
def test_the_hash_by_published_values(data: bytes, seed: int, value: int) -> None:
    """MurmurHash3_x86_32: values of its verification in SMHasher's circle of ports."""
    assert cryptomatte.murmur3(data, seed) == value


@given(st.text(max_size=40))
def test_ids_are_finite_numbers_and_not_denormal(name: str) -> None:
    value = float(np.array([cryptomatte.id_of(name)], np.uint32).view(np.float32)[0])
    assert np.isfinite(value)
    assert abs(value) >= np.finfo(np.float32).tiny


def test_a_layers_key_is_as_published() -> None:
    """The first seven digits of the hash of the layer's name, as other programs' files have it."""
    assert f"{cryptomatte.murmur3(b'CryptoObject'):08x}"[:-1] == "3ae39a5"


def test_ranks_fall_and_nothing_has_no_id() -> None:
    ids = np.array([cryptomatte.id_of(n) for n in "abc"], np.uint32).view(np.float32)
    label = np.array([[0, 3, 2], [1, 3, 2], [1, 3, 3], [1, 3, 0]])
    ranks = cryptomatte.rank(label, ids).reshape(3, cryptomatte.RANKS, 2)
    assert ranks[0, :2].tolist() == [[ids[1], 0.75], [ids[0], 0.25]]
    assert not ranks[1].any()
    assert ranks[2, :2].tolist() == [[ids[2], 0.5], [ids[0], 0.25]]
    assert not ranks[:, 2:].any()


@pytest.mark.parametrize("backend", ["reference", "ray", "raster"])
def test_mattes_come_back_from_a_file(tmp_path: Path, backend: str) -> None:
    """By nothing but the file's own attributes: what covers half a pixel has half a share, the rest is the background's."""
    path = tmp_path / "a.scene"
    path.write_text(SCENE)
    image = maquette.render(path, size=(32, 32), samples=16, filter="box", backend=backend, aov=("cryptomatte",), threads=1)
    image_files.write(image, tmp_path / "a.exr", image_files.Look(), {})
    source: Any = oiio.ImageInput.open(str(tmp_path / "a.exr"))
    spec, pixels = source.spec(), np.asarray(source.read_image(oiio.FLOAT))
    said: dict[str, Any] = {a.name: a.value for a in spec.extra_attribs if a.name.startswith("cryptomatte/")}
    keys = {value: name.split("/")[1] for name, value in said.items() if name.endswith("/name")}
    assert set(keys) == {"CryptoObject", "CryptoMaterial"}
    names = list(spec.channelnames)

    def matte(layer: str, object_name: str) -> np.ndarray:
        key = f"cryptomatte/{keys[layer]}"
        assert (said[f"{key}/hash"], said[f"{key}/conversion"]) == ("MurmurHash3_32", "uint32_to_float32")
        hashed = int(json.loads(said[f"{key}/manifest"])[object_name], 16)
        total = np.zeros(pixels.shape[:2])
        for rank in range(cryptomatte.RANKS):
            id_channel, share = (f"{layer}{rank // 2:02d}.{'RGBA'[2 * (rank % 2) + k]}" for k in (0, 1))
            ids = np.ascontiguousarray(pixels[..., names.index(id_channel)]).view(np.uint32)
            total += np.where(ids == hashed, pixels[..., names.index(share)], 0.0)
        return total

    left, middle = matte("CryptoObject", "left"), matte("CryptoObject", "middle")
    inside = slice(2, 30)
    assert left[inside, :15] == pytest.approx(np.ones((28, 15)))
    assert np.array_equal(left[:, 17:], np.zeros((32, 15)))
    assert left[inside, 15:17].mean(axis=0) == pytest.approx([1.0, 0.08], abs=0.03)  # up to x = 0.01 m, 0.08 pixels
    assert middle[inside, 16] == pytest.approx(np.full(28, 0.5), abs=1 / 16)  # from x = 0.0625, half of pixel 16
    assert np.array_equal(middle[inside, 17:24], np.ones((28, 7)))
    assert left + middle == pytest.approx(image.channels["rgba"][..., 3], abs=1e-6)
    material = next(name for name in json.loads(said[f"cryptomatte/{keys['CryptoMaterial']}/manifest"]) if name.endswith(("red", ".0")))
    assert np.array_equal(matte("CryptoMaterial", material), left)
    assert np.array_equal(cryptomatte.matte(image.channels["crypto_object"], "middle"), middle)
