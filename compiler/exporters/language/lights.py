"""Lights as elements of the language."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ....lights import SKIES
from ... import ir
from ...ir.light_links import CASTERS, EVERYTHING
from ...scene import transforms
from ..export import Export
from ..placement import F64, square
from . import words
from .outline import written_name
from .places import decomposed
from .textures import Textures

Kind = ir.LightKind
_CLOSE = 1e-9
_FORMS = {Kind.RECTANGLE: None, Kind.DISK: '"disk"', Kind.SPHERE: '"sphere"'}


class Lights:
    """The lights of a scene."""

    def __init__(self, out: Export, textures: Textures, photometric: bool) -> None:
        self.out, self.textures, self.tables = out, textures, out.scene.tables
        self._unit = photometric

    def text(self, row: int) -> str | None:
        """The element of a light; None, after a report, without one."""
        kind = Kind(int(self.tables.lights.kind[row]))
        if kind in (Kind.POINT, Kind.SPOT):
            return self._point(row, kind)
        if kind in (Kind.DIRECTIONAL, Kind.SUN):
            return self._distant(row, kind)
        if kind in SKIES:
            return self._sky(row)
        if kind == Kind.AMBIENT:
            return words.call("ambient", **self._strength(row, "luminance", "nit"), **self._common(row))
        if kind in _FORMS:
            return self._area(row, kind)
        self.out.cannot(f"a {kind.name.lower()} light is not carried", "lights", row)
        return None

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
        if not lights.shadows[row] and lights.kind[row] != Kind.AMBIENT:
            texts["shadows"] = "false"
        for argument, mask, every in (("receivers", lights.receivers[row], EVERYTHING), ("blockers", lights.blockers[row], CASTERS)):
            if mask != every:
                texts[argument] = self._members(int(mask))
        if names.groups and names.groups[row]:
            texts["group"] = words.string(names.groups[row])
        if row < len(names.lights) and names.lights[row] and names.lights[row] != Kind(int(lights.kind[row])).name.lower():
            texts["name"] = words.string(names.lights[row])
        return texts

    def _members(self, mask: int) -> str:
        """The names of the instances of a light link."""
        names, visible = self.out.scene.names.instances, self.tables.instances.visible
        chosen = dict.fromkeys(
            written_name(names[i])[0].replace("[", "[[]") for i in np.flatnonzero(visible & mask != 0).tolist() if i < len(names)
        )
        return f"[{', '.join(map(words.string, chosen))}]" if chosen else '["!*"]'

    def _point(self, row: int, kind: ir.LightKind) -> str:
        lights = self.tables.lights
        position, texts = lights.position[row], self._strength(row, "intensity", "cd")
        if lights.falloff[row] == ir.FalloffKind.POLYNOMIAL:
            texts["falloff"] = words.numbers(lights.coefficients[row])
        elif lights.falloff[row] == ir.FalloffKind.RAMP:
            texts["falloff"] = f"ramp({', '.join(map(words.number, lights.coefficients[row, :2]))})"
        if kind == Kind.SPOT:
            cone, full = (float(np.arccos(np.clip(cosine[row], -1.0, 1.0))) for cosine in (lights.cos_cone, lights.cos_full))
            texts |= {"look_at": words.numbers(_tidy(position + lights.direction[row])), "cone": words.degrees(cone)}
            texts["soft"] = words.degrees(cone - full)
        elif lights.image[row] >= 0:
            texts |= self._profile(row) | self._turn(row)
        return words.call(kind.name.lower(), words.numbers(_tidy(position)), **texts, **self._common(row))

    def _profile(self, row: int) -> dict[str, str]:
        return {"profile": words.string(self.textures.picture(int(self.tables.lights.image[row])).file)}

    def _turn(self, row: int) -> dict[str, str]:
        """The rotation of a frame, as angles."""
        turned = decomposed(self._frame(row)[:3, :3])
        return {"rotate": turned[0]} if turned is not None and turned[0] else {}

    def _frame(self, row: int) -> F64:
        return square(self.tables.transforms.matrix[self.tables.lights.transform[row]])

    def _distant(self, row: int, kind: ir.LightKind) -> str:
        lights = self.tables.lights
        texts: Mapping[str, str] = self._strength(row, "illuminance", "lx")
        towards = words.numbers(_direction(lights.direction[row]))
        angle = {"angle": words.degrees(2.0 * float(lights.angle[row]))} if kind == Kind.SUN else {}
        return words.call(kind.name.lower(), towards, **texts, **angle, **self._common(row))

    def _sky(self, row: int) -> str:
        image = int(self.tables.lights.image[row])
        texts = self._strength(row, "luminance", "nit")
        if image >= 0:
            return words.call("dome", words.string(self.textures.picture(image).file), **texts, **self._turn(row), **self._common(row))
        if self._unit and "color" in texts:  # a sky of a color with a unit stands above ground
            color = texts.pop("color")
            return words.call("dome", pattern=f"|x, y, z| {color}", **texts, **self._common(row))
        return words.call("sky", **texts, **self._common(row))

    def _area(self, row: int, kind: ir.LightKind) -> str:
        lights, frame = self.tables.lights, self._frame(row)
        position, towards = frame[:3, 3], frame[:3, 1]
        texts = {} if kind == Kind.SPHERE and lights.image[row] < 0 else {"look_at": words.numbers(_tidy(position + towards))}
        plain = transforms.facing(tuple(position), tuple(towards))
        if texts and plain is not None and np.abs(plain - frame).max() > _CLOSE:
            texts["up"] = words.numbers(_direction(-frame[:3, 2]))
        size = 2.0 * lights.size[row]
        texts["size"] = words.one_or_all(size if kind == Kind.RECTANGLE else size[:1])
        texts |= {"shape": form} if (form := _FORMS[kind]) else {}
        texts |= self._strength(row, "luminance", "nit")
        if lights.instance[row] < 0:
            texts["visible"] = "false"
        if lights.image[row] >= 0:
            texts |= self._profile(row)
        return words.call("area", words.numbers(_tidy(position)), **texts, **self._common(row))


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
