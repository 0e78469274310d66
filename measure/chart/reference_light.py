"""Selects the light of a chart's reference: all light of the scene to a stated depth. Missing light then shows as bias.

A number of bounces on the command line holds for all, the reference too. Otherwise light bounces until the remainder is below REMAINDER
of the light of a surface, at most 32 times, regardless of the scene's own depth. Scenes with ambient light are the exception: ambient
light stands for interreflection (the course's model), so their reference has none.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ...compiler import ir
from ...compiler.plan import plan as planner
from ...lights import AMBIENT
from ...materials import traits
from ...materials.contract import Lobes

REMAINDER = 1e-3  # share of the light that further bounces would add in a closed room of the brightest diffuse surface
MIN_DEPTH, MAX_DEPTH = 8, 32
SPECULAR_DEPTH = 16  # where only mirrors and glass reflect light


@dataclass(frozen=True, slots=True)
class ReferenceLight:
    """The settings of the reference: the shared ones and its depth (`bounces`; None: the scene's)."""

    settings: ir.Settings  # shared by all: size, threads, camera, …
    common: Mapping[str, str]  # overrides of the plan for all
    bounces: int | None
    overrides: Mapping[str, str]  # overrides that belong to the depth of the reference
    how: str  # description for readers

    def plan(self, scene: ir.Scene, backend: str = "ray", **options: object) -> planner.Plan:
        """A plan with this light."""
        requested = replace(self.settings, backend=backend, **options)
        if self.bounces is not None:
            requested = replace(requested, bounces=self.bounces)
        return planner.make_plan(scene, requested, {**self.common, **self.overrides})

    def scene_plan(self, scene: ir.Scene, backend: str) -> planner.Plan:
        """A plan with the light of the scene's own settings."""
        return planner.make_plan(scene, replace(self.settings, backend=backend), self.common)


def choose(scene: ir.Scene, settings: ir.Settings, common: Mapping[str, str] | None = None) -> ReferenceLight:
    """The reference light of a scene. Raises planner.PlanError."""
    bounces, plan, how = _light(scene, settings)
    return ReferenceLight(settings, common or {}, bounces, plan, how)


def _light(scene: ir.Scene, settings: ir.Settings) -> tuple[int | None, dict[str, str], str]:
    scene_plan = planner.make_plan(scene, replace(settings, backend="ray"))
    if settings.bounces is not None:
        between = ", matt surfaces too" if scene_plan["interreflection"] else ""
        return settings.bounces, {}, f"{settings.bounces} bounces, as asked for{between}"
    materials = scene.tables.materials
    specular = bool(traits.specular(scene.tables).any())
    lit = ~traits.has(scene.tables, Lobes.EMISSION)
    diffuse = float(materials.values[lit, ir.Slot.DIFFUSE].max(initial=0.0))
    if ir.is_in(scene.tables.lights.kind, AMBIENT).any():
        alone = {"interreflection": "off"} if scene_plan["interreflection"] else {}
        how = "none between matt surfaces: ambient light stands for it"
        if not specular:
            return 0, alone, f"interreflection: {how}"
        return SPECULAR_DEPTH, {"interreflection": "off"}, f"{SPECULAR_DEPTH} bounces at mirrors and glass, {how}"
    if diffuse > 0.0:
        depth = max(_depth(diffuse), SPECULAR_DEPTH if specular else 0)
        return depth, {}, f"interreflection to {depth} bounces"
    if specular:
        return SPECULAR_DEPTH, {}, f"{SPECULAR_DEPTH} bounces at mirrors and glass"
    return None, {}, "light as it is emitted"


def missing_light(truth: planner.Plan, other: planner.Plan) -> str:
    """A description of the light that `other` lacks or adds beside the reference; "" if none."""
    if truth["interreflection"] and not other["interreflection"]:
        return "no interreflection"
    if other["interreflection"] and not truth["interreflection"]:
        return "interreflection counted beside the ambient light"
    if other["bounces"] < truth["bounces"]:
        return f"{other['bounces']} bounces of {truth['bounces']}" if other["bounces"] else "no reflected or refracted rays"
    return ""


def _depth(albedo: float) -> int:
    """The number of bounces n after which albedo^n, the remainder in a closed room, is below REMAINDER."""
    if albedo >= 1.0:
        return MAX_DEPTH
    return int(np.clip(math.ceil(math.log(REMAINDER) / math.log(albedo)), MIN_DEPTH, MAX_DEPTH))
