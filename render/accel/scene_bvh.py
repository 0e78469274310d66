"""Builds the two-level BVH of a scene: a wide BVH for each mesh and one over the instances, by the surface area heuristic.

Wald, "On fast Construction of SAH-based Bounding Volume Hierarchies", 2007. The BVHs of all meshes share one pool, so instances of a mesh
share its BVH. Instances without bounds (planes) stand in a list that every ray tests.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.plan import scene_facts
from ...materials import traits
from .. import simd
from ..formula import scene_tables
from ..formula import tables as formula_tables
from ..geometry import bounds
from .bvh_build import opacity_maps, tlas, tree_cache, wide_bvh
from .bvh_build.scene_layout import CAMERA_REST, INSTANCE_ROW, SHADOW_REST, Bvh, KernelAddress, MotionAlpha, Nothing
from .bvh_build.wide_bvh import Wide
from .traverse import instance_extent

MESH, FORMULA = int(ir.GeometryKind.MESH), int(ir.GeometryKind.FORMULA)
CAMERA, SHADOW = int(ir.Visibility.CAMERA), int(ir.Visibility.SHADOW)


def build(
    tables: ir.Tables, brute: bool = False, threads: int = 0, keep: bool = True, moves: bool = True,
    left_out: NDArray[np.bool_] | None = None, closed: bool = True, general: bool = False,
) -> Bvh:  # fmt: skip
    """Build the BVH of a scene; the result does not depend on the number of threads (0: all cores).

    With `moves`, instances with motion keys move; otherwise they stay as at the shutter's opening. With `brute`, there is no BVH over the
    instances: each is tested. With `keep`, BVHs of meshes are read from and written to the cache. Instances in `left_out` are never hit.
    With `closed`, formulas that have closed forms are intersected by these. With `general`, the BVH of moving and partly transparent
    instances is there even if it is empty.
    """
    geometries, instances = tables.geometries, tables.instances
    included = np.ones(len(instances.geometry), np.bool_) if left_out is None else ~left_out
    used = instances.geometry[included & (geometries.kind[instances.geometry] == ir.GeometryKind.MESH)]
    make = tree_cache.cached_mesh_bvh if keep else wide_bvh.build
    meshes, roots, leaf_extents = mesh_bvhs(tables, scene_facts.used_rows(used), threads, make)
    boxes = bounds.swept_bounds(tables) if moves else bounds.world_bounds(tables)
    kind = geometries.kind[instances.geometry]
    root = roots[instances.geometry]
    drawable = included & ((kind != MESH) | (root >= 0))
    bounded = np.logical_and(np.isfinite(boxes).all(axis=1), not brute)
    partial = traits.partial(tables)[instances.material]
    moving = tables.transforms.first_key[instances.transform] >= 0
    opaque_still = drawable & ~partial & ~(moving & moves)
    still = np.flatnonzero(opaque_still & (root >= 0))
    instance_extent.tighten_bounds(boxes, still, meshes, root, lambda rows: frames(tables, rows), bounds.SLACK)
    inside = np.flatnonzero(opaque_still & bounded).astype(np.int32)
    large = inside[tlas.too_large(boxes[inside])]
    if len(large):
        bounded[large] = False
        inside = np.flatnonzero(opaque_still & bounded).astype(np.int32)
    rows = simd.aligned_empty((len(kind), INSTANCE_ROW), np.int64)
    forms = scene_tables.build_tables(tables, closed, threads)
    primed = opaque_still & (kind == FORMULA) & formula_tables.have_cells(forms)[instances.geometry]
    primed &= instances.visible & CAMERA != 0
    visibility_bits = ((CAMERA, CAMERA_REST), (SHADOW, SHADOW_REST))
    visible = instances.visible + sum(np.where((instances.visible & bit != 0) & ~primed, more, 0) for bit, more in visibility_bits)
    for k, column in enumerate((visible, instances.transform, instances.geometry, kind, root, 0, 0, 0)):
        rows[:, k] = column
    unbounded = np.flatnonzero(opaque_still & ~bounded).astype(np.int32)
    moves = moves and bool(moving.any())
    only = int(inside[0]) if len(inside) == 1 else -1
    top = tlas.build(boxes, inside, threads)
    motion_alpha = _motion_alpha(tables, boxes, drawable & ~opaque_still, bounded, partial, moves, threads, general)
    del boxes  # 48 MB of a million instances
    return Bvh(
        wide=meshes,
        boxes=_local_bounds(tables, leaf_extents),
        top=top,
        unbounded=unbounded,
        only=only,
        instance_rows=rows,
        inverse=_inverses(tables),
        parameters=geometries.parameters,
        origin=geometries.origin,
        forms=forms,
        rest_bits=int(np.bitwise_or.reduce(visible[drawable], initial=0)) & (CAMERA_REST | SHADOW_REST),
        motion_alpha=motion_alpha,
    )


def _motion_alpha(
    tables: ir.Tables, boxes: NDArray[np.float64], which: NDArray[np.bool_], bounded: NDArray[np.bool_], partial: NDArray[np.bool_],
    moving: bool, threads: int, general: bool,
) -> MotionAlpha | Nothing:  # fmt: skip
    """The BVH of the moving or partly transparent instances `which`; Nothing without any, unless `general`."""
    if not which.any() and not general:
        return Nothing()
    inside, unbounded = (np.flatnonzero(which & chosen).astype(np.int32) for chosen in (bounded, ~bounded))
    opacity, motion = (KernelAddress() if needed else Nothing() for needed in (partial.any() or general, moving or general))
    maps = opacity_maps.build(tables, partial & which) if partial.any() or general else Nothing()
    return MotionAlpha(tlas.build(boxes, inside, threads), unbounded, partial, tables, opacity=opacity, moving=motion, maps=maps)


def frames(tables: ir.Tables, rows: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(origins of the meshes of some instances (n, 3), their matrices (n, 3, 4))."""
    return tables.geometries.origin[tables.instances.geometry[rows]], tables.transforms.matrix[tables.instances.transform[rows]]


