"""The result record of mesh importers: a geometry with its material and placement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...lang.diagnostics import Diagnostics, Span
from ..mesh import polygon_mesh
from ..scene.builder import NONE, SceneBuilder


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A geometry with its material (builder row; None: not given) and its (3, 4) placement in the file."""

    geometry: int
    material: int | None
    name: str
    transform: np.ndarray | None = None
    material_name: str = ""  # in the file


def add(
    mesh: polygon_mesh.PolyMesh, material: int | None, name: str, builder: SceneBuilder, diagnostics: Diagnostics, span: Span
) -> Part | None:
    """Adds the mesh to the builder. None if no face has area. Faces without area are dropped with a note."""
    made, dropped = polygon_mesh.assemble(mesh, name=name)
    if dropped:
        diagnostics.note(f"{dropped} of {len(mesh.counts)} faces have no area: they are left out", span)
    if not len(made.triangles):
        if not dropped:
            diagnostics.warning("the mesh has no faces: nothing is drawn", span)
        return None
    row = builder.mesh(made, span, name)
    return None if row == NONE else Part(row, material, name)
