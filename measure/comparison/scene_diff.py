"""Compares the tables of two versions of a scene: added, removed and changed rows, and the pairing of rows.

Rows are paired by equal content, then by unique names, then in order within a kind. A reference to a changed row is not a change: a sphere
whose material has another colour is unchanged.
"""

from __future__ import annotations

import hashlib
import re
from collections import Counter, defaultdict
from collections.abc import Callable, Hashable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ...compiler import ir
from ...compiler.scene import dump
from ...lang.diagnostics import Span

TABLES = ("images", "textures", "materials", "geometries", "lights", "cameras", "instances")  # referenced tables come first
_REFERENCES = {  # columns with references to rows of other tables
    "textures": {"image": "images"},
    "materials": {"textures": "textures"},
    "lights": {"image": "images"},
    "instances": {"geometry": "geometries", "material": "materials"},
}
_PLACE_COLUMNS = {  # columns of positions in pools or tables, whose content is compared, and derived columns
    "images": ("first",),
    "geometries": ("bounds", "origin", "first_vertex", "vertex_count", "first_triangle", "triangle_count", "first_polygon", "polygon_count",
                   "normals", "uvs", "colors"),
    "lights": ("transform", "instance"),
    "cameras": ("transform",),
    "instances": ("transform", "light"),
}  # fmt: skip
_KIND_COLUMNS = {"geometries": "kind", "textures": "kind", "lights": "kind", "materials": "model"}  # rows of different kinds are not paired

_NUMBER = re.compile(r"-?\d+\.\d{4,}(e[+-]\d+)?")

Pairs = dict[str, dict[int, int]]  # table -> row of A -> row of B


@dataclass(frozen=True, slots=True)
class Change:
    """An added, removed or changed row. `cells` are (column, in A, in B), none for an added or removed row."""

    what: str  # "added", "removed" or "changed"
    table: str
    row: int  # of B; of A where removed
    label: str  # "sphere `ball`"
    span: Span | None
    cells: tuple[tuple[str, str, str], ...] = ()

    def __str__(self) -> str:
        place = f" {self.span}" if self.span else ""
        cells = "; ".join(f"{column} {_transition(before, after)}" for column, before, after in self.cells)
        return f"{self.what} {self.label}{place}{': ' if cells else ''}{cells}"

    def to_json(self) -> dict[str, Any]:
        """This change as plain data."""
        cells = [{"column": column, "a": before, "b": after} for column, before, after in self.cells]
        return {"what": self.what, "table": self.table, "row": self.row, "label": self.label, "place": str(self.span or ""), "cells": cells}


def diff(a: ir.Scene, b: ir.Scene) -> tuple[list[Change], dict[int, int]]:
    """All changes from `a` to `b`, and the mapping from instances of `a` to those of `b`."""
    changes = _setting_changes(a, b)
    pairs: Pairs = {}
    digests: tuple[dict[str, list[bytes]], dict[str, list[bytes]]] = {}, {}
    for table in TABLES:
        for scene, by_table in zip((a, b), digests, strict=True):
            by_table[table] = [_digest(scene, table, row, by_table) for row in range(_count(scene, table))]
        pairs[table] = _match(a, b, table, digests[0][table], digests[1][table])
        changes += _row_changes(a, b, table, pairs, digests)
    return changes, pairs["instances"]


def label(scene: ir.Scene, table: str, row: int) -> str:
    """The label of a row: its kind and, if it has one, its name."""
    tables, names = scene.tables, getattr(scene.names, table, ())
    if table == "instances":
        light = int(tables.instances.light[row])
        kind = "light" if light >= 0 else _kind(ir.GeometryKind, tables.geometries.kind[tables.instances.geometry[row]])
    elif table == "geometries":
        kind = f"shape {_kind(ir.GeometryKind, tables.geometries.kind[row])}"
    elif table == "materials":
        kind = f"material {_kind(ir.MaterialModel, tables.materials.model[row])}"
    elif table == "textures":
        kind = f"texture {_kind(ir.TextureKind, tables.textures.kind[row])}"
    elif table == "lights":
        kind = f"light {_kind(ir.LightKind, tables.lights.kind[row])}"
    else:
        kind = table.removesuffix("s")
    name = names[row] if row < len(names) else ""
    span = scene.spans.get(table, row)
    needless = not name or name in kind.split() or (span is not None and f"<{name}>" in span.file)
    return kind if needless else f"{kind} `{name}`"


