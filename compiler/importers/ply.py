"""Reads PLY files, ASCII and binary: polygons, normals, texture coordinates, colours of vertices or faces.

Format: the Stanford Polygon File Format (Turk 1994); property names as today's programs write them.
"""

from __future__ import annotations

import codecs
import re
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...lang import text_encoding
from ...lang.diagnostics import Diagnostics, Span
from .. import ir
from ..mesh.polygon_mesh import PolyMesh
from ..scene.builder import NONE
from ..scene.row_records import WHITE, Input, MaterialData, MeshAttribute
from . import mesh_tables, mtl
from .common import number_text, point_clouds, vertex_colors
from .common.mesh_parts import MeshFile, MeshFileError, Part, add

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2", "uint16": "u2",
    "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": ""}
_UV_NAMES = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("texture_s", "texture_t"))
MAX_HEADER = 1 << 16
_BEGIN = re.compile(rb"ply[ \t]*[\r\n]")
_END = re.compile(rb"(?<=[\r\n])[ \t]*end_header[ \t]*(?:\r|\n|\Z)")
_NEWLINE = re.compile(rb"\n")


Warn = Callable[[str], None]


class PlyError(MeshFileError):
    """A PLY file that cannot be read."""


@dataclass(slots=True)
class _Element:
    """A PLY element. `properties` are (name, type, type of the count or "" for a scalar)."""

    name: str
    count: int
    properties: list[tuple[str, str, str]] = field(default_factory=list)


@dataclass(slots=True)
class _Data:
    """Scalars by name (n,), lists by name as (counts (n,), values)."""

    scalars: dict[str, np.ndarray] = field(default_factory=dict)
    lists: dict[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)


def parts(file: MeshFile) -> list[Part]:
    """The mesh of the file, with the picture that it names. Raises PlyError."""
    span, builder, diagnostics = file.span, file.builder, file.diagnostics
    mesh, _ = file.repaired(file.cached(lambda messages: read(file.data, messages, span)))
    pictures = texture_files(file.data)
    material = None
    if len(pictures) > 1:
        diagnostics.warning(f"only the first of {len(pictures)} pictures is drawn: `{pictures[0]}`", span)
    if pictures and mesh.uvs is None:
        diagnostics.warning(f"the picture `{pictures[0]}` is not drawn: the PLY file has no texture coordinates", span)
    elif pictures:
        row = mtl.picture_row(mtl.MapReference(pictures[0], span), file.folder, True, NONE, builder, file.files, diagnostics)
        inputs = {ir.Slot.DIFFUSE: Input(WHITE, row), ir.Slot.AMBIENT: Input(WHITE, row)}
        material = builder.material(MaterialData(inputs=inputs, name=Path(pictures[0]).stem), span) if row >= 0 else None
    part = add(mesh, material, file.stem, builder, diagnostics, span, file.frame)
    return [] if part is None else [replace(part, material_name="" if material is None else Path(pictures[0]).stem)]


def read(data: bytes, diagnostics: Diagnostics, span: Span) -> PolyMesh:
    """The mesh of a PLY file. Faces with invalid indices are dropped with a warning. Raises PlyError."""
    def warn(message: str) -> None:
        diagnostics.warning(message, span)

    order, elements, body = _header(data, warn)
    with np.errstate(all="ignore"):
        elements_read = _ascii(body, elements, warn) if order == "ascii" else _binary(body, elements, _ORDERS[order], warn)
    vertices, faces = elements_read.get("vertex"), elements_read.get("face")
    points = None if vertices is None else _stack(vertices, "xyz")
    if vertices is None or points is None:
        raise PlyError("the PLY file has no vertices with x, y and z")
    ignored = _not_drawn(elements, elements_read)
    listed = _listed(faces)
    if faces is None or listed is None:
        faces, listed = _Data(), _strips(elements_read.get("tristrips"))
    elif _strips(elements_read.get("tristrips")) is not None:
        warn("the triangle strips of the PLY file are not drawn: it has faces")
    if listed is None and any(element.count for element in elements if element.name in ("face", "tristrips")):
        raise PlyError("the PLY file has no faces that can be drawn: a face is a list `vertex_indices`")
    if listed is None:
        cloud = point_clouds.mesh(points, _colors(vertices, warn), diagnostics, span)
        if cloud is None:
            raise PlyError("the PLY file has neither faces nor points")
        _tell(ignored, warn)
        return cloud
    counts, indices = listed
    owner = np.repeat(np.arange(len(counts)), counts)
    sound = np.asarray(np.isfinite(points).all(axis=1))
    inside = (indices >= 0) & (indices < len(points))
    bad = ~inside
    bad[inside] = ~sound[indices[inside]]
    valid = np.ones(len(counts), dtype=bool)
    valid[owner[bad]] = False
    if not valid.all():
        lost = int(np.count_nonzero(~valid))
        diagnostics.warning(f"{lost} of {len(valid)} faces use vertices that do not exist or are not finite: they are left out", span)
    _tell(ignored, warn)
    return _mesh(points, counts, indices, valid, owner, vertices, faces, warn)


