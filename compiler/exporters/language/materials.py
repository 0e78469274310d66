"""Materials as `let`s: of the elements that make a row, the one that loses least."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ....lang.schema.argument_types import REQUIRED, Arg, Entry
from ....lang.schema.media import FOG, MEDIUM
from ....materials import MATERIALS, losses
from ....materials.optics import metals
from ... import ir
from ...scene import phase_functions
from ...scene.row_records import DEFAULT_MATERIAL, MaterialData, MediumData
from .. import material_values as inputs
from ..export import Export
from ..material_values import MaterialRow
from . import elements, words
from .elements import Form
from .files import Files
from .textures import Textures

Slot = ir.Slot
_SAME = 1e-5  # of an input that is written and read again
_MAPPED = frozenset((Slot.FLAKE_SIZE, Slot.FLAKE_TILT, Slot.FLAKE_COVERAGE, Slot.FLAKE_SEED, Slot.COAT_NORMAL))  # arguments of maps


class _Written(NamedTuple):
    """Arguments of an element, and what they do not say of a row."""

    form: Form
    values: dict[str, Any]
    textures: dict[str, tuple[int, tuple[float, float, float]]]  # of arguments: a row of Textures and its factor
    lost: list[str]
    inside: bool  # whether the element makes the medium of the row


class Materials:
    """The materials of a scene, each a `let`. `lets` are their statements, in an order in which no name is used before it is there."""

    def __init__(self, out: Export, files: Files, textures: Textures, photometric: bool) -> None:
        self.out, self.files, self.textures = out, files, textures
        self.tables, self.unit = out.scene.tables, "nit" if photometric else ""
        self.lets: list[str] = []
        self._names: dict[int, str] = {}
        self._media: dict[int, str | None] = {}
        self._stem = ""  # of the material that is written, for names of its textures
        self._outside: set[int] = set()  # rows whose medium is an argument of the shape

    def name(self, row: int, shape: str = "") -> str | None:
        """The name of a material; None for the one that shapes have without. `shape` is one that has it, for materials without a name."""
        if row not in self._names:
            if self._is_default(row):
                return None
            source = self._source(row) or (f"{shape.rsplit('/', 1)[-1]}_material" if shape else "")
            self._stem = source
            text = self._blend(row) if self.tables.materials.model[row] == ir.MaterialModel.BLEND else self._text(row)
            self._names[row] = self.files.identifiers.new(source, "material")
            self.lets.append(f"let {self._names[row]} = {text}")
        return self._names[row]

    def medium(self, row: int) -> str | None:
        """The name of the medium that shapes of a material have as an argument, after `name`."""
        if row not in self._outside:
            return None
        medium = int(self.tables.materials.medium[row])
        if medium not in self._media:
            self._media[medium] = self._medium(medium)
        return self._media[medium]

    def _source(self, row: int) -> str:
        names = self.out.scene.names.materials
        return names[row] if row < len(names) else ""

    def _is_default(self, row: int) -> bool:
        m = self.tables.materials
        plain = (m.values[row, [Slot.DIFFUSE, Slot.AMBIENT]] == 0.8).all() and (m.textures[row] < 0).all() and m.medium[row] < 0
        lambert = m.model[row] == ir.MaterialModel.LAMBERT and m.shading[row] == ir.Shading.SMOOTH
        return bool(plain and lambert and m.values[row, Slot.OPACITY, 0] == 1.0 and self._source(row) == DEFAULT_MATERIAL)

    def _cannot(self, row: int, message: str) -> None:
        self.out.cannot(message, "materials", row)

    # --- text ---

    def _of(self, argument: str) -> str:
        """The name of a texture of an argument."""
        return f"{self._stem.removesuffix('_material')}_{argument}" if self._stem else argument

    def _blend(self, row: int) -> str:
        m = self.tables.materials
        parts = [self.name(int(part)) or "lambert()" for part in (m.first[row], m.second[row])]
        if m.medium[row] >= 0 and not any(m.medium[int(part)] >= 0 for part in (m.first[row], m.second[row])):
            self._outside.add(row)
        texture, weight = int(m.textures[row, Slot.WEIGHT]), float(m.values[row, Slot.WEIGHT, 0])
        text = self.textures.name(texture, "number", (weight, weight, weight), self._of("weight")) if texture >= 0 else None
        return words.call("blend", *parts, text or words.number(weight), **self._maps(row, MaterialRow(self.tables, row)))

    def _text(self, row: int) -> str:
        material = MaterialRow(self.tables, row)
        candidates = [self._arguments(form, material) for form in elements.forms(int(material.model))]
        if material.model == ir.MaterialModel.METAL and all(written.lost for written in candidates):
            return self._any_metal(row, material)
        if not candidates:
            self._cannot(row, f"a material of the kind {material.model.name.lower()} is not carried: it is grey")
            return "lambert(0.8)"
        written = min(candidates, key=lambda each: (len(each.lost), len(each.values) + len(each.textures)))
        for name in written.lost:
            self._cannot(row, losses.argument(name))
        if self.tables.materials.medium[row] >= 0 and (material.medium is None or not written.inside):
            self._outside.add(row)
        entry = written.form.element.entry
        texts: dict[str, str] = {}
        for arg in entry.args:
            text = self._argument(arg, written)
            if text is not None:
                texts[arg.name] = text
        return _call(entry, {**texts, **self._maps(row, material)})

    def _any_metal(self, row: int, material: MaterialRow) -> str:
        """A metal that is none of those with a name, as slabs, which have the same reflectance."""
        texts = {}
        for argument, slot, use in (("base_color", Slot.SPECULAR, "color"), ("specular_roughness", Slot.ROUGHNESS, "number")):
            texture, value = material.texture(slot), material.value(slot).tolist()
            gain = (value[0], value[1], value[2]) if use == "color" else (value[0],) * 3
            named = self.textures.name(texture, use, gain, self._of(argument)) if texture >= 0 else None
            texts[argument] = named or (words.color(value) if use == "color" else words.number(value[0]))
        texts |= {"base_metalness": "1", "specular_color": words.color(material.value(Slot.EDGE))}
        return words.call("openpbr", **texts, **self._maps(row, material))

    def _argument(self, arg: Arg, written: _Written) -> str | None:
        """The text of an argument; None for one that has its default."""
        if arg.name in written.textures:
            texture, gain = written.textures[arg.name]
            name = self.textures.name(texture, "color" if arg.type == "color_map" else "number", gain, self._of(arg.name))
            if name is not None:
                return name
            return words.grey_or_color(gain) if arg.type == "color_map" else words.number(gain[0])
        if arg.name not in written.values or _equal(written.values[arg.name], arg.default):
            return None
        value = written.values[arg.name]
        if arg.type == "color_map":
            return words.grey_or_color(value)
        if arg.type == "color":
            return words.color(value)
        if arg.type == "size3":
            return words.one_or_all(value)
        if isinstance(value, bool):
            return str(value).lower()
        if isinstance(value, str):
            return words.string(value)
        return words.number(value) + (self.unit if arg.type == "luminance" else "")

    def _maps(self, row: int, material: MaterialRow) -> dict[str, str]:
        """Opacity, normal map and bump map."""
        texts: dict[str, str] = {}
        opacity, texture = material.number(Slot.OPACITY), material.texture(Slot.OPACITY)
        if texture >= 0:
            texts["opacity"] = self.textures.name(texture, "opacity", (opacity, opacity, opacity), self._of("opacity")) or "1"
        elif opacity != 1.0:
            texts["opacity"] = words.number(opacity)
        if material.materials.threshold[row] > 0.0:
            texts["opacity_threshold"] = words.number(float(material.materials.threshold[row]))
        for slot, argument, level, use, plain in (
            (Slot.NORMAL, "normal_map", "normal_strength", "directions", 1.0), (Slot.BUMP, "bump_map", "bump_height", "number", 0.01),
        ):  # fmt: skip
            texture = material.texture(slot)
            name = self.textures.name(texture, use, (1.0, 1.0, 1.0), self._of(argument)) if texture >= 0 else None
            if name is not None:
                texts[argument] = name
                if material.number(slot) != plain:
                    texts[level] = words.number(material.number(slot))
        return texts | self._flakes(material) | self._coat_normal(material)

    def _flakes(self, material: MaterialRow) -> dict[str, str]:
        """Flakes as a normal map."""
        if material.number(Slot.FLAKE_SIZE) <= 0.0:
            return {}
        texts: dict[str, str] = {}
        for argument, slot in (("tilt", Slot.FLAKE_TILT), ("coverage", Slot.FLAKE_COVERAGE)):
            texture, value = material.texture(slot), material.number(slot)
            name = self.textures.name(texture, "number", (value, value, value), self._of(argument)) if texture >= 0 else None
            texts[argument] = name or words.number(value)
        if material.number(Slot.FLAKE_SEED) != 0.0:
            texts["seed"] = words.number(material.number(Slot.FLAKE_SEED))
        return {"normal_map": words.call("flakes", words.number(material.number(Slot.FLAKE_SIZE)), **texts)}

    def _coat_normal(self, material: MaterialRow) -> dict[str, str]:
        """The normal of the coat, where it is not that of the base."""
        texture = material.texture(Slot.COAT_NORMAL)
        if texture >= 0:
            name = self.textures.name(texture, "directions", (1.0, 1.0, 1.0), self._of("coat_normal"))
            return {} if name is None else {"geometry_coat_normal": name}
        return {"geometry_coat_smooth": "true"} if float(material.value(Slot.COAT_NORMAL)[2]) > 0.0 else {}

    # --- arguments ---

    def _arguments(self, form: Form, row: MaterialRow) -> _Written:
        entry, name = form.element.entry, form.element.entry.name
        values = {key: value for key, value in inputs.special(name, row).items() if entry.arg(key) is not None}
        textures: dict[str, tuple[int, tuple[float, float, float]]] = {}
        lost: list[str] = []
        for argument, slots in form.slots.items():
            arg = entry.arg(argument)
            if arg is None or not slots or argument in values:
                continue
            slot = slots[-1]  # of several, AMBIENT is the first
            value = _scaled(name, argument, slot, row, values)
            if row.texture(slot) >= 0:
                gain = (float(value[0]), float(value[1]), float(value[2])) if arg.type == "color_map" else (float(value[0]),) * 3
                textures[argument] = row.texture(slot), gain
                continue
            values[argument] = tuple(value.tolist()) if arg.type == "color_map" else _within(float(value[0]), arg)
        for group in entry.exclusive:  # an argument without a default comes in place of others
            if any(entry.arg(argument).default is None and argument in form.slots for argument in group):  # type: ignore[union-attr]
                for argument in group:
                    if entry.arg(argument).default is not None:  # type: ignore[union-attr]
                        values.pop(argument, None)
                        textures.pop(argument, None)
        tokens = {argument: number for number, argument in enumerate(textures)}
        lowered, arguments = elements.lower(form.element, values, tokens)
        rows = [texture for texture, _ in textures.values()]
        gains = [gain for _, gain in textures.values()]
        lost += _differing(row, lowered, rows, gains, name, values)
        inside = lowered.medium >= 0 and _same_medium(row.medium, arguments.medium_data)
        return _Written(form, values, textures, lost, inside)

    def _medium(self, row: int) -> str | None:
        media = self.tables.media
        if media.density[row] >= 0:
            self.out.cannot(losses.DENSITY, "media", row)
            return None
        text = words.call("medium", **medium_arguments(self.out, row, bool(media.priority[row] > 0.0)))
        name = self.files.identifiers.new("medium", "medium")
        self.lets.append(f"let {name} = {text}")
        return name


def medium_arguments(out: Export, row: int, priority: bool = False) -> dict[str, str]:
    """Scattering, absorption, emission and phase of a row of Media."""
    media = out.scene.tables.media
    default = next(arg.default for arg in (FOG if media.everywhere[row] else MEDIUM).args if arg.name == "phase")
    texts = {}
    for name, values in (("scattering", media.scattering[row]), ("absorption", media.absorption[row]), ("emission", media.emission[row])):
        if values.max() > 0.0 or name == "scattering":
            texts[name] = words.one_or_all(values)
    _, of_draine, alpha, weight = media.draine[row].tolist()
    phase = float(media.anisotropy[row])
    droplet = phase_functions.droplet_of(media.draine[row].tolist())
    if droplet is not None:
        texts["droplet"] = f"{words.number(droplet / phase_functions.MICROMETRE)}um"
    elif weight == 1.0:
        phase = of_draine
        texts["alpha"] = words.number(alpha)
    elif weight > 0.0:
        out.cannot(losses.PHASE, "media", row)
    if droplet is None and phase != default:
        texts["phase"] = words.number(phase)
    if priority:
        texts["priority"] = words.number(float(media.priority[row]))
    return texts


def _call(entry: Entry, texts: dict[str, str]) -> str:
    """A call whose first argument stands without its name."""
    first = entry.args[0]
    positional = [texts.pop(first.name)] if first.name in texts and not first.keyword else []
    return words.call(entry.name, *positional, **texts)


def _scaled(element: str, argument: str, slot: ir.Slot, row: MaterialRow, values: dict[str, Any]) -> Any:
    """The constant of a slot, without the factor that another argument is."""
    value = row.value(slot).copy()
    if slot == Slot.EMISSION and element in inputs.EMITTING:
        return value / inputs.brightness(row) if value.max() > 0.0 or element != "openpbr" else np.ones(3)
    if element == "metal" and argument == "color":
        return value / np.array(metals.reflectance(values.get("kind", "gold"))[0])
    return value


def _within(value: float, arg: Arg) -> float:
    """A number within the limits of an argument."""
    if arg.minimum is not None:
        value = max(value, arg.minimum)
    return value if arg.maximum is None else min(value, arg.maximum)


def _equal(value: Any, default: Any) -> bool:
    if default is REQUIRED or default is None:
        return False
    if isinstance(value, bool | str):
        return bool(value == default)
    return bool(np.allclose(value, default, rtol=1e-7, atol=1e-12))


def _differing(
    row: MaterialRow, lowered: MaterialData, rows: list[int], gains: list[Any], element: str, values: dict[str, Any]
) -> list[str]:  # fmt: skip
    """The names of the inputs of a row that its arguments do not make."""
    lost = []
    for slot in set(MATERIALS[int(row.model)].SLOTS) - _MAPPED:
        entry = lowered.inputs.get(slot)
        value, texture = row.value(slot), row.texture(slot)
        if entry is None:
            plain = 1.0 if slot == Slot.IOR else 0.0
            same = texture < 0 and bool((value == plain).all() or value[0] == plain)
        elif entry.texture >= 0:
            width = 3 if slot in ir.COLOR_SLOTS else 1
            expected = np.array(gains[entry.texture]) * np.array(entry.value) if slot == Slot.EMISSION else np.array(gains[entry.texture])
            if element == "metal" and slot == Slot.SPECULAR:
                expected = expected * np.array(entry.value)
            same = rows[entry.texture] == texture and np.allclose(expected[:width], value[:width], rtol=_SAME, atol=1e-7)
        else:
            width = 3 if slot in ir.COLOR_SLOTS and not (slot == Slot.AMBIENT and len(set(entry.value[1:])) == 1) else 1
            same = texture < 0 and np.allclose(np.array(entry.value)[:width], value[:width], rtol=_SAME, atol=1e-7)
        if not same:
            lost.append(slot.name.lower())
    return lost


def _same_medium(wanted: MediumData | None, medium: MediumData | None) -> bool:
    if wanted is None or medium is None:
        return wanted is medium
    pairs = ((wanted.scattering, medium.scattering), (wanted.absorption, medium.absorption))
    return all(np.allclose(a, b, rtol=1e-3, atol=1e-6) for a, b in pairs)
