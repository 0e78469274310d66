"""Blends of two materials: each sample chooses one of them at random, with the probability of the weight.

Only the chosen material is evaluated, and blends of blends need no extra code (as pbrt's MixMaterial: Pharr, Jakob, Humphreys, Physically
Based Rendering, 4th ed., §10.5.1). The random number is that of the sample, so the picture does not depend on the number of threads.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ...compiler import ir
from ...materials import traits
from ..jit.kernel import helper, make_replace
from ..jit.packed_struct import HandleType
from ..lanes import ops
from ..simd.registration import overload
from ..types import Lane, Surface, Tables
from . import model_tests
from .material_inputs import number_of

WEIGHT = int(ir.Slot.WEIGHT)
with_material = make_replace(Surface, "material")


class Unblended(NamedTuple):
    """The absence of blends."""


class Blends(NamedTuple):
    """The blends of a scene as kernels read them, besides the rows of materials."""

    deep: int  # largest nesting depth of blends


def find_blends(tables: ir.Tables, general: bool = False) -> Blends | Unblended:
    """The blends of a scene for kernels; without any Unblended, with `general` Blends(0)."""
    m = tables.materials
    deep = np.zeros(len(m.model), np.int64)
    for row in traits.blends(tables):
        deep[row] = 1 + max(deep[m.first[row]], deep[m.second[row]])
    most = int(deep[tables.instances.material].max(initial=0))
    return Blends(most) if most or general else Unblended()


def is_used(tables: Any) -> bool:
    """Whether kernels' tables of this Numba type have blends."""
    field = tables.field("materials.blended") if isinstance(tables, HandleType) else None
    return field is not None and field[1] != ()


def if_blended(function: Callable[..., Any]) -> Callable[..., Any]:
    """Wrap function(tables, point, …): in scenes without blends it returns its second argument and is not compiled."""

    def chosen(tables: Any, point: Any, *arguments: Any) -> Any:
        return function(tables, point, *arguments) if isinstance(getattr(tables.materials, "blended", None), Blends) else point

    @overload(chosen)
    def _in_kernels(tables, point, *arguments):
        if is_used(tables):
            return lambda tables, point, *arguments: function(tables, point, *arguments)
        return lambda tables, point, *arguments: point

    return chosen


@helper
def depth(tables: Any) -> int:
    """Largest nesting depth of blends, in tables with blends; 0 in general kernels of scenes without any."""
    return tables.materials.blended.deep


@helper
def choose_part(tables: Tables, point: Surface, u: Lane) -> Surface:
    """The surface with one of the materials of its blend, chosen by u from 0 to 1."""
    materials: Any = tables.materials
    point = with_material(point, ops.int_like(point.offset, 0) + point.material)
    for _ in range(materials.blended.deep):
        row = point.material
        mixed = model_tests.is_blend(materials.model[row])
        weight = ops.clip(number_of(tables, point, WEIGHT), 0.0, 1.0)
        second = u < weight
        u = ops.where(mixed, ops.where(second, u / ops.maximum(weight, 1e-9), (u - weight) / ops.maximum(1.0 - weight, 1e-9)), u)
        chosen = ops.where(second, ops.to_int(materials.second[row]), ops.to_int(materials.first[row]))
        point = with_material(point, ops.where(mixed, chosen, row))
    return point
