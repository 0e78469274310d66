"""Orders the decisions of a plan by their effect on the picture and on its cost."""

from __future__ import annotations

import math
from typing import Any

from .decision import Decision, Plan, adaptive, by_default

COUNT = 5
# By falling importance, with the values by which a scene lacks what a decision is about.
ORDER: dict[str, tuple[Any, ...]] = {
    "backend": (),
    "error": (0.0,),
    "budget": (math.inf,),
    "samples": (),
    "transport": (),
    "bounces": (0,),
    "transport.caustics": ("none", "paths"),
    "motion_blur": (False,),
    "lens": ("pinhole",),
    "raster.secondary_rays": (),
    "area_lights": (False,),
    "implicit_surfaces": (),
    "opacity": (False,),
    "raster.shadows": (),
    "denoise": ("off",),
    "texture_filter": ("point",),
    "transport.path_reuse": ("none",),
    "transport.sky_visibility": ("none",),
    "shadows": (),
    "exposure": (),
    "size": (),
    "accelerator": (),
    "background": (),
}


def most_important(plan: Plan) -> list[Decision]:
    """Five decisions: those that the user overrides with --plan first, then by falling importance for this scene."""
    names = [d.name for d in plan.decisions.values() if d.overridden]
    names += [name for name, idle in ORDER.items() if plan[name] not in idle and not _is_without_effect(name, plan)]
    return [plan.decisions[name] for name in list(dict.fromkeys(names))[:COUNT]]


def _is_without_effect(name: str, plan: Plan) -> bool:
    if name.startswith("raster."):
        return bool(plan["backend"] != "raster")
    if name == "samples":  # then the largest number
        return adaptive(plan) and not by_default(plan)
    if name == "implicit_surfaces":
        return plan.decisions[name].reason == "the scene has none"
    if name == "transport":
        return bool(plan["bounces"] == 0)  # nothing but direct light
    return False
