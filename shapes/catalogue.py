"""The elements of the language that are analytic shapes."""

from __future__ import annotations

from . import SHAPES

ELEMENTS = {each.entry.name: (shape, each) for shape in SHAPES.values() for each in shape.ELEMENTS}
"""The shape of each element, and how its arguments make it."""
ENTRIES = tuple(element.entry for _, element in ELEMENTS.values())
"""Their entries in the catalogue."""
