"""Meshes of glTF files that are compressed by Draco."""

import DracoPy
import numpy as np
import pytest
from maquette.compiler.importers import gltf_draco
from maquette.lang.distribution import install_command

from .. import tables
from .test_mesh_files import glb, read

POINTS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
FACES = np.array([[0, 1, 2], [0, 2, 3]], np.uint32)
COLORS = np.array([[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255], [255, 255, 255, 255]], np.uint8)


def compressed(change=lambda data: data):
    """A .glb with a compressed square of vertex colours and texture coordinates."""
    data = DracoPy.encode(POINTS, FACES, tex_coord=POINTS[:, :2].astype(np.float64).copy(), colors=COLORS, preserve_order=True)
    ids = {each["attribute_type"]: each["unique_id"] for each in DracoPy.decode(data).attributes}
    data = change(data)
    attributes = {"POSITION": ids[0], "COLOR_0": ids[2], "TEXCOORD_0": ids[3]}
    document = {
        "extensionsUsed": ["KHR_draco_mesh_compression"],
        "extensionsRequired": ["KHR_draco_mesh_compression"],
        "buffers": [{"byteLength": len(data)}],
        "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": len(data)}],
        "accessors": [
            {"componentType": 5126, "count": 4, "type": "VEC3"},
            {"componentType": 5121, "count": 4, "type": "VEC4", "normalized": True},
            {"componentType": 5126, "count": 4, "type": "VEC2"},
            {"componentType": 5123, "count": 6, "type": "SCALAR"},
        ],
        "meshes": [{"primitives": [{
            "attributes": {"POSITION": 0, "COLOR_0": 1, "TEXCOORD_0": 2}, "indices": 3,
            "extensions": {"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": attributes}},
        }]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
    }  # fmt: skip
    return glb(document, data)


def test_a_compressed_square():
    scene, (part,), messages = read(compressed(), "a.glb")
    assert messages == []
    assert tables.corners(scene.tables, part.geometry) == pytest.approx(POINTS[FACES], abs=1e-4)
    assert tables.attribute(scene.tables, "colors", part.geometry).tolist() == (COLORS[FACES][..., :3] / 255).tolist()
    found = tables.attribute(scene.tables, "uvs", part.geometry)
    assert np.stack([found[..., 0], 1 - found[..., 1]], axis=-1) == pytest.approx(POINTS[FACES][..., :2], abs=1e-3)


def test_a_damaged_square_is_left_out():
    messages = read(compressed(lambda data: data[: len(data) // 2]), "a.glb")[2]
    assert messages[0].startswith("a.glb: warning: a mesh compressed by Draco is damaged (")
    assert messages[1:] == ["a.glb: error: the glTF file shows no mesh"]


def test_without_the_package_the_warning_names_it(monkeypatch):
    monkeypatch.setattr(gltf_draco.importlib.util, "find_spec", lambda name: None)
    reason = f"meshes compressed by Draco are left out: the package DracoPy reads them ({install_command('draco')})"
    assert read(compressed(), "a.glb")[2] == [f"a.glb: warning: {reason}", "a.glb: error: the glTF file shows no mesh"]
