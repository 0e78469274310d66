"""Lights as elements of the language."""

from __future__ import annotations

import numpy as np

from ....lights import LIGHTS
from ....lights.contract import Form, Light
from ... import ir
from ...catalogue import CATALOGUE
from ...ir.light_links import CASTERS, EVERYTHING
from ...scene import transforms
from ..export import Export
from ..placement import F64, square
from . import words
from .outline import written_name
from .places import decomposed
from .textures import Textures

_CLOSE = 1e-9
_SHAPES = {Form.DISK: '"disk"', Form.SPHERE: '"sphere"'}
Written = tuple[str, list[str], dict[str, str]]
"""The name of an element, its arguments without a name, and those by name."""


class Lights:
    """The lights of a scene."""

    def __init__(self, out: Export, textures: Textures, photometric: bool) -> None:
        self.out, self.textures, self.tables = out, textures, out.scene.tables
        self._unit = photometric

    def text(self, row: int) -> str:
        """The element of a light."""
        light = LIGHTS[int(self.tables.lights.kind[row])]
        write = {Form.POINT: self._point, Form.DISTANT: self._distant, Form.SKY: self._sky, Form.AMBIENT: self._ambient}
        name, place, texts = write.get(light.FORM, self._area)(row, light)
        texts |= self._source(row, light) | self._common(row)
        entry = CATALOGUE[name]
        for argument in [argument for argument in texts if entry.arg(argument) is None]:
            self.out.cannot(f"`{argument}` of a {name} light is not carried", "lights", row)
            texts.pop(argument)
        return words.call(name, *place, **texts)

    def _source(self, row: int, light: Light) -> dict[str, str]:
        """The arguments that its kind of light has beyond those of its form."""
        if light.source is None:
            return {}
        entry = light.ELEMENTS[0].entry
        kinds = {argument.name: argument.type for argument in entry.args}
        values = light.source(self.tables.lights, row)
        return {name: (words.degrees if kinds.get(name) == "angle" else words.number)(value) for name, value in values.items()}

    def emits(self, row: int) -> str:
        """The material of a visible ball that is a light."""
        strength = self._strength(row, "luminance", "nit")
        return words.call("emissive", strength.pop("color", "#ffffff"), **strength)

    def is_linked(self, row: int) -> bool:
        """Whether a light has arguments that a shining ball has not."""
        return bool(self._common(row).keys() - {"name"})

    def _strength(self, row: int, argument: str, unit: str) -> dict[str, str]:
        """The largest component as strength, and the colour beside it."""
        color = self.tables.lights.color[row]
        strength = float(color.max())
        texts = {argument: words.number(strength) + (unit if self._unit else "")}
        if strength > 0.0 and (color != strength).any():
            texts["color"] = words.color(color / strength)
        return texts

    def _common(self, row: int) -> dict[str, str]:
        lights, names = self.tables.lights, self.out.scene.names
        texts: dict[str, str] = {}
        if not lights.shadows[row] and LIGHTS[int(lights.kind[row])].FORM != Form.AMBIENT:
            texts["shadows"] = "false"
        for argument, mask, every in (("receivers", lights.receivers[row], EVERYTHING), ("blockers", lights.blockers[row], CASTERS)):
            if mask != every:
                texts[argument] = self._members(int(mask))
        if names.groups and names.groups[row]:
            texts["group"] = words.string(names.groups[row])
        if row < len(names.lights) and names.lights[row] and names.lights[row] != ir.LightKind(int(lights.kind[row])).name.lower():
            texts["name"] = words.string(names.lights[row])
        return texts

    def _members(self, mask: int) -> str:
        """The names of the instances of a light link."""
        names, visible = self.out.scene.names.instances, self.tables.instances.visible
        chosen = dict.fromkeys(
            written_name(names[i])[0].replace("[", "[[]") for i in np.flatnonzero(visible & mask != 0).tolist() if i < len(names)
        )
        return f"[{', '.join(map(words.string, chosen))}]" if chosen else '["!*"]'

    def _ambient(self, row: int, light: Light) -> Written:
        return "ambient", [], self._strength(row, "luminance", "nit")

    def _point(self, row: int, light: Light) -> Written:
        lights = self.tables.lights
        position, texts = lights.position[row], self._strength(row, "intensity", "cd")
        if lights.falloff[row] == ir.FalloffKind.POLYNOMIAL:
            texts["falloff"] = words.numbers(lights.coefficients[row])
        elif lights.falloff[row] == ir.FalloffKind.RAMP:
            texts["falloff"] = f"ramp({', '.join(map(words.number, lights.coefficients[row, :2]))})"
        if light.profile is not None:
            texts["look_at"] = words.numbers(_tidy(position + lights.direction[row]))
        elif lights.image[row] >= 0:
            texts |= self._profile(row) | self._turn(row)
        return light.ELEMENTS[0].entry.name, [words.numbers(_tidy(position))], texts

    def _profile(self, row: int) -> dict[str, str]:
        return {"profile": words.string(self.textures.picture(int(self.tables.lights.image[row])).file)}

    def _turn(self, row: int) -> dict[str, str]:
        """The rotation of a frame, as angles."""
        turned = decomposed(self._frame(row)[:3, :3])
        return {"rotate": turned[0]} if turned is not None and turned[0] else {}

    def _frame(self, row: int) -> F64:
        return square(self.tables.transforms.matrix[self.tables.lights.transform[row]])

    def _distant(self, row: int, light: Light) -> Written:
        towards = words.numbers(_direction(self.tables.lights.direction[row]))
        return light.ELEMENTS[0].entry.name, [towards], self._strength(row, "illuminance", "lx")

    def _sky(self, row: int, light: Light) -> Written:
        image = int(self.tables.lights.image[row])
        texts = self._strength(row, "luminance", "nit")
        if image >= 0:
            return "dome", [words.string(self.textures.picture(image).file)], texts | self._turn(row)
        if self._unit and "color" in texts:  # a sky of a color with a unit stands above ground
            return "dome", [], {"pattern": f"|x, y, z| {texts.pop('color')}", **texts}
        return "sky", [], texts

    def _area(self, row: int, light: Light) -> Written:
        lights, frame = self.tables.lights, self._frame(row)
        position, towards = frame[:3, 3], frame[:3, 1]
        texts = {} if light.FORM == Form.SPHERE and lights.image[row] < 0 else {"look_at": words.numbers(_tidy(position + towards))}
        plain = transforms.facing(tuple(position), tuple(towards))
        if texts and plain is not None and np.abs(plain - frame).max() > _CLOSE:
            texts["up"] = words.numbers(_direction(-frame[:3, 2]))
        size = 2.0 * lights.size[row]
        texts["size"] = words.one_or_all(size if light.FORM == Form.RECTANGLE else size[:1])
        texts |= {"shape": _SHAPES[light.FORM]} if light.FORM in _SHAPES else {}
        texts |= self._strength(row, "luminance", "nit")
        if lights.image[row] >= 0:
            texts |= self._profile(row)
        if light.profile is not None:  # an element of its own, which is never seen
            return light.ELEMENTS[0].entry.name, [words.numbers(_tidy(position))], texts
        return "area", [words.numbers(_tidy(position))], texts | ({"visible": "false"} if lights.instance[row] < 0 else {})


def _tidy(values: F64) -> F64:
    """Places without the last digits of what they were computed from."""
    single = values.astype(np.float32).astype(np.float64)
    return np.where(np.abs(single - values) <= 1e-12 * np.maximum(np.abs(values), 1e-3), single, values)


def _direction(unit: F64) -> F64:
    """A direction in short numbers, where these are the same direction."""
    for digits in range(9):
        largest = float(np.abs(unit).max())
        short = np.round(unit / largest, digits)
        if np.abs(short / np.linalg.norm(short) - unit).max() < _CLOSE:
            return short
    return unit
