"""Light and shadow links of USD lights: the collections lightLink and shadowLink of UsdLux's LightAPI."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from pxr import Sdf, Usd

from ...scene.link_sets import Links, Members

_LIGHTS, _SHADOWS = "lightLink", "shadowLink"


def of(prim: Any, prefix: str) -> Links | None:
    """The links of a light to the instances of its stage, whose names are `prefix` and the path of their prim; None for all.

    Instances outside of the stage are members where the root of the stage is.
    """
    links = Links(_members(prim, _LIGHTS, prefix), _members(prim, _SHADOWS, prefix))
    return links if links != Links() else None


def _members(prim: Any, name: str, prefix: str) -> Members | None:
    """The members of a collection; None where the prim says nothing about it."""
    if not any(given.IsAuthored() for given in prim.GetPropertiesInNamespace(f"collection:{name}")):
        return None
    query = Usd.CollectionAPI(prim, name).ComputeMembershipQuery()

    def members(names: Sequence[str]) -> np.ndarray:
        outside = bool(query.IsPathIncluded(Sdf.Path.absoluteRootPath))
        known: dict[str, bool] = {}
        for path in {instance.partition("[")[0] for instance in names}:
            own = path.removeprefix(prefix) if path.startswith(prefix) else ""
            inside = own.startswith("/") and Sdf.Path.IsValidPathString(own)
            known[path] = bool(query.IsPathIncluded(Sdf.Path(own))) if inside else outside
        return np.array([known[instance.partition("[")[0]] for instance in names], bool)

    return members
