"""Normal and bump maps: normals against closed forms, tangents of mirrored coordinates, no inward reflection."""

from __future__ import annotations

import math

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.scene.row_records import Input, MaterialData, MeshAttribute, TextureData
from maquette.render import types
from maquette.render.lanes import ops
from maquette.render.material import principled
from maquette.render.surface import interaction, normal_map

from .. import tables as make

K = ir.GeometryKind
SQUARE = np.array([[-1, 0, 1], [1, 0, 1], [1, 0, -1], [-1, 0, -1]], float)  # in y = 0, facing up: x along u, −z along v
UVS = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
TWO = [[0, 1, 2], [0, 2, 3]]
TILT = (0.6, 0.0, 0.8)


def mapped(texel=TILT, strength=1.0):
    """Add an image of one direction and make a material with it as its normal map."""

    def prepare(builder):
        image = builder.image(np.array([[[*((np.array(texel) + 1) / 2), 1.0]]]))
        texture = builder.texture(TextureData(ir.TextureKind.IMAGE, image, gain=(2.0, 2.0, 2.0), bias=(-1.0, -1.0, -1.0)))
        return [MaterialData(inputs={ir.Slot.DIFFUSE: Input(), ir.Slot.NORMAL: Input((strength, strength, 1.0), texture)})]

    return prepare


def normal_at(tables, origin, direction):
    """The perturbed normal at the hit of one ray."""
    tables = principled.tables_for(tables)
    ray = make.rays(origin, direction)
    hit = make.first_hit(tables, ray)
    point = normal_map.apply_maps(tables, interaction.make_interaction(tables, ray, hit), hit, ray.direction)
    return np.array([float(c[0]) for c in point.normal])


def square(uvs=UVS, placed=None, positions=SQUARE, **more):
    data = make.mesh(positions, TWO, uvs=MeshAttribute(uvs), **more)
    return make.scene(meshes=[(data, make.matrix() if placed is None else placed, 0)], prepare=mapped())


def test_red_tilts_along_u():
    assert normal_at(square(), (0.2, 1, 0.1), (0, -1, 0)) == pytest.approx([0.6, 0.8, 0.0], abs=1e-6)


def test_mirrored_coordinates_lean_the_other_way_and_green_stays():
    mirrored = UVS * [-1, 1]
    assert normal_at(square(mirrored), (0.2, 1, 0.1), (0, -1, 0)) == pytest.approx([-0.6, 0.8, 0.0], abs=1e-6)
    tables = make.scene(meshes=[(make.mesh(SQUARE, TWO, uvs=MeshAttribute(mirrored)), make.matrix(), 0)], prepare=mapped((0, 0.6, 0.8)))
    assert normal_at(tables, (0.2, 1, 0.1), (0, -1, 0)) == pytest.approx([0.0, 0.8, -0.6], abs=1e-6)


@pytest.mark.parametrize("stretch", [(1, 1, 1), (2, 1, 1), (-1, 1, 1), (1, -3, 1), (-2, -1, -1)])
def test_normals_follow_the_transform(stretch):
    """The tangent follows the instance's transform, mirrored or scaled; a flipped plane is hit from its other side."""
    placed = make.matrix((0, 0, 0), make.turn(1, 0.7) @ np.diag(np.array(stretch, float)))
    along = placed[:3, 0] / np.linalg.norm(placed[:3, 0])
    normal = normal_at(square(placed=placed), (0.1, 1, 0.1), (0, -1, 0))
    outwards = np.sign(placed[1, 1])  # the square's own up, if it points up in the world; seen from below the map leans the other way
    assert normal == pytest.approx(0.6 * along * outwards + [0, 0.8, 0], abs=1e-6)


def test_the_back_is_the_front_seen_from_behind():
    assert normal_at(square(), (0.2, -1, 0.1), (0, 1, 0)) == pytest.approx([-0.6, -0.8, 0.0], abs=1e-6)


def test_shapes_lean_along_their_own_u():
    tables = make.scene([(K.BOX, (1, 1, 1), make.matrix(), 0)], prepare=mapped())
    assert normal_at(tables, (0.2, 0.1, 5), (0, 0, -1)) == pytest.approx([0.6, 0, 0.8], abs=1e-6)  # +z: u is +x
    assert normal_at(tables, (5, 0.1, 0.2), (-1, 0, 0)) == pytest.approx([0.8, 0, -0.6], abs=1e-6)  # +x: u is −z
    ball = make.scene([(K.SPHERE, (1,), make.matrix(), 0)], prepare=mapped())
    for angle in (0.3, 2.0, math.pi - 1e-4, math.pi + 1e-4):  # across the seam at the back, too
        out = np.array([math.sin(angle), 0, math.cos(angle)])
        around = np.array([math.cos(angle), 0, -math.sin(angle)])
        assert normal_at(ball, out * 3, -out) == pytest.approx(0.8 * out + 0.6 * around, abs=2e-3)


