"""Tests of BSDFs against closed forms: Fresnel, Snell, and albedos of lobes by quadrature."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from maquette.compiler import ir
from maquette.compiler.scene.row_records import Input, TextureData
from maquette.render.lanes import ops
from maquette.render.material import bsdf, fresnel
from maquette.render.material.shader import evaluate_shader
from maquette.render.surface import interaction

from .. import tables as make

K = ir.GeometryKind
BLINN = ir.MaterialModel.BLINN_PHONG
PHONG = ir.MaterialModel.PHONG
UP = (0.0, 1.0, 0.0)


def shader(material, prepare=None, color=None):
    """A material's numbers on a plane, seen straight from above."""
    tables = make.scene([(K.PLANE, (), make.matrix(), 0)], materials=[material], prepare=prepare)
    ray = make.rays((0.3, 1, 0.2), (0, -1, 0))
    return evaluate_shader(tables, interaction.make_interaction(tables, ray, make.first_hit(tables, ray)))


def hemisphere(n=150):
    """Directions (x, y up, z) over the upper half and their solid angles, by Gauss–Legendre in the cosine."""
    nodes, weights = np.polynomial.legendre.leggauss(n)
    cosine, weight = (nodes + 1) / 2, weights / 2
    phi = (np.arange(2 * n) + 0.5) * math.pi / n
    cosine, phi = np.meshgrid(cosine, phi)
    sine = np.sqrt(1 - cosine**2)
    return (sine * np.cos(phi), cosine, sine * np.sin(phi)), np.broadcast_to(weight, cosine.shape) * math.pi / n


def albedo(material, tilt):
    """What share of the light from a direction leaves in all directions: ∫ L cos θ dω / E, with E = cos(tilt) and I = E⊥/π."""
    to_light = (math.sin(tilt), math.cos(tilt), 0.0)
    out, solid = hemisphere()
    found = bsdf.reflected(shader(material), UP, to_light, out)[0]
    return float(np.sum(found * out[1] * solid)) / math.pi / math.cos(tilt)


def test_phong_with_exponent_one_gives_too_much_until_it_is_normalized():
    assert albedo(make.phong(1.0, 1.0, 1.0), 0.0) == pytest.approx(1 + 2 / 3, rel=1e-6)
    assert albedo(make.phong(0.0, 1.0, 1.0, normalized=True), 0.0) == pytest.approx(1.0, rel=1e-6)


def test_lambert_leaves_its_albedo():
    for tilt in (0.0, 0.7, 1.4):
        assert albedo(make.phong(0.6, model=ir.MaterialModel.LAMBERT), tilt) == pytest.approx(0.6, rel=1e-9)


@pytest.mark.parametrize("model", [PHONG, BLINN])
@pytest.mark.parametrize("n", [0.0, 0.5, 1.0, 33.0])
def test_no_highlight_on_the_side_away_from_the_light(model, n):
    """A negative cosine to a power is NaN or bright for even n, and 0⁰ is 1: all of them must be 0."""
    material = shader(make.phong(0.7, 1.0, n, model))
    viewer = (math.sqrt(0.5), math.sqrt(0.5), 0.0)
    angle = np.linspace(math.pi / 2 + 1e-12, 3 * math.pi / 2, 101)
    to_light = (np.sin(angle), np.cos(angle), 0 * angle)
    assert np.all(np.stack(bsdf.reflected(material, UP, to_light, viewer)) == 0.0)


@pytest.mark.parametrize("model", [PHONG, BLINN])
def test_a_highlight_whose_cosine_is_negative_is_nothing(model):
    """The mirrored light points away from the viewer though the light is above: V·R < 0."""
    material = shader(make.phong(0, 1.0, 3.0, PHONG))
    to_light = ops.normalize((1.0, 0.2, 0.0))
    assert bsdf.reflected(material, UP, to_light, to_light)[0] == 0.0


def test_highlight_in_the_mirrored_direction_is_the_whole_of_ks():
    to_light, viewer = (0.6, 0.8, 0.0), (-0.6, 0.8, 0.0)
    for model in (PHONG, BLINN):
        assert bsdf.reflected(shader(make.phong(0, 0.4, 50.0, model)), UP, to_light, viewer)[0] == pytest.approx(0.4, rel=1e-12)


