"""Materials of the parts of a solid: which part a point of the surface belongs to becomes the weight of a blend of materials.

As in POV-Ray, the surface takes the material of the part that it came from, and a part without one takes the solid's.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import NamedTuple

from ...lang.elements import Element
from .. import ir
from ..formula.builder import Builder
from ..formula.opcodes import Op
from ..formula.solid_fields import Point
from ..formula.tape import X, Y, Z
from ..scene.row_records import Input, MaterialData, TextureData
from .context import Context
from .patterns import MOST_OPERATIONS

EQUAL = 1e-9  # of a solid's size: surfaces this close coincide, and belong to the first part
Field = Callable[[Builder, Point], int]


class Looks(NamedTuple):
    """The materials of a solid's parts, and the share of each at a point of its frame. None: the material of the solid."""

    materials: tuple[Element | None, ...]
    shares: Callable[[Builder, Point], list[int]]

    def mapped(self, change: Callable[[Builder, Point], Point]) -> Looks:
        """These materials where `change` leads to their frame."""
        return self if len(self.materials) == 1 else Looks(self.materials, lambda b, point: self.shares(b, change(b, point)))

    def within(self, material: Element | None) -> Looks:
        """These materials in a solid of a material."""
        return Looks(tuple(look or material for look in self.materials), self.shares)


def only(material: Element | None) -> Looks:
    """One material all over."""
    return Looks((material,), lambda b, point: [b.constant(1.0)])


def nearest(parts: Sequence[tuple[Looks, Field]], size: float, over: float = 0.0) -> Looks:
    """The materials of parts, each where its field is the least; mixed where two fields differ by less than `over`."""
    materials = tuple({id(material): material for looks, _ in parts for material in looks.materials}.values())
    if len(materials) == 1:
        return only(materials[0])
    groups: list[tuple[Looks, list[Field]]] = []  # parts of one material are compared as one
    for looks, field in parts:
        same = next((fields for other, fields in groups if len(looks.materials) == 1 and other.materials == looks.materials), None)
        if same is None:
            groups.append((looks, [field]))
        else:
            same.append(field)

    def shares(b: Builder, point: Point) -> list[int]:
        least, totals = -1, [b.constant(0.0)] * len(materials)
        for k, (looks, fields) in enumerate(groups):
            mine = dict(zip(map(id, looks.materials), looks.shares(b, point), strict=True))
            weights = [mine.get(id(material), b.constant(0.0)) for material in materials]
            field = b.reduce(Op.MIN, [make(b, point) for make in fields])
            if k:
                later = b.subtract(least, field)
                totals = [_mixed(b, later, over, EQUAL * size, *pair) for pair in zip(totals, weights, strict=True)]
                field = b.op(Op.MIN, least, field)
            else:
                totals = weights
            least = field
        return totals

    return Looks(materials, shares)


def _mixed(b: Builder, later: int, over: float, slack: float, first: int, second: int) -> int:
    """The first value where `later` is negative, the second where it is positive."""
    if first == second:
        return first
    if not over:
        return b.op(Op.CHOOSE, b.offset(later, -slack), first, second)
    share = b.op(Op.MAX, b.op(Op.MIN, b.linear([(0.5 / over, later)], 0.5), b.constant(1.0)), b.constant(0.0))
    return b.add(first, b.multiply(share, b.subtract(second, first)))


def interpolated(parts: Sequence[Looks], weights: Sequence[float]) -> Looks:
    """The materials of parts, mixed by constant weights."""
    materials = tuple({id(material): material for looks in parts for material in looks.materials}.values())
    if len(materials) == 1:
        return only(materials[0])

    def shares(b: Builder, point: Point) -> list[int]:
        shares_of = [dict(zip(map(id, looks.materials), looks.shares(b, point), strict=True)) for looks in parts]
        return [
            b.linear([(weight, mine[id(material)]) for weight, mine in zip(weights, shares_of, strict=True) if id(material) in mine])
            for material in materials
        ]

    return Looks(materials, shares)


def row(lowering: Context, element: Element, looks: Looks, default: int) -> int:
    """The row of the material of a solid, whose own one is row `default`, or -1."""
    if len(looks.materials) > 1:
        _refuse_what_blends_lack(lowering, looks)
    builder = Builder()
    by_row: dict[int, list[int]] = {}
    for material, share in zip(looks.materials, looks.shares(builder, (X, Y, Z)), strict=True):
        material_row = default if material is None else lowering.materials.row(material)
        by_row.setdefault(lowering.builder.default_material() if material_row < 0 else material_row, []).append(share)
    (mixed, first), *others = [(number, functools.reduce(builder.add, shares)) for number, shares in by_row.items()]
    for number, share in others:
        first = builder.add(first, share)
        weight = share if number == others[-1][0] else builder.op(Op.DIVIDE, share, builder.op(Op.MAX, first, builder.constant(1e-9)))
        tape = builder.finish(weight)
        if len(tape.code) > MOST_OPERATIONS:
            message = f"the parts of this solid take {len(tape.code)} operations to tell apart: {MOST_OPERATIONS} at the most"
            lowering.error(element, message, "give one material to the solid, or draw some parts beside it")
            return default
        texture = lowering.builder.texture(
            TextureData(ir.TextureKind.FORMULA, tape=lowering.builder.tape(tape), channel=-1), element.place
        )
        inside = lowering.materials.inside_of_parts(element, mixed, number)
        weight_of = {ir.Slot.WEIGHT: Input.number(1.0, texture)}
        data = MaterialData(ir.MaterialModel.BLEND, weight_of, first=mixed, second=number, medium=inside)
        mixed = lowering.builder.material(data, element.place)
    return mixed


def _refuse_what_blends_lack(lowering: Context, looks: Looks) -> None:
    for material in looks.materials:
        if material is not None and material.args.get("opacity", 1.0) != 1.0:
            lowering.error(material, "materials of a solid's parts have no opacity of their own", "give all parts one material")
        if material is not None and material.args.get("shading") == "gouraud":
            message = "light of a solid's parts is computed at points, not at vertices"
            lowering.error(material, message, 'leave out `shading: "gouraud"`')
