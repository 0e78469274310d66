"""Reads OFF files, the text format of Geomview: polygons with normals, texture coordinates and colours.

Format: OFF(5) of the Geomview manual. The keyword's letters ST, C and N name what follows a vertex's position, in the order N, C, ST.
"""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np

from ...lang import text_encoding
from ...lang.diagnostics import Diagnostics, Span
from .. import ir
from ..mesh.polygon_mesh import PolyMesh
from ..scene.row_records import MeshAttribute
from .common import number_text, point_clouds, vertex_colors
from .common.mesh_parts import MeshFile, MeshFileError, Part

_KEYWORD = re.compile(r"(ST)?(C)?(N)?(4)?(n)?OFF$")
_MOST_SIDES = 1 << 20


class OffError(MeshFileError):
    """An OFF file that cannot be read."""


def read(data: bytes, diagnostics: Diagnostics, span: Span) -> PolyMesh:
    """The mesh of an OFF file. Damaged vertices and faces are left out with a warning. Raises OffError."""
    text = text_encoding.decode_any(data)
    numbers = number_text.plain(re.sub(r"#.*", "", text).encode())
    if numbers.warning:
        diagnostics.warning(numbers.warning, span)
    rows = [words for line in numbers.text.decode().splitlines() if (words := line.split())]
    kind = _KEYWORD.match(rows[0][0]) if rows else None
    if kind is None:
        raise OffError("this is not an OFF file: it does not begin with `OFF`")
    if kind[4] or kind[5] or rows[0][1:2] == ["BINARY"]:
        raise OffError("OFF files in binary or of another dimension than 3 are not read")
    rows[0] = rows[0][1:]
    rows = [row for row in rows if row]
    if not rows or len(rows[0]) < 2 or not all(word.isdecimal() for word in rows[0][:2]):
        raise OffError("the OFF file does not say how many vertices and faces it has")
    vertices, count = int(rows[0][0]), int(rows[0][1])
    points, face_rows = rows[1 : 1 + vertices], rows[1 + vertices : 1 + vertices + count]
    if len(face_rows) < count:
        message = f"the OFF file ends early: it promises {vertices} vertices and {count} faces and holds {len(points)} and {len(face_rows)}"
        diagnostics.warning(message, span)
    if (beyond := len(rows) - 1 - vertices - count) > 0:
        diagnostics.warning(f"after the {count} faces that the OFF file promises, {beyond} more lines are not drawn", span)
    def warn(message: str) -> None:
        diagnostics.warning(message, span)

    normals, colors, uvs = 3, 3 + 3 * bool(kind[3]), 3 + 3 * bool(kind[3]) + 4 * bool(kind[2])
    table = _table(points, uvs + 2 * bool(kind[1]))
    vertex_tints = vertex_colors.from_numbers(table[:, colors : colors + 3], warn) if kind[2] else None
    if not count and (cloud := point_clouds.mesh(table[:, :3], vertex_tints, diagnostics, span)) is not None:
        return cloud
    if not face_rows:
        raise OffError("the OFF file holds no faces")
    faces = [face for row in face_rows if (face := _face(row, table)) is not None]
    if len(faces) < len(face_rows):
        lost = f"{len(face_rows) - len(faces)} of {len(face_rows)} faces"
        diagnostics.warning(f"{lost} are damaged, or use vertices that do not exist or are not finite: they are left out", span)
    tails = [tail for _, tail in faces]
    tints = _face_colors(tails, warn) if vertex_tints is None else MeshAttribute(vertex_tints)
    if kind[2] and (unseen := sum(len(tail) >= 3 for tail in tails)):
        message = f"the colours of {unseen} of {len(faces)} faces are left out: the vertices of the OFF file have colours, which are drawn"
        diagnostics.warning(message, span, "to draw those of the faces, write the vertices without colours")
    if rows_of_map := sum(len(tail) == 1 for tail in tails):
        message = f"the colours of {rows_of_map} of {len(faces)} faces are rows of a colour map, which is not read: they are left out"
        diagnostics.warning(message, span)
    return PolyMesh(
        np.nan_to_num(table[:, :3]), np.array([len(face) for face, _ in faces], np.int64),
        np.array([index for face, _ in faces for index in face], np.int64),
        MeshAttribute(np.nan_to_num(table[:, normals : normals + 3])) if kind[3] else None,
        MeshAttribute(np.nan_to_num(table[:, uvs : uvs + 2])) if kind[1] else None, tints,
    )  # fmt: skip


def parts(file: MeshFile) -> list[Part]:
    """The mesh of the file, without a material. Raises MeshFileError."""
    return file.single(read)


def _table(rows: list[list[str]], width: int) -> np.ndarray:
    """Numbers (n, width) of rows; NaN for absent ones and for other words."""
    try:
        return np.array([row[:width] for row in rows], np.float64).reshape(len(rows), width)
    except ValueError:
        return np.array([[_number(word) for word in (*row, *["nan"] * width)[:width]] for row in rows]).reshape(len(rows), width)


def _number(word: str) -> float:
    try:
        return float(word)
    except ValueError:
        return np.nan


def _face(row: list[str], table: np.ndarray) -> tuple[list[int], list[str]] | None:
    """(vertices, words after them) of a face; None if it is damaged."""
    if not row[0].isdecimal() or not 0 < int(row[0]) <= min(_MOST_SIDES, len(row) - 1):
        return None
    sides = int(row[0])
    if not all(word.isdecimal() for word in row[1 : sides + 1]):
        return None
    corners = [int(word) for word in row[1 : sides + 1]]
    return (corners, row[sides + 1 :]) if max(corners) < len(table) and np.isfinite(table[corners, :3]).all() else None


def _face_colors(tails: list[list[str]], warn: Callable[[str], None]) -> MeshAttribute | None:
    """The colours of faces, white for those without; None without any. A single number is a row of a colour map, which is not read."""
    colored = [k for k, tail in enumerate(tails) if len(tail) >= 3]
    if not colored:
        return None
    values = np.ones((len(tails), 3))
    values[colored] = vertex_colors.from_numbers(_table([tails[k] for k in colored], 3), warn)
    return MeshAttribute(values, ir.Interpolation.FACE)


