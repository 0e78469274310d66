"""Tests of the light of further bounces between facets, against random walks on the microsurface."""

from __future__ import annotations

import math

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.render.lanes import ops
from maquette.render.material import bsdf, energy_compensation, microfacet, rough_dielectric
from maquette.render.material import further_bounces as further

from . import microsurface
from .microsurface import Bins
from .test_microfacet import UP, given, point_of, towards

GOLD, ALUMINIUM = (1.0, 0.71, 0.29), (0.91, 0.92, 0.92)
COSINES = (0.95, 0.5, 0.15)
COUNT = 150_000


def further_bounces(color, alpha, cosine, bins):
    """(channels, cosines, turns) share of the light of each bin by the BSDF: all of it, and without that of one bounce."""
    parts = lobes_towards(color, alpha, cosine, *microsurface.points(bins))
    return [np.stack([microsurface.integrate(c, bins) for c in part]) for part in parts]


def lobes_towards(color, alpha, cosine, z, turn):
    """(channels, directions) f cos of the BSDF towards cosines and turns: all of it, and without that of one bounce."""
    shader = point_of(given(ir.MaterialModel.METAL, specular=color, roughness=math.sqrt(alpha)))[1]
    flat = np.sqrt(1.0 - z * z)
    to, viewer = (flat * np.cos(turn), z, flat * np.sin(turn)), towards(math.acos(cosine))
    half = ops.normalize(ops.add(to, viewer))
    facets = microfacet.ggx_distribution(half, UP, alpha) * microfacet.smith_visibility(cosine, z, alpha) * z
    once = microsurface.schlick(color)(ops.dot(half, viewer)).T * facets
    whole = np.stack([np.asarray(c) / math.pi for c in bsdf.reflected(shader, UP, to, viewer)])
    return whole, whole - once


@pytest.mark.long
@pytest.mark.parametrize("color", [(1.0, 1.0, 1.0), GOLD])
@pytest.mark.parametrize("angle", [75, 80, 85])
@pytest.mark.parametrize("alpha", [0.3, 0.6, 1.0])
def test_silhouettes_of_rough_metals_are_as_bright_as_by_walks(alpha, angle, color):
    """The light sent to five cosines, over eight turns each: within 1 % and the walks' own error, which is 0.3 %."""
    cosine, to, turn = math.cos(math.radians(angle)), np.cos(np.radians([20, 45, 65, 75, 83])), math.pi * (np.arange(8) + 0.5) / 8
    z, turn = (x.ravel() for x in np.meshgrid(to, turn, indexing="ij"))
    flat = np.sqrt(1.0 - z * z)
    directions = np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1)
    walks = microsurface.sent_to(cosine, alpha, 60_000, microsurface.schlick(color), directions)
    whole, again = lobes_towards(color, alpha, cosine, z, turn)
    walks, whole, again = (x.reshape(3, 5, 8).mean(axis=2) for x in (walks, whole, again))
    assert np.abs(whole / (whole - again + walks) - 1.0).max() < 0.013


@pytest.mark.parametrize("alpha", [0.1, 0.3, 0.66, 1.0])
def test_light_of_further_bounces_keeps_its_colour_on_white_metal(alpha):
    table, columns = energy_compensation.table(), np.linspace(0.0, 1.0, 21)
    out, into = (x.ravel() for x in np.meshgrid(columns, columns))
    y, of = np.linspace(0.0, 1.0, len(out)), np.full(len(out), alpha)
    factor, s, v, c = further.pair(table.pairs, out, into, of, y)
    np.testing.assert_allclose(factor, further.pair(table.pairs, into, out, of, y)[0], rtol=1e-12)
    assert 0.01 < factor.min() < factor.max() < 1e4
    none = (0.0, 0.0, 0.0)
    np.testing.assert_allclose(further.colour((1.0, 1.0, 1.0), 1.0, none, of, s, v, c), 1.0, rtol=1e-12)
    black, grey = (further.colour((f, f, f), 1.0, none, of, s, v, c)[0] for f in (0.0, 0.5))
    assert black.min() >= 0.0
    assert np.all(black < grey)
    assert grey.max() < 1.0
    single = further.of_row(table.pairs, columns[:, None, None], into.reshape(21, 21, 1), alpha, y.reshape(21, 21, 1))[0]
    np.testing.assert_allclose(single.ravel(), further.pair(table.pairs, np.repeat(columns, 21), into, of, y)[0], rtol=1e-9)


