"""Opens glTF 2.0 containers, .glb and .gltf: the JSON document, its buffers and accessors.

Format: glTF 2.0 (Khronos, ISO/IEC 12113:2022), sections named in the functions.
"""

from __future__ import annotations

import base64
import binascii
import json
import math
import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import unquote, unquote_to_bytes

import numpy as np

from ...lang import text_encoding
from ..io.regular_files import read_bytes
from ..io.sandbox import FileError, Files
from . import gltf_meshopt
from .common import file_names
from .gltf_errors import GltfError

_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}

_TABLES = (
    "scenes", "nodes", "meshes", "materials", "textures", "images", "samplers", "accessors", "bufferViews", "buffers", "cameras", "skins",
    "animations",
)  # fmt: skip
_CHILDREN = {"scenes": ("nodes",), "nodes": ("children",), "meshes": ("primitives",), "animations": ("channels", "samplers")}


class Rows(list[Any]):
    """A table of a document. Indices in a file count from 0: negative ones, which Python counts from the end, are errors."""

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, int) and index < 0:
            raise IndexError(f"there is no row {index}")
        return super().__getitem__(index)


@dataclass(slots=True)
class Container:
    """A glTF document with its buffers. `binary` is the chunk of a .glb; `folder` holds the files that a .gltf references."""

    document: dict[str, Any]
    binary: bytes
    folder: Path | None
    files: Files
    decoded: dict[int, np.ndarray] = field(default_factory=dict)  # (count, width) stored values of accessors that were compressed
    warnings: list[str] = field(default_factory=list)  # of the container itself
    _buffers: dict[int, bytes] = field(default_factory=dict)
    _views: dict[int, bytes] = field(default_factory=dict)  # that were compressed

    def bytes_at(self, uri: str, what: str) -> bytes:
        """The content of a data URI, or of a file beside the document. Raises GltfError, FileError."""
        if uri.startswith("data:"):
            head, comma, body = uri.partition(",")
            if not comma:
                raise GltfError("a data URI has no data")
            try:
                return base64.b64decode(unquote(body), validate=False) if head.endswith(";base64") else unquote_to_bytes(body)
            except binascii.Error:
                raise GltfError("a data URI is not base64") from None
        if self.folder is None:
            raise GltfError(f"the {what} `{uri}` is not read: its mesh has no folder")
        try:
            return read_bytes(file_names.find(unquote(uri), self.folder, self.files, what))
        except FileError:
            if unquote(uri) == uri or (path := file_names.existing_path(uri, self.folder)) is None:
                raise
            return read_bytes(self.files.find(path.name, path.parent, what))  # its name holds the code of a character

    def buffer(self, index: int) -> bytes:
        """The bytes of a buffer (§3.6.1): the binary chunk, a file or a data URI."""
        if index not in self._buffers:
            written = self.document["buffers"][index]
            try:
                self._buffers[index] = self.bytes_at(written["uri"], "buffer") if "uri" in written else self.binary
            except FileError as failure:
                raise GltfError(failure.message) from None
        return self._buffers[index]

    def view_bytes(self, index: int) -> bytes:
        """The bytes of a buffer view, decompressed."""
        view = self.document["bufferViews"][index]
        extensions = view.get("extensions", {})
        packed = next((extensions[name] for name in gltf_meshopt.EXTENSIONS if name in extensions), None)
        if packed is not None:
            if index not in self._views:
                start = packed.get("byteOffset", 0)
                data = self.buffer(packed["buffer"])[start : start + packed["byteLength"]]
                self._views[index] = gltf_meshopt.decode(data, packed)
            return self._views[index]
        start = view.get("byteOffset", 0)
        return self.buffer(view.get("buffer", 0))[start : start + view["byteLength"]]

    def accessor(self, index: int) -> np.ndarray:
        """(count, width) values of an accessor (§3.6.2), sparse substitutions applied. `normalized` integers become floats."""
        a = self.document["accessors"][index]
        kind = np.dtype(_TYPES[a["componentType"]])
        width, count = _WIDTHS[a["type"]], int(a["count"])
        if index in self.decoded:
            values = self.decoded[index]
            kind = values.dtype
        elif "bufferView" in a:
            values = self._view(a["bufferView"], a.get("byteOffset", 0), kind, width, count)
        else:
            if count * width > len(self.binary) + (1 << 20):
                raise GltfError("the glTF file promises more numbers than it can hold")
            values = np.zeros((count, width), kind)
        if "sparse" in a:
            where, new, changed = a["sparse"]["indices"], a["sparse"]["values"], int(a["sparse"]["count"])
            rows = self._view(where["bufferView"], where.get("byteOffset", 0), np.dtype(_TYPES[where["componentType"]]), 1, changed)
            values = values.copy()
            values[rows[:, 0]] = self._view(new["bufferView"], new.get("byteOffset", 0), kind, width, changed)
        if a.get("normalized") and kind.kind in "iu":
            return np.maximum(values / np.iinfo(kind).max, -1.0)
        return values

    def _view(self, index: int, offset: int, kind: np.dtype[Any], width: int, count: int) -> np.ndarray:
        view = self.document["bufferViews"][index]
        stride = view.get("byteStride", kind.itemsize * width)
        if any(name in view.get("extensions", {}) for name in gltf_meshopt.EXTENSIONS):
            data, start = self.view_bytes(index), offset
        else:
            first = view.get("byteOffset", 0)
            data = self.buffer(view.get("buffer", 0))
            data, start = memoryview(data)[: max(first + view.get("byteLength", len(data)), 0)], first + offset
        size = kind.itemsize * width
        held = min(count, (len(data) - start - size) // stride + 1 if stride > 0 else count)
        if start < 0 or stride < 0 or held < min(count, 1) or start + size > len(data):
            raise GltfError("the glTF file's data lies outside of it")
        if held < count:
            self.warnings.append(f"buffer view {index} ends early: {held:,} of {count:,} elements are read")
        return np.ndarray((held, width), kind, data, start, (stride, kind.itemsize))


def check_finite(part: dict[str, Any]) -> None:
    """Raises GltfError for a number in a part of a document that is not finite: JSON's 1e999 is read as infinity."""
    waiting: list[tuple[str, Any]] = list(part.items())
    while waiting:
        name, value = waiting.pop()
        if isinstance(value, float) and not math.isfinite(value):
            raise GltfError(f"`{name[:40]}` is too large or no number")
        if isinstance(value, dict):
            waiting += [(str(key), item) for key, item in value.items() if key != "extras"]
        elif isinstance(value, list):
            waiting += [(name, item) for item in value]


def open_container(data: bytes, folder: Path | None, files: Files) -> Container:
    """Parses the bytes of a .glb or .gltf file. Raises GltfError."""
    warnings: list[str] = []
    if data[:4] == b"glTF":
        document, binary = _chunks(data, warnings)
        return Container(_tidy(document, warnings), binary, folder, files, warnings=warnings)
    data = text_encoding.as_utf8(data)
    if data.lstrip()[:1] != b"{":
        raise GltfError("this is not a glTF file: it begins neither with `glTF` nor with `{`")
    return Container(_tidy(_document(data, warnings), warnings), b"", folder, files, warnings=warnings)


def _chunks(data: bytes, warnings: list[str]) -> tuple[dict[str, Any], bytes]:
    """The JSON document and the binary chunk of a .glb (§4.4)."""
    if len(data) < 20:
        raise GltfError("the glTF file ends early")
    version, _, length, kind = struct.unpack_from("<III4s", data, 4)
    if version != 2:
        raise GltfError(f"the glTF file is of version {version}; version 2 is read")
    if kind != b"JSON" or 20 + length > len(data):
        raise GltfError("the glTF file ends early")
    rest = data[20 + length :]
    return _document(data[20 : 20 + length], warnings), rest[8 : 8 + struct.unpack_from("<I", rest)[0]] if len(rest) >= 8 else b""


def _document(text: bytes, warnings: list[str]) -> dict[str, Any]:
    try:
        document, end = json.JSONDecoder().raw_decode(written := text_encoding.decode_any(text).lstrip())
    except (ValueError, RecursionError) as failure:
        raise GltfError(f"the glTF file's JSON is damaged: {failure}") from None
    if not isinstance(document, dict):
        raise GltfError("the glTF file's JSON is damaged")
    if rest := written[end:].strip():
        warnings.append(f"{len(rest)} characters after the document are left out")
    about = document.get("asset")
    version = str(about.get("version", "2.0")) if isinstance(about, dict) else "2.0"
    if not version.startswith("2."):
        raise GltfError(f"the glTF file is of version {version[:10]}; version 2 is read")
    return document


def _tidy(document: dict[str, Any], warnings: list[str]) -> dict[str, Any]:
    """The document without tables, rows and extensions of another JSON type than the format's, which are named in the warnings."""
    for table in _TABLES:
        rows = document.get(table, [])
        if not isinstance(rows, list):
            warnings.append(f"`{table}` is not a list: it is left out")
            document[table] = rows = []
        for k, row in enumerate(rows):
            if not isinstance(row, dict):
                warnings.append(f"`{table}[{k}]` is not an object: it is left out")
                rows[k] = row = {}
            for key in _CHILDREN.get(table, ()):
                if not isinstance(row.get(key, []), list):
                    warnings.append(f"`{table}[{k}].{key}` is not a list: it is left out")
                    row[key] = []
        if table in document:
            document[table] = Rows(rows)
    waiting: list[Any] = [document]
    while waiting:
        value = waiting.pop()
        if isinstance(value, dict):
            extensions = value.get("extensions", {})
            named = extensions.items() if isinstance(extensions, dict) else [("extensions", extensions)]
            for name in [name for name, value in named if not isinstance(value, dict)]:
                warnings.append(f"`{name[:40]}` is not an object: it is left out")
                if isinstance(extensions, dict):
                    del extensions[name]
                else:
                    del value["extensions"]
            waiting += [item for key, item in value.items() if key != "extras" and isinstance(item, dict | list)]
        else:
            waiting += [item for item in value if isinstance(item, dict | list)]
    return document


Warn = Callable[[str], None]
"""Reports each unsupported feature once."""