def _kind(kinds: type, value: Any) -> str:
    return kinds(int(value)).name.lower().replace("_", " ")


def _count(scene: ir.Scene, table: str) -> int:
    return len(getattr(scene.tables, table)[0])


def _transition(before: str, after: str) -> str:
    """`before → after`, with five digits if these differ."""
    short = [_NUMBER.sub(lambda number: f"{float(number[0]):.5g}", text) for text in (before, after)]
    return " → ".join(text or "nothing" for text in (short if short[0] != short[1] else (before, after)))


def _setting_changes(a: ir.Scene, b: ir.Scene) -> list[Change]:
    """Changed params and settings of `render`, as one row each."""
    changes = []
    for name, before, after in (
        ("params", *({p.name: p.value for p in scene.params} for scene in (a, b))),
        ("render", *(asdict(scene.settings) | {"duration": scene.duration, "fps": scene.fps} for scene in (a, b))),
    ):
        cells = tuple(
            (key, _text(before.get(key)), _text(after.get(key))) for key in {**before, **after} if before.get(key) != after.get(key)
        )
        if cells:
            changes.append(Change("changed", name, 0, name, None, cells))
    return changes


def _text(value: Any) -> str:
    return "" if value is None else f"{value:.6g}" if isinstance(value, float) else str(value)


def _digest(scene: ir.Scene, table: str, row: int, digests: Mapping[str, list[bytes]]) -> bytes:
    """A hash of the content of a row, with the hashes of the rows it refers to."""
    digest = hashlib.blake2b(digest_size=16)
    references = _REFERENCES.get(table, {})
    for column, values in getattr(scene.tables, table)._asdict().items():
        if column in references:
            for target in np.atleast_1d(values[row]).tolist():
                digest.update(digests[references[column]][target] if target >= 0 else b"-")
        elif column != "texels" and column not in _PLACE_COLUMNS.get(table, ()):
            digest.update(np.ascontiguousarray(values[row]).tobytes())
    for content in _content(scene, table, row).values():
        digest.update(np.ascontiguousarray(content).tobytes())
    names = getattr(scene.names, table, ())
    digest.update(names[row].encode() if row < len(names) else b"")
    return digest.digest()


def _content(scene: ir.Scene, table: str, row: int) -> dict[str, np.ndarray]:
    """The content that the place columns of a row refer to."""
    tables = scene.tables
    if table == "images":
        first = int(tables.images.first[row])
        return {"texels": tables.images.texels[first : first + int(tables.images.width[row]) * int(tables.images.height[row])]}
    if table in ("lights", "cameras", "instances"):
        matrix = tables.transforms.matrix[getattr(tables, table).transform[row]]
        return {"position": matrix[:, 3], "frame": matrix[:, :3]}
    if table == "geometries" and tables.geometries.kind[row] == ir.GeometryKind.MESH:
        return _mesh(tables, row)
    return {}


def _mesh(tables: ir.Tables, row: int) -> dict[str, np.ndarray]:
    g, pools = tables.geometries, tables.pools
    positions, triangles = ir.mesh_arrays(tables, row)
    arrays = {"vertices": positions + g.origin[row], "triangles": triangles}
    for name in ("normals", "uvs", "colors"):
        attribute = int(getattr(g, name)[row])
        if attribute >= 0:
            first, width, count = (int(getattr(tables.attributes, c)[attribute]) for c in ("first", "width", "count"))
            arrays[name] = pools.values[first : first + width * count]
    return arrays


def _match(a: ir.Scene, b: ir.Scene, table: str, from_a: list[bytes], from_b: list[bytes]) -> dict[int, int]:
    """Row of A -> row of B, each used once."""
    pairs: dict[int, int] = {}
    left_a, left_b = list(range(len(from_a))), list(range(len(from_b)))

    def pair(key: Callable[[ir.Scene, list[bytes], int], Hashable], once: bool = False) -> None:
        """Pair remaining rows with equal keys, in order; None is not a key; `once`: only keys that are unique in both."""
        waiting: dict[Hashable, list[int]] = defaultdict(list)
        for row in left_b:
            waiting[key(b, from_b, row)].append(row)
        counts = Counter(key(a, from_a, row) for row in left_a) if once else {}
        for row in left_a:
            mine = key(a, from_a, row)
            partners = waiting.get(mine, [])
            if mine is not None and partners and not (once and (counts[mine] > 1 or len(partners) > 1)):
                pairs[row] = partners.pop(0)
        left_a[:] = [row for row in left_a if row not in pairs]
        used = set(pairs.values())
        left_b[:] = [row for row in left_b if row not in used]

    def named(scene: ir.Scene, _: list[bytes], row: int) -> Hashable:
        names = getattr(scene.names, table, ())
        return names[row] if row < len(names) and names[row] else None

    pair(lambda _, digests, row: digests[row])
    pair(named, once=True)
    pair(lambda scene, _, row: (_pairing_kind(scene, table, row), named(scene, _, row) or ""))
    pair(lambda scene, _, row: _pairing_kind(scene, table, row))
    return pairs


