"""Splits meshes into meshlets: up to 128 neighbouring triangles with vertices of their own, indexed by a byte.

The rasterizer culls a meshlet by its box, transforms its vertices once into the first-level cache, and sets up sixteen triangles at a time
from there. Instances share meshlets, and vertices of invisible meshlets are not transformed. Triangles follow a Z-curve, so that meshlets
are small on the screen.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...shapes.surfaces import Tessellation
from ..jit.kernel import helper, kernel
from .view_geometry import morton_order

TRIANGLES = 128  # of a meshlet, at most
VERTICES = 256
SHIFT = 7  # an id is visible meshlet << SHIFT | triangle
LANES = 16
RECORD = 8  # floats: position, normal, u, v


class Meshlets(NamedTuple):
    """All meshlets of a view. Triangles and vertices of each start at multiples of LANES; the slots between are never drawn."""

    first_triangle: NDArray[np.int32]  # (m,)
    triangles: NDArray[np.int32]  # (m,) number
    first_vertex: NDArray[np.int32]
    vertices: NDArray[np.int32]  # number; 0: points at infinity, drawn one by one in float64
    box: NDArray[np.float64]  # (6 · m,) columns of lowest x, y, z, then highest, in the mesh's frame
    a: NDArray[np.uint8]  # (t,) index of a triangle's first vertex in its meshlet, as `transposed_index`
    b: NDArray[np.uint8]
    c: NDArray[np.uint8]
    corner: NDArray[np.int32]  # (t, 4) rows of `record`, and the row of Model.triangles
    x: NDArray[np.float32]  # (v,) relative to the mesh's origin
    y: NDArray[np.float32]
    z: NDArray[np.float32]
    record: NDArray[np.float32]  # (v, RECORD); a zero normal stands for the triangle's own


class Source(NamedTuple):
    """Triangles and the attributes of their corners."""

    positions: NDArray[np.float64]  # (v, 4) homogeneous
    triangles: NDArray[np.int32]  # (t, 3)
    values: NDArray[np.float32]  # (k, 5) normal, u, v
    value: NDArray[np.int32]  # (t, 3) rows of values


def build(
    tables: ir.Tables, positions: NDArray, triangles: NDArray, ranges: NDArray[np.int64], tessellations: dict[int, Tessellation]
) -> tuple[Meshlets, NDArray[np.int64]]:
    """Meshlets of all ranges of triangles, and (instances, 2) first meshlet and count of each instance.

    `positions` and `triangles` are the Model's, `ranges` its (instances, 2) first triangle and count. Normals and texture coordinates
    are those of each mesh or tessellation.
    """
    builder = MeshletBuilder()
    placed = np.zeros_like(ranges)
    meshlet_ranges: dict[tuple[int, int], tuple[int, int]] = {}
    for instance, (first, count) in enumerate(ranges.tolist()):
        if count == 0:
            continue
        if (first, count) not in meshlet_ranges:
            source = _source(tables, positions, triangles, first, count, instance, tessellations.get(instance))
            meshlet_ranges[first, count] = builder.add(source, first)
        placed[instance] = meshlet_ranges[first, count]
    return builder.finish(), placed


def _source(tables: ir.Tables, positions, triangles, first: int, count: int, instance: int, tessellation: Tessellation | None) -> Source:
    mine = triangles[first : first + count]
    if tessellation is not None:
        values = np.concatenate([tessellation.normals, tessellation.uvs], axis=1).astype(np.float32)
        return Source(positions, mine, values, np.ascontiguousarray(tessellation.triangles, np.int32))
    geometries, g = tables.geometries, int(tables.instances.geometry[instance])
    rows = [int(geometries.normals[g]), int(geometries.uvs[g])]
    start, vertices = int(geometries.first_vertex[g]), int(geometries.vertex_count[g])
    smooth = all(row < 0 or tables.attributes.interpolation[row] in (ir.Interpolation.VERTEX, ir.Interpolation.CONSTANT) for row in rows)
    if smooth:
        values, value = np.zeros((vertices, 5), np.float32), mine - np.int32(start)
    else:
        values, value = np.zeros((3 * count, 5), np.float32), np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    for row, columns in zip(rows, (slice(0, 3), slice(3, 5)), strict=True):
        if row >= 0:
            values[:, columns] = _attribute_values(tables, row, mine - start, smooth, vertices)
    return Source(positions, mine, values, np.ascontiguousarray(value, np.int32))


def _attribute_values(tables: ir.Tables, row: int, corners: NDArray[np.int32], by_vertex: bool, vertices: int) -> NDArray[np.float32]:
    """The values of an attribute: at all vertices, or at all corners of triangles `corners` (t, 3)."""
    attributes = tables.attributes
    first, width, how = int(attributes.first[row]), int(attributes.width[row]), attributes.interpolation[row]
    values = tables.pools.values[first : first + width * int(attributes.count[row])].reshape(-1, width)
    if how == ir.Interpolation.CONSTANT:
        return np.broadcast_to(values[:1], (vertices if by_vertex else corners.size, width))
    if by_vertex:
        return values[:vertices]
    if how == ir.Interpolation.VERTEX:
        return values[corners.ravel()]
    if how == ir.Interpolation.FACE:
        return np.repeat(values[: len(corners)], 3, axis=0)
    return values[: corners.size]


class MeshletBuilder:
    """Collects the meshlets of meshes."""

    def __init__(self) -> None:
        self.parts: list[Meshlets] = []
        self.meshlets = self.triangles = self.vertices = 0

    def add(self, source: Source, first: int) -> tuple[int, int]:
        """Split a mesh; returns its first meshlet and their number. `first` is the row of its first triangle in the model."""
        count = len(source.triangles)
        corners = source.positions[source.triangles]
        infinite = bool((corners[..., 3] != 1.0).any())
        order = np.arange(count)
        if count > TRIANGLES and not infinite:
            order = morton_order(corners[..., :3].mean(axis=1))
        most = max(1, -(-count // (VERTICES // 3)))  # meshlets, if no triangles share a vertex
        slots, vertices = count + most * LANES, 3 * count + most * LANES
        numbers = [np.zeros(most, np.int32) for _ in range(4)]
        local = [np.zeros(slots, np.uint8) for _ in range(3)]
        places = [np.zeros(vertices, np.float32) for _ in range(3)]
        corner, record = np.zeros((slots, 4), np.int32), np.zeros((vertices, RECORD), np.float32)
        columns: list[Any] = [*numbers, np.zeros((6, most)), *local, corner, *places, record]
        meshlets = Meshlets(*columns)
        total = np.zeros(3, np.int64)
        cut_mesh(source, order, meshlets, infinite, first, total)
        m, t, v = (int(n) for n in total)
        part = Meshlets(
            meshlets.first_triangle[:m] + np.int32(self.triangles), meshlets.triangles[:m],
            meshlets.first_vertex[:m] + np.int32(self.vertices),
            meshlets.vertices[:m], meshlets.box[:, :m], meshlets.a[:t], meshlets.b[:t], meshlets.c[:t],
            meshlets.corner[:t] + np.array([self.vertices] * 3 + [0], np.int32), meshlets.x[:v], meshlets.y[:v], meshlets.z[:v],
            meshlets.record[:v],
        )  # fmt: skip
        start = self.meshlets
        self.parts.append(part)
        self.meshlets, self.triangles, self.vertices = self.meshlets + m, self.triangles + t, self.vertices + v
        return start, m

    def finish(self) -> Meshlets:
        """All meshlets, padded for loads of whole vectors."""
        if not self.parts:
            empty = Source(np.zeros((3, 4)), np.zeros((0, 3), np.int32), np.zeros((1, 5), np.float32), np.zeros((0, 3), np.int32))
            self.add(empty, 0)
        joined = [np.concatenate([getattr(part, name) for part in self.parts], axis=1 if name == "box" else 0) for name in Meshlets._fields]
        pads = {"box": ((0, 0), (0, LANES))}
        shape = [pads.get(name, ((0, LANES), *((0, 0),) * (array.ndim - 1))) for name, array in zip(Meshlets._fields, joined, strict=True)]
        meshlets = Meshlets(*(np.ascontiguousarray(np.pad(array, pad)) for array, pad in zip(joined, shape, strict=True)))
        return meshlets._replace(box=meshlets.box.ravel())


@helper
def transposed_index(vertex: int) -> int:
    """The index of a meshlet's vertex in the transformed vertices: a 4×4 transpose of vectors reorders them."""
    return (vertex & ~15) | ((vertex & 3) << 2) | ((vertex >> 2) & 3)


