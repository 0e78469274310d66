"""What both workflows of `principled` share: microfacets over a diffuse base, under a clear coat and sheen, as UsdPreviewSurface has."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..compiler import ir
from ..compiler.scene.row_records import Input
from . import losses
from .contract import Exported, Finish, MitsubaRow, PovrayRow, SurfaceRow

SLOTS = (
    ir.Slot.AMBIENT, ir.Slot.DIFFUSE, ir.Slot.ROUGHNESS, ir.Slot.IOR, ir.Slot.METALLIC, ir.Slot.COAT, ir.Slot.COAT_ROUGHNESS,
    ir.Slot.SHEEN, ir.Slot.SHEEN_ROUGHNESS, ir.Slot.TRANSMISSION, ir.Slot.EMISSION,
)  # fmt: skip


def surface(row: SurfaceRow, metallic: Input, specular: Input | None = None) -> Exported:
    """A surface with all layers."""
    transmission = float(row.value(ir.Slot.TRANSMISSION).max())
    layers = row.surface(
        row.input(ir.Slot.DIFFUSE), metallic, row.input(ir.Slot.ROUGHNESS), row.ior, specular=specular,
        emissive=row.input(ir.Slot.EMISSION), coat=row.input(ir.Slot.COAT), coat_roughness=row.input(ir.Slot.COAT_ROUGHNESS),
        sheen=row.input(ir.Slot.SHEEN), sheen_roughness=row.input(ir.Slot.SHEEN_ROUGHNESS), occlusion=row.input(ir.Slot.AMBIENT),
        transmission=transmission,
    )  # fmt: skip
    return Exported(layers)


def mitsuba(row: MitsubaRow) -> Any:
    """Mitsuba's `principled`, whose diffuse base and coat are others."""
    row.cannot("`principled` is carried as Mitsuba's, whose diffuse base and coat are others")
    if row.value(ir.Slot.SHEEN).any():
        row.cannot(losses.SHEEN)
    gloss = 1.0 - float(row.value(ir.Slot.COAT_ROUGHNESS)[0])
    inputs = (
        row.color("base_color", ir.Slot.DIFFUSE), row.number("roughness", ir.Slot.ROUGHNESS), row.number("metallic", ir.Slot.METALLIC),
        row.constant("clearcoat_gloss", gloss),
    )  # fmt: skip
    eta, coat = float(np.clip(row.value(ir.Slot.IOR)[0], 1.01, 2.0)), float(row.value(ir.Slot.COAT)[0])
    return row.two_sided(row.bsdf("principled", *inputs, eta=eta, clearcoat=coat))


def povray(row: PovrayRow) -> Finish:
    """A diffuse base beside a mirror of the same colour, weighted by METALLIC."""
    metallic = float(np.clip(row.value(ir.Slot.METALLIC)[0], 0.0, 1.0))
    row.cannot(losses.FACETS, "lambert(…), phong(…) or mirror(…) are")
    if row.value(ir.Slot.COAT)[0] > 0:
        row.cannot(losses.COAT)
    if row.value(ir.Slot.SHEEN).any():
        row.cannot(losses.SHEEN)
    if row.value(ir.Slot.EMISSION).max() > 0:
        row.cannot(losses.EMISSION)
    words = [f"diffuse {row.numeral(1.0 - metallic)}", f"ambient rgb <{row.vector((1.0 - metallic) * row.ambient)}>"]
    if metallic > 0.0 and row.bounces > 0:
        words.append(f"reflection {{ rgb {row.numeral(metallic)} metallic 1 }}")
    return Finish(ir.Slot.DIFFUSE, " ".join(words))
