"""Writes materials and their pictures: glTF 2.0 §3.9 and ratified KHR_materials_… extensions."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ....materials import losses
from ....materials.contract import Exported
from ... import ir
from ...scene import scattering_albedo
from ...scene.row_records import WHITE, Input, MediumData, scale_color
from ..export import Export
from ..media import medium_of
from ..placement import F64
from ..surfaces import surface_of
from ..texture_sets import TextureSets
from .container import Container
from .looks import Looks

_WRAPS = {ir.Wrap.REPEAT: 10497, ir.Wrap.CLAMP: 33071, ir.Wrap.MIRROR: 33648}
_NEAREST, _LINEAR, _MIPS = 9728, 9729, 9987
_GLASS_IOR = 1.5  # glTF's default
_SLOT = ir.Slot
PICTURED = frozenset(
    (
        _SLOT.AMBIENT,
        _SLOT.DIFFUSE,
        _SLOT.SPECULAR,
        _SLOT.REFLECTION,
        _SLOT.EMISSION,
        _SLOT.OPACITY,
        _SLOT.ROUGHNESS,
        _SLOT.METALLIC,
        _SLOT.COAT,
        _SLOT.COAT_ROUGHNESS,
        _SLOT.SHEEN,
        _SLOT.SHEEN_ROUGHNESS,
        _SLOT.DIFFUSE_TRANSMISSION,
        _SLOT.SPECULAR_WEIGHT,
        _SLOT.FUZZ_COLOR,
        _SLOT.FUZZ_ROUGHNESS,
        _SLOT.FILM,
        _SLOT.FILM_THICKNESS,
        _SLOT.SUBSURFACE_COLOR,
    )
)  # inputs that have a picture in glTF
TOGETHER = frozenset((_SLOT.DIFFUSE, _SLOT.OPACITY)), frozenset((_SLOT.METALLIC, _SLOT.ROUGHNESS))  # channels of one picture


class Written(NamedTuple):
    """A material of the file, and the sets of texture coordinates that its pictures use."""

    index: int
    sets: TextureSets
    is_turned: bool = False  # whether its highlights follow u


class Materials:
    """The materials of the file, each written once."""

    def __init__(self, out: Export, container: Container, png: Callable[..., bytes], baked: Mapping[int, F64]) -> None:
        """`baked`: see TextureSets."""
        self._baked = baked
        self.out, self.container, self.tables, self._png = out, container, out.scene.tables, png
        self._written: dict[tuple[int, bytes], Written] = {}
        self._images: dict[bytes, int] = {}
        self._sets = TextureSets(self.tables, self._baked)  # of the material that is being written

    def written(self, row: int, radiance: F64 | None = None) -> Written:
        """The material of a row; with `radiance` a black one that emits it, as an area light's shape does."""
        key = (row, b"" if radiance is None else radiance.tobytes())
        if key not in self._written:
            self._sets = TextureSets(self.tables, self._baked)
            looks = Looks(self.tables, row)
            exported = surface_of(self.out, row, looks.carried())._replace(medium=medium_of(self.out, row))
            document = self._document(exported, looks) if radiance is None else self._shining(f"light{len(self._written)}", radiance)
            document["doubleSided"] = True
            self._written[key] = Written(self.container.add("materials", document), self._sets, radiance is None and looks.is_turned)
        return self._written[key]

    # --- documents ---

    def _shining(self, name: str, radiance: F64) -> dict[str, Any]:
        pbr = {"baseColorFactor": [0.0, 0.0, 0.0, 1.0], "metallicFactor": 0.0, "roughnessFactor": 1.0}
        document: dict[str, Any] = {"name": name, "pbrMetallicRoughness": pbr, **self._emission(Input(tuple(radiance.tolist())))}
        return document

    def _document(self, exported: Exported, looks: Looks) -> dict[str, Any]:
        if exported.body:  # its colour is in the medium
            exported = exported._replace(diffuse_transmission=Input(WHITE))
            if exported.surface.diffuse.texture >= 0:
                self.out.cannot(losses.BODY_COLOR, "textures", exported.surface.diffuse.texture)
        share = 1.0 if exported.body else self._passing_share(exported)
        if share > 0.0:
            diffuse = exported.surface.diffuse
            base = replace(diffuse, value=scale_color(diffuse.value, 1.0 / (1.0 - share))) if share < 1.0 else diffuse
            exported = exported._replace(surface=replace(exported.surface, diffuse=base))
        s = exported.surface
        if s.diffuse.texture < 0 and s.opacity.texture >= 0:
            base = self._in_alpha(s.opacity.texture)
        else:
            base = self._base(s.diffuse, s.opacity.texture)
        alpha = s.opacity.value[0] * (1.0 - s.transmission)
        factor = self._below_one(s.diffuse.value)
        pbr: dict[str, Any] = {"baseColorFactor": [*factor, min(max(alpha, 0.0), 1.0)]}
        if base is not None:
            pbr["baseColorTexture"] = base
        pbr |= {"metallicFactor": s.metallic.value[0], "roughnessFactor": looks.roughness(s.roughness.value[0])}
        packed = self._packed(s.metallic.texture, s.roughness.texture)
        if packed is not None:
            pbr["metallicRoughnessTexture"] = packed
        document: dict[str, Any] = {"name": s.name, "pbrMetallicRoughness": pbr}
        if s.threshold > 0:
            document |= {"alphaMode": "MASK", "alphaCutoff": s.threshold}
        elif alpha < 1.0 or s.opacity.texture >= 0:
            document["alphaMode"] = "BLEND"
        if s.normal is not None:
            document["normalTexture"] = {**self._picture(s.normal.texture, levels=True), "scale": s.normal.value[0]}
        if s.occlusion.texture >= 0:
            document["occlusionTexture"] = self._picture(s.occlusion.texture)
        document |= self._emission(s.emissive)
        if extensions := {**self._extensions(exported, share), **looks.extensions(self._picture, self._in_alpha)}:
            document.setdefault("extensions", {}).update(extensions)
        for name in document.get("extensions", {}):
            self.container.use(name)
        return document

    @staticmethod
    def _passing_share(exported: Exported) -> float:
        """KHR_materials_diffuse_transmission weights reflection and transmission by one number: with it both colours are at most 1."""
        passed = 0.0 if exported.diffuse_transmission is None else max(exported.diffuse_transmission.value)
        return passed / max(passed + max(exported.surface.diffuse.value), 1e-9)

    def _emission(self, emissive: Input) -> dict[str, Any]:
        strength = max(emissive.value)
        if strength <= 0:
            return {}
        emission: dict[str, Any] = {"emissiveFactor": [c / strength for c in emissive.value]}
        if emissive.texture >= 0:
            emission["emissiveTexture"] = self._picture(emissive.texture, color=True)
        self.container.use("KHR_materials_emissive_strength")
        return {**emission, "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": strength}}}

    def _extensions(self, exported: Exported, share: float) -> dict[str, Any]:
        """`share`: what passes diffusely, of what is reflected or passes."""
        s = exported.surface
        extensions: dict[str, Any] = {}
        if s.ior.value[0] != _GLASS_IOR and s.specular is None:
            extensions["KHR_materials_ior"] = {"ior": max(s.ior.value[0], 1.0)}
        if s.specular is not None:
            largest = max(*s.specular.value, 1e-9)
            root = math.sqrt(min(largest, 0.99))
            extensions["KHR_materials_ior"] = {"ior": (1.0 + root) / (1.0 - root)}
            specular: dict[str, Any] = {"specularColorFactor": [c / largest for c in s.specular.value]}
            if s.specular.texture >= 0:
                specular["specularColorTexture"] = self._picture(s.specular.texture, color=True)
            extensions["KHR_materials_specular"] = specular
        if share > 0.0 and exported.diffuse_transmission is not None:
            passed = exported.diffuse_transmission
            through: dict[str, Any] = {"diffuseTransmissionFactor": share}
            through["diffuseTransmissionColorFactor"] = self._below_one(scale_color(passed.value, 1.0 / share))
            if passed.texture >= 0:
                through["diffuseTransmissionColorTexture"] = self._picture(passed.texture, color=True)
            extensions["KHR_materials_diffuse_transmission"] = through
        if exported.transmission > 0:
            extensions["KHR_materials_transmission"] = {"transmissionFactor": exported.transmission}
        if exported.transmission > 0 or exported.medium is not None:
            extensions |= self._volume(exported)
        if s.coat.value[0] > 0:
            coat: dict[str, Any] = {"clearcoatFactor": s.coat.value[0], "clearcoatRoughnessFactor": s.coat_roughness.value[0]}
            for name, slot in (("clearcoatTexture", s.coat), ("clearcoatRoughnessTexture", s.coat_roughness)):
                if slot.texture >= 0:
                    coat[name] = self._picture(slot.texture)
            normal = s.normal if s.coat_normal is None else s.coat_normal  # in glTF a coat without one is smooth
            if normal is not None and normal.texture >= 0:
                coat["clearcoatNormalTexture"] = {**self._picture(normal.texture, levels=True), "scale": normal.value[0]}
            extensions["KHR_materials_clearcoat"] = coat
        if any(s.sheen.value):
            sheen: dict[str, Any] = {"sheenColorFactor": list(s.sheen.value), "sheenRoughnessFactor": s.sheen_roughness.value[0]}
            if s.sheen.texture >= 0:
                sheen["sheenColorTexture"] = self._picture(s.sheen.texture, color=True)
            if s.sheen_roughness.texture >= 0:
                sheen["sheenRoughnessTexture"] = self._in_alpha(s.sheen_roughness.texture)
            extensions["KHR_materials_sheen"] = sheen
        return extensions

    @staticmethod
    def _volume(exported: Exported) -> dict[str, Any]:
        """What glass and a medium absorb together, and what the medium scatters."""
        inside = exported.medium or MediumData()
        r, g, b = (a + c for a, c in zip(inside.absorption, exported.absorption, strict=True))
        inside = replace(inside, absorption=(r, g, b))
        extinction, volume = scattering_albedo.extinction(inside), dict[str, Any](thicknessFactor=1.0)
        if (most := max(extinction)) > 0:
            volume |= {"attenuationDistance": 1.0 / most, "attenuationColor": [math.exp(-a / most) for a in extinction]}
        if max(inside.scattering) <= 0:
            return {"KHR_materials_volume": volume}
        color = scattering_albedo.multiple_from_single(scattering_albedo.albedo(inside), inside.anisotropy)
        scatter = {"multiscatterColor": list(color), "scatterAnisotropy": inside.anisotropy}
        return {"KHR_materials_volume": volume, "KHR_materials_volume_scatter": scatter}

    def _below_one(self, color: tuple[float, ...]) -> list[float]:
        if max(color) > 1.0 + 1e-9:
            self.out.cannot(losses.TOO_BRIGHT)
        return [min(max(c, 0.0), 1.0) for c in color]

    # --- pictures ---

    def _base(self, diffuse: Input, opacity: int) -> dict[str, Any] | None:
        """The reference of a base colour, with the picture of its opacity as alpha."""
        row = diffuse.texture
        if row < 0:
            return None
        alpha = None
        if opacity >= 0:
            alpha = self._sets.pixels(opacity)[..., 0]
            if alpha.shape != self._sets.pixels(row).shape[:2] or self._place(opacity) != self._place(row):
                self.out.cannot("an opacity that lies differently from the colour's picture is not carried", "textures", opacity)
                alpha = None
        return self._reference(row, self._png(self._sets.pixels(row), color=True, alpha=alpha))

    def _in_alpha(self, row: int) -> dict[str, Any]:
        """The reference of a picture of numbers in alpha."""
        alpha = self._sets.pixels(row)[..., 0]
        return self._reference(row, self._png(np.ones((*alpha.shape, 3), np.float32), alpha=alpha))

    def _packed(self, metallic: int, roughness: int) -> dict[str, Any] | None:
        """The reference of a picture of roughness in green and of metallic in blue."""
        row = max(metallic, roughness)
        if row < 0:
            return None
        blue, green = (None if k < 0 else self._sets.pixels(k)[..., 0] for k in (metallic, roughness))
        if blue is not None and green is not None and (blue.shape != green.shape or self._place(metallic) != self._place(roughness)):
            self.out.cannot("a metallic picture that lies differently from the roughness picture is not carried", "textures", metallic)
            row, blue = roughness, None
        shape = (green if green is not None else blue).shape  # type: ignore[union-attr]
        parts = [np.ones(shape, np.float32) if part is None else part for part in (None, green, blue)]
        return self._reference(row, self._png(np.stack(parts, axis=-1)))

    def _picture(self, row: int, color: bool = False, levels: bool = False) -> dict[str, Any]:
        pixels = self._sets.pixels(row)
        return self._reference(row, self._png(0.5 * pixels + 0.5 if levels else pixels, color=color))

    def _place(self, row: int) -> tuple[Any, ...]:
        """Frame, wrap modes and filter of a texture: equal for textures that can share one picture."""
        textures = self.tables.textures
        return textures.frame[row].tobytes(), int(textures.wrap_u[row]), int(textures.wrap_v[row]), bool(textures.nearest[row])

    def _reference(self, row: int, png: bytes) -> dict[str, Any]:
        textures, cells = self.tables.textures, self._sets.has_cells(row)
        wraps = [ir.Wrap(int(wrap[row])) for wrap in (textures.wrap_u, textures.wrap_v)]
        if not cells and any(wrap not in _WRAPS for wrap in wraps):
            self.out.cannot("a texture that ends in black is not carried", "textures", row)
        nearest = cells or bool(textures.nearest[row])
        filters = {"magFilter": _NEAREST if nearest else _LINEAR, "minFilter": _NEAREST if nearest else _MIPS}
        modes = [10497, 10497] if cells else [_WRAPS.get(wrap, 33071) for wrap in wraps]
        sampler = self.container.shared("samplers", {**filters, "wrapS": modes[0], "wrapT": modes[1]})
        image = self._image(png)
        number = self._sets.add(row)
        texture = self.container.shared("textures", {"sampler": sampler, "source": image})
        return {"index": texture, "texCoord": number} if number else {"index": texture}

    def _image(self, png: bytes) -> int:
        if png not in self._images:
            self._images[png] = self.container.add("images", {"bufferView": self.container.view(png), "mimeType": "image/png"})
        return self._images[png]