@kernel
def cut_mesh(source, order, meshlets, infinite, first, total):
    """Write a mesh's meshlets to `meshlets`, and the numbers of meshlets, triangle slots and vertex slots to `total`."""
    head = np.full(len(source.positions), -1, np.int32)  # last slot of each vertex
    previous = np.full(len(meshlets.x), -1, np.int32)  # previous slot of the same vertex, with other attributes
    value_row = np.full(len(meshlets.x), -1, np.int32)  # rows of source.values
    m, slot, start, count, vertices = -1, 0, 0, 0, 0
    for n in range(len(order)):
        triangle = order[n]
        if m < 0 or count == 128 or vertices + 3 > 256:
            if m >= 0:
                slot, start = _finish_meshlet(meshlets, m, slot, start, count, vertices, infinite)
            m, count, vertices = m + 1, 0, 0
            meshlets.first_triangle[m], meshlets.first_vertex[m] = slot, start
            meshlets.box[:3, m], meshlets.box[3:, m] = np.inf, -np.inf
        for k in range(3):
            vertex, value = source.triangles[triangle, k], source.value[triangle, k]
            vertex_slot = head[vertex]
            while vertex_slot >= start and not _equal_values(source.values, value_row[vertex_slot], value):
                vertex_slot = previous[vertex_slot]
            if vertex_slot < start:
                vertex_slot = start + vertices
                previous[vertex_slot], value_row[vertex_slot] = head[vertex], value
                head[vertex] = vertex_slot
                vertices += 1
                _add_vertex(source, meshlets, m, vertex_slot, vertex, value)
            meshlets.corner[slot + count, k] = vertex_slot
            place = transposed_index(vertex_slot - start)
            if k == 0:
                meshlets.a[slot + count] = place
            elif k == 1:
                meshlets.b[slot + count] = place
            else:
                meshlets.c[slot + count] = place
        meshlets.corner[slot + count, 3] = first + triangle
        count += 1
    if m >= 0:
        slot, start = _finish_meshlet(meshlets, m, slot, start, count, vertices, infinite)
    total[0], total[1], total[2] = m + 1, slot, start


