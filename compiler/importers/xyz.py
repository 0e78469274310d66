"""Reads .xyz files: a point a line, with its colour from 0 to 255 or its normal, in columns apart by blanks, commas or semicolons."""

from __future__ import annotations

import codecs

import numpy as np

from ...lang.diagnostics import Diagnostics, Span
from ..mesh.polygon_mesh import PolyMesh
from .common import point_clouds
from .common.mesh_parts import MeshFile, MeshFileError, Part
from .common.vertex_colors import linear

MOST_COLUMNS = 16
_FROM = 255.0


class PointListError(MeshFileError):
    """A file that cannot be read. The caller adds the span."""


def read(data: bytes, diagnostics: Diagnostics, span: Span) -> PolyMesh:
    """Spheres at the points of a .xyz file, with their colours if it has three columns of them after the places. Raises PointListError."""
    text = data.removeprefix(codecs.BOM_UTF8).decode("latin-1").replace(",", " ").replace(";", " ")
    rows = [words for line in text.splitlines() if (words := line.split("#")[0].split()) and not words[0].startswith("//")]
    if len(rows) > 1 and len(rows[0]) == 1 and rows[0][0].isdecimal():
        if any(row[0][:1].isalpha() and len(row) == 4 for row in rows[1:3]):
            raise PointListError("this .xyz file is a molecule: atoms are not drawn")
        rows = rows[1:]  # the number of points
    width = min(max(map(len, rows), default=0), MOST_COLUMNS)
    if width < 3:
        raise PointListError("a .xyz file has three numbers a line, or more")
    table = np.full((len(rows), width), np.nan)
    wrong = 0
    for k, row in enumerate(rows):
        try:
            table[k, : len(row)] = [float(word) for word in row[:width]]
        except ValueError:
            wrong += 1
    if wrong:
        diagnostics.warning(f"{wrong:,} of {len(rows):,} lines are not numbers: they are left out", span)
    table = table[np.isfinite(table[:, :3]).any(axis=1)]
    tints = table[:, 3:6] if width >= 6 else table[:, :0]
    colored = tints.shape[1] == 3 and len(tints) and bool(((tints >= 0) & (tints <= _FROM)).all() and (tints > 1).any())
    if width > 3 and not colored:
        diagnostics.warning(f"the columns after x, y and z are not drawn: {width - 3} a line are not colours from 0 to 255", span)
    mesh = point_clouds.mesh(table[:, :3], linear(tints / _FROM) if colored else None, diagnostics, span)
    if mesh is None:
        raise PointListError("the .xyz file has no points")
    return mesh


def parts(file: MeshFile) -> list[Part]:
    """The mesh of the file, without a material. Raises MeshFileError."""
    return file.single(read)
