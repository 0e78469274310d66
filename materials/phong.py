"""The course's Phong model: a diffuse lobe, and a highlight about the mirrored direction."""

from __future__ import annotations

from typing import Any

from ..compiler import ir
from . import classic
from .contract import Exported, Finish, Lobes, MitsubaRow, PovrayRow, SurfaceRow

MODEL = ir.MaterialModel.PHONG
ELEMENTS = (classic.element("phong", "Phong model (lobe R·V)", MODEL),)
LOBES, SLOTS, COLOR, REFLECTANCE, HALF_VECTOR = Lobes.CLASSIC, classic.SLOTS, ir.Slot.DIFFUSE, None, False
LOBE = facets = None
_SCALE = 4.0  # the angle to the half vector is half that to the mirrored direction: its cosine has four times the exponent


def surface(row: SurfaceRow) -> Exported:
    return classic.surface(row, _SCALE)


def mitsuba(row: MitsubaRow) -> Any:
    return classic.mitsuba(row, _SCALE)


def povray(row: PovrayRow) -> Finish:
    return classic.povray(row, ("phong", "phong_size"), float(row.value(ir.Slot.SHININESS)[0]))
