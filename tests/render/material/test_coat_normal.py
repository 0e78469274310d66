"""Coats with normals of their own: their normals at points, energy, densities and directions of highlights."""

from __future__ import annotations

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.scene.row_records import Input, MaterialData, TextureData
from maquette.materials import openpbr
from maquette.render.integrator import direct_light
from maquette.render.lanes import ops
from maquette.render.material import anisotropic_facets, bsdf, principled, slabs
from maquette.render.material.shader import evaluate_shader
from maquette.render.surface import interaction, normal_map, tangent_frame

from .. import tables as make
from ..chi2 import chi2
from ..surface.test_normal_map import SQUARE, TILT, TWO, UVS, MeshAttribute
from .slab_scenes import UP, USES, given, lanes, numbers, point_of, towards

Slot = ir.Slot
LEAN = 0.6, 0.8, 0.0  # TILT on the square


def scene(rounded=0.0, /, **slots):
    """Tables of a square of slabs: each slot is a normal map of one direction, or a constant. `rounded`: slope of normals at corners."""

    def prepare(builder):
        image = builder.image(np.array([[[*((np.array(TILT) + 1) / 2), 1.0]]]))
        texture = builder.texture(TextureData(ir.TextureKind.IMAGE, image, gain=(2.0, 2.0, 2.0), bias=(-1.0, -1.0, -1.0)))
        inputs = {Slot[name]: Input((1.0, 1.0, 1.0), texture) if value == "map" else Input(value) for name, value in slots.items()}
        return [openpbr.data({Slot.COAT: Input.number(1.0), **inputs})]

    normals = SQUARE * rounded + [0.0, 1.0, 0.0]
    normals = {"normals": MeshAttribute(normals / np.linalg.norm(normals, axis=1, keepdims=True))} if rounded else {}
    data = make.mesh(SQUARE, TWO, uvs=MeshAttribute(UVS), **normals)
    return principled.tables_for(make.scene(meshes=[(data, make.matrix(), 0)], prepare=prepare))


def point_at(tables):
    ray = make.rays((0.2, 1, 0.1), (0, -1, 0))
    hit = make.first_hit(tables, ray)
    point = normal_map.apply_maps(tables, interaction.make_interaction(tables, ray, hit), hit, ray.direction)
    return tangent_frame.attach(tables, point, hit)


@pytest.mark.parametrize(
    ("slots", "base", "coat"),
    [
        ({"COAT_NORMAL": "map"}, UP, LEAN),
        ({"NORMAL": "map", "COAT_NORMAL": (0.0, 0.0, 1.0)}, LEAN, UP),
        ({"NORMAL": "map", "COAT_NORMAL": "map"}, LEAN, LEAN),
        ({"NORMAL": "map", "COAT_NORMAL": "map", "ANISOTROPY": (0.5, 0.5, 0.5)}, LEAN, LEAN),
    ],
)
def test_normals_of_coats(slots, base, coat):
    tables = scene(**slots)
    point = point_at(tables)
    part = evaluate_shader(tables, point).slabs
    assert np.ravel(point.normal) == pytest.approx(base, abs=1e-6)
    assert np.ravel(tangent_frame.coat_of(point.tangent)) == pytest.approx(coat, abs=1e-6)
    assert np.ravel(part.coat_normal) == pytest.approx(coat, abs=1e-6)
    for facets, normal in ((part.facets, base), (part.coat_facets, coat)):
        assert abs(np.dot(np.ravel(facets.along), normal)) < 1e-6
        assert abs(np.dot(np.ravel(facets.across), normal)) < 1e-6


def kinds_of(part):
    """The types of a nest of tuples and arrays, by which kernels are chosen."""
    if isinstance(part, tuple):
        return type(part), [kinds_of(each) for each in part]
    return (part.dtype, part.shape[1:]) if isinstance(part, np.ndarray) else type(part)


def test_slabs_with_and_without_such_coats_and_dispersion_share_general_kernels():
    placed = make.matrix()
    glass = MaterialData(ir.MaterialModel.GLASS, {Slot.DISPERSION: Input.number(0.5), Slot.IOR: Input.number(1.5)})
    scenes = [
        make.scene([(ir.GeometryKind.SPHERE, (1.0,), placed, 0)], materials=[material])
        for material in (openpbr.data({}), openpbr.data({Slot.COAT: Input.number(1.0), Slot.COAT_NORMAL: openpbr.SMOOTH_COAT}), glass)
    ]  # fmt: skip
    plain, coated, split = (kinds_of(principled.tables_for(each, general=True, space="rec709").materials) for each in scenes)
    assert plain == coated
    assert plain == split


def test_scenes_without_such_coats_keep_their_tables():
    for slots in ({}, {"NORMAL": "map"}):
        tables = scene(**slots)
        assert not isinstance(getattr(getattr(tables.materials, "tangents", None), "coats", None), normal_map.CoatNormals)
        assert evaluate_shader(tables, point_at(tables)).slabs.coat_normal is None


