"""No lane reads before a table's start: kernels do not wrap indices as numpy does, not even of lanes that are masked afterwards."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import maquette
import numpy as np
import pytest
from maquette.render import light_tree, prepare

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


class Guarded(np.ndarray):
    """An array that refuses negative places. (numpy itself refuses those beyond the end.)"""

    def __getitem__(self, at: Any) -> Any:
        for one in at if isinstance(at, tuple) else (at,):
            if isinstance(one, np.ndarray) and one.dtype.kind == "i":
                assert one.size == 0 or one.min() >= 0, "a place before the start of a table"
        return np.asarray(super().__getitem__(at))


def guarded(value: Any) -> Any:
    """A nest of NamedTuples with Guarded arrays."""
    if isinstance(value, np.ndarray):
        return value.view(Guarded)
    if hasattr(value, "_fields"):
        return type(value)(*(guarded(item) for item in value))
    return value


def one_sided(places: list[list[float]]) -> light_tree.Bounds:
    """Lamps that shine upwards alone."""
    place, n = np.array(places), len(places)
    return light_tree.Bounds(place, place, np.tile([0.0, 1.0, 0.0], (n, 1)), np.zeros(n), np.full(n, 0.5 * np.pi), np.ones(n))


@pytest.mark.parametrize("count", [1, 2, 3, 20])
def test_where_nothing_shines_no_lamp_is_read(count):
    """Below lamps that shine upwards, and at places that are no numbers, with no far light that would be row 0."""
    tree = guarded(light_tree.build(np.zeros(0), one_sided([[k, 1.0, 0.0] for k in range(count)])))
    facing = None if count < 20 else (np.zeros(4), np.ones(4), np.zeros(4))
    for position in (np.zeros(4), np.full(4, -3.0), np.full(4, np.nan)):
        with np.errstate(all="ignore"):
            row, chance = light_tree.choose(tree, (position, position - 1.0, position), facing, np.linspace(0.0, 0.9, 4))
        assert (row == 0).all()
        assert (chance == 0).all()


SLOW = {"instancing", "gear", "cut", "bracket"}  # many primitives, each tried for every ray


@pytest.mark.parametrize("path", [path for path in sorted(EXAMPLES.glob("*.scene")) if path.stem not in SLOW], ids=lambda path: path.stem)
def test_pictures_read_nothing_before_a_table(path, monkeypatch):
    """Every example by the reference, whose lanes are the kernels'."""
    made = prepare.prepare

    def watched(*given: Any) -> prepare.Prepared:
        ready = made(*given)
        guards = {name: guarded(getattr(ready, name)) for name in ("tables", "packed", "frame", "paths")}
        return dataclasses.replace(ready, **guards)

    monkeypatch.setattr(prepare, "prepare", watched)
    maquette.render(maquette.load(path), backend="reference", size=(24, 16), samples=1)
