"""Removes the names of missing specs from the child lists of a damaged layer, since usd-core ends the process when it reads one."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

from typing import Any

from pxr import Sdf

from .....lang.diagnostics import Diagnostics, Span
from . import spec_tree

MOST = 5  # warnings for a layer


def leave_out(layer: Any, missing: list[Any], diagnostics: Diagnostics) -> None:
    """Remove missing prims and variants (see SpecTree) from the lists of a layer in memory, with a warning for each."""
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
        if field not in spec_tree.CHILDREN:
            return True
        children = spec_tree.listed(source, source.GetObjectAtPath(path), path, field)
        present = [name for name, child, spec in children if spec is not None and child not in gone]
        return (True, present, present)

    cleaned = Sdf.Layer.CreateAnonymous(".usda")
    try:
        Sdf.CopySpec(layer, spec_tree.ROOT, cleaned, spec_tree.ROOT, lambda *_: True, held)
    except spec_tree.REFUSED:
        cleaned.Clear()
        diagnostics.warning("nothing of this layer can be read", span)
    layer.TransferContent(cleaned)
