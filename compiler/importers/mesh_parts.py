"""The result record of mesh importers, a geometry with its material and placement; and the frames of mesh files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...lang import file_types
from ...lang.diagnostics import Diagnostics, Span
from ..mesh import polygon_mesh
from ..scene.builder import NONE, SceneBuilder
from ..scene.row_records import MeshAttribute
from .stage_options import ASSUMED, MeshOptions

_TO_Y = {
    "x": np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
    "y": np.eye(3),
    "z": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]),
}
"""Rotations that turn an axis to y."""


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A geometry with its material (builder row; None: not given) and its (3, 4) placement in the file."""

    geometry: int
    material: int | None
    name: str
    transform: np.ndarray | None = None
    material_name: str = ""  # in the file


@dataclass(frozen=True, slots=True)
class Frame:
    """The frame of a mesh file: what 1 is in metres, and the axis that points up."""

    unit: float = 1.0
    up: str = "y"

    @staticmethod
    def of(suffix: str, options: MeshOptions | None, unit: float = 1.0, up: str = "y") -> Frame:
        """The frame of a file: that of the options, else of ASSUMED, else `unit` and `up`. Without options metres, y up."""
        if options is None:
            return Frame()
        assumed = ASSUMED.get(suffix)
        if assumed is not None:
            unit, up = file_types.UNITS[assumed[0]], assumed[1]
        return Frame(unit if options.unit is None else file_types.UNITS[options.unit], options.up or up)

    def linear(self) -> np.ndarray:
        """(3, 3) from the file to metres with y up."""
        return self.unit * _TO_Y[self.up]

    def moved(self, mesh: polygon_mesh.PolyMesh) -> polygon_mesh.PolyMesh:
        """A mesh in metres with y up."""
        if self == Frame():
            return mesh
        normals = mesh.normals
        if normals is not None:
            normals = MeshAttribute(np.asarray(normals.values) @ _TO_Y[self.up].T, normals.interpolation)
        return replace(mesh, points=np.asarray(mesh.points, np.float64) @ self.linear().T, normals=normals)

    def placed(self, matrix: np.ndarray) -> np.ndarray:
        """(4, 4) in metres with y up of a (4, 4) transform in the file."""
        frame = np.eye(4)
        frame[:3, :3] = self.linear()
        return frame @ matrix @ np.linalg.inv(frame)


PLAIN = Frame()
LIKELY = 0.002, 20.0  # metres: longest sides that a file in metres has


def tell_frame(
    parts: Sequence[Part], suffix: str, options: MeshOptions | None, builder: SceneBuilder, diagnostics: Diagnostics, span: Span
) -> None:  # fmt: skip
    """A note on the unit and the axis that were assumed for a file, with its size in metres.

    In a format that is read as it is, in metres with y up, only of a size that is not LIKELY.
    """
    if options is None or suffix not in ASSUMED or not parts:
        return
    unit, up = ASSUMED[suffix]
    lacking = [("unit", f"in {unit}", unit), ("up", f"with {up} up", up)]
    lacking = [row for row in lacking if getattr(options, row[0]) is None]
    if not lacking:
        return
    boxes = np.array([builder.bounds(part.geometry, np.eye(4)) for part in parts])
    sides = boxes[:, 1].max(axis=0) - boxes[:, 0].min(axis=0)
    if (unit, up) == ("m", "y") and (options.unit is not None or LIKELY[0] <= sides.max() < LIKELY[1]):
        return
    size = " × ".join(f"{side:.4g}" for side in sides)
    has = " and ".join({"unit": "no unit", "up": "no up axis"}[name] for name, _, _ in lacking)
    words = " ".join(words for _, words, _ in lacking)
    other = {"mm": "m", "m": "mm", "y": "z", "z": "y"}
    asked = " ".join(f"--{name} {other[value]}" for name, _, value in lacking)
    written = ", ".join(f'{name}: "{other[value]}"' for name, _, value in lacking)
    message = f"a {suffix} file says {has}: read {words}, this one is {size} m"
    diagnostics.note(message, span, f"if that is wrong: {asked}, in a scene mesh(…, {written})")


def add(
    mesh: polygon_mesh.PolyMesh, material: int | None, name: str, builder: SceneBuilder, diagnostics: Diagnostics, span: Span,
    frame: Frame = PLAIN,
) -> Part | None:  # fmt: skip
    """Adds the mesh of a frame to the builder. None if no face has area. Faces without area are dropped with a note."""
    made, dropped = polygon_mesh.assemble(frame.moved(mesh), name=name)
    if dropped:
        diagnostics.note(f"{dropped} of {len(mesh.counts)} faces have no area: they are left out", span)
    if not len(made.triangles):
        if not dropped:
            diagnostics.warning("the mesh has no faces: nothing is drawn", span)
        return None
    row = builder.mesh(made, span, name)
    return None if row == NONE else Part(row, material, name)
