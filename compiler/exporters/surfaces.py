"""Materials as metallic–roughness surfaces, for formats that have these: glTF and UsdPreviewSurface."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from .. import ir
from ..scene.metallic_roughness import ALL, DARK, NOTHING, Surface
from ..scene.row_records import BLACK, Color, Input, as_color
from .export import Export

MODEL, SLOT = ir.MaterialModel, ir.Slot
MATT = (MODEL.LAMBERT, MODEL.PHONG, MODEL.BLINN_PHONG)
NO_HIGHLIGHT = Input.number(1.0)  # index of refraction without a reflectance


HIGHLIGHT = "a Phong highlight is carried as one of microfacets of the same width"


def highlight_roughness(tables: ir.Tables, material: int) -> float | None:
    """The roughness of microfacets, α = roughness², whose highlight is as wide as that of a Phong material; None without a highlight."""
    model, values = MODEL(int(tables.materials.model[material])), tables.materials.values[material]
    if model not in (MODEL.PHONG, MODEL.BLINN_PHONG) or values[SLOT.SPECULAR].max() <= 0:
        return None
    exponent = float(values[SLOT.SHININESS][0]) / (1.0 if model == MODEL.BLINN_PHONG else 0.25)
    return (2.0 / (exponent + 2.0)) ** 0.25  # its square is the α of Walter et al. 2007, √(2 / (n + 2)) for half vectors


class Exported(NamedTuple):
    """A surface, its transmission and its absorption. The textures of its inputs are rows of Textures."""

    surface: Surface
    transmission: float = 0.0  # 1: glass
    absorption: Color = BLACK  # per metre


class Surfaces:
    """The surfaces of materials. Reports inputs that the format lacks."""

    def __init__(self, out: Export) -> None:
        self.out, self.tables = out, out.scene.tables

    def of(self, material: int) -> Exported:
        """The surface of a material that is no blend."""
        model = MODEL(int(self.tables.materials.model[material]))
        name = self._name(material)
        opaque = {"opacity": 1.0, "holes": self._holes(material), "threshold": float(self.tables.materials.threshold[material])}
        more: dict[str, Any] = {**opaque, **self._maps(material), "name": name}
        if model in MATT:
            return Exported(self._matt(material, model, more))
        if model == MODEL.MIRROR:
            return Exported(Surface(self._color(material, SLOT.REFLECTION), ALL, NOTHING, **more))
        if model == MODEL.METAL:
            self.out.note("a metal's colour at grazing angles is carried as white", "materials", material)
            return Exported(Surface(self._color(material, SLOT.SPECULAR), ALL, self._input(material, SLOT.ROUGHNESS), **more))
        if model == MODEL.EMISSIVE:
            shining = self._color(material, SLOT.EMISSION)
            return Exported(Surface(DARK, NOTHING, ALL, NO_HIGHLIGHT, emissive=shining, **more))
        if model == MODEL.GLASS:
            inputs = self._color(material, SLOT.TRANSMISSION), NOTHING, self._input(material, SLOT.ROUGHNESS), self._ior(material)
            return Exported(Surface(*inputs, **more), 1.0, as_color(self._constant(material, SLOT.ABSORPTION)))
        return Exported(self._principled(material, model, more))

    def _name(self, material: int) -> str:
        names = self.out.scene.names.materials
        return (names[material] if material < len(names) else "") or f"material{material}"

    def _constant(self, material: int, slot: ir.Slot) -> np.ndarray:
        return self.tables.materials.values[material, slot]

    def _input(self, material: int, slot: ir.Slot) -> Input:
        texture = self.out.carried(int(self.tables.materials.textures[material, slot]))
        return Input(as_color(self._constant(material, slot)), texture)

    def _color(self, material: int, slot: ir.Slot) -> Input:
        return self._input(material, slot)

    def _ior(self, material: int) -> Input:
        if self.tables.materials.textures[material, SLOT.IOR] >= 0:
            self.out.cannot("a texture of the index of refraction is not carried", "materials", material)
        return Input.number(float(self._constant(material, SLOT.IOR)[0]))

    def _holes(self, material: int) -> Input | None:
        found = self._input(material, SLOT.OPACITY)
        return None if found.texture < 0 and found.value[0] >= 1.0 else found

    def _maps(self, material: int) -> dict[str, Input | None]:
        if self.tables.materials.textures[material, SLOT.BUMP] >= 0:
            self.out.cannot("a bump map is not carried", "materials", material, "a normal map is")
        normal = self._input(material, SLOT.NORMAL)
        return {"normal": normal if normal.texture >= 0 else None}

    def _matt(self, material: int, model: ir.MaterialModel, more: dict[str, Any]) -> Surface:
        diffuse = self._color(material, SLOT.DIFFUSE)
        if self._constant(material, SLOT.REFLECTION).max() > 0 or self._constant(material, SLOT.TRANSMISSION).max() > 0:
            self.out.cannot("k_r and k_t are not carried", "materials", material, "mirror(…) and glass(…) are")
        rough = highlight_roughness(self.tables, material)
        if rough is None:
            return Surface(diffuse, NOTHING, ALL, NO_HIGHLIGHT, **more)
        self.out.note(HIGHLIGHT, "materials", material)
        return Surface(diffuse, NOTHING, Input.number(rough), **more)

    def _principled(self, material: int, model: ir.MaterialModel, more: dict[str, Any]) -> Surface:
        through = float(self._constant(material, SLOT.TRANSMISSION).max())
        specular = model == MODEL.PRINCIPLED_SPECULAR
        if through > 0.0:
            more["opacity"] = 1.0 - through
        return Surface(
            self._color(material, SLOT.DIFFUSE), NOTHING if specular else self._input(material, SLOT.METALLIC),
            self._input(material, SLOT.ROUGHNESS), self._ior(material),
            specular=self._color(material, SLOT.SPECULAR) if specular else None, emissive=self._color(material, SLOT.EMISSION),
            coat=self._input(material, SLOT.COAT), coat_roughness=self._input(material, SLOT.COAT_ROUGHNESS),
            sheen=self._color(material, SLOT.SHEEN), sheen_roughness=self._input(material, SLOT.SHEEN_ROUGHNESS),
            occlusion=self._input(material, SLOT.AMBIENT), **more,
        )  # fmt: skip
