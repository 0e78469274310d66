"""Daylight factors: the illuminance of meters under the CIE overcast sky over that of an unobstructed level plane."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...compiler import ir
from ...lang.diagnostics import Diagnostic
from . import illuminance
from .replicates import Effort

ZENITH = 9000.0  # nit: its amount has no effect
HEIGHT = 512  # texels of the sky's image from pole to pole
UNOBSTRUCTED = 7.0 / 9.0 * math.pi * ZENITH  # lux on a level plane


def read(scene: ir.Scene, meters: Sequence[ir.Meter], effort: Effort) -> tuple[list[illuminance.Reading], list[Diagnostic]]:
    """The readings of meters as daylight factors, shares of 1, and warnings. Raises sensors.MeterError."""
    readings, notes = illuminance.read(under_overcast_sky(scene), meters, effort)
    return [reading.over(UNOBSTRUCTED) for reading in readings], notes


def under_overcast_sky(scene: ir.Scene) -> ir.Scene:
    """The scene with the CIE overcast sky as its only light: L = L_zenith (1 + 2 sin γ)/3 at the altitude γ (CIE S 011, type 1)."""
    tables = scene.tables
    altitude = math.pi * (0.5 - (np.arange(HEIGHT) + 0.5) / HEIGHT)
    sky = np.where(altitude > 0.0, (1.0 + 2.0 * np.sin(altitude)) / 3.0, 0.0)
    texels = np.ones((HEIGHT, 2 * HEIGHT, 4), np.float32)
    texels[..., :3] = sky[:, None, None]
    before = tables.images
    images = ir.table_of("images", {
        "first": [*before.first, len(before.texels)], "width": [*before.width, 2 * HEIGHT], "height": [*before.height, HEIGHT],
        "texels": np.concatenate([before.texels, texels.reshape(-1, 4)]),
    })  # fmt: skip
    lights = ir.table_of("lights", {
        "kind": [ir.LightKind.DOME], "color": [[ZENITH] * 3], "position": np.zeros((1, 3)), "direction": [[0.0, 1.0, 0.0]],
        "transform": [0], "size": np.zeros((1, 2)), "cos_cone": [-1.0], "cos_full": [-1.0], "angle": [0.0],
        "falloff": [ir.FalloffKind.INVERSE_SQUARE], "coefficients": np.zeros((1, 3)), "image": [len(before.first)], "instance": [-1],
        "shadows": [True], "receivers": [-1], "blockers": [ir.Visibility.SHADOW],
    })  # fmt: skip
    values = tables.materials.values.copy()
    values[:, ir.Slot.EMISSION] = 0.0  # lamps are off, and block light
    instances = tables.instances._replace(light=np.full_like(tables.instances.light, -1))
    tables = tables._replace(images=images, lights=lights, materials=tables.materials._replace(values=values), instances=instances)
    spans = replace(scene.spans, rows={table: rows for table, rows in scene.spans.rows.items() if table != "lights"})
    names = replace(scene.names, lights=("overcast sky",), images=(*scene.names.images, "overcast sky"), groups=())
    return replace(scene, tables=tables, names=names, spans=spans, settings=replace(scene.settings, background=None))
