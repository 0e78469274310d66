"""Reads the prim and variant specs of a layer, their composition arcs, and the paths of missing specs."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from pxr import Sdf, Tf

ROOT = Sdf.Path.absoluteRootPath
REFUSED = (Tf.ErrorException, TypeError, ValueError)  # ValueError: names that are not UTF-8
CHILDREN = {  # fields that list children: the path of a child, and its type
    "primChildren": (lambda path, name: path.AppendChild(name), Sdf.PrimSpec),
    "properties": (lambda path, name: path.AppendProperty(name), Sdf.PropertySpec),
    "variantSetChildren": (lambda path, name: path.AppendVariantSelection(name, ""), Sdf.VariantSetSpec),
    "variantChildren": (
        lambda path, name: path.GetParentPath().AppendVariantSelection(path.GetVariantSelection()[0], name), Sdf.VariantSpec,
    ),
}  # fmt: skip
_FIELDS = ("primChildren", "variantSetChildren", "variantChildren")
_ARCS = ("references", "payload", "inheritPaths", "specializes")  # fields of composition arcs


@dataclass(slots=True)
class SpecTree:
    """The prim, variant set and variant specs of a layer, parents before their children."""

    rows: dict[Any, int] = field(default_factory=dict)  # by path
    parents: list[int] = field(default_factory=list)
    kinds: list[type] = field(default_factory=list)
    arcs: dict[int, list[tuple[str, Any]]] = field(default_factory=dict)  # composition arcs of a spec: (layer, "" for the same; path)
    instanceable: set[int] = field(default_factory=set)
    clips: list[Any] = field(default_factory=list)  # paths of prims with value clips
    missing: list[Any] = field(default_factory=list)  # paths that are listed and not there, listed twice, or whose lists cannot be read


def read(layer: Any) -> SpecTree:
    """The specs of a layer. Missing ones are not in the tree."""
    tree = SpecTree()
    waiting: list[tuple[Any, Any, int]] = [(layer.pseudoRoot, ROOT, -1)]
    seen = {ROOT}
    while waiting:
        spec, path, parent = waiting.pop()
        try:
            children = [child for name in _FIELDS for child in listed(layer, spec, path, name)]
            arcs = _arcs(spec)
        except REFUSED:
            tree.missing.append(path)
            continue
        row = tree.rows[path] = len(tree.parents)
        tree.parents.append(parent)
        tree.kinds.append(type(spec))
        if spec.HasInfo("clips"):
            tree.clips.append(path)
        if arcs:
            tree.arcs[row] = arcs
            if spec.HasInfo("instanceable") and spec.GetInfo("instanceable"):
                tree.instanceable.add(row)
        for _, child, child_spec in children:
            if child_spec is not None and child not in seen:
                seen.add(child)
                waiting.append((child_spec, child, row))
            else:
                tree.missing.append(child)
    return tree


def listed(layer: Any, spec: Any, path: Any, name: str) -> list[tuple[str, Any, Any]]:
    """The children that a spec at a path lists in a field: name, path, and the child's spec, None if the layer does not hold it."""
    if not spec or not spec.HasInfo(name):
        return []
    below, kind = CHILDREN[name]
    children = []
    for child in spec.GetInfo(name):
        below_spec = layer.GetObjectAtPath(path_of_child := below(path, child))
        children.append((child, path_of_child, below_spec if isinstance(below_spec, kind) else None))
    return children


def _arcs(spec: Any) -> list[tuple[str, Any]]:
    """(layer, path) of the references, payloads, inherits and specializes of a spec; an empty path for a layer's default prim.

    Damaged values have none.
    """
    arcs: list[tuple[str, Any]] = []
    for name in _ARCS:
        try:
            items = spec.GetInfo(name).GetAddedOrExplicitItems() if spec.HasInfo(name) else ()
        except (*REFUSED, AttributeError):
            continue
        arcs += [("", item) if isinstance(item, Sdf.Path) else (str(item.assetPath), item.primPath) for item in items]
    return arcs
