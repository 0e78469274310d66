"""Interpolation of light that `vertex_lighting` computes at the vertices of meshes."""

from __future__ import annotations

from ...compiler import ir
from ..jit.kernel import helper
from ..lanes import ops
from ..types import Hit, Lane, Surface, Tables, Vec, VertexLight

GOURAUD = int(ir.Shading.GOURAUD)


@helper
def is_vertex_lit(tables: Tables, vertex_light: VertexLight, point: Surface) -> Lane:
    """Whether the light of a surface is computed at vertices."""
    return (tables.materials.shading[point.material] == GOURAUD) & (vertex_light.first[point.instance] >= 0)


@helper
def interpolate_vertex_light(tables: Tables, vertex_light: VertexLight, point: Surface, hit: Hit, lanes: Lane) -> Vec:
    """Interpolate the light of the hit triangle's vertices in the lanes of a mask."""
    g = tables.instances.geometry[point.instance]
    triangle = ops.where(lanes, hit.primitive, 0)
    triangles, color = tables.pools.triangles, vertex_light.color
    base = vertex_light.first[point.instance] - tables.geometries.first_vertex[g] + ops.where(point.front, 0, len(color) // 2)
    base = ops.where(lanes, base, 0)
    a = base + ops.where(lanes, triangles[triangle, 0], 0)
    b = base + ops.where(lanes, triangles[triangle, 1], 0)
    c = base + ops.where(lanes, triangles[triangle, 2], 0)
    w = 1.0 - hit.u - hit.v
    return (
        w * color[a, 0] + hit.u * color[b, 0] + hit.v * color[c, 0],
        w * color[a, 1] + hit.u * color[b, 1] + hit.v * color[c, 1],
        w * color[a, 2] + hit.u * color[b, 2] + hit.v * color[c, 2],
    )
