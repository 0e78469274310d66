"""Exports materials as Mitsuba BSDFs, with normal and bump maps. Mitsuba has no ambient light."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ... import ir
from ...scene import metals
from .. import texture_values
from ..export import Export
from ..placement import F64
from ..surfaces import HIGHLIGHT, highlight_roughness
from .xml import Node, node, rgb, value

MIRROR, GLASS, EMISSIVE = ir.MaterialModel.MIRROR, ir.MaterialModel.GLASS, ir.MaterialModel.EMISSIVE
METAL, BLEND = ir.MaterialModel.METAL, ir.MaterialModel.BLEND
PRINCIPLED = (ir.MaterialModel.PRINCIPLED, ir.MaterialModel.PRINCIPLED_SPECULAR)
ROUGH = 0.3  # roughness from which interreflection between microfacets exceeds 1 % of a metal's reflectance
_WRAPS = {ir.Wrap.REPEAT: "repeat", ir.Wrap.CLAMP: "clamp", ir.Wrap.MIRROR: "mirror"}
_MAPS = (ir.Slot.NORMAL, ir.Slot.BUMP)
_SLOTS = {
    MIRROR: (ir.Slot.REFLECTION, *_MAPS), GLASS: (ir.Slot.TRANSMISSION, ir.Slot.ROUGHNESS, *_MAPS), EMISSIVE: (ir.Slot.EMISSION,),
    METAL: (ir.Slot.ROUGHNESS, *_MAPS), BLEND: (ir.Slot.WEIGHT,),
    **dict.fromkeys(PRINCIPLED, (ir.Slot.DIFFUSE, ir.Slot.ROUGHNESS, ir.Slot.METALLIC, ir.Slot.EMISSION, *_MAPS)),
}  # fmt: skip
_MATT = (ir.Slot.DIFFUSE, ir.Slot.REFLECTION, ir.Slot.EMISSION, *_MAPS)


class Look(NamedTuple):
    """Exported surface of an instance."""

    bsdf: Node
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
            self._check_highlight(material)
            if self._constant(material, ir.Slot.TRANSMISSION).max() > 0:
                out.cannot("k_t is not carried: Mitsuba refracts by Fresnel's law only", "materials", material, "glass(…)")
        self._check_facets(material, model)
        if model == GLASS and m.textures[material, ir.Slot.IOR] >= 0:
            out.cannot("a texture of the index of refraction is not carried", "materials", material)
        if colored and (model in (MIRROR, GLASS) or m.textures[material, ir.Slot.DIFFUSE] >= 0):
            out.cannot("the mesh's colours are carried only where they stand alone, or times a constant", "instances", spoken)

    def _check_highlight(self, material: int) -> None:
        if highlight_roughness(self.tables, material) is None:
            return
        hint = "specular: 0, or lambert(…)"
        if self._constant(material, ir.Slot.REFLECTION).max() > 0:
            self.out.cannot("a highlight beside k_r is not carried", "materials", material, hint)
        else:
            self.out.cannot(HIGHLIGHT, "materials", material, hint)

    def _check_facets(self, material: int, model: ir.MaterialModel) -> None:
        m, out = self.tables.materials, self.out
        rough = self._constant(material, ir.Slot.ROUGHNESS)[0] > ROUGH or m.textures[material, ir.Slot.ROUGHNESS] >= 0
        if model in PRINCIPLED:
            out.cannot("`principled` is carried as Mitsuba's, whose matt part and coat are others", "materials", material)
        if model in (METAL, GLASS) and rough:
            out.cannot("light that bounces between facets is not carried: rough surfaces are darker in Mitsuba", "materials", material)
        if model == METAL and m.textures[material, ir.Slot.SPECULAR] >= 0:
            out.cannot("a texture of a metal's colour is not carried", "materials", material)
        if model == GLASS and self._constant(material, ir.Slot.ABSORPTION).max() > 0:
            out.cannot("what glass absorbs inside is not carried", "materials", material)

    def _texture(self, material: int) -> int:
        """The texture for which the mesh gets coordinates."""
        tables = self.tables
        made_of = [material]
        while blends := [k for k in made_of if tables.materials.model[k] == BLEND]:
            made_of.remove(blends[0])
            made_of += [int(tables.materials.first[blends[0]]), int(tables.materials.second[blends[0]])]
        pairs = [(k, slot) for k in made_of for slot in self._slots(k)]
        pairs += [(material, slot) for slot in self._slots(material) if material not in made_of]
        rows = [self.out.carried(int(tables.materials.textures[k, slot])) for k, slot in pairs]
        rows = [row for row in rows if row >= 0]
        for row in rows[1:]:
            same = tables.textures.kind[row] == tables.textures.kind[rows[0]] == ir.TextureKind.IMAGE
            if not same or (tables.textures.frame[row] != tables.textures.frame[rows[0]]).any():
                self.out.cannot("textures that lie differently on one surface are not carried", "textures", row)
        return rows[0] if rows else -1

    def _bsdf(self, material: int, colored: bool) -> Node:
        """A material's BSDF inside its normal and bump map BSDFs."""
        made = self._plain(material, colored)
        textures = self.tables.materials.textures
        if (row := self.out.carried(int(textures[material, ir.Slot.NORMAL]))) >= 0:
            if self._constant(material, ir.Slot.NORMAL)[0] != 1.0:
                self.out.cannot("the strength of a normal map is not carried", "materials", material)
            made = node("bsdf", "normalmap").with_(self._bitmap("normalmap", row, np.ones(3), levels=True), made)
        if (row := self.out.carried(int(textures[material, ir.Slot.BUMP]))) >= 0:
            self.out.cannot("how high a bump map is, is carried in Mitsuba's own unit", "materials", material)
            picture = self._bitmap("arbitrary", row, np.ones(3))
            made = node("bsdf", "bumpmap", scale=float(self._constant(material, ir.Slot.BUMP)[0])).with_(picture, made)
        return made

    def _plain(self, material: int, colored: bool) -> Node:
        model = ir.MaterialModel(int(self.tables.materials.model[material]))
        if model in PRINCIPLED:
            return node("bsdf", "twosided").with_(self._principled(material))
        if model == METAL:
            f0, edge = self._constant(material, ir.Slot.SPECULAR), self._constant(material, ir.Slot.EDGE)
            n, k = indices_of(f0, edge)
            facets = node("bsdf", "roughconductor", distribution="ggx").with_(rgb("eta", n), rgb("k", k), self._alpha(material))
            return node("bsdf", "twosided").with_(facets)
        if model == BLEND:
            rows = (int(self.tables.materials.first[material]), int(self.tables.materials.second[material]))
            parts = [self._bsdf(row, colored) for row in rows]
            return node("bsdf", "blendbsdf").with_(self._number("weight", material, ir.Slot.WEIGHT), *parts)
        if model == GLASS and self._constant(material, ir.Slot.ROUGHNESS)[0] > 0:
            ior = float(self._constant(material, ir.Slot.IOR)[0])
            color = self._color("specular_transmittance", material, ir.Slot.TRANSMISSION)
            return node("bsdf", "roughdielectric", distribution="ggx", int_ior=ior, ext_ior=1.0).with_(self._alpha(material), color)
        if model == GLASS:
            ior = float(self._constant(material, ir.Slot.IOR)[0])
            if ior == 1.0:
                self.out.cannot("glass of index 1 is not carried", "materials", material)
                ior = 1.000001
            color = self._color("specular_transmittance", material, ir.Slot.TRANSMISSION)
            return node("bsdf", "dielectric", int_ior=ior, ext_ior=1.0).with_(color)
        mirror, matt = self._constant(material, ir.Slot.REFLECTION), self._constant(material, ir.Slot.DIFFUSE)
        if model == EMISSIVE:
            matt, mirror = texture_values.BLACK, texture_values.BLACK
        if model == MIRROR or (mirror.max() > 0 and matt.max() == 0):
            return node("bsdf", "twosided").with_(self._conductor(material, 1.0))
        if mirror.max() > 0:
            return self._mix(material, float(mirror.max()), float(matt.max()), colored)
        rough = highlight_roughness(self.tables, material)
        if rough is not None:
            return node("bsdf", "twosided").with_(self._plastic(material, rough, colored))
        return node("bsdf", "twosided").with_(self._diffuse(material, 1.0, colored, black=model == EMISSIVE))

    def _plastic(self, material: int, rough: float, colored: bool) -> Node:
        """A diffuse base under microfacets of a roughness, which reflect 4 % along the normal as those of glTF."""
        bsdf = node("bsdf", "roughplastic", distribution="ggx", int_ior=1.5, ext_ior=1.0, alpha=rough**2)
        return bsdf.with_(self._reflectance("diffuse_reflectance", material, 1.0, colored))

    def _principled(self, material: int) -> Node:
        coat = float(self._constant(material, ir.Slot.COAT)[0])
        if self._constant(material, ir.Slot.SHEEN).any():
            self.out.cannot("sheen is not carried", "materials", material)
        ior = float(np.clip(self._constant(material, ir.Slot.IOR)[0], 1.01, 2.0))
        made = node("bsdf", "principled", eta=ior, clearcoat=coat)
        gloss = 1.0 - float(self._constant(material, ir.Slot.COAT_ROUGHNESS)[0])
        inputs = [self._color("base_color", material, ir.Slot.DIFFUSE), self._number("roughness", material, ir.Slot.ROUGHNESS)]
        inputs += [self._number("metallic", material, ir.Slot.METALLIC), value("clearcoat_gloss", gloss)]
        return made.with_(*inputs)

    def _alpha(self, material: int) -> Node:
        """Microfacet distribution width alpha: roughness squared."""
        row = self.out.carried(int(self.tables.materials.textures[material, ir.Slot.ROUGHNESS]))
        if row >= 0:
            self.out.cannot("a texture of roughness is carried as its mean", "textures", row)
        scale = 1.0 if row < 0 else float(texture_values.picture(self.tables, row, np.ones(3)).mean())
        return value("alpha", max(float(self._constant(material, ir.Slot.ROUGHNESS)[0]) * scale, 0.01) ** 2)

    def _number(self, name: str, material: int, slot: ir.Slot) -> Node:
        """A float parameter or a texture."""
        row = self.out.carried(int(self.tables.materials.textures[material, slot]))
        factor = float(self._constant(material, slot)[0])
        if row >= 0 and self.tables.textures.kind[row] == ir.TextureKind.IMAGE:
            return self._bitmap(name, row, np.full(3, factor))
        return value(name, factor)

    def _mix(self, material: int, mirror: float, matt: float, colored: bool) -> Node:
        """k_d and k_r together: a blend of two BSDFs, each divided by its weight.

        Mitsuba 3.9 weights light seen by the mirror as if it were diffuse (its blendbsdf loses that the sample was discrete). Measured:
        a fifth darker than each BSDF alone. So the two renderers differ.
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
            return node("bsdf", "diffuse").with_(rgb("reflectance", texture_values.BLACK))
        return node("bsdf", "diffuse").with_(self._reflectance("reflectance", material, scale, colored))

    def _reflectance(self, name: str, material: int, scale: float, colored: bool) -> Node:
        """The diffuse colour of a material; of a mesh with colours, theirs."""
        if colored:
            return node("texture", "mesh_attribute", name=name).with_(*_named_color(scale))
        return self._color(name, material, ir.Slot.DIFFUSE, scale)

    def _conductor(self, material: int, scale: float) -> Node:
        color = self._color("specular_reflectance", material, ir.Slot.REFLECTION, scale)
        return node("bsdf", "conductor", material="none").with_(color)

    def _emission(self, material: int) -> Node | None:
        if self._constant(material, ir.Slot.EMISSION).max() <= 0 or ir.Slot.EMISSION not in self._slots(material):
            return None
        return self._color("radiance", material, ir.Slot.EMISSION)

    def _color(self, name: str, material: int, slot: ir.Slot, scale: float = 1.0) -> Node:
        """A material input as an rgb, a bitmap or a checkerboard."""
        tables = self.tables
        constant = self._constant(material, slot) * scale
        row = self.out.carried(int(tables.materials.textures[material, slot]))
        reflects = slot != ir.Slot.EMISSION
        if row < 0:
            return rgb(name, self._below_one(constant, material) if reflects else constant)
        if tables.textures.kind[row] == ir.TextureKind.IMAGE:
            return self._bitmap(name, row, constant)
        a, b = texture_values.cell_colors(tables, row, constant)
        if reflects:
            a, b = self._below_one(a, material), self._below_one(b, material)
        return node("texture", "checkerboard", name=name).with_(rgb("color0", a), rgb("color1", b))

    def _below_one(self, color: F64, material: int) -> F64:
        if color.max() > 1.0 + 1e-9:
            self.out.cannot("Mitsuba reflects no more light than arrives: colours above 1 are cut", "materials", material)
        return np.clip(color, 0.0, 1.0)

    def _bitmap(self, name: str, row: int, constant: F64, levels: bool = False) -> Node:
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
        given = {"filename": self._pictures[key], "raw": True, "wrap_mode": _WRAPS.get(ir.Wrap(wraps[0]), "clamp")}
        return node("texture", "bitmap", name=name, filter_type="nearest" if textures.nearest[row] else "bilinear", **given)


def _named_color(scale: float) -> tuple[Node, ...]:
    return (value("name", "vertex_color"), value("scale", scale))


def indices_of(f0: F64, edge: F64) -> tuple[F64, F64]:
    """(n, k) of conductors with reflectance f0 along the normal and factor `edge` of Schlick's law at metals.LOWEST.

    Nearest entry of a fine grid.
    """
    n = np.geomspace(0.01, 6.0, 400)
    found = np.zeros((2, 3))
    for channel in range(3):
        along = min(float(f0[channel]), 0.9999)
        k = np.sqrt(np.maximum((along * (n + 1.0) ** 2 - (n - 1.0) ** 2) / (1.0 - along), 0.0))
        wanted = (along + (1.0 - along) * (1.0 - metals.LOWEST) ** 5) * float(edge[channel])
        off = np.abs(metals.conductor(n, k, metals.LOWEST) - wanted) + np.abs(metals.conductor(n, k, 1.0) - along)
        best = int(np.argmin(off))
        found[:, channel] = n[best], k[best]
    return found[0], found[1]


def pfm(pixels: np.ndarray) -> bytes:
    """A portable float map of (height, width, 3) linear pixels from the top."""
    height, width = pixels.shape[:2]
    return f"PF\n{width} {height}\n-1.0\n".encode() + np.ascontiguousarray(pixels[::-1]).astype("<f4").tobytes()
