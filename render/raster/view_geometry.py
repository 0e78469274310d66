"""Triangles of one view, their transform to clip space, and clusters with pixel bounds.

Clip space is (X, Y, W, D, V). X / W and Y / W are pixel coordinates; D / V is the distance along the camera's axis; V is the point's
homogeneous coordinate: 1, or 0 for points at infinity. A perspective camera has W = D, an orthographic one W = V.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from .. import camera
from ..jit import packed_struct
from ..jit.kernel import helper, kernel
from ..tessellation.analytic_shapes import Tessellation, visible_analytic
from ..types import View

COLUMNS = 5  # X, Y, W, D, V
CLUSTER = 128  # triangles
GUARD = float(1 << 20)  # pixels from the picture's centre to the guard band's clip planes: fixed-point edges stay exact in int64
ROUNDING = 2.0**-46  # of the eye's coordinates: bounds the rounding error of depth at the eye
MARGIN = 4.0  # pixels around a bounding box, for filters
_EVERYWHERE = 1 << 30


class Model(NamedTuple):
    """All triangles of a view: the scene's meshes, in rows of Pools, then tessellated shapes."""

    positions: NDArray[np.float64]  # (v, 4) homogeneous, in the shape's frame, relative to the mesh's origin
    triangles: NDArray[np.int32]  # (t, 3)
    order: NDArray[np.int32]  # (t,) rows of each shape's triangles in Morton order
    parts: NDArray[np.int32]  # (t,) the part of the shape that a triangle approximates; of a mesh, its own row
    matrix: NDArray[np.float64]  # (instances, 5, 4) to clip space
    planes: NDArray[np.float64]  # (p, 5) clip planes; inside is >= 0
    perspective: bool


class Clusters(NamedTuple):
    """Runs of neighbouring triangles or polygons of visible instances, nearest first."""

    instance: NDArray[np.int32]
    first: NDArray[np.int32]  # row of Model.order, or of Polygons
    count: NDArray[np.int32]
    polygons: NDArray[np.bool_]  # whether first and count are of polygons
    box: NDArray[np.int32]  # (n, 4) pixel bounds x0 <= x < x1, y0 <= y < y1


def build_model(tables: ir.Tables, view: View, tessellations: dict[int, Tessellation]) -> tuple[Model, NDArray[np.int64]]:
    """The triangles of a view, and (instances, 2) first triangle and count of each instance; count 0: invisible."""
    pools, geometries, instances = tables.pools, tables.geometries, tables.instances
    ranges = np.zeros((len(instances.geometry), 2), np.int64)
    meshes = (geometries.kind[instances.geometry] == ir.GeometryKind.MESH) & (instances.visible & ir.Visibility.CAMERA != 0)
    ranges[meshes, 0] = geometries.first_triangle[instances.geometry[meshes]]
    ranges[meshes, 1] = geometries.triangle_count[instances.geometry[meshes]]
    positions = [np.append(pools.positions, np.ones((len(pools.positions), 1), np.float32), axis=1).astype(np.float64)]
    triangles, parts = [pools.triangles], [np.arange(len(pools.triangles), dtype=np.int32)]
    placed: dict[int, tuple[int, int]] = {}
    vertices, count = len(pools.positions), len(pools.triangles)
    for instance, tessellation in tessellations.items():
        if id(tessellation) not in placed:
            placed[id(tessellation)] = count, len(tessellation.triangles)
            positions.append(to_float32(tessellation.positions))
            triangles.append(tessellation.triangles + np.int32(vertices))
            parts.append(tessellation.parts)
            vertices += len(tessellation.positions)
            count += len(tessellation.triangles)
        ranges[instance] = placed[id(tessellation)]
    points, corners = np.concatenate(positions), np.concatenate(triangles)
    order = np.arange(len(corners), dtype=np.int32)
    for first, number in np.unique(ranges[ranges[:, 1] > CLUSTER], axis=0):
        order[first : first + number] = first + morton_order(points[corners[first : first + number], :3].mean(axis=1))
    model = Model(
        points, corners, order, np.concatenate(parts), clip_matrices(tables, view), clip_planes(tables, view),
        bool(tables.cameras.projection[view.camera] == ir.Projection.PERSPECTIVE),
    )  # fmt: skip
    return model, ranges


