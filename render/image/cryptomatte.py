"""Cryptomatte channels: ranked pairs of id and coverage in each pixel, for compositing.

Friedman & Jones 2015, Fully Automatic ID Mattes with Support for Motion Blur and Transparency, and the Cryptomatte specification 1.2.0:
an id is the MurmurHash3 of a name, as the bits of a float32; a file's manifest lists the names.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir

LAYERS = {"crypto_object": "CryptoObject", "crypto_material": "CryptoMaterial"}  # channel -> name of the layer
RANKS = 6  # most pairs of a pixel, those of greatest coverage
SAMPLES = 64  # most samples of a pixel that coverage is computed from
_MASK = 0xFFFFFFFF


def murmur3(data: bytes, seed: int = 0) -> int:
    """MurmurHash3_x86_32 (Appleby)."""
    h = seed
    end = len(data) & ~3
    for offset in range(0, end, 4):
        h ^= _scramble(int.from_bytes(data[offset : offset + 4], "little"))
        h = ((h << 13 | h >> 19) * 5 + 0xE6546B64) & _MASK
    if len(data) > end:
        h ^= _scramble(int.from_bytes(data[end:], "little"))
    h ^= len(data)
    h = ((h ^ h >> 16) * 0x85EBCA6B) & _MASK
    h = ((h ^ h >> 13) * 0xC2B2AE35) & _MASK
    return h ^ h >> 16


def _scramble(k: int) -> int:
    k = (k * 0xCC9E2D51) & _MASK
    k = (k << 15 | k >> 17) & _MASK
    return (k * 0x1B873593) & _MASK


def id_of(name: str) -> int:
    """Return the 32 bits of a name's id, which are a normal float32."""
    bits = murmur3(name.encode())
    return bits ^ (1 << 23) if bits >> 23 & 255 in (0, 255) else bits


def names_of(scene: ir.Scene) -> dict[str, tuple[str, ...]]:
    """Return each channel's names of instances: their own, or their materials'; nameless ones get their kind and row."""
    tables = scene.tables
    kinds = tables.geometries.kind[tables.instances.geometry].tolist()
    objects = _named(scene.names.instances, [ir.GeometryKind(kind).name for kind in kinds])
    materials = _named(scene.names.materials, [ir.MaterialModel(model).name for model in tables.materials.model.tolist()])
    return {"crypto_object": objects, "crypto_material": tuple(materials[row] for row in tables.instances.material.tolist())}


def _named(names: Sequence[str], kinds: Sequence[str]) -> tuple[str, ...]:
    """Names, or kind and row."""
    named = names or [""] * len(kinds)
    return tuple(name or f"{kind.lower()}.{row}" for row, (name, kind) in enumerate(zip(named, kinds, strict=True)))


class Mattes:
    """The Cryptomatte layers of a picture."""

    def __init__(self, scene: ir.Scene, channels: Sequence[str]) -> None:
        self.channels = tuple(channels)
        self._names = {name: names for name, names in names_of(scene).items() if name in channels}
        self._ids = {name: np.array([id_of(n) for n in names] or [0], np.uint32).view(np.float32) for name, names in self._names.items()}

    def put(self, seen: NDArray[np.int64], out: dict[str, NDArray[np.float32]]) -> None:
        """Write the channels, (h, w, 2 · RANKS) each, of samples that hit instances (n, h · w), -1 for misses."""
        for name, ids in self._ids.items():
            distinct, which = np.unique(ids, return_inverse=True)
            label = np.where(seen >= 0, which[np.maximum(seen, 0)], len(distinct))
            out[name][...] = rank(label, distinct).reshape(out[name].shape)

    @property
    def attributes(self) -> dict[str, str]:
        """The file attributes of the layers."""
        said = {}
        for name, names in self._names.items():
            layer = LAYERS[name]
            key = f"cryptomatte/{murmur3(layer.encode()):08x}"[:-1]
            said[f"{key}/name"], said[f"{key}/hash"], said[f"{key}/conversion"] = layer, "MurmurHash3_32", "uint32_to_float32"
            manifest = {n: f"{id_of(n):08x}" for n in sorted(set(names))}
            said[f"{key}/manifest"] = json.dumps(manifest, ensure_ascii=False, separators=(",", ":"))
        return said


def rank(label: NDArray[np.int64], ids: NDArray[np.float32]) -> NDArray[np.float32]:
    """(pixels, 2 · RANKS) ids and coverages of each pixel by falling coverage; label (n, pixels) is len(ids) for misses."""
    n, pixels = label.shape
    present = np.unique(label)
    present = present[present < len(ids)]
    ranked = np.zeros((pixels, RANKS, 2), np.float32)
    if len(present) == 0:
        return ranked.reshape(pixels, 2 * RANKS)
    place = np.full(len(ids) + 1, len(present))
    place[present] = np.arange(len(present))
    counts = np.bincount((place[label] * pixels + np.arange(pixels)).ravel(), minlength=(len(present) + 1) * pixels)
    counts = counts.reshape(-1, pixels)[: len(present)]
    order = np.argsort(-counts, axis=0, kind="stable")[:RANKS]
    share = np.take_along_axis(counts, order, axis=0).T / np.float32(n)
    ranked[:, : share.shape[1], 0] = np.where(share > 0, ids[present][order].T, np.float32(0.0))
    ranked[:, : share.shape[1], 1] = share
    return ranked.reshape(pixels, 2 * RANKS)


def channel_names(name: str) -> tuple[str, ...]:
    """Return the names of a layer's channels in a file: two pairs in four components."""
    return tuple(f"{LAYERS[name]}{k // 4:02d}.{'RGBA'[k % 4]}" for k in range(2 * RANKS))


def matte(channel: NDArray[Any], name: str) -> NDArray[np.float64]:
    """Return (h, w): coverage of each pixel by the instance or material of a name."""
    pairs = channel.reshape(*channel.shape[:2], RANKS, 2)
    return np.where(np.ascontiguousarray(pairs[..., 0]).view(np.uint32) == id_of(name), pairs[..., 1], 0.0).sum(axis=-1)
