"""What a mesh file's readers hand back: parts, each a geometry with its material and place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...lang.diagnostics import Diagnostics, Span
from ..mesh import polygon_mesh
from ..scene.builder import NONE, SceneBuilder


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A geometry of a file with its material (a builder's row, None: the file gives none) and its place in the file (3, 4)."""

    geometry: int
    material: int | None
    name: str
    transform: np.ndarray | None = None


def add(
    mesh: polygon_mesh.PolyMesh, material: int | None, name: str, builder: SceneBuilder, diagnostics: Diagnostics, span: Span
) -> Part | None:
    """The mesh as a part, or None where no face of it has area. Faces without area are left out with a note."""
    made, dropped = polygon_mesh.assemble(mesh, name=name)
    if dropped:
        diagnostics.note(f"{dropped} of {len(mesh.counts)} faces have no area: they are left out", span)
    if not len(made.triangles):
        if not dropped:
            diagnostics.warning("the mesh has no faces: nothing is drawn", span)
        return None
    row = builder.mesh(made, span, name)
    return None if row == NONE else Part(row, material, name)
