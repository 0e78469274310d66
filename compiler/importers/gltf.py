"""Reads binary glTF files (.glb): meshes placed by nodes, vertex colours, base colours and pictures.

Format: glTF 2.0 (Khronos, ISO/IEC 12113:2022), sections named in the functions.
"""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...lang.diagnostics import Diagnostics, Span
from ...lang.elements import Quaternion
from .. import ir
from ..mesh import polygon_mesh
from ..scene import metallic_roughness, transforms
from ..scene.builder import NONE, SceneBuilder
from ..scene.row_records import Input, MeshAttribute, TextureData
from . import images
from .mesh_parts import Part, add

_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_WRAPS = {33071: ir.Wrap.CLAMP, 33648: ir.Wrap.MIRROR, 10497: ir.Wrap.REPEAT}
DATA = -2
_UNDERSTOOD = {"KHR_materials_unlit", "KHR_texture_transform", "KHR_mesh_quantization"}
TRIANGLES, STRIP, FAN = 4, 5, 6
MAX_NODES = 200_000
LEAST_CUTOFF = 1e-9  # a mask that is cut at 0 is there everywhere


class GltfError(Exception):
    """A GLB file that cannot be read."""


def read(data: bytes, name: str, builder: SceneBuilder, diagnostics: Diagnostics) -> list[Part]:
    """The parts of a .glb file's scene, one for each primitive of each node that shows a mesh; nodes share geometries.
    GltfError if there is nothing to be had."""
    document, binary = _chunks(data)
    needed = set(document.get("extensionsRequired", ())) - _UNDERSTOOD
    if needed:
        raise GltfError(f"the GLB file needs what is not built: {', '.join(sorted(map(str, needed)))}")
    try:
        return _Reader(document, binary, name, builder, diagnostics).parts()
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError) as failure:
        raise GltfError(f"the GLB file contradicts itself ({type(failure).__name__}: {failure})") from None


def _chunks(data: bytes) -> tuple[dict[str, Any], bytes]:
    """The JSON document and the binary chunk (§4.4)."""
    if len(data) < 20 or data[:4] != b"glTF":
        raise GltfError("this is no GLB file: it does not begin with `glTF`")
    version, _, length, kind = struct.unpack_from("<III4s", data, 4)
    if version != 2 or kind != b"JSON" or 20 + length > len(data):
        raise GltfError(f"the GLB file is of version {version}; version 2 is read" if version != 2 else "the GLB file ends early")
    try:
        document = json.loads(data[20 : 20 + length])
    except (ValueError, RecursionError):
        raise GltfError("the GLB file's JSON is damaged") from None
    if not isinstance(document, dict):
        raise GltfError("the GLB file's JSON is damaged")
    rest = data[20 + length :]
    return document, rest[8 : 8 + struct.unpack_from("<I", rest)[0]] if len(rest) >= 8 else b""


