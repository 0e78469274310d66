"""Exports materials as POV-Ray pigments and finishes. Equations agree, but POV-Ray's highlights have no colour."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ....lights import AMBIENT
from ... import ir
from ...plan.plan import Plan
from .. import number_text, texture_values
from ..export import Export
from ..number_text import number
from ..placement import F64

_GREY = 1e-9
_HIGHLIGHTS = {ir.MaterialModel.PHONG: ("phong", "phong_size"), ir.MaterialModel.BLINN_PHONG: ("specular", "roughness")}


class Look(NamedTuple):
    """Exported material without its pigment."""

    finish: str
    more: list[str]  # interior lines of the object
    glass: bool


class Finishes:
    """Finishes of materials, and the images they use."""

    def __init__(self, out: Export, plan: Plan, name: str) -> None:
        self.out, self.plan, self.name, self.tables = out, plan, name, out.scene.tables
        lights = self.tables.lights
        self.ambient = lights.color[ir.is_in(lights.kind, AMBIENT)].sum(axis=0) if len(lights.kind) else np.zeros(3)
        self._pictures: dict[tuple[int, bytes], str] = {}

    def texture_of(self, material: int) -> int:
        """The texture row of a material's pigment, or -1."""
        model = self.tables.materials.model[material]
        if model == ir.MaterialModel.MIRROR:
            return -1
        return self.out.carried(int(self.tables.materials.textures[material, self._slot(material)]))

    def _slot(self, material: int) -> ir.Slot:
        model = self.tables.materials.model[material]
        if model == ir.MaterialModel.GLASS:
            return ir.Slot.TRANSMISSION
        return ir.Slot.EMISSION if model == ir.MaterialModel.EMISSIVE else ir.Slot.DIFFUSE

    def _value(self, material: int, slot: ir.Slot) -> F64:
        return self.tables.materials.values[material, slot]

    def pigment(self, material: int) -> str:
        """A colour, a checker or an image; PLACE marks the position of its surface mapping."""
        constant = self._value(material, self._slot(material))
        clear = " filter 1" if self.tables.materials.model[material] == ir.MaterialModel.GLASS else ""
        row = self.texture_of(material)
        if row < 0:
            return f"rgb <{number_text.numbers(constant)}>{clear}"
        if clear:
            self.out.cannot("a texture of glass is not carried", "textures", row)
        if self.tables.textures.kind[row] == ir.TextureKind.IMAGE:
            return self._image(row, constant)
        a, b = texture_values.cell_colors(self.tables, row, constant)
        return f"checker rgb <{number_text.numbers(a)}>, rgb <{number_text.numbers(b)}> PLACE"

    def _image(self, row: int, constant: F64) -> str:
        textures = self.tables.textures
        if textures.wrap_u[row] != ir.Wrap.REPEAT or textures.wrap_v[row] != ir.Wrap.REPEAT:
            self.out.cannot("a texture that does not repeat is not carried", "textures", row)
        pixels = texture_values.picture(self.tables, row, constant)
        if pixels.max(initial=0.0) > 1.0:
            self.out.cannot("a texture brighter than 1 is not carried", "textures", row)
        key = (row, constant.tobytes())
        if key not in self._pictures:
            self._pictures[key] = f"{self.name}.{len(self.out.files)}.ppm"
            self.out.files[self._pictures[key]] = ppm(pixels)
        smooth = "" if textures.nearest[row] else " interpolate 2"
        return f'image_map {{ ppm "{self._pictures[key]}" gamma 1.0{smooth} }} PLACE'

    def look(self, material: int, instance: int) -> Look:
        """A material's finish."""
        m, out = self.tables.materials, self.out
        model = ir.MaterialModel(int(m.model[material]))
        if m.shading[material] == ir.Shading.GOURAUD:
            out.cannot("light at vertices (gouraud) is not carried: POV-Ray shades at every point", "materials", material)
        self._check(material, model)
        for slot in ir.Slot:
            if m.textures[material, slot] >= 0 and slot != self._slot(material) and slot != ir.Slot.AMBIENT:
                out.cannot(f"a texture of {slot.name.lower()} is not carried", "materials", material)
        if model == ir.MaterialModel.GLASS:
            ior = number(self._value(material, ir.Slot.IOR)[0])
            finish = "finish { ambient 0 diffuse 0 reflection { rgb 0, rgb 1 fresnel on } conserve_energy }"
            return Look(finish, [f"  interior {{ ior {ior} }}"], True)
        if model == ir.MaterialModel.EMISSIVE:
            return Look("finish { ambient 0 diffuse 0 emission 1 }", [], False)
        return Look(self._opaque(material, model, instance), [], False)

    def _check(self, material: int, model: ir.MaterialModel) -> None:
        """Reports microfacet features that POV-Ray lacks."""
        names = {
            ir.MaterialModel.PRINCIPLED: "principled", ir.MaterialModel.PRINCIPLED_SPECULAR: "principled", ir.MaterialModel.METAL: "metal",
            ir.MaterialModel.BLEND: "blend",
        }  # fmt: skip
        if model in names:
            what = {"blend": "POV-Ray gets its colour alone"}.get(names[model], "POV-Ray has no microfacets: its colour alone is")
            self.out.cannot(f"`{names[model]}` is not carried: {what}", "materials", material, "lambert(…), phong(…) or mirror(…)")
        if model == ir.MaterialModel.GLASS and self._value(material, ir.Slot.ROUGHNESS)[0] > 0:
            self.out.cannot("roughness of glass is not carried", "materials", material)
        if model == ir.MaterialModel.GLASS and self._value(material, ir.Slot.ABSORPTION).max() > 0:
            self.out.cannot("what glass absorbs inside is not carried", "materials", material)

    def _opaque(self, material: int, model: ir.MaterialModel, instance: int) -> str:
        matt = 0 if model == ir.MaterialModel.MIRROR else 1
        words = [f"diffuse {matt}", f"ambient rgb <{number_text.numbers(self._ambient(material))}>"]
        mirror = self._value(material, ir.Slot.REFLECTION)
        if mirror.max() > 0 and self.plan["bounces"] > 0:
            words.append(f"reflection {{ rgb <{number_text.numbers(mirror)}> }}")
        if model != ir.MaterialModel.MIRROR:
            words += self._highlight(material, model)
            if self._value(material, ir.Slot.TRANSMISSION).max() > 0:
                self.out.cannot("k_t is not carried: in POV-Ray it weakens k_d", "materials", material, "glass(…)")
            if self._value(material, ir.Slot.EMISSION).max() > 0:
                self.out.cannot("emission beside k_d is not carried", "materials", material)
        return f"finish {{ {' '.join(words)} }}"

    def _ambient(self, material: int) -> F64:
        """k_a L_a divided by the pigment, by which POV-Ray multiplies."""
        m, wanted = self.tables.materials, self._value(material, ir.Slot.AMBIENT) * self.ambient
        matt = self._value(material, ir.Slot.DIFFUSE)
        if not wanted.any():
            return np.zeros(3)
        alike = m.textures[material, ir.Slot.AMBIENT] == m.textures[material, ir.Slot.DIFFUSE]
        if not alike or np.any((matt == 0) & (wanted > 0)):
            self.out.cannot("k_a is carried as a share of k_d only", "materials", material)
        return np.where(matt > 0, wanted / np.where(matt > 0, matt, 1.0), 0.0)

    def _highlight(self, material: int, model: ir.MaterialModel) -> list[str]:
        strength = self._value(material, ir.Slot.SPECULAR)
        if strength.max() <= 0 or model not in _HIGHLIGHTS:
            return []
        if np.ptp(strength) > _GREY:
            self.out.cannot("a highlight's colour is not carried: POV-Ray's has the light's", "materials", material)
        if self.tables.materials.normalized[material]:
            self.out.cannot("a normalized highlight is not carried", "materials", material, "normalized: false")
        exponent = float(self._value(material, ir.Slot.SHININESS)[0])
        name, size = _HIGHLIGHTS[model]
        given = exponent if model == ir.MaterialModel.PHONG else 1.0 / max(exponent, 1e-6)
        return [f"{name} {number(strength.mean())} {size} {number(given)}"]


def ppm(pixels: np.ndarray) -> bytes:
    """A binary PPM with 16 bits a channel from (height, width, 3) linear pixels from the top, clipped to 0…1."""
    height, width = pixels.shape[:2]
    return f"P6\n{width} {height}\n65535\n".encode() + np.rint(np.clip(pixels, 0.0, 1.0) * 65535.0).astype(">u2").tobytes()
