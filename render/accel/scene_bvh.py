"""Bounding volume hierarchies: a wide tree for each mesh and one over the instances, by the surface area heuristic.

Wald, "On fast Construction of SAH-based Bounding Volume Hierarchies", 2007. All meshes' trees stand in one pool, so that a
mesh used by many instances has one tree. What has no bounds (planes) stands in a list beside the tree and is always tried.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.plan import plan as planner
from .. import simd
from ..formula import scene_tables
from ..formula import tables as formula_tables
from ..geometry import bounds
from .build import tlas, tree_cache, wide_bvh
from .build.scene_layout import CAMERA_REST, PLACED, SHADOW_REST, Aside, Bvh, Call, Nothing
from .build.wide_bvh import Wide
from .traverse import instance_extent

MESH, FORMULA = int(ir.GeometryKind.MESH), int(ir.GeometryKind.FORMULA)
CAMERA, SHADOW = int(ir.Visibility.CAMERA), int(ir.Visibility.SHADOW)


def build(
    tables: ir.Tables, brute: bool = False, threads: int = 0, keep: bool = True, moves: bool = True,
    left_out: NDArray[np.bool_] | None = None, closed: bool = True,
) -> Bvh:  # fmt: skip
    """The trees of a scene, the same on any number of threads (0: all).

    With `moves`, things that have keys move, else they stand as at the shutter's opening. With `brute` there is none over the instances:
    each is tried. Meshes' trees are taken from those that are kept, and kept, if `keep`.
    Instances that are `left_out` are met by nothing. Formulas are met by closed forms where they have these, with `closed`.
    """
    geometries, instances = tables.geometries, tables.instances
    there = np.ones(len(instances.geometry), np.bool_) if left_out is None else ~left_out
    used = instances.geometry[there & (geometries.kind[instances.geometry] == ir.GeometryKind.MESH)]
    meshes, roots, fine = mesh_trees(tables, np.unique(used), threads, tree_cache.cached_mesh_bvh if keep else wide_bvh.build)
    boxes = bounds.swept_bounds(tables) if moves else bounds.world_bounds(tables)
    kind = geometries.kind[instances.geometry]
    root = roots[instances.geometry]
    drawable = there & ((kind != MESH) | (root >= 0))
    bounded = np.logical_and(np.isfinite(boxes).all(axis=1), not brute)
    partial = planner.partial(tables)[instances.material]
    moving = tables.transforms.first_key[instances.transform] >= 0
    plain = drawable & ~partial & ~(moving & moves)
    still = np.flatnonzero(plain & (root >= 0))
    instance_extent.tighten_bounds(boxes, still, meshes, root, *frames(tables), bounds.SLACK)
    inside = np.flatnonzero(plain & bounded).astype(np.int32)
    large = inside[tlas.too_large(boxes[inside])]
    if len(large):
        bounded[large] = False
        inside = np.flatnonzero(plain & bounded).astype(np.int32)
    rows = simd.aligned_empty((len(kind), PLACED), np.int64)
    found = scene_tables.build_tables(tables, closed, threads)
    primed = plain & (kind == FORMULA) & formula_tables.have_cells(found)[instances.geometry]
    primed &= instances.visible & CAMERA != 0
    rest = ((CAMERA, CAMERA_REST), (SHADOW, SHADOW_REST))
    visible = instances.visible + sum(np.where((instances.visible & bit != 0) & ~primed, more, 0) for bit, more in rest)
    for k, column in enumerate((visible, instances.transform, instances.geometry, kind, root, 0, 0, 0)):
        rows[:, k] = column
    endless = np.flatnonzero(plain & ~bounded).astype(np.int32)
    aside = _aside(tables, boxes, drawable & ~plain, bounded, partial, moves and bool(moving.any()), threads)
    only = int(inside[0]) if len(inside) == 1 else -1
    return Bvh(
        wide=meshes,
        boxes=local_bounds(tables, fine),
        top=tlas.build(boxes, inside, threads),
        endless=endless,
        only=only,
        alone=only if only >= 0 and root[only] >= 0 and not len(endless) and isinstance(aside, Nothing) else -1,
        placed=rows,
        inverse=_inverses(tables),
        parameters=geometries.parameters,
        origin=geometries.origin,
        forms=found,
        rest=int(np.bitwise_or.reduce(visible[drawable], initial=0)) & (CAMERA_REST | SHADOW_REST),
        aside=aside,
    )


def _aside(
    tables: ir.Tables, boxes: NDArray[np.float64], which: NDArray[np.bool_], bounded: NDArray[np.bool_], partial: NDArray[np.bool_],
    moving: bool, threads: int,
) -> Aside | Nothing:  # fmt: skip
    """The instances told of by `which` aside."""
    if not which.any():
        return Nothing()
    inside, endless = (np.flatnonzero(which & chosen).astype(np.int32) for chosen in (bounded, ~bounded))
    cover, through = Call() if partial.any() else Nothing(), Call() if moving else Nothing()
    return Aside(tlas.build(boxes, inside, threads), endless, partial, tables, cover=cover, moving=through)


def frames(tables: ir.Tables) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Of each instance, where its mesh stands (instances, 3) and its matrix (instances, 3, 4)."""
    return tables.geometries.origin[tables.instances.geometry], tables.transforms.matrix[tables.instances.transform]


def _inverses(tables: ir.Tables) -> NDArray[np.float64]:
    rows = simd.aligned_empty((len(tables.instances.transform), 4, 4), np.float64)
    rows[:, :3], rows[:, 3, 3] = tables.transforms.inverse[tables.instances.transform], 0.0
    rows[:, 3, :3] = tables.geometries.origin[tables.instances.geometry]
    return rows


def mesh_trees(
    tables: ir.Tables, used: NDArray[np.int32], threads: int = 0, tree_of: Callable[..., Wide] = tree_cache.cached_mesh_bvh
) -> tuple[Wide, NDArray[np.int32], NDArray[np.float64]]:
    """The trees of meshes; for each geometry where its own begins, -1 where it has none, and how wide its leaves are."""
    geometries, pools = tables.geometries, tables.pools
    roots = np.full(len(geometries.kind), -1, np.int32)
    fine = np.zeros(len(roots))
    made, rows, nodes = [], [], 0
    for g in used:
        first, count = int(geometries.first_triangle[g]), int(geometries.triangle_count[g])
        vertex, vertices = int(geometries.first_vertex[g]), int(geometries.vertex_count[g])
        if count > 0:
            triangles = pools.triangles[first : first + count]
            tree = tree_of(pools.positions[vertex : vertex + vertices], triangles - vertex if vertex else triangles, threads)
            made.append(tree)
            rows.append(first)
            roots[g], fine[g] = nodes, wide_bvh.median_leaf_extent(tree)
            nodes += len(tree.nodes)
    return wide_bvh.concatenate(made, rows), roots, fine


def local_bounds(tables: ir.Tables, fine: NDArray[np.float64]) -> NDArray[np.float64]:
    """(geometries, 8) as Bvh.boxes."""
    low, high = (tables.geometries.bounds[:, k] - tables.geometries.origin for k in range(2))
    most = np.maximum(np.abs(low), np.abs(high)).max(axis=1)
    return np.concatenate([low, high, fine[:, None], most[:, None]], axis=1)
