"""Reads STL files, binary and ASCII; equal corners are welded into vertices."""

from __future__ import annotations

import codecs
import re

import numpy as np

from ...lang import text_encoding
from ...lang.diagnostics import Diagnostics, Span
from .. import ir
from ..mesh.polygon_mesh import PolyMesh
from ..scene.row_records import MeshAttribute
from .common import number_text
from .common.mesh_parts import MeshFile, MeshFileError, Part
from .common.vertex_colors import linear

_VERTEX = re.compile(rb"\bvertex\s+(\S+)\s+(\S+)\s+(\S+)")
_NORMAL = re.compile(rb"\bfacet\s+normal\s+(\S+)\s+(\S+)\s+(\S+)")
_NAME = re.compile(rb"(?:\A|[\r\n])\s*(?:end)?solid\b[^\r\n]*")  # names may contain any text
_ROW = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_FACET = re.compile(rb"\b(?:facet|vertex)\b")
_LOOP_END = b"endloop"
_HEADER = 84
_TAIL = 4096  # bytes that hold the last line and its name


class StlError(MeshFileError):
    """An STL file that cannot be read."""


def read(data: bytes, diagnostics: Diagnostics, span: Span) -> PolyMesh:
    """The mesh of an STL file, oriented by winding, with a warning if stored normals contradict it. Raises StlError."""
    data = _narrow(data)
    facets = _binary(data, diagnostics, span)
    colors = None
    if facets is None:
        corners, normals = _ascii(data.removeprefix(codecs.BOM_UTF8), diagnostics, span)
    else:
        with np.errstate(invalid="ignore"):  # signalling NaN
            corners = facets["corners"].astype(np.float64)
        normals = facets["normal"]
        colors = _colors(data[:80], facets["attribute"], diagnostics, span)
    if len(normals) == len(corners):
        _compare(normals, corners, diagnostics, span)
    sound = np.asarray(np.isfinite(corners).all(axis=(1, 2)))
    if not sound.all():
        lost = int(np.count_nonzero(~sound))
        diagnostics.warning(f"{lost} of {len(sound)} triangles have corners that are not finite: they are left out", span)
    corners = corners[sound]
    points, rows = np.unique(corners.reshape(-1, 3) + 0.0, axis=0, return_inverse=True)
    tints = None if colors is None else MeshAttribute(colors[sound], ir.Interpolation.FACE)
    return PolyMesh(points, np.full(len(corners), 3), rows.reshape(-1), colors=tints)


def parts(file: MeshFile) -> list[Part]:
    """The mesh of the file, without a material. Raises MeshFileError."""
    return file.single(read)


def _compare(normals: np.ndarray, corners: np.ndarray, diagnostics: Diagnostics, span: Span) -> None:
    """A warning where the stored normals (t, 3) of more than half of the triangles point against their winding."""
    with np.errstate(all="ignore"):
        along = np.einsum("ij,ij->i", np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), normals.astype(np.float64))
    against = int(np.count_nonzero(along < 0))
    if 2 * against > len(corners):
        message = f"the normals of {against:,} of {len(corners):,} triangles point against their winding, which is drawn as the outside"
        diagnostics.warning(message, span)


def _colors(header: bytes, attribute: np.ndarray, diagnostics: Diagnostics, span: Span) -> np.ndarray | None:
    """Linear colours (t, 3) from the attribute bytes, 5 bits a channel; None without colours.

    VisCAM and SolidView set bit 15 of a coloured triangle and store red in bits 10 to 14. Magics writes `COLOR=` and the solid's colour
    to the header, clears bit 15 of a coloured triangle and stores red in bits 0 to 4.
    """
    place = header.find(b"COLOR=")
    low, middle, high = (((attribute >> shift) & 31) / 31.0 for shift in (0, 5, 10))
    if 0 <= place <= 70:
        has_color = (attribute >> 15) == 0
        default = np.frombuffer(header, np.uint8, 3, place + 6) / 255.0
        return linear(np.where(has_color[:, None], np.stack([low, middle, high], axis=1), default))
    has_color = (attribute >> 15) == 1
    if has_color.any():
        return np.where(has_color[:, None], linear(np.stack([high, middle, low], axis=1)), 1.0)
    if attribute.any():
        diagnostics.warning("the attribute bytes of the triangles are not colours: they are left out", span)
    return None


