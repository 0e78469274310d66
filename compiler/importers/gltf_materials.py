"""Converts glTF 2.0 materials and textures to `principled`, glass and emissive materials.

Format: glTF 2.0 §3.9 and the ratified KHR_materials_… extensions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ...lang.diagnostics import Span
from .. import ir
from ..io.sandbox import FileError
from ..scene import metallic_roughness, partial_coverage, scattering_albedo
from ..scene.builder import NONE, SceneBuilder
from ..scene.row_records import BLACK, WHITE, Color, Input, MaterialData, MediumData, TextureData, as_color, scale_color
from . import images
from .common import uv_sets, vertex_numbers
from .gltf_container import Container, Warn, check_finite
from .gltf_errors import GltfError
from .khronos import ktx2, slabs

_WRAPS = {33071: ir.Wrap.CLAMP, 33648: ir.Wrap.MIRROR, 10497: ir.Wrap.REPEAT}
_DATA = -2  # all channels of an image, as data
_LEAST_CUTOFF = 1e-9  # least alphaCutoff: a mask with cutoff 0 is opaque everywhere
_COLORS = ("baseColorTexture", "diffuseTexture")
_NOT_READ = ("thicknessTexture",)  # a shape has its own thickness
_EVEN = 0.1  # difference of a colour's components that is not a tint
_SCATTER = "KHR_materials_volume_scatter"
_MOST_ANISOTROPY = 0.99
_MOST_DISPERSION = 4.0  # an Abbe number of 5
_GLASS_TRANSMISSION = 0.5  # transmission from which a tinted material without a volume becomes glass


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """How a part of a mesh uses its material."""

    maps: dict[int, np.ndarray | None] = field(default_factory=dict)  # (3, 3) from the part's coordinates to another set; None: unknown
    alpha: float = 1.0  # factor of the opacity
    ramp: bool = False  # whether u is a factor of the opacity


@dataclass(slots=True)
class Materials:
    """The material rows of a file, created on first use."""

    container: Container
    name: str
    builder: SceneBuilder
    warn: Warn
    _rows: dict[Any, int] = field(default_factory=dict)
    _fit: Fit = field(default_factory=lambda: Fit())  # of the row that is being made
    _read: list[dict[str, Any]] = field(default_factory=list)  # its references to textures that were read

    def row(self, index: int, fit: Fit | None = None) -> int:
        """The builder's row of a material for a part."""
        self._fit = fit or Fit()
        key = (index, self._fit.alpha, self._fit.ramp, *((k, m if m is None else m.tobytes()) for k, m in self._fit.maps.items()))
        if key not in self._rows:
            written = self.container.document["materials"][index]
            check_finite(written)
            self._read = []
            self._rows[key] = self.builder.material(self._material(written), Span(self.name))
            self._report_unread(written)
        return self._rows[key]

    def _report_unread(self, written: dict[str, Any]) -> None:
        """Warn of pictures that the kind of a material leaves out. Those of KHR_materials_unlit but its colour count nowhere."""
        extensions, replaced = written.get("extensions", {}), {}
        if "KHR_materials_unlit" in extensions:
            return
        if "KHR_materials_pbrSpecularGlossiness" in extensions and not self._is_glass(written):
            replaced = written.get("pbrMetallicRoughness", {})
        kind = "solid glass" if self._is_glass(written) else "such a surface"
        for name, reference in _references(written):
            if not any(reference is each for each in self._read) and name not in (*_NOT_READ, *replaced):
                self.warn(f"the {name} of {kind} is not drawn")

    def uv_sets(self, index: int) -> list[int]:
        """The sets of texture coordinates that a material's pictures read: that of its base colour, if any, first; occlusion last."""
        references = _references(self.container.document["materials"][index])
        references.sort(key=lambda item: (item[0] not in _COLORS, item[0] == "occlusionTexture"))
        return list(dict.fromkeys(_uv_set(reference) for _, reference in references))

    def is_see_through(self, index: int) -> bool:
        """Whether alpha counts: the material's mode is BLEND or MASK."""
        return self.container.document["materials"][index].get("alphaMode", "OPAQUE") in ("BLEND", "MASK")

    def has_normal_map(self, index: int) -> bool:
        written = self.container.document["materials"][index]
        return "normalTexture" in written or "clearcoatNormalTexture" in written.get("extensions", {}).get("KHR_materials_clearcoat", {})

    def is_double_sided(self, index: int) -> bool:
        """Whether a surface is seen from behind: it says so, or it is the boundary of a volume, of which both sides count."""
        written = self.container.document["materials"][index]
        scatters = _SCATTER in written.get("extensions", {})
        return written.get("doubleSided") is True or self._is_glass(written) or scatters

    def _is_glass(self, written: dict[str, Any]) -> bool:
        """Whether a material is drawn as solid glass: it has a volume, or a tint and no picture of what passes."""
        extensions, pbr = written.get("extensions", {}), written.get("pbrMetallicRoughness", {})
        share = slabs.share_of(extensions)
        if "KHR_materials_unlit" in extensions or share == 0.0:
            return False
        tinted = share >= _GLASS_TRANSMISSION and "transmissionTexture" not in slabs.transmission(extensions) and _is_colored(pbr)
        return tinted or bool(extensions.get("KHR_materials_volume", {}).get("thicknessFactor"))

    def _material(self, written: dict[str, Any]) -> MaterialData:
        extensions = written.get("extensions", {})
        pbr = written.get("pbrMetallicRoughness", {})
        color, picture = pbr.get("baseColorFactor", (1.0, 1.0, 1.0, 1.0)), self._texture(pbr.get("baseColorTexture"))
        base = Input((color[0], color[1], color[2]), picture)
        title = written.get("name", "")
        if "KHR_materials_unlit" in extensions:
            inputs = {ir.Slot.DIFFUSE: Input(BLACK), ir.Slot.EMISSION: base}
            return partial_coverage.with_opacity(MaterialData(inputs=inputs, name=title), *self._opacity(written, base, float(color[3])))
        if self._is_glass(written):
            return self._glass(written, base, float(color[3]))
        if "KHR_materials_dispersion" in extensions:
            self.warn("KHR_materials_dispersion counts in solid glass alone: with KHR_materials_transmission and KHR_materials_volume")
        if "KHR_materials_pbrSpecularGlossiness" in extensions:
            surface = self._specular_glossiness(written, extensions["KHR_materials_pbrSpecularGlossiness"])
        else:
            surface = self._surface(written, base, float(color[3]), extensions)
        if (share := slabs.share_of(extensions)) > 0.0 and not self._is_of_slabs(written):
            if _is_colored(pbr):
                self.warn("light passes thin smooth surfaces white: without the colour of KHR_materials_transmission")
            if "KHR_materials_pbrSpecularGlossiness" in extensions:
                self.warn("light passes a surface with KHR_materials_pbrSpecularGlossiness straight and white")
            metallic = surface.metallic.value[0] if surface.metallic.texture == NONE else 0.0  # metals transmit nothing
            surface = replace(surface, transmission=share * (1.0 - min(max(metallic, 0.0), 1.0)))
        return self._scattering_through(surface, written)

    def _glass(self, written: dict[str, Any], base: Input, alpha: float) -> MaterialData:
        """Solid glass, around the medium of its volume."""
        extensions, pbr = written.get("extensions", {}), written.get("pbrMetallicRoughness", {})
        if extensions.get("KHR_materials_diffuse_transmission", {}).get("diffuseTransmissionFactor"):
            self.warn("KHR_materials_diffuse_transmission of solid glass is not drawn")
        if slabs.are_needed_in_glass(written):
            return self._lobed_glass(written, base, alpha)
        ior = float(extensions.get("KHR_materials_ior", {}).get("ior", 1.5))
        rough = Input.number(float(pbr.get("roughnessFactor", 1.0)), self._texture(pbr.get("metallicRoughnessTexture"), 1))
        inputs = {ir.Slot.TRANSMISSION: base, ir.Slot.IOR: Input.number(max(ior, 1.0)), ir.Slot.ROUGHNESS: rough}
        if (normal := self._normal(written.get("normalTexture"))) is not None:
            inputs[ir.Slot.NORMAL] = normal
        if (dispersion := float(extensions.get("KHR_materials_dispersion", {}).get("dispersion", 0.0))) > 0.0:
            inputs[ir.Slot.DISPERSION] = Input.number(min(dispersion, _MOST_DISPERSION))
        medium = self._medium(extensions)
        absorbed = self._absorption(extensions) if medium == NONE else {}
        glass = MaterialData(ir.MaterialModel.GLASS, inputs | absorbed, name=written.get("name", ""), medium=medium)
        return partial_coverage.with_opacity(glass, *self._opacity(written, base, alpha))

    def _lobed_glass(self, written: dict[str, Any], base: Input, alpha: float) -> MaterialData:
        """Solid glass as slabs."""
        extensions = written["extensions"]
        if extensions.get("KHR_materials_dispersion", {}).get("dispersion"):
            self.warn("KHR_materials_dispersion of glass that is drawn as OpenPBR is not drawn: its boundary has other lobes")
        medium, absorbed = self._medium(extensions), _attenuation(extensions)
        if medium == NONE and absorbed is not None:
            medium = self.builder.medium(MediumData(absorption=absorbed), Span(self.name))
        slabs_of_file = slabs.Slabs(self.builder, self._picture, self.warn, self.name)
        return slabs_of_file.glass(self._surface(written, base, alpha, extensions), written, medium)

    def _reflecting(self, surface: metallic_roughness.Surface, written: dict[str, Any]) -> MaterialData:
        """What a surface reflects: slabs of OpenPBR, else `principled`."""
        extensions = written.get("extensions", {})
        if self._is_of_slabs(written):
            return slabs.Slabs(self.builder, self._picture, self.warn, self.name).material(surface, written)
        if slabs.are_used(extensions):
            self.warn("the anisotropy and iridescence of a surface with KHR_materials_pbrSpecularGlossiness are not drawn")
        if slabs.has_own_coat(written):
            self.warn("the coat of a surface with KHR_materials_pbrSpecularGlossiness has the normals of its base")
        return metallic_roughness.material(surface)

    @staticmethod
    def _is_of_slabs(written: dict[str, Any]) -> bool:
        """Whether a surface is drawn as slabs: it needs them, and has no colour of its highlight instead of an index."""
        return slabs.are_needed(written) and "KHR_materials_pbrSpecularGlossiness" not in written.get("extensions", {})

    def _scattering_through(self, surface: metallic_roughness.Surface, written: dict[str, Any]) -> MaterialData:
        """A surface that passes a share of the diffuse light on, by KHR_materials_diffuse_transmission.

        Where all light enters it is `subsurface`. Else it is `translucent` without a highlight. With one it is blended with a sheet that
        reflects nothing.
        """
        extensions = written.get("extensions", {})
        extension, medium = extensions.get("KHR_materials_diffuse_transmission", {}), self._medium(extensions)
        weight = self._texture(extension.get("diffuseTransmissionTexture"), 3)
        share = min(max(float(extension.get("diffuseTransmissionFactor", 0.0)), 0.0), 1.0)
        if share == 0.0:
            if medium != NONE:
                self.warn("KHR_materials_volume_scatter counts where light passes: with KHR_materials_transmission from one half on,"
                          " or KHR_materials_diffuse_transmission")  # fmt: skip
            return self._reflecting(surface, written)
        color = as_color(extension.get("diffuseTransmissionColorFactor", WHITE))
        passed = Input(color, self._texture(extension.get("diffuseTransmissionColorTexture")))
        body = medium != NONE and share == 1.0
        plain = (surface.ior.value[0] == 1.0 or body) and surface.specular is None and surface.metallic.value[0] == 0.0
        plain = plain and surface.coat.value[0] == 0.0 and surface.sheen.value == BLACK and weight == NONE
        plain = plain and not self._is_of_slabs(written)
        reflected = replace(surface.diffuse, value=scale_color(surface.diffuse.value, 1.0 - share)) if plain else Input(BLACK)
        inputs = {
            ir.Slot.AMBIENT: reflected, ir.Slot.DIFFUSE: reflected,
            ir.Slot.DIFFUSE_TRANSMISSION: replace(passed, value=scale_color(color, share)) if plain else passed,
        }  # fmt: skip
        maps = {slot: map_ for slot, map_ in ((ir.Slot.NORMAL, surface.normal), (ir.Slot.EMISSION, surface.emissive)) if map_ is not None}
        opacity = surface.opacity, surface.threshold
        model = ir.MaterialModel.TRANSLUCENT
        if plain and body:
            model = ir.MaterialModel.SUBSURFACE
            inputs[ir.Slot.AMBIENT] = Input(as_color(extensions[_SCATTER].get("multiscatterColor", BLACK)))
            inputs |= {ir.Slot.RADIUS: Input.number(1.0), ir.Slot.IOR: surface.ior, ir.Slot.ROUGHNESS: surface.roughness}
        if plain:
            if surface.occlusion.texture != NONE:
                self.warn("the occlusionTexture of a sheet without a highlight is not drawn: light from all sides reaches it")
            return partial_coverage.with_opacity(MaterialData(model, inputs | maps, name=surface.name, medium=medium), *opacity)
        sheet = MaterialData(model, inputs | maps, name=f"{surface.name} through", medium=medium)
        opaque = self._reflecting(replace(surface, opacity=metallic_roughness.ALL, threshold=0.0), written)
        parts = self.builder.material(opaque, Span(self.name)), self.builder.material(sheet, Span(self.name))
        mix = MaterialData(
            ir.MaterialModel.BLEND, {ir.Slot.WEIGHT: Input.number(share, weight)}, first=parts[0], second=parts[1], name=surface.name,
            medium=medium,
        )  # fmt: skip
        return partial_coverage.with_opacity(mix, *opacity)

    def _opacity(self, written: dict[str, Any], base: Input, alpha: float) -> tuple[Input, float]:
        """(opacity of a surface, below 1 with the modes BLEND and MASK; its threshold, 0 for none)."""
        mode = written.get("alphaMode", "OPAQUE")
        alpha *= self._fit.alpha
        through = vertex_numbers.texture(self.builder, Span(self.name)) if self._fit.ramp else self.builder.alpha_of(base.texture)
        if mode == "OPAQUE" or (alpha >= 1.0 and through == NONE):
            return partial_coverage.OPAQUE, 0.0
        return Input.number(alpha, through), max(float(written.get("alphaCutoff", 0.5)), _LEAST_CUTOFF) if mode == "MASK" else 0.0

    def _absorption(self, extensions: dict[str, Any]) -> dict[ir.Slot, Input]:
        """What the glass of KHR_materials_volume absorbs."""
        absorbed = _attenuation(extensions)
        return {} if absorbed is None else {ir.Slot.ABSORPTION: Input(absorbed)}

    def _medium(self, extensions: dict[str, Any]) -> int:
        """The row of the medium of KHR_materials_volume_scatter; NONE without one, or where nothing scatters."""
        scatter, extinction = extensions.get(_SCATTER, {}), _attenuation(extensions)
        color = as_color(scatter.get("multiscatterColor", BLACK))
        if extinction is None or max(color) <= 0.0:
            return NONE
        anisotropy = min(max(float(scatter.get("scatterAnisotropy", 0.0)), -_MOST_ANISOTROPY), _MOST_ANISOTROPY)
        single = scattering_albedo.single_from_multiple(color, anisotropy)
        return self.builder.medium(scattering_albedo.by_extinction(extinction, single, anisotropy), Span(self.name))

    def _specular_glossiness(self, written: dict[str, Any], extension: dict[str, Any]) -> metallic_roughness.Surface:
        """KHR_materials_pbrSpecularGlossiness: a diffuse colour, a reflectance along the normal, and 1 − roughness in its alpha."""
        color, gloss = extension.get("diffuseFactor", (1.0, 1.0, 1.0, 1.0)), float(extension.get("glossinessFactor", 1.0))
        r, g, b = extension.get("specularFactor", (1.0, 1.0, 1.0))
        diffuse = Input((color[0], color[1], color[2]), self._texture(extension.get("diffuseTexture")))
        packed = extension.get("specularGlossinessTexture")
        alpha = self._texture(packed, 3)
        rough = Input.number(1.0 - gloss)
        if alpha != NONE:
            rough = Input.number(1.0, self.builder.with_levels(alpha, scale_color(WHITE, -gloss), WHITE))
        plain = self._surface({**written, "pbrMetallicRoughness": {"baseColorFactor": color}}, diffuse, float(color[3]), {})
        return replace(plain, specular=Input((r, g, b), self._texture(packed)), roughness=rough)

    def _ior(self, extensions: dict[str, Any]) -> float:
        """The index of refraction of the reflectance along the normal, times the mean factor of KHR_materials_specular."""
        ior = float(extensions.get("KHR_materials_ior", {}).get("ior", 1.5))
        specular = extensions.get("KHR_materials_specular", {})
        color = specular.get("specularColorFactor", (1.0, 1.0, 1.0))
        share = float(specular.get("specularFactor", 1.0)) * float(np.mean(color))
        if _is_tinted(specular):
            self.warn("the colour and the pictures of KHR_materials_specular are drawn as the mean of its factors where metallic is not 0")
        if share == 1.0:
            return ior
        root = math.sqrt(min(((ior - 1) / (ior + 1)) ** 2 * share, 0.9))
        return (1 + root) / (1 - root)

    def _specular(self, extensions: dict[str, Any]) -> Input:
        """The reflectance along the normal of KHR_materials_specular on a surface that is not a metal."""
        ior = float(extensions.get("KHR_materials_ior", {}).get("ior", 1.5))
        specular = extensions["KHR_materials_specular"]
        share = ((ior - 1) / (ior + 1)) ** 2 * float(specular.get("specularFactor", 1.0))
        tint, weight = self._texture(specular.get("specularColorTexture")), specular.get("specularTexture")
        r, g, b = (min(share * float(c), 1.0) for c in specular.get("specularColorFactor", (1.0, 1.0, 1.0)))
        return Input((r, g, b), tint if tint != NONE else self._texture(weight, 3))

    def _surface(self, written: dict[str, Any], base: Input, alpha: float, extensions: dict[str, Any]) -> metallic_roughness.Surface:
        """Base colour, metallic, roughness, emission and, for BLEND and MASK, opacity (§3.9)."""
        pbr = written.get("pbrMetallicRoughness", {})
        packed, (opacity, threshold) = pbr.get("metallicRoughnessTexture"), self._opacity(written, base, alpha)
        strength = float(extensions.get("KHR_materials_emissive_strength", {}).get("emissiveStrength", 1.0))
        r, g, b = written.get("emissiveFactor", (0.0, 0.0, 0.0))
        coat, sheen = (extensions.get(f"KHR_materials_{name}", {}) for name in ("clearcoat", "sheen"))
        metallic = float(pbr.get("metallicFactor", 1.0))
        tinted = metallic == 0.0 and _is_tinted(extensions.get("KHR_materials_specular", {}))
        return metallic_roughness.Surface(
            base,
            Input.number(metallic, self._texture(packed, 2)),
            Input.number(float(pbr.get("roughnessFactor", 1.0)), self._texture(packed, 1)),
            metallic_roughness.GLASS if tinted else Input.number(self._ior(extensions)),
            specular=self._specular(extensions) if tinted else None,
            emissive=Input(scale_color((r, g, b), strength), self._texture(written.get("emissiveTexture"))),
            coat=Input.number(float(coat.get("clearcoatFactor", 0.0)), self._texture(coat.get("clearcoatTexture"), 0)),
            coat_roughness=Input.number(
                float(coat.get("clearcoatRoughnessFactor", 0.0)), self._texture(coat.get("clearcoatRoughnessTexture"), 1)
            ),
            sheen=Input(as_color(sheen.get("sheenColorFactor", BLACK)), self._texture(sheen.get("sheenColorTexture"))),
            sheen_roughness=Input.number(
                float(sheen.get("sheenRoughnessFactor", 0.0)), self._texture(sheen.get("sheenRoughnessTexture"), 3)
            ),
            occlusion=self._occlusion(written.get("occlusionTexture")),
            normal=self._normal(written.get("normalTexture")),
            coat_normal=self._normal(coat.get("clearcoatNormalTexture")), opacity=opacity,
            threshold=threshold, name=written.get("name", ""),
        )  # fmt: skip

    def _occlusion(self, reference: dict[str, Any] | None) -> Input:
        """The occlusion picture with its strength: 1 + strength · (texel − 1)."""
        row = self._texture(reference, 0)
        strength = 1.0 if reference is None else float(reference.get("strength", 1.0))
        if row != NONE and strength != 1.0:
            row = self.builder.with_levels(row, scale_color(WHITE, strength), scale_color(WHITE, 1.0 - strength))
        return Input.number(1.0, row)

    def _normal(self, reference: dict[str, Any] | None) -> Input | None:
        """A normal map with its strength, or None."""
        row = self._texture(reference, _DATA)
        if reference is None or row == NONE:
            return None
        strength = float(reference.get("scale", 1.0))
        return Input((strength, strength, 1.0), self.builder.with_levels(row, (2.0, 2.0, 2.0), (-1.0, -1.0, -1.0)))

    def _texture(self, reference: dict[str, Any] | None, channel: int = -1) -> int:
        """The texture row of a texture reference: a colour, one `channel`, or all channels as _DATA."""
        data = self._picture(reference, channel)
        return NONE if data is None else self.builder.texture(data, Span(self.name))

    def _picture(self, reference: dict[str, Any] | None, channel: int = -1) -> TextureData | None:
        """A texture reference as columns of ir.Textures; None without one, or if it cannot be read."""
        if reference is None:
            return None
        self._read.append(reference)
        map_ = self._fit.maps.get(_uv_set(reference), uv_sets.PLAIN)
        if map_ is None:
            reason = f"more than {uv_sets.MOST_PARTS} affine maps lead to it from the set of the first picture"
            self.warn(f"pictures with TEXCOORD_{_uv_set(reference)} are left out: {reason}")
            return None
        try:
            texture = self.container.document["textures"][reference["index"]]
            sampler = self.container.document["samplers"][texture["sampler"]] if "sampler" in texture else {}
            image = self._image(texture, color=channel == -1)
        except (KeyError, IndexError, TypeError, AttributeError):
            self.warn(f"texture {reference['index']}, its sampler or its image does not exist: it is left out")
            return None
        if image == NONE:
            return None
        wrap_u, wrap_v = (_WRAPS.get(sampler.get(k, 10497), ir.Wrap.REPEAT) for k in ("wrapS", "wrapT"))
        return TextureData(
            ir.TextureKind.IMAGE, image, wrap_u=wrap_u, wrap_v=wrap_v, nearest=sampler.get("magFilter") == 9728,
            channel=max(channel, -1), frame=_frame(_transform(reference), map_),
        )  # fmt: skip

    def _source(self, texture: dict[str, Any]) -> int | None:
        """The number of a texture's image: that in KTX 2 where it can be read, else that of the texture itself, else WebP."""
        packed, plain = texture.get("extensions", {}).get("KHR_texture_basisu", {}).get("source"), texture.get("source")
        if packed is not None and plain is not None and (reason := ktx2.missing()):
            self.warn(f"the pictures beside those in KTX 2 are drawn: {reason}")
            packed = None
        webp = texture.get("extensions", {}).get("EXT_texture_webp", {}).get("source")
        return next((number for number in (packed, plain, webp) if number is not None), None)

    def _image(self, texture: dict[str, Any], color: bool) -> int:
        """The row of a texture's image; NONE and a warning if it cannot be read."""
        source = self._source(texture)
        if source is None:
            names = sorted(texture.get("extensions", {})) or ["nothing"]
            self.warn(f"a texture is not drawn: its picture is given by {', '.join(names)} alone")
            return NONE
        picture = self.container.document["images"][source]
        try:
            data = self.container.view_bytes(picture["bufferView"]) if "bufferView" in picture else None
            data = self.container.bytes_at(picture["uri"], "picture") if data is None else data
            return images.row_from_bytes(self.builder, data, f"{self.name}[{source}]", color=color, span=Span(self.name))
        except (images.ImageError, FileError) as failure:
            self.builder.diagnostics.warning(failure.message, Span(self.name), failure.hint)
        except GltfError as failure:
            self.warn(str(failure))
        return NONE


