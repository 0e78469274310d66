"""Reads the light and shadow links of lights (UsdLux's LightAPI), and limits collections that include other collections."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdShade

from ...scene.link_sets import Links, Members
from .stage import Warnings

MAX_INCLUDES = 10_000  # of a collection: usd-core expands another one as often as it is included, which can grow without bound
_BINDINGS = "material:binding:collection"
_LIGHTS, _SHADOWS = "lightLink", "shadowLink"


def light_links(prim: Any, prefix: str, warnings: Warnings) -> Links | None:
    """The links of a light to the instances of its stage, whose names are `prefix` and the path of their prim; None for all.

    Instances outside of the stage are members where the root of the stage is.
    """
    links = Links(_members(prim, _LIGHTS, prefix, warnings), _members(prim, _SHADOWS, prefix, warnings))
    return links if links != Links() else None


def _members(prim: Any, name: str, prefix: str, warnings: Warnings) -> Members | None:
    """The members of a collection; None where the prim says nothing about it."""
    if not any(prop.IsAuthored() for prop in prim.GetPropertiesInNamespace(f"collection:{name}")):
        return None
    if why := _fault(prim.GetStage(), prim.GetPath().AppendProperty(f"collection:{name}")):
        warnings.tell(why, prim)
        return None
    query = Usd.CollectionAPI(prim, name).ComputeMembershipQuery()

    def members(names: Sequence[str]) -> np.ndarray:
        outside = bool(query.IsPathIncluded(Sdf.Path.absoluteRootPath))
        included: dict[str, bool] = {}
        for path in {instance.partition("[")[0] for instance in names}:
            stage_path = path.removeprefix(prefix) if path.startswith(prefix) else ""
            inside = stage_path.startswith("/") and Sdf.Path.IsValidPathString(stage_path)
            included[path] = bool(query.IsPathIncluded(Sdf.Path(stage_path))) if inside else outside
        return np.array([included[instance.partition("[")[0]] for instance in names], bool)

    return members


def _fault(stage: Any, path: Any) -> str:
    """Why usd-core must not expand a collection, "" for a sound one. `path` is that of the property `collection:name`."""
    try:
        if _count(stage, path, {}) <= MAX_INCLUDES:
            return ""
        others = f"others more than {MAX_INCLUDES:,} times"
    except (_Cycle, RecursionError):
        others = "itself by way of others"
    return f"the collection `{path}` includes {others}: it is left out"


def remove_bindings(prim: Any, warnings: Warnings) -> None:
    """Block the bindings of a prim to collections that must not be expanded, with a warning; no file changes."""
    if not prim.GetAuthoredPropertiesInNamespace(_BINDINGS):
        return
    api, stage = UsdShade.MaterialBindingAPI(prim), prim.GetStage()
    for purpose in (UsdShade.Tokens.allPurpose, UsdShade.Tokens.full, UsdShade.Tokens.preview):
        for relation in api.GetCollectionBindingRels(purpose):
            path = UsdShade.MaterialBindingAPI.CollectionBinding(relation).GetCollectionPath()
            if why := _fault(stage, path):
                warnings.tell(why, prim)
                with Usd.EditContext(stage, stage.GetSessionLayer()):
                    relation.SetTargets([])


class _Cycle(Exception):
    """A collection includes itself by way of others."""


def _count(stage: Any, path: Any, counts: dict[Any, int]) -> int:
    """How many collections the expansion of one expands. Raises _Cycle."""
    if path not in counts:
        counts[path] = -1
        relation = stage.GetRelationshipAtPath(Sdf.Path(f"{path}:includes"))
        targets = relation.GetTargets() if relation else ()
        others = [target for target in targets if Usd.CollectionAPI.IsCollectionAPIPath(target) and target != path]
        counts[path] = 1 + sum(_count(stage, target, counts) for target in others)
    if counts[path] < 0:
        raise _Cycle
    return counts[path]
