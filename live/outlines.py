"""Outlines in the picture of the instances that a line of a source makes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiler import ir
from .scene_files import resolved

MANY = 1 << 30  # lines, more than any statement has


def of_line(scene: ir.Scene, ids: NDArray[Any], path: str, line: int) -> dict[str, Any]:
    """The outlines of the instances of the innermost statement around a line of the file `path`.

    `ids` is the channel id, (h, w, 2). Returns the size of the channel, the names of the instances, and the pixels of their outlines as
    runs: row, first column, number of columns, flat.
    """
    rows = instances(scene, path, line)
    height, width = ids.shape[:2]
    mask = np.isin(ids[..., 0], rows)
    names = dict.fromkeys(scene.names.instances[row] for row in rows if row < len(scene.names.instances))
    return {"width": width, "height": height, "names": [name for name in names if name], "runs": _runs(_edges(mask)).ravel().tolist()}


def instances(scene: ir.Scene, path: str, line: int) -> list[int]:
    """The rows of the instances whose element, or outermost call, holds a line of a file and has the fewest lines of those that do."""
    sources = [k for k, name in enumerate(scene.spans.sources) if resolved(name) == path]
    fewest = np.full(len(scene.tables.instances.geometry), MANY)
    for table in ("instances", "calls"):
        spans = scene.spans.rows.get(table)
        if spans is not None:
            inside = np.isin(spans[:, 0], sources) & (spans[:, 1] > 0) & (spans[:, 1] <= line) & (spans[:, 3] >= line)
            fewest = np.where(inside, np.minimum(fewest, spans[:, 3] - spans[:, 1]), fewest)
    return np.flatnonzero(fewest == fewest.min()).tolist() if fewest.min(initial=MANY) < MANY else []


def _edges(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The pixels of a mask with a neighbour outside it; the picture's border is outside."""
    around = np.pad(mask, 1)
    return mask & ~(around[:-2, 1:-1] & around[2:, 1:-1] & around[1:-1, :-2] & around[1:-1, 2:])


def _runs(mask: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(n, 3) runs of a mask: row, first column, number of columns."""
    steps = np.diff(np.pad(mask, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    first, last = np.argwhere(steps == 1), np.argwhere(steps == -1)
    return np.concatenate([first, (last[:, 1:] - first[:, 1:])], axis=1)
