"""Facts of light links: which lights light some surfaces only, or have shadows of some instances only."""

from __future__ import annotations

import numpy as np

from .kinds import Visibility
from .tables import Tables

FIRST_SET = 1 << 5  # bits of Instances.visible from this one on are sets of instances; lower ones are Visibility and those of kernels
MOST_SETS = 26
ALL_SETS = sum(FIRST_SET << k for k in range(MOST_SETS))
EVERYTHING = -1  # receivers of a light that lights every surface
CASTERS = int(Visibility.SHADOW)  # blockers of a light whose shadows every shadow caster casts


def selective(tables: Tables) -> np.ndarray:
    """(lights,) bool: lights in whose light not every shadow caster casts shadows."""
    return tables.lights.blockers != CASTERS


def are_there(tables: Tables) -> bool:
    """Whether any light has links."""
    return bool(((tables.lights.receivers != EVERYTHING) | selective(tables)).any())


def casts_unevenly(tables: Tables) -> np.ndarray:
    """(instances,) bool: instances that cast shadows in the light of some lights and not of others; none without light links."""
    visible, masks = tables.instances.visible, set(tables.lights.blockers.tolist()) | {CASTERS}
    casts = np.array([(visible & mask) != 0 for mask in sorted(masks)])
    return np.logical_and(casts.any(axis=0), ~casts.all(axis=0))