def _attenuation(extensions: dict[str, Any]) -> Color | None:
    """KHR_materials_volume: light of `attenuationColor` is left after `attenuationDistance` (Beer and Lambert). Per metre; None without."""
    volume = extensions.get("KHR_materials_volume", {})
    distance = float(volume.get("attenuationDistance", math.inf))
    if not volume.get("thicknessFactor") or not 0 < distance < math.inf:
        return None
    r, g, b = (-math.log(min(max(float(c), 1e-6), 1.0)) / distance for c in volume.get("attenuationColor", (1.0, 1.0, 1.0)))
    return (r, g, b)


def _is_colored(pbr: dict[str, Any]) -> bool:
    """Whether a base colour has a picture or a tint."""
    return "baseColorTexture" in pbr or bool(np.ptp(pbr.get("baseColorFactor", (1.0, 1.0, 1.0, 1.0))[:3]) > _EVEN)


def _is_tinted(specular: dict[str, Any]) -> bool:
    """Whether KHR_materials_specular has a colour or a picture."""
    return bool(np.ptp(specular.get("specularColorFactor", (1.0, 1.0, 1.0))) > 0) or any(key.endswith("Texture") for key in specular)


def _references(material: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    """(name, texture reference) of the pictures of a material and its extensions."""
    textures = []
    for key, value in material.items():
        if isinstance(value, dict):
            textures += [(key, value)] if key.endswith("Texture") and "index" in value else _references(value)
    return textures


def _transform(reference: dict[str, Any]) -> dict[str, Any]:
    return reference.get("extensions", {}).get("KHR_texture_transform", {})


def _uv_set(reference: dict[str, Any]) -> int:
    """The texture coordinate set; KHR_texture_transform's texCoord overrides the reference's own."""
    return int(_transform(reference).get("texCoord", reference.get("texCoord", 0)))


def _frame(moved: dict[str, Any], map_: np.ndarray) -> Any:
    """KHR_texture_transform, uv' = T · R · S · uv with v down, as a frame for v up, after the map (3, 3) to the picture's set."""
    (ox, oy), angle, (sx, sy) = moved.get("offset", (0.0, 0.0)), moved.get("rotation", 0.0), moved.get("scale", (1.0, 1.0))
    c, s = float(np.cos(angle)), float(np.sin(angle))
    down = np.array([[c * sx, s * sy, ox], [-s * sx, c * sy, oy], [0, 0, 1]])
    turn = np.array([[1.0, 0, 0], [0, -1, 1], [0, 0, 1]])
    up = turn @ down @ turn @ map_
    return tuple(map(tuple, (up[:2] + 0.0).tolist()))
