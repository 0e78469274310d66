"""Whether groups of pixels can share their paths beyond the first surface (render/integrator/path_reuse.py)."""

from __future__ import annotations

import numpy as np

from ...lights import SKIES
from ...materials import traits
from .. import ir
from ..ir import light_links
from .decision import Plan

SHARED = ("groups", "none")
LEAST_DIFFUSE = 0.5  # share of the surface area with a diffuse lobe, from which on paths are shared
MANY = 64  # lights, from which on most noise comes from the choice of a light at the first surface


def by_groups(tables: ir.Tables, plan: Plan) -> tuple[str, str, tuple[str, ...]]:
    """(value, reason, choices) of the decision."""
    why, share = "", diffuse_share(tables)
    if plan["transport"] != "path":
        why = "there are no random paths"
    elif plan["backend"] != "ray":
        why = "the reference backend traces each path by itself"
    elif traits.participates(tables):
        why = "light scatters inside of media, where paths are not shared"
    elif plan["motion_blur"]:
        why = "each path has its own time"
    elif is_barred(tables):
        why = "some surface is partly transparent, shaded at vertices or hidden from other surfaces"
    elif share < LEAST_DIFFUSE:
        why = f"{100.0 * share:.2g} % of the surface area has a diffuse lobe: other light depends on the direction"
    elif light_links.are_there(tables):
        why = "some light lights some surfaces only: paths count for the surface that they leave"
    elif ir.is_in(tables.lights.kind, SKIES).any() and not plan["indoors"]:
        why = "outdoors most noise comes from the light samples of first surfaces"
    elif len(tables.lights.kind) > MANY:
        why = "there are many lights: most noise comes from the choice of one at the first surface"
    if why:
        return "none", why, SHARED[1:]
    figure = f"{100.0 * share:.3g} % of the surface area has a diffuse lobe"
    return "groups", f"{figure}: groups of 16 pixels share their paths beyond the first surface", SHARED


def is_barred(tables: ir.Tables) -> bool:
    """Whether some surface is partly transparent, shaded at vertices or hidden from rays of other surfaces."""
    instances = tables.instances
    barred = (tables.materials.shading == ir.Shading.GOURAUD) | traits.partial(tables)
    seen = instances.visible & ir.Visibility.REFLECTION != 0
    return bool((barred[instances.material] | ~seen).any())


def diffuse_share(tables: ir.Tables) -> float:
    """The share of the area of all instances' boxes whose materials have a diffuse lobe, 0 to 1."""
    instances, diffuse = tables.instances, traits.mostly_diffuse(tables)
    bounds = tables.geometries.bounds[instances.geometry]
    with np.errstate(invalid="ignore", over="ignore"):
        scale = np.linalg.norm(tables.transforms.matrix[instances.transform][:, :, :3], axis=1)
        x, y, z = ((bounds[:, 1] - bounds[:, 0]) * scale).T
        area = x * y + y * z + z * x
    finite = np.isfinite(area)
    area = np.where(finite, area, max(float(area[finite].sum()), 1.0))  # unbounded planes count as all others together
    lit = instances.light < 0
    return float((area * diffuse[instances.material])[lit].sum() / max(float(area[lit].sum()), 1e-30))
