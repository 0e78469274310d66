"""Surfaces of glTF without doubleSided: seen from behind they are not there, on every backend."""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from .conftest import Draw
from .views import alpha, rgb

QUADS = np.array([(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])
BOX = np.concatenate([QUADS[:, [0, 1, 2]], QUADS[:, [0, 2, 3]]])
CORNERS = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float32)
VIEW = "camera([0, 0, 6], look_at: [0, 0, 0], fov: 40deg)\n"


def write(path: Path, shells: Sequence[tuple[float, np.ndarray, dict[str, Any]]], **node: Any) -> None:
    """A glTF file of meshes on the corners of boxes: half size, triangles, material."""
    document: dict[str, Any] = {"asset": {"version": "2.0"}, "scenes": [{"nodes": []}], "nodes": [], "meshes": [], "materials": []}
    document |= {"accessors": [], "bufferViews": [], "buffers": []}
    data = b""
    for k, (half, triangles, material) in enumerate(shells):
        corners = (half * CORNERS[triangles]).reshape(-1, 3).astype("<f4")
        document["bufferViews"].append({"buffer": 0, "byteOffset": len(data), "byteLength": corners.nbytes})
        document["accessors"].append({"bufferView": k, "componentType": 5126, "count": len(corners), "type": "VEC3"})
        document["meshes"].append({"primitives": [{"attributes": {"POSITION": k}, "material": k}]})
        document["materials"].append(material)
        document["nodes"].append({"mesh": k, **node})
        document["scenes"][0]["nodes"].append(k)
        data += corners.tobytes()
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    document["buffers"].append({"byteLength": len(data), "uri": uri})
    path.write_text(json.dumps(document))


def shines(*color: float, **more: Any) -> dict[str, Any]:
    return {"pbrMetallicRoughness": {"baseColorFactor": [*color, 1.0]}, "extensions": {"KHR_materials_unlit": {}}, **more}


@pytest.mark.parametrize("scale", [[1, 1, 1], [-1, 1, 1]])
def test_an_outline_hull_shows_what_is_in_it(draw: Draw, tmp_path: Path, scale: list[int]) -> None:
    hull, cube = (1.3, BOX[:, ::-1], shines(0, 0, 1)), (1.0, BOX, shines(1, 0, 0))
    write(tmp_path / "a.gltf", [hull, cube], scale=scale)
    color = rgb(draw('mesh("a.gltf")\n' + VIEW))
    assert color[24, 24].tolist() == [1, 0, 0]
    assert ((color == [0, 0, 1]).all(axis=2)).sum() > 100  # its far side, around the cube
    write(tmp_path / "a.gltf", [(1.3, BOX[:, ::-1], shines(0, 0, 1, doubleSided=True)), cube], scale=scale)
    assert rgb(draw('mesh("a.gltf")\n' + VIEW))[24, 24].tolist() == [0, 0, 1]


def test_light_passes_the_hull_that_is_not_seen(draw: Draw, tmp_path: Path) -> None:
    red = {"pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0, 1], "metallicFactor": 0}}
    sun = "directional([0.2, 0.1, 1])\n"
    write(tmp_path / "a.gltf", [(1.0, BOX, red)])
    alone = rgb(draw('mesh("a.gltf")\n' + sun + VIEW))
    write(tmp_path / "a.gltf", [(1.3, BOX[:, ::-1], shines(0, 0, 1)), (1.0, BOX, red)])
    assert np.allclose(rgb(draw('mesh("a.gltf")\n' + sun + VIEW))[24, 24], alone[24, 24], rtol=1e-5)
    assert alone[24, 24, 0] > 0.2


@pytest.mark.parametrize("turned", [False, True])
def test_a_square_from_behind(draw: Draw, tmp_path: Path, turned: bool) -> None:
    square = np.array([(1, 5, 7), (1, 7, 3)])
    write(tmp_path / "a.gltf", [(1.0, square[:, ::-1] if turned else square, shines(1, 1, 1))])
    found = alpha(draw('mesh("a.gltf")\n' + VIEW, background="transparent"))
    assert found.max() == (0 if turned else 1)


def test_a_back_casts_a_shadow(draw: Draw, tmp_path: Path) -> None:
    """A square over a floor that the camera sees from below, as its light does not."""
    lid = np.array([(2, 3, 7), (2, 7, 6)])  # y = 1, towards +y
    write(tmp_path / "a.gltf", [(1.0, lid, shines(1, 0, 0))])
    view = "camera([0, 0, 0.5], look_at: [0, -1, -0.5], fov: 60deg)\n"
    scene = f'mesh("a.gltf")\nplane(y: -1)\ndirectional([0, 1, 0])\n{view}'
    with_lid, without = rgb(draw(scene)), rgb(draw(scene.replace('mesh("a.gltf")\n', "")))
    assert without.max() > 0
    assert with_lid[20:, 16:32].max() < 0.5 * without[20:, 16:32].max()
