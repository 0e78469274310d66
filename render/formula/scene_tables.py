"""Tables of a scene's implicit surfaces; scenes without any do not load the builder."""

from __future__ import annotations

import numpy as np

from ...compiler import ir
from .tables import NO_FORMS, Forms


def build_tables(tables: ir.Tables, closed: bool = True, threads: int = 1) -> Forms:
    """Tables of the implicit surfaces that instances reference; `closed` uses closed forms for surfaces that have them."""
    kinds = tables.geometries.kind
    if (kinds[tables.instances.geometry] == ir.GeometryKind.FORMULA).any():
        from . import scene_surfaces

        return scene_surfaces.forms(tables, closed, threads)
    return NO_FORMS._replace(surface_of=np.full(len(kinds), -1, np.int32))
