"""Tests of microfacet BSDFs: energy, reciprocity, densities and closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.scene.row_records import Input, MaterialData
from maquette.render.integrator.state import path_state
from maquette.render.lanes import ops
from maquette.render.material import bsdf, energy_compensation, further_bounces, microfacet, principled, rough_dielectric
from maquette.render.material.shader import ONLY, Uses, evaluate_shader
from maquette.render.sampling import sobol
from maquette.render.surface import interaction

from .. import tables as make
from ..chi2 import chi2

K = ir.GeometryKind
Model = ir.MaterialModel
UP = (0.0, 1.0, 0.0)
USES = Uses(glossy=True, sharp=True, shines=True, ambient=True, sky=True)
ANGLES = (0.0, 0.6, 1.1, 1.4)


def given(model=Model.PRINCIPLED, **slots):
    """A material from inputs by slot name: grey numbers or colours."""
    plain = {"roughness": 0.5, "diffuse": 0.0, "ambient": 1.0, "edge": 1.0} | slots
    inputs = {ir.Slot[name.upper()]: Input(value if isinstance(value, tuple) else (value, value, value)) for name, value in plain.items()}
    return MaterialData(model, inputs)


def point_of(material, inside=False):
    """(Surface, Shader) of a plane of a material, seen from above; `inside`: a plane that is turned over."""
    placed = make.matrix(linear=np.diag([1.0, -1.0, -1.0])) if inside else make.matrix()
    tables = principled.tables_for(make.scene([(K.PLANE, (), placed, 0)], materials=[material]))
    ray = make.rays((0.3, 1, 0.2), (0, -1, 0))
    point = interaction.make_interaction(tables, ray, make.first_hit(tables, ray))
    return point, evaluate_shader(tables, point)


def towards(angle, turn=0.0):
    return (math.sin(angle) * math.cos(turn), math.cos(angle), math.sin(angle) * math.sin(turn))


def numbers(n):
    """n·n pairs of Sobol points and a third number each, as columns."""
    pixel = np.zeros(n * n, np.int64)
    sample = np.arange(n * n)
    u, v = sobol.pair(pixel, sample, np.int64(1), 3)
    return u, v, sobol.pair(pixel, sample, np.int64(2), 3)[0]


def scattered(material, angle, n=90, random=False, inside=False):
    """What `scatter` gives for many random numbers: the weights' mean is the material's reflectance to this angle."""
    point, shader = point_of(material, inside)
    u, v, which = np.random.default_rng(1).random((3, n * n)) if random else numbers(n)
    lanes_of = [np.broadcast_to(x, u.shape) for x in towards(angle)]
    wide = point._replace(**{k: tuple(np.broadcast_to(c, u.shape) for c in getattr(point, k)) for k in ("geometric", "normal")})
    wide = wide._replace(front=np.broadcast_to(point.front, u.shape))
    return bsdf.sample_bsdf(shader, USES, wide, tuple(lanes_of), u, v, which), shader


def reflectance(material, angle, n=90):
    weight = scattered(material, angle, n)[0].weight
    return [float(np.mean(c)) for c in weight]


def energy(material, angle, inside=False, n=300):
    """(Reflectance, standard error of as many independent samples: these are Sobol points, and nearer)."""
    weight = scattered(material, angle, n, inside=inside)[0].weight[0]
    return float(np.mean(weight)), float(np.std(weight)) / n


METAL = {"model": Model.METAL, "specular": 1.0}
LOSSLESS = {
    "metal": METAL,
    "white under a highlight": {"diffuse": 1.0, "ior": 1.5},
    "white under a strong highlight": {"diffuse": 1.0, "ior": 2.4},
    "white metal": {"diffuse": 1.0, "ior": 1.5, "metallic": 1.0},
    "specular workflow": {"model": Model.PRINCIPLED_SPECULAR, "diffuse": 1.0, "specular": 0.3},
    "coated white": {"diffuse": 1.0, "ior": 1.5, "coat": 1.0, "coat_roughness": 0.2},
}


@pytest.mark.long
@pytest.mark.parametrize("roughness", [0.0, 0.1, 0.35, 0.7, 1.0])
@pytest.mark.parametrize("name", LOSSLESS)
def test_what_loses_nothing_is_white_in_a_white_room(name, roughness):
    for angle in ANGLES:
        found, error = energy(given(**LOSSLESS[name], roughness=roughness), angle)
        assert 0.98 <= found <= 1 + 3 * error, (angle, found, error)


def whole(name, roughness, cosine):
    """At the most, what a material of `LOSSLESS` sends on under cosines: its highlights by quadrature, the matt part by its own law.

    What is under a coat counts by the lesser of what it lets through on both ways: by that of this way, at the most.
    """
    lobes = point_of(given(**LOSSLESS[name], roughness=roughness))[1].lobes
    numbers_ = (lobes.alpha, lobes.f90, lobes.coat_alpha, lobes.coat, lobes.f0[0])
    alpha, f90, alpha_coat, coat_share, f0 = (float(np.ravel(x)[0]) for x in numbers_)
    e, b = energy_compensation.integrals(cosine, np.full_like(cosine, alpha), 60, 40)
    c, g = energy_compensation.integrals(cosine, np.full_like(cosine, alpha_coat), 60, 40)
    coat = coat_share * (microfacet.COAT * (c - g) + g)
    highlight = f0 * (e - b) + f90 * b
    all_, out = microfacet.viewer_albedo(lobes, UP, (np.sqrt(1 - cosine**2), cosine, 0 * cosine))
    nodes, weights = np.polynomial.legendre.leggauss(200)
    matt = np.zeros_like(cosine)
    for mu, w in zip(0.5 * (nodes + 1), weights, strict=True):
        matt += (
            w
            * mu
            * microfacet.diffuse_under_layers(lobes, all_, out, microfacet.directional_albedo(lobes, np.asarray(mu)))[0]
        )
    of = np.full_like(cosine, alpha)
    wide = energy_compensation.spread_alpha(of)
    lit, away, to = energy_compensation.over_visible_normals(cosine, wide, 60, 40)
    out_of, wide, of, to = cosine[:, None, None], wide[:, None, None], np.full_like(to, alpha), np.minimum(to, 1.0)
    up = np.minimum(0.5 * (to + out_of) / np.maximum(1.0 - away, 1e-12), 1.0) ** 2
    columns = [np.broadcast_to(energy_compensation.column_of(z, of), of.shape) for z in (out_of, to)]
    factor, s, v, c = further_bounces.pair(lobes.table.pairs, *columns, of, wide**2 * up / (1.0 - up + wide**2 * up))
    share = further_bounces.colour((f0, f0, f0), f90, (0.0, 0.0, 0.0), of, s, v, c)[0]
    again = out.again * (lit * energy_compensation.further_bounces(lobes.table, to, of) * factor * share).sum(axis=(-2, -1))
    return coat + (1 - coat) * (highlight + again) + matt


@pytest.mark.long
@pytest.mark.parametrize("name", LOSSLESS)
def test_nothing_sends_on_more_than_it_gets(name):
    """By quadrature, at many roughnesses and cosines: tables are never more than the truth where they say what is lost."""
    cosine = np.concatenate([np.geomspace(0.02, 0.1, 6), np.linspace(0.13, 1, 14)])
    for roughness in (0.035, 0.05, 0.1, 0.2, 0.33, 0.5, 0.61, 0.75, 0.9, 1.0):
        found = whole(name, roughness, cosine)
        assert found.max() <= 1 + 1e-6, (roughness, cosine[found.argmax()], found.max())
        assert found.min() >= 0.98, (roughness, cosine[found.argmin()], found.min())


@pytest.mark.parametrize("name", ["metal", "white under a highlight"])
@pytest.mark.parametrize(("roughness", "angle"), [(0.03, 1.55), (0.1, 1.5), (0.2, 1.5)])
def test_nothing_is_gained_at_grazing_angles(name, roughness, angle):
    """Where a polished highlight's E and B bend most; tables too coarse there gave 1.026."""
    found, error = energy(given(**LOSSLESS[name], roughness=roughness), angle)
    assert 0.99 <= found <= 1 + 3 * error


