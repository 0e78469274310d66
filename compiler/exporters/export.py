"""The result of an export: its files, and what the format lacks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from ...lang.diagnostics import Diagnostic
from ...materials import traits
from ...shapes import SHAPES
from .. import ir
from ..io.replace_file import make_folder, replace_file
from ..ir.light_links import CASTERS, EVERYTHING


@dataclass(eq=False)
class Export:
    """An exported scene: the main file's content, and the other files by name.

    `diagnostics` has a warning with a fix for each feature that the format lacks, and a note for each feature in another form.
    """

    scene: ir.Scene
    text: str = ""
    data: bytes = b""  # of a binary format, in place of the text
    files: dict[str, bytes] = field(default_factory=dict)
    diagnostics: list[Diagnostic] = field(default_factory=list)
    triangles: int = 0
    deviation: float = 0.0  # metres: largest distance of the triangles from the true surface
    closed: str = ""  # how the triangles fit together, of formats for printing: closed, 3 open edges
    messages: list[str] = field(default_factory=list)  # about the file as a whole
    write: Callable[[Path], None] | None = None  # writes the main file, in place of the text

    def cannot(self, message: str, table: str = "", row: int = -1, hint: str = "") -> None:
        """Report a loss, once."""
        self._say("warning", message, table, row, hint)

    def without_opacity(self) -> None:
        """Report the materials whose opacity is lost."""
        used = self.scene.tables.instances.material
        for row in np.unique(used[traits.partial(self.scene.tables)[used]]):
            self.cannot("opacity is not carried: the surface is opaque there", "materials", int(row))

    def without_links(self) -> None:
        """Report the lights whose links are lost."""
        lights = self.scene.tables.lights
        for row in np.flatnonzero((lights.receivers != EVERYTHING) | (lights.blockers != CASTERS)).tolist():
            self.cannot("`receivers` and `blockers` are not carried: the light lights every object, and each casts shadows", "lights", row)

    @cached_property
    def boundaries(self) -> np.ndarray:
        """(materials,) bool: boundaries of a medium that light passes straight."""
        return traits.invisible(self.scene.tables)

    @cached_property
    def bodies(self) -> np.ndarray:
        """(materials,) bool: bodies that light enters diffusely; each reports its medium by itself."""
        return traits.bodies(self.scene.tables)

    @property
    def lights(self) -> list[int]:
        """The rows of lights that shine, without those added to a scene that has none: other programs have their own."""
        lights = self.scene.tables.lights
        return [row for row in np.flatnonzero(lights.color.max(axis=1, initial=0.0) > 0).tolist() if self.scene.spans.get("lights", row)]

    def tessellated(self, kind: ir.GeometryKind, instance: int, triangles: int, tolerance: float) -> None:
        """Report that a shape is exported as triangles, unless the triangles are exact."""
        if kind not in SHAPES or not SHAPES[kind].EXACT:
            self.note(f"a {kind.name.lower()} is carried as {triangles} triangles, {tolerance:g} pixels off at most", "instances", instance)

    def is_endless(self, instance: int, what: str = "") -> bool:
        """Whether a shape has no end, and so no triangles: the loss (of `what`) is reported."""
        geometries, g = self.scene.tables.geometries, int(self.scene.tables.instances.geometry[instance])
        endless = not np.isfinite(geometries.bounds[g]).all()
        if endless:
            kind = ir.GeometryKind(int(geometries.kind[g]))
            hint = "within: gives it a box" if kind == ir.GeometryKind.QUADRIC and not what else ""
            self.cannot(f"{what}an endless {kind.name.lower()} is not carried", "instances", instance, hint)
        return endless

    def carried(self, texture: int) -> int:
        """A row of Textures; -1, with a report, for a texture defined by formulas."""
        if texture >= 0 and self.scene.tables.textures.kind[texture] == ir.TextureKind.FORMULA:
            self.cannot("a pattern is not carried: it is white", "textures", texture)
            return -1
        return texture

    def note(self, message: str, table: str = "", row: int = -1) -> None:
        """Report a feature exported in another form, once."""
        self._say("note", message, table, row, "")

    def save(self, path: Path) -> None:
        """Write the main file to `path` and the other files beside it. Raises OSError."""
        for folder in self.folders:
            make_folder(path.parent / folder)
        for name, data in self.files.items():
            replace_file(path.parent / name, data)
        if self.write is not None:
            self.write(path)
        else:
            replace_file(path, self.data or self.text.encode())

    @property
    def folders(self) -> list[str]:
        """The folders beside the main file that hold other files."""
        return list(dict.fromkeys(name.partition("/")[0] for name in self.files if "/" in name))

    @property
    def lost(self) -> list[str]:
        """The features that the format lacks, each with its place; empty for a faithful export."""
        return [f"{d.span}: {d.message}" if d.span else d.message for d in self.diagnostics if d.severity == "warning"]

    def _say(self, severity: str, message: str, table: str, row: int, hint: str) -> None:
        diagnostic = Diagnostic(severity, message, self.scene.spans.get(table, row) if table else None, hint)
        if diagnostic not in self.diagnostics:
            self.diagnostics.append(diagnostic)


class ExportError(Exception):
    """A scene that a format cannot hold at all. `out` has what was found before."""

    def __init__(self, message: str, out: Export) -> None:
        super().__init__(message)
        self.out = out
