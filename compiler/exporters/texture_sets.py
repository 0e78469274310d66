"""Texture coordinates of meshes: each set belongs to the textures that lie the same way on a surface."""

from __future__ import annotations

from collections.abc import Mapping

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
    """The sets of coordinates of one material.

    `baked` are the corners (m, 3, 2) of a mesh's triangles in the pictures of textures (rows) that are made for it.
    """

    def __init__(self, tables: ir.Tables, baked: Mapping[int, F64] | None = None) -> None:
        self.tables, self._baked = tables, {} if baked is None else baked
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
        full_shell, corners = shell, {row: self._baked[row].reshape(-1, 2) for row in self.rows if row in self._baked}
        if any(map(self.has_cells, self.rows)):
            shell = shells.divided(shell)
        elif corners:
            shell, corners = _split(shell, corners)
        uvs = np.zeros((len(shell.positions), 2)) if shell.uvs is None else shell.uvs
        sets = []
        for row in self.rows:
            if row in corners:
                sets.append(corners[row])
            elif self.has_cells(row):
                cells = texture_values.with_cells(self.tables, row, full_shell, scale).uvs
                assert cells is not None
                sets.append(cells / CELLS)
            else:
                frame = texture_values.texture_matrix(self.tables, row)
                sets.append(uvs @ frame[:2, :2].T + frame[:2, 2])
        return shell, sets

    def _same(self, first: int, second: int) -> bool:
        if first in self._baked or second in self._baked:
            return self._baked.get(first) is self._baked.get(second)
        frames, cells = self.tables.textures.frame, self.has_cells(first) or self.has_cells(second)
        return first == second or bool(not cells and (frames[first] == frames[second]).all())


def _split(shell: Shell, corners: Mapping[int, F64]) -> tuple[Shell, dict[int, F64]]:
    """A shell whose vertices have one place in each of some sets of coordinates (3 m, 2), and these by vertex."""
    vertices = shell.triangles.ravel()
    key = np.column_stack([vertices.astype(np.int32).view(np.float32), *(values.astype(np.float32) for values in corners.values())])
    key = np.ascontiguousarray(key).view(np.dtype((np.void, key.itemsize * key.shape[1]))).ravel()
    _, first, index = np.unique(key, return_index=True, return_inverse=True)
    chosen = vertices[first]
    normals, uvs, colors = (None if values is None else values[chosen] for values in (shell.normals, shell.uvs, shell.colors))
    triangles = index.reshape(-1, 3).astype(np.int32)
    split = Shell(shell.positions[chosen], triangles, normals, uvs, shell.metric, colors)
    return split, {row: values[first] for row, values in corners.items()}
