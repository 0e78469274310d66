"""Tests of OpenPBR's slabs: energy, reciprocity, densities and closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.scene.row_records import Input, MaterialData
from maquette.render.lanes import ops
from maquette.render.material import anisotropic_facets, bsdf, dielectric_albedo, fuzz, microfacet, oren_nayar, slabs
from maquette.render.material.openpbr import bend_of

from ..chi2 import chi2
from .slab_scenes import UP, USES, energy, given, lanes, point_of, scattered, towards
from .test_microfacet import given as principled
from .test_microfacet import point_of as principled_point

ANGLES = (0.0, 0.6, 1.1, 1.4)
WHITE = {
    "metal": {"base_metalness": 1},
    "dielectric": {},
    "dense dielectric": {"specular_ior": 2.4},
    "rough base": {"base_diffuse_roughness": 1},
    "coat": {"coat_weight": 1, "coat_roughness": 0.2},
    "smooth coat": {"coat_weight": 1, "specular_ior": 2},
    "coated metal": {"base_metalness": 1, "coat_weight": 0.7, "coat_roughness": 0.1},
    "fuzz": {"fuzz_weight": 1, "fuzz_roughness": 0.3},
    "half metal": {"base_metalness": 0.5},
    "lines": {"specular_roughness_anisotropy": 0.9},
    "metal of lines": {"base_metalness": 1, "specular_roughness_anisotropy": 0.9},
    "film": {"thin_film_weight": 1, "thin_film_ior": 1.9, "thin_film_thickness": 0.12},
    "film on metal": {"thin_film_weight": 1, "base_metalness": 1, "thin_film_thickness": 0.3},
    "all": {"base_metalness": 0.3, "base_diffuse_roughness": 0.5, "coat_weight": 0.7, "coat_roughness": 0.4, "fuzz_weight": 0.5},
}
LEAST = {
    "film": 0.85,
    "film on metal": 0.6,
    "lines": 0.95,
    "coated metal": 0.93,
    "rough base": 0.95,
}  # fmt: skip; at any roughness and angle


@pytest.mark.long
@pytest.mark.parametrize("roughness", [0.0, 0.1, 0.2, 0.3, 0.45, 0.6, 0.75, 0.9, 1.0])
@pytest.mark.parametrize("name", WHITE)
def test_white_slabs_in_a_white_room(name, roughness):
    for angle in ANGLES:
        for turn in (0.0, math.pi / 2) if "lines" in name else (0.3,):
            share, error = energy(given(base_color=1, specular_roughness=roughness, **WHITE[name]), angle, turn=turn)
            assert LEAST.get(name, 0.97) - 3 * error <= share <= 1.002 + 3 * error, (angle, turn, share, error)


def test_a_white_ball_is_white():
    """The quick part of the test above."""
    for arguments in ({}, {"base_metalness": 1}, {"coat_weight": 1}, {"fuzz_weight": 1}):
        share, error = energy(given(base_color=1, **arguments), 0.7, 60)
        assert 0.97 <= share <= 1.002 + 3 * error, (arguments, share)


RECIPROCAL = {
    "metal": {"base_metalness": 1, "base_color": (0.9, 0.5, 0.2), "specular_color": (0.3, 0.6, 0.9)},
    "dielectric": {"base_diffuse_roughness": 0.7, "specular_color": (0.3, 0.6, 0.9)},
    "coat": {"coat_weight": 0.8, "coat_color": (0.9, 0.3, 0.5), "coat_roughness": 0.3, "coat_roughness_anisotropy": 0.5},
    "lines": {"specular_roughness_anisotropy": 0.9, "specular_rotation": 0.1, "base_metalness": 0.5},
}


@pytest.mark.parametrize("name", RECIPROCAL)
def test_light_goes_both_ways(name):
    """f is symmetric; fuzz alone is not."""
    rng = np.random.default_rng(3)
    shader = point_of(given(**RECIPROCAL[name], specular_roughness=0.4))[1]
    angles, turns = rng.uniform(0, 1.5, (2, 200)), rng.uniform(0, 2 * math.pi, (2, 200))
    one, two = ((np.sin(a) * np.cos(t), np.cos(a), np.sin(a) * np.sin(t)) for a, t in zip(angles, turns, strict=True))
    up = lanes(UP, angles[0])
    there, back = bsdf.reflected(shader, up, one, two), bsdf.reflected(shader, up, two, one)
    for a, b in zip(there, back, strict=True):
        assert np.allclose(a / one[1], b / two[1], rtol=1e-5)


SAMPLED = {
    "metal": {"base_metalness": 1},
    "lines": {"base_metalness": 1, "specular_roughness_anisotropy": 0.8, "specular_rotation": 0.1},
    "coat": {"coat_weight": 1, "coat_roughness": 0.3, "coat_roughness_anisotropy": 0.6},
    "fuzz": {"fuzz_weight": 1},
    "all": {"base_metalness": 0.4, "base_diffuse_roughness": 0.5, "coat_weight": 0.5, "coat_roughness": 0.5, "fuzz_weight": 0.5},
}


@pytest.mark.parametrize("name", SAMPLED)
@pytest.mark.parametrize(("roughness", "angle", "turn"), [(0.35, 0.3, 0.0), (0.6, 1.2, 0.8), (1.0, 0.8, 2.0)])
def test_samples_follow_the_density(name, roughness, angle, turn):
    material = given(**SAMPLED[name], specular_roughness=roughness)
    found, shader = scattered(material, angle, 300, turn, random=True)
    counted = found.direction[1] > 0

    def density(directions):
        flat = [np.ravel(c) for c in np.broadcast_arrays(*directions)]
        value = bsdf.eval_bsdf_pdf(shader, USES, lanes(UP, flat[0]), tuple(flat), lanes(towards(angle, turn), flat[0]))[1]
        return value.reshape(np.broadcast(*directions).shape)

    chi2(found.direction, counted, density)


@pytest.mark.parametrize("step", [0.05, 0.2, 0.4])
def test_fresnel_of_a_dielectric(step):
    """Snell's law and both polarizations (Hecht, Optics, 4.6)."""
    ratio = (1 + step) / (1 - step)
    cosine = np.linspace(0.01, 1, 50)
    bent = np.sqrt(1 - (1 - cosine**2) / ratio**2)
    across, along = (cosine - ratio * bent) / (cosine + ratio * bent), (ratio * cosine - bent) / (ratio * cosine + bent)
    assert np.allclose(dielectric_albedo.reflectance(cosine, np.full(50, step)), 0.5 * (across**2 + along**2), atol=1e-9)