@kernel
def _equal_values(values, row, other_row):
    same = True
    for k in range(values.shape[1]):
        same = same and (row == other_row or values[row, k] == values[other_row, k])
    return same


@kernel
def _add_vertex(source, meshlets, m, vertex_slot, vertex, value):
    """Write one vertex of a meshlet."""
    p = source.positions[vertex]
    meshlets.x[vertex_slot], meshlets.y[vertex_slot], meshlets.z[vertex_slot] = p[0], p[1], p[2]
    for k in range(3):
        meshlets.record[vertex_slot, k] = p[k]
        meshlets.box[k, m], meshlets.box[3 + k, m] = min(meshlets.box[k, m], p[k]), max(meshlets.box[3 + k, m], p[k])
    for k in range(5):
        meshlets.record[vertex_slot, 3 + k] = source.values[value, k]


@kernel
def _finish_meshlet(meshlets, m, slot, start, count, vertices, infinite):
    """End a meshlet; returns the first triangle slot and vertex slot of the next."""
    meshlets.triangles[m], meshlets.vertices[m] = count, 0 if infinite else vertices
    if infinite:
        meshlets.box[:3, m], meshlets.box[3:, m] = -np.inf, np.inf
    return slot + ((count + 15) & ~15), start + ((vertices + 15) & ~15)
