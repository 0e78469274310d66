"""Guided walks in thick bodies: where they are used, their densities, colours of half spaces, lamps inside, equal means of both ways."""

# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import maquette
import numpy as np
import pytest
from maquette.materials import subsurface_inversion
from maquette.render.material import medium_stack
from maquette.render.medium import guides, scattering_table, thickness

from .test_media import LOOK, SKY, albedo_of_half_space, seen

WAX = "subsurface(rgb(0.8, 0.5, 0.2), radius: [{0}, {0}, {0}])"


def scattering(tmp_path: Path, text: str, general: bool = False) -> Any:
    """The table of scattering media of a scene."""
    path = tmp_path / "a.scene"
    path.write_text(LOOK + SKY + text, encoding="utf-8")
    media = medium_stack.media(maquette.load(path).tables, general)
    assert isinstance(media.scatter, scattering_table.Scattering)
    return media.scatter


def test_the_decay_is_the_root_of_its_equation() -> None:
    albedo = np.array([1e-3, 0.1, 0.5, 0.9, 0.99, 0.99999])
    decay = guides.decay_of(albedo)
    assert decay[1:] / np.arctanh(decay[1:]) == pytest.approx(albedo[1:], rel=1e-9)
    assert decay[-1] == pytest.approx(math.sqrt(3 * 1e-5), rel=1e-3)  # diffusion


@pytest.mark.parametrize(("shape", "expected"), [
    ("sphere(30cm, {})", 0.2), ("box([1, 1, 0.3], {})", 2 * 0.3 / (2 * (1 + 0.3 + 0.3))), ("scale(2) {{ sphere(30cm, {}) }}", 0.4),
    ("box([9, 9, 1cm], {})", 0.01 / (1 + 2 * 0.01 / 9)), ("sphere(30cm, {0})\nbox([9, 9, 1cm], {0})", 0.01 / (1 + 2 * 0.01 / 9)),
    ("extrude([[0, 0], [1, 0], [1, 1], [0, 1]], 1, {})", 1 / 3), ("implicit(|x, y, z| x^2 + y^4 + z^2 <= 1, within: 2, {})", 0.0),
])  # fmt: skip
def test_the_thickness_of_shapes(tmp_path: Path, shape: str, expected: float) -> None:
    path = tmp_path / "a.scene"
    path.write_text(LOOK + SKY + shape.format("material: subsurface(#c86)"), encoding="utf-8")
    tables = maquette.load(path).tables
    rows = np.unique(tables.materials.medium[tables.materials.medium >= 0]).astype(np.int64)
    assert thickness.of_media(tables, rows)[0] == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize(("body", "deep"), [
    (f"sphere(1, material: {WAX.format('2mm')})", True),
    (f"sphere(1, material: {WAX.format('50cm')})", False),  # light passes it
    ("sphere(1, material: subsurface(rgb(0.8, 0.5, 0.2), radius: [2, 2mm, 2mm]))", False),  # red passes
    ("sphere(1, material: subsurface(#ffffff, radius: 2mm))", False),
    ("sphere(1, material: subsurface(checker(#804020, #c08060), radius: 2mm))", False),
    ("sphere(1, material: glass(ior: 1.3), medium: medium(#808080, 2mm))", True),
    ("sphere(1, material: glass(ior: 1.3), medium: medium(#808080, 2mm, phase: 0.5))", False),
    ("sphere(1, material: glass(ior: 1.3), medium: medium(#808080, 2mm, density: |x, y, z| abs(x)))", False),
    ("sphere(1, medium: medium(#808080, 2mm))", False),  # an invisible boundary: light samples find the lamps
    ("fog(visibility: 1m, color: #808080)", False),
])  # fmt: skip
def test_walks_are_guided_where_no_light_passes(tmp_path: Path, body: str, deep: bool) -> None:
    record, in_general = scattering(tmp_path, body).guides, scattering(tmp_path, body, general=True).guides
    assert isinstance(in_general, guides.Guides)
    assert in_general.used[0] == deep
    assert isinstance(record, guides.Guides if deep else guides.NoGuides)
    if deep:
        assert np.array_equal(record.decay, in_general.decay)
        assert (record.decay[:, 3] == [0, 1]).all()


