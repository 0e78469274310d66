"""Elements and arguments that make a row of Materials: each element is lowered with tokens, which show the slot of each argument."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any, NamedTuple

from ....lang.schema.argument_types import REQUIRED, Entry
from ....materials import MATERIALS
from ....materials.contract import Element
from ... import ir
from ...scene.row_records import WHITE, Input, MaterialData, MediumData
from ..material_values import SHADINGS

MAPS = ("color_map", "number_map")


class Form(NamedTuple):
    """A way to write materials of a model: an element, the slots of its arguments, and the arguments that are there."""

    element: Element
    slots: Mapping[str, tuple[ir.Slot, ...]]
    optional: bool  # whether arguments without a default are there


class Values:
    """The arguments of an element, as materials.contract.Arguments. A texture is any number."""

    def __init__(self, entry: Entry, values: Mapping[str, Any], textures: Mapping[str, int]) -> None:
        self.args: Mapping[str, Any] = {arg.name: _default(arg) for arg in entry.args} | dict(values)
        self._textures, self.medium_data, self.errors = textures, None, list[str]()

    def color(self, name: str) -> Input:
        if name in self._textures:
            return Input(WHITE, self._textures[name])
        value = self.args[name]
        r, g, b = (value, value, value) if isinstance(value, float) else value
        return Input((r, g, b))

    def number(self, name: str) -> Input:
        return Input.number(1.0, self._textures[name]) if name in self._textures else Input.number(self.args[name])

    def error(self, message: str, hint: str = "") -> None:
        self.errors.append(message)

    def medium(self, medium: MediumData) -> int:
        self.medium_data: MediumData | None = medium
        return 0

    def normals(self, element: Any) -> Input:
        return Input(WHITE)

    def part(self, name: str) -> int:
        return {"first": 0, "second": 1}[name]

    @property
    def shading(self) -> ir.Shading:
        return SHADINGS[self.args["shading"]]


def _default(arg: Any) -> Any:
    return (arg.choices or (None,))[0] if arg.default is REQUIRED else arg.default


@cache
def forms(model: int) -> tuple[Form, ...]:
    """The ways to write materials of a model."""
    return tuple(form for material in MATERIALS.values() for element in material.ELEMENTS for form in _forms(element, model))


def _forms(element: Element, model: int) -> Iterator[Form]:
    if any(arg.type == "material" for arg in element.entry.args):
        return  # a blend, whose parts have elements of their own
    maps = [arg for arg in element.entry.args if arg.type in MAPS and arg.name != "opacity"]
    for optional in (False, True) if any(arg.default is None for arg in maps) else (False,):
        present = [arg.name for arg in maps if optional or arg.default is not None]
        tokens = {name: number for number, name in enumerate(present)}
        lowered = lower(element, {arg.name: 1.0 for arg in maps if arg.name in tokens and arg.default is None}, tokens)[0]
        if lowered.model == model:
            yield Form(element, {name: _slots_of(lowered, tokens[name]) for name in present}, optional)


def _slots_of(row: MaterialData, token: int) -> tuple[ir.Slot, ...]:
    return tuple(ir.Slot(slot) for slot, value in row.inputs.items() if value.texture == token)


def lower(element: Element, values: Mapping[str, Any], textures: Mapping[str, int]) -> tuple[MaterialData, Values]:
    """The row that arguments make, and them, with the medium and the errors that they lead to."""
    arguments = Values(element.entry, values, textures)
    return element.lower(arguments), arguments
