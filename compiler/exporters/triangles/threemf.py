"""Exports a scene as 3MF, in millimetres with z up: an object for each part, with colours."""

from __future__ import annotations

import zipfile
from collections.abc import Sequence
from io import BytesIO
from xml.sax.saxutils import quoteattr

import numpy as np

from ...mesh.parts import Part, corner_colors
from ..export import Export
from ..export_job import ExportJob
from . import triangle_files
from .triangle_files import DIGITS, Format

_CONTENT_TYPES = (
    '<?xml version="1.0" encoding="UTF-8"?>\n<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">'
    '<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
    '<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>\n'
)
_RELATIONS = (
    '<?xml version="1.0" encoding="UTF-8"?>\n<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
    '<Relationship Target="/3D/3dmodel.model" Id="rel0" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/>'
    "</Relationships>\n"
)


def export(job: ExportJob) -> Export:
    """The file of a scene. Raises ExportError."""
    return triangle_files.export(job, Format(encode, printed=True))


def encode(parts: Sequence[Part], out: Export) -> bytes:
    """3MF core: a zip archive with an XML model, one object for each part; triangles have materials where a part has several.

    Parts with colours of their own have those of the Materials and Properties Extension, a colour for each corner.
    """
    materials = list(dict.fromkeys(material for part in parts if part.colors is None for material in part.materials))
    bases = "".join(f'<base name={quoteattr(m.name)} displaycolor="{_hex(m.color)}"/>' for m in materials)
    objects, items = [f'<basematerials id="1">{bases}</basematerials>'] if materials else [], []
    tints = [None if part.colors is None else corner_colors(part).astype(np.int64) @ [1 << 16, 1 << 8, 1] for part in parts]
    colors = np.unique(np.concatenate([np.zeros(0, np.int64), *(t.ravel() for t in tints if t is not None)]))
    if len(colors):
        group = "".join(f'<m:color color="#{color:06X}"/>' for color in colors.tolist())
        objects.append(f'<m:colorgroup id="2">{group}</m:colorgroup>')
    for number, (part, tint) in enumerate(zip(parts, tints, strict=True), 3):
        vertices = "".join(f'<vertex x="{x:.{DIGITS}g}" y="{y:.{DIGITS}g}" z="{z:.{DIGITS}g}"/>' for x, y, z in part.positions.tolist())
        rows = [] if tint is not None else [materials.index(material) for material in part.materials]
        references = [""] * len(part.triangles)
        if tint is not None:
            references = [f' pid="2" p1="{a}" p2="{b}" p3="{c}"' for a, b, c in np.searchsorted(colors, tint).tolist()]
        elif part.material is not None and len(rows) > 1:
            references = [f' pid="1" p1="{rows[k]}"' for k in part.material.tolist()]
        corners = zip(part.triangles.tolist(), references, strict=True)
        triangles = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"{reference}/>' for (a, b, c), reference in corners)
        mesh = f"<mesh><vertices>{vertices}</vertices><triangles>{triangles}</triangles></mesh>"
        reference = f' pid="1" pindex="{rows[0]}"' if rows else ' pid="2" pindex="0"' if tint is not None else ""
        objects.append(f'<object id="{number}" type="model" name={quoteattr(part.name)}{reference}>{mesh}</object>')
        items.append(f'<item objectid="{number}"/>')
    model = (
        '<?xml version="1.0" encoding="UTF-8"?>\n<model unit="millimeter" xml:lang="en-US" '
        'xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02" '
        'xmlns:m="http://schemas.microsoft.com/3dmanufacturing/material/2015/02"><resources>'
        f"{''.join(objects)}</resources><build>{''.join(items)}</build></model>\n"
    )
    return _archive(model)


def _hex(color: Sequence[float]) -> str:
    return "#" + "".join(f"{round(255 * min(max(part, 0.0), 1.0)):02X}" for part in color)


def _archive(model: str) -> bytes:
    """The zip archive of a model; equal models make equal bytes."""
    buffer = BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in (("[Content_Types].xml", _CONTENT_TYPES), ("_rels/.rels", _RELATIONS), ("3D/3dmodel.model", model)):
            archive.writestr(zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0)), text, zipfile.ZIP_DEFLATED)
    return buffer.getvalue()