def test_tangents_of_a_smooth_mesh_are_shared_and_those_across_a_mirror_are_not():
    """Two squares side by side, the second mirrored in u: at their common edge tangents point apart, at inner corners they agree."""
    tables = principled.tables_for(square(normals=MeshAttribute(np.tile([0.0, 1.0, 0.0], (4, 1)))))
    tangents = tables.materials.tangents  # pyright: ignore
    assert tangents.first.tolist() == [0]
    assert tangents.values == pytest.approx(np.tile([1, 0, 0, 1], (6, 1)), abs=1e-6)
    six = np.concatenate([SQUARE, SQUARE[:2] + [2, 0, 0], SQUARE[2:] + [2, 0, 0]])
    uvs = np.concatenate([UVS, UVS * [-1, 1] + [2, 0]])
    both = make.mesh(six, [*TWO, *(np.array(TWO) + 4).tolist()], uvs=MeshAttribute(uvs))
    tangents = normal_map.mesh_tangents(make.scene(meshes=[(both, make.matrix(), 0)], prepare=mapped()), 0)
    assert tangents[:6] == pytest.approx(np.tile([1, 0, 0, 1], (6, 1)), abs=1e-6)
    assert tangents[6:] == pytest.approx(np.tile([-1, 0, 0, -1], (6, 1)), abs=1e-6)


def test_coordinates_without_area_give_some_tangent():
    tangents = normal_map.mesh_tangents(square(UVS * 0.0), 0)
    assert np.linalg.norm(tangents[:, :3], axis=1) == pytest.approx(np.ones(6), abs=1e-6)
    assert np.abs(tangents[:, 1]).max() < 1e-6


def heights(builder):
    """A ramp along u: 0 at the left, 1 at the right, over 64 texels."""
    ramp = np.ones((4, 64, 4))
    ramp[..., :3] = ((np.arange(64) + 0.5) / 64)[None, :, None]
    texture = builder.texture(TextureData(ir.TextureKind.IMAGE, builder.image(ramp), channel=0))
    return [MaterialData(inputs={ir.Slot.DIFFUSE: Input(), ir.Slot.BUMP: Input.number(0.5, texture)})]


@pytest.mark.parametrize("scale", [1.0, 4.0])
def test_the_slope_of_a_bump_map(scale):
    """0.5 m over a square of 2 m is a slope of ¼; an instance four times as large has a quarter of it."""
    placed = make.matrix(linear=np.eye(3) * scale)
    data = make.mesh(SQUARE, TWO, uvs=MeshAttribute(UVS))
    normal = normal_at(make.scene(meshes=[(data, placed, 0)], prepare=heights), (0.2, 9, 0.1), (0, -1, 0))
    slope = 0.25 / scale
    assert normal == pytest.approx(np.array([-slope, 1, 0]) / math.hypot(1, slope), abs=1e-5)
    tables = make.scene([(K.RECTANGLE, (1, 1), placed, 0)], prepare=heights)
    assert normal_at(tables, (0.2, 9, 0.1), (0, -1, 0)) == pytest.approx(normal, abs=1e-5)


def test_no_normal_mirrors_the_viewer_into_the_surface():
    rng = np.random.default_rng(2)
    n = rng.normal(size=(3, 500))
    n[1] = np.abs(n[1]) * 0.2
    normal = ops.normalize(tuple(n))
    up = (np.zeros(500), np.ones(500), np.zeros(500))
    viewer = ops.normalize((rng.normal(size=500), np.abs(rng.normal(size=500)) * 0.3 + 1e-3, rng.normal(size=500)))
    bent = normal_map.bend_to_viewer(normal, up, viewer)
    mirrored = ops.reflect(ops.negate(viewer), bent)
    assert (mirrored[1] >= np.minimum(viewer[1], normal_map.CLEAR) * 0.99).all()
    assert (ops.dot(bent, viewer) > 0).all()
    clear = ops.reflect(ops.negate(viewer), normal)[1] >= normal_map.CLEAR
    assert np.abs(np.stack(bent) - np.stack(normal))[:, clear].max() == 0.0


def test_scenes_without_maps_keep_their_tables():
    tables = make.scene([(K.SPHERE, (1,), make.matrix(), 0)])
    assert principled.tables_for(tables) is tables
    assert isinstance(normal_map.build_tangents(tables), normal_map.NoMaps)
    assert principled.Layered._fields[: len(ir.Materials._fields)] == ir.Materials._fields
    assert types.Tables is ir.Tables