def to_float32(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points rounded to float32, as meshlets store them: both must give the same corners."""
    return points.astype(np.float32).astype(np.float64)


def morton_order(points: NDArray[np.float64]) -> NDArray[np.intp]:
    """The order of (n, 3) points along a Z-curve of 1024 cells an axis (Morton 1966)."""
    low = points.min(axis=0)
    size = float((points.max(axis=0) - low).max())
    cell = ((points - low) * (1023.0 / size if size > 0 else 0.0)).astype(np.int64)
    for shift, mask in ((16, 0x030000FF), (8, 0x0300F00F), (4, 0x030C30C3), (2, 0x09249249)):
        cell = (cell | (cell << shift)) & mask
    return np.argsort(cell[:, 0] | (cell[:, 1] << 1) | (cell[:, 2] << 2), kind="stable")


def world_to_clip(tables: ir.Tables, view: View) -> NDArray[np.float64]:
    """(5, 4) from the world to clip space: P · C⁻¹, scaled to the picture's size in pixels."""
    to_camera, projection = camera.projection_matrices(tables, view)
    screen = np.zeros((COLUMNS, 4))
    screen[0] = 0.5 * view.width * (projection[0] + projection[3])
    screen[1] = 0.5 * view.height * (projection[3] - projection[1])
    screen[2] = projection[3]
    screen[3] = [0.0, 0.0, -1.0, 0.0]
    screen[4] = [0.0, 0.0, 0.0, 1.0]
    return screen @ to_camera


def clip_matrices(tables: ir.Tables, view: View) -> NDArray[np.float64]:
    """(instances, 5, 4) from each instance's frame to clip space."""
    instances = tables.instances
    to_world = np.zeros((len(instances.geometry), 4, 4))
    to_world[:, 3, 3] = 1.0
    to_world[:, :3] = tables.transforms.matrix[instances.transform]
    to_world[:, :3, 3] += np.einsum("nij,nj->ni", to_world[:, :3, :3], tables.geometries.origin[instances.geometry])
    return np.ascontiguousarray(world_to_clip(tables, view) @ to_world)


def clip_planes(tables: ir.Tables, view: View) -> NDArray[np.float64]:
    """(p, 5) clip planes: near and far where finite, and the guard band, GUARD pixels from the picture's centre."""
    near, far = depth_range(tables, view)
    x, y = 0.5 * view.width, 0.5 * view.height
    planes = [[0.0, 0.0, 0.0, 1.0, -near]] if np.isfinite(near) else []
    if np.isfinite(far):
        planes.append([0.0, 0.0, 0.0, -1.0, far])
    planes += [[1.0, 0.0, GUARD - x, 0.0, 0.0], [-1.0, 0.0, GUARD + x, 0.0, 0.0]]
    planes += [[0.0, 1.0, GUARD - y, 0.0, 0.0], [0.0, -1.0, GUARD + y, 0.0, 0.0]]
    return np.array(planes)


def depth_range(tables: ir.Tables, view: View) -> tuple[float, float]:
    """The near and far depths; near excludes the rounding error around the eye."""
    near, far = float(tables.cameras.near[view.camera]), float(tables.cameras.far[view.camera])
    if tables.cameras.projection[view.camera] == ir.Projection.ORTHOGRAPHIC:
        return near, far
    eye = tables.transforms.matrix[tables.cameras.transform[view.camera], :, 3]
    return max(near, ROUNDING * float(np.abs(eye).sum())), far


@helper
def to_clip(matrix: Any, instance: int, p: Any, row: int, out: Any, k: int) -> None:
    """Transform vertex p[row] of an instance to clip space, into row k of `out`."""
    x, y, z, w = p[row, 0], p[row, 1], p[row, 2], p[row, 3]
    for c in range(COLUMNS):
        out[k, c] = matrix[instance, c, 0] * x + matrix[instance, c, 1] * y + matrix[instance, c, 2] * z + matrix[instance, c, 3] * w


def untessellated(tables: ir.Tables, tessellations: Mapping[int, Tessellation]) -> NDArray[np.intp]:
    """The rows of visible instances without triangles; a ray for each sample enters them into the z-buffer."""
    return np.array([i for i in visible_analytic(tables).tolist() if i not in tessellations], np.intp)


def pixel_boxes(tables: ir.Tables, view: View, chosen: NDArray[np.intp]) -> NDArray[np.int32]:
    """(n, 4) pixel bounds x0 <= x < x1, y0 <= y < y1 of instances, plus MARGIN."""
    if len(chosen) == 0:
        return np.empty((0, 4), np.int32)
    bounds = tables.geometries.bounds[tables.instances.geometry[chosen]]
    corners = np.stack(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij"), axis=-1).reshape(8, 3)
    points = np.take_along_axis(bounds, np.broadcast_to(corners, (len(chosen), 8, 3)), axis=1)
    boxes = np.empty((len(chosen), 4))
    with np.errstate(all="ignore"):
        matrix = clip_matrices(tables, view)[chosen]
        clipped = np.einsum("nij,nkj->nki", matrix[:, :, :3], points) + matrix[:, None, :, 3]
        w = clipped[..., 2:3]
        projected = clipped[..., :2] / w
        boxes[:, :2], boxes[:, 2:] = np.floor(projected.min(axis=1)) - MARGIN, np.ceil(projected.max(axis=1)) + MARGIN
        unbounded = ~(np.isfinite(boxes).all(axis=1) & (w.min(axis=(1, 2)) > 0.0))
    boxes[unbounded] = -_EVERYWHERE, -_EVERYWHERE, _EVERYWHERE, _EVERYWHERE
    return np.clip(boxes, -_EVERYWHERE, _EVERYWHERE).astype(np.int32)


# --- clusters ------------------------------------------------------------------------------------------------------------


def clusters(model: Any, ranges: NDArray[np.int64], tables: ir.Tables, view: View, margin: int, polygons: bool) -> Clusters:
    """The clusters of a model (its handle) that may overlap the picture grown by `margin` pixels.

    With `polygons`, meshes with polygons are clustered by those.
    """
    by_polygon = np.zeros(len(ranges), bool)
    if polygons:
        geometry = tables.instances.geometry
        by_polygon = (ranges[:, 1] > 0) & (tables.geometries.polygon_count[geometry] > 0)
        rows = np.stack([tables.geometries.first_polygon[geometry], tables.geometries.polygon_count[geometry]], axis=1)
        ranges = np.where(by_polygon[:, None], rows, ranges)
    keys, which = np.unique(np.column_stack([ranges, by_polygon]), axis=0, return_inverse=True)
    counts = -(-keys[:, 1] // CLUSTER)
    starts = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    boxes, keys = np.empty((int(starts[-1]), 6)), keys.astype(np.int64)
    _cluster_bounds(model, packed_struct.Handle(tables.polygons), keys, starts, boxes)
    total = int(counts[which].sum())
    first, count, none = np.empty(total, np.int32), np.empty(total, np.int32), np.empty(0, np.bool_)
    rows = Clusters(np.empty(total, np.int32), first, count, none, np.empty((total, 4), np.int32))
    depth = np.empty(total)
    visible_count = _cull_clusters(model, keys, starts, which.ravel(), boxes, view, margin, rows, depth)
    order = np.argsort(depth[:visible_count], kind="stable")
    instance = rows.instance[:visible_count][order]
    box = np.ascontiguousarray(rows.box[:visible_count][order])
    return Clusters(instance, first[:visible_count][order], count[:visible_count][order], by_polygon[instance], box)


@kernel
def _cluster_bounds(model, polygons, keys, starts, boxes):
    """Write the bounding box of each cluster in its shape's frame; infinite for clusters with points at infinity."""
    for m in range(len(keys)):
        for c in range(starts[m], starts[m + 1]):
            first = keys[m, 0] + (c - starts[m]) * CLUSTER
            last = min(first + CLUSTER, keys[m, 0] + keys[m, 1])
            by_polygon = keys[m, 2] != 0
            if by_polygon:
                last = polygons.first_triangle[last - 1] + polygons.triangle_count[last - 1]
                first = polygons.first_triangle[first]
            boxes[c, :3] = np.inf
            boxes[c, 3:] = -np.inf
            for item in range(first, last):
                triangle = item if by_polygon else model.order[item]
                for corner in range(3):
                    row = model.triangles[triangle, corner]
                    endless = model.positions[row, 3] != 1.0
                    for k in range(3):
                        x = model.positions[row, k]
                        boxes[c, k] = -np.inf if endless else min(boxes[c, k], x)
                        boxes[c, 3 + k] = np.inf if endless else max(boxes[c, 3 + k], x)


@kernel
def _cull_clusters(model, keys, starts, which, boxes, view, margin, clusters, depth):
    """Write the visible clusters of all instances, and their least depths; returns their number."""
    corner = np.empty((8, COLUMNS))
    point = np.ones((1, 4))
    visible_count = 0
    for i in range(len(which)):
        m = which[i]
        for c in range(starts[m], starts[m + 1]):
            endless = not np.isfinite(boxes[c, 0])
            if not endless:
                for k in range(8):
                    for axis in range(3):
                        point[0, axis] = boxes[c, axis + 3 * ((k >> axis) & 1)]
                    to_clip(model.matrix, i, point, 0, corner, k)
            nearest = project_box(corner, model.planes, view, margin, endless, clusters.box[visible_count])
            if nearest == np.inf:
                continue
            clusters.instance[visible_count], depth[visible_count] = i, nearest
            clusters.first[visible_count] = keys[m, 0] + (c - starts[m]) * CLUSTER
            clusters.count[visible_count] = min(CLUSTER, keys[m, 0] + keys[m, 1] - clusters.first[visible_count])
            visible_count += 1
    return visible_count


@helper
def project_box(corner: Any, planes: Any, view: View, margin: int, endless: bool, out: Any) -> float:
    """Write the pixel bounds of a box with these corners in clip space; returns its least depth, inf if it is invisible."""
    out[0], out[1], out[2], out[3] = -_EVERYWHERE, -_EVERYWHERE, _EVERYWHERE, _EVERYWHERE
    if endless:
        return 0.0
    for p in range(len(planes)):
        outside = True
        for k in range(8):
            d = 0.0
            for c in range(COLUMNS):
                d += planes[p, c] * corner[k, c]
            outside = outside and d < 0.0
        if outside:
            return np.inf
    nearest, front = np.inf, np.inf
    for k in range(8):
        nearest, front = min(nearest, corner[k, 3]), min(front, corner[k, 2])
    if front <= 0.0:
        return nearest
    x0, y0, x1, y1 = np.inf, np.inf, -np.inf, -np.inf
    for k in range(8):
        x, y = corner[k, 0] / corner[k, 2], corner[k, 1] / corner[k, 2]
        x0, y0, x1, y1 = min(x0, x), min(y0, y), max(x1, x), max(y1, y)
    edge = margin + 1.0
    if x1 < -edge or y1 < -edge or x0 > view.width + edge or y0 > view.height + edge:
        return np.inf
    far = float(_EVERYWHERE)
    out[0], out[1] = int(np.floor(max(x0 - edge, -far))), int(np.floor(max(y0 - edge, -far)))
    out[2], out[3] = int(np.ceil(min(x1 + edge, far))), int(np.ceil(min(y1 + edge, far)))
    return nearest
