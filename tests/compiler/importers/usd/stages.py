"""Help for the tests of USD: a stage's text in, its scene and messages out."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from maquette.compiler import ir
from maquette.compiler.importers.usd import load as usd_load
from maquette.compiler.io.sandbox import Files
from maquette.compiler.scene.builder import SceneBuilder
from maquette.lang.diagnostics import Diagnostics, render_text

from ... import tables

SQUARE = """
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    uniform token subdivisionScheme = "none"
"""


def read(folder: Path, text: str, header: str = "", **more: Any) -> tuple[ir.Scene, list[str]]:
    """The scene of a stage's text and what was said, with the folder's name taken out."""
    path = folder / "x.usda"
    lines = text.replace("{", "{\n").replace("}", "\n}\n")  # a statement ends with its line
    path.write_text(f"#usda 1.0\n({header})\n{lines}\n", encoding="utf-8")
    return load(path, **more)


def load(path: Path, allow: Sequence[Path] = (), **more: Any) -> tuple[ir.Scene, list[str]]:
    found = Diagnostics()
    scene = usd_load.scene(path, SceneBuilder(found, Files(path.parent, allow)), **more)
    messages = [render_text(d, lambda file: None).replace(f"{path.parent}/", "") for d in found.items]
    return scene, messages


def world(scene: ir.Scene, instance: int = 0) -> np.ndarray:
    """An instance's matrix (3, 4)."""
    return scene.tables.transforms.matrix[scene.tables.instances.transform[instance]]


def kinds(scene: ir.Scene) -> list[str]:
    """What each instance is."""
    t = scene.tables
    return [ir.GeometryKind(k).name for k in t.geometries.kind[t.instances.geometry]]


def corners(scene: ir.Scene, instance: int = 0) -> np.ndarray:
    """The corners of an instance's triangles in the world, (t, 3, 3)."""
    local = tables.corners(scene.tables, scene.tables.instances.geometry[instance])
    m = world(scene, instance)
    return local @ m[:, :3].T + m[:, 3]


def has(scene: ir.Scene, name: str, instance: int = 0) -> bool:
    """Whether an instance's mesh has an attribute."""
    return tables.has(scene.tables, name, scene.tables.instances.geometry[instance])


def attribute(scene: ir.Scene, name: str, instance: int = 0) -> np.ndarray:
    """Values of an instance's mesh attribute at its triangles' corners, (t, 3, width)."""
    return tables.attribute(scene.tables, name, scene.tables.instances.geometry[instance])


def slot(scene: ir.Scene, name: str, instance: int = 0) -> list[float]:
    """A material input of an instance."""
    t = scene.tables
    return t.materials.values[t.instances.material[instance], ir.Slot[name]].tolist()
