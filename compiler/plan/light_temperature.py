"""The colour temperature of a scene's lights together, for white balance."""

from __future__ import annotations

import math

import numpy as np

from ...lang import colors
from ...lights import DISTANT, PICTURED, POINTS, SKIES, SURFACES
from .. import ir
from .scene_facts import extents

COLORED = 0.05  # distance of chromaticities x, y from that of a black body, beyond which light is coloured
TO_XYZ = np.array([[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]])


def of_lights(tables: ir.Tables) -> float:
    """Kelvin of the mean colour of all lights, each weighted by what it sheds on the middle of the scene; 0 without one.

    The temperature of the nearest black body by McCamy's formula (1992); 0 for colours far from all of them.
    """
    lights, reach = tables.lights, max(extents(tables)[0], 1e-3)
    if not len(lights.kind):
        return 0.0
    weight = np.zeros(len(lights.kind))
    weight[ir.is_in(lights.kind, POINTS)] = 1.0 / reach**2
    weight[ir.is_in(lights.kind, DISTANT)] = 1.0
    weight[ir.is_in(lights.kind, SKIES)] = math.pi
    wide, deep = lights.size[:, 0], np.where(lights.size[:, 1] > 0.0, lights.size[:, 1], lights.size[:, 0])
    area = ir.is_in(lights.kind, SURFACES)
    weight[area] = (4.0 * wide * deep / reach**2)[area]
    color = lights.color * weight[:, None]
    for row in np.flatnonzero(ir.is_in(lights.kind, PICTURED) & (lights.image >= 0)).tolist():
        image = int(lights.image[row])
        first, width, height = int(tables.images.first[image]), int(tables.images.width[image]), int(tables.images.height[image])
        rows = tables.images.texels[first : first + width * height, :3].reshape(height, width, 3).mean(axis=1)
        latitude = np.pi * (0.5 - (np.arange(height) + 0.5) / height)
        solid = np.cos(latitude) * ((latitude > 0.0) | (not rows[: height // 2].any()))  # what is below the horizon reflects this light
        color[row] *= (rows * solid[:, None]).sum(axis=0) / solid.sum()
    total = TO_XYZ @ color.sum(axis=0)
    if not total.sum() > 0.0:
        return 0.0
    x, y = total[:2] / total.sum()
    if y <= 0.1858 + 1e-3:
        return 0.0
    n = (x - 0.3320) / (0.1858 - y)
    kelvin = 449.0 * n**3 + 3525.0 * n**2 + 6823.3 * n + 5520.33
    low, high = colors.KELVIN_RANGE
    if not low <= kelvin <= high:
        return 0.0
    body = TO_XYZ @ np.array(colors.kelvin(float(kelvin)))
    near = math.hypot(x - body[0] / body.sum(), y - body[1] / body.sum()) <= COLORED
    return round(float(kelvin)) if near else 0.0