def _inverses(tables: ir.Tables) -> NDArray[np.float64]:
    rows = simd.aligned_empty((len(tables.instances.transform), 4, 4), np.float64)
    rows[:, 3, 3] = 0.0
    for first in range(0, len(rows), bounds.CHUNK):
        chosen = slice(first, first + bounds.CHUNK)
        rows[chosen, :3] = tables.transforms.inverse[tables.instances.transform[chosen]]
        rows[chosen, 3, :3] = tables.geometries.origin[tables.instances.geometry[chosen]]
    return rows


def mesh_bvhs(
    tables: ir.Tables, used: NDArray[np.int32], threads: int = 0, build_bvh: Callable[..., Wide] = tree_cache.cached_mesh_bvh
) -> tuple[Wide, NDArray[np.int32], NDArray[np.float64]]:
    """(BVHs of the meshes `used`; root of each geometry's BVH or -1; median extent of its leaves)."""
    geometries, pools = tables.geometries, tables.pools
    roots = np.full(len(geometries.kind), -1, np.int32)
    leaf_extents = np.zeros(len(roots))
    bvhs, rows, nodes = [], [], 0
    for g in used:
        first, count = int(geometries.first_triangle[g]), int(geometries.triangle_count[g])
        vertex, vertices = int(geometries.first_vertex[g]), int(geometries.vertex_count[g])
        if count > 0:
            triangles = pools.triangles[first : first + count]
            bvh = build_bvh(pools.positions[vertex : vertex + vertices], triangles - vertex if vertex else triangles, threads)
            bvhs.append(bvh)
            rows.append(first)
            roots[g], leaf_extents[g] = nodes, wide_bvh.median_leaf_extent(bvh)
            nodes += len(bvh.nodes)
    return wide_bvh.concatenate(bvhs, rows), roots, leaf_extents


def _local_bounds(tables: ir.Tables, leaf_extents: NDArray[np.float64]) -> NDArray[np.float64]:
    """Bvh.boxes, (geometries, 8)."""
    low, high = (tables.geometries.bounds[:, k] - tables.geometries.origin for k in range(2))
    most = np.maximum(np.abs(low), np.abs(high)).max(axis=1)
    return np.concatenate([low, high, leaf_extents[:, None], most[:, None]], axis=1)
