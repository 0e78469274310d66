"""Which light a chart's reference holds: everything the scene's light does, to a depth that is said; so that what is missing shows as bias.

Bounces asked for on the command line hold for all, the reference too. Otherwise light is followed between all surfaces until what is
left out is below LEFT_OUT of what a surface gets, 32 bounces at the most, whatever depth the scene itself asks for. A scene with
ambient light is the exception: ambient light stands for interreflection (the course's model), so its truth has none.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ...compiler import ir
from ...compiler.plan import plan as planner

LEFT_OUT = 1e-3  # share of the light that more bounces would add, for the brightest matt surface all around
LEAST_DEPTH, MOST_DEPTH = 8, 32
SPECULAR_DEPTH = 16  # where only mirrors and glass send light on


@dataclass(frozen=True, slots=True)
class Truth:
    """The settings of the reference: what all have in common, and the depth beside it (`bounces` None: as the scene says)."""

    settings: ir.Settings  # size, threads, camera, …: everybody's
    common: Mapping[str, str]  # everybody's overrides of the plan
    bounces: int | None
    plan: Mapping[str, str]  # overrides that belong to the depth
    how: str  # for people

    def make(self, scene: ir.Scene, backend: str = "ray", **options: object) -> planner.Plan:
        """A plan of this light."""
        asked = replace(self.settings, backend=backend, **options)
        if self.bounces is not None:
            asked = replace(asked, bounces=self.bounces)
        return planner.make(scene, asked, {**self.common, **self.plan})

    def own(self, scene: ir.Scene, backend: str) -> planner.Plan:
        """A plan of the light that the scene's own settings, or those asked for, give."""
        return planner.make(scene, replace(self.settings, backend=backend), self.common)


def of(scene: ir.Scene, settings: ir.Settings, common: Mapping[str, str] | None = None) -> Truth:
    """The truth of a scene as asked for. Raises planner.PlanError."""
    bounces, plan, how = _light(scene, settings)
    return Truth(settings, common or {}, bounces, plan, how)


def _light(scene: ir.Scene, settings: ir.Settings) -> tuple[int | None, dict[str, str], str]:
    own = planner.make(scene, replace(settings, backend="ray"))
    if settings.bounces is not None:
        between = ", matt surfaces too" if own["interreflection"] else ""
        return settings.bounces, {}, f"{settings.bounces} bounces, as asked for{between}"
    materials = scene.tables.materials
    specular = bool(planner.specular_materials(scene).any())
    lit = materials.model != ir.MaterialModel.EMISSIVE
    matt = float(materials.values[lit, ir.Slot.DIFFUSE].max(initial=0.0))
    if (scene.tables.lights.kind == ir.LightKind.AMBIENT).any():
        alone = {"interreflection": "off"} if own["interreflection"] else {}
        how = "none between matt surfaces: ambient light stands for it"
        if not specular:
            return 0, alone, f"interreflection: {how}"
        return SPECULAR_DEPTH, {"interreflection": "off"}, f"{SPECULAR_DEPTH} bounces at mirrors and glass, {how}"
    if matt > 0.0:
        depth = max(_depth(matt), SPECULAR_DEPTH if specular else 0)
        return depth, {}, f"interreflection to {depth} bounces"
    if specular:
        return SPECULAR_DEPTH, {}, f"{SPECULAR_DEPTH} bounces at mirrors and glass"
    return None, {}, "light as it is emitted"


def differs(truth: planner.Plan, other: planner.Plan) -> str:
    """What light a plan leaves out of the truth's (or adds to it), "" where it has the same."""
    if truth["interreflection"] and not other["interreflection"]:
        return "no interreflection"
    if other["interreflection"] and not truth["interreflection"]:
        return "interreflection counted beside the ambient light"
    if other["bounces"] < truth["bounces"]:
        return f"{other['bounces']} bounces of {truth['bounces']}" if other["bounces"] else "no reflected or refracted rays"
    return ""


def _depth(albedo: float) -> int:
    """Bounces after which albedo^n, what is left in a closed room of it, is below LEFT_OUT."""
    if albedo >= 1.0:
        return MOST_DEPTH
    return int(np.clip(math.ceil(math.log(LEFT_OUT) / math.log(albedo)), LEAST_DEPTH, MOST_DEPTH))
