"""Materials as Mitsuba's BSDFs: matt, mirror, glass, and mixes of matt and mirror. It has no Phong lobe and no ambient light."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from . import export, ir
from .export import F64, Export
from .export_mitsuba_xml import Node, node, rgb, value

MIRROR, GLASS, EMISSIVE = ir.MaterialModel.MIRROR, ir.MaterialModel.GLASS, ir.MaterialModel.EMISSIVE
_WRAPS = {ir.Wrap.REPEAT: "repeat", ir.Wrap.CLAMP: "clamp", ir.Wrap.MIRROR: "mirror"}
_SLOTS = {MIRROR: (ir.Slot.REFLECTION,), GLASS: (ir.Slot.TRANSMISSION,), EMISSIVE: (ir.Slot.EMISSION,)}
_MATT = (ir.Slot.DIFFUSE, ir.Slot.REFLECTION, ir.Slot.EMISSION)


class Look(NamedTuple):
    """How an instance's surface is written."""

    bsdf: Node
    emission: Node | None  # radiance
    texture: int  # row of Textures whose coordinates its mesh must have, or -1


class Materials:
    """Looks of materials, each written once; pictures go to the export's files."""

    def __init__(self, out: Export, name: str) -> None:
        self.out, self.name, self.tables = out, name, out.scene.tables
        self.definitions: list[Node] = []
        self._looks: dict[tuple[int, bool], Look] = {}
        self._pictures: dict[tuple[int, bytes], str] = {}

    def look(self, material: int, colored: bool, spoken: int) -> Look:
        """The look of a material on a mesh with or without vertex colours; `spoken` is an instance for messages."""
        key = (material, colored)
        if key not in self._looks:
            self._check(material, colored, spoken)
            texture = self._texture(material)
            made = Look(self._bsdf(material, colored), self._emission(material), texture)
            name = f"material{len(self.definitions)}"
            self.definitions.append(Node("bsdf", {**made.bsdf.attributes, "id": name}, made.bsdf.children))
            self._looks[key] = made._replace(bsdf=Node("ref", {"id": name}))
        return self._looks[key]

    def _slots(self, material: int) -> tuple[ir.Slot, ...]:
        return _SLOTS.get(ir.MaterialModel(int(self.tables.materials.model[material])), _MATT)

    def _constant(self, material: int, slot: ir.Slot) -> F64:
        return self.tables.materials.values[material, slot]

    def _check(self, material: int, colored: bool, spoken: int) -> None:
        m, out = self.tables.materials, self.out
        model = ir.MaterialModel(int(m.model[material]))
        if m.shading[material] == ir.Shading.GOURAUD:
            out.cannot("light at vertices (gouraud) is not carried: Mitsuba shades at every point", "materials", material)
        if model in (ir.MaterialModel.PHONG, ir.MaterialModel.BLINN_PHONG, ir.MaterialModel.LAMBERT):
            if self._constant(material, ir.Slot.SPECULAR).max() > 0:
                name = "Blinn-Phong" if model == ir.MaterialModel.BLINN_PHONG else "Phong"
                out.cannot(f"the highlight is not carried: Mitsuba has no {name} lobe", "materials", material, "specular: 0, or lambert(…)")
            if self._constant(material, ir.Slot.TRANSMISSION).max() > 0:
                out.cannot("k_t is not carried: Mitsuba refracts by Fresnel's law only", "materials", material, "glass(…)")
        if model == GLASS and m.textures[material, ir.Slot.IOR] >= 0:
            out.cannot("a texture of the index of refraction is not carried", "materials", material)
        if colored and (model in (MIRROR, GLASS) or m.textures[material, ir.Slot.DIFFUSE] >= 0):
            out.cannot("the mesh's colours are carried only where they stand alone, or times a constant", "instances", spoken)

    def _texture(self, material: int) -> int:
        """The texture that says which coordinates the mesh gets."""
        tables = self.tables
        rows = [self.out.carried(int(tables.materials.textures[material, slot])) for slot in self._slots(material)]
        rows = [row for row in rows if row >= 0]
        for row in rows[1:]:
            same = tables.textures.kind[row] == tables.textures.kind[rows[0]] == ir.TextureKind.IMAGE
            if not same or (tables.textures.frame[row] != tables.textures.frame[rows[0]]).any():
                self.out.cannot("textures that lie differently on one surface are not carried", "textures", row)
        return rows[0] if rows else -1

    def _bsdf(self, material: int, colored: bool) -> Node:
        model = ir.MaterialModel(int(self.tables.materials.model[material]))
        if model == GLASS:
            ior = float(self._constant(material, ir.Slot.IOR)[0])
            if ior == 1.0:
                self.out.cannot("glass of index 1 is not carried", "materials", material)
                ior = 1.000001
            color = self._color("specular_transmittance", material, ir.Slot.TRANSMISSION)
            return node("bsdf", "dielectric", int_ior=ior, ext_ior=1.0).with_(color)
        mirror, matt = self._constant(material, ir.Slot.REFLECTION), self._constant(material, ir.Slot.DIFFUSE)
        if model == EMISSIVE:
            matt, mirror = export.BLACK, export.BLACK
        if model == MIRROR or (mirror.max() > 0 and matt.max() == 0):
            return node("bsdf", "twosided").with_(self._conductor(material, 1.0))
        if mirror.max() > 0:
            return self._mix(material, float(mirror.max()), float(matt.max()), colored)
        return node("bsdf", "twosided").with_(self._diffuse(material, 1.0, colored, black=model == EMISSIVE))

    def _mix(self, material: int, mirror: float, matt: float, colored: bool) -> Node:
        """k_d and k_r at once: a blend of two, each divided by its own share.

        Mitsuba 3.9 weighs what the mirror sees as if it were matt (its blendbsdf loses that the sample was discrete): measured, a fifth
        less than each alone. So the two are not the same.
        """
        self.out.cannot(
            "k_d and k_r at once are not carried: in Mitsuba's blend of a matt surface and a mirror, light arrives weaker in the mirror",
            "materials", material,
        )  # fmt: skip
        share = mirror / max(mirror + matt, 1.0)
        layers = self._diffuse(material, 1.0 / (1.0 - share), colored), self._conductor(material, 1.0 / share)
        blend = node("bsdf", "blendbsdf", weight=share).with_(*layers)
        return node("bsdf", "twosided").with_(blend)

    def _diffuse(self, material: int, scale: float, colored: bool, black: bool = False) -> Node:
        if black:
            return node("bsdf", "diffuse").with_(rgb("reflectance", export.BLACK))
        if colored:
            return node("bsdf", "diffuse", reflectance=node("texture", "mesh_attribute", name="reflectance").with_(*_named_color(scale)))
        return node("bsdf", "diffuse").with_(self._color("reflectance", material, ir.Slot.DIFFUSE, scale))

    def _conductor(self, material: int, scale: float) -> Node:
        color = self._color("specular_reflectance", material, ir.Slot.REFLECTION, scale)
        return node("bsdf", "conductor", material="none").with_(color)

    def _emission(self, material: int) -> Node | None:
        if self._constant(material, ir.Slot.EMISSION).max() <= 0 or ir.Slot.EMISSION not in self._slots(material):
            return None
        return self._color("radiance", material, ir.Slot.EMISSION)

    def _color(self, name: str, material: int, slot: ir.Slot, scale: float = 1.0) -> Node:
        """A material's input: an rgb, a bitmap or a checkerboard."""
        tables = self.tables
        constant = self._constant(material, slot) * scale
        row = self.out.carried(int(tables.materials.textures[material, slot]))
        reflects = slot != ir.Slot.EMISSION
        if row < 0:
            return rgb(name, self._below_one(constant, material) if reflects else constant)
        if tables.textures.kind[row] == ir.TextureKind.IMAGE:
            return self._bitmap(name, row, constant)
        a, b = export.cell_colors(tables, row, constant)
        if reflects:
            a, b = self._below_one(a, material), self._below_one(b, material)
        return node("texture", "checkerboard", name=name).with_(rgb("color0", a), rgb("color1", b))

    def _below_one(self, color: F64, material: int) -> F64:
        if color.max() > 1.0 + 1e-9:
            self.out.cannot("Mitsuba reflects no more light than arrives: colours above 1 are cut", "materials", material)
        return np.clip(color, 0.0, 1.0)

    def _bitmap(self, name: str, row: int, constant: F64) -> Node:
        textures = self.tables.textures
        wraps = int(textures.wrap_u[row]), int(textures.wrap_v[row])
        if wraps[0] != wraps[1] or wraps[0] not in _WRAPS:
            self.out.cannot("a texture that wraps differently over u and v, or ends in black, is not carried", "textures", row)
        key = (row, constant.tobytes())
        if key not in self._pictures:
            self._pictures[key] = f"{self.name}.{len(self.out.files)}.pfm"
            self.out.files[self._pictures[key]] = pfm(export.picture(self.tables, row, constant))
        given = {"filename": self._pictures[key], "raw": True, "wrap_mode": _WRAPS.get(ir.Wrap(wraps[0]), "clamp")}
        return node("texture", "bitmap", name=name, filter_type="nearest" if textures.nearest[row] else "bilinear", **given)


def _named_color(scale: float) -> tuple[Node, ...]:
    return (value("name", "vertex_color"), value("scale", scale))


def pfm(pixels: np.ndarray) -> bytes:
    """A portable float map of (height, width, 3) linear pixels from the top."""
    height, width = pixels.shape[:2]
    return f"PF\n{width} {height}\n-1.0\n".encode() + np.ascontiguousarray(pixels[::-1]).astype("<f4").tobytes()
