"""Removes the names of missing specs from the child lists of a damaged layer, since usd-core ends the process when it reads one."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

from typing import Any

from pxr import Sdf, Tf

from .....lang.diagnostics import Diagnostics, Span

MOST = 5  # warnings for a layer
_ROOT = Sdf.Path.absoluteRootPath
_CHILDREN = {  # fields that list children: the path of a child, and its type
    "primChildren": (lambda path, name: path.AppendChild(name), Sdf.PrimSpec),
    "properties": (lambda path, name: path.AppendProperty(name), Sdf.PropertySpec),
    "variantSetChildren": (lambda path, name: path.AppendVariantSelection(name, ""), Sdf.VariantSetSpec),
    "variantChildren": (
        lambda path, name: path.GetParentPath().AppendVariantSelection(path.GetVariantSelection()[0], name), Sdf.VariantSpec,
    ),
}  # fmt: skip
_REFUSED = (Tf.ErrorException, TypeError, ValueError)  # ValueError: names that are not UTF-8


def leave_out(layer: Any, diagnostics: Diagnostics) -> None:
    """Remove missing prims and variants from the lists of a layer in memory, with a warning for each."""
    missing = _missing(layer)
    if not missing:
        return
    span = Span(layer.GetDisplayName())
    for count, path in enumerate(missing):
        if count == MOST:
            diagnostics.warning(f"{len(missing) - count} more are listed in this layer and missing", span)
            break
        diagnostics.warning(f"`{path}` is listed in this layer and missing: it is left out", span)
    gone = set(missing)

    def held(field: str, source: Any, path: Any, *_: object) -> bool | tuple[bool, list[str], list[str]]:
        if field not in _CHILDREN:
            return True
        kept = [name for name, child, there in _listed(source, path, field) if there and child not in gone]
        return (True, kept, kept)

    whole = Sdf.Layer.CreateAnonymous(".usda")
    try:
        Sdf.CopySpec(layer, _ROOT, whole, _ROOT, lambda *_: True, held)
    except _REFUSED:
        whole.Clear()
        diagnostics.warning("nothing of this layer can be read", span)
    layer.TransferContent(whole)


def _missing(layer: Any) -> list[Any]:
    """The paths of prims and variants that are listed and not there, listed twice, or whose lists cannot be read."""
    missing, seen, waiting = [], {_ROOT}, [_ROOT]
    while waiting:
        path = waiting.pop()
        try:
            children = [found for field in _CHILDREN if field != "properties" for found in _listed(layer, path, field)]
        except _REFUSED:
            missing.append(path)
            continue
        for _, child, there in children:
            if there and child not in seen:
                seen.add(child)
                waiting.append(child)
            else:
                missing.append(child)
    return missing


def _listed(layer: Any, path: Any, field: str) -> list[tuple[str, Any, bool]]:
    """The children that a spec lists in a field: name, path, and whether the layer holds them."""
    spec = layer.GetObjectAtPath(path)
    if not spec or not spec.HasInfo(field):
        return []
    below, kind = _CHILDREN[field]
    paths = [(name, below(path, name)) for name in spec.GetInfo(field)]
    return [(name, child, isinstance(layer.GetObjectAtPath(child), kind)) for name, child in paths]
