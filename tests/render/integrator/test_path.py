"""Tests of the path integrator: closed forms, the Whitted integrator, and single against double precision."""

from __future__ import annotations

import math

import maquette
import numpy as np
import pytest
from maquette.compiler import ir, load
from maquette.compiler.plan import plan as planner

INSIDE = "camera(position: [0.1, 0.05, 0], look_at: [1, 0.3, 0.2], fov: 70deg)\n"
ROOM = """
box([4, 3, 4], center: [0, 1.5, 0], material: lambert(0.7))
sphere(0.5, center: [0.8, 0.5, 0.3], material: phong(0.3, specular: 0.4, shininess: 20, normalized: true))
cylinder(0.3, 1, center: [-0.8, 0.5, -0.4], material: mirror(0.9))
camera(position: [0, 1.4, 1.8], look_at: [0, 0.8, 0], fov: 60deg)
render(bounces: 3)
"""
LAMPS = {
    "rectangle": "area([0, 2.9, 0], size: [1, 0.8], luminance: 8)\n",
    "disk": 'area([0, 2.9, 0], size: 1, shape: "disk", luminance: 8)\n',
    "ball": "sphere(0.2, center: [0, 2.5, 0], material: emissive(1, luminance: 20))\n",
    "triangles": "polygon([[-0.4, 2.8, -0.4], [0.4, 2.8, -0.4], [0, 2.8, 0.5]], material: emissive(1, luminance: 12))\n",
    "two": "area([-1, 2.9, 0], size: 0.5, luminance: 9)\nspot([1, 2.8, 0], look_at: [0, 0, 0], cone: 60deg, intensity: 9)\n",
}


@pytest.fixture
def draw(tmp_path):
    def run(text, samples=64, seed=0, size=(16, 16), backend="ray", **plan):
        path = tmp_path / "a.scene"
        path.write_text(text, encoding="utf-8")
        image = maquette.render(path, size=size, samples=samples, seed=seed, backend=backend, filter="box", threads=1, plan=plan)
        assert image.metadata["issues"] == 0
        return image.channels["rgba"].astype(np.float64)[..., :3]

    return run


def near(values, answer, most=0.004):
    """Independent values have the answer as their mean, within 4 standard errors of at most a share of it."""
    values = np.ravel(values)
    error = values.std(ddof=1) / math.sqrt(values.size)
    assert error <= most * answer
    assert abs(values.mean() - answer) <= 4 * error + 1e-6 * answer


@pytest.mark.parametrize(("albedo", "bounces"), [(0.6, 1), (0.5, 12)])
def test_a_shining_room_looks_for_light_at_its_own_walls(draw, albedo, bounces):
    """k bounces give e (1 − ρ^(k+1))/(1 − ρ): what shines is one more surface."""
    text = INSIDE + f"sphere(2, material: lambert({albedo}))\nsphere(2.001, material: emissive(0.7))\nrender(bounces: {bounces})\n"
    assert draw(text, 4).max() == 0.0  # the matt ball stands before the shining one
    text = INSIDE + f"sphere(2, material: emissive(0.7))\nsphere(0.4, center: [1, 0.3, 0.2], material: lambert({albedo}))\n"
    found = draw(text + f"render(bounces: {bounces})\n", 64)
    matt = found[6:10, 6:10, 0]  # convex, in an even light of 0.7 all round
    near(matt, 0.7 * albedo)


@pytest.mark.long
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_no_light_leaks_into_a_ball(draw, precision):
    """Rays that graze its inside, surface after surface, stay in: of 160,000 samples none finds the light around it."""
    text = INSIDE + "sphere(2, material: lambert(0.9))\nsphere(2.001, material: emissive(0.7))\nrender(bounces: 12)\n"
    assert draw(text, 16, size=(100, 100), precision=precision).max() == 0.0


@pytest.mark.parametrize(("radius", "albedo", "bounces"), [(2.0, 0.8, 12), (0.5, 0.5, 3)])
def test_a_lamp_in_the_middle_of_a_ball(draw, radius, albedo, bounces):
    """ρI/(πR²(1 − ρ)) on its wall, and with k bounces that times 1 − ρ^(k+1)."""
    text = f"sphere({radius}, material: lambert({albedo}))\npoint([0, 0, 0], intensity: 4)\nrender(bounces: {bounces})\n"
    answer = albedo * 4 / (math.pi * radius**2) * (1 - albedo ** (bounces + 1)) / (1 - albedo)
    near(draw(INSIDE + text, 128)[..., 0], answer)


@pytest.mark.long
@pytest.mark.parametrize("lamp", LAMPS)
def test_single_and_double_precision_and_the_reference_agree(draw, lamp):
    """The means of blocks of the picture, by z."""
    text = ROOM + LAMPS[lamp]
    plain = {"transport.caustics": "paths"}  # the reference has no photons
    single = np.stack([draw(text, 64, seed, precision="float32", **plain) for seed in range(6)])
    double = np.stack([draw(text, 64, 20 + seed, precision="float64", **plain) for seed in range(6)])
    plain = np.stack([draw(text, 16, 40 + seed, backend="reference") for seed in range(6)])

    def blocks(runs):
        return runs.reshape(len(runs), 4, 4, 4, 4, 3).mean(axis=(2, 4, 5))

    for other in (double, plain):
        a, b = blocks(single), blocks(other)
        variance = a.var(axis=0, ddof=1) + b.var(axis=0, ddof=1)
        variance = np.maximum(variance, variance.mean()) / 6  # of few runs: no less than that of all blocks together
        z2 = (a.mean(axis=0) - b.mean(axis=0)) ** 2 / variance
        assert z2.mean() < 2.5, z2
        whole = [runs.mean(axis=(1, 2, 3)) for runs in (single, other)]
        apart = abs(whole[0].mean() - whole[1].mean())
        assert apart < 4.5 * math.sqrt(sum(w.var(ddof=1) / len(w) for w in whole)), whole


