"""Converts glTF materials to OpenPBR's slabs, where `principled` and `glass` lack what their extensions add.

That is anisotropy, iridescence, a normal of the coat that is not that of the base, two pictures of KHR_materials_specular, a picture or
the roughness of light that passes, and what lies on or in solid glass: a coat, sheen, emission, a highlight that is not the index's, a
share that light does not pass.

With the roughness r of glTF, α = r², and the strength s of the anisotropy, α along its direction is α + (1 − α) s², and across it α.
OpenPBR has one roughness R and an anisotropy a: its α are R² √(2 / (1 + (1 − a)²)), and that times 1 − a. Both pairs are made equal.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from ....lang.diagnostics import Span
from ....materials import openpbr
from ... import ir
from ...formula.opcodes import Op
from ...scene import partial_coverage
from ...scene.builder import NONE, SceneBuilder
from ...scene.metallic_roughness import NOTHING, Surface
from ...scene.row_records import BLACK, WHITE, Input, MaterialData, TextureData, as_color, scale_color
from ...texture_graph.graph_builder import GraphBuilder
from ...texture_graph.opcodes import U, V

Slot = ir.Slot
NAMES = "KHR_materials_anisotropy", "KHR_materials_iridescence"
COAT_IOR = 1.5  # of KHR_materials_clearcoat, which darkens no base
LEAST_ALPHA = 1e-6
_NANOMETRES = 1e-3  # micrometres
_SMOOTH = 0.1  # roughness up to which light passes thin surfaces straight
_ALL = 0.95  # share of the light that passes from which all of it does
_TRANSMISSIONS = "KHR_materials_transmission", "ADOBE_materials_thin_transparency"
Picture = Callable[[Any, int], TextureData | None]  # of a reference and a channel


def are_used(extensions: dict[str, Any]) -> bool:
    """Whether a material has one of these lobes."""
    strength = extensions.get(NAMES[0], {}).get("anisotropyStrength", 0.0)
    return bool(strength or extensions.get(NAMES[1], {}).get("iridescenceFactor", 0.0))


def transmission(extensions: dict[str, Any]) -> dict[str, Any]:
    """KHR_materials_transmission, or the extension that it was made from; empty without either."""
    return next((extensions[name] for name in _TRANSMISSIONS if name in extensions), {})


def share_of(extensions: dict[str, Any]) -> float:
    """The factor of the light that passes, 0 to 1."""
    return min(max(float(transmission(extensions).get("transmissionFactor", 0.0)), 0.0), 1.0)


def are_needed(written: dict[str, Any]) -> bool:
    """Whether a surface is drawn as slabs."""
    extensions = written.get("extensions", {})
    if are_used(extensions):
        return True
    if has_own_coat(written):
        return True
    if share_of(extensions) > 0.0:
        rough = float(written.get("pbrMetallicRoughness", {}).get("roughnessFactor", 1.0))
        return rough > _SMOOTH or "transmissionTexture" in transmission(extensions) or written.get("alphaMode") == "MASK"
    specular = extensions.get("KHR_materials_specular", {})
    return "specularTexture" in specular and "specularColorTexture" in specular and not _is_metal(written)


def has_own_coat(written: dict[str, Any]) -> bool:
    """Whether a coat has another normal than its base. Without a normal map it is smooth over a base that has one."""
    coat = written.get("extensions", {}).get("KHR_materials_clearcoat", {})
    return bool(coat.get("clearcoatFactor")) and coat.get("clearcoatNormalTexture") != written.get("normalTexture")


def are_needed_in_glass(written: dict[str, Any]) -> bool:
    """Whether solid glass is drawn as slabs: it has more than a boundary and an inside."""
    extensions = written.get("extensions", {})
    lobes = (
        share_of(extensions) < _ALL and "KHR_materials_volume" in extensions, "transmissionTexture" in transmission(extensions),
        any(written.get("emissiveFactor", BLACK)),
        extensions.get("KHR_materials_clearcoat", {}).get("clearcoatFactor"),
        any(extensions.get("KHR_materials_sheen", {}).get("sheenColorFactor", BLACK)),
        extensions.get("KHR_materials_specular"),
    )  # fmt: skip
    return are_used(extensions) or any(map(bool, lobes))


def _is_metal(written: dict[str, Any]) -> bool:
    return float(written.get("pbrMetallicRoughness", {}).get("metallicFactor", 1.0)) != 0.0


def roughness_of(rough: float, strength: float) -> tuple[float, float]:
    """OpenPBR's roughness and anisotropy of those of glTF."""
    across = max(min(max(rough, 0.0), 1.0) ** 2, LEAST_ALPHA)
    along = across + (1.0 - across) * min(max(strength, 0.0), 1.0) ** 2
    share = across / along
    return math.sqrt(along * math.sqrt(0.5 * (1.0 + share * share))), 1.0 - share


