"""Tables of scenes with participating media for rays that do not scatter in them, and of those that hold nothing else."""

from __future__ import annotations

import numpy as np

from ...materials import subsurface, traits
from .. import ir


def substitute(tables: ir.Tables, traced: bool) -> ir.Tables:
    """The tables without media that scatter, emit or have invisible boundaries; bodies that light enters are diffuse surfaces.

    Where secondary rays are `traced`, an even medium that only absorbs is the inside of its boundary.
    """
    if not traits.participates(tables):
        return tables
    absorbing = only_absorbing(tables) if traced else np.zeros(len(tables.materials.model), bool)
    clear, visible = traits.invisible(tables) & ~absorbing, tables.instances.visible.copy()
    visible[clear[tables.instances.material]] = 0
    tables = subsurface.diffuse_substitute(tables._replace(instances=tables.instances._replace(visible=visible)))
    none, values = np.full(len(tables.materials.model), -1, np.int32), tables.materials.values.copy()
    values[absorbing, ir.Slot.ABSORPTION] += tables.media.absorption[tables.materials.medium[absorbing]]
    return tables._replace(materials=tables.materials._replace(medium=none, values=values), media=ir.table_of("media", {}))


def only_absorbing(tables: ir.Tables) -> np.ndarray:
    """(materials,) bool: materials around an even medium that neither scatters nor emits light."""
    media, row = tables.media, tables.materials.medium
    clear = ((media.scattering + media.emission).max(axis=1, initial=0.0) == 0.0) & (media.density < 0)
    return np.append(clear, False)[row]


def leaves_out(tables: ir.Tables, traced: bool) -> bool:
    """Whether rays that do not scatter in media leave out some of these, besides the shadows in fog."""
    absorbing = only_absorbing(tables) if traced else np.zeros(len(tables.materials.model), bool)
    return bool((traits.participating(tables) & traits.used(tables) & ~absorbing).any())


def with_an_instance(tables: ir.Tables) -> ir.Tables:
    """The tables with an invisible point if they have media and no instance: kernels look up a row for each vertex of a path."""
    if len(tables.instances.geometry) or not traits.participates(tables):
        return tables
    geometry, material = len(tables.geometries.kind), len(tables.materials.model)
    ones = {"kind": int(ir.GeometryKind.SPHERE), "normals": -1, "uvs": -1, "colors": -1, "tape": -1}
    point = _row("geometries", tables.geometries, ones)
    plain = _row("materials", tables.materials, {"textures": -1, "first": -1, "second": -1, "medium": -1})
    hidden = ir.table_of("instances", {"geometry": [geometry], "transform": [0], "material": [material], "light": [-1], "visible": [0]})
    return tables._replace(geometries=point, materials=plain, instances=hidden)


def _row(table: str, columns: ir.Geometries | ir.Materials, numbers: dict[str, int]) -> ir.Geometries | ir.Materials:
    """A table with one more row: 0 but for some columns."""
    more = {}
    for name, values in columns._asdict().items():
        row = np.full((1, *values.shape[1:]), numbers.get(name, 0), values.dtype)
        more[name] = np.concatenate([values, row])
    return ir.table_of(table, more)