def _narrow(data: bytes) -> bytes:
    """A text file of UTF-16 or UTF-32 in UTF-8. A binary file may begin with such a text, in its header."""
    if not text_encoding.is_wide(data):
        return data
    text = text_encoding.as_utf8(data)
    return text if _begins_as_text(text) and _VERTEX.search(text.lower()) else data


def _begins_as_text(data: bytes) -> bool:
    return data.removeprefix(codecs.BOM_UTF8).lstrip()[:5].lower() == b"solid"


def _binary(data: bytes, diagnostics: Diagnostics, span: Span) -> np.ndarray | None:
    """Rows (t,) of _ROW; None for an ASCII file: too short, or text whose length does not fit the triangle count."""
    if len(data) < _HEADER:
        return None
    count = int(np.frombuffer(data, "<u4", 1, 80)[0])
    held = (len(data) - _HEADER) // _ROW.itemsize
    solid = _begins_as_text(data)
    if solid and count != held and _VERTEX.search(data.lower()):
        return None
    if count > held:
        message = f"the STL file ends early: it promises {count} triangles and holds {held}"
        if not held:
            raise StlError(message)
        diagnostics.warning(message, span)
    if not count and held:
        diagnostics.warning(f"the STL file promises 0 triangles and holds {held}: these are drawn", span)
        count = held
    if rest := len(data[_HEADER + count * _ROW.itemsize :].rstrip(b"\0")):
        diagnostics.warning(f"after the {count} triangles that the STL file promises, {rest:,} more bytes are not drawn", span)
    return np.frombuffer(data, _ROW, min(count, held), _HEADER)


def _ascii(data: bytes, diagnostics: Diagnostics, span: Span) -> tuple[np.ndarray, np.ndarray]:
    """The corners (t, 3, 3) of the triangles of a text file, and the normals (n, 3) of its facets.

    A facet without three vertices is left out, with a warning.
    """
    if not _begins_as_text(data):
        raise StlError("this is not an STL file: it is neither binary nor does it begin with `solid`")
    numbers = number_text.plain(_NAME.sub(lambda name: re.sub(rb"[^\r\n]", b" ", name[0]), data.lower()))
    text = numbers.text
    if numbers.warning:
        diagnostics.warning(numbers.warning, _span_at(text, numbers.first, span))
    chunks = text.split(_LOOP_END)
    facets = [_VERTEX.findall(chunk) for chunk in chunks]
    last = facets.pop() if len(facets) > 1 else []  # after the last loop
    sound = [facet for facet in [*facets, last] if len(facet) and len(facet) % 3 == 0]
    if not sound:
        count = sum(map(len, facets))
        raise StlError(f"the STL file has {count} vertices, which make no whole number of triangles")
    damaged = [k for k, facet in enumerate(facets) if not facet or len(facet) % 3]
    if damaged:
        message = f"{len(damaged)} facets of the STL file have no three vertices: they are left out"
        diagnostics.warning(message, _place(text, chunks, damaged[0], span))
    if len(chunks) > 1 and (len(last) % 3 or (not last and _FACET.search(chunks[-1]))):
        message = "the STL file ends in the middle of this facet: it is left out"
        diagnostics.warning(message, _place(text, chunks, len(chunks) - 1, span), "copy or write the file again")
    elif b"endsolid" not in data.lower()[-_TAIL:]:
        message = "the STL file ends without `endsolid`: it may be cut off"
        diagnostics.warning(message, _span_at(text, len(text.rstrip()), span), "copy or write the file again")
    corners = _numbers([number for facet in sound for vertex in facet for number in vertex]).reshape(-1, 3, 3)
    return corners, _numbers([number for normal in _NORMAL.findall(text) for number in normal]).reshape(-1, 3)


def _numbers(texts: list[bytes]) -> np.ndarray:
    """(n,) numbers; NaN for other text."""
    try:
        return np.array(texts, dtype=np.float64)
    except ValueError:
        return np.array([_number(text) for text in texts])


def _place(text: bytes, chunks: list[bytes], k: int, span: Span) -> Span:
    """The line at which the facet of a chunk begins."""
    first = sum(len(chunk) + len(_LOOP_END) for chunk in chunks[:k])
    facet = _FACET.search(text, first)
    return _span_at(text, facet.start() if facet else first, span)


def _span_at(text: bytes, position: int, span: Span) -> Span:
    line = len(re.findall(rb"\r\n|\r|\n", text[:position])) + 1
    return Span(span.file, line, 1, line, 1)


def _number(text: bytes) -> float:
    """A number; NaN for other text."""
    try:
        return float(text)
    except ValueError:
        return np.nan
