"""Shapes of area lights that block other lights."""

from __future__ import annotations

import numpy as np

from ...lights import AMBIENT, PLACED, SPHERES, SURFACES
from ...materials import traits
from .. import ir
from ..ir import light_links


def blocking(tables: ir.Tables) -> np.ndarray:
    """(instances,) bool: shapes of lights that block light.

    None with a single light: no light blocks itself. Neither does a sphere around another light, nor a light without shadows. Strengths do
    not matter, so that all light groups cast the same shadows.
    """
    lights, instances = tables.lights, tables.instances
    blocks = (instances.light >= 0) & (instances.visible & ir.Visibility.SHADOW != 0)
    others = bool(traits.emissive(tables)[instances.material[instances.light < 0]].any())
    if int(np.sum(lights.shadows & ~ir.is_in(lights.kind, AMBIENT))) + others < 2:
        return np.zeros(len(blocks), bool)
    for row in np.flatnonzero(ir.is_in(lights.kind, SPHERES) & (lights.instance >= 0)).tolist():
        if _holds_another(tables, row):
            blocks[lights.instance[row]] = False
    return blocks


def _holds_another(tables: ir.Tables, row: int) -> bool:
    """Whether the sphere light `row` contains another light."""
    lights, transforms = tables.lights, tables.transforms
    area = ir.is_in(lights.kind, SURFACES)
    places = np.where(area[:, None], transforms.matrix[lights.transform, :, 3], lights.position)
    matrix = transforms.matrix[lights.transform[row]]
    radius = lights.size[row, 0] * np.linalg.norm(matrix[:, 0])
    inside = ir.is_in(lights.kind, PLACED) & (np.linalg.norm(places - matrix[:, 3], axis=1) < radius)
    inside[row] = False
    return bool(inside.any())


def let_through(tables: ir.Tables, blocks: bool) -> ir.Tables:
    """Tables where shadow rays ignore shapes of lights that do not block light; all shapes of lights without `blocks`."""
    instances = tables.instances
    casts = int(ir.Visibility.SHADOW) | light_links.ALL_SETS
    passed = (instances.light >= 0) & ~(blocking(tables) & blocks) & (instances.visible & casts != 0)
    if not passed.any():
        return tables
    visible = np.where(passed, instances.visible & ~casts, instances.visible)
    return tables._replace(instances=ir.table_of("instances", {**instances._asdict(), "visible": visible}))
