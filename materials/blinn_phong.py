"""The course's Blinn-Phong model: a diffuse lobe, and a highlight about the half vector."""

from __future__ import annotations

from typing import Any

from ..compiler import ir
from . import classic
from .contract import Exported, Finish, Lobes, MitsubaRow, PovrayRow, SurfaceRow

MODEL = ir.MaterialModel.BLINN_PHONG
ELEMENTS = (classic.element("blinn_phong", "Blinn-Phong model (lobe N·H)", MODEL),)
LOBES, SLOTS, COLOR, REFLECTANCE, HALF_VECTOR = Lobes.CLASSIC, classic.SLOTS, ir.Slot.DIFFUSE, None, True
LOBE = facets = None
_SCALE = 1.0


def surface(row: SurfaceRow) -> Exported:
    return classic.surface(row, _SCALE)


def mitsuba(row: MitsubaRow) -> Any:
    return classic.mitsuba(row, _SCALE)


def povray(row: PovrayRow) -> Finish:
    return classic.povray(row, ("specular", "roughness"), 1.0 / max(float(row.value(ir.Slot.SHININESS)[0]), 1e-6))