def test_the_table_of_a_dielectric_is_an_upper_bound():
    rng = np.random.default_rng(7)
    for alpha in (1e-3, 0.04, 0.3, 0.9):
        for step in (0.03, 0.2, 0.41):
            cosine = rng.uniform(0.05, 1, 20)
            true = dielectric_albedo.integrals(cosine, np.full(20, alpha), [step], 40, 30)[0]
            read = dielectric_albedo.directional(dielectric_albedo.table(), cosine, np.full(20, alpha), np.full(20, step))
            assert np.all(read >= true - 2e-4)
            assert np.all(read <= true + (0.03 if alpha < 0.01 else 0.006)), (alpha, step, (read - true).max())


def test_f82_tint():
    """Of Schlick's reflectance, `specular_color` is left at 82 degrees: a cosine of 1/7. Along the normal it is the base colour."""
    f0, tint = (0.9, 0.5, 0.2), (0.3, 0.6, 0.9)
    shader = point_of(given(base_color=f0, specular_color=tint, base_metalness=1))[1]
    for cosine in (1.0, 1 / 7):
        found = slabs.metal_reflectance(shader.slabs, np.array([cosine]))
        for value, f, t in zip(found, f0, tint, strict=True):
            schlick = f + (1 - f) * (1 - cosine) ** 5
            assert float(value[0]) == pytest.approx(schlick * (t if cosine < 1 else 1), abs=1e-6)
    assert bend_of(0.5, 1.0) == 0.0


