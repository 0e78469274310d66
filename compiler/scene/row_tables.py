"""Rows of the scene builder as columns of the IR, and their source positions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...lang.diagnostics import Span
from .. import ir
from .row_records import WHITE, Input, MaterialData


def spans(tables: Mapping[str, list[Span | None]]) -> ir.Spans:
    """ir.Spans of the spans of each table's rows."""
    sources: dict[str, int] = {}
    rows = {}
    for table, row_spans in tables.items():
        places: dict[int, int] = {}  # the rows of a loop share few spans
        numbers = [places.setdefault(id(span), len(places)) for span in row_spans]
        each: list[Span | None] = [None] * len(places)
        for number, span in zip(numbers, row_spans, strict=True):
            each[number] = span
        numbered = [
            (-1, 0, 0, 0, 0) if s is None else (sources.setdefault(s.file, len(sources)), s.line, s.column, s.end_line, s.end_column)
            for s in each
        ]
        rows[table] = np.array(numbered, dtype=np.int32).reshape(-1, 5)[numbers]
        rows[table].flags.writeable = False
    return ir.Spans(tuple(sources), rows)


def columns(table: str, rows: Sequence[tuple[Any, ...]]) -> Mapping[str, Any]:
    """Columns by name, without columns that the rows lack (an image's texels)."""
    names = ir.TABLES[table]._fields  # type: ignore[attr-defined]
    return dict(zip(names, zip(*rows, strict=True), strict=False))


def material_data(row: Sequence[Any], name: str) -> MaterialData:
    """The record of a row of Materials, with all of its inputs."""
    columns = dict(zip(ir.Materials._fields, row, strict=True))
    inputs = {slot: Input(columns["values"][slot], columns["textures"][slot]) for slot in ir.Slot}
    return MaterialData(
        ir.MaterialModel(columns["model"]),
        inputs,
        ir.Shading(columns["shading"]),
        columns["normalized"],
        name,
        columns["threshold"],
        columns["first"],
        columns["second"],
        columns["medium"],
    )


def clear_rows(rows: Sequence[Sequence[Any]]) -> list[int]:
    """The rows of Materials that bound media and let light pass straight: smooth, colourless glass of index 1."""
    return [k for k, row in enumerate(rows) if row[-1] >= 0 and _passes_straight(material_data(row, ""))]


def emitting(materials: Sequence[Sequence[Any]], media: Sequence[Sequence[Any]]) -> tuple[list[int], bool, bool]:
    """(rows of Materials that emit light, whether some medium does, whether some medium scatters it)."""
    values, glow, back = ir.Materials._fields.index("values"), ir.Media._fields.index("emission"), ir.Media._fields.index("scattering")
    rows = [index for index, row in enumerate(materials) if any(row[values][ir.Slot.EMISSION])]
    return rows, any(any(row[glow]) for row in media), any(any(row[back]) for row in media)


def _passes_straight(material: MaterialData) -> bool:
    color, ior, rough = (material.inputs[slot] for slot in (ir.Slot.TRANSMISSION, ir.Slot.IOR, ir.Slot.ROUGHNESS))
    plain = color.value == WHITE and ior.value[0] == 1.0 and rough.value[0] == 0.0
    return material.model == ir.MaterialModel.GLASS and plain and max(color.texture, ior.texture, rough.texture) < 0
