"""Emissive shapes whose light reaches no other surface under a plan."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...lang.diagnostics import Diagnostic
from ...materials import traits
from .. import ir
from .decision import Plan

RASTER_HINT = "--backend ray with bounces draws that light; area lights and round spheres of one color light with raster, too"
BOUNCES_HINT = "render(bounces: 1) or --bounces 1, or more; area lights and round spheres of one color are sampled without"


class UnusedEmission(NamedTuple):
    """Emissive shapes that light no other surface: a note on the first of them."""

    message: str
    instance: int
    hint: str

    def diagnostic(self, scene: ir.Scene) -> Diagnostic:
        """The note at the first shape's place."""
        return Diagnostic("note", self.message, scene.spans.get("instances", self.instance), self.hint)


def without_effect(scene: ir.Scene, plan: Plan) -> UnusedEmission | None:
    """The note on shapes that emit light which no other surface receives, because no ray is scattered; None if there are none.

    Shapes of lights are sampled by direct light, and are not among them.
    """
    if plan["interreflection"] and plan["bounces"] > 0:
        return None
    emitting = _emitting(scene.tables)
    lit = traits.lit(scene.tables)[scene.tables.instances.material]
    if not emitting.any() or not lit.any() or (emitting.sum() == 1 and not (lit & ~emitting).any()):
        return None
    rows = np.flatnonzero(emitting)
    subject, verb, them = "this emits light", "lights", "it"
    if len(rows) > 1:
        subject, verb, them = f"this and {len(rows) - 1:,} more shape{'s' if len(rows) > 2 else ''} emit light", "light", "them"
    if plan["backend"] == "raster" and plan["raster.secondary_rays"] == "none":
        message = f"{subject}, but raster lights no other objects with {them}"
        return UnusedEmission(message, int(rows[0]), RASTER_HINT)
    return UnusedEmission(f"{subject}, but {verb} other objects only with bounces", int(rows[0]), BOUNCES_HINT)


def _emitting(tables: ir.Tables) -> np.ndarray:
    """(instances,) bool: shapes, without those of lights, with an emissive material that scattered rays can hit."""
    instances = tables.instances
    shines = traits.with_parts(tables, traits.emissive(tables))
    return shines[instances.material] & (instances.light < 0) & (instances.visible & ir.Visibility.REFLECTION != 0)
