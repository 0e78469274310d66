"""Tests of Gouraud shading against shading at each point."""

from __future__ import annotations

import math

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.scene.row_records import CameraData, LightData, MeshAttribute
from maquette.render.accel import intersect, ray_queries
from maquette.render.integrator import vertex_lighting
from maquette.render.jit.packed_struct import Handle
from maquette.render.types import Frame, View

from .. import tables as make

TILT = math.radians(30)
SLOPES = np.array([[-math.sin(TILT), math.cos(TILT), 0.0], [math.sin(TILT), math.cos(TILT), 0.0]])
FRAME = Frame(View(0, 8, 8), make.OPTIONS, np.zeros(1))
OVERHEAD = make.looking((0, 50, 0), (0, 0, 0), (0, 0, -1))


def strip():
    """A flat strip from x = −1 to 1 whose normals lean out by 30° at its ends."""
    corners = np.array([[-1, 0, 1], [1, 0, 1], [1, 0, -1], [-1, 0, -1]], float)
    normals = SLOPES[[0, 1, 1, 0]]
    return make.mesh(corners, [[0, 1, 2], [0, 2, 3]], normals=MeshAttribute(normals))


def scene(material, mesh=None, frame=OVERHEAD):
    camera = CameraData(transform=1, extent=1.0, projection=ir.Projection.ORTHOGRAPHIC)
    sun = LightData(ir.LightKind.DIRECTIONAL, make.grey(math.pi), direction=(0.0, 1.0, 0.0))
    return make.scene(meshes=[(mesh or strip(), make.matrix(), 0)], materials=[material], lights=[sun], camera=camera, frame=frame)


def value_at(x, material):
    tables = scene(material)
    light = vertex_lighting.vertex_light(tables, tables, intersect.Brute(), FRAME)
    rgb, _ = make.radiance(tables, make.rays((x, 5, 0.1), (0, -1, 0)), light=light)
    return rgb[0, 0, 0]


def test_diffuse_light_at_the_middle():
    """Under overhead light both ends show cos 30° and so does the middle by Gouraud; by Phong its normal is up again: 1."""
    assert value_at(0.0, make.phong(1.0, shading=ir.Shading.GOURAUD)) == pytest.approx(math.cos(TILT), rel=1e-7)
    assert value_at(0.0, make.phong(1.0)) == pytest.approx(1.0, rel=1e-7)


def test_a_highlight_between_vertices_is_lost():
    """R·V is cos 60° at the ends: 0.5ⁿ; with n = 32 nothing is left of the highlight that Phong shows whole. Blinn's lobe has
    cos³² 30° there, .01002."""
    blinn = ir.MaterialModel.BLINN_PHONG
    assert value_at(0.0, make.phong(0, 1.0, 32.0, shading=ir.Shading.GOURAUD)) == pytest.approx(0.5**32, rel=1e-5)
    assert value_at(0.0, make.phong(0, 1.0, 32.0, blinn, shading=ir.Shading.GOURAUD)) == pytest.approx(0.01002, abs=5e-6)
    assert value_at(0.0, make.phong(0, 1.0, 32.0)) == pytest.approx(1.0, rel=1e-6)


def test_kernels_and_numpy_compute_the_same_light_at_vertices():
    rng = np.random.default_rng(4)
    bumps = make.mesh(rng.normal(size=(30, 3)), rng.integers(0, 30, (40, 3)))
    tables = scene(make.phong(0.5, 0.5, 9.0, shading=ir.Shading.GOURAUD), bumps)
    one = vertex_lighting.vertex_light(tables, tables, intersect.Brute(), FRAME)
    other = vertex_lighting.vertex_light(tables, Handle(tables), ray_queries.build(tables), Handle(FRAME))
    assert one.color.max() > 0.1
    assert np.abs(one.color - other.color).max() < 1e-12
    assert np.array_equal(one.first, other.first)


def test_only_meshes_shaded_at_vertices_have_light_there():
    tables = scene(make.phong(1.0))
    light = vertex_lighting.vertex_light(tables, tables, intersect.Brute(), FRAME)
    assert list(light.first) == [-1]


def test_shadows_fall_on_vertices():
    roof = make.mesh(np.array([[-3, 2, 3], [0, 2, 3], [0, 2, -3], [-3, 2, -3]], float), [[0, 1, 2], [0, 2, 3]])
    material = make.phong(1.0, shading=ir.Shading.GOURAUD)
    camera = CameraData(transform=1, extent=1.0, projection=ir.Projection.ORTHOGRAPHIC)
    sun = LightData(ir.LightKind.DIRECTIONAL, make.grey(math.pi), direction=(0.0, 1.0, 0.0))
    frame = make.looking((0, 1, 40), (0, 1, 0))
    tables = make.scene(
        meshes=[(strip(), make.matrix(), 0), (roof, make.matrix(), 1)], materials=[material, make.phong(0.0)],
        lights=[sun], camera=camera, frame=frame,
    )  # fmt: skip
    light = vertex_lighting.vertex_light(tables, tables, intersect.Brute(), FRAME)
    x = np.array([-1, 1, 1, -1])
    assert light.color[: len(x), 0] == pytest.approx(np.where(x > 0, math.cos(TILT), 0.0), abs=1e-7)


def test_a_vertex_on_the_outline_is_lit_from_outside_for_triangles_that_show_it():
    """Two faces of a ridge meet at an edge; seen along one of them, its vertices' light must be that of the outside all the same."""
    positions = np.array([[-1, 0, 1], [0, 1, 1], [1, 0, 1], [-1, 0, -1], [0, 1, -1], [1, 0, -1]], float)
    ridge = make.mesh(positions, [[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]])  # counter-clockwise from above
    frame = make.looking((30, 5, 0), (0, 0, 0))
    tables = scene(make.phong(1.0, shading=ir.Shading.GOURAUD), ridge, frame)
    light = vertex_lighting.vertex_light(tables, tables, intersect.Brute(), FRAME)
    assert light.color[:6, 0] == pytest.approx(math.sqrt(0.5), abs=1e-7)
    assert light.color[6:, 0] == pytest.approx(0.0, abs=1e-7)


def test_soft_lights_are_averaged_at_vertices():
    """A unit square 40 m above gives I = cos θ₁ cos θ₂ / (π d²) but for a share of some 1/40²; the mean of the samples is that."""
    camera = CameraData(transform=1, extent=1.0)
    tables = make.scene(
        meshes=[(strip(), make.matrix(), 0)], materials=[make.phong(0.6, shading=ir.Shading.GOURAUD)],
        lights=[LightData(ir.LightKind.RECTANGLE, make.grey(1.0), transform=1, size=(0.5, 0.5))], camera=camera,
        frame=make.facing((0, 40, 0), (0, 0, 0)),
    )  # fmt: skip
    light = vertex_lighting.vertex_light(tables, tables, intersect.Brute(), FRAME)
    d = math.hypot(40, math.sqrt(2))
    cosine = (40 * math.cos(TILT) - math.sin(TILT)) / d  # the normals lean away from the lamp
    assert light.color[:4, 0] == pytest.approx(0.6 / math.pi * cosine * (40 / d) / d**2, rel=2e-3)
