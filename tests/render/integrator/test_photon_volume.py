"""Tests of photons in media: quadratures of a single scattering, paths that find the same light, and equal bits of threads."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import maquette
import numpy as np
import pytest
from maquette.compiler import ir, load
from maquette.compiler.plan import plan as planner
from maquette.render.accel import photon_grid
from maquette.render.integrator.photon_maps import photon_beams
from maquette.render.material import fresnel


def seen(tmp_path: Path, text: str, **settings: Any) -> np.ndarray:
    """A small picture: red, green, blue."""
    path = tmp_path / "a.scene"
    path.write_text(text, encoding="utf-8")
    settings = {"size": (4, 4), "samples": 256, "denoise": False, "filter": "box", **settings}
    return maquette.load(path).render(**settings).channels["rgba"][..., :3].astype(float)


def reflectance(angle: float, n: float) -> float:
    """Of a flat interface to an index n, for unpolarized light."""
    return float(fresnel.fresnel(np.array([math.cos(angle)]), np.array([1 / n]))[0][0])


def henyey(g: float, cosine: float) -> float:
    return (1 - g * g) / (4 * math.pi * (1 + g * g - 2 * g * cosine) ** 1.5)


def along(length: float, extinction: np.ndarray) -> np.ndarray:
    """The integral of the transmittance over a ray."""
    return (1 - np.exp(-extinction * length)) / extinction


SCATTERING, ABSORPTION = np.array([4e-4, 3e-4, 2e-4]), np.array([0.4, 0.6, 0.8])
EXTINCTION = SCATTERING + ABSORPTION
FORMS = ("beams", "points")
MEDIUM = "medium(scattering: [0.0004, 0.0003, 0.0002], absorption: [0.4, 0.6, 0.8], phase: 0.4)"


@pytest.mark.parametrize("form", ["points", pytest.param("beams", marks=pytest.mark.long)])
def test_the_sun_through_a_slab_of_glass(tmp_path: Path, form: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Light passes by (1 − R) / (1 + R), then fades along the slanted way, and scatters once on a level ray. Paths find none of it."""
    text = "box([5, 0.2, 5], center: [0, 2, 0], material: glass(ior: 1.5))\n"
    text += f"box([3, 1.5, 3], center: [0, 0.9, 0], medium: {MEDIUM})\n"
    text += "sun(from: [0.6, 0.8, 0], illuminance: 10, angle: 0.01deg)\n"
    text += "camera(position: [0, 1, 9], look_at: [0, 1, 0], fov: 0.2deg)\nrender(bounces: 16)\n"
    r = reflectance(math.acos(0.8), 1.5)
    arrives = 10 * (1 - r) / (1 + r) * np.exp(-EXTINCTION * (1.65 - 1) / 0.8)
    expected = arrives * SCATTERING * henyey(0.4, 0) * along(3, EXTINCTION)
    plan = {"transport.caustics_in_media": form}
    monkeypatch.setattr(photon_beams, "FEWEST", 8192)  # the camera sees a part of them
    monkeypatch.setattr(photon_beams, "MOST", 8192)
    light = np.mean([seen(tmp_path, text, size=(32, 32), samples=512, seed=k, plan=plan).mean(axis=(0, 1)) for k in range(4)], axis=0)
    assert light == pytest.approx(expected, rel=0.03)
    assert seen(tmp_path, text, samples=64, plan={"transport.caustics": "paths"}).mean() < 1e-3 * expected.mean()


