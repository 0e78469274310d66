"""Decodes EXT_meshopt_compression: buffer views of glTF files as gltfpack writes them.

Format: the appendix of the extension (Khronos registry, EXT_meshopt_compression), version 0 of the attribute codec, 1 of the index codecs.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .gltf_errors import GltfError

EXTENSIONS = ("EXT_meshopt_compression", "KHR_meshopt_compression")
MOST_BYTES = 1 << 31
_GROUP, _MOST_BLOCK, _BLOCK_BYTES, _LEAST_TAIL = 16, 256, 8192, 32
_SENTINELS2 = tuple(sum((byte >> shift) & 3 == 3 for shift in (0, 2, 4, 6)) for byte in range(256))  # of each byte of 2-bit deltas
_SENTINELS4 = tuple(sum((byte >> shift) & 15 == 15 for shift in (0, 4)) for byte in range(256))


def decode(data: bytes, extension: dict[str, Any]) -> bytes:
    """The bytes of a buffer view from its compressed `data` and its extension. Raises GltfError."""
    count, stride, mode = int(extension["count"]), int(extension["byteStride"]), extension["mode"]
    if count < 0 or stride < 1 or count * stride > MOST_BYTES:
        raise GltfError("a buffer view compressed by meshopt has an impossible size")
    try:
        if mode == "ATTRIBUTES":
            values = _filtered(_attributes(data, count, stride), extension.get("filter", "NONE"))
            return values.tobytes()
        indices = _Triangles(data, count).decode() if mode == "TRIANGLES" else _sequence(data, count)
    except (IndexError, ValueError):
        raise GltfError("a buffer view compressed by meshopt is damaged") from None
    return np.array(indices, np.uint32).astype(np.uint16 if stride == 2 else np.uint32).tobytes()


def _attributes(data: bytes, count: int, stride: int) -> np.ndarray:
    """The vertices (count, stride) of bytes: deltas of each byte from the vertex before, in blocks of groups of 16."""
    if not data or data[0] != 0xA0:
        raise GltfError(f"version {data[0] & 15 if data else 0} of meshopt's attribute codec is not read: version 0 is")
    if stride % 4 or stride > _MOST_BLOCK:
        raise ValueError
    block = min(_BLOCK_BYTES // stride // _GROUP * _GROUP, _MOST_BLOCK)
    modes, offsets, places, offset = [], [], [], 1
    for first in range(0, count, block):
        size = min(block, count - first)
        groups = -(-size // _GROUP)
        for k in range(stride):
            header, offset = offset, offset + -(-groups // 4)
            for g in range(groups):
                mode = data[header + (g >> 2)] >> (2 * (g & 3)) & 3
                modes.append(mode)
                offsets.append(offset)
                places.append((first + g * _GROUP) * stride + k)
                offset += _group_size(data, offset, mode)
    if offset + max(stride, _LEAST_TAIL) > len(data):
        raise ValueError
    deltas = _groups(np.frombuffer(data, np.uint8), np.array(modes, np.int64), np.array(offsets, np.int64))
    bytes_out = np.zeros((count + _GROUP) * stride, np.uint8)
    rows = np.array(places, np.int64)[:, None] + np.arange(_GROUP) * stride
    bytes_out[rows] = deltas
    bytes_out = bytes_out[: count * stride].reshape(count, stride)
    signed = (bytes_out >> 1) ^ (-(bytes_out & 1).astype(np.int8)).view(np.uint8)  # zigzag
    base = np.frombuffer(data, np.uint8)[len(data) - stride :]
    return base + np.cumsum(signed, axis=0, dtype=np.uint8)


def _group_size(data: bytes, offset: int, mode: int) -> int:
    """Bytes of a group of 16 deltas: 0, 2, 4 or 8 bits each, and a byte for each that is the largest of its bits."""
    if mode == 0:
        return 0
    if mode == 1:
        return 4 + sum(_SENTINELS2[byte] for byte in data[offset : offset + 4])
    return 8 + sum(_SENTINELS4[byte] for byte in data[offset : offset + 8]) if mode == 2 else _GROUP


def _groups(data: np.ndarray, modes: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """The deltas (n, 16) of groups."""
    groups = np.zeros((len(modes), _GROUP), np.uint8)
    raw = np.flatnonzero(modes == 3)
    groups[raw] = data[offsets[raw, None] + np.arange(_GROUP)]
    for mode, bits in ((1, 2), (2, 4)):
        rows = np.flatnonzero(modes == mode)
        each, packed = 8 // bits, 2 * bits
        source = data[offsets[rows, None] + np.arange(packed)]
        shifts = 8 - bits * (np.arange(each) + 1)
        values = ((source[:, :, None] >> shifts) & ((1 << bits) - 1)).reshape(-1, _GROUP).astype(np.uint8)
        escaped = values == (1 << bits) - 1
        rank = np.cumsum(escaped, axis=1) - 1
        further = data[np.minimum(offsets[rows, None] + packed + np.maximum(rank, 0), len(data) - 1)]
        groups[rows] = np.where(escaped, further, values)
    return groups


def _filtered(values: np.ndarray, name: str) -> np.ndarray:
    """Vertices (count, stride) of bytes after a filter."""
    if name == "NONE":
        return values
    stride = values.shape[1]
    if name == "OCTAHEDRAL":
        kind = np.dtype("<i1" if stride == 4 else "<i2")
        stored = np.ascontiguousarray(values).view(kind)
        x, y = stored[:, 0].astype(np.float64), stored[:, 1].astype(np.float64)
        z = stored[:, 2] - np.abs(x) - np.abs(y)
        fold = np.minimum(z, 0.0)
        x, y = x + np.where(x >= 0, fold, -fold), y + np.where(y >= 0, fold, -fold)
        scale = np.iinfo(kind).max / np.maximum(np.sqrt(x * x + y * y + z * z), 1e-30)
        filtered = stored.copy()
        for column, axis in enumerate((x, y, z)):
            filtered[:, column] = _rounded(axis * scale)
        return filtered.view(np.uint8)
    if name == "QUATERNION":
        stored = np.ascontiguousarray(values).view("<i2").astype(np.int64)
        share = np.sqrt(0.5) / (stored[:, 3] | 3)
        small = stored[:, :3] * share[:, None]
        largest = np.sqrt(np.maximum(1.0 - (small * small).sum(axis=1), 0.0))
        filtered = np.zeros((len(stored), 4), "<i2")
        which = stored[:, 3] & 3
        for k, axis in enumerate((largest, small[:, 0], small[:, 1], small[:, 2])):
            filtered[np.arange(len(stored)), (which + k) & 3] = _rounded(axis * 32767.0)
        return filtered.view(np.uint8)
    if name == "EXPONENTIAL":
        stored = np.ascontiguousarray(values).view("<i4")
        return np.ldexp((stored << 8 >> 8).astype(np.float64), stored >> 24).astype("<f4").view(np.uint8)
    raise GltfError(f"the filter `{str(name)[:40]}` of meshopt is not known")


def _rounded(values: np.ndarray) -> np.ndarray:
    return np.trunc(values + np.where(values >= 0, 0.5, -0.5)).astype(np.int64)


def _varint(data: bytes, offset: int) -> tuple[int, int]:
    """(an unsigned number of 7 bits a byte, the place after it)."""
    value, shift = 0, 0
    while True:
        byte = data[offset]
        offset += 1
        value |= (byte & 127) << shift
        if byte < 128:
            return value, offset
        shift += 7


def _signed(value: int) -> int:
    return value >> 1 ^ -(value & 1)


def _sequence(data: bytes, count: int) -> list[int]:
    """Indices as differences from one of two earlier ones."""
    if not data or data[0] != 0xD1:
        raise ValueError
    last, indices, offset = [0, 0], [], 1
    for _ in range(count):
        value, offset = _varint(data, offset)
        which = value & 1
        last[which] = (last[which] + _signed(value >> 1)) & 0xFFFFFFFF
        indices.append(last[which])
    return indices


class _Triangles:
    """Decodes indices of triangles, which share edges and vertices with recent ones."""

    def __init__(self, data: bytes, count: int) -> None:
        if not data or data[0] != 0xE1 or count % 3:
            raise ValueError
        self.data, self.codes, self.at = data, data[1 : 1 + count // 3], 1 + count // 3
        self.table = data[len(data) - 16 :]
        self.edges, self.vertices = [(0, 0)] * 16, [0] * 16
        self.edge_at = self.vertex_at = self.following = self.last = 0

    def decode(self) -> list[int]:
        indices: list[int] = []
        for code in self.codes:
            indices += self.on_edge(code) if code < 0xF0 else self.apart(code)
        return indices

    def vertex(self, v: int) -> int:
        self.vertices[self.vertex_at] = v
        self.vertex_at = self.vertex_at + 1 & 15
        return v

    def edge(self, a: int, b: int) -> None:
        self.edges[self.edge_at] = (a, b)
        self.edge_at = self.edge_at + 1 & 15

    def next(self) -> int:
        self.following += 1
        return self.following - 1

    def written(self) -> int:
        """An index as its difference from the last one that was written so."""
        value, self.at = _varint(self.data, self.at)
        self.last = (self.last + _signed(value)) & 0xFFFFFFFF
        return self.last

    def on_edge(self, code: int) -> tuple[int, int, int]:
        """A triangle on a recent edge."""
        a, b = self.edges[self.edge_at - 1 - (code >> 4) & 15]
        third = code & 15
        if third == 0:
            c = self.vertex(self.next())
        elif third < 13:
            c = self.vertices[self.vertex_at - 1 - third & 15]
        elif third == 15:
            c = self.vertex(self.written())
        else:
            self.last = (self.last + (1 if third == 14 else -1)) & 0xFFFFFFFF
            c = self.vertex(self.last)
        self.edge(c, b)
        self.edge(a, c)
        return a, b, c

    def apart(self, code: int) -> tuple[int, int, int]:
        """A triangle on no recent edge: of new, recent and, from code 254 on, written vertices."""
        free = code >= 0xFE
        if free:
            packed = self.data[self.at]
            self.at += 1
            self.following = self.following if packed else 0
        else:
            packed = self.table[code & 15]
        sources = (15 if code == 0xFF else 0, packed >> 4, packed & 15)
        corners = [self.next() if source == 0 else self.vertices[self.vertex_at - source & 15] for source in sources]
        corners = [self.written() if source == 15 and free else v for source, v in zip(sources, corners, strict=True)]
        for source, v in zip(sources, corners, strict=True):
            if source == 0 or (source == 15 and free):
                self.vertex(v)
        a, b, c = corners
        self.edge(b, a)
        self.edge(c, b)
        self.edge(a, c)
        return a, b, c
