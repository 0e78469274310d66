"""No lane, not even a masked one, reads before the start of a table: kernels do not wrap negative indices."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import maquette
import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.scene.row_records import LightData, MeshAttribute
from maquette.render.backends import prepare
from maquette.render.light import light_tree

from ..tables import matrix, mesh, scene

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"


class Guarded(np.ndarray):
    """An array that rejects negative indices; numpy itself rejects those beyond the end."""

    def __getitem__(self, index: Any) -> Any:
        for part in index if isinstance(index, tuple) else (index,):
            if isinstance(part, np.ndarray) and part.dtype.kind == "i":
                assert part.size == 0 or part.min() >= 0, "a place before the start of a table"
        return np.asarray(super().__getitem__(index))


def guarded(value: Any) -> Any:
    """Nested NamedTuples with Guarded arrays."""
    if isinstance(value, np.ndarray):
        return value.view(Guarded)
    if hasattr(value, "_fields"):
        return type(value)(*(guarded(item) for item in value))
    return value


def one_sided(places: list[list[float]]) -> light_tree.Bounds:
    """Lights that only shine upwards."""
    place, n = np.array(places), len(places)
    return light_tree.Bounds(place, place, np.tile([0.0, 1.0, 0.0], (n, 1)), np.zeros(n), np.full(n, 0.5 * np.pi), np.ones(n))


@pytest.mark.parametrize("count", [1, 2, 3, 20])
def test_unlit_points_read_no_light(count):
    """Below lights that shine upwards, and at NaN positions, without a far light in row 0."""
    tree = guarded(light_tree.build(np.zeros(0), one_sided([[k, 1.0, 0.0] for k in range(count)])))
    facing = None if count < 20 else (np.zeros(4), np.ones(4), np.zeros(4))
    for position in (np.zeros(4), np.full(4, -3.0), np.full(4, np.nan)):
        with np.errstate(all="ignore"):
            row, chance = light_tree.choose(tree, (position, position - 1.0, position), facing, np.linspace(0.0, 0.9, 4))
        assert (row == 0).all()
        assert (chance == 0).all()


SLOW = {"instancing", "gear", "cut", "bracket"}  # many primitives, each tried for every ray
LONG = ("profiles",)
DRAWN = [path for path in sorted(EXAMPLES.glob("*.scene")) if path.stem not in SLOW]


@pytest.mark.long
@pytest.mark.parametrize("path", [pytest.param(path, id=path.stem, marks=[pytest.mark.long] * (path.stem in LONG)) for path in DRAWN])
def test_pictures_read_nothing_before_a_table(path, monkeypatch):
    """Every example by the reference backend, which shares its code with kernels."""
    prepared = prepare.prepare

    def watched(*arguments: Any) -> prepare.Prepared:
        ready = prepared(*arguments)
        guards = {name: guarded(getattr(ready, name)) for name in ("tables", "packed", "frame", "paths")}
        return dataclasses.replace(ready, **guards)

    monkeypatch.setattr(prepare, "prepare", watched)
    maquette.render(maquette.load(path), backend="reference", size=(24, 16), samples=1)


@pytest.mark.parametrize("name", ["normals", "uvs", "colors"])
def test_instances_without_an_attribute_do_not_read_past_the_end(name):
    """A large mesh without attributes precedes a triangle with the only attribute; lanes mix both."""
    side = np.linspace(-0.913, 0.937, 20)  # no edge through a pixel's centre
    points = np.stack([*np.meshgrid(side, side), np.full((20, 20), -2.0)], axis=-1).reshape(-1, 3)
    first = (np.arange(19)[:, None] * 20 + np.arange(19)).ravel()[::-1]
    bare = mesh(points, np.concatenate([np.stack([first, first + 1, first + 20], axis=-1)]))
    values = {"normals": np.tile([0.0, 0.0, 1.0], (3, 1)), "uvs": np.eye(3)[:, :2], "colors": np.full((3, 3), 0.5)}[name]
    small = mesh([[-1.03, -1.07, -1.5], [1.09, -1.01, -1.5], [0.05, 0.03, -1.5]], [[0, 1, 2]], **{name: MeshAttribute(values)})
    light = LightData(ir.LightKind.DIRECTIONAL, (3.0, 3.0, 3.0), direction=(0.0, 0.0, 1.0))
    tables = scene(meshes=[(bare, matrix(), 0), (small, matrix(), 0)], lights=[light])
    assert len(tables.pools.values) < 20
    shown = [drawn(tables, backend) for backend in ("reference", "ray", "raster")]
    for picture in shown[1:]:
        assert np.allclose(picture, shown[0], atol=1e-5)


def drawn(tables: ir.Tables, backend: str) -> np.ndarray:
    """Colors and coordinates of a backend, (h, w, 6)."""
    complete = ir.Scene("test", tables, names=ir.Names(cameras=("",)))
    image = maquette.render(complete, backend=backend, size=(24, 24), samples=1, background=(0.0, 0.0, 0.0), aov=("uv",))
    return np.concatenate([image.channels["rgba"], image.channels["uv"]], axis=-1)
