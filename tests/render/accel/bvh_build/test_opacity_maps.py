"""Opacity maps: where they are certain, the opacity is 0 or 1, and no ray changes."""

from __future__ import annotations

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.scene.row_records import Input, MaterialData, MeshAttribute, TextureData, lambert
from maquette.materials import traits
from maquette.render.accel.bvh_build import opacity_maps
from maquette.render.surface import alpha, interaction
from maquette.render.types import Hit

from ...tables import grey, matrix, mesh, rays, scene
from ...tracing import random_rays, same


def leaf(random, wrap=ir.Wrap.REPEAT, nearest=False, gain=1.0, size=(24, 17)):
    """`prepare` of a scene with a material of an image that is 0 in parts, 1 in others and between at few texels."""

    def prepare(builder):
        texels = np.ones((*size, 4))
        y, x = np.mgrid[0 : size[0], 0 : size[1]]
        texels[..., 3] = np.clip(np.hypot(x - size[1] / 2, y - size[0] / 2) - 4, 0, 1)
        texels[random.integers(size[0]), random.integers(size[1]), 3] = 0.4
        image = builder.image(texels)
        texture = builder.texture(TextureData(
            ir.TextureKind.IMAGE, image, wrap_u=wrap, wrap_v=ir.Wrap.CLAMP, nearest=nearest, channel=3, gain=(gain, gain, gain),
            frame=((1.3, 0.2, -0.4), (-0.1, 0.8, 0.3)),
        ))  # fmt: skip
        cut = {**lambert(grey(1.0)).inputs, ir.Slot.OPACITY: Input.number(1.0, texture)}
        return [lambert(grey(1.0)), *(MaterialData(ir.MaterialModel.LAMBERT, cut, threshold=threshold) for threshold in (0.0, 0.5))]

    return prepare


def leaves(seed, reach=1.5, count=12, **of):
    random = np.random.default_rng(seed)
    corners, triangles = random.uniform(-2, 2, (3 * count, 3)), np.arange(3 * count).reshape(-1, 3)
    uvs = MeshAttribute(random.uniform(-reach, reach, (3 * count, 2)))
    tree = mesh(corners, triangles, uvs=uvs)
    other = mesh(corners[:9] + 0.5, triangles[:3])
    placed = [(tree, matrix(), 1), (tree, matrix((1, 0, 0)), 2), (tree, matrix(), 0), (other, matrix(), 1)]
    return scene((), placed, prepare=leaf(random, **of))


def states(tables, random, count=4000):
    """(states by the maps, opacities) of random points of the first two instances, with the share of certain ones."""
    partial = traits.partial(tables)[tables.instances.material]
    maps = opacity_maps.build(tables, partial)
    instance, u, v = random.integers(0, 2, count), random.random(count), random.random(count)
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    g = tables.instances.geometry[instance]
    triangle = tables.geometries.first_triangle[g] + random.integers(0, tables.geometries.triangle_count[g])
    column, row = ((x * maps.size).astype(int) for x in (u, v))
    cell = (maps.of_triangle[maps.first[instance] + triangle] * maps.size + row) * maps.size + column
    hit = Hit(np.ones(count), instance, triangle, u, v)
    point = interaction.make_interaction(tables, rays(np.zeros((count, 3)), np.ones((count, 3))), hit)
    return maps, maps.cells[cell], alpha.opacity_at(tables, point)


@pytest.mark.parametrize(
    "of", [{}, {"wrap": ir.Wrap.CLAMP}, {"nearest": True}, {"gain": 1.7}, {"gain": 0.45}, {"reach": 40.0}, {"reach": 0.0}, {"size": (1, 1)}]
)
def test_certain_cells_have_that_opacity(of):
    seen = set()
    for seed in range(3):
        _, state, opacity = states(leaves(seed, **of), np.random.default_rng(seed + 9))
        assert np.all(opacity[state == opacity_maps.OPAQUE] >= 1.0 - 1e-12)
        assert np.all(opacity[state == opacity_maps.ABSENT] == 0.0)
        seen |= set(state.tolist())
    assert opacity_maps.UNKNOWN in seen or of.get("reach") == 0.0 or "size" in of
    assert len(seen) > 1 or "reach" in of


def test_small_triangles_are_mostly_certain():
    maps, state, _ = states(leaves(1, reach=0.3), np.random.default_rng(0))
    assert maps.size == 64
    assert np.mean(state == opacity_maps.UNKNOWN) < 0.35


def test_only_images_that_repeat_or_are_clamped_have_maps():
    tables = leaves(0, wrap=ir.Wrap.MIRROR)
    maps = opacity_maps.build(tables, traits.partial(tables)[tables.instances.material])
    assert len(maps.cells) == 0
    assert np.all(maps.first == opacity_maps.NONE)
    tables = leaves(0)
    maps = opacity_maps.build(tables, traits.partial(tables)[tables.instances.material])
    assert (maps.first != opacity_maps.NONE).tolist() == [True, True, False, False]
    assert len(maps.cells) == 24 * maps.size**2


def test_many_triangles_have_coarser_maps_or_none(monkeypatch):
    tables = leaves(0)
    partial = traits.partial(tables)[tables.instances.material]
    monkeypatch.setattr(opacity_maps, "MOST_CELLS", 24 * 16 * 16)
    assert opacity_maps.build(tables, partial).size == 16
    for name, limit in (("MOST_CELLS", 24), ("MOST_TRIANGLES", 23)):
        with monkeypatch.context() as patch:
            patch.setattr(opacity_maps, name, limit)
            maps = opacity_maps.build(tables, partial)
        assert np.all(maps.first == opacity_maps.NONE)
        assert len(maps.cells) == 0


@pytest.mark.parametrize("bit", [1, 2])
def test_rays_hit_the_same_with_maps(bit):
    """Bit for bit: rays in numpy evaluate every opacity."""
    t = same(leaves(4), random_rays(1500, 3, 4.0), bit)[0]
    assert np.isfinite(t).any()
