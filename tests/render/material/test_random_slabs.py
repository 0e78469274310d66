"""Slabs of random parameters: energy at nine roughnesses, densities by chi², reciprocity. Lanes run in numpy; no kernel is compiled."""

from __future__ import annotations

import math

import numpy as np
import pytest
from maquette.materials import openpbr as element
from maquette.render.material import bsdf

from ..chi2 import chi2
from .slab_scenes import UP, USES, energy, given, lanes, point_of, scattered, towards

ROUGHNESSES = tuple(k / 8 for k in range(9))
ONE_WAY = ("fuzz_weight", "transmission_weight", "subsurface_weight")  # fuzz is not reciprocal; the others have two sides
SLOTS = {
    "base_color": {"base_color": 1, "base_weight": 1},
    "base_metalness": {"base_metalness": 0.7},
    "base_diffuse_roughness": {"base_diffuse_roughness": 0.8},
    "specular_weight": {"specular_weight": 0.5},
    "specular_ior": {"specular_ior": 2.2},
    "specular_roughness_anisotropy": {"specular_roughness_anisotropy": 0.6},
    "metal, anisotropy 0.3": {"base_metalness": 1, "specular_roughness_anisotropy": 0.3},
    "metal, anisotropy 0.6": {"base_metalness": 1, "specular_roughness_anisotropy": 0.6},
    "coat_roughness_anisotropy": {"coat_weight": 1, "coat_roughness": 0.4, "coat_roughness_anisotropy": 0.8},
    "coat_ior": {"coat_weight": 1, "coat_ior": 2},
    "fuzz_weight": {"fuzz_weight": 1},
    "thin_film_weight": {"thin_film_weight": 1, "thin_film_thickness": 0.4},
    "transmission_weight": {"transmission_weight": 1},
    "transmission, half": {"transmission_weight": 0.5},
    "transmission, dense": {"transmission_weight": 1, "specular_ior": 2.4},
    "transmission, lines": {"transmission_weight": 1, "specular_roughness_anisotropy": 0.7},
    "transmission under a coat": {"transmission_weight": 1, "coat_weight": 1},
    "transmission under a film": {"transmission_weight": 1, "thin_film_weight": 1},
    "transmission under fuzz": {"transmission_weight": 1, "fuzz_weight": 0.5},
    "thin wall": {"transmission_weight": 1, "thin_walled": 1},
    "thin wall, lines": {"transmission_weight": 1, "thin_walled": 1, "specular_roughness_anisotropy": 0.9},
    "half glass of lines": {"transmission_weight": 0.5, "specular_roughness_anisotropy": 0.9},
    "metal, anisotropy 1": {"base_metalness": 1, "specular_roughness_anisotropy": 1},
    "subsurface_weight": {"subsurface_weight": 1, "subsurface_color": 1},
}
LEAST = {
    "specular_roughness_anisotropy": 0.95, "coat_roughness_anisotropy": 0.95, "thin_film_weight": 0.93, "transmission under fuzz": 0.92,
    "transmission under a coat": 0.95, "transmission under a film": 0.95,
}  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize("roughness", ROUGHNESSES)
@pytest.mark.parametrize("name", SLOTS)
def test_each_slot_in_a_white_room(name, roughness):
    for angle in (0.1, 0.9, 1.35):
        share, error = energy(given(**{"base_color": 1, "specular_roughness": roughness, **SLOTS[name]}), angle, 60, 0.4)
        assert LEAST.get(name, 0.97) - 4 * error <= share <= 1.004 + 4 * error, (angle, share, error)


@pytest.mark.long
@pytest.mark.parametrize("roughness", ROUGHNESSES)
@pytest.mark.parametrize("name", [name for name in SLOTS if name.startswith(("transmission", "half"))])
def test_each_slot_from_inside_of_a_white_solid(name, roughness):
    for angle in (0.1, 0.6, 0.9, 1.35):
        share, error = energy(given(**{"base_color": 1, "specular_roughness": roughness, **SLOTS[name]}), angle, 60, 0.4, inside=True)
        assert 0.91 - 4 * error <= share <= 1.01 + 4 * error, (angle, share, error)