def test_equal_roughnesses_are_round_facets():
    rng = np.random.default_rng(1)
    facets = anisotropic_facets.facets((1.0, 0.0, 0.0), (0.0, 0.0, -1.0), 0.3, np.float64(0.6), np.float64(0.0))
    half = ops.normalize(tuple(rng.normal(size=(3, 100))))
    half = half[0], np.abs(half[1]), half[2]
    expected = microfacet.ggx_distribution(half, lanes(UP, half[0]), 0.36)
    assert np.allclose(anisotropic_facets.distribution(facets, anisotropic_facets.to_frame(facets, UP, half)), expected)


def test_the_highlight_is_long_along_the_tangent():
    """Facets are rough along the tangent, so that the highlight is long there, at a right angle to the scratches of brushed metal."""
    arguments = {"base_metalness": 1, "specular_roughness": 0.4, "specular_roughness_anisotropy": 0.8}
    for turns in (0.0, 0.25):
        shader = point_of(given(**arguments, specular_rotation=turns))[1]
        lengthwise, across = (tuple(float(np.ravel(c)[0]) for c in axis) for axis in shader.slabs.facets[:2])
        light = [tuple(0.5 * c + 0.87 * up for c, up in zip(axis, UP, strict=True)) for axis in (lengthwise, across)]
        found = [float(np.ravel(bsdf.reflected(shader, UP, ops.normalize(each), UP)[0])[0]) for each in light]
        assert found[0] > 10 * found[1], (turns, found)


def test_oren_nayar():
    """A roughness of 0 is Lambert's law, and white of any roughness keeps all light."""
    assert float(oren_nayar.value((0.3, 0.3, 0.3), 0.0, 0.4, 0.7, 0.1)[0]) == pytest.approx(0.3, abs=1e-6)
    nodes, weights = np.polynomial.legendre.leggauss(60)
    mu, turn = np.meshgrid(0.5 * (nodes + 1), np.pi * (nodes + 1), indexing="ij")
    weight = np.outer(weights * 0.5, weights * np.pi)
    for out in (0.1, 0.5, 1.0):
        between = mu * out + np.sqrt((1 - mu**2) * (1 - out**2)) * np.cos(turn)
        value = oren_nayar.value((np.ones_like(mu),) * 3, 0.8, mu, out, between)[0]
        assert float((value * mu * weight).sum() / np.pi) == pytest.approx(1.0, abs=2e-3)


def test_fuzz_sends_on_its_albedo():
    rng = np.random.default_rng(5)
    u, v = rng.random((2, 4000))
    viewer = lanes(towards(0.9, 0.4), u)
    direction = fuzz.sample(0.4, lanes(UP, u), viewer, u, v)
    assert np.all(direction[1] > 0)
    assert np.all(fuzz.density(0.4, lanes(UP, u), direction, viewer) > 0)
    assert 0.0 < float(fuzz.albedo(np.float64(0.2), 0.5)) < 1.0


def test_a_plain_dielectric_is_nearly_principled():
    """The same base under facets of the same width; Schlick's approximation is not Fresnel's equations."""
    shader, other = point_of(given(base_color=0.5))[1], principled_point(principled(diffuse=0.5, ior=1.5, roughness=0.3))[1]
    for angle in (0.0, 0.3, 0.5):
        for light in (towards(0.2, 0.5), towards(0.8, 2.0), towards(angle, math.pi)):
            one, two = (float(np.ravel(bsdf.reflected(s, UP, light, towards(angle))[0])[0]) for s in (shader, other))
            assert one == pytest.approx(two, rel=0.04), (angle, light)


def test_a_coat_of_its_color():
    """White light that passes the coat along the normal twice has its colour; darkening is off."""
    plain = point_of(given(base_color=1, specular_ior=1.6, coat_weight=1, coat_darkening=0))[1]
    tinted = point_of(given(base_color=1, specular_ior=1.6, coat_weight=1, coat_darkening=0, coat_color=(0.9, 0.5, 0.25)))[1]
    light = towards(0.02, 1.0)
    a, b = bsdf.eval_diffuse(plain, UP, light, towards(0.02)), bsdf.eval_diffuse(tinted, UP, light, towards(0.02))
    for before, after, color in zip(a, b, (0.9, 0.5, 0.25), strict=True):
        assert (after / before).item() == pytest.approx(color, rel=2e-3)


