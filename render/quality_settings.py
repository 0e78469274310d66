"""Quality settings of each backend: the options that trade time for accuracy, with their values from fast to accurate.

Read by `maquette chart`. A backend without a row has samples alone.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..compiler import ir
from ..compiler.plan.plan import Plan
from ..shapes import SHAPES

FIXED_SAMPLES = 64  # for settings other than samples
TESSELLATED = [kind for kind, shape in SHAPES.items() if not shape.EXACT]


@dataclass(frozen=True, slots=True)
class QualitySetting:
    """One quality setting of a backend.

    `values`, from fast to accurate, are of a field of ir.Settings (`option`) or of a plan decision (`decision`); `fixed` sets others.
    Rendering with a value takes about `cost(value)` units of time. `applies` tests whether the setting changes a scene's picture.
    """

    name: str
    values: tuple[Any, ...]
    cost: Callable[[Any], float]
    option: str = ""
    decision: str = ""
    fixed: Mapping[str, Any] = field(default_factory=dict)
    applies: Callable[[ir.Scene, Plan], bool] = lambda scene, plan: True


def _has_bounces(scene: ir.Scene, plan: Plan) -> bool:
    return plan["bounces"] > 0


def _is_tessellated(scene: ir.Scene, plan: Plan) -> bool:
    instances = scene.tables.instances
    seen = instances.geometry[instances.visible & ir.Visibility.CAMERA != 0]
    return bool(np.isin(scene.tables.geometries.kind[seen], TESSELLATED).any())


_SAMPLES = (1, 4, 16, 64, 256, 1024, 4096)
_ERRORS = (0.3, 0.1, 0.03, 0.01, 0.003)


def _by_samples(values: tuple[int, ...]) -> QualitySetting:
    return QualitySetting("samples", values, float, option="samples")


def can_denoise() -> bool:
    """Whether pyoidn is installed."""
    return importlib.util.find_spec("pyoidn") is not None


def _is_noisy(scene: ir.Scene, plan: Plan) -> bool:
    return can_denoise() and (plan["area_lights"] or plan["interreflection"])


_DENOISED = QualitySetting("denoised samples", _SAMPLES[1:6], float, option="samples", fixed={"denoise": True}, applies=_is_noisy)
_ERROR = QualitySetting("error", _ERRORS, lambda error: error**-2, option="error")

QUALITY_SETTINGS: Mapping[str, tuple[QualitySetting, ...]] = {
    "ray": (
        _by_samples(_SAMPLES),
        _ERROR,
        _DENOISED,
        QualitySetting("bounces", (0, 1, 2, 4, 8), lambda n: 1.0 + n, option="bounces",
                       fixed={"samples": FIXED_SAMPLES}, applies=_has_bounces),
    ),
    "raster": (
        _by_samples(_SAMPLES),
        QualitySetting("tolerance", (3.2, 0.8, 0.2, 0.05, 0.0125), lambda px: 1.0 + 0.05 / px, decision="tolerance",
                       fixed={"samples": FIXED_SAMPLES}, applies=_is_tessellated),
    ),
    "reference": (_by_samples(_SAMPLES[:5]),),
}  # fmt: skip


def of_backend(backend: str) -> tuple[QualitySetting, ...]:
    """The quality settings of a backend."""
    return QUALITY_SETTINGS.get(backend, (_by_samples(_SAMPLES),))
