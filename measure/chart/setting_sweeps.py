"""Parameter sweeps of a chart: a series of settings for each knob that a backend declares and a scene uses."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Any

from ...compiler import ir
from ...compiler.plan import plan as planner
from ...render import quality_settings
from ...render.quality_settings import QualitySetting
from ..records import Setting
from . import reference_light

SHARED_SETTINGS = ("size", "seed", "threads", "aov", "exposure", "view", "backend")  # the chart's own settings, which steps do not repeat


@dataclass(frozen=True, slots=True)
class Sweep:
    """Settings in order of cost, with relative `costs`. `light` describes the light that is missing beside the reference."""

    backend: str
    name: str  # of the curve: the knob, with a distinction from other sweeps of it
    settings: tuple[Setting, ...]
    costs: tuple[float, ...]
    light: str = ""


def sweeps(scene: ir.Scene, light: reference_light.ReferenceLight, backend: str) -> list[Sweep]:
    """The sweeps of one of our backends.

    They use the light of the reference where the backend supports it. The scene's own settings have further sweeps where they leave out
    light, which then shows as bias.
    """
    full, scene_plan = light.plan(scene, backend), light.scene_plan(scene, backend)
    missing = reference_light.missing_light(light.plan(scene), full)  # light that no setting of the backend has
    plain = _shared_options(light.settings)
    stated = any(full[name] != scene_plan[name] for name in ("bounces", "interreflection"))  # whether options must state the light
    deep, decided = (plain | {"bounces": light.bounces}, {**light.common, **light.overrides}) if stated else (plain, light.common)
    less = reference_light.missing_light(full, scene_plan)
    other = full["interreflection"] != scene_plan["interreflection"]
    listed = []
    for knob in quality_settings.of_backend(backend):
        if not knob.applies(scene, full):
            continue
        if knob.option == "bounces":
            if light.settings.bounces is None:
                listed.append(_bounce_sweep(knob, backend, light, plain, full))
            continue
        name = f"{knob.name}, {full['bounces']} bounces" if less and full["bounces"] else knob.name
        listed.append(_sweep(knob, backend, name, deep, decided, missing))
        if other and knob.option == "samples" and backend != "reference":
            shallow = knob.name if full["bounces"] else f"{knob.name}, {scene_plan['bounces']} bounces"
            listed.append(_sweep(knob, backend, shallow, plain, light.common, less))
    return listed


def of_full_light(scene: ir.Scene, light: reference_light.ReferenceLight) -> dict[str, Setting]:
    """The cheapest setting of each sweep of the ray backend that has the light of the reference, by its knob."""
    return {sweep.settings[0].knob: sweep.settings[0] for sweep in sweeps(scene, light, "ray") if not sweep.light}


def _shared_options(settings: ir.Settings) -> dict[str, Any]:
    """Shared settings that a picture depends on."""
    options = ((f.name, getattr(settings, f.name)) for f in fields(settings) if f.name not in SHARED_SETTINGS)
    return {name: value for name, value in options if value is not None}


def _sweep(knob: QualitySetting, backend: str, name: str, options: Mapping[str, Any], plan: Mapping[str, str], light: str) -> Sweep:
    settings = []
    for value in knob.values:
        turned = {knob.option: value} if knob.option else {}
        decided = {knob.decision: f"{value:g}"} if knob.decision else {}
        settings.append(Setting(backend, knob.name, value, {**knob.fixed, **turned, **options}, {**plan, **decided}))
    return Sweep(backend, name, tuple(settings), _costs(knob.cost, knob.values), light)


def _bounce_sweep(
    knob: QualitySetting, backend: str, light: reference_light.ReferenceLight, options: Mapping[str, Any], full: planner.Plan
) -> Sweep:
    """The sweep of bounces below those of the reference."""
    values = tuple(v for v in knob.values if v < full["bounces"])
    plans = [{**light.common, **(light.overrides if v else {})} for v in values]
    settings = tuple(
        Setting(backend, knob.name, v, {**knob.fixed, knob.option: v, **options}, p) for v, p in zip(values, plans, strict=True)
    )
    light_lost = f"no more than {values[-1]} bounces of {full['bounces']}"
    return Sweep(backend, knob.name, settings, _costs(knob.cost, values), light_lost)


def _costs(cost: Callable[[Any], float], values: tuple[Any, ...]) -> tuple[float, ...]:
    return tuple(cost(value) for value in values)
