"""Media around the camera and around lights: the closed shapes that they stand inside of."""

from __future__ import annotations

import numpy as np

from ...compiler import ir
from ...materials import traits
from ..accel import intersect
from ..surface import interaction
from ..types import Ray

WAY = (0.3141, 0.8867, 0.3394)  # of the ray that counts boundaries: along no axis
MOST = 256  # boundaries that it passes


def around(tables: ir.Tables, camera: int) -> tuple[int, ...]:
    """The materials of the shapes with media around a camera, the outermost first."""
    if not traits.participates(tables):
        return ()
    bounds_medium = (tables.materials.medium >= 0) | traits.participating(tables)
    return around_place(tables, bounds_medium, tables.transforms.matrix[tables.cameras.transform[camera], :, 3])


def around_place(tables: ir.Tables, bounds_medium: np.ndarray, eye: np.ndarray) -> tuple[int, ...]:
    """The materials of the shapes around a point, the outermost first, of those materials (n,) that bound media."""
    bounding = ir.Instances(*(column[bounds_medium[tables.instances.material]] for column in tables.instances))
    if not len(bounding.geometry):
        return ()
    tables = tables._replace(instances=bounding)
    way = np.array(WAY) / np.linalg.norm(WAY)
    ones = np.ones(1)
    origin, direction = tuple(ones * x for x in eye), tuple(ones * x for x in way)
    near, entered, holding = 0.0 * ones, [0] * len(tables.materials.model), []
    for _ in range(MOST):
        ray = Ray(origin, direction, near, ones * np.inf, None)
        hit = intersect.closest_hit(intersect.Brute(), tables, ray, np.ones(1, bool), int(ir.Visibility.REFLECTION))
        if hit.instance[0] < 0:
            break
        point = interaction.make_interaction(tables, ray, hit)
        material = int(bounding.material[hit.instance[0]])
        if bool(point.front[0]):
            entered[material] += 1
        elif entered[material]:
            entered[material] -= 1
        else:
            holding.append(material)
        near = np.maximum(intersect.next_t_min(tables, ray, hit), np.nextafter(hit.t, np.inf)) * (1.0 + 1e-9)
    return tuple(reversed(holding))
