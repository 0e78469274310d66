"""Estimates the number of prims of a stage before it is opened: references that reference twice grow without bound."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

from typing import Any

from pxr import Sdf

MAX_PRIMS = 4_000_000
_DEEP = 6  # levels of references from which prims are counted: fewer levels cannot hide so many prims in small files


def estimate(root: Any) -> int:
    """The prims of the stage of a layer, about: variants count by their largest; 0 if few levels of layers reference each other.

    Layers and prims that are referenced many times are counted once and multiplied.
    """
    depths: dict[str, int] = {}
    if _depth(root, depths, set()) < _DEEP:
        return 0
    return _Counter().layer(root)


def _depth(layer: Any, known: dict[str, int], above: set[str]) -> int:
    """Levels of layers below a layer; a layer that depends on itself ends there."""
    name = layer.identifier
    if name in above or name in known:
        return known.get(name, 0)
    below = 0
    for path in layer.GetCompositionAssetDependencies():
        other = _opened(layer, path)
        if other is not None:
            below = max(below, _depth(other, known, above | {name}))
    known[name] = below + 1
    return below + 1


def _opened(layer: Any, path: str) -> Any:
    try:
        return Sdf.Layer.FindOrOpenRelativeToLayer(layer, path) if path else layer
    except Exception:  # usd-core reports it when the stage is opened
        return None


class _Counter:
    """Counts prims below prim specs, each once."""

    def __init__(self) -> None:
        self._known: dict[tuple[str, str], int] = {}

    def layer(self, layer: Any) -> int:
        below = [_opened(layer, path) for path in layer.subLayerPaths]
        return sum(self.spec(spec) for spec in layer.rootPrims) + sum(self.layer(one) for one in below if one is not None)

    def spec(self, spec: Any) -> int:
        """Prims of a prim spec, with those that it references."""
        key = (spec.layer.identifier, str(spec.path))
        if key in self._known:
            return self._known[key]
        self._known[key] = 0  # a circle of references counts as nothing
        total = 1 + sum(map(self.spec, spec.nameChildren))
        for variants in spec.variantSets.values():
            total += max((self.spec(variant.primSpec) for variant in variants.variants.values()), default=0)
        if not spec.instanceable:
            arcs = [*spec.referenceList.GetAddedOrExplicitItems(), *spec.payloadList.GetAddedOrExplicitItems()]
            total += sum(self._target(spec, arc) for arc in arcs)
        self._known[key] = total
        return total

    def _target(self, spec: Any, arc: Any) -> int:
        layer = _opened(spec.layer, arc.assetPath)
        if layer is None:
            return 0
        path = arc.primPath if arc.primPath else Sdf.Path.absoluteRootPath.AppendChild(layer.defaultPrim) if layer.defaultPrim else None
        found = layer.GetPrimAtPath(path) if path else None
        return self.spec(found) if found else 0
