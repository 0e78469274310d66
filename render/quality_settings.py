"""The knobs each backend declares: what trades time for accuracy, as ladders from cheap to dear, and when a scene has a use for them.

Data for the instruments (`maquette chart`); nothing here draws. A new backend or a new knob is a row here.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..compiler import ir
from ..compiler.plan.plan import Plan

FIXED_SAMPLES = 64  # of ladders that turn another knob
TESSELLATED = (
    ir.GeometryKind.SPHERE, ir.GeometryKind.CYLINDER, ir.GeometryKind.CONE, ir.GeometryKind.TORUS, ir.GeometryKind.CAPSULE,
    ir.GeometryKind.QUADRIC, ir.GeometryKind.DISK,
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Knob:
    """One ladder of a backend.

    `values` from cheap to dear set a field of ir.Settings (`option`) or a decision of the plan (`decision`), beside what `fixed`
    sets. A rung takes about `cost(value)` times as long as 1. `applies` says whether turning it changes a scene's picture.
    """

    name: str
    values: tuple[Any, ...]
    cost: Callable[[Any], float]
    option: str = ""
    decision: str = ""
    fixed: Mapping[str, Any] = field(default_factory=dict)
    applies: Callable[[ir.Scene, Plan], bool] = lambda scene, plan: True


def _light_goes_on(scene: ir.Scene, plan: Plan) -> bool:
    return plan["bounces"] > 0


def _is_tessellated(scene: ir.Scene, plan: Plan) -> bool:
    instances = scene.tables.instances
    seen = instances.geometry[instances.visible & ir.Visibility.CAMERA != 0]
    return bool(np.isin(scene.tables.geometries.kind[seen], TESSELLATED).any())


_SAMPLES = (1, 4, 16, 64, 256, 1024, 4096)
_ERRORS = (0.3, 0.1, 0.03, 0.01, 0.003)


def _by_samples(values: tuple[int, ...]) -> Knob:
    return Knob("samples", values, float, option="samples")


def can_denoise() -> bool:
    """Whether the package for it is there."""
    return importlib.util.find_spec("pyoidn") is not None


def _is_noisy(scene: ir.Scene, plan: Plan) -> bool:
    return can_denoise() and (plan["soft lights"] or plan["interreflection"])


_DENOISED = Knob("denoised samples", _SAMPLES[1:6], float, option="samples", fixed={"denoise": True}, applies=_is_noisy)
_ERROR = Knob("error", _ERRORS, lambda error: error**-2, option="error")

KNOBS: Mapping[str, tuple[Knob, ...]] = {
    "ray": (
        _by_samples(_SAMPLES),
        _ERROR,
        _DENOISED,
        Knob("bounces", (0, 1, 2, 4, 8), lambda n: 1.0 + n, option="bounces", fixed={"samples": FIXED_SAMPLES}, applies=_light_goes_on),
    ),
    "raster": (
        _by_samples(_SAMPLES),
        Knob("tolerance", (3.2, 0.8, 0.2, 0.05, 0.0125), lambda px: 1.0 + 0.05 / px, decision="tolerance",
             fixed={"samples": FIXED_SAMPLES}, applies=_is_tessellated),
    ),
    "reference": (_by_samples(_SAMPLES[:5]),),
}  # fmt: skip
