"""Lights as exporters write them: kind, colour, place, cone and fall-off. Says once, in one wording, what a format lacks of them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from ...lights import AMBIENT, LIGHTS, SKIES, SURFACES
from ...lights.contract import ExportedLight, Form
from .. import ir
from ..plan import scene_facts
from .export import Export
from .placement import F64, square


class LightFormat(NamedTuple):
    """What a format holds of lights."""

    program: str  # its name, for messages
    ambient: bool = False
    skies: bool = True
    extent: bool = True  # suns and area lights with a size
    unshadowed: bool = True
    constant: bool = False  # lights that do not fade with distance
    profiled: bool = True  # whether a light whose emission depends on the direction is written without that; otherwise it is left out
    lacking: str = ""  # why it has no skies, or no extent


def exported(out: Export, rows: Iterable[int], form: LightFormat) -> Iterator[ExportedLight]:
    """The lights in `rows` that a format holds. Reports the others, and what these lose."""
    lights, names = out.scene.tables.lights, out.scene.names.lights
    profiled = scene_facts.profiled(out.scene.tables)
    for row in rows:
        kind = ir.LightKind(int(lights.kind[row]))
        light_kind = LIGHTS[kind]
        name = (names[row] if row < len(names) else "") or kind.name.lower()
        if not _is_held(out, row, kind, form):
            continue
        if profiled[row]:
            out.cannot("a light whose emission depends on the direction is not carried", "lights", row)
            if not form.profiled:
                continue
        color, fades = lights.color[row], True
        if light_kind.FORM == Form.POINT:
            color, fades = _at_a_metre(out, row, form)
        if light_kind.HAS_ANGLE and lights.angle[row] > 0 and not form.extent:
            out.cannot(f"a sun's size is not carried: {form.lacking}", "lights", row, "angle: 0deg")
        cone, full = (float(np.arccos(np.clip(cosine[row], -1.0, 1.0))) for cosine in (lights.cos_cone, lights.cos_full))
        angle = float(lights.angle[row]) if light_kind.HAS_ANGLE else 0.0
        matrix = square(out.scene.tables.transforms.matrix[lights.transform[row]]) if light_kind.FORM >= Form.RECTANGLE else np.eye(4)
        yield ExportedLight(
            row, kind, name, color, lights.position[row], lights.direction[row], cone, full, angle, fades, matrix, lights.size[row]
        )


def _is_held(out: Export, row: int, kind: ir.LightKind, form: LightFormat) -> bool:
    """Whether a format holds a light of this kind at all; reports it if not."""
    lights = out.scene.tables.lights
    if kind in AMBIENT:
        if not form.ambient:
            out.cannot(f"ambient light is not carried: {form.program} has none", "lights", row)
        return form.ambient
    if not lights.shadows[row] and not form.unshadowed:
        out.cannot("a light without shadows is not carried", "lights", row)
    if kind in SKIES and not form.skies:
        out.cannot(f"a {kind.name.lower()} is not carried: {form.lacking}", "lights", row)
        return False
    if kind in SURFACES and not form.extent:
        out.cannot(f"an area light is not carried: {form.lacking}", "lights", row)
        return False
    return True


def _at_a_metre(out: Export, row: int, form: LightFormat) -> tuple[F64, bool]:
    """(the color of a point or spot light at 1 m, whether it fades by 1/d²); reports another fall-off."""
    lights = out.scene.tables.lights
    if lights.falloff[row] == ir.FalloffKind.INVERSE_SQUARE:
        return lights.color[row], True
    a, b, c = lights.coefficients[row]
    if lights.falloff[row] == ir.FalloffKind.POLYNOMIAL and a == b == 0.0:
        return lights.color[row] / c, True
    if lights.falloff[row] == ir.FalloffKind.POLYNOMIAL and b == c == 0.0 and form.constant:
        return lights.color[row] / a, False
    out.cannot("a fall-off other than 1/d² is not carried", "lights", row)
    return lights.color[row], True
