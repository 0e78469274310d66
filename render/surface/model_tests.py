"""Tests of material models in lanes, made from the lobes of the modules in materials/."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from ...compiler import ir
from ...materials import MATERIALS
from ...materials.contract import Lobes
from ..jit.kernel import helper


def _make(name: str, models: Iterable[int]) -> Any:
    """A helper that says of each lane's model whether it is one of these."""
    scope: dict[str, Any] = {}
    test = " | ".join(f"(model == {int(model)})" for model in models) or "(model < 0)"
    exec(f"def {name}(model):\n    return {test}", scope)
    return helper(scope[name])


def _with(lobes: Lobes) -> list[int]:
    return [model for model in ir.MaterialModel if lobes & MATERIALS[model].LOBES]


is_glass = _make("is_glass", _with(Lobes.GLASS))
is_blend = _make("is_blend", _with(Lobes.PARTS))
has_facets = _make("has_facets", _with(Lobes.FACETS))
has_half_vector = _make("has_half_vector", [model for model in ir.MaterialModel if MATERIALS[model].HALF_VECTOR])
