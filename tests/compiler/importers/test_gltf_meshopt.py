"""Buffer views of glTF files that are compressed by meshopt; meshoptimizer wrote the bytes."""

import numpy as np
import pytest
from maquette.compiler.importers import gltf_meshopt
from maquette.compiler.importers.gltf_errors import GltfError

from .. import tables
from .test_mesh_files import SQUARE, glb, read, square

K = np.arange(20)
VERTICES = np.stack([7 + 0 * K, K, K * K, 37 * K], axis=1).astype(np.uint8)
PACKED = bytes.fromhex(
    "a000052aaaaaaaaa000000070002060a0e12161a1e22262a2e32363aff0000003e42464a07004a4a4a4a4a4a4a4a4a4a4a4a4a4a4aff0000"
    "004a4a4a4a0000000000000000000000000000000000000000000000000000000007000000"
)
TRIANGLES = [0, 1, 2, 2, 1, 3, 4, 5, 6, 2, 3, 9, 7, 100, 3, 6, 5, 8]  # of 0 1 2, 2 1 3, 4 5 6, 2 3 9, 100 3 7, 6 5 8
PACKED_TRIANGLES = bytes.fromhex("e1f010f03ffe6012f5b601007687566778a9866589689801690000")


def attributes(count, stride, **more):
    return {"count": count, "byteStride": stride, "mode": "ATTRIBUTES", **more}


def test_attributes():
    found = np.frombuffer(gltf_meshopt.decode(PACKED, attributes(20, 4)), np.uint8)
    assert found.reshape(-1, 4).tolist() == VERTICES.tolist()


@pytest.mark.parametrize(("stride", "kind"), [(2, "<u2"), (4, "<u4")])
def test_triangles(stride, kind):
    given = {"count": 18, "byteStride": stride, "mode": "TRIANGLES"}
    assert np.frombuffer(gltf_meshopt.decode(PACKED_TRIANGLES, given), kind).tolist() == TRIANGLES


def test_indices():
    """Differences from one of two bases, each a zigzag number above the bit that selects the base: 5, 6, 105, 4."""
    steps = [(0, 5), (0, 1), (1, 105), (0, -2)]
    numbers = [((2 * d if d >= 0 else -2 * d - 1) << 1) | base for base, d in steps]
    coded = b"".join(bytes([n]) if n < 128 else bytes([n & 127 | 128, n >> 7]) for n in numbers)
    given = {"count": 4, "byteStride": 2, "mode": "INDICES"}
    assert np.frombuffer(gltf_meshopt.decode(b"\xd1" + coded + bytes(4), given), "<u2").tolist() == [5, 6, 105, 4]


def stored(values):
    """The bytes of one vertex, all of whose bytes stand in the tail."""
    data = np.asarray(values).tobytes()
    return b"\xa0" + bytes(len(data)) + bytes(32 - len(data)) + data, len(data)


def filtered(values, name, kind):
    data, stride = stored(values)
    return np.frombuffer(gltf_meshopt.decode(data, attributes(1, stride, filter=name)), kind)


@pytest.mark.parametrize("direction", [(0, 0, 1), (0.6, 0, -0.8), (-0.48, 0.6, 0.64), (0.36, -0.48, -0.8)])
def test_octahedral_directions(direction):
    """x and y of the octahedron |x| + |y| + |z| = 1, its lower half folded outward, times 127; the fourth byte stays."""
    x, y, z = np.array(direction) / np.abs(direction).sum()
    if z < 0:
        x, y = (1 - abs(y)) * (1 if x >= 0 else -1), (1 - abs(x)) * (1 if y >= 0 else -1)
    found = filtered(np.array([round(x * 127), round(y * 127), 127, 5], np.int8), "OCTAHEDRAL", np.int8)
    assert found[:3] / 127 == pytest.approx(direction, abs=0.02)
    assert found[3] == 5


def test_quaternions():
    """Three components times √2 · 32767, and the number of the largest one in the last two bits."""
    q = np.array([0.5, 0.1, -0.7, np.sqrt(1 - 0.75)])
    largest = 2
    rest = [q[(largest + k) & 3] * -1 for k in (1, 2, 3)]  # the largest is positive
    values = np.array([*np.round(np.array(rest) * np.sqrt(2) * 32767), 32767 & ~3 | largest], np.int16)
    found = filtered(values, "QUATERNION", "<i2") / 32767
    assert found == pytest.approx(-q, abs=1e-3)


def test_exponents():
    """2^−3 · 20 and 2^1 · −7."""
    assert filtered(np.array([(-3 << 24) | 20, (1 << 24) | (-7 & 0xFFFFFF)], np.int32), "EXPONENTIAL", "<f4").tolist() == [2.5, -14]


@pytest.mark.parametrize(
    ("data", "given", "expected"),
    [
        (PACKED[:30], attributes(20, 4), "a buffer view compressed by meshopt is damaged"),
        (b"", {"count": 3, "byteStride": 2, "mode": "TRIANGLES"}, "a buffer view compressed by meshopt is damaged"),
        (b"\xa1" + PACKED[1:], attributes(20, 4), "version 1 of meshopt's attribute codec is not read: version 0 is"),
        (PACKED, attributes(20, 4, filter="ODD"), "the filter `ODD` of meshopt is not known"),
        (PACKED, attributes(1 << 30, 200), "a buffer view compressed by meshopt has an impossible size"),
    ],
)
def test_damaged_views(data, given, expected):
    with pytest.raises(GltfError) as caught:
        gltf_meshopt.decode(data, given)
    assert str(caught.value) == expected


def test_a_file():
    """A square whose indices are compressed: a triangle of three new vertices, and one on its edge 0 2."""
    document, binary = square()
    packed = b"\xe1" + bytes([0xF0, 0x00]) + bytes(16)
    document["bufferViews"][2] = {
        "buffer": 1, "byteOffset": 0, "byteLength": 12,
        "extensions": {"EXT_meshopt_compression": {
            "buffer": 0, "byteOffset": len(binary), "byteLength": len(packed), "byteStride": 2, "count": 6, "mode": "TRIANGLES",
        }},
    }  # fmt: skip
    document["buffers"].append({"byteLength": 12, "extensions": {"EXT_meshopt_compression": {"fallback": True}}})
    document["extensionsUsed"] = document["extensionsRequired"] = ["EXT_meshopt_compression"]
    scene, parts, messages = read(glb(document, binary + packed), "a.glb")
    assert (messages, len(parts)) == ([], 2)
    assert tables.corners(scene.tables)[0].tolist() == SQUARE[[0, 1, 2]].tolist()
    assert len(scene.tables.pools.triangles) == 2