class Slabs:
    """Makes materials of a file."""

    def __init__(self, builder: SceneBuilder, picture: Picture, warn: Callable[[str], None], name: str) -> None:
        self._builder, self._picture, self._warn, self._name = builder, picture, warn, name

    def material(self, surface: Surface, written: dict[str, Any]) -> MaterialData:
        """The material of a metallic–roughness surface with the lobes that its extensions add; where light passes it, a thin wall."""
        inputs = self._given(surface, written)
        if share_of(written.get("extensions", {})) > 0.0:
            inputs |= {**self._passing(surface, written, 1.0), Slot.THIN_WALLED: Input.number(1.0)}
        return partial_coverage.with_opacity(openpbr.data(inputs, name=surface.name), surface.opacity, surface.threshold)

    def glass(self, surface: Surface, written: dict[str, Any], medium: int) -> MaterialData:
        """The material of solid glass with these lobes, around a medium."""
        inputs = self._given(replace(surface, metallic=NOTHING), written)
        row = openpbr.simplified(openpbr.data(inputs | self._passing(surface, written, _ALL), name=surface.name, medium=medium))
        return partial_coverage.with_opacity(row, surface.opacity, surface.threshold)

    def _passing(self, surface: Surface, written: dict[str, Any], all_from: float) -> dict[Slot, Input]:
        """What light passes; a factor from `all_from` on, without a picture, is 1."""
        extensions = written["extensions"]
        share, picture = share_of(extensions), self._row(transmission(extensions).get("transmissionTexture"), 0)
        share = 1.0 if picture == NONE and share >= all_from else share
        return {Slot.TRANSMISSION_WEIGHT: Input.number(share, picture), Slot.TRANSMISSION_COLOR: surface.diffuse}

    def _given(self, surface: Surface, written: dict[str, Any]) -> dict[Slot, Input]:
        s, extensions = surface, written.get("extensions", {})
        weight, tint, ior = self._highlight(s, extensions)
        if ior.texture == NONE and s.coat.texture == NONE and not share_of(extensions):
            ior = Input.number(openpbr.below_coat(ior.value[0], s.coat.value[0], COAT_IOR))
        inputs = {
            Slot.DIFFUSE: s.diffuse, Slot.METALLIC: s.metallic, Slot.SPECULAR_WEIGHT: weight, Slot.SPECULAR: tint, Slot.IOR: ior,
            Slot.COAT: s.coat, Slot.COAT_ROUGHNESS: s.coat_roughness, Slot.COAT_IOR: Input.number(COAT_IOR),
            Slot.COAT_DARKENING: Input.number(0.0),
            **self._rough(written, extensions.get(NAMES[0], {})), **self._film(extensions.get(NAMES[1], {})),
        }  # fmt: skip
        if s.sheen.value != BLACK:
            most = max(s.sheen.value)
            fuzz = Input.number(min(most, 1.0)), Input(scale_color(s.sheen.value, 1.0 / most), s.sheen.texture)
            inputs |= {Slot.FUZZ: fuzz[0], Slot.FUZZ_COLOR: fuzz[1], Slot.FUZZ_ROUGHNESS: s.sheen_roughness}
        optional = ((Slot.EMISSION, s.emissive if s.emissive.value != BLACK else None), (Slot.NORMAL, s.normal))
        inputs |= {slot: value for slot, value in optional if value is not None}
        if has_own_coat(written):
            inputs[Slot.COAT_NORMAL] = openpbr.SMOOTH_COAT if s.coat_normal is None else s.coat_normal
        if s.occlusion.texture != NONE:
            self._warn("the occlusionTexture of a surface that is drawn as OpenPBR is not drawn: light from all sides reaches it")
        return inputs

    def _highlight(self, s: Surface, extensions: dict[str, Any]) -> tuple[Input, Input, Input]:
        """(weight, tint, index of refraction) of KHR_materials_specular and _ior; of metals the index alone."""
        specular = extensions.get("KHR_materials_specular", {})
        if s.metallic.value[0] != 0.0 or not specular:
            return Input.number(1.0), Input(WHITE), s.ior
        ior = float(extensions.get("KHR_materials_ior", {}).get("ior", 1.5))
        color = as_color(specular.get("specularColorFactor", WHITE))
        if (most := max(color)) > 1.0:  # a tint is at most 1: the index is larger
            root = math.sqrt(min(((ior - 1.0) / (ior + 1.0)) ** 2 * most, 0.9))
            ior, color = (1.0 + root) / (1.0 - root), scale_color(color, 1.0 / most)
        weight = Input.number(float(specular.get("specularFactor", 1.0)), self._row(specular.get("specularTexture"), 3))
        return weight, Input(color, self._row(specular.get("specularColorTexture"), -1)), Input.number(ior)

    def _film(self, film: dict[str, Any]) -> dict[Slot, Input]:
        factor = float(film.get("iridescenceFactor", 0.0))
        if factor <= 0.0:
            return {}
        least, most = (
            _NANOMETRES * float(film.get(f"iridescenceThickness{name}", value)) for name, value in (("Minimum", 100.0), ("Maximum", 400.0))
        )
        thickness, picture = Input.number(most), self._row(film.get("iridescenceThicknessTexture"), 1)
        if picture != NONE:
            thickness = Input.number(1.0, self._builder.with_levels(picture, scale_color(WHITE, most - least), scale_color(WHITE, least)))
        return {
            Slot.FILM: Input.number(min(factor, 1.0), self._row(film.get("iridescenceTexture"), 0)), Slot.FILM_THICKNESS: thickness,
            Slot.FILM_IOR: Input.number(max(float(film.get("iridescenceIor", 1.3)), 1.0)),
        }  # fmt: skip

    def _rough(self, written: dict[str, Any], anisotropy: dict[str, Any]) -> dict[Slot, Input]:
        """The roughness and its direction. Pictures of both become formulas of texture graphs."""
        pbr = written.get("pbrMetallicRoughness", {})
        rough, strength = float(pbr.get("roughnessFactor", 1.0)), float(anisotropy.get("anisotropyStrength", 0.0))
        turn = float(anisotropy.get("anisotropyRotation", 0.0)) / (2.0 * math.pi)
        of_rough = self._picture(pbr.get("metallicRoughnessTexture"), 1)
        of_strength = self._picture(anisotropy.get("anisotropyTexture"), -2) if strength else None
        if of_strength is None and (of_rough is None or not strength):
            value, ratio = roughness_of(rough, strength) if of_rough is None else (rough, 0.0)
            row = NONE if of_rough is None else self._builder.texture(of_rough, Span(self._name))
            return {
                Slot.ROUGHNESS: Input.number(value, row), Slot.ANISOTROPY: Input.number(ratio), Slot.ROTATION: Input.number(turn),
            }  # fmt: skip
        b = GraphBuilder()
        scale, turns = b.constant(strength), b.constant(turn)
        if of_strength is not None:
            red, green, blue, _ = self._texels(b, of_strength)
            across, along = (b.offset(b.scale(name, 2.0), -1.0) for name in (red, green))
            scale, turns = b.scale(blue, strength), b.offset(b.scale(b.op(Op.ATAN2, along, across), 0.5 / math.pi), turn)
        r = b.constant(rough) if of_rough is None else b.scale(self._texels(b, of_rough)[1], rough)
        alpha = b.op(Op.MAX, b.multiply(r, r), b.constant(LEAST_ALPHA))
        long = b.add(alpha, b.multiply(b.subtract(b.constant(1.0), alpha), b.multiply(scale, scale)))
        share = b.divide(alpha, long)
        mean = b.op(Op.SQRT, b.scale(b.offset(b.multiply(share, share), 1.0), 0.5))
        roughness = b.op(Op.SQRT, b.multiply(long, mean))
        results = {Slot.ROUGHNESS: roughness, Slot.ANISOTROPY: b.subtract(b.constant(1.0), share), Slot.ROTATION: turns}
        return {slot: Input.number(1.0, self._graph(b, name)) for slot, name in results.items()}

    def _graph(self, b: GraphBuilder, name: int) -> int:
        return self._builder.texture(TextureData(ir.TextureKind.FORMULA, tape=self._builder.tape(b.finish(name))), Span(self._name))

    def _texels(self, b: GraphBuilder, data: TextureData) -> tuple[int, int, int, int]:
        """Red, green, blue and alpha of a picture, by its frame."""
        plain = TextureData(data.kind, data.image, wrap_u=data.wrap_u, wrap_v=data.wrap_v, nearest=data.nearest)
        row = self._builder.texture(plain, Span(self._name))
        s, t = (b.linear([(line[0], U), (line[1], V)], line[2]) for line in data.frame)
        return b.look_up(row, s, t)

    def _row(self, reference: Any, channel: int) -> int:
        data = self._picture(reference, channel)
        return NONE if data is None else self._builder.texture(data, Span(self._name))
