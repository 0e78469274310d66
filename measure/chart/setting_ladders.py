"""The ladders of a scene's chart: every knob a backend declares and the scene has a use for, as settings to render and to copy."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Any

from ...compiler import ir
from ...compiler.plan import plan as planner
from ...render import quality_settings
from ..records import Setting
from . import reference_light

NOT_PIXELS = ("size", "seed", "threads", "aov", "exposure", "view", "backend")  # settings of a chart that a rung need not repeat


@dataclass(frozen=True, slots=True)
class Ladder:
    """Settings from cheap to dear with what each takes beside the others (`costs`). `light` says what of the truth's is left out."""

    backend: str
    name: str  # of the curve: the knob, with what distinguishes it from another ladder of it
    settings: tuple[Setting, ...]
    costs: tuple[float, ...]
    light: str = ""


def ladders(scene: ir.Scene, light: reference_light.Truth, backend: str) -> list[Ladder]:
    """The ladders of one of our backends.

    Where a backend can draw the truth's light, it climbs with that; where the scene's own settings leave some of it out, they have
    ladders too, on which that shows as bias.
    """
    full, own = light.make(scene, backend), light.own(scene, backend)
    missing = reference_light.differs(light.make(scene), full)  # what no setting of the backend draws
    plain = _common(light.settings)
    said = any(full[name] != own[name] for name in ("bounces", "interreflection"))  # what has to stand on the command line
    deep, decided = (plain | {"bounces": light.bounces}, {**light.common, **light.plan}) if said else (plain, light.common)
    less = reference_light.differs(full, own)
    other = full["interreflection"] != own["interreflection"]
    made = []
    for knob in quality_settings.QUALITY_SETTINGS[backend]:
        if not knob.applies(scene, full):
            continue
        if knob.option == "bounces":
            if light.settings.bounces is None:
                made.append(_depths(knob, backend, light, plain, full))
            continue
        name = f"{knob.name}, {full['bounces']} bounces" if less and full["bounces"] else knob.name
        made.append(_ladder(knob, backend, name, deep, decided, missing))
        if other and knob.option == "samples" and backend != "reference":
            shallow = knob.name if full["bounces"] else f"{knob.name}, {own['bounces']} bounces"
            made.append(_ladder(knob, backend, shallow, plain, light.common, less))
    return made


def _common(settings: ir.Settings) -> dict[str, Any]:
    """What everybody was asked for and a picture depends on."""
    said = ((f.name, getattr(settings, f.name)) for f in fields(settings) if f.name not in NOT_PIXELS)
    return {name: value for name, value in said if value is not None}


def _ladder(
    knob: quality_settings.QualitySetting, backend: str, name: str, options: Mapping[str, Any], plan: Mapping[str, str], light: str
) -> Ladder:
    settings = []
    for value in knob.values:
        turned = {knob.option: value} if knob.option else {}
        decided = {knob.decision: f"{value:g}"} if knob.decision else {}
        settings.append(Setting(backend, knob.name, value, {**knob.fixed, **turned, **options}, {**plan, **decided}))
    return Ladder(backend, name, tuple(settings), _costs(knob.cost, knob.values), light)


def _depths(
    knob: quality_settings.QualitySetting, backend: str, light: reference_light.Truth, options: Mapping[str, Any], full: planner.Plan
) -> Ladder:
    """Depths below the truth's, which other ladders climb with."""
    values = tuple(v for v in knob.values if v < full["bounces"])
    plans = [{**light.common, **(light.plan if v else {})} for v in values]
    settings = tuple(
        Setting(backend, knob.name, v, {**knob.fixed, knob.option: v, **options}, p) for v, p in zip(values, plans, strict=True)
    )
    light_lost = f"no more than {values[-1]} bounces of {full['bounces']}"
    return Ladder(backend, knob.name, settings, _costs(knob.cost, values), light_lost)


def _costs(cost: Callable[[Any], float], values: tuple[Any, ...]) -> tuple[float, ...]:
    return tuple(cost(value) for value in values)
