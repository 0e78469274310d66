"""Estimates the number of prims of a stage before it is opened, so that references that multiply without bound are refused."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

from pxr import Sdf

from . import spec_tree
from .spec_tree import SpecTree

MAX_PRIMS = 4_000_000  # of a stage; once it is open, those of every instance are counted
MAX_STAGE_LEVELS = 4000  # of prims in prims; usd-core takes quadratic time
MAX_CHAIN = 120  # references that lead from one to the next; usd-core takes quadratic time


class Extent(NamedTuple):
    """The size of a hierarchy of prims."""

    prims: int
    levels: int


class TooLongChain(Exception):
    """References lead from one to the next more than MAX_CHAIN times."""


def estimate(root: Any, trees: dict[str, SpecTree]) -> Extent:
    """The extent of the stage of a layer, about; (0, 0) without composition arcs. `trees` are those that were read, by layer.

    Variants count by the largest of a set, instances as one prim. Prims that are referenced many times are counted once and multiplied.
    Raises TooLongChain.
    """
    counter = _Counter(trees)
    if not any(counter.tree(layer).arcs for layer in counter.stack(root)):
        return Extent(0, 0)
    try:
        return counter.extent(root, spec_tree.ROOT)
    except RecursionError:
        return Extent(0, MAX_STAGE_LEVELS + 1)


@dataclass(slots=True)
class _Sums:
    """Sums of the specs of a layer without arcs. `parts` are the children of a spec that have some, or below which some have."""

    prims: list[int]
    levels: list[int]
    parts: dict[int, list[int]] = field(default_factory=dict)


def _sums(tree: SpecTree) -> _Sums:
    prims = [int(kind is Sdf.PrimSpec) for kind in tree.kinds]
    sums = _Sums(prims, list(prims))
    for row in range(len(prims) - 1, 0, -1):
        parent = tree.parents[row]
        if row in tree.arcs or row in sums.parts:
            sums.parts.setdefault(parent, []).append(row)
        elif tree.kinds[parent] is Sdf.VariantSetSpec:
            prims[parent] = max(prims[parent], prims[row])
        else:
            prims[parent] += prims[row]
        is_prim = int(tree.kinds[parent] is Sdf.PrimSpec)
        sums.levels[parent] = max(sums.levels[parent], sums.levels[row] + is_prim)
    return sums


class _Counter:
    """Counts the prims below paths of layers, each path once."""

    def __init__(self, trees: dict[str, SpecTree]) -> None:
        self._trees = trees
        self._sums: dict[str, _Sums] = {}
        self._stacks: dict[str, list[Any]] = {}
        self._known: dict[tuple[str, Any], Extent] = {}
        self._chains: dict[tuple[str, Any], int] = {}  # paths from one to the next, from each path on
        self._longest = 0  # of those that the path leads to that is being counted
        self._depth = 0  # paths that are being counted

    def tree(self, layer: Any) -> SpecTree:
        if layer.identifier not in self._trees:
            self._trees[layer.identifier] = spec_tree.read(layer)
        return self._trees[layer.identifier]

    def sums(self, layer: Any) -> _Sums:
        if layer.identifier not in self._sums:
            self._sums[layer.identifier] = _sums(self.tree(layer))
        return self._sums[layer.identifier]

    def stack(self, layer: Any) -> list[Any]:
        """A layer with its sublayers, and theirs."""
        if layer.identifier not in self._stacks:
            layers, waiting = {}, [layer]
            while waiting:
                current = waiting.pop()
                if current is not None and current.identifier not in layers:
                    layers[current.identifier] = current
                    waiting += [_opened(current, path) for path in current.subLayerPaths]
            self._stacks[layer.identifier] = list(layers.values())
        return self._stacks[layer.identifier]

    def extent(self, top: Any, path: Any) -> Extent:
        """The extent of the prim at a path of a layer and its sublayers; (0, 0) if there is none, and in a cycle. Raises TooLongChain."""
        key = (top.identifier, path)
        if key not in self._known:
            self._known[key], self._chains[key] = Extent(0, 0), 0
            others, self._longest, self._depth = self._longest, 0, self._depth + 1
            if self._depth > MAX_CHAIN:
                raise TooLongChain
            specs = [(layer, row) for layer in self.stack(top) if (row := self.tree(layer).rows.get(path)) is not None]
            extents = [self._spec(top, layer, row) for layer, row in specs]
            local_prims = max((self.sums(layer).prims[row] for layer, row in specs), default=0)  # many layers may hold opinions on one prim
            prims = local_prims + sum(extent.prims for extent in extents)
            self._known[key] = Extent(prims, max((extent.levels for extent in extents), default=0))
            self._chains[key] = self._longest + 1
            self._longest, self._depth = others, self._depth - 1
        self._longest = max(self._longest, self._chains[key])
        if self._longest > MAX_CHAIN:
            raise TooLongChain
        return self._known[key]

    def _spec(self, top: Any, layer: Any, row: int) -> Extent:
        """The extent of what a spec composes: the prims of its arcs and parts, without those in `_Sums.prims`."""
        tree, sums = self.tree(layer), self.sums(layer)
        is_prim = int(tree.kinds[row] is Sdf.PrimSpec)
        parts = [(part, self._spec(top, layer, part)) for part in sums.parts.get(row, ())]
        each = [sums.prims[part] + below.prims for part, below in parts]
        targets = [self._target(top, layer, arc) for arc in tree.arcs.get(row, ())]
        below_targets = (is_prim - 1 + target.levels for target in targets)
        levels = max([sums.levels[row], *(is_prim + below.levels for _, below in parts), *below_targets])
        prims = max(each, default=0) if tree.kinds[row] is Sdf.VariantSetSpec else sum(each)
        return Extent(prims + (0 if row in tree.instanceable else sum(target.prims for target in targets)), levels)

    def _target(self, top: Any, layer: Any, arc: tuple[str, Any]) -> Extent:
        asset, path = arc
        other = _opened(layer, asset) if asset else top
        if other is None:
            return Extent(0, 0)
        if not path:
            path = spec_tree.ROOT.AppendChild(other.defaultPrim) if other.defaultPrim else spec_tree.ROOT
        return self.extent(other, path)


def _opened(layer: Any, path: str) -> Any:
    try:
        return Sdf.Layer.FindOrOpenRelativeToLayer(layer, path)
    except Exception:  # usd-core reports it when the stage is opened
        return None
