"""Tests of flakes: the filter over a pixel keeps every mean, samples follow the density, no light is gained."""

# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import math
from dataclasses import replace

import maquette
import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.scene.row_records import Input
from maquette.render.material import bsdf, principled
from maquette.render.material.shader import evaluate_shader
from maquette.render.sampling import flake_tilts
from maquette.render.surface import interaction

from .. import tables as make
from ..chi2 import chi2
from .slab_scenes import UP, USES, given, lanes, towards

ANGLES = (0.3, 1.0, 1.3)
POINTS = 40_000


def flaked(tilt=0.5, coverage=1.0, **arguments):
    """A row of slabs with flakes of a metre."""
    row = given(**{"base_metalness": 1, "specular_roughness": 0.3, "base_color": 1, **arguments})
    values = (ir.Slot.FLAKE_SIZE, 1.0), (ir.Slot.FLAKE_TILT, tilt), (ir.Slot.FLAKE_COVERAGE, coverage), (ir.Slot.FLAKE_SEED, 3.0)
    return replace(row, inputs={**row.inputs, **{slot: Input.number(v) for slot, v in values}})


def shader_of(material, width, count=POINTS, place=None):
    """The shader of random points of a plane of flakes; `width` is that of a sample, in flakes."""
    tables = principled.tables_for(make.scene([(ir.GeometryKind.PLANE, (), make.matrix(), 0)], materials=[material]))
    ray = make.rays((0.3, 1, 0.2), (0, -1, 0))
    point = interaction.make_interaction(tables, ray, make.first_hit(tables, ray))
    x, z = np.random.default_rng(4).uniform(-500, 500, (2, count)) if place is None else np.full((2, count), place)
    seen = tables.materials.slabs.flakes._replace(widths=np.array([width, 0.0]), eye=np.array([0.0, 1e6, 0.0]))
    tables = tables._replace(materials=tables.materials._replace(slabs=tables.materials.slabs._replace(flakes=seen)))
    up = lanes(UP, x)
    point = point._replace(
        local=(x, 0.0 * x, z), position=(x, 0.0 * x, z), geometric=up, normal=up, local_normal=up, offset=0.0 * x + 1e-6,
        front=np.ones(count, bool), material=np.zeros(count, np.int64), instance=np.zeros(count, np.int64), color=lanes((1.0, 1.0, 1.0), x),
    )  # fmt: skip
    return evaluate_shader(tables, point), point


def test_tilts_and_narrow_facets_are_wide_facets():
    """P(slope < r) of GGX is r²/(r² + α²); a flake's tilt plus facets of c α have the same law."""
    rng, n = np.random.default_rng(1), 200_000
    shares = np.linspace(0.02, 0.98, 25)
    for c in (0.1, 0.4, 0.7, 0.95):
        tilt, facet = flake_tilts.size_of_tilt(flake_tilts.table(), np.full(n, c), rng.random(n)), c * np.sqrt(1 / rng.random(n) - 1)
        turn = rng.uniform(0, 2 * math.pi, n)
        slopes = np.sort(np.hypot(tilt + facet * np.cos(turn), facet * np.sin(turn)))
        below = np.searchsorted(slopes, np.sqrt(shares / (1 - shares))) / n
        assert np.abs(below - shares).max() < 0.003, c


def test_the_mean_is_the_same_near_and_far():
    """The quick part of the test below."""
    pair = towards(0.4, 2.8), towards(0.3)
    values = [bsdf.reflected(shader, lanes(UP, point.offset), *(lanes(d, point.offset) for d in pair))[0]
              for shader, point in (shader_of(flaked(), 0.1, 10_000), shader_of(flaked(), 1e6, 4))]  # fmt: skip
    near, far = (float(np.mean(value)) for value in values)
    assert abs(near - far) <= 4 * float(np.std(values[0])) / 100 + 0.01 * far


@pytest.mark.long
@pytest.mark.parametrize("arguments", [{}, {"specular_roughness_anisotropy": 0.7}, {"coat_weight": 1}, {"base_metalness": 0.3}])
def test_the_mean_is_the_same_at_any_distance(arguments):
    """Of flakes with footprints from a tenth of a flake to all flakes, for pairs of directions in and off the highlight."""
    material = flaked(**arguments)
    far = shader_of(material, 1e6, 4)[0]
    for viewer, light in ((0.3, (0.4, 2.8)), (1.1, (1.0, 3.3)), (0.1, (0.5, 1.0)), (1.3, (0.2, 0.0))):
        pair = towards(*light), towards(viewer)
        expected = float(np.mean(bsdf.reflected(far, lanes(UP, np.zeros(4)), *(lanes(d, np.zeros(4)) for d in pair))[0]))
        for width in (0.1, 1.5, 6.0):
            shader, point = shader_of(material, width)
            like = point.offset
            values = bsdf.reflected(shader, lanes(UP, like), *(lanes(d, like) for d in pair))[0]
            error = float(np.std(values)) / math.sqrt(POINTS)
            assert abs(float(np.mean(values)) - expected) <= 4 * error + 0.01 * expected, (viewer, light, width)


