"""Rows and names of instances for the scene builder: one by one, and whole arrays of copies, which take less memory."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from .. import ir
from ..ir import I32, I64

GEOMETRY, TRANSFORM, MATERIAL, LIGHT, VISIBLE = map(ir.Instances._fields.index, ("geometry", "transform", "material", "light", "visible"))
Row = tuple[int, ...]
_LISTED = 10_000  # up to so many copies, each has a name of its own in memory


class InstanceRows:
    """Rows of ir.Instances in the order in which they are added."""

    def __init__(self) -> None:
        self._blocks: list[I32] = []
        self._rows: list[Row] = []  # after the blocks
        self._length = 0

    def __len__(self) -> int:
        return self._length

    def append(self, row: Row) -> None:
        self._rows.append(row)
        self._length += 1

    def extend(self, rows: Iterable[Row]) -> None:
        before = len(self._rows)
        self._rows.extend(rows)
        self._length += len(self._rows) - before

    def block(self, rows: I32) -> None:
        """Add rows (n, columns) of an array."""
        self._flush()
        self._blocks.append(rows)
        self._length += len(rows)

    def table(self) -> I32:
        """All rows, (n, columns)."""
        self._flush()
        if len(self._blocks) > 1:
            self._blocks = [np.concatenate(self._blocks)]
        return self._blocks[0] if self._blocks else np.zeros((0, len(ir.Instances._fields)), np.int32)

    def _flush(self) -> None:
        if self._rows:
            self._blocks.append(np.array(self._rows, np.int32))
            self._rows = []


class InstanceNames:
    """Names of instances in the order of their rows."""

    def __init__(self) -> None:
        self._stems: list[str] = []
        self._copies: list[tuple[int, I64]] = []  # row of their stem, their ids

    def append(self, name: str) -> None:
        self._stems.append(name)

    def extend(self, names: Iterable[str]) -> None:
        self._stems.extend(names)

    def copies(self, name: str, ids: I64) -> None:
        """Add `name[id]` for each id."""
        if len(ids) <= _LISTED:
            self.extend(f"{name}[{k}]" for k in ids.tolist())
            return
        self._copies.append((len(self._stems), ids))
        self._stems.append(name)

    def names(self) -> Sequence[str]:
        if not self._copies:
            return tuple(self._stems)
        rows, ids, first = [], [], 0
        for stem, numbers in self._copies:
            rows += [np.arange(first, stem, dtype=np.int32), np.full(len(numbers), stem, np.int32)]
            ids += [np.full(stem - first, -1), numbers]
            first = stem + 1
        rows.append(np.arange(first, len(self._stems), dtype=np.int32))
        ids.append(np.full(len(self._stems) - first, -1))
        return ir.CopyNames(tuple(self._stems), np.concatenate(rows), np.concatenate(ids))
