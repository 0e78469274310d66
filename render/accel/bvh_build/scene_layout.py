"""Records of the two-level BVH that traversal kernels read, with the columns and type tags of their arrays."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....compiler import ir
from ...formula.tables import Forms
from .tlas import Top
from .wide_bvh import Wide

INSTANCE_ROW = 8  # numbers of a row of Bvh.instance_rows
LEAF_EXTENT, EXTENT = 6, 7  # columns of Bvh.boxes

MESH = int(ir.GeometryKind.MESH)
NO_MESHES, NO_TREE = "no meshes", "no tree"  # type tags of a BVH without these, see packed_struct.with_type_tags
# Bits beside ir.Visibility's: seen by camera rays, or casting shadows, and not traced by formula packets (accel/formula_packets).
CAMERA_REST, SHADOW_REST = 8, 16
VISIBILITY, TRANSFORM, GEOMETRY, KIND, ROOT = range(5)  # columns of Bvh.instance_rows


class Nothing(NamedTuple):
    """The absence of a record."""


class KernelAddress(NamedTuple):
    """The address of a linked kernel."""

    address: int = 0


class MotionAlpha(NamedTuple):
    """BVH of moving or partly transparent instances."""

    top: Top  # over those that have bounds
    unbounded: NDArray[np.int32]
    partial: NDArray[np.bool_]  # (instances,) whether the opacity is to be evaluated
    tables: ir.Tables
    opaque_search: int = 0  # address of two_level.search, for all other instances
    opacity: Any = Nothing()  # KernelAddress of motion_alpha.opacity_kernel, if some are partial
    moving: Any = Nothing()  # KernelAddress of motion_alpha.search_moving, if some move
    maps: Any = Nothing()  # OpacityMaps, if some are partial


class Bvh(NamedTuple):
    """Two-level BVH of a scene as traversal reads it. The arrays are few, since Numba passes each part of each array on.

    A mesh's boxes and corners are relative to its origin.
    """

    wide: Wide  # of all meshes; its rows are those of Pools.triangles
    boxes: NDArray[np.float64]  # (geometries, 8) of meshes: low x, y, z, high x, y, z, median leaf extent, largest coordinate
    top: Top  # over instances
    unbounded: NDArray[np.int32]  # instances outside of `top`, ascending
    only: int  # the one instance in `top`, or -1
    instance_rows: NDArray[np.int64]  # (instances, INSTANCE_ROW) visibility, transform, geometry, kind, root of the mesh's BVH, 0, 0, 0
    inverse: NDArray[np.float64]  # (instances, 4, 4): inverse transform, then the mesh's origin; two cache lines
    parameters: NDArray[np.float64]  # Geometries.parameters
    origin: NDArray[np.float64]  # Geometries.origin
    forms: Forms  # formula surfaces
    rest_bits: int  # those of CAMERA_REST and SHADOW_REST that some instance has
    motion_alpha: Any = Nothing()  # a MotionAlpha, if any instance moves or is partly transparent
    search: int = 0  # address of two_level.search, or of motion_alpha.search_all
    formula_kernel: int = 0  # address of the formula intersection, if there are formula surfaces
    rare_kernel: int = 0  # address of shape_hit.rare, if there are such shapes


def absent_features(bvh: Bvh) -> tuple[str, ...]:
    """Type tags of absent parts of a BVH. Meshes and the tree over instances each take a third of the compile time of traversal."""
    meshes = (bvh.instance_rows[:, KIND] == MESH).any()
    return (() if meshes else (NO_MESHES,)) + ((NO_TREE,) if bvh.only >= 0 or not len(bvh.top.links) else ())
