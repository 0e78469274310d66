"""Lobes that materials add to the classic ones, made from the modules that they name as LOBE.

Each has a value, a density and samples; `albedo` is its share of the samples of a BSDF. They count as diffuse: photons and reused paths
treat them so. Scenes without such materials compile nothing of it: the `added` of their Shader is None, which is a type.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from ...compiler import ir
from ...materials import ADDED, traits
from ..jit.kernel import helper, specialize_if_present
from ..jit.packed_struct import HandleType
from ..lanes import ops
from ..light import lights
from ..simd.registration import overload
from ..surface.material_inputs import color_of
from ..types import Lane, Surface, Tables, Vec


class NotAdded(NamedTuple):
    """No material has a lobe of its own."""


class Added(NamedTuple):
    """Some material has a lobe of its own."""

    count: int  # of lobes


class AddedLobe(NamedTuple):
    """One lobe at a point."""

    here: Lane  # bool: the material has it
    inputs: Any  # a tuple of colours, in the order of the lobe's SLOTS


def tables_of(tables: ir.Tables, general: bool = False) -> Added | NotAdded:
    """Added if a material of an instance has a lobe of its own, or with `general`, if there is any such lobe."""
    has_lobes = bool((traits.added(tables) & traits.used(tables)).any())
    return Added(len(ADDED)) if ADDED and (general or has_lobes) else NotAdded()


def _make(head: str, before: Sequence[str], branch: Sequence[str], after: str) -> Any:
    """A helper with `branch` for each lobe: `lobe` is its AddedLobe, a call of `value` and so on one of its functions."""
    lines, scope = [head, *before], {"ops": ops, "color_of": color_of, "AddedLobe": AddedLobe}
    for n, (lobe, _) in enumerate(ADDED):
        for name in ("value", "density", "sample", "albedo"):
            scope[f"{name}_{n}"] = getattr(lobe, name)
        for line in branch:
            for name in ("value", "density", "sample", "albedo"):
                line = line.replace(f"{name}(", f"{name}_{n}(")
            lines.append(line.replace("LOBE", f"added[{n}]").replace("THROUGH", str(lobe.THROUGH)))
    exec("\n    ".join([*lines, after]), scope)
    return helper(scope[head[4 : head.index("(")]])


_without = _make(
    "def added_without(added, plain, hidden):", (), (), "return (" + "".join(
        f"AddedLobe(added[{n}].here & ops.not_(hidden), added[{n}].inputs), " for n in range(len(ADDED))
    ) + ")",
)  # fmt: skip
_at = _make(
    "def added_at(tables, surface):", ("model = tables.materials.model[surface.material]", "no = ops.bool_like(surface.offset, False)"), (),
    "return (" + "".join(
        f"AddedLobe(no | {' | '.join(f'(model == {model})' for model in models)}, "
        f"({''.join(f'color_of(tables, surface, {int(slot)}), ' for slot in lobe.SLOTS)})), " for lobe, models in ADDED
    ) + ")",
)  # fmt: skip
_value = _make(
    "def added_value(added, plain, normal, to_light, to_viewer):", (),
    (
        "if ops.any_lane(LOBE.here):",
        "    plain = ops.where3(LOBE.here, ops.add(plain, value(LOBE.inputs, normal, to_light, to_viewer)), plain)",
    ),
    "return plain",
)  # fmt: skip
_density = _make(
    "def added_density(added, plain, normal, to_light, to_viewer):", (),
    (
        "if ops.any_lane(LOBE.here):",
        "    chance = ops.mean3(albedo(LOBE.inputs, normal, to_viewer))",
        "    plain = ops.where(LOBE.here, plain + chance * density(LOBE.inputs, normal, to_light, to_viewer), plain)",
    ),
    "return plain",
)  # fmt: skip
_chance = _make(
    "def added_chance(added, plain, normal, to_viewer):", (),
    (
        "if ops.any_lane(LOBE.here):",
        "    plain = ops.where(LOBE.here, plain + ops.mean3(albedo(LOBE.inputs, normal, to_viewer)), plain)",
    ),
    "return plain",
)  # fmt: skip
_draw = _make(
    "def added_draw(added, plain, normal, to_viewer, u, v, which):", (),
    (
        "if ops.any_lane(LOBE.here):",
        "    chance = ops.where(LOBE.here, ops.mean3(albedo(LOBE.inputs, normal, to_viewer)), 0.0)",
        "    drawn = (which >= 0.0) & (which < chance)",
        "    plain = ops.where3(drawn, sample(LOBE.inputs, normal, to_viewer, u, v), plain)",
        "    which = which - chance",
    ),
    "return plain",
)  # fmt: skip
_or_has = _make("def added_or_has(added, plain):", (), ("plain = plain | LOBE.here",), "return plain")
_or_through = _make("def added_or_through(added, plain):", (), ("if THROUGH: plain = plain | LOBE.here",), "return plain")

value = specialize_if_present(_value)  # `plain` and π f cos of the lobes: normal, direction to the light, to the viewer
density = specialize_if_present(_density)  # `plain` and the densities of `draw`, each times its chance; directions as for `value`
chance = specialize_if_present(_chance)  # `plain` and the albedos of the lobes: normal, viewer
draw = specialize_if_present(_draw)  # a direction: normal, viewer, u, v, and a number from 0 to `chance`; `plain` for other numbers
without = specialize_if_present(_without)  # (lobes, None, mask): the lobes, but for those of a mask
or_has = specialize_if_present(_or_has)  # the condition, or that there is a lobe
or_through = specialize_if_present(_or_through)  # the condition, or that there is a lobe that scatters light to the other side


def at(tables: Tables, surface: Surface) -> Any:
    """Return the added lobes of a surface; None in scenes without any."""
    return _at(tables, surface) if isinstance(getattr(tables.materials, "added", None), Added) else None


@overload(at)
def _at_in_kernels(tables, surface):
    field = tables.field("materials.added") if isinstance(tables, HandleType) else None
    if field is not None and field[1] != ():
        return lambda tables, surface: _at(tables, surface)
    return lambda tables, surface: None


@helper
def _sample(added: Any, default: tuple[Vec, Vec], normal: Vec, to_viewer: Vec, u: Lane, v: Lane) -> tuple[Vec, Vec]:
    """(direction, weight) of a sample of the lobe, where there is one; `default` elsewhere."""
    zero = 0.0 * normal[0]
    direction = _draw(added, default[0], normal, to_viewer, u, v, zero)
    share = _value(added, (zero, zero, zero), normal, direction, to_viewer)
    density, chance = _density(added, zero, normal, direction, to_viewer), _chance(added, zero, normal, to_viewer)
    share = ops.scale(share, chance / ops.maximum(math.pi * density, lights.TINY))
    has_lobe = _or_has(added, ops.bool_like(zero, False))
    return ops.where3(has_lobe, direction, default[0]), ops.where3(has_lobe, share, default[1])


@helper
def _sample_beside(
    added: Any, default: tuple[Vec, Vec], normal: Vec, to_viewer: Vec, u: Lane, v: Lane, which: Lane, factor: float
) -> tuple[Vec, Vec]:  # fmt: skip
    """(direction, weight) of the diffuse lobe `default` or of the lobe beside it, by their albedos; times a factor."""
    diffuse, lobe = ops.mean3(default[1]), factor * _chance(added, 0.0 * which, normal, to_viewer)
    total = diffuse + lobe
    takes_lobe = which * total >= diffuse
    direction, share = _sample(added, default, normal, to_viewer, u, v)
    scale = factor * total / ops.maximum(lobe, lights.TINY)
    has_lobe = _or_has(added, ops.bool_like(which, False))
    light = ops.scale(default[1], ops.where(has_lobe, total / ops.maximum(diffuse, lights.TINY), 1.0))
    takes_lobe = has_lobe & takes_lobe
    return ops.where3(takes_lobe, direction, default[0]), ops.where3(takes_lobe, ops.scale(share, scale), light)


sample_lobe = specialize_if_present(_sample)  # see there
sample_beside_diffuse = specialize_if_present(_sample_beside)  # see there