def walk(color: tuple[float, float, float], lengths: tuple[float, float, float], walkers: int) -> tuple[np.ndarray, np.ndarray]:
    """(mean, standard error) by channel of the light that leaves a half space below y = 0, lit evenly, by guided walks."""
    rng = np.random.default_rng(3)
    extinction, back = np.transpose([subsurface_inversion.channel(np.array(c), r) for c, r in zip(color, lengths, strict=True)])
    table = type("Table", (), {"guides": guides.build(np.array([[*extinction, 0.0]]), np.array([[*back, 0.0]]), np.full(1, 1e9), False)})
    sine = np.sqrt(rng.random(walkers))
    direction: Any = sine, -np.sqrt(1 - sine * sine), 0.0 * sine
    weight, y, leaving = np.ones((3, walkers)), 0.0 * sine, [np.zeros((3, 1))]
    for _ in range(500):
        count, zero = len(y), 0.0 * y
        axis, number, even = (zero, zero + 1.0, zero), np.zeros(count, int), zero + 0.25 / math.pi
        coefficients = tuple(tuple(zero + c for c in row) for row in (extinction, back))
        far = np.where(direction[1] > 0, -y / np.maximum(direction[1], 1e-12), np.inf)
        nowhere = zero > 0, far, (zero, zero, zero)
        scattered, t, factor = guides.fly(
            axis, nowhere, table, number, (None, direction, zero, far), coefficients, weight, rng.random(count)
        )
        weight, y = weight * np.array(factor), np.where(scattered, y + direction[1] * t, y)
        leaving.append(weight[:, ~scattered])
        guide = guides.of(axis, None, table, number, weight, coefficients[1], scattered)
        cosine, turn = 2 * rng.random(count) - 1, 2 * math.pi * rng.random(count)
        sine = np.sqrt(1 - cosine**2)
        plain = (sine * np.cos(turn), cosine, sine * np.sin(turn)), zero + 1.0, even
        direction, change, density = guides.sample(guide, plain, *rng.random((3, count)))
        assert guides.density(guide, even, direction) == pytest.approx(density)
        survival = np.minimum(2 * weight.max(axis=0), 1)
        going = scattered & (rng.random(count) < survival)
        weight = (weight * change / np.maximum(survival, 1e-30))[:, going]
        direction, y = tuple(c[going] for c in direction), y[going]
        if not going.any():
            break
    light = np.concatenate(leaving, axis=1)
    mean = light.sum(axis=1) / walkers
    return mean, np.sqrt(((light**2).sum(axis=1) / walkers - mean**2) / walkers)


@pytest.mark.parametrize("lengths", [(1.0, 1.0, 1.0), (0.2, 1.0, 3.0)])
def test_guided_walks_keep_the_colour_of_a_half_space(lengths: tuple[float, float, float]) -> None:
    color = (0.85, 0.5, 0.2)
    mean, error = walk(color, lengths, 6_000)
    assert (error / mean < 0.15).all()
    assert (np.abs(mean - color) < 4 * error + 0.004 * mean).all()


@pytest.mark.long
@pytest.mark.parametrize("cosine", [1.0, 0.3])
@pytest.mark.parametrize("albedo", [0.5, 0.9])
def test_a_half_space_reflects_by_the_h_function(tmp_path: Path, albedo: float, cosine: float) -> None:
    """Behind glass that does not refract, but whose faint tint makes its boundary a visible one."""
    sine = math.sqrt(1 - cosine * cosine)
    text = f"camera(position: [0, {cosine}, {sine}], look_at: [0, 0, 0], up: [0, 0, -1], fov: 2deg)\n" + SKY
    medium = f"medium(scattering: {albedo}, absorption: {1 - albedo:g})"
    text += f"box(size: 1000, center: [0, -500, 0], material: glass(0.99999, ior: 1), medium: {medium})\n"
    assert seen(tmp_path, text, samples=4096)[0] == pytest.approx(albedo_of_half_space(albedo, cosine), abs=0.01)


BODIES = {
    "ball": "sphere(1, material: subsurface(#c08060, radius: [30mm, 20mm, 10mm], roughness: 0.3))\n",
    "lamp inside": "sphere(1, material: subsurface(#c08060, radius: 30mm))\nsphere(0.2, center: [0, 0, 0.75], material: emissive(200))\n",
    "glass": "sphere(1, material: glass(ior: 1.4, roughness: 0.2), medium: medium(rgb(0.9, 0.8, 0.5), 2cm))\n",
    "cube and slab": "box(1, material: subsurface(#c08060, radius: 8mm))\n"
    "box([4, 4, 0.4], center: [0, 0, -1], material: subsurface(#6080c0, radius: 8mm))\n",
}


@pytest.mark.long
@pytest.mark.parametrize("body", BODIES)
def test_guided_walks_have_the_mean_of_classic_ones(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, body: str) -> None:
    text = LOOK.replace("0.2deg", "30deg") + "sky(radiance: 1)\npoint([1, 2, 3], intensity: 10)\n" + BODIES[body]
    means = []
    for deep in (guides.DEEP, math.inf):
        monkeypatch.setattr(guides, "DEEP", deep)
        means.append([seen(tmp_path, text, samples=1024, size=(6, 6), seed=seed)[:3] for seed in range(4)])
    first, second = np.array(means)
    error = np.sqrt(first.var(axis=0, ddof=1) / 4 + second.var(axis=0, ddof=1) / 4)
    assert (np.abs(first.mean(axis=0) - second.mean(axis=0)) < 5 * error + 0.002 * second.mean(axis=0)).all()


@pytest.mark.long
def test_backends_and_threads_agree(tmp_path: Path) -> None:
    text = LOOK.replace("0.2deg", "30deg") + SKY + BODIES["lamp inside"].replace("200", "2")
    ray, single = (seen(tmp_path, text, samples=32, bounces=40, threads=n) for n in (2, 1))
    assert (ray == single).all()
    assert seen(tmp_path, text, samples=32, bounces=40, backend="reference") == pytest.approx(ray, rel=3e-3)
