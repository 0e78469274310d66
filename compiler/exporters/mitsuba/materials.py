"""Exports materials as Mitsuba BSDFs, with normal and bump maps. Mitsuba has no ambient light."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ....materials import losses
from ... import ir
from ...scene import scattering_albedo
from .. import texture_values
from ..export import Export
from ..media import medium_of
from ..placement import F64
from ..surfaces import MaterialRow
from .xml import Node, node, rgb, value

ROUGH = 0.3  # roughness from which interreflection between microfacets exceeds 1 % of a metal's reflectance
_WRAPS = {ir.Wrap.REPEAT: "repeat", ir.Wrap.CLAMP: "clamp", ir.Wrap.MIRROR: "mirror"}


class Look(NamedTuple):
    """Exported surface of an instance."""

    bsdf: Node
    medium: Node | None  # inside of it
    emission: Node | None  # radiance
    texture: int  # row of Textures for which the mesh needs coordinates, or -1


class Materials:
    """BSDFs of materials, each created once; images are added to the export's files."""

    def __init__(self, out: Export, name: str) -> None:
        self.out, self.name, self.tables = out, name, out.scene.tables
        self.definitions: list[Node] = []
        self._looks: dict[tuple[int, bool], Look] = {}
        self._pictures: dict[tuple[int, bytes], str] = {}

    def look(self, material: int, colored: bool, spoken: int) -> Look:
        """The surface of a material on a mesh with or without vertex colours. `spoken` is an instance for messages."""
        key = (material, colored)
        if key not in self._looks:
            row = MitsubaRow(self, material, colored, spoken)
            bsdf, emission = row.mapped_bsdf(), row.emission()
            name = f"material{len(self.definitions)}"
            self.definitions.append(Node("bsdf", {**bsdf.attributes, "id": name}, bsdf.children))
            self._looks[key] = Look(Node("ref", {"id": name}), self._medium(material), emission, self._texture(row.textures))
        return self._looks[key]

    def _medium(self, material: int) -> Node | None:
        """The medium inside of a material. Values of colours are at most 1, `scale` is their factor."""
        inside = None if self.out.bodies[material] else medium_of(self.out, material)
        if inside is None or (most := max(scattering_albedo.extinction(inside))) <= 0.0:
            return None
        relative = np.divide(scattering_albedo.extinction(inside), most)
        phase = node("phase", "isotropic") if inside.anisotropy == 0.0 else node("phase", "hg", g=inside.anisotropy)
        medium = node("medium", "homogeneous", name="interior", scale=most)
        return medium.with_(rgb("albedo", scattering_albedo.albedo(inside)), rgb("sigma_t", relative), phase)

    def _texture(self, rows: list[int]) -> int:
        """The texture for which the mesh gets coordinates."""
        textures = self.tables.textures
        for row in rows[1:]:
            same = textures.kind[row] == textures.kind[rows[0]] == ir.TextureKind.IMAGE
            if not same or (textures.frame[row] != textures.frame[rows[0]]).any():
                self.out.cannot("textures that lie differently on one surface are not carried", "textures", row)
        return rows[0] if rows else -1

    def bitmap(self, name: str, row: int, constant: F64, levels: bool = False) -> Node:
        """A bitmap; with `levels` a normal map with values from 0 to 1, as Mitsuba expects."""
        textures = self.tables.textures
        wraps = int(textures.wrap_u[row]), int(textures.wrap_v[row])
        if wraps[0] != wraps[1] or wraps[0] not in _WRAPS:
            self.out.cannot("a texture that wraps differently over u and v, or ends in black, is not carried", "textures", row)
        key = (row, constant.tobytes())
        if key not in self._pictures:
            self._pictures[key] = f"{self.name}.{len(self.out.files)}.pfm"
            pixels = texture_values.picture(self.tables, row, constant)
            self.out.files[self._pictures[key]] = pfm(0.5 * pixels + 0.5 if levels else pixels)
        attributes = {"filename": self._pictures[key], "raw": True, "wrap_mode": _WRAPS.get(ir.Wrap(wraps[0]), "clamp")}
        return node("texture", "bitmap", name=name, filter_type="nearest" if textures.nearest[row] else "bilinear", **attributes)


