"""Layouts of dome pictures: a picture of the direction itself, written in each layout, shows each direction where it is."""

import math

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.importers.usd.pictures import dome_pictures

from .....files import write_image
from ..stages import read


def ways(layout: str, n: int) -> np.ndarray:
    """(rows, columns, 3) the direction that each texel shows, from the definition of the layout; 0 outside of it."""
    if layout == "cubeMapVerticalCross":
        made = np.zeros((4 * n, 3 * n, 3))
        t = (np.arange(n) + 0.5) / n * 2 - 1
        right, down, one = np.broadcast_arrays(t[None], t[:, None], 1.0)
        faces = {  # unfolded from the face at +z, whose right is −x
            (1, 1): (-right, -down, one), (1, 0): (one, -down, right), (1, 2): (-one, -down, -right),
            (0, 1): (-right, one, down), (2, 1): (-right, -one, -down), (3, 1): (-right, down, -one),
        }  # fmt: skip
        for (row, column), way in faces.items():
            made[row * n : (row + 1) * n, column * n : (column + 1) * n] = np.stack(way, axis=-1)
        return made / np.maximum(np.linalg.norm(made, axis=2, keepdims=True), 1e-9)
    t = (np.arange(n) + 0.5) / n * 2 - 1
    u, v = np.broadcast_arrays(t[None], -t[:, None])
    r = np.hypot(u, v)
    if layout == "angular":
        across = np.sin(np.pi * r) / np.maximum(r, 1e-9)
        made = np.stack([u * across, v * across, np.cos(np.pi * r)], axis=-1)
    else:
        normal = np.stack([u, v, np.sqrt(np.maximum(1 - r * r, 0))], axis=-1)
        made = 2 * normal[..., 2:] * normal - [0, 0, 1]  # the reflection of the ray along −z
    return np.where(r[..., None] <= 1, made, 0.0)


@pytest.mark.long
@pytest.mark.parametrize("layout", ["angular", "mirroredBall", "cubeMapVerticalCross"])
def test_every_direction_is_where_the_layout_shows_it(layout):
    texels = np.concatenate([ways(layout, 256), np.ones((*ways(layout, 256).shape[:2], 1))], axis=2)
    found = dome_pictures.latitude_longitude(texels.astype(np.float32), layout)
    height, width = found.shape[:2]
    latitude = math.pi * (0.5 - (np.arange(height) + 0.5) / height)[:, None]
    turn = 2 * math.pi * (0.5 - (np.arange(width) + 0.5) / width)[None]
    expected = np.stack([np.cos(latitude) * np.sin(turn), np.sin(latitude) + 0 * turn, np.cos(latitude) * np.cos(turn)], axis=-1)
    error = np.abs(found[..., :3] - expected).max(axis=2)
    edge = {"angular": -0.98, "mirroredBall": -0.9, "cubeMapVerticalCross": -2}[layout]  # the edge of a disk shows one direction
    blind = expected[..., 2] < edge
    assert width == 2 * height
    assert error[~blind].max() < 0.03
    assert found[..., 3] == pytest.approx(1.0)


def test_a_dome_is_resampled(tmp_path):
    """The middle of an angular picture is at +z, its edge at −z; latitude–longitude has the former in its middle."""
    n = 64
    t = (np.arange(n) + 0.5) / n * 2 - 1
    near = np.hypot(t[None], t[:, None]) < 0.5
    write_image(tmp_path / "sky.exr", np.where(near[..., None], [1, 0, 0], [0, 0, 1]).astype(np.float32))
    text = 'def DomeLight "l" { asset inputs:texture:file = @sky.exr@\ntoken inputs:texture:format = "angular" }\ndef Cube "c" {}'
    scene, messages = read(tmp_path, text)
    t = scene.tables
    image = t.lights.image[0]
    texels = t.images.texels[t.images.first[image] :].reshape(t.images.height[image], t.images.width[image], 4)
    assert (messages, t.lights.kind.tolist(), texels.shape) == ([], [ir.LightKind.DOME], (64, 128, 4))
    assert texels[32, 64, :3].tolist() == [1, 0, 0]
    assert texels[32, 0, :3].tolist() == [0, 0, 1]


def test_an_unknown_layout(tmp_path):
    write_image(tmp_path / "sky.png", np.full((2, 4, 3), 255, np.uint8))
    text = 'def DomeLight "l" { asset inputs:texture:file = @sky.png@\ntoken inputs:texture:format = "fisheye" }\ndef Cube "c" {}'
    assert read(tmp_path, text)[1] == ["x.usda</l>: warning: the dome's format `fisheye` is read as latlong"]
