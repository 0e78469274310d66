"""Writes what glTF's extensions add to a surface: anisotropy and dispersion as constants, iridescence and the highlight with pictures."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from ....materials import losses
from ... import ir

Slot = ir.Slot
Reference = dict[str, Any]
_COAT_IOR = 1.5  # of glTF's coat, which darkens no base
_MICROMETRES = 1e3  # nanometres
_ROUND = ("specular_roughness_anisotropy", "specular_rotation")
_FILM = ("thin_film_weight", "thin_film_thickness", "thin_film_ior")
_HIGHLIGHT = ("specular_weight", "specular_color")


class Looks:
    """The extensions of a row of Materials."""

    def __init__(self, tables: ir.Tables, row: int) -> None:
        materials, self._kinds = tables.materials, tables.textures.kind
        self._values, self._textures = materials.values[row], materials.textures[row]
        self._model = ir.MaterialModel(int(materials.model[row]))
        slabs = self._model == ir.MaterialModel.OPENPBR
        self._round = slabs and self._constant(Slot.ANISOTROPY, Slot.ROTATION, Slot.ROUGHNESS) and self._number(Slot.ANISOTROPY) > 0.0
        film = slabs and self._constant(Slot.FILM_IOR) and self._pictured(Slot.FILM, Slot.FILM_THICKNESS)
        self._film = film and self._number(Slot.FILM) > 0.0
        dielectric = slabs and self._constant(Slot.METALLIC) and self._number(Slot.METALLIC) == 0.0
        tinted = self._number(Slot.SPECULAR_WEIGHT) != 1.0 or bool((self._values[Slot.SPECULAR] != 1.0).any())
        tinted = tinted or not self._constant(Slot.SPECULAR_WEIGHT, Slot.SPECULAR)
        self._tinted = dielectric and tinted and self._pictured(Slot.SPECULAR_WEIGHT, Slot.SPECULAR)
        self._dispersive = self._model == ir.MaterialModel.GLASS and self._number(Slot.DISPERSION) > 0.0

    @property
    def is_turned(self) -> bool:
        """Whether highlights follow the texture coordinate u."""
        return self._round

    def carried(self) -> frozenset[str]:
        """The losses of a metallic–roughness surface that the extensions carry."""
        names: list[str] = []
        for is_used, carried in ((self._round, _ROUND), (self._film, _FILM), (self._tinted, _HIGHLIGHT)):
            names += carried if is_used else ()
        if self._model == ir.MaterialModel.OPENPBR and self._number(Slot.COAT_IOR) == _COAT_IOR:
            names.append("coat_ior")
        if self._model == ir.MaterialModel.OPENPBR and self._number(Slot.COAT_DARKENING) == 0.0:
            names.append("coat_darkening")
        return frozenset((losses.COAT_NORMAL, *map(losses.argument, names), *([losses.DISPERSION] if self._dispersive else [])))

    def roughness(self, rough: float) -> float:
        """The roughness that glTF has across the direction of the anisotropy, of that of the surface."""
        return math.sqrt(self._alphas()[1]) if self._round else rough

    def extensions(self, picture: Callable[..., Reference], in_alpha: Callable[[int], Reference]) -> dict[str, Any]:
        """The extensions by their names. The functions give references of a texture: to its colours or numbers, to numbers in alpha."""
        extensions_by_name: dict[str, Any] = {}
        if self._round:
            along, across = self._alphas()
            strength = math.sqrt(max(along - across, 0.0) / max(1.0 - across, 1e-9))
            turn = 2.0 * math.pi * self._number(Slot.ROTATION)
            extensions_by_name["KHR_materials_anisotropy"] = {"anisotropyStrength": min(strength, 1.0), "anisotropyRotation": turn}
        if self._film:
            film: dict[str, Any] = {
                "iridescenceFactor": self._number(Slot.FILM), "iridescenceIor": max(self._number(Slot.FILM_IOR), 1.0),
                "iridescenceThicknessMaximum": _MICROMETRES * self._number(Slot.FILM_THICKNESS),
            }  # fmt: skip
            if (row := int(self._textures[Slot.FILM])) >= 0:
                film["iridescenceTexture"] = picture(row)
            if (row := int(self._textures[Slot.FILM_THICKNESS])) >= 0:
                film |= {"iridescenceThicknessMinimum": 0.0, "iridescenceThicknessTexture": picture(row)}
            extensions_by_name["KHR_materials_iridescence"] = film
        if self._tinted:
            specular: dict[str, Any] = {"specularFactor": min(self._number(Slot.SPECULAR_WEIGHT), 1.0)}
            specular["specularColorFactor"] = self._values[Slot.SPECULAR].tolist()
            if (row := int(self._textures[Slot.SPECULAR_WEIGHT])) >= 0:
                specular["specularTexture"] = in_alpha(row)
            if (row := int(self._textures[Slot.SPECULAR])) >= 0:
                specular["specularColorTexture"] = picture(row, color=True)
            extensions_by_name["KHR_materials_specular"] = specular
        if self._dispersive:
            extensions_by_name["KHR_materials_dispersion"] = {"dispersion": self._number(Slot.DISPERSION)}
        return extensions_by_name

    def _alphas(self) -> tuple[float, float]:
        """α of the highlight along and across its direction, at most 1."""
        share = 1.0 - float(np.clip(self._number(Slot.ANISOTROPY), 0.0, 1.0))
        along = self._number(Slot.ROUGHNESS) ** 2 * math.sqrt(2.0 / (1.0 + share * share))
        return min(along, 1.0), min(along * share, 1.0)

    def _number(self, slot: ir.Slot) -> float:
        return float(self._values[slot, 0])

    def _pictured(self, *slots: ir.Slot) -> bool:
        """Whether the textures of slots, if any, are pictures or cells."""
        return all(self._textures[slot] < 0 or self._kinds[self._textures[slot]] != ir.TextureKind.FORMULA for slot in slots)

    def _constant(self, *slots: ir.Slot) -> bool:
        return bool((self._textures[list(slots)] < 0).all())