@dataclass(slots=True)
class _Reader:
    document: dict[str, Any]
    binary: bytes
    name: str
    builder: SceneBuilder
    diagnostics: Diagnostics
    warned: set[str] = field(default_factory=set)
    meshes: dict[int, list[Part]] = field(default_factory=dict)
    materials: dict[int, int] = field(default_factory=dict)

    def parts(self) -> list[Part]:
        scenes = self.document.get("scenes") or [{"nodes": list(range(len(self.document.get("nodes", ()))))}]
        found: list[Part] = []
        waiting = [(n, transforms.identity()) for n in reversed(scenes[self.document.get("scene", 0)].get("nodes", ()))]
        seen = 0
        while waiting:
            index, above = waiting.pop()
            seen += 1
            if seen > min(MAX_NODES, len(self.document["nodes"])):
                raise GltfError("the GLB file's nodes contain each other")
            node = self.document["nodes"][index]
            matrix = above @ _local(node)
            if "mesh" in node:
                title = node.get("name") or ""
                found += [Part(p.geometry, p.material, title or p.name, matrix[:3]) for p in self.mesh(node["mesh"])]
            if "skin" in node:
                self.warn("skins are drawn in their rest pose")
            waiting += [(child, matrix) for child in reversed(node.get("children", ()))]
        if not found and not self.diagnostics.failed:
            raise GltfError("the GLB file shows no mesh")
        return found

    def warn(self, message: str) -> None:
        if message not in self.warned:
            self.warned.add(message)
            self.diagnostics.warning(message, Span(self.name))

    def mesh(self, index: int) -> list[Part]:
        if index not in self.meshes:
            mesh = self.document["meshes"][index]
            made = [self.primitive(p, mesh.get("name") or f"mesh {index}") for p in mesh["primitives"]]
            self.meshes[index] = [p for p in made if p is not None]
        return self.meshes[index]

    def primitive(self, primitive: dict[str, Any], name: str) -> Part | None:
        """§3.7.2: positions, normals, the first set of texture coordinates and colours of a primitive of triangles."""
        mode = primitive.get("mode", TRIANGLES)
        if mode not in (TRIANGLES, STRIP, FAN):
            self.warn("points and lines are not drawn")
            return None
        if primitive.get("targets"):
            self.warn("morph targets are not drawn")
        attributes = primitive["attributes"]
        points = self.accessor(attributes["POSITION"]).astype(np.float64)
        order = self.accessor(primitive["indices"]).reshape(-1) if "indices" in primitive else np.arange(len(points))
        triangles = _triangles(order.astype(np.int64), mode)
        if len(triangles) and triangles.max() >= len(points):
            raise GltfError(f"the GLB file's mesh `{name}` has indices beyond its {len(points)} vertices")
        sound = np.isfinite(points[triangles]).all(axis=(1, 2))
        triangles = triangles[sound]
        given = {key: self.accessor(attributes[key])[: len(points)] for key in ("NORMAL", "TEXCOORD_0", "COLOR_0") if key in attributes}
        uvs = given.get("TEXCOORD_0")
        mesh = polygon_mesh.PolyMesh(
            points, np.full(len(triangles), 3), triangles.reshape(-1),
            MeshAttribute(given["NORMAL"]) if "NORMAL" in given else None,
            None if uvs is None else MeshAttribute(np.stack([uvs[:, 0], 1.0 - uvs[:, 1]], axis=1)),  # their v goes down the picture
            MeshAttribute(given["COLOR_0"][:, :3]) if "COLOR_0" in given else None,
        )  # fmt: skip
        material = self.material(primitive["material"]) if "material" in primitive else None
        return add(mesh, material, name, self.builder, self.diagnostics, Span(self.name))

    def accessor(self, index: int) -> np.ndarray:
        """(count, width) of an accessor (§3.6.2), whole numbers marked `normalized` as floats. Sparse ones have their changes applied."""
        a = self.document["accessors"][index]
        kind = np.dtype(_TYPES[a["componentType"]])
        width, count = _WIDTHS[a["type"]], int(a["count"])
        if "bufferView" in a:
            values = self.view(a["bufferView"], a.get("byteOffset", 0), kind, width, count)
        else:
            if count * width > len(self.binary) + (1 << 20):
                raise GltfError("the GLB file promises more numbers than it can hold")
            values = np.zeros((count, width), kind)
        if "sparse" in a:
            where, new, changed = a["sparse"]["indices"], a["sparse"]["values"], int(a["sparse"]["count"])
            rows = self.view(where["bufferView"], where.get("byteOffset", 0), np.dtype(_TYPES[where["componentType"]]), 1, changed)
            values = values.copy()
            values[rows[:, 0]] = self.view(new["bufferView"], new.get("byteOffset", 0), kind, width, changed)
        if a.get("normalized") and kind.kind in "iu":
            return np.maximum(values / np.iinfo(kind).max, -1.0)
        return values

    def view(self, index: int, offset: int, kind: np.dtype[Any], width: int, count: int) -> np.ndarray:
        view = self.document["bufferViews"][index]
        stride = view.get("byteStride", kind.itemsize * width)
        start = view.get("byteOffset", 0) + offset
        if view.get("buffer", 0) != 0 or start < 0 or start + stride * (count - 1) + kind.itemsize * width > len(self.binary):
            raise GltfError("the GLB file's data lies outside of it")
        return np.ndarray((count, width), kind, self.binary, start, (stride, kind.itemsize))

    def material(self, index: int) -> int:
        if index not in self.materials:
            material = self.document["materials"][index]
            self.materials[index] = self.builder.material(metallic_roughness.material(self.surface(material)), Span(self.name))
        return self.materials[index]

    def surface(self, material: dict[str, Any]) -> metallic_roughness.Surface:
        """§3.9: base colour, metallic, roughness, emission and, for BLEND and MASK, opacity."""
        if "extensions" in material:
            self.warn(f"of materials, {', '.join(sorted(material['extensions']))} are not drawn")
        pbr = material.get("pbrMetallicRoughness", {})
        packed = pbr.get("metallicRoughnessTexture")
        r, g, b, a = pbr.get("baseColorFactor", (1.0, 1.0, 1.0, 1.0))
        mode = material.get("alphaMode", "OPAQUE")
        picture = self.texture(pbr.get("baseColorTexture"))
        whole = mode == "OPAQUE" or (mode == "BLEND" and picture == NONE)
        holes = None if whole else Input.number(float(a), self.builder.alpha_of(picture))
        emissive = tuple(material.get("emissiveFactor", (0.0, 0.0, 0.0)))
        occlusion = material.get("occlusionTexture")
        return metallic_roughness.Surface(
            Input((r, g, b), picture),
            Input.number(float(pbr.get("metallicFactor", 1.0)), self.texture(packed, 2)),
            Input.number(float(pbr.get("roughnessFactor", 1.0)), self.texture(packed, 1)),
            emissive=Input(emissive, self.texture(material.get("emissiveTexture"))), normal=self.normal(material.get("normalTexture")),
            occlusion=Input.number(1.0, self.texture(occlusion, 0)) if occlusion else metallic_roughness.ALL,
            opacity=float(a) if mode == "BLEND" and holes is None else 1.0, holes=holes,
            threshold=max(float(material.get("alphaCutoff", 0.5)), LEAST_CUTOFF) if mode == "MASK" else 0.0, name=material.get("name", ""),
        )  # fmt: skip

    def normal(self, reference: dict[str, Any] | None) -> Input | None:
        """A normal map, with its strength; None where there is none."""
        row = self.texture(reference, DATA)
        if reference is None or row == NONE:
            return None
        strength = float(reference.get("scale", 1.0))
        return Input((strength, strength, 1.0), self.builder.with_levels(row, (2.0, 2.0, 2.0), (-1.0, -1.0, -1.0)))

    def texture(self, reference: dict[str, Any] | None, channel: int = -1) -> int:
        """The row of a picture that a material refers to: a colour, one of its channels, or all of them as DATA."""
        if reference is None:
            return NONE
        if reference.get("texCoord", 0) != 0:
            self.warn("pictures with texture coordinates other than the first set use the first")
        texture = self.document["textures"][reference["index"]]
        picture = self.document["images"][texture["source"]]
        if "bufferView" not in picture:
            self.warn("pictures outside of the GLB file are not read")
            return NONE
        view = self.document["bufferViews"][picture["bufferView"]]
        start = view.get("byteOffset", 0)
        title = f"{self.name}[{texture['source']}]"
        try:
            data = self.binary[start : start + view["byteLength"]]
            row = images.row_from_bytes(self.builder, data, title, color=channel == -1, span=Span(self.name))
        except images.ImageError as failure:
            self.diagnostics.warning(failure.message, Span(self.name), failure.hint)
            return NONE
        sampler = self.document["samplers"][texture["sampler"]] if "sampler" in texture else {}
        wrap_u, wrap_v = (_WRAPS.get(sampler.get(k, 10497), ir.Wrap.REPEAT) for k in ("wrapS", "wrapT"))
        nearest = sampler.get("magFilter") == 9728
        frame = _frame(reference.get("extensions", {}).get("KHR_texture_transform", {}))
        return self.builder.texture(
            TextureData(ir.TextureKind.IMAGE, row, wrap_u=wrap_u, wrap_v=wrap_v, nearest=nearest, channel=max(channel, -1), frame=frame),
            Span(self.name),
        )


