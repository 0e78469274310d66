"""Closed meshes in solids: volumes, closedness, what they combine with, and what is said of meshes that have no inside."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.formula import dual_contouring
from maquette.compiler.mesh import mesh_csg

from ..lower.test_formulas import loaded, refused

CUBE = "mesh(points: 0.5 * [[-1,-1,-1],[1,-1,-1],[1,1,-1],[-1,1,-1],[-1,-1,1],[1,-1,1],[1,1,1],[-1,1,1]], faces: {0}{1})"
FACES = "[[3,2,1,0],[4,5,6,7],[0,1,5,4],[1,2,6,5],[2,3,7,6],[3,0,4,7]]"
INWARDS = "[[0,1,2,3],[7,6,5,4],[4,5,1,0],[5,6,2,1],[6,7,3,2],[7,4,0,3]]"
BOX = CUBE.format(FACES, "")


def triangles(scene: ir.Scene) -> tuple[np.ndarray, np.ndarray]:
    """Of the first instance's mesh, in the world, equal corners once."""
    tables = scene.tables
    g, matrix = int(tables.instances.geometry[0]), tables.transforms.matrix[tables.instances.transform[0]]
    assert tables.geometries.kind[g] == ir.GeometryKind.MESH
    first, count = int(tables.geometries.first_triangle[g]), int(tables.geometries.triangle_count[g])
    faces = tables.pools.triangles[first : first + count].astype(np.int64)
    if tables.transforms.flips[tables.instances.transform[0]]:
        faces = faces[:, ::-1]
    positions = (tables.pools.positions + tables.geometries.origin[g]) @ matrix[:, :3].T + matrix[:, 3]
    found, index = np.unique(np.round(positions, 9), axis=0, return_inverse=True)
    faces = index.reshape(-1)[faces]
    return found, faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]


HOLE = math.pi * 0.25**2


@pytest.mark.parametrize(
    ("text", "volume"),
    [
        (f"difference {{ {BOX}; cylinder(0.25, 4) }}", 1 - HOLE),
        (f"difference {{ box([1, 1, 1]); {CUBE.format(FACES, ', translate: [0.5, 0.5, 0.5]')} }}", 7 / 8),
        (f"intersection {{ {BOX}; sphere(0.6) }}", 0.8054),
        (f"intersection {{ plane(y: 0.1); {BOX} }}", 0.6),
        (f"difference {{ {BOX}; plane(y: 0.1) }}", 0.4),
        (f"union {{ {BOX}; {CUBE.format(FACES, ', translate: [1, 0, 0]')} }}", 2),
        (f"translate([3, 0, 0]) {{ mirrored([1, 0, 0]) {{ {CUBE.format(FACES, ', translate: [0.25, 0, 0]')} }} }}", 1.5),
        (f"repeat([0.5, 0, 0], count: 3) {{ {BOX} }}", 2),
        (f"union {{ difference {{ {BOX}; cylinder(0.25, 4) }}; sphere(0.2) }}", 1 - HOLE + 4 / 3 * math.pi * 0.2**3),
        (f"difference(scale: [1, 2, -1]) {{ {BOX}; cylinder(0.25, 4) }}", 2 * (1 - HOLE)),
    ],
)
def test_volumes_of_closed_triangles(tmp_path, text, volume):
    if "sphere(0.6)" in text:  # a ball without the six caps that stand out of the box
        volume = 4 / 3 * math.pi * 0.6**3 - 6 * math.pi * 0.1**2 * (3 * 0.6 - 0.1) / 3
    scene, said = loaded(tmp_path, text)
    assert said == []
    positions, faces = triangles(scene)
    assert dual_contouring.open_edges(faces) == 0
    assert mesh_csg.volume(positions, faces) == pytest.approx(volume, rel=1e-3)


def vertices(scene: ir.Scene) -> tuple[np.ndarray, np.ndarray]:
    """Positions and normals (n, 3) of the first instance's mesh."""
    tables = scene.tables
    g = int(tables.instances.geometry[0])
    row = int(tables.geometries.normals[g])
    first, count = int(tables.attributes.first[row]), int(tables.geometries.vertex_count[g])
    normals = tables.pools.values[first : first + 3 * count].reshape(-1, 3)
    begin = int(tables.geometries.first_vertex[g])
    return tables.pools.positions[begin : begin + count] + tables.geometries.origin[g], normals


def prism(sides: int) -> str:
    """A mesh of a regular prism of radius 1."""
    angles = 2 * np.pi * np.arange(sides) / sides
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    points = [[round(x, 9), y, round(z, 9)] for y in (-1, 1) for x, z in ring.tolist()]
    after = [(k + 1) % sides for k in range(sides)]
    faces = [[k, k + sides, after[k] + sides, after[k]] for k in range(sides)]
    return f"mesh(points: {points}, faces: {[*faces, [*range(sides)], [*range(2 * sides - 1, sides - 1, -1)]]})"


