"""Writes triangle meshes for other programs and for 3D printing: .stl, .obj, .ply and .3mf."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Sequence
from io import BytesIO
from typing import NamedTuple
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

SINGLE = (".stl", ".ply")  # formats in single precision
PRINTED = (".stl", ".3mf")  # formats in millimetres with z up, as 3D printing programs expect; the others are in metres, y up
DIGITS = 12  # of numbers in text
_MM = 1000.0


class Material(NamedTuple):
    """The properties of a material that a file holds."""

    name: str
    color: tuple[float, ...]  # sRGB, 0 to 1
    plain: bool = False  # what a scene has without a material: of a mesh with colours, these alone are written


class Part(NamedTuple):
    """One object in world space: metres, counter-clockwise from outside."""

    name: str
    positions: NDArray[np.float64]  # (n, 3)
    triangles: NDArray[np.int64]  # (m, 3)
    deviation: float  # largest distance of its triangles from the true surface, in metres
    open_edges: int  # edges with a triangle on one side only
    materials: tuple[Material, ...] = ()
    material: NDArray[np.int64] | None = None  # (m,) of each triangle, in `materials`
    instance: int = -1  # its row
    colors: NDArray[np.float64] | None = None  # (m, 3, 3) linear, of the corners of triangles: factors of the materials' colours
    rows: tuple[int, ...] = ()  # of the materials in the scene


MIN_SEPARATION = 2.0**-20  # of the largest coordinate: least distance by which touching edges are separated
WELDED = 2.0**-23  # of the largest coordinate: corners nearer than this are merged
_TURNS = 4
FAR = 64.0  # distance from the origin, in object extents, from which single precision is insufficient


def separate(parts: Sequence[Part], ending: str) -> tuple[list[Part], int]:
    """Separates touching edges: (parts, number of edges that still coincide).

    Programs identify corners by position, in about single precision. An edge along which two objects touch, or one touches itself, thus
    has four triangles. Its corners move inwards by a millionth.
    """
    parts = list(parts)
    low, high = _box(parts)
    middle = np.zeros(3) if ending in SINGLE else 0.5 * (low + high)
    reach = float(np.maximum(high - middle, middle - low).max())
    for turn in range(_TURNS):
        found = _coincident_sides(parts, middle, reach)
        if not any(mask.any() for mask in found):
            return parts, 0
        step = MIN_SEPARATION * reach * 4.0**turn
        for i, (part, mask) in enumerate(zip(parts, found, strict=True)):
            corners = np.unique(part.triangles[mask.any(axis=1)])
            if len(corners):
                moved = part.positions.copy()
                moved[corners] -= step * _normals(part)[corners]
                parts[i] = part._replace(positions=moved, deviation=part.deviation + step)
    return parts, sum(int(mask.sum()) for mask in _coincident_sides(parts, middle, reach)) // 2


def _coincident_sides(parts: Sequence[Part], middle: NDArray[np.float64], reach: float) -> list[NDArray[np.bool_]]:
    """For each part, mask (m, 3) of triangle sides shared in the same direction by another triangle, rounded as in the file."""
    positions, triangles = _joined(parts)
    _, place = np.unique(np.round((positions - middle) / (WELDED * reach)).astype(np.int64), axis=0, return_inverse=True)
    sides = place.reshape(-1)[triangles]
    key = sides * np.int64(len(positions)) + np.roll(sides, -1, axis=1)
    _, index, count = np.unique(key, return_inverse=True, return_counts=True)
    found = (count[index.reshape(key.shape)] > 1) & (sides != np.roll(sides, -1, axis=1))
    return np.split(found, np.cumsum([len(part.triangles) for part in parts])[:-1])


def _normals(part: Part) -> NDArray[np.float64]:
    """(n, 3) vertex normals, weighted by triangle area."""
    a, b, c = (part.positions[part.triangles[:, k]] for k in range(3))
    faces = np.cross(b - a, c - a)
    total = np.stack([sum(np.bincount(part.triangles[:, k], faces[:, i], len(part.positions)) for k in range(3)) for i in range(3)], axis=1)
    return total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-300)


def center(parts: Sequence[Part]) -> tuple[list[Part], NDArray[np.float64] | None]:
    """(parts, offset by which they were moved to the origin; None if single precision suffices in place)."""
    low, high = _box(parts)
    if max(np.abs(low).max(), np.abs(high).max()) <= FAR * (high - low).max():
        return list(parts), None
    middle = 0.5 * (low + high)
    return [part._replace(positions=part.positions - middle) for part in parts], -middle


def _box(parts: Sequence[Part]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    ends = np.array([[part.positions.min(axis=0), part.positions.max(axis=0)] for part in parts])
    return ends[:, 0].min(axis=0), ends[:, 1].max(axis=0)


def rounding(parts: Sequence[Part], ending: str) -> float:
    """The largest distance, in metres, by which the digits of a format move a vertex."""
    scale = _MM if ending in PRINTED else 1.0
    written = np.concatenate([part.positions for part in parts]) * scale
    if ending in SINGLE:
        off = np.abs(written.astype(np.float32).astype(np.float64) - written).max(initial=0.0)
    else:
        off = 0.5 * 10.0 ** (1 - DIGITS) * np.abs(written).max(initial=0.0)
    return 3.0**0.5 * float(off) / scale


def encode(parts: Sequence[Part], ending: str, library: str = "") -> bytes:
    """The content of a file with an extension in `WRITERS`; `library` is the name of the file with the materials of an OBJ file."""
    if ending in PRINTED:
        parts = [part._replace(positions=part.positions[:, [0, 2, 1]] * [_MM, -_MM, _MM] + 0.0) for part in parts]
    return WRITERS[ending](parts, library)


def _stl(parts: Sequence[Part], library: str) -> bytes:
    """Binary STL: 80 bytes, a count, and for each triangle its normal, its corners and two zero bytes."""
    corners = np.concatenate([part.positions[part.triangles] for part in parts])
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    rows = np.zeros(len(corners), np.dtype([("numbers", "<f4", (4, 3)), ("nothing", "<u2")]))
    rows["numbers"][:, 0] = normal / np.where(length > 0, length, 1.0)
    rows["numbers"][:, 1:] = corners
    return b"maquette: millimetres, z up".ljust(80) + np.uint32(len(rows)).tobytes() + rows.tobytes()


def _obj(parts: Sequence[Part], library: str) -> bytes:
    """OBJ, with the names of its materials, which stand in the file `library`; see `mtl`."""
    lines, first, names = [], 1, _material_names(parts)
    if names and library:
        lines.append(f"mtllib {library}")
    for part in parts:
        lines.append(f"o {part.name}")
        places, triangles, tints = part.positions, part.triangles, None
        if part.colors is not None:  # a vertex between two colours is there once for each
            key = np.concatenate([triangles.reshape(-1, 1), np.round(255 * _srgb(part.colors)).reshape(-1, 3)], axis=1).astype(np.int64)
            used, index = np.unique(key, axis=0, return_inverse=True)
            places, triangles, tints = places[used[:, 0]], index.reshape(-1, 3), used[:, 1:] / 255
        ends = [""] * len(places) if tints is None else [f" {r:.4f} {g:.4f} {b:.4f}" for r, g, b in tints.tolist()]
        lines += [f"v {x:.{DIGITS}g} {y:.{DIGITS}g} {z:.{DIGITS}g}{end}" for (x, y, z), end in zip(places.tolist(), ends, strict=True)]
        rows = np.zeros(len(triangles), np.int64) if part.material is None else part.material
        for k in np.unique(rows).tolist():
            if library and part.materials:
                lines.append(f"usemtl {names[part.materials[k]]}")
            lines += [f"f {a} {b} {c}" for a, b, c in (triangles[rows == k] + first).tolist()]
        first += len(places)
    return ("\n".join(lines) + "\n").encode()


def mtl(parts: Sequence[Part]) -> bytes:
    """The material library of an OBJ file."""
    rows = []
    for material, name in _material_names(parts).items():
        color = " ".join(f"{_linear(part):.6g}" for part in material.color)
        rows.append(f"newmtl {name}\nKa {color}\nKd {color}\nillum 1\n")
    return "\n".join(rows).encode()


def _linear(value: float) -> float:
    """A linear value from 0 to 1 of one in sRGB."""
    value = min(max(value, 0.0), 1.0)
    return value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4


def _material_names(parts: Sequence[Part]) -> dict[Material, str]:
    """A name without blanks for each material, unlike the others."""
    names: dict[Material, str] = {}
    taken: set[str] = set()
    for material in dict.fromkeys(material for part in parts for material in part.materials):
        name = base = "".join(c if c.isalnum() or c in "._-" else "_" for c in material.name) or "material"
        count = 1
        while name in taken:
            count += 1
            name = f"{base}.{count}"
        taken.add(name)
        names[material] = name
    return names


def _joined(parts: Sequence[Part]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    firsts = np.cumsum([0, *(len(part.positions) for part in parts[:-1])])
    triangles = [part.triangles + first for part, first in zip(parts, firsts, strict=True)]
    return np.concatenate([part.positions for part in parts]), np.concatenate(triangles)


def _ply(parts: Sequence[Part], library: str) -> bytes:
    """Binary PLY with sRGB colours of vertices; those between materials are there once for each colour."""
    positions, triangles = _joined(parts)
    colors = np.concatenate([_corner_colors(part) for part in parts])
    key = triangles.astype(np.int64) * (1 << 24) + colors.astype(np.int64) @ [1 << 16, 1 << 8, 1]
    used, corners = np.unique(key, return_inverse=True)
    vertices = np.zeros(len(used), np.dtype([("place", "<f4", 3), ("color", "u1", 3)]))
    vertices["place"] = positions[used >> 24]
    vertices["color"] = np.stack([used >> 16 & 255, used >> 8 & 255, used & 255], axis=1)
    head = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\nproperty float x\nproperty float y\nproperty float z\n"
        f"property uchar red\nproperty uchar green\nproperty uchar blue\n"
        f"element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    faces = np.zeros(len(triangles), np.dtype([("count", "u1"), ("corners", "<i4", 3)]))
    faces["count"], faces["corners"] = 3, corners.reshape(-1, 3)
    return head.encode() + vertices.tobytes() + faces.tobytes()


def _corner_colors(part: Part) -> NDArray[np.uint8]:
    """(m, 3, 3) the sRGB colours of the corners of triangles; white without a material."""
    if not part.materials:
        return np.full((len(part.triangles), 3, 3), 255, np.uint8)
    rows = np.zeros(len(part.triangles), np.int64) if part.material is None else part.material
    if part.colors is None:
        table = np.round(255 * np.clip([material.color for material in part.materials], 0.0, 1.0)).astype(np.uint8)
        return np.repeat(table[rows][:, None], 3, axis=1)
    factors = np.array([(1.0, 1.0, 1.0) if m.plain else tuple(map(_linear, m.color)) for m in part.materials])
    return np.round(255 * _srgb(part.colors * factors[rows][:, None])).astype(np.uint8)


def _srgb(linear: NDArray[np.float64]) -> NDArray[np.float64]:
    """sRGB colours from 0 to 1 of linear ones."""
    clipped = np.clip(linear, 0.0, 1.0)
    return np.where(clipped <= 0.0031308, 12.92 * clipped, 1.055 * clipped ** (1 / 2.4) - 0.055)


def _3mf(parts: Sequence[Part], library: str) -> bytes:
    """3MF core: a zip archive with an XML model, one object for each part; triangles have materials where a part has several.

    Parts with colours of their own have those of the Materials and Properties Extension, a colour for each corner.
    """
    materials = list(dict.fromkeys(material for part in parts if part.colors is None for material in part.materials))
    bases = "".join(f'<base name={quoteattr(m.name)} displaycolor="{_hex(m.color)}"/>' for m in materials)
    objects, items = [f'<basematerials id="1">{bases}</basematerials>'] if materials else [], []
    tints = [None if part.colors is None else _corner_colors(part).astype(np.int64) @ [1 << 16, 1 << 8, 1] for part in parts]
    colors = np.unique(np.concatenate([np.zeros(0, np.int64), *(t.ravel() for t in tints if t is not None)]))
    if len(colors):
        group = "".join(f'<m:color color="#{color:06X}"/>' for color in colors.tolist())
        objects.append(f'<m:colorgroup id="2">{group}</m:colorgroup>')
    for number, (part, tint) in enumerate(zip(parts, tints, strict=True), 3):
        vertices = "".join(f'<vertex x="{x:.{DIGITS}g}" y="{y:.{DIGITS}g}" z="{z:.{DIGITS}g}"/>' for x, y, z in part.positions.tolist())
        rows = [] if tint is not None else [materials.index(material) for material in part.materials]
        looks = [""] * len(part.triangles)
        if tint is not None:
            looks = [f' pid="2" p1="{a}" p2="{b}" p3="{c}"' for a, b, c in np.searchsorted(colors, tint).tolist()]
        elif part.material is not None and len(rows) > 1:
            looks = [f' pid="1" p1="{rows[k]}"' for k in part.material.tolist()]
        corners = zip(part.triangles.tolist(), looks, strict=True)
        triangles = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"{look}/>' for (a, b, c), look in corners)
        mesh = f"<mesh><vertices>{vertices}</vertices><triangles>{triangles}</triangles></mesh>"
        look = f' pid="1" pindex="{rows[0]}"' if rows else ' pid="2" pindex="0"' if tint is not None else ""
        objects.append(f'<object id="{number}" type="model" name={quoteattr(part.name)}{look}>{mesh}</object>')
        items.append(f'<item objectid="{number}"/>')
    model = (
        '<?xml version="1.0" encoding="UTF-8"?>\n<model unit="millimeter" xml:lang="en-US" '
        'xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02" '
        'xmlns:m="http://schemas.microsoft.com/3dmanufacturing/material/2015/02"><resources>'
        f"{''.join(objects)}</resources><build>{''.join(items)}</build></model>\n"
    )
    types = (
        '<?xml version="1.0" encoding="UTF-8"?>\n<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">'
        '<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
        '<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>\n'
    )
    relations = (
        '<?xml version="1.0" encoding="UTF-8"?>\n<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
        '<Relationship Target="/3D/3dmodel.model" Id="rel0" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/>'
        "</Relationships>\n"
    )
    out = BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in (("[Content_Types].xml", types), ("_rels/.rels", relations), ("3D/3dmodel.model", model)):
            archive.writestr(zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0)), text, zipfile.ZIP_DEFLATED)
    return out.getvalue()


def _hex(color: Sequence[float]) -> str:
    return "#" + "".join(f"{round(255 * min(max(part, 0.0), 1.0)):02X}" for part in color)


WRITERS: dict[str, Callable[[Sequence[Part], str], bytes]] = {".stl": _stl, ".obj": _obj, ".ply": _ply, ".3mf": _3mf}