@pytest.mark.parametrize("model", [PHONG, BLINN])
@pytest.mark.parametrize("normalized", [False, True])
def test_sampling_a_lobe_agrees_with_integrating_it(model, normalized):
    """The mean of sampled shares is ∫ f_lobe dω / π over the upper half for light of radiance 1 from everywhere."""
    material = shader(make.phong(0, 0.8, 12.0, model, normalized=normalized))
    viewer = (math.sin(0.9), math.cos(0.9), 0.0)
    d, solid = hemisphere(200)
    expected = float(np.sum(bsdf.reflected(material, UP, d, viewer)[0] * solid)) / math.pi
    u, v = np.meshgrid((np.arange(300) + 0.5) / 300, (np.arange(300) + 0.5) / 300)
    with np.errstate(all="ignore"):
        direction, share = bsdf.sample_lobe(material, UP, viewer, u, v, u)
    assert float(np.mean(share[0])) == pytest.approx(expected, rel=4e-3)
    assert np.abs(ops.length(direction) - 1).max() < 1e-12


# --- boundaries between media ---


@pytest.mark.long
@given(st.floats(-1e-6, 1e-6), st.floats(1.01, 3.0))
@settings(max_examples=200, deadline=None)
def test_reflected_and_refracted_add_up_to_one_about_the_critical_angle(off, n):
    """On one branch: where the root's argument rounds below zero nothing is NaN, all is reflected and nothing refracted."""
    sine = 1 / n + off
    cosine = math.sqrt(max(0.0, 1 - sine * sine))
    share, bent, total = fresnel.fresnel(np.float64(cosine), np.float64(n))
    assert 0.0 <= share <= 1.0
    assert np.isfinite(bent)
    assert (share == 1.0) if total else (share <= 1.0)
    if abs(off) > 1e-9:
        assert bool(total) == (off > 0)


@pytest.mark.long
@given(st.floats(0, 1.5), st.floats(0, 2 * math.pi), st.floats(0.4, 2.5))
@settings(max_examples=200, deadline=None)
def test_snells_law(theta, phi, n):
    """n₁ sin θ₁ = n₂ sin θ₂, in the plane of incidence, unit length."""
    d = (math.sin(theta) * math.cos(phi), -math.cos(theta), math.sin(theta) * math.sin(phi))
    eta = np.float64(1 / n)
    cosine = np.float64(math.cos(theta))
    _, bent, total = fresnel.fresnel(cosine, eta)
    if total:
        assert math.sin(theta) / n >= 1 - 1e-12
        return
    out = fresnel.refract(d, UP, cosine, bent, eta)
    assert float(ops.length(out)) == pytest.approx(1.0, abs=1e-12)
    assert math.hypot(out[0], out[2]) == pytest.approx(math.sin(theta) / n, abs=1e-12)
    assert out[1] < 0
    assert out[0] * d[2] - out[2] * d[0] == pytest.approx(0, abs=1e-12)


def test_index_one_goes_straight_on():
    d = ops.normalize((0.3, -0.5, 0.1))
    share, bent, _ = fresnel.fresnel(-d[1], np.float64(1.0))
    assert share == pytest.approx(0.0, abs=1e-30)
    assert np.allclose(fresnel.refract(d, UP, -d[1], bent, 1.0), d, atol=1e-15)


# --- inputs ---


def test_a_texture_multiplies_the_constant():
    def prepare(builder):
        row = builder.texture(TextureData(ir.TextureKind.CHECKER, color_a=(0.5, 0.25, 1.0), color_b=(0.5, 0.25, 1.0)))
        return [make.phong(Input((0.5, 0.5, 0.5), row), shininess=Input.number(40.0, row))]

    found = shader(None, prepare)
    assert tuple(float(np.squeeze(c)) for c in found.diffuse) == pytest.approx((0.25, 0.125, 0.5))
    assert float(np.squeeze(found.shininess)) == pytest.approx(20.0)