@pytest.mark.parametrize(("sides", "smooth"), [(6, False), (8, False), (10, True), (12, True), (24, True)])
def test_walls_of_prisms_with_many_sides_are_smooth_where_they_are_cut(tmp_path, sides, smooth):
    """A mesh of twelve sides has edges of 30°: it shows a round thing. Those of eight, 45°, are edges of the thing."""
    scene, _ = loaded(tmp_path, f"difference {{ {prism(sides)}; box([3, 1, 3], center: [0, 1, 0]) }}")
    positions, normals = vertices(scene)
    wall = np.abs(normals[:, 1]) < 0.5
    outwards = positions[wall][:, [0, 2]] / np.linalg.norm(positions[wall][:, [0, 2]], axis=1, keepdims=True)
    along = (normals[wall][:, [0, 2]] * outwards).sum(axis=1)
    assert along.min() == pytest.approx(1 if smooth else math.cos(math.pi / sides), abs=0.02)


def test_normals_are_sharp_where_faces_meet_and_smooth_elsewhere(tmp_path):
    scene, _ = loaded(tmp_path, f"difference {{ {BOX}; cylinder(0.25, 4) }}")
    positions, normals = vertices(scene)
    wall = np.hypot(positions[:, 0], positions[:, 2]) < 0.26
    bore = wall & (np.abs(normals[:, 1]) < 0.5)
    inwards = -positions[bore][:, [0, 2]] / np.linalg.norm(positions[bore][:, [0, 2]], axis=1, keepdims=True)
    assert bore.sum() > 50
    assert (normals[bore][:, [0, 2]] * inwards).sum(axis=1).min() > 0.98
    flat = np.abs(normals[~bore]).max(axis=1)
    assert flat.min() > 0.999


def test_a_mesh_turned_inside_out_is_turned_back(tmp_path):
    scene, said = loaded(tmp_path, f"difference {{ {CUBE.format(INWARDS, '')}; box(0.5) }}")
    assert said == ["all triangles of this mesh face inwards: it is taken the other way round"]
    assert mesh_csg.volume(*triangles(scene)) == pytest.approx(7 / 8, rel=1e-6)


HINT = "(close it (most modelling programs have a repair for printing), or draw it beside the solid)"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (f"union {{ {CUBE.format(FACES.replace(',[3,0,4,7]', ''), '')}; sphere(1) }}",
         f"`mesh` cannot be a part of a solid: the mesh is open: 4 of its 17 edges have a triangle on one side only {HINT}"),
        ("union { polygon([[0, 0, 0], [1, 0, 0], [0, 1, 0]]); sphere(1) }",
         f"`polygon` cannot be a part of a solid: the mesh is open: 3 of its 3 edges have a triangle on one side only {HINT}"),
        (f"union {{ {CUBE.format(FACES[:-1] + ',[0,1,7]]', '')}; sphere(1) }}",
         f"`mesh` cannot be a part of a solid: 1 of the mesh's 20 edges has more than two triangles {HINT}"),
        (f"union(round: 0.1) {{ {BOX}; sphere(0.6) }}",
         "a solid with a mesh in it has no round edges (leave out `round`, or make a formula of the mesh's shape)"),
        (f"shell(0.1) {{ {BOX} }}",
         "`shell` of a mesh is not built yet: it needs a field (meshes can be in union, intersection and difference, repeat and mirrored)"),
        (f"morph(0.5) {{ {BOX}; sphere(1) }}",
         "`morph` of a mesh is not built yet: it needs a field (meshes can be in union, intersection and difference, repeat and mirrored)"),
        (f"union {{ {BOX}; plane(y: 0) }}", "this union is endless (cut it by an intersection with a box or sphere)"),
    ],
)  # fmt: skip
def test_what_is_refused(tmp_path, text, message):
    assert refused(tmp_path, text) == [message]


def test_nothing_left_is_said(tmp_path):
    _, said = loaded(tmp_path, f"sphere(1)\nintersection {{ {BOX}; sphere(0.1, center: [2, 0, 0]) }}")
    assert said == ["nothing is left of this intersection: it is not drawn"]


def test_a_file_of_several_parts_that_are_closed_together(tmp_path):
    """An .obj with two groups, each of them half of a cube's faces."""
    corners = "".join(f"v {x} {y} {z}\n" for z in (-0.5, 0.5) for y in (-0.5, 0.5) for x in (-0.5, 0.5))
    Path(tmp_path / "cube.obj").write_text(
        corners + "g one\nf 3 4 2 1\nf 5 6 8 7\nf 1 2 6 5\ng two\nf 2 4 8 6\nf 4 3 7 8\nf 3 1 5 7\n", encoding="utf-8"
    )
    scene, said = loaded(tmp_path, 'difference { mesh("cube.obj"); cylinder(0.25, 4) }')
    assert said == []
    assert mesh_csg.volume(*triangles(scene)) == pytest.approx(1 - HOLE, rel=1e-3)