@pytest.mark.parametrize("roughness", [0.4, 1.0])
@pytest.mark.parametrize("name", ["transmission_weight", "transmission under a coat", "thin wall", "transmission, lines"])
def test_rough_refraction_keeps_its_light(name, roughness):
    """The quick part of the test above: by one bounce alone 0.65 are left at a roughness of 0.4, 0.09 at 1."""
    share, error = energy(given(**{"specular_roughness": roughness, **SLOTS[name]}), 0.7, 30)
    assert 0.95 - 3 * error <= share <= 1.004 + 3 * error, (share, error)


def random_slabs(seed, without=()):
    """A row of random numbers and colours; half of the weights are 0."""
    rng = np.random.default_rng(seed)
    arguments = {}
    for name, (_, _, most, _) in element.NUMBERS.items():
        value = float(rng.uniform(0.0, 1.0) if most is not None else rng.uniform(1.2, 2.2))
        weight = name in ("base_metalness", *(w for w in element.NUMBERS if w.endswith("_weight")))
        arguments[name] = 0.0 if weight and name != "base_weight" and rng.random() < 0.5 else value
    arguments |= {name: tuple(rng.uniform(0.1, 1.0, 3).tolist()) for name in element.COLORS}
    arguments["base_weight"] = float(rng.random())
    arguments["specular_roughness"], arguments["coat_roughness"] = (float(x) for x in rng.uniform(0.3, 1.0, 2))
    arguments["specular_roughness_anisotropy"] *= 0.8
    arguments["coat_roughness_anisotropy"] *= 0.8
    arguments["thin_film_thickness"] = float(rng.uniform(0.1, 0.9))
    return given(**{**arguments, **dict.fromkeys(without, 0.0)})


@pytest.mark.parametrize("seed", range(6))
def test_random_slabs_gain_nothing(seed):
    for inside in (False, True):
        share, error = energy(random_slabs(seed), 0.2 + 0.2 * seed, 40, 0.5, inside)
        assert 0.0 < share <= 1.005 + 4 * error, (inside, share, error)


@pytest.mark.parametrize("seed", range(6))
def test_random_slabs_are_reciprocal(seed):
    rng = np.random.default_rng(100 + seed)
    shader = point_of(random_slabs(seed, ONE_WAY))[1]
    angles, turns = rng.uniform(0, 1.5, (2, 100)), rng.uniform(0, 2 * math.pi, (2, 100))
    pair = [(np.sin(a) * np.cos(t), np.cos(a), np.sin(a) * np.sin(t)) for a, t in zip(angles, turns, strict=True)]
    up = lanes(UP, angles[0])
    forward, backward = bsdf.reflected(shader, up, *pair), bsdf.reflected(shader, up, *reversed(pair))
    for a, b in zip(forward, backward, strict=True):
        assert np.allclose(a / pair[0][1], b / pair[1][1], rtol=1e-5)


def samples_follow(seed, n, fine, inside=False):
    angle, turn = 0.3 + 0.12 * seed, 0.4 * seed
    sample, shader = scattered(random_slabs(seed), angle, n, turn, random=True, inside=inside)

    def density(directions):
        flat = [np.ravel(c) for c in np.broadcast_arrays(*directions)]
        share, value = bsdf.eval_bsdf_pdf(shader, USES, lanes(UP, flat[0]), tuple(flat), lanes(towards(angle, turn), flat[0]))
        return np.where(sum(share) > 0, value, 0.0).reshape(np.broadcast(*directions).shape)

    chi2(sample.direction, sum(sample.weight) > 0, density, fine=fine)


@pytest.mark.long
@pytest.mark.parametrize("inside", [False, True])
@pytest.mark.parametrize("seed", range(10))
def test_samples_of_random_slabs_follow_the_density(seed, inside):
    samples_follow(seed, 250, 32, inside)


def test_samples_of_two_slabs_follow_the_density():
    """The quick part of the test above."""
    samples_follow(3, 60, 10)
