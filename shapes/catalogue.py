"""The elements of the language that are analytic shapes. To import this module adds them to the schema of the language."""

from __future__ import annotations

from ..lang.schema import elements
from . import SHAPES

ELEMENTS = {each.entry.name: (shape, each) for shape in SHAPES.values() for each in shape.ELEMENTS}
"""The shape of each element, and how its arguments make it."""

elements.register(element.entry for _, element in ELEMENTS.values())
