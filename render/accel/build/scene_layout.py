"""Records of the two-level BVH that traversal kernels read, with the columns and type tags of their arrays."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....compiler import ir
from ...formula.tables import Forms
from .tlas import Top
from .wide_bvh import Wide

PLACED = 8  # numbers of a row of `placed`
FINE, REACH = 6, 7  # columns of `boxes`

MESH = int(ir.GeometryKind.MESH)
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
