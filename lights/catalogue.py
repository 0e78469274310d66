"""The elements of the language that are lights."""

from __future__ import annotations

from . import LIGHTS

ELEMENTS = {each.entry.name: each for light in LIGHTS.values() for each in light.ELEMENTS}
"""How the arguments of each element make a light."""
ENTRIES = tuple(element.entry for element in ELEMENTS.values())
"""Their entries in the catalogue."""