def test_a_coat_darkens_what_it_covers():
    light = towards(0.4, 1.0)
    shaders = [point_of(given(base_color=0.3, coat_weight=1, coat_darkening=share))[1] for share in (0, 1)]
    grey, dark = (float(bsdf.eval_diffuse(shader, UP, light, UP)[0].item()) for shader in shaders)
    assert 0.3 * grey < dark < 0.8 * grey


def test_other_scenes_have_no_slabs():
    assert point_of(MaterialData(ir.MaterialModel.LAMBERT, {ir.Slot.DIFFUSE: Input()}))[1].slabs is None


PASSAGES = {
    "glass": {"transmission_weight": 1},
    "half glass": {"transmission_weight": 0.5, "base_color": 1},
    "sheet": {"transmission_weight": 1, "thin_walled": 1},
    "bubble": {"transmission_weight": 1, "thin_walled": 1, "specular_ior": 1, "thin_film_weight": 1, "thin_film_thickness": 0.3},
    "body": {"subsurface_weight": 1},
    "half body": {"transmission_weight": 0.5, "subsurface_weight": 1, "subsurface_color": 1},
    "glass of lines": {"transmission_weight": 1, "specular_roughness_anisotropy": 0.9},
    "sheet of lines": {"transmission_weight": 1, "thin_walled": 1, "specular_roughness_anisotropy": 0.9},
    "leaf": {"subsurface_weight": 0.7, "subsurface_color": 1, "thin_walled": 1, "base_color": 1},
    "coated glass": {"transmission_weight": 1, "coat_weight": 1},
}


@pytest.mark.parametrize("inside", [False, True])
@pytest.mark.parametrize("name", PASSAGES)
def test_what_light_passes_gains_none(name, inside):
    """It loses at most 2 % from outside, and 9 % where light meets a rough boundary from inside."""
    for roughness, least in ((0.0, 0.98), (0.2, 0.98), (0.5, 0.97), (1.0, 0.98)):
        least = 0.91 if inside and roughness > 0.0 else least - 0.02 * ("coat" in name)
        for angle in (0.3, 1.3):
            share, error = energy(given(**PASSAGES[name], specular_roughness=roughness), angle, 50, 0.3, inside)
            assert share <= 1.005 + 3 * error, (roughness, angle, share, error)
            assert share >= least - 3 * error, (roughness, angle, share, error)


@pytest.mark.long
@pytest.mark.parametrize("inside", [False, True])
@pytest.mark.parametrize("name", ["glass", "sheet", "leaf", "half glass", "half body"])
def test_samples_that_pass_follow_the_density(name, inside):
    angle, turn = 0.7, 0.8
    arguments = {"specular_roughness": 0.6, "specular_roughness_anisotropy": 0.4}
    sample, shader = scattered(given(**PASSAGES[name], **arguments), angle, 300, turn, random=True, inside=inside)
    counted = sample.weight[0] > 0

    def density(directions):
        flat = [np.ravel(c) for c in np.broadcast_arrays(*directions)]
        share, value = bsdf.eval_bsdf_pdf(shader, USES, lanes(UP, flat[0]), tuple(flat), lanes(towards(angle, turn), flat[0]))
        return np.where(share[0] > 0, value, 0.0).reshape(np.broadcast(*directions).shape)

    chi2(sample.direction, counted, density, fine=60)


def test_polished_glass_refracts_by_snells_law():
    sample, _ = scattered(given(transmission_weight=1, specular_roughness=0), 0.6, 20)
    below = sample.direction[1] < 0
    assert below.mean() > 0.9
    sine = np.hypot(sample.direction[0], sample.direction[2])[below]
    assert np.allclose(sine, math.sin(0.6) / 1.5, atol=0.01)


def test_a_thin_wall_shows_what_lies_behind_it_in_place():
    sample, _ = scattered(given(transmission_weight=1, specular_roughness=0, thin_walled=1), 0.6, 20)
    below = sample.direction[1] < 0
    straight = [-c for c in towards(0.6)]
    assert below.mean() > 0.9
    assert all(np.median(c[below]) == pytest.approx(s, abs=0.01) for c, s in zip(sample.direction, straight, strict=True))
