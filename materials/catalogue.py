"""The elements of the language that are materials."""

from __future__ import annotations

from . import MATERIALS

ELEMENTS = {each.entry.name: each for material in MATERIALS.values() for each in material.ELEMENTS}
"""How each element makes a row of Materials."""
ENTRIES = tuple(element.entry for element in ELEMENTS.values())
"""Their entries in the catalogue."""
