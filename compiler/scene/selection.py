"""Selects instances of a scene by name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fnmatch import fnmatchcase

import numpy as np

from ...lang.diagnostics import suggest
from .. import ir

SHOWN = 12  # names listed in a message


class SelectionError(ValueError):
    """An unknown name or an empty selection. The message lists names."""


def select(scene: ir.Scene, only: Sequence[str] = (), without: Sequence[str] = ()) -> ir.Scene:
    """The scene with the instances that match `only` (all if it is empty) and not `without`. Lights stay.

    A name matches itself and its descendants: `gear` matches `gear.rim`, `/a` matches `/a/b`. `*` and `?` match any characters.
    Raises SelectionError.
    """
    names = [*scene.names.instances]
    names += [""] * (len(scene.tables.instances.geometry) - len(names))
    selected = named(names, only) if only else np.ones(len(names), dtype=bool)
    selected &= ~named(names, without)
    if not selected.any():
        raise SelectionError("no instance is left of the scene")
    rows = np.flatnonzero(selected)
    place = np.full(len(names) + 1, -1, dtype=np.int32)  # the last row: an instance of -1
    place[rows] = np.arange(len(rows))
    tables = scene.tables
    instances = ir.Instances(*(column[rows] for column in tables.instances))
    lights = tables.lights._replace(instance=place[tables.lights.instance])
    spans = dict(scene.spans.rows)
    for table in spans.keys() & {"instances", "calls"}:
        spans[table] = spans[table][rows]
    return replace(
        scene, tables=tables._replace(instances=instances, lights=lights),
        names=replace(scene.names, instances=tuple(names[row] for row in rows)), spans=replace(scene.spans, rows=spans),
    )  # fmt: skip


def named(names: Sequence[str], patterns: Sequence[str]) -> np.ndarray:
    """Mask of the `names` that some pattern matches, see `select`. Raises SelectionError for a pattern that matches none."""
    selected = np.zeros(len(names), dtype=bool)
    for pattern in patterns:
        matches = [any(fnmatchcase(name, p) for p in (pattern, f"{pattern}.*", f"{pattern}/*", f"{pattern}[[]*")) for name in names]
        if not any(matches):
            candidates = sorted({name for name in names if name})
            more = f" and {len(candidates) - SHOWN} more" if len(candidates) > SHOWN else ""
            near = suggest(pattern, candidates) or f"there are: {', '.join(candidates[:SHOWN]) or 'no names'}{more}"
            raise SelectionError(f"no instance is called `{pattern}`; {near}")
        selected |= np.array(matches)
    return selected
