"""Sheen: its albedo against the quadrature of the published formulas, energy, reciprocity, and scenes without it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.scene.row_records import Input, MaterialData
from maquette.render.material import bsdf, principled, sheen

from .. import tables as make
from .test_microfacet import ANGLES, UP, USES, given, point_of, scattered, towards

DARK: dict[str, Any] = {"ior": 1.0, "diffuse": 0.0}  # without a highlight


def charlie(roughness, cos_in, cos_out, cos_half):
    """f of Charlie's sheen by the glTF specification, appendix of KHR_materials_sheen; numpy."""
    alpha = roughness**2
    t = (1 - alpha) ** 2
    rough, smooth = (21.5473, 3.82987, 0.19823, -1.9776, -4.32054), (25.3245, 3.32435, 0.16801, -1.27393, -4.85967)
    a, b, c, d, e = ((1 - t) * np.array(rough) + t * np.array(smooth)).tolist()

    def curve(x):
        return a / (1 + b * x**c) + d * x + e

    def shadowing(x):
        return math.exp(curve(x)) if x < 0.5 else math.exp(2 * curve(0.5) - curve(1 - x))

    strength = (2 + 1 / alpha) * (1 - cos_half**2) ** (0.5 / alpha) / (2 * math.pi)
    return strength / ((1 + shadowing(cos_in) + shadowing(cos_out)) * 4 * cos_in * cos_out)


@pytest.mark.parametrize("roughness", [0.2, 0.5, 1.0])
def test_the_lobe_is_that_of_the_specification(roughness):
    _, shader = point_of(given(**DARK, sheen=(0.8, 0.4, 0.1), sheen_roughness=roughness))
    for into, out, turn in ((0.3, 0.9, 1.0), (1.2, 0.8, 2.5), (1.0, 1.0, 3.1)):
        light, viewer = towards(into), towards(out, turn)
        half = np.add(light, viewer) / np.linalg.norm(np.add(light, viewer))
        expected = math.pi * math.cos(into) * charlie(roughness, math.cos(into), math.cos(out), half[1]) * np.array([0.8, 0.4, 0.1])
        found = bsdf.reflected(shader, UP, light, viewer)
        assert [float(np.ravel(x)[0]) for x in found] == pytest.approx(expected.tolist(), rel=1e-6)


@pytest.mark.parametrize("roughness", [0.15, 0.3, 0.6, 1.0])
def test_the_table_is_the_integral(roughness):
    cosine = np.linspace(0.05, 1.0, 40)
    found = sheen.directional_albedo(sheen.table(), cosine, np.full(40, roughness))
    assert found == pytest.approx(sheen.integrals(cosine, roughness, 200, 200), abs=2e-3)


@pytest.mark.long
@pytest.mark.parametrize("roughness", [0.0, 0.3, 0.7, 1.0])
@pytest.mark.parametrize("below", [{}, {"metallic": 1.0}, {"coat": 1.0, "coat_roughness": 0.3}])
def test_white_cloth_gains_no_light(below, roughness):
    for angle in (*ANGLES, 1.53):
        weight = scattered(given(**below, diffuse=1.0, sheen=1.0, sheen_roughness=roughness), angle, 200)[0].weight[0]
        assert 0.5 < np.mean(weight) <= 1 + 3 * np.std(weight) / 200, (angle, np.mean(weight))


@pytest.mark.long
def test_samples_have_the_mean_of_the_albedo():
    """Of samples of sheen alone; its own albedo is below 1 here."""
    for angle in (0.6, 1.1, 1.4):
        weight = scattered(given(**DARK, sheen=0.7, sheen_roughness=0.5), angle, 300)[0].weight[0]
        assert np.mean(weight) == pytest.approx(0.7 * sheen.integrals(math.cos(angle), 0.5), rel=0.02)


def test_both_ways_are_equal():
    _, shader = point_of(given(diffuse=(0.5, 0.2, 0.1), sheen=(0.8, 0.4, 0.1), sheen_roughness=0.2, coat=0.5, coat_roughness=0.2))
    for into, out, turn in ((0.3, 1.5, 1.0), (1.2, 0.8, 2.5)):
        one, other = towards(into), towards(out, turn)
        there = np.array(bsdf.reflected(shader, UP, one, other)).ravel() / math.cos(into)
        back = np.array(bsdf.reflected(shader, UP, other, one)).ravel() / math.cos(out)
        assert there == pytest.approx(back, rel=1e-9)


def test_the_parts_are_the_whole():
    """Diffuse part and highlight, as direct light takes them, are `reflected`."""
    _, shader = point_of(given(diffuse=(0.5, 0.2, 0.1), sheen=(0.8, 0.4, 0.1), sheen_roughness=0.4, coat=0.5, coat_roughness=0.2))
    light, viewer = towards(0.9), towards(0.5, 2.0)
    matt, shine, _ = bsdf.eval_lobes_pdf(shader, UP, light, viewer)
    assert np.add(matt, shine).ravel() == pytest.approx(np.ravel(bsdf.reflected(shader, UP, light, viewer)), rel=1e-12)
    assert np.ravel(bsdf.eval_diffuse(shader, UP, light, viewer)) == pytest.approx(np.ravel(matt), rel=1e-12)
    share, _ = bsdf.eval_bsdf_pdf(shader, USES, UP, light, viewer)
    assert np.ravel(share) == pytest.approx(np.add(matt, shine).ravel(), rel=1e-12)


def test_scenes_without_sheen_have_no_table():
    plain = MaterialData(ir.MaterialModel.PRINCIPLED, {ir.Slot.DIFFUSE: Input.number(0.5)})
    scene = make.scene([(ir.GeometryKind.SPHERE, [1.0], make.matrix(), 0)], materials=[plain])
    found: list[Any] = [principled.tables_for(scene, general).materials for general in (False, True)]
    assert [type(materials.sheen) for materials in found] == [sheen.NoSheen, sheen.Albedo]
