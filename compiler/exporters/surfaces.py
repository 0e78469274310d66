"""Rows of materials as the modules of materials/ read them, and their metallic–roughness surfaces for glTF and USD."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ...materials import MATERIALS, losses
from ...materials.contract import Exported
from .. import ir
from ..scene.metallic_roughness import Surface
from ..scene.row_records import Input, as_color
from .export import Export
from .placement import F64

SLOT = ir.Slot


class MaterialRow:
    """One row of Materials. Reports losses at its place."""

    def __init__(self, out: Export, row: int) -> None:
        self.out, self.row, self.materials = out, row, out.scene.tables.materials
        self.module = MATERIALS[int(self.materials.model[row])]

    def value(self, slot: ir.Slot) -> F64:
        return self.materials.values[self.row, slot]

    def texture(self, slot: ir.Slot) -> int:
        return self.out.carried(int(self.materials.textures[self.row, slot]))

    def input(self, slot: ir.Slot) -> Input:
        return Input(as_color(self.value(slot)), self.texture(slot))

    @property
    def normalized(self) -> bool:
        return bool(self.materials.normalized[self.row])

    def cannot(self, message: str, hint: str = "") -> None:
        self.out.cannot(message, "materials", self.row, hint)

    def note(self, message: str) -> None:
        self.out.note(message, "materials", self.row)

    def reports_vertex_light(self) -> None:
        """Report light that is computed at vertices."""
        if self.materials.shading[self.row] == ir.Shading.GOURAUD:
            self.cannot(losses.AT_VERTICES)


class SurfaceRow(MaterialRow):
    """A row as a metallic–roughness surface. Losses that the format carries by other means are left out."""

    def __init__(
        self, out: Export, row: int, carried: frozenset[str] = frozenset(), has_graph: Callable[[int], bool] = lambda texture: False
    ) -> None:  # fmt: skip
        super().__init__(out, row)
        self._carried, self._has_graph = carried, has_graph

    def texture(self, slot: ir.Slot) -> int:
        texture = int(self.materials.textures[self.row, slot])
        return texture if self._has_graph(texture) else super().texture(slot)

    def note(self, message: str) -> None:
        if message not in self._carried:
            super().note(message)

    def cannot(self, message: str, hint: str = "") -> None:
        if message not in self._carried:
            super().cannot(message, hint)

    @property
    def ior(self) -> Input:
        if self.materials.textures[self.row, SLOT.IOR] >= 0:
            self.cannot(losses.texture(SLOT.IOR))
        return Input.number(float(self.value(SLOT.IOR)[0]))

    def surface(self, diffuse: Input, metallic: Input, roughness: Input, ior: Input, **more: Any) -> Surface:
        normal = self.input(SLOT.NORMAL)
        if self.materials.textures[self.row, SLOT.BUMP] >= 0:
            self.cannot(losses.BUMP_MAP, "a normal map is")
        return Surface(
            diffuse, metallic, roughness, ior, opacity=self.input(SLOT.OPACITY), threshold=float(self.materials.threshold[self.row]),
            normal=normal if normal.texture >= 0 else None, name=self._name(), **more,
        )  # fmt: skip

    def _name(self) -> str:
        names = self.out.scene.names.materials
        return (names[self.row] if self.row < len(names) else "") or f"material{self.row}"


def surface_of(
    out: Export, row: int, carried: frozenset[str] = frozenset(), has_graph: Callable[[int], bool] = lambda texture: False
) -> Exported:  # fmt: skip
    """The surface of a material that is not a blend. Reports inputs that the format lacks, but for the losses `carried`.

    Patterns of which `has_graph` is true are textures of the format.
    """
    surface_row = SurfaceRow(out, row, carried, has_graph)
    surface_row.reports_vertex_light()
    assert surface_row.module.surface is not None
    return surface_row.module.surface(surface_row)