def _frame(moved: dict[str, Any]) -> Any:
    """KHR_texture_transform, uv' = T · R · S · uv with v down, as a frame for v up."""
    (ox, oy), angle, (sx, sy) = moved.get("offset", (0.0, 0.0)), moved.get("rotation", 0.0), moved.get("scale", (1.0, 1.0))
    c, s = float(np.cos(angle)), float(np.sin(angle))
    down = np.array([[c * sx, s * sy, ox], [-s * sx, c * sy, oy], [0, 0, 1]])
    turn = np.array([[1.0, 0, 0], [0, -1, 1], [0, 0, 1]])
    up = turn @ down @ turn
    return tuple(map(tuple, (up[:2] + 0.0).tolist()))


def _local(node: dict[str, Any]) -> np.ndarray:
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    rotation = Quaternion(*map(float, node["rotation"])) if any(node.get("rotation", ())) else None
    return transforms.place(node.get("translation"), rotation, node.get("scale"))


def _triangles(order: np.ndarray, mode: int) -> np.ndarray:
    """(t, 3) of a list, strip or fan (§3.7.2.1)."""
    if mode == TRIANGLES:
        return order[: len(order) // 3 * 3].reshape(-1, 3)
    if len(order) < 3:
        return np.zeros((0, 3), np.int64)
    if mode == FAN:
        return np.stack([np.broadcast_to(order[0], len(order) - 2), order[1:-1], order[2:]], axis=1)
    strip = np.stack([order[:-2], order[1:-1], order[2:]], axis=1)
    strip[1::2] = strip[1::2][:, [0, 2, 1]]
    return strip
