"""Participating media of materials, for formats that carry some of them, and the losses of the others."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from ...materials import losses
from ..scene.row_records import MediumData, as_color
from .export import Export


def medium_of(out: Export, material: int) -> MediumData | None:
    """The homogeneous medium inside of a material's shapes; None without one, or after a report of one with a formula."""
    media, row = out.scene.tables.media, int(out.scene.tables.materials.medium[material])
    if row < 0:
        return None
    if media.density[row] >= 0:
        out.cannot(losses.DENSITY, "media", row)
        return None
    if media.emission[row].max() > 0.0:
        out.cannot(losses.MEDIUM_EMISSION, "media", row)
    if media.draine[row, 3] > 0.0:
        out.cannot(losses.PHASE, "media", row)
    if media.priority[row] > 0.0:
        out.cannot(losses.PRIORITY, "media", row)
    return MediumData(as_color(media.scattering[row]), as_color(media.absorption[row]), anisotropy=float(media.anisotropy[row]))


def without_media(out: Export, carrying: Collection[int] = ()) -> None:
    """Report the media of a scene for a format that has them inside of materials of the models `carrying` alone.

    Bodies have a report of their own.
    """
    m = out.scene.tables.materials
    for material in np.unique(out.scene.tables.instances.material).tolist():
        if m.model[material] in carrying:
            medium_of(out, material)
        elif m.medium[material] >= 0 and not out.bodies[material]:
            out.cannot(losses.MEDIUM, "media", int(m.medium[material]))
    without_fog(out)


def without_fog(out: Export) -> None:
    """Report the fog of a scene."""
    for row in np.flatnonzero(out.scene.tables.media.everywhere).tolist():
        out.cannot(losses.FOG, "media", row)
