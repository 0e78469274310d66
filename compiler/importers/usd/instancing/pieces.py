"""Geometry of a stage with its material and transform, single or as copies of point instancers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """A geometry with its material and transform. `prim` owns it.

    One that point instancers place has the matrices (n, 4, 4) of its copies, a material or n of them, and their ids, which are appended to
    `name`.
    """

    geometry: int
    material: int | np.ndarray
    matrix: np.ndarray  # (4, 4) or (n, 4, 4)
    prim: Any
    name: str
    colored: bool = True  # has a material or a displayColor of its own
    ids: np.ndarray | None = None  # (n,)
    owner: str = ""  # path of `prim` where another instance than that of `prim` is meant

    @property
    def copies(self) -> int:
        return 1 if self.ids is None else len(self.ids)

    @property
    def path(self) -> str:
        return self.owner or str(self.prim.GetPath())

    def moved(self, matrix: np.ndarray, old: str, new: str) -> Piece:
        """This piece of the instance `old` as that of the instance `new`, under `matrix` (4, 4)."""
        name, owner = new + self.name[len(old) :], new + self.path[len(old) :]
        return Piece(self.geometry, self.material, matrix @ self.matrix, self.prim, name, self.colored, self.ids, owner)


def merged(pieces: list[Piece]) -> list[Piece]:
    """Pieces of one frame, with those of the same prim, geometry and colour as the copies of one. Their ids are lost."""
    groups: dict[Any, list[Piece]] = {}
    for piece in pieces:
        groups.setdefault((piece.geometry, piece.path, piece.colored), []).append(piece)
    return [group[0] if len(group) == 1 else _joined(group) for group in groups.values()]


def _joined(group: list[Piece]) -> Piece:
    material = np.concatenate([np.broadcast_to(piece.material, piece.copies) for piece in group])
    matrix = np.concatenate([piece.matrix.reshape(-1, 4, 4) for piece in group])
    first = group[0]
    return Piece(first.geometry, material, matrix, first.prim, first.name, first.colored, np.arange(len(matrix)), first.owner)
