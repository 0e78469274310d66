"""What readers of mesh files get and give: the file, its frame, and parts, each a geometry with its material and placement."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from ....lang import file_types
from ....lang.diagnostics import Diagnostics, Span
from ...io import stage_cache
from ...io.sandbox import Files
from ...mesh import polygon_mesh, repair
from ...scene.builder import NONE, SceneBuilder
from ...scene.row_records import MeshAttribute
from .mesh_options import MeshOptions

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
    def from_options(reader: file_types.Reader, options: MeshOptions | None) -> Frame:
        """The frame of a file: that of the options, else of its format. Without options, or without both, metres, y up."""
        if options is None or not reader.unit:
            return Frame()
        return Frame(file_types.UNITS[options.unit or reader.unit], options.up or reader.up)

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
T = TypeVar("T")


class MeshFileError(Exception):
    """A mesh file that cannot be read. The message says what it lacks; the caller adds the place."""


@dataclass(frozen=True, slots=True, eq=False)
class MeshFile:
    """A file as its reader gets it.

    `folder` is None for data that stands in no file; `files` decides what else may be read. `as_scene`: the file is the scene, so that
    its lights and cameras go to the builder. `time` in seconds is for animations. Without `options`, another element says its frame.
    """

    data: bytes
    name: str
    folder: Path | None
    reader: file_types.Reader
    builder: SceneBuilder
    files: Files
    diagnostics: Diagnostics
    import_span: Span  # of the element that places it, or the whole file
    as_scene: bool = False
    time: float | None = None
    options: MeshOptions | None = None

    @property
    def span(self) -> Span:
        """The whole file."""
        return Span(self.name)

    @property
    def stem(self) -> str:
        """The name of the file without its folder and ending."""
        return Path(self.name).stem

    @property
    def frame(self) -> Frame:
        """Its frame, of a format that does not say it."""
        return Frame.from_options(self.reader, self.options)

    def cached(self, read: Callable[[Diagnostics], T]) -> T:
        """read(diagnostics), or its result of the last compilation of the same data."""
        return stage_cache.cached_read("meshes read", (self.data, self.name), self.diagnostics, read)

    def repaired(self, mesh: polygon_mesh.PolyMesh, name: str = "", fill: bool = True) -> tuple[polygon_mesh.PolyMesh, np.ndarray | None]:
        """(the mesh, repaired if the options ask for it, with notes of what was repaired; the face of the file for each of its faces)

        The faces are None if they are as they were. Without `fill` holes stay.
        """
        if self.options is None or not self.options.repair:
            return mesh, None
        mended, source, repairs = stage_cache.cached("meshes repaired", (mesh, fill), lambda: repair.repaired(mesh, fill))
        repairs.tell(f"`{name}`" if name else "the mesh", self.diagnostics, self.span)
        return mended, source

    def single(self, read: Callable[[bytes, Diagnostics, Span], polygon_mesh.PolyMesh]) -> list[Part]:
        """The only part of a file without materials, whose mesh `read` makes. Raises what it raises."""
        mesh, _ = self.repaired(self.cached(lambda diagnostics: read(self.data, diagnostics, self.span)))
        part = add(mesh, None, self.stem, self.builder, self.diagnostics, self.span, self.frame)
        return [] if part is None else [part]


LIKELY = 0.002, 20.0  # metres: longest sides that a file in metres has


def tell_frame(
    parts: Sequence[Part], ending: str, options: MeshOptions | None, builder: SceneBuilder, diagnostics: Diagnostics, span: Span
) -> None:  # fmt: skip
    """A note on the unit and the axis that were assumed for a file, with its size in metres.

    In a format that is read as it is, in metres with y up, only of a size that is not LIKELY.
    """
    reader = file_types.reader_of(ending)
    if options is None or reader is None or not reader.unit or not parts:
        return
    unit, up = reader.unit, reader.up
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
    wanted = " ".join(f"--{name} {other[value]}" for name, _, value in lacking)
    written = ", ".join(f'{name}: "{other[value]}"' for name, _, value in lacking)
    message = f"a {ending} file says {has}: read {words}, this one is {size} m"
    diagnostics.note(message, span, f"if that is wrong: {wanted}, in a scene mesh(…, {written})")


def add(
    mesh: polygon_mesh.PolyMesh, material: int | None, name: str, builder: SceneBuilder, diagnostics: Diagnostics, span: Span,
    frame: Frame = PLAIN,
) -> Part | None:  # fmt: skip
    """Adds the mesh of a frame to the builder. None if no face has area. Faces without area are dropped with a note."""
    triangulated, dropped = polygon_mesh.assemble(frame.moved(mesh), name=name)
    if dropped:
        diagnostics.note(f"{dropped} of {len(mesh.counts)} faces have no area: they are left out", span)
    if not len(triangulated.triangles):
        if not dropped:
            diagnostics.warning("the mesh has no faces: nothing is drawn", span)
        return None
    row = builder.mesh(triangulated, span, name)
    return None if row == NONE else Part(row, material, name)