class MitsubaRow(MaterialRow):
    """A row as a BSDF. `textures` are those that it shows."""

    def __init__(self, materials: Materials, row: int, colored: bool, spoken: int) -> None:
        super().__init__(materials.out, row)
        self._all, self._colored, self._spoken = materials, colored, spoken
        self.textures: list[int] = []

    def mapped_bsdf(self) -> Node:
        """The BSDF inside those of its normal and bump maps."""
        self.reports_vertex_light()
        if self.out.boundaries[self.row]:
            return node("bsdf", "null")
        bsdf = self.module.mitsuba(self)
        if (row := self.texture(ir.Slot.NORMAL)) >= 0:
            if self.value(ir.Slot.NORMAL)[0] != 1.0:
                self.cannot(losses.NORMAL_STRENGTH)
            bsdf = node("bsdf", "normalmap").with_(self._bitmap("normalmap", row, np.ones(3), levels=True), bsdf)
        if (row := self.texture(ir.Slot.BUMP)) >= 0:
            self.cannot("how high a bump map is, is carried in Mitsuba's own unit")
            bsdf = node("bsdf", "bumpmap", scale=float(self.value(ir.Slot.BUMP)[0])).with_(self._bitmap("arbitrary", row, np.ones(3)), bsdf)
        return bsdf

    def emission(self) -> Node | None:
        """The radiance, of materials that emit."""
        if self.value(ir.Slot.EMISSION).max() <= 0 or ir.Slot.EMISSION not in self.module.SLOTS:
            return None
        return self.color("radiance", ir.Slot.EMISSION)

    def bsdf(self, kind: str, *children: Node, **parameters: Any) -> Node:
        return node("bsdf", kind, **parameters).with_(*children)

    def two_sided(self, bsdf: Node) -> Node:
        return node("bsdf", "twosided").with_(bsdf)

    def constant(self, name: str, number: float) -> Node:
        return value(name, number)

    def rgb(self, name: str, color: Any) -> Node:
        return rgb(name, color)

    def color(self, name: str, slot: ir.Slot, scale: float = 1.0) -> Node:
        constant, row = self.value(slot) * scale, self.texture(slot)
        reflects = slot != ir.Slot.EMISSION
        if row < 0:
            return rgb(name, self._below_one(constant) if reflects else constant)
        if self.out.scene.tables.textures.kind[row] == ir.TextureKind.IMAGE:
            return self._bitmap(name, row, constant)
        self.textures.append(row)
        a, b = texture_values.cell_colors(self.out.scene.tables, row, constant)
        if reflects:
            a, b = self._below_one(a), self._below_one(b)
        return node("texture", "checkerboard", name=name).with_(rgb("color0", a), rgb("color1", b))

    def reflectance(self, name: str, scale: float = 1.0) -> Node:
        if not self._colored:
            return self.color(name, ir.Slot.DIFFUSE, scale)
        if self.materials.textures[self.row, ir.Slot.DIFFUSE] >= 0:
            self.reports_colors()
        return node("texture", "mesh_attribute", name=name).with_(value("name", "vertex_color"), value("scale", scale))

    def reports_colors(self) -> None:
        if self._colored:
            self.out.cannot(losses.COLORS, "instances", self._spoken)

    def number(self, name: str, slot: ir.Slot) -> Node:
        row, factor = self.texture(slot), float(self.value(slot)[0])
        if row >= 0 and self.out.scene.tables.textures.kind[row] == ir.TextureKind.IMAGE:
            return self._bitmap(name, row, np.full(3, factor))
        if row >= 0:
            self.cannot(losses.texture(slot))
        return value(name, factor)

    def alpha(self) -> Node:
        row, scale = self.texture(ir.Slot.ROUGHNESS), 1.0
        if row >= 0 or self.value(ir.Slot.ROUGHNESS)[0] > ROUGH:
            self.cannot(losses.INTERREFLECTION)
        if row >= 0:
            self.out.cannot("a texture of roughness is carried as its mean", "textures", row)
            scale = float(texture_values.mean(self.out.scene.tables, row).mean())
        return value("alpha", max(float(self.value(ir.Slot.ROUGHNESS)[0]) * scale, 0.01) ** 2)

    def parts(self) -> list[Node]:
        nodes = []
        for part in (self.materials.first, self.materials.second):
            row = MitsubaRow(self._all, int(part[self.row]), self._colored, self._spoken)
            nodes.append(row.mapped_bsdf())
            self.textures += row.textures
        return nodes

    def _bitmap(self, name: str, row: int, constant: F64, levels: bool = False) -> Node:
        self.textures.append(row)
        return self._all.bitmap(name, row, constant, levels)

    def _below_one(self, color: F64) -> F64:
        if color.max() > 1.0 + 1e-9:
            self.cannot(losses.TOO_BRIGHT)
        return np.clip(color, 0.0, 1.0)


def pfm(pixels: np.ndarray) -> bytes:
    """A portable float map of (height, width, 3) linear pixels from the top."""
    height, width = pixels.shape[:2]
    return f"PF\n{width} {height}\n-1.0\n".encode() + np.ascontiguousarray(pixels[::-1]).astype("<f4").tobytes()