def test_flakes_become_smooth_from_far():
    """The spread of radiance between flakes falls with the width of the footprint."""
    spreads = []
    for width in (0.1, 2.0, 8.0, 100.0):
        shader, point = shader_of(flaked(), width, 4000)
        value = bsdf.reflected(shader, lanes(UP, point.offset), lanes(towards(0.3), point.offset), lanes(towards(0.2), point.offset))[0]
        spreads.append(float(np.std(value) / np.mean(value)))
    assert spreads == sorted(spreads, reverse=True)
    assert spreads[0] > 0.8
    assert spreads[-1] < 0.05


def test_a_flake_keeps_its_tilt():
    """Points of one flake have one tilt; another seed has other flakes."""
    shader = shader_of(flaked(), 0.1, 3, place=0.37)[0]
    assert np.ptp(shader.slabs.flake.along) == 0.0
    assert abs(float(shader.slabs.flake.along[0])) > 0.0


@pytest.mark.parametrize("coverage", [0.0, 0.3, 1.0])
def test_coverage_is_the_share_of_points_with_flakes(coverage):
    shader = shader_of(flaked(coverage=coverage), 0.1)[0]
    assert float(np.mean(shader.slabs.flake.here)) == pytest.approx(coverage, abs=0.02)


@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize("width", [0.1, 3.0])
def test_white_flakes_in_a_white_room(angle, width):
    """The mean over flakes gains nothing and loses little; `far` has the loss of facets of both roughnesses."""
    shader, point = shader_of(flaked(), width)
    u, v, which = np.random.default_rng(2).random((3, POINTS))
    weight = bsdf.sample_bsdf(shader, USES, point, lanes(towards(angle), u), u, v, which).weight[0]
    error = float(np.std(weight)) / math.sqrt(POINTS)
    assert 0.95 - 3 * error <= float(np.mean(weight)) <= 1.005 + 3 * error


@pytest.mark.long
@pytest.mark.parametrize(("angle", "place"), [(0.4, 0.37), (1.2, 5.2), (0.8, -7.7)])
def test_samples_of_a_flake_follow_the_density(angle, place):
    shader, point = shader_of(flaked(specular_roughness=0.5, tilt=0.6, coat_weight=0.5, coat_roughness=0.4), 0.1, 90_000, place)
    u, v, which = np.random.default_rng(5).random((3, 90_000))
    sample = bsdf.sample_bsdf(shader, USES, point, lanes(towards(angle, 0.8), u), u, v, which)

    def density(directions):
        flat = [np.ravel(c) for c in np.broadcast_arrays(*directions)]
        shader = shader_of(flaked(specular_roughness=0.5, tilt=0.6, coat_weight=0.5, coat_roughness=0.4), 0.1, len(flat[0]), place)[0]
        value = bsdf.eval_bsdf_pdf(shader, USES, lanes(UP, flat[0]), tuple(flat), lanes(towards(angle, 0.8), flat[0]))[1]
        return value.reshape(np.broadcast(*directions).shape)

    chi2(sample.direction, sample.direction[1] > 0, density)


BOARD = """\
box([8, 8, 0.1], material: openpbr(#c0c0c0, base_metalness: 1, specular_roughness: 0.35, coat_weight: 1,
  normal_map: flakes(1cm, tilt: 0.45)))
directional(from: [0.3, 0.2, 1], illuminance: 3)
camera(position: [0, 0, 5], look_at: [0, 0, 0], width: 1.2)
"""


@pytest.mark.long
def test_pictures_from_near_and_far_have_one_mean(tmp_path):
    """Pixels of half a flake, of ten flakes and of sixty; a picture from far has little of the spread between flakes."""
    means, spreads = [], []
    for size, samples in ((72, 4), (12, 16), (2, 16)):
        scene = maquette.load_text(BOARD, tmp_path)
        picture = np.asarray(scene.render(backend="reference", size=(size, size), samples=samples, bounces=0))[..., 0]
        means.append(float(picture.mean()))
        spreads.append(float(picture.std()))
    error = spreads[0] / 72 + spreads[1] / 12
    assert means[0] == pytest.approx(means[2], abs=3 * error)
    assert means[1] == pytest.approx(means[2], abs=3 * error)
    assert error < 0.03 * means[2]
    assert spreads[2] < 0.02 * spreads[0]