def diffuse_lobe(alpha, bins):
    """(1, cosines, turns) shape of a reciprocal diffuse lobe that returns what one bounce loses (Kulla and Conty 2017)."""

    def lost(mu):
        return 1.0 - energy_compensation.integrals(mu, np.full_like(mu, alpha), 40, 30)[0]

    z = microsurface.points(bins)[0]
    rows = np.unique(z)
    found = microsurface.integrate(np.interp(z, rows, lost(rows)) * z, bins)
    return (found / found.sum())[None]


@pytest.mark.long
@pytest.mark.parametrize("alpha", [0.1, 0.3, 0.6, 1.0])
@pytest.mark.parametrize("cosine", COSINES)
def test_the_first_bounces_of_walks_are_the_tabled_integrals(alpha, cosine):
    """Within 4 standard errors. So the walks are those of this distribution and this shadowing."""
    metal = microsurface.conductor(cosine, alpha, COUNT, microsurface.schlick((1.0,)))
    one = float(energy_compensation.integrals(np.array(cosine), np.array(alpha), 60, 40)[0])
    assert np.mean(metal.bounces == 1) == pytest.approx(one, abs=4.0 * math.sqrt(one * (1.0 - one) / COUNT))
    assert np.mean(metal.bounces > microsurface.MOST) < 1e-3
    for ratio in (1.5, 1.0 / 1.5):
        glass = microsurface.dielectric(cosine, alpha, COUNT, ratio)
        one = float(rough_dielectric.integral(np.array(cosine), np.array(alpha), ratio, 17711, 10946))
        error = math.sqrt(max(one * (1.0 - one), 1e-6) / COUNT)
        assert np.mean(glass.bounces == 1) == pytest.approx(one, abs=4.0 * error + 1.5e-2 * (alpha == 0.1))


@pytest.mark.long
@pytest.mark.parametrize("color", [GOLD, ALUMINIUM])
@pytest.mark.parametrize(("alpha", "most"), [(0.1, 0.6), (0.3, 0.5), (0.6, 0.6), (1.0, 0.75)])
def test_rough_metals_send_light_where_walks_do(alpha, most, color):
    """The albedo within 0.04; further bounces by Σ |difference| at most so much of what a diffuse lobe of the right energy is off."""
    bins, ours, diffuse = Bins(10, 9, 16), 0.0, 0.0
    for cosine in COSINES:
        walks = microsurface.conductor(cosine, alpha, 2 * COUNT, microsurface.schlick(color))
        further = microsurface.counts(walks, walks.bounces > 1, bins)
        whole, found = further_bounces(color, alpha, cosine, bins)
        assert whole.sum(axis=(1, 2)) == pytest.approx(walks.weight.mean(axis=0), abs=0.04)
        ours += np.abs(found - further).sum()
        diffuse += np.abs(diffuse_lobe(alpha, bins) * further.sum(axis=(1, 2), keepdims=True) - further).sum()
    assert ours < most * diffuse


@pytest.mark.long
@pytest.mark.parametrize("alpha", [0.3, 0.6, 1.0])
def test_rough_glass_reflects_as_much_as_walks_do(alpha):
    """Both sides of an index of 1.5: the share of the light that is reflected within 0.04; at α = 1 within 0.13 from inside."""
    for inside, ratio in ((False, 1.5), (True, 1.0 / 1.5)):
        shader = point_of(given(ir.MaterialModel.GLASS, transmission=1.0, ior=1.5, roughness=math.sqrt(alpha)), inside)[1]
        bins = Bins()
        z, turn = microsurface.points(bins)
        flat = np.sqrt(1.0 - z * z)
        for cosine in COSINES:
            walks = microsurface.dielectric(cosine, alpha, COUNT, ratio)
            value = bsdf.reflected(shader, UP, (flat * np.cos(turn), z, flat * np.sin(turn)), towards(math.acos(cosine)))[0]
            share = microsurface.integrate(np.asarray(value), bins).sum() / math.pi
            assert share == pytest.approx(np.mean(walks.direction[:, 2] > 0.0), abs=0.13 if inside and alpha == 1.0 else 0.045)