@pytest.mark.parametrize("form", ["points", pytest.param("beams", marks=pytest.mark.long)])
def test_a_beam_through_a_flat_interface(tmp_path: Path, form: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Sunlight enters water from above and scatters once before a camera in it. Radiance is not scaled by n²."""
    n, height = 1.33, 2.0
    text = f"box([24, {2 * height}, 24], material: glass(ior: {n}), medium: {MEDIUM})\n"
    text += "plane(y: -1.9, material: lambert(0))\nsun(from: [0.6, 0.8, 0], illuminance: 10, angle: 0.01deg)\n"
    text += "camera(position: [0, 1, 0], look_at: [-3, 1, 0], fov: 0.2deg)\nrender(bounces: 16)\n"
    sine = 0.6 / n
    cosine = math.sqrt(1 - sine * sine)
    enters = 10 * (1 - reflectance(math.acos(0.8), n)) * 0.8 / cosine
    arrives = enters / n**2 * np.exp(-EXTINCTION * (height - 1) / cosine)
    expected = arrives * SCATTERING * henyey(0.4, -sine) * along(12, EXTINCTION)
    plan = {"transport.caustics_in_media": form}
    monkeypatch.setattr(photon_beams, "FEWEST", 8192)  # the camera sees a part of them
    monkeypatch.setattr(photon_beams, "MOST", 8192)
    light = np.mean([seen(tmp_path, text, size=(32, 32), samples=512, seed=k, plan=plan).mean(axis=(0, 1)) for k in range(4)], axis=0)
    assert light == pytest.approx(expected, rel=0.03)


LAMP = "sphere(0.35, center: [-1, 2.7, 0.4], material: emissive(1, luminance: 20))\nplane(y: 0, material: lambert(0.5))\n"
LOOK = "camera(position: [0, 1.4, 5], look_at: [0, 1, 0], fov: 45deg)\nrender(bounces: 64)\n"
BALL = "sphere(0.5, center: [0, 1.2, 0], material: glass(ior: 1.5))\n"
SCENES = {
    "a ball in fog": BALL + "fog(visibility: 12, top: 3, falloff: 2, phase: 0.5)\n",
    "a ball in a box of smoke": BALL
    + "box([4, 4, 4], center: [0, 1.2, 0], medium: medium(scattering: 0.25, absorption: 0.05, phase: 0.4))\n",
    "a ball in a cloud": BALL + "box([4, 3, 4], center: [0, 1.5, 0], medium: medium(#ffffff, depth: 1, phase: 0.4,"
    " density: |x, y, z| smoothstep(0, 0.8, 1 + 0.7 * sin(3 * x) * cos(2 * y + z))))\n",
    "mirrors": "box([1, 1, 0.2], center: [0.4, 0.6, -0.8], material: mirror(0.9))\n"
    'sphere(0.4, center: [-0.5, 0.4, 0], material: metal("gold", roughness: 0.2))\n'
    "fog(visibility: 12, top: 3, falloff: 2, phase: 0.5)\n",
    "a lamp in water": "box([6, 3.6, 6], center: [0, 1.7, 0], material: glass(ior: 1.33),"
    " medium: medium(scattering: [0.1, 0.15, 0.2], absorption: [0.2, 0.1, 0.05]))\n" + BALL,
}


@pytest.mark.long
@pytest.mark.parametrize(("name", "form"), [*((name, "") for name in SCENES), ("a ball in fog", "beams"), ("a lamp in water", "beams")])
def test_paths_find_the_same_light(tmp_path: Path, name: str, form: str) -> None:
    """The lamp is large enough for paths to hit it; photons are forced."""
    text = SCENES[name] + LAMP + LOOK
    means: dict[str, np.ndarray] = {}
    errors = {}
    for way, samples in (("paths", 1024), ("photons", 64)):
        plan = {"transport.caustics": way} | ({"transport.caustics_in_media": form} if form and way == "photons" else {})
        runs = np.array([seen(tmp_path, text, size=(48, 36), samples=samples, seed=k, plan=plan) for k in range(6)])
        parts = runs.reshape(6, 3, 12, 4, 12, 3).mean(axis=(2, 4, 5))
        means[way], errors[way] = parts.mean(axis=0), parts.std(axis=0, ddof=1) / math.sqrt(6)
    assert means["photons"].mean() == pytest.approx(means["paths"].mean(), rel=0.01)
    off = np.abs(means["photons"] - means["paths"])
    assert (off < 0.02 * means["paths"] + 5 * np.hypot(errors["paths"], errors["photons"])).all()


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("threads", [2, 3])
def test_photons_in_media_have_the_same_bits_on_any_number_of_threads(tmp_path: Path, threads: int, form: str) -> None:
    text = SCENES["a ball in a box of smoke"] + LAMP + LOOK
    plan = {"transport.caustics": "photons", "transport.caustics_in_media": form}
    first, other = (seen(tmp_path, text, size=(24, 16), samples=4, threads=n, plan=plan) for n in (1, threads))
    assert np.array_equal(first, other)


def test_a_lamp_in_a_bulb_lights_the_fog(tmp_path: Path) -> None:
    """All its light passes the glass: paths find it by chance, photons carry it. The two agree."""
    text = "difference(material: glass(ior: 1.5)) {\n  sphere(0.5)\n  sphere(0.45)\n}\nsphere(0.2, material: emissive(1, luminance: 20))\n"
    text += "fog(scattering: 0.1, absorption: 0.1, phase: 0, top: 100m)\ncamera(position: [0, 2, 6], look_at: [0, 2, 0], fov: 4deg)\n"
    ways = [
        seen(tmp_path, text, samples=n, size=(16, 16), plan={"transport.caustics": way}).mean()
        for way, n in (("paths", 1024), ("photons", 64))
    ]
    assert ways[1] == pytest.approx(ways[0], rel=0.05)


WATER = "box([1, 1, 1], material: glass(ior: 1.33), medium: medium(scattering: {scattering}))\n"
GLOBE = "sphere(0.5, center: [0, 3, 0], material: emissive(1))\n"


@pytest.mark.parametrize(
    ("scene", "carrier"),
    [
        (BALL + "fog(visibility: 12)\nsun(from: [1, 2, 1])\n", "photons"),
        (WATER.format(scattering=3) + "point([0, 3, 0])\n", "photons"),
        (WATER.format(scattering=2) + GLOBE, "photons"),
        (WATER.format(scattering=20) + GLOBE, "paths"),  # light scatters 34 times, and has chances enough to find a lamp of 0.2 sr
        (WATER.format(scattering="0, absorption: 3") + "point([0, 3, 0])\n", "paths"),  # nothing scatters
        ("box([6, 6, 6], medium: medium(scattering: 3))\npoint([0, 1, 0])\nsphere(1, material: lambert(1))\n", "paths"),  # nothing focuses
        (BALL + "fog(visibility: 12)\narea([0, 3, 0], look_at: [0, 0, 0], size: [5, 5])\n", "paths"),  # a large light
        (BALL + "fog(visibility: 12)\nsky()\n", "paths"),
    ],
)
def test_the_plan_carries_light_of_small_lights_that_glass_focuses_into_media(tmp_path: Path, scene: str, carrier: str) -> None:
    path = tmp_path / "a.scene"
    path.write_text(scene, encoding="utf-8")
    plan = planner.make_plan(load.load(path), ir.Settings(bounces=16))
    assert plan["transport.caustics"] == carrier


SMOKE = "box([4, 4, 4], center: [0, 1.2, 0], medium: medium({medium}))\n"
SPOT = "spot([0, 3, 0], look_at: [0, 1.2, 0], cone: {cone}deg)\n"
BULB = "sphere(0.3, center: [0, 3, 0], material: glass())\npoint([0, 3, 0])\n"


@pytest.mark.parametrize(
    ("scene", "form", "forms"),
    [
        (BALL + SMOKE.format(medium="scattering: 0.2") + SPOT.format(cone=10), "beams", 2),
        (BALL + SMOKE.format(medium="scattering: 0.2") + SPOT.format(cone=20), "points", 2),  # passes by the ball
        (BALL + SMOKE.format(medium="scattering: 0.2") + SPOT.format(cone=10) + "sky()\n", "points", 2),
        (BALL + SMOKE.format(medium="scattering: 0.2") + "point([0, 3, 0])\n", "points", 2),
        (BALL + SMOKE.format(medium="scattering: 5") + SPOT.format(cone=10), "points", 2),  # dense
        (BALL + SMOKE.format(medium="#ffffff, depth: 9, density: |x, y, z| max(x, 0)") + SPOT.format(cone=10), "points", 1),
        (BALL + SMOKE.format(medium="absorption: 1") + SPOT.format(cone=10), "none", 1),
        (SMOKE.format(medium="scattering: 0.2") + SPOT.format(cone=10), "none", 1),  # nothing focuses
        (BULB + "fog(visibility: 100)\n", "beams", 2),
        (BULB + "fog(visibility: 0.1)\n", "points", 2),
    ],
)
def test_the_plan_carries_light_in_thin_media_by_beams(tmp_path: Path, scene: str, form: str, forms: int) -> None:
    path = tmp_path / "a.scene"
    path.write_text(scene, encoding="utf-8")
    decision = planner.make_plan(load.load(path), ir.Settings(bounces=16)).decisions["transport.caustics_in_media"]
    assert (decision.value, len(decision.choices)) == (form, forms)


def maps(beams: int, photons: int, empty: int = 0) -> tuple[photon_beams.Beams, list[np.ndarray]]:
    """Maps of beams with random starts, directions and lengths, and their rows; the first maps are `empty`."""
    rng, landed = np.random.default_rng(4), []
    for k in range(photon_grid.MAPS):
        n = 0 if k < empty else beams
        rows = np.zeros((n, 13), np.float32)
        toward = rng.normal(size=(n, 3))
        rows[:, :3], rows[:, 3:6] = rng.random((n, 3)), toward / np.linalg.norm(toward, axis=1)[:, None]
        rows[:, 6:9], rows[:, 9], rows[:, 12] = 1.0, rng.exponential(size=n), photon_beams.CODE + 1
        landed.append(rows)
    plain = photon_beams.empty(np.float64, np.array([False, True]), 40.0)
    return photon_beams.build(landed, 1, photons, np.zeros(3), plain, 2), landed


@pytest.mark.parametrize(("beams", "empty"), [(1, 0), (3, 15), (100, 1), (3000, 0)])
def test_pieces_cover_beams_and_boxes_hold_pieces(beams: int, empty: int) -> None:
    """All lengths and powers are there; each box holds those below it."""
    built, landed = maps(beams, 20_000, empty)
    rows = built.leaves * photon_beams.LEAF
    n = len(built.begin)
    power, start, way = (x.reshape(3, n) for x in (built.power, built.start, built.direction))
    boxes = built.boxes.reshape(photon_grid.MAPS, -1, 6)
    for k in range(photon_grid.MAPS):
        at = slice(k * rows, (k + 1) * rows)
        length = np.maximum(built.end[at] - built.begin[at], 0.0)
        kept = landed[k][:: -(-beams // photon_beams.FEWEST), 9]
        assert (length * power[0, at]).sum() == pytest.approx(kept.sum() * len(landed[k]) / max(len(kept), 1), rel=1e-4)
        used = length > 0.0
        low, high = (np.repeat(boxes[k, built.leaves :, axis : axis + 3], photon_beams.LEAF, axis=0)[used].T for axis in (0, 3))
        for t in (built.begin[at], built.end[at]):
            ends = (start[:, at] + t * way[:, at])[:, used]
            assert np.all(low < ends)
            assert np.all(ends < high)
        inner = np.arange(1, built.leaves)
        assert (boxes[k, inner, :3] == np.minimum(boxes[k, 2 * inner, :3], boxes[k, 2 * inner + 1, :3])).all()


def test_more_beams_are_thinner() -> None:
    few, many = (maps(250, photons)[0] for photons in (1_000_000, 100_000_000))
    used = few.end > few.begin
    assert (many.inverse >= few.inverse).all()
    assert (many.inverse[used] > 2.0 * few.inverse[used]).mean() > 0.1


def test_without_beams_there_are_no_maps() -> None:
    assert maps(0, 20_000)[0].leaves == 0