FLOOR = """
plane(y: 0, material: lambert(0.6))
sphere(0.5, center: [0.8, 0.5, 0.3], material: lambert(0.3))
cylinder(0.3, 1, center: [-0.8, 0.5, -0.4], material: lambert(0.5))
camera(position: [0, 1.4, 3.8], look_at: [0, 0.8, 0], fov: 50deg, shutter: 20ms)
render(bounces: 3)
"""
LAMP = "area([0, 2.9, 0], size: [1, 0.8], luminance: 8)\n"
MATT = "lambert(rgb(0.8, 0.2, 0.1)"
FEATURES = {
    "opacity": LAMP + f"sphere(0.4, center: [0, 0.4, 1], material: {MATT}, opacity: 0.4))\n"
    + "disk(0.75, center: [0, 1.8, 0], material: lambert(0.5, opacity: checker(#555555, #eeeeee)))\n",
    "light at vertices": LAMP + f'sphere(0.4, center: [0, 0.4, 1], material: {MATT}, shading: "gouraud"))\n',
    "sky at vertices": f'sky(luminance: 0.2)\nsphere(0.4, center: [0, 0.4, 1], material: {MATT}, shading: "gouraud"))\n',
    "motion": LAMP + f"sphere(0.4, center: [0, 0.4, 1], translate: [30m * time / 1s, 15m * time / 1s, 0], material: {MATT}))\n"
    + "sphere(0.2, center: [0, 1.4, 0], translate: [30m * time / 1s, 0, 0], material: emissive(1, luminance: 3))\n",
    "skies": "sky(luminance: 1, shadows: false)\nsky(luminance: 0.3)\n",
}


@pytest.mark.long
@pytest.mark.parametrize("feature", FEATURES)
@pytest.mark.parametrize(
    "other", [{"transport": "whitted"}, pytest.param({"backend": "reference"}, marks=pytest.mark.long)], ids=["whitted", "reference"]
)
def test_paths_agree_with_the_tree_of_all_branches(draw, feature, other):
    """Where only matt surfaces light each other, both hold the same light: means of blocks, by z."""
    text = FLOOR + FEATURES[feature]
    ours = np.stack([draw(text, 32, seed) for seed in range(6)])
    others = np.stack([draw(text, 8 if "backend" in other else 32, 50 + seed, **other) for seed in range(6)])
    a, b = (runs.reshape(6, 2, 8, 2, 8, 3).mean(axis=(2, 4)) for runs in (ours, others))
    variance = a.var(axis=0, ddof=1) + b.var(axis=0, ddof=1)
    z2 = (a.mean(axis=0) - b.mean(axis=0)) ** 2 / (np.maximum(variance, variance.mean()) / 6)
    assert z2.mean() < 3.0, z2


def test_the_plan_chooses_transport_and_precision(tmp_path):
    def decided(text, **settings):
        path = tmp_path / "a.scene"
        path.write_text(text, encoding="utf-8")
        plan = planner.make_plan(load.load(path), ir.Settings(**settings))
        return plan["transport"], plan["precision"]

    ball = "sphere(1, material: lambert(0.5))\n"
    assert decided(ball) == ("whitted", "float64")
    assert decided(ball, bounces=2) == ("path", "float32")
    assert decided(ball, bounces=2, backend="reference") == ("path", "float64")
    assert decided(ball + "sphere(1mm, center: [0, 50, 0])\n", bounces=2) == ("path", "float64")
    assert decided('sphere(1, material: lambert(0.5, shading: "gouraud"))\n', bounces=2)[0] == "path"
    assert decided('sphere(1, material: lambert(0.5, opacity: 0.5))\n', bounces=2)[0] == "path"


@pytest.mark.long
def test_any_number_of_threads_gives_the_same_picture(tmp_path):
    path = tmp_path / "a.scene"
    path.write_text(ROOM + LAMPS["rectangle"], encoding="utf-8")
    one, two = (maquette.render(path, size=(70, 40), samples=4, threads=n).channels["rgba"] for n in (1, 2))
    assert np.array_equal(one, two)


def spectrum(error):
    """Power of an error by frequency: below 1/16 of a cycle a pixel, and above ¼."""
    power = np.abs(np.fft.fft2(error)) ** 2
    f = np.fft.fftfreq(error.shape[0])[:, None], np.fft.fftfreq(error.shape[1])[None, :]
    away = np.hypot(*f)
    return power[away < 1 / 16].mean(), power[away > 1 / 4].mean()


@pytest.mark.long
@pytest.mark.parametrize("transport", ["path", "whitted"])
@pytest.mark.parametrize("backend", ["ray", "reference"])
def test_the_error_of_a_soft_shadow_is_blue_noise(draw, backend, transport):
    """A slab's shadow from a wide lamp: in the error at 4 samples slow waves have a quarter at most of the power of quick ones."""
    text = (
        "camera(position: [0, 1, 0.01], look_at: [0, 0, 0], fov: 60deg)\nplane(y: 0, material: lambert(0.8))\n"
        "box([4, 0.1, 8], center: [2, 2, 0], material: lambert(0))\narea([0, 4, 0], size: [2, 2], luminance: 5)\nrender(bounces: 1)\n"
    )
    size = (64, 64)
    true = draw(text, 1024, seed=99, size=size, transport="path")[..., 1]
    found = [draw(text, 4, seed=seed, size=size, backend=backend, transport=transport)[..., 1] - true for seed in range(3)]
    slow, quick = np.mean([spectrum(error) for error in found], axis=0)
    assert slow < 0.25 * quick
