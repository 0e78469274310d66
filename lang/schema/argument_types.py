"""Schema records: elements, their arguments, and the argument types."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

REQUIRED = object()  # the default of an argument that must be given

# The argument types with their documentation. elements.Element.args says how their values are represented.
TYPES = {
    "number": "a plain number",
    "int": "a whole number",
    "bool": "true or false",
    "string": "a string",
    "choice": "one of the listed strings",
    "length": "a length; a bare number is in the file's unit",
    "angle": "an angle: 30deg or 0.5rad",
    "time": "a time: 2s",
    "intensity": "candela (cd), or bare",
    "illuminance": "lux (lx), or bare",
    "luminance": "nit (cd/m²), or bare",
    "flux": "lumen (lm)",
    "color": "a colour",
    "factors": "a colour, or a number for all channels",
    "number_map": "a number or a texture",
    "color_map": "a colour, a number (grey) or a texture",
    "texture": "a texture",
    "material": "a material",
    "medium": "a medium",
    "coefficient": "per metre in any file: a plain number, 1 / length, a colour, or a list of three for red, green and blue",
    "emission": "radiance per metre in any file: a plain number, nit / length, a colour, or a list of three for red, green and blue",
    "density": "a plain number, a formula |x, y, z| …, a pattern or a volume",
    "point": "three lengths",
    "size3": "three lengths, or one for all",
    "size2": "two lengths, or one for both",
    "direction": "three numbers or lengths, of any length above 0",
    "numbers2": "two plain numbers, or one for both",
    "scale3": "three plain numbers, or one for all",
    "rotation": "[x, y, z] angles, axis(v, angle) or quaternion(x, y, z, w)",
    "matrix": "four rows of four numbers (the last may be left out); the translation column takes lengths",
    "numbers": "a list of plain numbers",
    "points": "a list of points",
    "point_lists": "a list of lists of points",
    "lengths": "a length, or a list of lengths",
    "points2": "a list of points of a plane, two lengths each",
    "point2_lists": "a list of lists of points of a plane",
    "vectors3": "a list of three-number vectors",
    "vectors2": "a list of two-number vectors",
    "faces": "a list of lists of whole numbers from 0",
    "falloff": "[constant, linear, quadratic] or ramp(start, end)",
    "heights": "the file of a picture, a formula |x, z| …, or rows of lengths",
    "formula": "a formula |x, y, z| …",
    "pixels": "[width, height] whole numbers",
    "within": "a length, three lengths, two corners, or a sphere or box",
    "strings": "a list of strings",
    "white": 'a temperature in kelvin, as 4000 or kelvin(4000), or "auto"',
    "materials": 'a list of pairs of a name and a material: [["Body", gold()]]; * in a name matches any text',
}


@dataclass(frozen=True, slots=True)
class Arg:
    """One argument. Positional arguments follow the order of the entry; `keyword` arguments are given by name only."""

    name: str
    type: str
    default: Any = None
    doc: str = ""
    aliases: tuple[str, ...] = ()
    choices: tuple[str, ...] = ()
    minimum: float | None = None  # inclusive limits, in base units
    maximum: float | None = None
    above: float | None = None  # exclusive minimum
    below: float | None = None  # exclusive maximum
    keyword: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Entry:
    """One element of the language."""

    name: str
    category: str  # shape solid block light material medium texture camera fog setting meter
    doc: str
    args: tuple[Arg, ...] = ()
    children: bool = False
    planned: bool = False  # a reserved name, not built yet
    exclusive: tuple[tuple[str, ...], ...] = ()  # groups of which at most one may be given
    example: str = ""

    def arg(self, name: str) -> Arg | None:
        """The argument with this name or alias, or None."""
        return next((a for a in self.args if name == a.name or name in a.aliases), None)


Catalogue = Mapping[str, Entry]
"""The elements that a scene can use, by name."""


def catalogue(*groups: Iterable[Entry]) -> Catalogue:
    """The catalogue of several groups of elements, in their order. Raises ValueError for a name that is taken."""
    entries: dict[str, Entry] = {}
    for entry in (entry for group in groups for entry in group):
        if entry.name in entries:
            raise ValueError(f"two elements are called {entry.name}")
        entries[entry.name] = entry
    return entries
