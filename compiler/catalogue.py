"""The catalogue of all elements of the language. A package that has elements has a line here."""

from __future__ import annotations

from ..lang.schema import elements, media, meters
from ..lang.schema.argument_types import Catalogue, catalogue
from ..lights import catalogue as lights
from ..materials import catalogue as materials
from ..shapes import catalogue as shapes

CATALOGUE: Catalogue = catalogue(shapes.ENTRIES, lights.ENTRIES, materials.ENTRIES, media.ENTRIES, elements.ENTRIES, meters.ENTRIES)