def test_tables_are_near_to_their_integrals():
    root, angle = np.meshgrid([0.03, 0.06, 0.1, 0.2, 0.35, 0.7, 1.0], [0.0, 0.6, 1.1, 1.4, 1.5, 1.55])
    alpha, cosine = root.ravel() ** 2, np.cos(angle.ravel())
    for told, true in zip(
        energy_compensation.directional_albedo(energy_compensation.table(), cosine, alpha),
        energy_compensation.integrals(cosine, alpha, 60, 40),
        strict=True,
    ):
        assert np.abs(told - true).max() < 0.003


@pytest.mark.parametrize("roughness", [0.05, 0.4, 1.0])
def test_nothing_gives_more_than_it_gets(roughness):
    metal = {"model": Model.METAL, "specular": (1.0, 0.8, 0.3), "edge": 0.7}
    for slots in ({"diffuse": (1.0, 0.5, 0.0), "coat": 0.7, "metallic": 0.3}, metal):
        for angle in (*ANGLES, 1.55):
            found = reflectance(given(**slots, roughness=roughness), angle)
            assert max(found) <= 1.004
            assert min(found) >= 0.0


@pytest.mark.parametrize("slots", [*LOSSLESS.values(), {"diffuse": (0.9, 0.4, 0.1), "metallic": 0.5, "coat": 0.6, "coat_roughness": 0.4}])
def test_light_may_go_either_way(slots):
    """π f cos over cos is the same with light and viewer exchanged."""
    shader = point_of(given(**slots, roughness=0.4))[1]
    rng = np.random.default_rng(5)

    def directions():
        z, turn = rng.uniform(0.02, 1.0, 64), rng.uniform(0.0, 2 * math.pi, 64)
        return np.sqrt(1 - z * z) * np.cos(turn), z, np.sqrt(1 - z * z) * np.sin(turn)

    a, b = directions(), directions()
    one, other = bsdf.reflected(shader, UP, a, b), bsdf.reflected(shader, UP, b, a)
    for c in range(3):
        np.testing.assert_allclose(one[c] / a[1], other[c] / b[1], rtol=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("angle", [0.3, 1.3])
@pytest.mark.parametrize(
    "slots",
    [
        {**METAL, "roughness": 0.3}, {**METAL, "roughness": 0.9}, {"diffuse": 0.6, "ior": 1.5, "roughness": 0.4},
        {"diffuse": 0.4, "ior": 1.5, "roughness": 0.8, "coat": 1.0, "coat_roughness": 0.3},
        {"diffuse": 0.5, "metallic": 0.5, "roughness": 0.0, "coat": 1.0, "coat_roughness": 0.5},
    ],
)  # fmt: skip
def test_directions_are_drawn_as_their_density_says(slots, angle):
    taken, shader = scattered(given(**slots), angle, 400, random=True)
    blunt = (taken.density < ONLY) & (taken.direction[1] > 0.0)
    viewer = towards(angle)

    def density(direction):
        return bsdf.eval_bsdf_pdf(shader, USES, UP, direction, viewer)[1]

    chi2(taken.direction, blunt, density)
    again = density(taken.direction)
    np.testing.assert_allclose(again[blunt], taken.density[blunt], rtol=1e-9)


def test_a_white_metal_as_rough_as_can_be_gives_back_1_less_ln_2_by_one_bounce():
    """Oracle 22: GGX, F = 1, α = 1, along the normal. With Smith's function for the viewer alone (what visible facets are), it is 1."""
    e, _ = energy_compensation.integrals(np.array(1.0), np.array(1.0))
    assert float(e) == pytest.approx(1.0 - math.log(2.0), abs=1e-4)
    assert float(
        energy_compensation.directional_albedo(energy_compensation.table(), np.array([1.0]), np.array([1.0]))[0][0]
    ) == pytest.approx(1.0 - math.log(2.0), abs=1e-3)


@pytest.mark.long
def test_the_tables_are_what_quadrature_says():
    cosine, alpha = np.meshgrid(np.linspace(0.02, 1.0, 25), np.linspace(0.08, 1.0, 20) ** 2)
    e, b = energy_compensation.integrals(cosine, alpha, 60, 40)
    found = energy_compensation.directional_albedo(energy_compensation.table(), cosine, alpha)
    assert np.abs(found[0] - e).max() < 0.01
    assert np.abs(found[1] - b).max() < 0.035


def test_facets_cover_the_plane():
    """∫ D cos = 1: all facets together have the area of the plane below them."""
    cosine = (np.polynomial.legendre.leggauss(500)[0] + 1) / 2
    weight = np.polynomial.legendre.leggauss(500)[1] / 2
    sine = np.sqrt(1 - cosine**2)
    half = (sine, cosine, 0 * sine)
    for alpha in (0.1, 0.5, 1.0):
        found = microfacet.ggx_distribution(half, tuple(np.broadcast_to(c, sine.shape) for c in UP), np.full(sine.shape, alpha))
        assert 2 * math.pi * float(np.sum(found * cosine * weight)) == pytest.approx(1.0, abs=1e-6)


def test_a_polished_one_mirrors_by_schlicks_law():
    point, shader = point_of(given(Model.PRINCIPLED_SPECULAR, specular=(0.2, 0.5, 0.9), roughness=0.0))
    for angle in ANGLES:
        direction = tuple(-c for c in towards(angle))
        found = bsdf.fresnel_split(point, shader, direction)[0]
        for channel, f0 in enumerate((0.2, 0.5, 0.9)):
            assert float(found[channel][0]) == pytest.approx(f0 + (1 - f0) * (1 - math.cos(angle)) ** 5, rel=1e-9)


def test_what_is_half_metal_reflects_half_as_either():
    lobes = point_of(given(diffuse=(0.9, 0.5, 0.1), metallic=0.5, ior=1.5))[1].lobes
    assert [float(c[0]) for c in lobes.f0] == pytest.approx([0.47, 0.27, 0.07])
    assert [float(c[0]) for c in lobes.base] == pytest.approx([0.45, 0.25, 0.05])


@pytest.mark.long
def test_every_draw_is_finite_where_it_grazes():
    for slots in LOSSLESS.values():
        for roughness in (0.0, 0.04, 1.0):
            for angle in (math.pi / 2 - 1e-9, math.pi / 2, math.pi / 2 + 0.1):
                taken, _ = scattered(given(**slots, roughness=roughness), angle, 16)
                assert np.isfinite(np.stack(taken.weight)).all()
                assert np.abs(ops.length(taken.direction) - 1.0).max() < 1e-6


# --- rough glass ---

GLASS = {"model": Model.GLASS, "transmission": 1.0, "ior": 1.5}
sides = pytest.mark.parametrize("inside", [False, True])


@pytest.mark.long
@sides
@pytest.mark.parametrize("roughness", [0.0, 0.1, 0.35, 0.7, 1.0])
def test_rough_glass_loses_nothing(roughness, inside):
    for angle in (*ANGLES, 1.54):
        found, error = energy(given(**GLASS, roughness=roughness), angle, inside)
        assert 0.98 <= found <= 1 + 3 * error, angle


@pytest.mark.long
@pytest.mark.parametrize("ratio", [1.33, 1.5, 2.4, 1 / 1.33, 1 / 1.5, 1 / 2.4])
def test_rough_glass_sends_on_no_more_than_it_gets(ratio):
    """By quadrature: what one meeting sends on, and what is tabled as lost to further ones, which come back in full at the most."""
    cosine = np.concatenate([np.geomspace(0.01, 0.1, 6), np.linspace(0.13, 1, 12)])
    made = rough_dielectric.AlbedoTables(np.zeros(1, np.int64), *rough_dielectric.albedo_table(max(ratio, 1 / ratio)))
    row, other = (0, rough_dielectric.ROWS) if ratio > 1 else (rough_dielectric.ROWS, 0)
    nodes, weights = np.polynomial.legendre.leggauss(100)
    for alpha in np.linspace(0.033, 1, 12) ** 2:
        frost = rough_dielectric.RoughGlass(np.True_, np.asarray(alpha), ratio, (1, 1, 1), row, other, made)
        lost = rough_dielectric.lost_share(frost, row, cosine)
        found = rough_dielectric.integral(cosine, np.full_like(cosine, alpha), ratio, 17711, 10946) + lost
        assert found.max() <= 1 + 1e-6, (alpha, cosine[found.argmax()], found.max())
        assert found.min() >= 0.99, (alpha, cosine[found.argmin()], found.min())
        mean = weights @ (0.5 * (nodes + 1) * rough_dielectric.lost_share(frost, row, 0.5 * (nodes + 1)))
        assert mean <= float(rough_dielectric.mean_lost_shares(frost)[0])


@pytest.mark.long
@sides
@pytest.mark.parametrize("angle", [0.3, 1.3])
@pytest.mark.parametrize("roughness", [0.3, 0.9])
def test_rough_glass_sends_light_as_its_density_says(roughness, angle, inside):
    taken, shader = scattered(given(**GLASS, roughness=roughness), angle, 400, random=True, inside=inside)
    viewer = towards(angle)
    chi2(taken.direction, taken.weight[0] > 0, lambda d: bsdf.eval_bsdf_pdf(shader, USES, UP, d, viewer)[1])


def test_light_goes_through_rough_glass_either_way():
    """On one side f is the same with light and viewer exchanged; through it, f over the other index squared (Veach 1997, §5.2)."""
    outside, inside = (point_of(given(**GLASS, roughness=0.6), k)[1] for k in (False, True))
    rng = np.random.default_rng(9)

    def directions():
        z, turn = rng.uniform(0.05, 1.0, 500), rng.uniform(0.0, 2 * math.pi, 500)
        return np.sqrt(1 - z * z) * np.cos(turn), z, np.sqrt(1 - z * z) * np.sin(turn)

    a, b = directions(), directions()
    for shader in (outside, inside):
        one, other = bsdf.reflected(shader, UP, a, b)[0], bsdf.reflected(shader, UP, b, a)[0]
        np.testing.assert_allclose(one / a[1], other / b[1], rtol=1e-9)
    below = (a[0], -a[1], a[2])
    inward = bsdf.reflected(outside, UP, below, b)[0] / a[1]  # light below, inside; viewer above
    outward = bsdf.reflected(inside, UP, (b[0], -b[1], b[2]), a)[0] / b[1]  # mirrored in the plane, so that the inside is up
    np.testing.assert_allclose(inward, outward * 1.5**2, rtol=1e-6)


def test_scenes_without_them_have_none():
    shader = point_of(make.phong(0.5))[1]
    assert shader.lobes is None
    assert shader.frost is None
    assert path_state.uses_of(make.scene([(K.PLANE, (), make.matrix(), 0)], materials=[make.phong(0.5)])).glossy is False
