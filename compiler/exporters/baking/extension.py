"""Rows that a scene gets for an export: materials, textures and images."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ... import ir


class Extension:
    """New rows of a scene. `scene` makes the scene that has them; the rows of the old one stay as they are."""

    def __init__(self, scene: ir.Scene) -> None:
        self._scene, self._tables = scene, scene.tables
        self._materials: list[tuple[int, Mapping[str, Any]]] = []  # rows that they are copies of, and columns that differ
        self._textures: list[int] = []  # rows of textures whose place in the source they have
        self._images: list[NDArray[np.float32]] = []

    def picture(self, pixels: NDArray[np.float32], source: int, is_direction: bool = False) -> int:
        """The row of a texture with pixels (height, width, 3) from 0 to 1, in place of texture `source`. Directions are from -1 to 1."""
        self._images.append(pixels)
        self._textures.append(~source if is_direction else source)
        return len(self._tables.textures.kind) + len(self._textures) - 1

    def material(self, row: int, columns: Mapping[str, Any]) -> int:
        """The row of a copy of a material with other values in some columns."""
        self._materials.append((row, columns))
        return len(self._tables.materials.model) + len(self._materials) - 1

    @property
    def scene(self) -> ir.Scene:
        """The scene with all rows."""
        sources = {
            "materials": [row for row, _ in self._materials], "textures": [max(row, ~row) for row in self._textures],
            "images": [-1] * len(self._images),
        }  # fmt: skip
        tables = self._tables._replace(materials=self._more_materials(), textures=self._more_textures(), images=self._more_images())
        return replace(self._scene, tables=tables, names=self._more_names(sources), spans=self._more_spans(sources))

    def _more_materials(self) -> ir.Materials:
        table = self._tables.materials
        rows = [row for row, _ in self._materials]
        columns = {name: np.concatenate([column, column[rows]]) for name, column in table._asdict().items()}
        for k, (_, differing) in enumerate(self._materials):
            for name, value in differing.items():
                columns[name][len(table.model) + k] = value
        return ir.table_of("materials", columns)

    def _more_textures(self) -> ir.Textures:
        table, count = self._tables.textures, len(self._textures)
        first = len(self._tables.images.first)
        directions = np.array(self._textures, np.int64) < 0
        baked = {
            "kind": np.full(count, int(ir.TextureKind.IMAGE)), "mapping": np.full(count, int(ir.TextureMapping.UV)),
            "wrap_u": np.full(count, int(ir.Wrap.CLAMP)), "wrap_v": np.full(count, int(ir.Wrap.CLAMP)), "nearest": np.zeros(count, bool),
            "image": first + np.arange(count), "tape": np.full(count, -1), "channel": np.full(count, -1),
            "frame": np.tile(np.eye(2, 3), (count, 1, 1)), "size": np.zeros(count), "color_a": np.ones((count, 3)),
            "color_b": np.zeros((count, 3)), "gain": np.where(directions[:, None], 2.0, np.ones((count, 3))),
            "bias": np.where(directions[:, None], -1.0, np.zeros((count, 3))), "slices": np.zeros(count),
        }  # fmt: skip
        return ir.table_of("textures", {name: np.concatenate([column, baked[name]]) for name, column in table._asdict().items()})

    def _more_images(self) -> ir.Images:
        table, pieces = self._tables.images, [self._tables.images.texels]
        first, starts = len(table.texels), list[int]()
        for pixels in self._images:
            starts.append(first)
            pieces.append(np.concatenate([pixels.reshape(-1, 3), np.ones((pixels.shape[0] * pixels.shape[1], 1), np.float32)], axis=1))
            first += len(pieces[-1])
        baked = {
            "first": starts, "width": [pixels.shape[1] for pixels in self._images], "height": [pixels.shape[0] for pixels in self._images],
            "texels": np.concatenate(pieces),
        }  # fmt: skip
        columns = {name: np.concatenate([column, baked[name]]) for name, column in table._asdict().items() if name != "texels"}
        return ir.table_of("images", {**columns, "texels": baked["texels"]})

    def _more_names(self, sources: Mapping[str, list[int]]) -> ir.Names:
        names, tables = self._scene.names, {"materials": self._tables.materials.model, "images": self._tables.images.first}
        extended = {}
        for table, column in tables.items():
            table_names = getattr(names, table)
            padded = (*table_names, *[""] * (len(column) - len(table_names)))
            extended[table] = (*padded, *[padded[row] if row >= 0 else "" for row in sources[table]])
        return replace(names, **extended)

    def _more_spans(self, sources: Mapping[str, list[int]]) -> ir.Spans:
        spans = self._scene.spans
        rows = {
            table: np.concatenate([places, places[sources[table]]]) if table in sources and len(places) else places
            for table, places in spans.rows.items()
        }
        return ir.Spans(spans.sources, rows)
