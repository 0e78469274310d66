"""Texture coordinates of meshes: each set belongs to the textures that lie the same way on a surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .. import ir
from ..mesh import shells
from ..mesh.shells import Shell
from . import texture_values
from .export import Export
from .placement import F64

CELLS = 2  # cells along a side of the picture of a checker or stripes


class TextureSets:
    """The sets of coordinates of one material."""

    def __init__(self, tables: ir.Tables) -> None:
        self.tables = tables
        self.rows: list[int] = []  # a texture of each set

    def add(self, row: int) -> int:
        """The number of the set of a texture."""
        number = next((k for k, other in enumerate(self.rows) if self._same(other, row)), len(self.rows))
        if number == len(self.rows):
            self.rows.append(row)
        return number

    def has_cells(self, row: int) -> bool:
        """Whether a texture is a checker or stripes."""
        return bool(self.tables.textures.kind[row] in (ir.TextureKind.CHECKER, ir.TextureKind.STRIPES))

    def pixels(self, row: int) -> NDArray[np.float32]:
        """(height, width, 3) the values of a texture: its picture, or CELLS × CELLS cells."""
        if not self.has_cells(row):
            return texture_values.picture(self.tables, row, np.ones(3))
        a, b = texture_values.cell_colors(self.tables, row, np.ones(3))
        return np.array([[b, a], [a, b]], np.float32)

    def coordinates(self, out: Export, shell: Shell, kind: int, scale: float) -> tuple[Shell, list[F64]]:
        """The shell, its vertices divided where cells need it, and the coordinates (n, 2) of each set, v up.

        `kind` is the shape's ir.GeometryKind, `scale` its scale to the world. Reports mappings that are not the surface's own.
        """
        for row in self.rows:
            if not texture_values.follows_uv(self.tables, row, kind):
                name = ir.TextureMapping(int(self.tables.textures.mapping[row])).name.lower()
                out.cannot(f"the mapping {name} is not carried: a mesh has its own coordinates", "textures", row)
        full_shell = shell
        if any(map(self.has_cells, self.rows)):
            shell = shells.divided(shell)
        uvs = np.zeros((len(shell.positions), 2)) if shell.uvs is None else shell.uvs
        sets = []
        for row in self.rows:
            if self.has_cells(row):
                cells = texture_values.with_cells(self.tables, row, full_shell, scale).uvs
                assert cells is not None
                sets.append(cells / CELLS)
            else:
                frame = texture_values.texture_matrix(self.tables, row)
                sets.append(uvs @ frame[:2, :2].T + frame[:2, 2])
        return shell, sets

    def _same(self, first: int, second: int) -> bool:
        frames, cells = self.tables.textures.frame, self.has_cells(first) or self.has_cells(second)
        return first == second or bool(not cells and (frames[first] == frames[second]).all())
