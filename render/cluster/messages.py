"""Messages between client and workers: pictures and scenes as JSON and arrays, which `packing` makes bytes. No pickle."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.scene import serialize
from .. import packing
from ..film.bounce_error import Cut
from ..image.image import Image
from ..packing import Arrays

PART = 8 << 20  # bytes of an array in one message
UNSENT = ("variance", "half_difference")  # metadata of a picture that stay on the worker


# --- numbers of samples ---------------------------------------------------------------------------------------------------


def counts_to(name: str, counts: NDArray[np.int64]) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """(data, arrays) of (h, w) numbers of samples: one number, if all are equal."""
    first = int(counts.flat[0]) if counts.size else 0
    return ({name: first}, {}) if (counts == first).all() else ({}, {name: counts})


def counts_from(name: str, shape: tuple[int, int], about: Mapping[str, Any], arrays: Arrays) -> NDArray[np.int64]:
    """The numbers of samples of `counts_to`."""
    return np.full(shape, about[name], np.int64) if name in about else np.array(arrays[name])


# --- pictures --------------------------------------------------------------------------------------------------------------


def image_to(image: Image) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """(data, arrays) of a picture, without `UNSENT`."""
    metadata = {name: value for name, value in image.metadata.items() if name not in UNSENT}
    if isinstance(metadata.get("cut"), Cut):
        metadata["cut"] = asdict(metadata["cut"])
    return {"width": image.width, "height": image.height, "metadata": metadata}, dict(image.channels)


def image_from(about: Mapping[str, Any], arrays: Arrays) -> Image:
    """The picture of `image_to`."""
    metadata: dict[str, Any] = {name: packing.tuples(value) for name, value in about["metadata"].items()}
    metadata |= dict.fromkeys(UNSENT)
    cut: dict[str, Any] | None = metadata.get("cut")
    if cut is not None:
        metadata["cut"] = Cut(**cut)
    metadata["notes"] = list(metadata.get("notes", ()))
    return Image(about["width"], about["height"], {name: np.array(array) for name, array in arrays.items()}, metadata)


# --- scenes ----------------------------------------------------------------------------------------------------------------


class Parcel(NamedTuple):
    """A scene as arrays by the hash of their content, which other scenes may share."""

    key: str  # hash of `rows`
    rows: list[list[Any]]  # name, hash, dtype and shape of each array
    arrays: dict[str, NDArray[Any]]  # by hash


def parcel(scene: ir.Scene) -> Parcel:
    """The parcel of a scene: tables, textures, meshes and names; without positions in source files, which no picture needs."""
    bare = replace(scene, spans=ir.Spans(), files=(), params=(), defaults=())
    rows, arrays = [], {}
    for name, array in serialize.to_arrays(bare).items():
        data = np.ascontiguousarray(array)
        digest = hashlib.blake2b(f"{data.dtype.str} {data.shape} ".encode(), digest_size=16)
        digest.update(data.reshape(-1).view(np.uint8).data if data.size else b"")
        rows.append([name, digest.hexdigest(), data.dtype.str, list(data.shape)])
        arrays[rows[-1][1]] = data
    return Parcel(hashlib.blake2b(json.dumps(rows).encode(), digest_size=16).hexdigest(), rows, arrays)


def scene_from(rows: list[list[Any]], arrays: Arrays) -> ir.Scene:
    """The scene of a parcel's rows."""
    return serialize.from_arrays({name: arrays[digest] for name, digest, _, _ in rows})