def _pairing_kind(scene: ir.Scene, table: str, row: int) -> int:
    """The kind of a row; rows of different kinds are never paired."""
    if table == "instances":
        return int(scene.tables.geometries.kind[scene.tables.instances.geometry[row]])
    column = _KIND_COLUMNS.get(table)
    return int(getattr(getattr(scene.tables, table), column)[row]) if column else 0


def _row_changes(
    a: ir.Scene, b: ir.Scene, table: str, pairs: Pairs, digests: tuple[dict[str, list[bytes]], dict[str, list[bytes]]]
) -> list[Change]:
    """The changes of one table: rows of B in order, then removed rows."""
    back = {row_b: row_a for row_a, row_b in pairs[table].items()}
    changes = []
    for row in range(_count(b, table)):
        if row not in back:
            changes.append(Change("added", table, row, label(b, table, row), b.spans.get(table, row)))
        elif digests[0][table][back[row]] != digests[1][table][row] and (cells := _cells(a, b, table, back[row], row, pairs)):
            changes.append(Change("changed", table, row, label(b, table, row), b.spans.get(table, row), cells))
    gone = (row for row in range(_count(a, table)) if row not in pairs[table])
    return changes + [Change("removed", table, row, label(a, table, row), a.spans.get(table, row)) for row in gone]


def _cells(a: ir.Scene, b: ir.Scene, table: str, row_a: int, row_b: int, pairs: Pairs) -> tuple[tuple[str, str, str], ...]:
    """(column, in A, in B) of the differences of two rows."""
    before, after = _plain_cells(a, table, row_a), _plain_cells(b, table, row_b)
    cells = [(column, before.get(column, ""), after.get(column, "")) for column in {**before, **after}]
    first, second = _content(a, table, row_a), _content(b, table, row_b)
    for name in {**first, **second}:
        x, y = first.get(name), second.get(name)
        if x is None or y is None or not np.array_equal(x, y):
            cells.append((name, _short(x), _short(y)))
    for column, target in _REFERENCES.get(table, {}).items():
        mine, theirs = (np.atleast_1d(getattr(getattr(s.tables, table), column)[row]).tolist() for s, row in ((a, row_a), (b, row_b)))
        for slot, (x, y) in enumerate(zip(mine, theirs, strict=True)):
            if (pairs[target].get(x, -1) if x >= 0 else -1) != y or (x < 0) != (y < 0):
                name = ir.Slot(slot).name.lower() if table == "materials" else column
                cells.append((name, _target(a, target, x, column), _target(b, target, y, column)))
    return tuple(cell for cell in cells if cell[1] != cell[2])


def _plain_cells(scene: ir.Scene, table: str, row: int) -> dict[str, str]:
    """The name and the cells of a row as text, without places and references."""
    left_out = {*_PLACE_COLUMNS.get(table, ()), *_REFERENCES.get(table, {})}
    cells = {column: text for column, text in dump.cells(scene, table, row).items() if column not in left_out and not column.endswith("*")}
    names = getattr(scene.names, table, ())
    return {"name": names[row], **cells} if row < len(names) and names[row] else cells


def _target(scene: ir.Scene, table: str, row: int, column: str) -> str:
    """The label of a referenced row, with its source position."""
    place = scene.spans.get(table, row) or f"row {row}"
    return f"{label(scene, table, row).removeprefix(f'{column} ')} {place}" if row >= 0 else ""


def _short(values: np.ndarray | None) -> str:
    if values is None:
        return ""
    if values.size > 9:
        return f"{len(values)} #{dump.short_hash(values)}"
    return f"[{' '.join(f'{v + 0.0:.6g}' for v in values.ravel())}]"
