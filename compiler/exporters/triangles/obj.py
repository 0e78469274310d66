"""Exports a scene as OBJ in metres with y up, with the colours of its materials in a .mtl file beside it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from ...mesh.parts import Material, Part, to_linear, to_srgb
from ..export import Export
from ..export_job import ExportJob
from . import triangle_files
from .triangle_files import DIGITS, Format


def export(job: ExportJob) -> Export:
    """The file of a scene. Raises ExportError."""
    return triangle_files.export(job, Format(partial(encode, library=f"{job.stem}.mtl")))


def encode(parts: Sequence[Part], out: Export, library: str) -> bytes:
    """The text, with the names of its materials, which stand in the file `library` beside it."""
    out.files[library] = mtl(parts)
    lines, first, names = [], 1, material_names(parts)
    if names:
        lines.append(f"mtllib {library}")
    for part in parts:
        lines.append(f"o {part.name}")
        places, triangles, tints = part.positions, part.triangles, None
        if part.colors is not None:  # a vertex between two colours is there once for each
            key = np.concatenate([triangles.reshape(-1, 1), np.round(255 * to_srgb(part.colors)).reshape(-1, 3)], axis=1).astype(np.int64)
            used, index = np.unique(key, axis=0, return_inverse=True)
            places, triangles, tints = places[used[:, 0]], index.reshape(-1, 3), used[:, 1:] / 255
        ends = [""] * len(places) if tints is None else [f" {r:.4f} {g:.4f} {b:.4f}" for r, g, b in tints.tolist()]
        lines += [f"v {x:.{DIGITS}g} {y:.{DIGITS}g} {z:.{DIGITS}g}{end}" for (x, y, z), end in zip(places.tolist(), ends, strict=True)]
        rows = np.zeros(len(triangles), np.int64) if part.material is None else part.material
        for k in np.unique(rows).tolist():
            if part.materials:
                lines.append(f"usemtl {names[part.materials[k]]}")
            lines += [f"f {a} {b} {c}" for a, b, c in (triangles[rows == k] + first).tolist()]
        first += len(places)
    return ("\n".join(lines) + "\n").encode()


def mtl(parts: Sequence[Part]) -> bytes:
    """The material library of an OBJ file."""
    rows = []
    for material, name in material_names(parts).items():
        color = " ".join(f"{to_linear(part):.6g}" for part in material.color)
        rows.append(f"newmtl {name}\nKa {color}\nKd {color}\nillum 1\n")
    return "\n".join(rows).encode()


def material_names(parts: Sequence[Part]) -> dict[Material, str]:
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