def test_light_below_the_normal_of_the_base_arrives_at_the_coat_above_the_facet():
    """Light from the sky that only the coat faces begins where other light does: above a facet that stands for a rounded surface."""
    point = point_at(scene(0.3, NORMAL="map", COAT_NORMAL=(0.0, 0.0, 1.0)))
    raised, place = np.ravel(interaction.shadow_origin(point)), np.ravel(point.position)
    assert raised[1] > place[1] + 0.01
    below_base, below_both = ops.normalize((-0.95, 0.3, 0.0)), ops.normalize((-0.95, -0.1, 0.0))
    assert np.dot(below_base, np.ravel(point.normal)) < 0 < below_base[1]
    for direction, expected in (((0.0, 1.0, 0.0), raised), (below_base, raised), (below_both, place)):
        origin = direct_light._shadow_origin(point, tuple(np.array([c]) for c in direction))
        assert np.ravel(origin) == pytest.approx(expected, abs=1e-9), direction


def leaning(lean, **arguments):
    """(point, shader) of a coat that leans by an angle from its base."""
    point, shader = point_of(given(coat_weight=1, **arguments))
    normal = towards(lean)
    along, across = tangent_frame.frame(None, lanes(normal, shader.slabs.coat), True)
    facets = shader.slabs.coat_facets
    moved = anisotropic_facets.Facets(along, across, facets.first, facets.second, facets.alpha)
    part = shader.slabs._replace(coat_normal=lanes(normal, shader.slabs.coat), coat_facets=moved)
    return point, shader._replace(slabs=part)


def test_a_coat_that_leans_by_nothing_is_the_plain_one():
    rng = np.random.default_rng(3)
    turns, heights = rng.uniform(0, 6.28, (2, 100)), rng.uniform(0.05, 1, (2, 100))
    light, viewer = ((np.sqrt(1 - h * h) * np.cos(t), h, np.sqrt(1 - h * h) * np.sin(t)) for t, h in zip(turns, heights, strict=True))
    up = lanes(UP, turns[0])
    upright, plain = (bsdf.reflected(shader, up, light, viewer) for shader in (leaning(0.0)[1], point_of(given(coat_weight=1))[1]))
    assert np.array(upright) == pytest.approx(np.array(plain), rel=1e-12)


@pytest.mark.parametrize(("lean", "angle", "turn"), [(0.3, 0.4, 0.0), (0.3, 0.9, 2.0), (0.6, 0.2, 1.0)])
@pytest.mark.parametrize("arguments", [{"coat_roughness": 0.3}, {"coat_roughness": 0.3, "base_metalness": 1, "specular_roughness": 0.5}])
def test_samples_follow_the_density(arguments, lean, angle, turn):
    _, shader = leaning(lean, **arguments)
    u, v, which = np.random.default_rng(1).random((3, 90000))
    up, viewer = lanes(UP, u), lanes(towards(angle, turn), u)
    direction, counts = slabs.draw(shader.slabs, up, viewer, u, v, which, np.full(u.shape, True))

    def density(directions):
        flat = [np.ravel(c) for c in np.broadcast_arrays(*directions)]
        value = bsdf.eval_bsdf_pdf(shader, USES, lanes(UP, flat[0]), tuple(flat), lanes(towards(angle, turn), flat[0]))[1]
        return value.reshape(np.broadcast(*directions).shape)

    chi2(direction, counts, density)


@pytest.mark.parametrize("lean", [0.0, 0.2, 0.5])
def test_a_white_base_under_a_leaning_coat_gains_little(lean):
    """Both boundaries take their shares by their own normals: the sum stays near 1."""
    point, shader = leaning(lean, base_color=1, coat_roughness=0.2, coat_darkening=0)
    u, v, which = numbers(90)
    wide = point._replace(**{k: lanes(getattr(point, k), u) for k in ("geometric", "normal")}, front=np.broadcast_to(point.front, u.shape))
    for angle in (0.0, 0.7, 1.2):
        weight = bsdf.sample_bsdf(shader, USES, wide, lanes(towards(angle), u), u, v, which).weight[0]
        assert 0.85 <= float(np.mean(weight)) <= 1.03


def test_the_highlight_lies_about_the_coats_normal():
    _, shader = leaning(0.4, coat_roughness=0.1, base_color=0, specular_weight=0)
    u, v, which = numbers(30)
    direction, counts = slabs.draw(shader.slabs, lanes(UP, u), lanes(UP, u), u, v, 0.0 * which, np.full(u.shape, True))
    mirrored = ops.reflect(tuple(-c for c in lanes(UP, u)), lanes(towards(0.4), u))
    cosines = ops.dot(direction, mirrored)[counts]
    assert np.median(cosines) > 0.999