def _tell(ignored: list[str], warn: Warn) -> None:
    if ignored:
        warn(f"the PLY file has data that is not drawn: {', '.join(ignored)}")


def texture_files(data: bytes) -> list[str]:
    """Image names from `comment TextureFile NAME` lines of the header, as MeshLab writes them. Raises PlyError."""
    header, _ = _parted(data)
    return [name.strip().strip('"') for name in re.findall(r"^comment\s+TextureFile\s+(\S.*?)\s*$", "\n".join(header), re.MULTILINE)]


def _listed(faces: _Data | None) -> tuple[np.ndarray, np.ndarray] | None:
    """Corner counts and vertices of faces; None without any."""
    corner_list = next((faces.lists[n] for n in ("vertex_indices", "vertex_index") if n in faces.lists), None) if faces else None
    return (corner_list[0], corner_list[1].astype(np.int64)) if corner_list is not None and len(corner_list[0]) else None


def _strips(strips: _Data | None) -> tuple[np.ndarray, np.ndarray] | None:
    """Corner counts and vertices of the triangles of strips, which −1 ends; every other triangle of a strip is turned. None without any."""
    strip_list = _listed(strips)
    if strip_list is None:
        return None
    counts, indices = strip_list
    strip = np.repeat(np.arange(len(counts)), counts)
    rows = np.stack([indices[:-2], indices[1:-1], indices[2:]], axis=1) if len(indices) > 2 else np.zeros((0, 3), np.int64)
    positions = np.arange(len(indices))
    starts = np.maximum.accumulate(np.where((indices < 0) | np.append(True, strip[1:] != strip[:-1]), positions + (indices < 0), 0))
    odd = (positions - starts)[: len(rows)] % 2 == 1
    rows[odd] = rows[odd][:, [1, 0, 2]]
    valid = (rows >= 0).all(axis=1) & (strip[: len(rows)] == strip[2 : 2 + len(rows)])
    return (np.full(int(valid.sum()), 3), rows[valid].reshape(-1)) if valid.any() else None


def _not_drawn(elements: list[_Element], data: dict[str, _Data]) -> list[str]:
    """Names of the elements and properties that are not drawn. An alpha that is opaque everywhere counts as drawn."""
    unused = []
    for element in (e for e in elements if e.count):
        if mesh_tables.PLY.report("", element.name):
            unused.append(f"element `{element.name}`")
            continue
        names = [name for name, _, _ in element.properties if mesh_tables.PLY.report("", f"{element.name}.{name}")]
        alpha = data[element.name].scalars.get("alpha")
        if alpha is not None and (alpha >= (np.iinfo(alpha.dtype).max if alpha.dtype.kind in "iu" else 1.0)).all():
            names.remove("alpha")
        unused += [f"`{name}` of `{element.name}`" for name in names]
    return unused


def _mesh(
    points: np.ndarray, counts: np.ndarray, indices: np.ndarray, valid: np.ndarray, owner: np.ndarray, vertices: _Data, faces: _Data,
    warn: Warn,
) -> PolyMesh:  # fmt: skip
    uvs = next((uv for names in _UV_NAMES if (uv := _stack(vertices, names)) is not None), None)
    uv = None if uvs is None else MeshAttribute(np.nan_to_num(uvs))
    corner_uvs = faces.lists.get("texcoord")
    if corner_uvs is not None and np.array_equal(corner_uvs[0], 2 * counts):
        uv = MeshAttribute(np.nan_to_num(corner_uvs[1].reshape(-1, 2)[valid[owner]]), ir.Interpolation.CORNER)
    color = _colors(vertices, warn)
    tint = None if color is None else MeshAttribute(color)
    if tint is None and (color := _colors(faces, warn)) is not None:
        tint = MeshAttribute(color[valid], ir.Interpolation.FACE)
    normals = _stack(vertices, ("nx", "ny", "nz"))
    normal = None if normals is None else MeshAttribute(normals)
    return PolyMesh(points, counts[valid], indices[valid[owner]], normal, uv, tint)


