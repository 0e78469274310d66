"""A mix of two materials, the second weighted by WEIGHT: each sample has one of them, at random (render/surface/blend.py)."""

from __future__ import annotations

from typing import Any

from ..compiler import ir
from ..compiler.scene.row_records import MaterialData
from ..lang.schema.argument_types import REQUIRED, Arg, Entry
from .arguments import OPACITY
from .contract import Arguments, Element, Lobes, MitsubaRow

MODEL = ir.MaterialModel.BLEND


def _lower(arguments: Arguments) -> MaterialData:
    """A blend of two opaque materials, shaded at points."""
    rows = [arguments.part(name) for name in ("first", "second")]
    flat = all(arguments.args[name].args.get("shading") == "flat" for name in ("first", "second"))
    shading = ir.Shading.FLAT if flat else ir.Shading.SMOOTH
    return MaterialData(MODEL, {ir.Slot.WEIGHT: arguments.number("weight")}, shading, first=rows[0], second=rows[1])


ELEMENTS = (
    Element(
        Entry(
            "blend",
            "material",
            "a mix of two materials",
            (
                Arg("first", "material", REQUIRED, "the material at weight 0"),
                Arg("second", "material", REQUIRED, "the material at weight 1"),
                Arg("weight", "number_map", 0.5, "weight of the second material", minimum=0.0, maximum=1.0),
                *OPACITY,
            ),
            example='sphere(1, material: blend(metal("copper"), lambert(#5a9a80), pattern(|x, y, z| smoothstep(-0.2, 0.2, y))))',
        ),
        _lower,
    ),
)
LOBES, SLOTS, COLOR, REFLECTANCE, HALF_VECTOR = Lobes.PARTS, (ir.Slot.WEIGHT,), None, None, False
LOBE = facets = surface = povray = None


def mitsuba(row: MitsubaRow) -> Any:
    first, second = row.parts()
    return row.bsdf("blendbsdf", row.number("weight", ir.Slot.WEIGHT), first, second)
