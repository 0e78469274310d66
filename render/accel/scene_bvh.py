"""Bounding volume hierarchies: a wide tree for each mesh and one over the instances, by the surface area heuristic.

Wald, "On fast Construction of SAH-based Bounding Volume Hierarchies", 2007. All meshes' trees stand in one pool, so that a
mesh used by many instances has one tree. What has no bounds (planes) stands in a list beside the tree and is always tried.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.plan import plan as planner
from .. import simd
from ..formula import scene_tables
from ..formula import tables as formula_tables
from ..formula.tables import Forms
from ..geometry import instance_transform
from .build import tlas, tree_cache, wide_bvh
from .build.tlas import Top
from .build.wide_bvh import Wide
from .traverse import instance_extent

PLACED = 8  # numbers of a row of `placed`
FINE, REACH = 6, 7  # columns of `boxes`
_SWEEP = 0.25  # radians between moments at which the place of what turns is computed
SLACK = 1e-12  # of its coordinates, by which an instance's box grows: transforms round


MESH, FORMULA = int(ir.GeometryKind.MESH), int(ir.GeometryKind.FORMULA)
CAMERA, SHADOW = int(ir.Visibility.CAMERA), int(ir.Visibility.SHADOW)
NO_MESHES, NO_TREE = "no meshes", "no tree"  # marks of the type of trees without; see handles.marked
CAMERA_REST, SHADOW_REST = 8, 16  # bits beside ir.Visibility's: seen by camera rays, or casts shadows, and not met beforehand (primed.py)


class Nothing(NamedTuple):
    """No thing stands aside."""


class Call(NamedTuple):
    """Where a linked kernel is."""

    address: int = 0


class Aside(NamedTuple):
    """What traversal reads of things that stand aside."""

    top: Top  # over those that have bounds
    endless: NDArray[np.int32]
    partial: NDArray[np.bool_]  # (instances,) whether a thing's opacity is to be asked
    tables: ir.Tables
    plain: int = 0  # address of traverse.search, which goes through all other things
    cover: Any = Nothing()  # the Call of aside.covering, if some are partial
    moving: Any = Nothing()  # the Call of aside.through_moving, if some move


class Bvh(NamedTuple):
    """All that traversal reads, in few arrays: Numba hands each part of each array from function to function.

    A mesh's boxes and corners are relative to its origin.
    """

    wide: Wide  # of meshes; its rows are those of Pools.triangles
    boxes: NDArray[np.float64]  # (geometries, 8) of meshes: low x, y, z, high x, y, z, how wide their leaves are, the largest coordinate
    top: Top  # over instances
    endless: NDArray[np.int32]  # instances outside of the tree, rising
    only: int  # the one instance in the tree, or -1
    alone: int  # the same if there is nothing else and it is a mesh, or -1
    placed: NDArray[np.int64]  # (instances, PLACED) visibility, transform, geometry, kind, root of a mesh's tree; the rest is 0
    inverse: NDArray[np.float64]  # (instances, 4, 4): three rows of their transforms' inverses, and their meshes' origins; two cache lines
    parameters: NDArray[np.float64]  # Geometries.parameters
    origin: NDArray[np.float64]  # Geometries.origin
    forms: Forms  # formula surfaces
    rest: int  # those of CAMERA_REST and SHADOW_REST that some instance has
    aside: Any = Nothing()  # an Aside where things stand aside of all this
    search: int = 0  # address of traverse.search, or of what goes through things aside too, for kernels
    meet: int = 0  # address of formulas.meet, where there are formula surfaces
    rare: int = 0  # address of meeting.rare, where there are such shapes


def absent_features(trees: Bvh) -> tuple[str, ...]:
    """What there is none of: a third of what traversal takes to compile is for meshes, another for the tree over instances."""
    meshes = (trees.placed[:, 3] == MESH).any()
    return (() if meshes else (NO_MESHES,)) + ((NO_TREE,) if trees.only >= 0 or not len(trees.top.links) else ())


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
    boxes = swept_bounds(tables) if moves else world_bounds(tables)
    kind = geometries.kind[instances.geometry]
    root = roots[instances.geometry]
    drawable = there & ((kind != MESH) | (root >= 0))
    bounded = np.logical_and(np.isfinite(boxes).all(axis=1), not brute)
    partial = planner.partial(tables)[instances.material]
    moving = tables.transforms.first_key[instances.transform] >= 0
    plain = drawable & ~partial & ~(moving & moves)
    still = np.flatnonzero(plain & (root >= 0))
    instance_extent.tighten_bounds(boxes, still, meshes, root, *frames(tables), SLACK)
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


def world_bounds(tables: ir.Tables) -> NDArray[np.float64]:
    """(instances, 6) boxes in the world, grown by what rounding may move a thing; not finite where a thing is endless."""
    instances = tables.instances
    boxes = tables.geometries.bounds[instances.geometry]
    matrix = tables.transforms.matrix[instances.transform]
    with np.errstate(invalid="ignore"):
        middle, half = 0.5 * (boxes[:, 0] + boxes[:, 1]), 0.5 * (boxes[:, 1] - boxes[:, 0])
        centre = np.einsum("nij,nj->ni", matrix[:, :, :3], middle) + matrix[:, :, 3]
        reach = np.einsum("nij,nj->ni", np.abs(matrix[:, :, :3]), half)
        magnitude = np.einsum("nij,nj->ni", np.abs(matrix[:, :, :3]), np.abs(middle)) + np.abs(matrix[:, :, 3]) + reach
        reach = reach + SLACK * magnitude.max(axis=1, keepdims=True, initial=0.0)
    return np.concatenate([centre - reach, centre + reach], axis=1)


def swept_bounds(tables: ir.Tables) -> NDArray[np.float64]:
    """As `world_bounds`, of all places that things pass between the shutter's opening and its closing.

    Between moments at which a corner's place is computed, it strays from the line between them by at most h²/8 of its acceleration:
    ω² r + 2 ω r' for a turn of ω radians and a corner at r that stretches by r' a key.
    """
    boxes, instances, keys = world_bounds(tables), tables.instances, tables.keys
    first, count = tables.transforms.first_key[instances.transform], tables.transforms.keys[instances.transform]
    for i in np.flatnonzero(first >= 0):
        bounds = tables.geometries.bounds[instances.geometry[i]]
        corners = np.array([[bounds[k >> axis & 1, axis] for axis in range(3)] for k in range(8)])
        for key in range(first[i], first[i] + count[i] - 1):
            turn = 2.0 * np.arccos(np.clip(keys.turn[key] @ keys.turn[key + 1], -1.0, 1.0))
            parts = int(np.ceil(turn / _SWEEP)) or 1
            with np.errstate(invalid="ignore"):
                ends = [corners @ keys.stretch[k].T for k in (key, key + 1)]
                reach = max(np.linalg.norm(end, axis=1).max() for end in ends)
                stray = (turn * turn * reach + 2.0 * turn * np.linalg.norm(ends[1] - ends[0], axis=1).max()) / (8.0 * parts * parts)
                at = _between(keys, key, np.arange(parts + 1) / parts) @ np.vstack([corners.T, np.ones(8)])
                stray += SLACK * (np.abs(at).max() + reach)
                boxes[i, :3] = np.minimum(boxes[i, :3], at.min(axis=(0, 2)) - stray)
                boxes[i, 3:] = np.maximum(boxes[i, 3:], at.max(axis=(0, 2)) + stray)
    return boxes


def _between(keys: ir.Keys, key: int, shares: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 3, 4) places at shares (n,) of the way from a key to the next."""
    return np.stack(instance_transform.between(keys, key, np.full(len(shares), 2), shares), axis=1).reshape(-1, 3, 4)


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
