"""Selects one level of detail below each LODRootAPI: the index of a LODOverrideAPI, else lod:default:index."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

import math
from typing import Any

from pxr import Usd, UsdGeom

from . import stage

Override = float | str | None  # an index, "noLOD" or "allLOD"; None: no override


def override(prim: Any, above: Override, time: Any) -> Override:
    """The override at a prim whose parent has that of `above`."""
    if not prim.HasAPI("LODOverrideAPI"):
        return above
    mode = str(stage.value(prim.GetAttribute("lod:override:mode"), time))
    if mode == "indexedLOD":
        return stage.number(prim.GetAttribute("lod:override:index"), time)
    return mode if mode in ("noLOD", "allLOD") else None if mode == "noOverride" else above


def inherited(prim: Any, time: Any) -> Override:
    """The override that the ancestors of a prim give it."""
    current: Override = None
    for path in prim.GetPath().GetPrefixes()[:-1]:
        current = override(prim.GetStage().GetPrimAtPath(path), current, time)
    return current


def children(prim: Any, forced: Override, time: Any) -> list[Any]:
    """The children of a prim to traverse: of an LODRootAPI one item, or none or all if the override says so.

    Items are the children that may hold geometry. Indices are rounded and clamped to the items. Heuristics, by which a renderer may
    select another item for each camera, are not used.
    """
    prims = prim.GetFilteredChildren(Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate))
    if not prims or not prim.HasAPI("LODRootAPI") or forced == "allLOD":
        return prims
    items = [child for child in prims if not child.GetTypeName() or child.IsA(UsdGeom.Imageable)]
    if forced == "noLOD" or not items:
        return []
    index = stage.number(prim.GetAttribute("lod:default:index"), time) if forced is None else float(forced)
    index = index if math.isfinite(index) else 0.0
    return [items[min(max(math.floor(index + 0.5), 0), len(items) - 1)]]
