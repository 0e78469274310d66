"""Surfaces at hits: normals under all transforms, mesh attributes, metrics of coordinates, offsets of new rays."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from maquette.compiler import ir
from maquette.compiler.scene.row_records import MeshAttribute
from maquette.render.accel import intersect
from maquette.render.integrator import ray_stack
from maquette.render.lanes import ops
from maquette.render.surface import interaction

from .. import tables as make

K = ir.GeometryKind
By = ir.Interpolation
SHAPES = {
    "sphere": (K.SPHERE, (1.0,)),
    "box": (K.BOX, (1.0, 0.5, 2.0)),
    "cylinder": (K.CYLINDER, (0.7, 1.0, 1.0)),
    "cone": (K.CONE, (1.0, 0.0, 1.0, 1.0)),
    "torus": (K.TORUS, (1.0, 0.3)),
    "capsule": (K.CAPSULE, (0.5, 0.8)),
    "quadric": (K.QUADRIC, (1, 2, 1, 0, 0, 0, 0, 0, 0, -1, 2, 2, 2)),
}
TRIANGLE = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 0.0, -4.0]])  # counter-clockwise from above


def at(tables, ray):
    hit = make.first_hit(tables, ray)
    with np.errstate(all="ignore"):
        return interaction.make_interaction(tables, ray, hit, True), hit


def vector(v):
    return np.stack(np.broadcast_arrays(*v), axis=-1)


def mesh(**attributes):
    return make.mesh(TRIANGLE, [[0, 1, 2]], **attributes)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("linear", [np.diag([2.0, 0.3, 1.0]), np.diag([-1.0, 1.0, 2.0]), make.turn(0, 0.7) @ np.diag([1.0, 3.0, -0.5])])
def test_normals_are_perpendicular_under_scales_and_mirrors(shape, linear):
    """Two nearby hits span the tangent plane; the normal is perpendicular to it, unit, and faces the ray."""
    kind, parameters = SHAPES[shape]
    tables = make.scene([(kind, parameters, make.matrix((3, -1, 2), linear), 0)])
    random = np.random.default_rng(5)
    target = np.array([3, -1, 2]) + (random.uniform(-0.4, 0.4, (300, 3)) * [1, 0.5, 1]) @ linear.T
    away = random.normal(size=(300, 3))
    origin = target + 20 * away / np.linalg.norm(away, axis=1, keepdims=True)
    ray = make.rays(origin, target - origin)
    surface, hit = at(tables, ray)
    normal, position = vector(surface.normal), vector(surface.position)
    close = []
    for step in np.eye(3) * 1e-5:
        other = make.rays(origin, target + step - origin)
        hit2 = make.first_hit(tables, other)
        same = (hit2.instance == hit.instance) & (hit2.primitive == hit.primitive)
        with np.errstate(all="ignore"):
            close.append((vector(ops.along(other.origin, other.direction, hit2.t)) - position, same))
    seen = np.isfinite(hit.t)
    assert seen.sum() > 20
    assert np.allclose(np.linalg.norm(normal[seen], axis=1), 1, atol=1e-12)
    assert np.all(np.sum(normal[seen] * vector(ray.direction)[seen], axis=1) < 0)
    for moved, same in close:
        length = np.linalg.norm(moved, axis=1)
        usable = seen & same & (length > 1e-9) & (length < 1e-3)
        assert usable.sum() > 15
        slope = np.abs(np.sum(moved[usable] * normal[usable], axis=1)) / length[usable]
        assert np.median(slope) < 1e-3
    if kind in (K.SPHERE, K.BOX, K.TORUS, K.CAPSULE):
        assert np.all(surface.front[seen])


def test_a_mirrored_mesh_keeps_its_outside():
    for linear in (np.eye(3), np.diag([1.0, 1.0, -1.0]), np.diag([-2.0, 1.0, 1.0])):
        tables = make.scene(meshes=[(mesh(), make.matrix(linear=linear), 0)])
        inside = linear @ [0.5, 0.0, -1.0]
        above, _ = at(tables, make.rays(inside + [0, 1, 0], (0, -1, 0)))
        below, _ = at(tables, make.rays(inside - [0, 1, 0], (0, 1, 0)))
        assert above.front[0]
        assert not below.front[0]
        assert vector(above.normal)[0] == pytest.approx([0, 1, 0])
        assert vector(below.normal)[0] == pytest.approx([0, -1, 0])


@pytest.mark.parametrize(
    ("interpolation", "values", "expected"),
    [
        (By.CONSTANT, [[0.2, 0.4, 0.6]], [0.2, 0.4, 0.6]),
        (By.FACE, [[0.1, 0.5, 0.9]], [0.1, 0.5, 0.9]),
        (By.VERTEX, [[1, 0, 0], [0, 1, 0], [0, 0, 1]], [0.5, 0.25, 0.25]),
        (By.CORNER, [[1, 0, 0], [0, 1, 0], [0, 0, 1]], [0.5, 0.25, 0.25]),
    ],
)
def test_interpolation_of_attributes(interpolation, values, expected):
    """For the second of two meshes in the pools, so that first rows matter."""
    other = make.mesh(TRIANGLE + 50, [[0, 1, 2]], colors=MeshAttribute(np.zeros((1, 3)), By.FACE))
    given_ = mesh(colors=MeshAttribute(np.array(values), interpolation))
    tables = make.scene(meshes=[(other, make.matrix(), 0), (given_, make.matrix(), 0)])
    surface, _ = at(tables, make.rays((0.5, 1, -1), (0, -1, 0)))
    assert vector(surface.color)[0] == pytest.approx(expected, abs=1e-7)


def test_smooth_normals_are_interpolated_and_flat_ones_are_not():
    tilted = np.array([[0.6, 0.8, 0.0], [-0.6, 0.8, 0.0], [0.6, 0.8, 0.0]])
    given_ = mesh(normals=MeshAttribute(tilted))
    for shading, expected in ((ir.Shading.SMOOTH, [0, 1, 0]), (ir.Shading.FLAT, [0, 1, 0])):
        tables = make.scene(meshes=[(given_, make.matrix(), 0)], materials=[make.phong(1.0, shading=shading)])
        middle, _ = at(tables, make.rays((1.0, 1, -0.001), (0, -1, 0)))
        assert vector(middle.normal)[0] == pytest.approx(expected, abs=1e-3)
        corner, _ = at(tables, make.rays((1e-5, 1, -1e-5), (0, -1, 0)))
        assert vector(corner.normal)[0] == pytest.approx([0.6, 0.8, 0] if shading == ir.Shading.SMOOTH else [0, 1, 0], abs=1e-4)
        assert vector(corner.geometric)[0] == pytest.approx([0, 1, 0])


def test_inward_normals_flip_to_the_triangles_outside():
    given_ = mesh(normals=MeshAttribute(np.array([[0.0, -1.0, 0.0]] * 3)))
    surface, _ = at(make.scene(meshes=[(given_, make.matrix(), 0)]), make.rays((0.5, 1, -1), (0, -1, 0)))
    assert vector(surface.normal)[0] == pytest.approx([0, 1, 0])


def test_normals_that_cancel_give_the_face_normal():
    given_ = mesh(normals=MeshAttribute(np.zeros((3, 3))))
    surface, _ = at(make.scene(meshes=[(given_, make.matrix(), 0)]), make.rays((0.5, 1, -1), (0, -1, 0)))
    assert vector(surface.normal)[0] == pytest.approx([0, 1, 0])


def test_metric_of_mesh_coordinates():
    """u runs 0 to 1 over 2 m and v over 4 m; scaled by three they are 6 and 12."""
    given_ = mesh(uvs=MeshAttribute(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])))
    tables = make.scene(meshes=[(given_, make.matrix(linear=3 * np.eye(3)), 0)])
    surface, _ = at(tables, make.rays((1.5, 1, -3), (0, -1, 0)))
    assert (surface.uv[0][0], surface.uv[1][0]) == pytest.approx((0.25, 0.25))
    assert (surface.metric[0][0], surface.metric[1][0]) == pytest.approx((6.0, 12.0))


def test_without_coordinates_and_with_coordinates_that_are_all_one_point():
    for uvs in (None, MeshAttribute(np.full((3, 2), 0.5))):
        surface, _ = at(make.scene(meshes=[(mesh(uvs=uvs), make.matrix(), 0)]), make.rays((0.5, 1, -1), (0, -1, 0)))
        assert (surface.metric[0][0], surface.metric[1][0]) == (1.0, 1.0)
        assert surface.uv[0][0] == (0.0 if uvs is None else 0.5)


@pytest.mark.parametrize("place", [1e-3, 1.0, 1e5])
@pytest.mark.parametrize("shape", [*SHAPES, "mesh"])
def test_new_rays_do_not_hit_their_surface(shape, place):
    """At coordinates of 1e-3, 1 and 1e5, with equal or much smaller sizes, an outward ray from a convex solid hits nothing.

    No fixed epsilon works for all of them.
    """
    random = np.random.default_rng(3)
    size = min(place, 1.0)
    spot = np.array([0.7, -0.4, 1.1]) * place
    if shape == "mesh":
        corners = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], float)
        solid = make.mesh(corners, [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])
        tables = make.scene(meshes=[(solid, make.matrix(spot, size * make.turn(1, 0.3)), 0)])
    else:
        tables = make.scene([(*SHAPES[shape], make.matrix(spot, size * make.turn(1, 0.3)), 0)])
    n = 300
    away = random.normal(size=(n, 3))
    origin = spot + 5 * size * away / np.linalg.norm(away, axis=1, keepdims=True)
    target = spot + size * random.uniform(-0.4, 0.4, (n, 3))
    ray = make.rays(origin, target - origin)
    surface, hit = at(tables, ray)
    seen = np.isfinite(hit.t)
    assert seen.sum() > 50
    offset = surface.offset[seen]
    assert np.all(offset > 0)
    assert offset.max() < 1e-12 * max(1.0, place) * 100
    if shape == "torus":
        return  # not convex: a free ray may well meet it again
    normal = vector(surface.geometric)
    out = random.normal(size=(n, 3))
    out *= np.sign(np.sum(out * np.where(seen[:, None], normal, 1.0), axis=1))[:, None]
    out = tuple((out / np.linalg.norm(out, axis=1, keepdims=True)).T)
    with np.errstate(all="ignore"):
        leaving = ray_stack.spawn_ray(surface, out, np.full(n, np.inf))
        again = intersect.occluded(intersect.Brute(), tables, leaving, seen)
    assert not again.any()


@pytest.mark.long
@given(st.floats(-3, 6), st.floats(0.01, 1.5))
@settings(max_examples=60, deadline=None)
def test_offset_scales_with_the_coordinates(power, theta):
    """The offset is proportional to the coordinates, about ten units of rounding; it is not a fixed length."""
    far = 10.0**power
    tables = make.scene([(K.SPHERE, (1.0,), make.matrix((far, 0, 0)), 0)])
    ray = make.rays((far + 3 * math.sin(theta), 3 * math.cos(theta), 0), (-math.sin(theta), -math.cos(theta), 0))
    surface, _ = at(tables, ray)
    assert 1e-16 * far < surface.offset[0] < 1e-13 * (far + 10)


def test_lanes_without_a_hit_do_no_harm():
    tables = make.scene([(K.SPHERE, (1.0,), make.matrix(), 0)], meshes=[(mesh(), make.matrix((5, 0, 0)), 0)])
    ray = make.rays([[0, 0, 5], [0, 9, 5], [5.5, 1, -1]], [[0, 0, -1], [0, 0, -1], [0, -1, 0]])
    surface, hit = at(tables, ray)
    assert list(hit.instance) == [0, -1, 1]
    assert vector(surface.normal)[[0, 2]] == pytest.approx(np.array([[0, 0, 1], [0, 1, 0]]))
