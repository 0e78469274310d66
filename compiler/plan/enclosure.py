"""Whether the camera stands in an enclosed space, and how many bounces of light it takes."""

from __future__ import annotations

import math

import numpy as np

from ...lang.schema.picture_settings import MAX_BOUNCES
from ...lights import AMBIENT
from ...materials import traits
from .. import ir
from . import sky_visibility

OPEN = 0.2  # share of all directions without a wall, above which a space counts as open: a box without a lid has 1/6
MATT = 0.1  # least share of all directions that show diffuse surfaces: in rooms of mirrors light does not come from these
LOST = 0.01  # of the light between the walls, that the bounces may leave out
LEAST, MOST = 8, MAX_BOUNCES  # bounces
RAYS_IN_MESH = 96  # to the triangles of a mesh, from inside of its box
MOST_TRIANGLES = 1 << 17  # of a mesh that is searched from inside of its box: a third of a second


def bounces(scene: ir.Scene, camera: int) -> tuple[int, str]:
    """(bounces that light between the walls around a camera takes, 0 in an open space; the reason)."""
    tables = scene.tables
    if not tables.instances.geometry.size:
        return 0, "there are no objects"
    diffuse = traits.diffuse(tables)
    if not diffuse[tables.instances.material].any():
        return 0, "no surface is diffuse"
    if ir.is_in(tables.lights.kind, AMBIENT).any():
        return 0, "ambient light stands for light that bounces"
    if len(tables.instances.geometry) > sky_visibility.MOST_OBJECTS:
        return 0, f"more than {sky_visibility.MOST_OBJECTS:,} objects are not searched for walls around the camera"
    walls = _walls(tables)
    eye = tables.transforms.matrix[tables.cameras.transform[camera], :, 3]
    escapes, row = _surroundings(tables, eye, walls)
    seen = float(np.mean(escapes))
    if seen > OPEN:
        return 0, f"the camera stands in the open: {100.0 * seen:.3g} % of all directions around it have no wall"
    shown = diffuse[tables.instances.material[row]] & ~escapes
    if float(np.mean(shown)) < MATT:
        return 0, f"diffuse surfaces fill {100.0 * float(np.mean(shown)):.2g} % of the view around the camera"
    albedo = float(np.mean(traits.albedo(tables)[tables.instances.material[row[~escapes]]]))
    needed = math.ceil(math.log(LOST) / math.log(min(max(albedo, 1e-3), 0.999))) - 1
    count = min(max(needed, LEAST), MOST)
    around = f"the camera stands in an enclosed space: {100.0 * (1.0 - seen):.3g} % of all directions around it have a wall"
    return count, f"{around}, and these reflect {100.0 * albedo:.2g} % of the light"


def _surroundings(tables: ir.Tables, eye: np.ndarray, walls: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """((n,) bool: directions without a wall, (n,) the instance that each shows): by boxes alone where these leave the space open."""
    directions = sky_visibility.even_directions(sky_visibility.RAYS)
    boxes, _ = sky_visibility.hits(tables, eye, directions, walls, exact=False)
    if float(np.mean(~np.isfinite(boxes))) > OPEN:
        return ~np.isfinite(boxes), np.zeros(len(boxes), np.int64)
    inside = [row for row in np.flatnonzero(walls).tolist() if _is_large_around(tables, row, eye)]
    some = sky_visibility.even_directions(RAYS_IN_MESH) if inside else directions
    reach, row = sky_visibility.hits(tables, eye, some, walls, round_too=True, large=tuple(inside))
    return ~np.isfinite(reach), row


def _is_large_around(tables: ir.Tables, row: int, eye: np.ndarray) -> bool:
    """Whether a place is in the box of a mesh that has too many triangles for all rays, but not for some."""
    g = int(tables.instances.geometry[row])
    if not sky_visibility.MOST_TRIANGLES < tables.geometries.triangle_count[g] <= MOST_TRIANGLES:
        return False
    inverse = tables.transforms.inverse[tables.instances.transform[row]]
    local, (low, high) = inverse[:, :3] @ eye + inverse[:, 3], tables.geometries.bounds[g]
    return bool(((local > low) & (local < high)).all())


def _walls(tables: ir.Tables) -> np.ndarray:
    """(instances,) bool: shapes that light does not pass: neither glass nor partly transparent, nor shapes of lights."""
    instances, clear = tables.instances, traits.passes_light(tables)
    return (instances.visible & ir.Visibility.SHADOW != 0) & (instances.light < 0) & ~clear[instances.material]
