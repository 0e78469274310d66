"""Sets of texture coordinates and opacities of vertices of glTF meshes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from maquette.compiler import ir
from maquette.compiler.importers import gltf_tangents
from maquette.compiler.importers.common import uv_sets

from ...files import write_image
from .. import tables
from .test_mesh_files import glb, read, square

SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])


def with_sets(tmp_path, second):
    """A square with a red picture in set 0 and an emissive one in set 1; its `second` coordinates (4, 2)."""
    data = write_image(tmp_path / "p.png", np.array([[[255, 0, 0]]], np.uint8)).read_bytes()
    document, binary = square()
    extra = np.asarray(second, "<f4").tobytes()
    document["bufferViews"] += [
        {"buffer": 0, "byteOffset": len(binary), "byteLength": 32}, {"buffer": 0, "byteOffset": len(binary) + 32, "byteLength": len(data)},
    ]  # fmt: skip
    document["accessors"].append({"bufferView": 3, "componentType": 5126, "count": 4, "type": "VEC2"})
    document["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_1"] = 3
    document["images"], document["textures"] = [{"bufferView": 4}], [{"source": 0}]
    made = document["materials"][0]
    made["emissiveFactor"], made["emissiveTexture"] = [1, 1, 1], {"index": 0, "texCoord": 1}
    made["pbrMetallicRoughness"]["baseColorTexture"] = {"index": 0}
    document["scenes"] = [{"nodes": [0]}]
    return read(glb(document, binary + extra + data), "a.glb")


def coordinates(scene, part, slot):
    """Coordinates of a slot's picture at the corners of a part's triangles, with v down as in the file."""
    t = scene.tables
    frame = t.textures.frame[t.materials.textures[part.material, slot]]
    own = tables.attribute(t, "uvs", part.geometry)
    found = own @ frame[:, :2].T + frame[:, 2]
    return np.stack([found[..., 0], 1 - found[..., 1]], axis=-1)


def test_an_affine_second_set_is_a_frame(tmp_path):
    second = SQUARE @ [[0, 2], [3, 0]] + [0.5, 0.25]
    scene, parts, messages = with_sets(tmp_path, second)
    assert (messages, len(parts)) == ([], 1)
    assert coordinates(scene, parts[0], ir.Slot.DIFFUSE)[0].tolist() == SQUARE[[0, 1, 2]].tolist()
    assert np.allclose(coordinates(scene, parts[0], ir.Slot.EMISSION), second[[[0, 1, 2], [0, 2, 3]]], atol=1e-6)


def test_two_triangles_with_two_maps_are_two_parts(tmp_path):
    second = np.array([[0, 0], [1, 0], [2, 1], [0.5, 3]])
    scene, parts, messages = with_sets(tmp_path, second)
    assert (messages, len(parts)) == ([], 2)
    found = {np.round(coordinates(scene, part, ir.Slot.EMISSION), 5).tobytes() for part in parts}
    assert found == {np.round(second[[rows]], 5).tobytes() for rows in ([0, 1, 2], [0, 2, 3])}


@pytest.mark.long
@given(st.lists(st.lists(st.floats(-4, 4), min_size=6, max_size=6), min_size=1, max_size=6), st.integers(1, 9))
def test_split_gives_every_face_maps_that_hold_at_its_corners(maps, count):
    rng = np.random.default_rng(count)
    counts = rng.integers(3, 6, count)
    own = rng.random((counts.sum(), 2))
    linear = np.array(maps).reshape(-1, 2, 3)
    face = np.repeat(np.arange(count), counts)
    chosen = linear[face % len(linear)]
    other = np.einsum("cij,cj->ci", chosen, np.concatenate([own, np.ones((len(own), 1))], axis=1))
    groups = uv_sets.split(own, other, counts)
    assert groups is not None
    assert sorted(np.concatenate([rows for rows, _ in groups])) == list(range(count))
    for rows, found in groups:
        corners = np.isin(face, rows)
        mapped = own[corners] @ found[0, :2, :2].T + found[0, :2, 2]
        assert np.allclose(mapped, other[corners], atol=2e-4)


def test_too_many_maps_are_refused():
    rng = np.random.default_rng(1)
    own, other = rng.random((300, 2)), rng.random((300, 2))
    assert uv_sets.split(own, other, np.full(100, 3)) is None


def test_a_picture_of_a_set_without_maps_is_left_out(tmp_path, monkeypatch):
    monkeypatch.setattr(uv_sets, "MOST_PARTS", 1)
    scene, parts, messages = with_sets(tmp_path, [[0, 0], [1, 0], [2, 1], [0.5, 3]])
    assert messages == [
        "a.glb: warning: pictures with TEXCOORD_1 are left out: more than 1 affine maps lead to it from the set of the first picture"
    ]
    assert scene.tables.materials.textures[parts[0].material, ir.Slot.EMISSION] == -1


def with_alpha(alphas, mode="BLEND", picture=None):
    document, binary = square()
    extra = np.concatenate([np.ones((4, 3)), np.array(alphas)[:, None]], axis=1).astype("<f4").tobytes()
    document["bufferViews"].append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(extra)})
    document["accessors"].append({"bufferView": 3, "componentType": 5126, "count": 4, "type": "VEC4"})
    document["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = 3
    document["materials"][0]["alphaMode"] = mode
    if picture is not None:
        document["bufferViews"].append({"buffer": 0, "byteOffset": len(binary) + len(extra), "byteLength": len(picture)})
        document["images"], document["textures"] = [{"bufferView": 4}], [{"source": 0}]
        document["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = {"index": 0}
    return read(glb(document, binary + extra + (picture or b"")), "a.glb")


def input_of(scene, part, slot):
    m = scene.tables.materials
    return m.values[part.material, slot, 0], m.textures[part.material, slot]


def test_even_alpha_of_vertices_is_a_factor():
    scene, (part, _), messages = with_alpha([0.25] * 4)
    assert messages == []
    assert input_of(scene, part, ir.Slot.OPACITY) == (0.25, -1)


def test_alpha_of_vertices_varies_as_the_coordinate_of_a_ramp():
    scene, (part, _), messages = with_alpha([0, 0.25, 0.5, 1])
    assert messages == []
    value, row = input_of(scene, part, ir.Slot.OPACITY)
    t = scene.tables.textures
    assert (value, t.channel[row]) == (1, 0)
    u = tables.attribute(scene.tables, "uvs", part.geometry)[..., 0]
    assert u.tolist() == [[0, 0.25, 0.5], [0, 0.5, 1]]
    assert (t.frame[row] @ [0, 0, 1]).tolist() == [0.25, 0.5]  # the centre of the black texel
    assert (t.frame[row] @ [1, 0, 1]).tolist() == [0.75, 0.5]  # and of the white one
    assert scene.tables.images.texels[:, 0].tolist() == [0, 1]


def test_alpha_of_vertices_counts_in_blended_materials_alone():
    scene, (part, _), messages = with_alpha([0, 0.25, 0.5, 1], "OPAQUE")
    assert messages == []
    assert input_of(scene, part, ir.Slot.OPACITY) == (1, -1)


def test_alpha_of_vertices_beside_pictures_is_its_mean(tmp_path):
    data = write_image(tmp_path / "p.png", np.array([[[255, 0, 0]]], np.uint8)).read_bytes()
    scene, (part, _), messages = with_alpha([0, 0.25, 0.5, 1], picture=data)
    assert messages == ["a.glb: warning: the opacity of vertex colours is drawn as its mean on meshes with pictures"]
    assert input_of(scene, part, ir.Slot.OPACITY) == (pytest.approx(0.4375), -1)


def test_sheen(tmp_path):
    data = write_image(tmp_path / "p.png", np.array([[[255, 0, 0, 64]]], np.uint8)).read_bytes()
    document, binary = square()
    document["bufferViews"].append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(data)})
    document["images"], document["textures"] = [{"bufferView": 3}], [{"source": 0}]
    sheen = {"sheenColorFactor": [0.5, 0.25, 0], "sheenRoughnessFactor": 0.75}
    sheen |= {"sheenColorTexture": {"index": 0}, "sheenRoughnessTexture": {"index": 0}}
    document["materials"][0]["extensions"] = {"KHR_materials_sheen": sheen}
    scene, (part, _), messages = read(glb(document, binary + data), "a.glb")
    assert messages == []
    channel, color = scene.tables.textures.channel, scene.tables.materials.values[part.material, ir.Slot.SHEEN].tolist()
    one, (rough, other) = scene.tables.materials.textures[part.material, ir.Slot.SHEEN], input_of(scene, part, ir.Slot.SHEEN_ROUGHNESS)
    assert (color, channel[one], rough, channel[other]) == ([0.5, 0.25, 0], -1, 0.75, 3)


def test_pictures_of_a_clear_coat(tmp_path):
    data = write_image(tmp_path / "p.png", np.array([[[255, 0, 0]]], np.uint8)).read_bytes()
    document, binary = square()
    document["bufferViews"].append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(data)})
    document["images"], document["textures"] = [{"bufferView": 3}], [{"source": 0}]
    coat = {"clearcoatFactor": 0.5, "clearcoatRoughnessFactor": 1}
    coat |= {"clearcoatTexture": {"index": 0}, "clearcoatRoughnessTexture": {"index": 0}}
    document["materials"][0]["extensions"] = {"KHR_materials_clearcoat": coat}
    scene, (part, _), messages = read(glb(document, binary + data), "a.glb")
    assert messages == []
    channel = scene.tables.textures.channel
    (weight, one), (rough, other) = (input_of(scene, part, slot) for slot in (ir.Slot.COAT, ir.Slot.COAT_ROUGHNESS))
    assert (weight, channel[one], rough, channel[other]) == (0.5, 0, 1, 1)


@pytest.mark.parametrize(("turn", "hand", "differs"), [(0.0, 1.0, False), (0.3, 1.0, False), (1.5, 1.0, True), (0.0, -1.0, True)])
def test_tangents_that_differ_from_those_of_the_coordinates(turn, hand, differs):
    """A square in the plane z = 0 with u along x and v, which points down in glTF, along -y."""
    points = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], float)
    uvs = np.stack([points[:, 0], 1 - points[:, 1]], axis=1)
    tangents = np.tile([np.cos(turn), np.sin(turn), 0, hand], (4, 1))
    assert gltf_tangents.differ(points, np.array([(0, 1, 2), (0, 2, 3)]), uvs, tangents) == differs