def _stack(data: _Data, names: Any) -> np.ndarray | None:
    if any(name not in data.scalars for name in names):
        return None
    return np.stack([data.scalars[name].astype(np.float64) for name in names], axis=1)


def _colors(data: _Data, warn: Warn) -> np.ndarray | None:
    """Linear colours from red, green and blue; see vertex_colors."""
    names = next((n for n in (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue")) if n[0] in data.scalars), None)
    tints = _stack(data, names) if names else None
    if names is None or tints is None:
        return None
    return vertex_colors.from_column(tints, data.scalars[names[0]].dtype, warn)


def _parted(data: bytes) -> tuple[list[str], bytes]:
    """The lines of the header between `ply` and `end_header`, and what follows it. Blanks at the end of lines count for nothing."""
    data = (text_encoding.as_utf8(data) if text_encoding.is_wide(data) else data.removeprefix(codecs.BOM_UTF8)).lstrip()
    end = _END.search(data, 0, MAX_HEADER)
    if not _BEGIN.match(data):
        raise PlyError("this is not a PLY file: it does not begin with a PLY header")
    if end is None:
        raise PlyError(f"the PLY file has no line `end_header` in its first {MAX_HEADER:,} bytes")
    start = end.end()
    if end[0].endswith(b"\r") and data[start : start + 1] == b"\n" and _NEWLINE.search(data, 0, end.start() + 1):
        start += 1  # in a file whose lines end with \r alone, \n is the first byte of the rows
    return re.split("\r\n|\r|\n", text_encoding.decode_any(data[: end.start()]))[1:], data[start:]


def _header(data: bytes, warn: Warn) -> tuple[str, list[_Element], bytes]:
    """The order of bytes, the elements, and what follows the header."""
    lines, body = _parted(data)
    order, elements = "", []
    for line in lines:
        words = line.split()
        if not words or words[0] in ("comment", "obj_info"):
            continue
        if words[0] == "format" and len(words) > 1:
            order = words[1]
        elif words[0] == "element" and len(words) == 3 and words[2].isdecimal():
            elements.append(_Element(words[1], int(words[2])))
        elif words[0] == "property" and elements and len(words) == 3 and words[1] in _TYPES:
            elements[-1].properties.append((words[2], _TYPES[words[1]], ""))
        elif words[0] == "property" and elements and len(words) == 5 and words[1] == "list" and {words[2], words[3]} <= set(_TYPES):
            elements[-1].properties.append((words[4], _TYPES[words[3]], _TYPES[words[2]]))
        elif words[0].startswith("prop") and elements and len(words) == 3 and order == "ascii":
            warn(f"the PLY header has a property of no known type, which is read as a number: `{line[:60]}`")
            elements[-1].properties.append((words[2], "f8", ""))
        elif order == "ascii" and words[0] not in ("element", "property", "format"):
            warn(f"the PLY header has a line that says nothing: `{line[:60]}`")
        else:
            raise PlyError(f"the PLY header has a line that says nothing: `{line[:60]}`")
    if order not in _ORDERS:
        raise PlyError(f"the PLY file has no format that is known: `{order}`")
    return order, elements, body


def _binary(body: bytes, elements: list[_Element], order: str, warn: Warn) -> dict[str, _Data]:
    columns, offset = {}, 0
    for element in elements:
        if not element.properties:
            continue
        data, offset = _rows_alike(body, offset, element, order) or _rows_one_by_one(body, offset, element, order, warn)
        columns[element.name] = data
    if rest := len(body[offset:].rstrip(b"\0\r\n")):
        warn(f"after the rows that the PLY header promises, {rest:,} more bytes are not drawn")
    return columns


def _rows_alike(body: bytes, start: int, element: _Element, order: str) -> tuple[_Data, int] | None:
    """Reads all rows at once if every row's lists are as long as the first row's; else None."""
    fields: list[Any] = []
    offset = start
    for name, kind, counted in element.properties:
        if counted:
            size = np.dtype(order + counted).itemsize
            if element.count and offset + size > len(body):
                return None
            length = int(np.frombuffer(body, order + counted, 1, offset)[0]) if element.count else 0
            if not 0 <= length <= 1 << 16:
                return None
            fields += [(f"#{name}", order + counted), (name, order + kind, (length,))]
            offset += size + length * np.dtype(kind).itemsize
        else:
            fields.append((name, order + kind))
            offset += np.dtype(kind).itemsize
    try:
        row = np.dtype(fields)
    except ValueError:
        raise PlyError(f"the PLY element `{element.name}` has two properties of one name") from None
    if row.itemsize * element.count > len(body) - start:
        return None
    table = np.frombuffer(body, row, element.count, start)
    data = _Data()
    for name, _, counted in element.properties:
        if not counted:
            data.scalars[name] = table[name].astype(table[name].dtype.newbyteorder("="))
            continue
        counts = table[f"#{name}"].astype(np.int64)
        if element.count and (counts != counts[0]).any():
            return None
        data.lists[name] = (counts, table[name].reshape(-1))
    return data, start + row.itemsize * element.count


def _rows_one_by_one(body: bytes, start: int, element: _Element, order: str, warn: Warn) -> tuple[_Data, int]:
    values: dict[str, list[Any]] = {name: [] for name, _, _ in element.properties}
    types = [(name, np.dtype(order + kind), np.dtype(order + counted) if counted else None) for name, kind, counted in element.properties]
    for k in range(element.count):
        row = {}
        for name, kind, counted in types:
            length = 1
            if counted is not None and start + counted.itemsize <= len(body):
                length = int(np.frombuffer(body, counted, 1, start)[0])
                start += counted.itemsize
            if length < 0 or start + kind.itemsize * length > len(body):
                break
            row[name] = np.frombuffer(body, kind, length, start)
            start += kind.itemsize * length
        if not _is_kept(row, values, element, k, warn):
            return _gather(element, values), len(body)
    return _gather(element, values), start


def _is_kept(row: dict[str, Any], values: dict[str, list[Any]], element: _Element, k: int, warn: Warn) -> bool:
    """Append a whole row to the values; a warning and False for one that the file ends in."""
    if len(row) < len(element.properties):
        warn(f"the PLY file ends in the middle of its `{element.name}` rows: it promises {element.count:,} and has {k:,}")
        return False
    for name, value in row.items():
        values[name].append(value)
    return True


def _ascii(body: bytes, elements: list[_Element], warn: Warn) -> dict[str, _Data]:
    """Reads ASCII rows as one stream of numbers, as many as each element declares; line ends do not matter."""
    numbers = number_text.plain(body)
    if numbers.warning:
        warn(numbers.warning)
    words = numbers.text.split()
    try:
        stream = np.array(words, dtype=np.float64)
    except ValueError:
        stream = np.array([_number(word) for word in words])
        bad = next(word for word, value in zip(words, stream.tolist(), strict=True) if value != value and word.lower() != b"nan")
        warn(f"the PLY file has `{bad.decode('latin-1')[:40]}` among its numbers: it is read as not finite")
    elements_read, offset = {}, 0
    for element in elements:
        if not any(counted for _, _, counted in element.properties):
            width = len(element.properties)
            held = min(element.count, (len(stream) - offset) // max(width, 1))
            if held < element.count:
                warn(f"the PLY file ends in the middle of its `{element.name}` rows: it promises {element.count:,} and has {held:,}")
            columns = stream[offset : offset + width * held].reshape(held, width)
            elements_read[element.name] = _Data({name: _typed(columns[:, k], kind) for k, (name, kind, _) in enumerate(element.properties)})
            offset = offset + width * held if held == element.count else len(stream)
            continue
        values: dict[str, list[Any]] = {name: [] for name, _, _ in element.properties}
        for k in range(element.count):
            row = {}
            for name, _, counted in element.properties:
                length = 1
                if counted and offset < len(stream):
                    length = int(min(max(np.nan_to_num(stream[offset]), 0), len(stream)))
                    offset += 1
                if offset + length > len(stream):
                    break
                row[name] = stream[offset : offset + length]
                offset += length
            if not _is_kept(row, values, element, k, warn):
                offset = len(stream)
                break
        elements_read[element.name] = _gather(element, values)
    if offset < len(stream):
        warn(f"after the rows that the PLY header promises, {len(stream) - offset:,} more words are not drawn")
    return elements_read


def _number(word: bytes) -> float:
    """A number; NaN for other text."""
    try:
        return float(word)
    except ValueError:
        return np.nan


def _gather(element: _Element, values: dict[str, list[Any]]) -> _Data:
    data = _Data()
    for name, kind, counted in element.properties:
        joined = _typed(np.concatenate(values[name]) if values[name] else np.zeros(0), kind)
        if counted:
            data.lists[name] = (np.array([len(v) for v in values[name]], dtype=np.int64), joined)
        else:
            data.scalars[name] = joined
    return data


def _typed(values: np.ndarray, kind: str) -> np.ndarray:
    return (np.nan_to_num(values) if kind[0] in "iu" else values).astype(kind)
