"""A .glb file in the making: its JSON document and its binary chunk (glTF 2.0 §3.6 and §4)."""

from __future__ import annotations

import json
from collections.abc import Hashable
from typing import Any

import numpy as np

_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
_FLOAT, _UNSIGNED = 5126, 5125
_ARRAY, _ELEMENTS = 34962, 34963


class Container:
    """The document and its buffer."""

    def __init__(self) -> None:
        self.document: dict[str, Any] = {"asset": {"version": "2.0", "generator": "maquette"}}
        self._chunks: list[bytes] = []
        self._size = 0
        self._known: dict[Hashable, int] = {}

    def add(self, kind: str, value: dict[str, Any]) -> int:
        """The index of a new entry of one of the document's lists."""
        entries = self.document.setdefault(kind, [])
        entries.append(value)
        return len(entries) - 1

    def shared(self, kind: str, value: dict[str, Any]) -> int:
        """The index of an entry; equal entries are one."""
        key = (kind, json.dumps(value, sort_keys=True))
        if key not in self._known:
            self._known[key] = self.add(kind, value)
        return self._known[key]

    def use(self, extension: str) -> None:
        """Declare an extension."""
        used = self.document.setdefault("extensionsUsed", [])
        if extension not in used:
            used.append(extension)

    def floats(self, values: np.ndarray, bounds: bool = False) -> int:
        """The accessor of vertex values (n, width), in single precision."""
        data = np.ascontiguousarray(values, "<f4")
        accessor: dict[str, Any] = {"bufferView": self.view(data.tobytes(), _ARRAY), "componentType": _FLOAT, "count": len(data)}
        accessor["type"] = _TYPES[data.shape[1]]
        if bounds:
            accessor |= {"min": data.min(axis=0).tolist(), "max": data.max(axis=0).tolist()}
        return self.add("accessors", accessor)

    def indices(self, triangles: np.ndarray) -> int:
        """The accessor of triangles (m, 3)."""
        data = np.ascontiguousarray(triangles, "<u4")
        view = self.view(data.tobytes(), _ELEMENTS)
        return self.add("accessors", {"bufferView": view, "componentType": _UNSIGNED, "count": data.size, "type": "SCALAR"})

    def view(self, data: bytes, target: int | None = None) -> int:
        """The buffer view of bytes."""
        described: dict[str, Any] = {"buffer": 0, "byteOffset": self._size, "byteLength": len(data)}
        padded = data + bytes(-len(data) % 4)
        self._chunks.append(padded)
        self._size += len(padded)
        return self.add("bufferViews", described if target is None else {**described, "target": target})

    def encode(self) -> bytes:
        """The file."""
        binary = b"".join(self._chunks)
        if binary:
            self.document["buffers"] = [{"byteLength": len(binary)}]
        text = json.dumps(self.document, ensure_ascii=False, separators=(",", ":"), allow_nan=False).encode()
        text += b" " * (-len(text) % 4)
        chunks = [(text, b"JSON"), (binary, b"BIN\0")] if binary else [(text, b"JSON")]
        body = b"".join(np.uint32(len(data)).tobytes() + kind + data for data, kind in chunks)
        return b"glTF" + np.array([2, 12 + len(body)], "<u4").tobytes() + body
