"""Validation state of one scene: its tables, repairs and diagnostics."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ...lang.diagnostics import Diagnostics
from .. import ir

Columns = dict[str, Any]  # a table's arrays by name
_SINGULAR = {
    "geometries": "shape", "instances": "instance", "materials": "material", "media": "medium", "textures": "texture", "lights": "light",
    "cameras": "camera", "attributes": "attribute", "images": "image", "transforms": "transform", "keys": "key",
}  # fmt: skip


class Check:
    """A scene under validation: its tables as dicts of columns, which repairs replace."""

    def __init__(self, scene: ir.Scene, diagnostics: Diagnostics) -> None:
        self.scene = scene
        self.diagnostics = diagnostics
        self.errors = 0
        self.tables: dict[str, Columns] = {name: dict(getattr(scene.tables, name)._asdict()) for name in ir.TABLES}
        self.names = scene.names
        self.spans = dict(scene.spans.rows)
        self.changed: set[str] = set()

    def rows(self, table: str) -> int:
        return len(next(iter(self.tables[table].values())))

    def set(self, table: str, column: str, values: Any) -> None:
        self.tables[table][column] = values
        self.changed.add(table)

    def bad(self, table: str, rows: Any, message: str, severity: str = "error", hint: str = "") -> bool:
        """Report `message` once, at the first of the masked rows. Returns whether there are any."""
        if not np.count_nonzero(rows):
            return False
        where = np.flatnonzero(rows)
        more = f" (and {len(where) - 1} more)" if len(where) > 1 else ""
        names = getattr(self.scene.names, table, ())
        name = f" `{names[where[0]]}`" if where[0] < len(names) and names[where[0]] else ""
        what = f"{_SINGULAR.get(table, table)}{name}: {message}{more}"
        report = self.diagnostics.error if severity == "error" else self.diagnostics.warning
        report(what, self.scene.spans.get(table, int(where[0])), hint)
        self.errors += severity == "error"
        return True

    def fatal(self, message: str) -> None:
        self.diagnostics.error(message)
        self.errors += 1

    def finished(self) -> ir.Scene:
        """The repaired scene; the same object if nothing was repaired."""
        if not self.changed:
            return self.scene
        tables = {
            name: ir.table_of(name, columns) if name in self.changed else getattr(self.scene.tables, name)
            for name, columns in self.tables.items()
        }
        spans = ir.Spans(self.scene.spans.sources, self.spans)
        return replace(self.scene, tables=ir.Tables(**tables), names=self.names, spans=spans)
