"""Selects instances of a scene by name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fnmatch import fnmatchcase

import numpy as np

from ...lang.diagnostics import suggest
from .. import ir

SHOWN = 12  # names in a message


class SelectionError(ValueError):
    """A name that no instance has, or a selection of nothing. The message lists names."""


def select(scene: ir.Scene, only: Sequence[str] = (), without: Sequence[str] = ()) -> ir.Scene:
    """The scene with the instances that `only` names (all where it is empty) and `without` does not. Lights stay.

    A name stands for itself and all below it: `gear` for `gear.rim`, `/a` for `/a/b`. `*` and `?` stand for any characters.
    Raises SelectionError.
    """
    names = [*scene.names.instances]
    names += [""] * (len(scene.tables.instances.geometry) - len(names))
    kept = _named(names, only) if only else np.ones(len(names), dtype=bool)
    kept &= ~_named(names, without)
    if not kept.any():
        raise SelectionError("no instance is left of the scene")
    rows = np.flatnonzero(kept)
    place = np.full(len(names) + 1, -1, dtype=np.int32)  # the last row: an instance of -1
    place[rows] = np.arange(len(rows))
    tables = scene.tables
    instances = ir.Instances(*(column[rows] for column in tables.instances))
    lights = tables.lights._replace(instance=place[tables.lights.instance])
    spans = dict(scene.spans.rows)
    if "instances" in spans:
        spans["instances"] = spans["instances"][rows]
    return replace(
        scene, tables=tables._replace(instances=instances, lights=lights),
        names=replace(scene.names, instances=tuple(names[row] for row in rows)), spans=replace(scene.spans, rows=spans),
    )  # fmt: skip


def _named(names: list[str], patterns: Sequence[str]) -> np.ndarray:
    """Which of `names` some pattern stands for."""
    found = np.zeros(len(names), dtype=bool)
    for pattern in patterns:
        matches = [any(fnmatchcase(name, p) for p in (pattern, f"{pattern}.*", f"{pattern}/*", f"{pattern}[[]*")) for name in names]
        if not any(matches):
            known = sorted({name for name in names if name})
            more = f" and {len(known) - SHOWN} more" if len(known) > SHOWN else ""
            near = suggest(pattern, known) or f"there are: {', '.join(known[:SHOWN]) or 'no names'}{more}"
            raise SelectionError(f"no instance is called `{pattern}`; {near}")
        found |= np.array(matches)
    return found
