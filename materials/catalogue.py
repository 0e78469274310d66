"""The elements of the language that are materials."""

from __future__ import annotations

from . import MATERIALS

ELEMENTS = {each.entry.name: (material, each) for material in MATERIALS.values() for each in material.ELEMENTS}
"""The material of each element, and how its arguments make a row of Materials."""
ENTRIES = tuple(element.entry for _, element in ELEMENTS.values())
"""Their entries in the catalogue."""
