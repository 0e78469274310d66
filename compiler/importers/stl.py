"""Reads STL files, binary and ASCII; equal corners are welded into vertices."""

from __future__ import annotations

import codecs
import re

import numpy as np

from ..mesh.polygon_mesh import PolyMesh

_VERTEX = re.compile(rb"\bvertex\s+(\S+)\s+(\S+)\s+(\S+)")
_NAME = re.compile(rb"^\s*(end)?solid\b[^\r\n]*", re.MULTILINE)  # names may contain any text
_ROW = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_HEADER = 84


class StlError(Exception):
    """An STL file that cannot be read."""


def read(data: bytes) -> PolyMesh:
    """The mesh of an STL file, oriented by winding; stored normals are ignored. Raises StlError."""
    corners = _binary(data)
    if corners is None:
        corners = _ascii(data)
    corners = corners[np.isfinite(corners).all(axis=(1, 2))]
    points, rows = np.unique(corners.reshape(-1, 3) + 0.0, axis=0, return_inverse=True)
    return PolyMesh(points, np.full(len(corners), 3), rows.reshape(-1))


def _begins_as_text(data: bytes) -> bool:
    return data.removeprefix(codecs.BOM_UTF8).lstrip()[:5].lower() == b"solid"


def _binary(data: bytes) -> np.ndarray | None:
    """(t, 3, 3) corners; None for an ASCII file: too short, or text whose length does not fit the triangle count."""
    if len(data) < _HEADER:
        return None
    count = int(np.frombuffer(data, "<u4", 1, 80)[0])
    held = (len(data) - _HEADER) // _ROW.itemsize
    solid = _begins_as_text(data)
    if count > held or (solid and count != held):
        if solid:
            return None
        raise StlError(f"the STL file ends early: it promises {count} triangles and holds {held}")
    with np.errstate(invalid="ignore"):  # signalling NaN
        return np.frombuffer(data, _ROW, count, _HEADER)["corners"].astype(np.float64)


def _ascii(data: bytes) -> np.ndarray:
    if not _begins_as_text(data):
        raise StlError("this is no STL file: it is neither binary nor does it begin with `solid`")
    try:
        text = _NAME.sub(b"", data.removeprefix(codecs.BOM_UTF8).lower())
        numbers = np.array([m.groups() for m in _VERTEX.finditer(text)], dtype=np.float64)
    except ValueError:
        raise StlError("the STL file has a vertex that is not three numbers") from None
    if not len(numbers) or len(numbers) % 3:
        raise StlError(f"the STL file has {len(numbers)} vertices, which make no whole number of triangles")
    return numbers.reshape(-1, 3, 3)
