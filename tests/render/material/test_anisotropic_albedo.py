"""Tables of the albedo of facets of two roughnesses, against quadrature with more nodes at random places."""

from __future__ import annotations

import math

import numpy as np
import pytest
from maquette.render.material import anisotropic_albedo, anisotropic_facets, rough_dielectric

from .slab_scenes import UP, energy, given, towards

FACETS = [(0.2, 0.9, 0.3, 0.6), (0.5, 0.5, 1.2, 1.3), (0.36, 1.0, 0.9, 1.5), (1.0, 0.8, 1.1, 0.1), (0.81, 0.3, 0.6, 0.8)]


def place_of(alpha, anisotropy, angle, turn):
    """(facets, the place of a direction) in numpy, for one direction."""
    facets = anisotropic_facets.facets((1.0, 0.0, 0.0), (0.0, 0.0, -1.0), np.zeros(1), np.array([math.sqrt(alpha)]), np.array([anisotropy]))
    return facets, anisotropic_albedo.place_of(facets, UP, tuple(np.array([c]) for c in towards(angle, turn)))


def sent(facets, angle, turn, index=None):
    """The share of light that one bounce sends on, by 17,711 nodes: reflected by a mirror, or on both sides of a boundary to an index."""
    along, across = float(facets.first[0]), float(facets.second[0])
    sine, cosine = math.sin(angle), math.cos(angle)
    view = np.array([sine * math.cos(turn)]), np.array([sine * math.sin(turn)]), np.array([cosine])
    normal, facing, weight = anisotropic_albedo._visible(view, along, across, 17711, 10946)
    near = 1 + anisotropic_albedo._lambda(view, along, across)[:, None]
    light = [2 * facing * n - v[:, None] for n, v in zip(normal, view, strict=True)]
    mirrored = np.where(light[2] > 0, near / (near + anisotropic_albedo._lambda(light, along, across)), 0)
    if index is None:
        return float((mirrored * weight).sum())
    turned = rough_dielectric.reflectance(facing, np.full_like(facing, index))
    bent = np.sqrt(np.maximum(1 - (1 - facing**2) / index**2, 0))
    through = [(facing * n - v[:, None]) / index - bent * n for n, v in zip(normal, view, strict=True)]
    leaves = rough_dielectric.shadowing_across(near - 1, anisotropic_albedo._lambda(through, along, across))
    return float(((turned * mirrored + (1 - turned) * np.where(through[2] < 0, leaves, 0)) * weight).sum())


@pytest.mark.parametrize(("alpha", "anisotropy", "angle", "turn"), FACETS)
def test_the_albedo_of_a_mirror(alpha, anisotropy, angle, turn):
    facets, place = place_of(alpha, anisotropy, angle, turn)
    tables = anisotropic_albedo.tables_of(np.array([1.5]), np.array([False]), np.array([True]))
    read, true = float(anisotropic_albedo._read(tables.albedo, 0, place)[0]), sent(facets, angle, turn)
    assert true - 0.004 <= read <= true + 0.02, (read, true)


@pytest.mark.parametrize(("alpha", "anisotropy", "angle", "turn"), FACETS)
def test_the_loss_of_a_boundary(alpha, anisotropy, angle, turn):
    facets, place = place_of(alpha, anisotropy, angle, turn)
    tables = anisotropic_albedo.tables_of(np.array([1.5]), np.array([True]), np.array([True]))
    for side, index in enumerate((1.5, 1 / 1.5)):
        read = float(anisotropic_albedo._read(tables.lost, side * anisotropic_albedo.CELLS, place)[0])
        true = 1 - sent(facets, angle, turn, index)
        assert true - 0.04 <= read <= true + 0.01, (index, read, true)


def test_nearly_round_facets_are_nearly_those_of_round_ones():
    """No step where the anisotropy of a picture passes 0."""
    for kind in ({"base_metalness": 1}, {"transmission_weight": 1}, {}):
        arguments = {"base_color": 1, "specular_roughness": 0.8, **kind}
        shares = [energy(given(**arguments, specular_roughness_anisotropy=a), 0.9, 60, 0.4)[0] for a in (0.0, 0.01)]
        assert shares[0] == pytest.approx(shares[1], abs=0.02), kind


def test_only_what_has_two_roughnesses_is_tabulated():
    """Three indices in order, of which materials of lines have the second."""
    indices, passing = np.array([1.7, 1.3, 1.5, 1.5]), np.array([True, True, True, False])
    nothing = anisotropic_albedo.tables_of(indices, passing, np.zeros(4, bool))
    assert not any(table.any() for table in nothing)
    tables = anisotropic_albedo.tables_of(indices, passing, np.array([False, False, True, True]))
    filled = tables.lost.reshape(3, -1).any(axis=1)
    assert filled.tolist() == [False, True, False]
    assert tables.lost_mean.reshape(3, -1).any(axis=1).tolist() == [False, True, False]
    assert tables.albedo.any()
