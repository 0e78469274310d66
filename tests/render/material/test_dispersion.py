"""Dispersion of glass: Abbe numbers, a prism against Snell's law, kept energy, equal pictures of both backends, and its words."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import maquette
import numpy as np
import pytest
from click.testing import CliRunner
from maquette.cli.main import cli
from maquette.materials import glass
from maquette.materials.optics import spectrum
from maquette.render.material import dispersion, fresnel

IOR, DISPERSION = 1.6, 1.0  # an Abbe number of 20
INTO = np.array([np.cos(np.radians(23.13)), -np.sin(np.radians(23.13))])  # x and z of a ray at about minimum deviation
APEX, RIGHT, LEFT = np.array([0.0, -0.231]), np.array([0.2, 0.115]), np.array([-0.2, 0.115])
FAR = 10.0  # metres from the prism to the screen
WIDE = 2.0  # half width of the screen's window


def seen(tmp_path: Path, text: str, **settings: Any) -> np.ndarray:
    path = tmp_path / "a.scene"
    path.write_text(text, encoding="utf-8")
    return maquette.render(path, **{"denoise": False, **settings}).channels["rgba"][..., :3]


def refract(direction: np.ndarray, normal: np.ndarray, eta: float) -> tuple[np.ndarray, float]:
    """(refracted direction, transmitted share) at a face whose normal looks against the ray; `eta` is n₁/n₂."""
    cosine = float(-direction @ normal)
    bent = np.sqrt(1.0 - eta * eta * (1.0 - cosine * cosine))
    across, along = (eta * cosine - bent) / (eta * cosine + bent), (cosine - eta * bent) / (cosine + eta * bent)
    return eta * direction + (eta * cosine - bent) * normal, 1.0 - 0.5 * (across**2 + along**2)


def through_prism(ior: float) -> tuple[np.ndarray, np.ndarray, float]:
    """(where a ray leaves the prism, its direction, the transmitted share)."""
    start = (APEX + LEFT) / 2
    outward = [np.array([edge[1], -edge[0]]) / np.hypot(*edge) for edge in (APEX - LEFT, RIGHT - APEX)]
    inside, first = refract(INTO, outward[0], 1.0 / ior)
    way = ((APEX - start) @ outward[1]) / (inside @ outward[1])
    leaving, second = refract(inside, -outward[1], ior)
    return start + way * inside, leaving, first * second


@pytest.mark.parametrize("space", ["rec709", "rec2020", "acescg"])
def test_cells_of_the_spectrum_are_white_together(space: str) -> None:
    rows = dispersion.cells(space)
    assert rows[:-1, :3].mean(axis=0) == pytest.approx([1.0, 1.0, 1.0], abs=1e-12)
    assert (np.diff(rows[:, 3]) < 0.0).all()
    waves = 1.0 / np.sqrt(rows[[0, -1], 3] + glass.LINES[1] ** -2)
    assert waves == pytest.approx([0.38, 0.78], abs=1e-9)


@pytest.mark.parametrize(("ior", "abbe"), [(1.5168, 64.17), (1.62, 36.37), (2.417, 55.3)])
def test_the_abbe_number(ior: float, abbe: float) -> None:
    blue, yellow, red = (glass.index_at(ior, glass.KHRONOS / abbe, wave) for wave in glass.LINES)
    assert yellow == ior
    assert (yellow - 1.0) / (blue - red) == pytest.approx(abbe, rel=1e-12)


def test_schott_glasses_by_two_terms() -> None:
    """N-BK7 and SF2 by the Sellmeier equations of their data sheets; two terms are within 5e-4 and 3e-3."""
    sheets = {
        (1.5168, 64.17): ((1.03961212, 0.00600069867), (0.231792344, 0.0200179144), (1.01046945, 103.560653)),
        (1.64769, 33.82): ((1.40301821, 0.0105795466), (0.231767504, 0.0493226978), (0.939056586, 112.405955)),
    }
    for (ior, abbe), terms in sheets.items():
        for wave in (0.42, 0.45, 0.5, 0.55, 0.6, 0.65, 0.7):
            exact = np.sqrt(1.0 + sum(b * wave**2 / (wave**2 - c) for b, c in terms))
            bound = 5e-4 if abbe > 50 else 3e-3
            assert glass.index_at(ior, glass.KHRONOS / abbe, wave) == pytest.approx(exact, abs=bound)


PRISM = f"extrude([[0, -0.231], [0.2, 0.115], [-0.2, 0.115]], 2, centered: true, material: glass(ior: {IOR}, dispersion: {DISPERSION}))"


def test_rays_of_each_wavelength_leave_a_prism_by_snells_law() -> None:
    """The index of a wavelength and the refraction that kernels use, against the deviation i + arcsin(n sin(A − arcsin(sin i / n))) − A."""
    number = (np.arange(64) + 0.5) / 64
    rows = dispersion.cells()
    shift = np.interp(number, np.linspace(0.0, 1.0, len(rows)), rows[:, 3])
    table = dispersion.Dispersion(np.array([glass.slope(DISPERSION)]), np.zeros(1), rows)
    tables, surface = SimpleNamespace(materials=SimpleNamespace(dispersion=table)), SimpleNamespace(material=np.zeros(64, int))
    ior = dispersion.index(dispersion.Component(shift, (shift, shift, shift)), np.full(64, IOR), tables, surface)
    zero, faces = np.zeros(64), [np.array([edge[1], 0.0, -edge[0]]) / np.hypot(*edge) for edge in (APEX - LEFT, RIGHT - APEX)]
    ray = (zero + INTO[0], zero, zero + INTO[1])
    for normal, eta in ((faces[0], 1.0 / ior), (-faces[1], ior)):
        against = tuple(zero + c for c in normal)
        cosine = -sum(a * b for a, b in zip(ray, against, strict=True))
        ray = fresnel.refract(ray, against, cosine, fresnel.fresnel(cosine, eta)[1], eta)
    waves = 1.0 / np.sqrt(shift + glass.LINES[1] ** -2)
    n = np.array([glass.index_at(IOR, DISPERSION, wave) for wave in waves])
    apex, angle = np.arccos(-faces[0] @ faces[1]), np.arccos(-INTO[0] * faces[0][0] - INTO[1] * faces[0][2])
    deviation = angle + np.arcsin(n * np.sin(apex - np.arcsin(np.sin(angle) / n))) - apex
    turned = np.arctan2(ray[2], ray[0]) - np.arctan2(INTO[1], INTO[0])
    assert apex == pytest.approx(np.radians(60.0), abs=2e-3)
    assert np.ptp(deviation) > 0.09
    assert turned == pytest.approx(deviation, abs=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("backend", ["ray", "reference"])
def test_a_screen_seen_through_a_prism(tmp_path: Path, backend: str) -> None:
    """Its radiance grows along it, so that red, green and blue tell the mean of the places that each is seen at, in metres."""
    left, out, _ = through_prism(IOR)
    across, target = np.array([-out[1], out[0]]), (APEX + LEFT) / 2
    middle, eye = left + FAR * out, target - INTO
    place = f"x * {across[0]:.17g} + z * {across[1]:.17g}"  # in the frame of the plane
    text = f"""
{PRISM}
plane(normal: [{-out[0]:.17g}, 0, {-out[1]:.17g}], point: [{middle[0]:.17g}, 0, {middle[1]:.17g}],
  material: emissive(pattern(|x, y, z| if abs({place}) < {WIDE} then SHOWN else 0)))
camera(position: [{eye[0]:.17g}, 0, {eye[1]:.17g}], look_at: [{target[0]:.17g}, 0, {target[1]:.17g}], projection: "orthographic",
  width: 1e-6)
sky(radiance: 1e-12)
"""
    even, growing = (
        seen(tmp_path, text.replace("SHOWN", shown), size=(16, 16), samples=256, bounces=3, backend=backend).mean(axis=(0, 1))
        for shown in ("1", f"2 + {place}")
    )
    waves = np.arange(spectrum.FIRST, spectrum.LAST, 0.5)
    places, shares = [], []
    for wave in waves:
        end, direction, share = through_prism(glass.index_at(IOR, DISPERSION, wave * 1e-3))
        places.append((end + ((middle - end) @ out) / (direction @ out) * direction - middle) @ across)
        shares.append(share)
    assert np.abs(places).max() < WIDE
    response = spectrum.response(waves) * np.array(shares)
    wanted = response @ np.array(places) / response.sum(axis=1)
    assert np.ptp(wanted) > 0.5
    assert growing / even - 2.0 == pytest.approx(wanted, abs=0.01)


BALL = "sphere(1, material: glass(ior: 1.8, dispersion: 2))\nsphere(0.6, material: glass(ior: 1.4, dispersion: 1, priority: 2))"
FROSTED = "sphere(1, material: glass(ior: 1.5, dispersion: 1, roughness: 0.4))"


@pytest.mark.long
@pytest.mark.parametrize(("shapes", "within"), [(BALL, 0.01), (FROSTED, 0.015)])
def test_a_white_sky_stays_white(tmp_path: Path, shapes: str, within: float) -> None:
    """Also by total reflection, in glass around glass, and where the camera is inside of glass."""
    for eye in (4, 0.8):
        text = f"{shapes}\nsky(radiance: 1)\ncamera(position: [0, 0, {eye}], look_at: [0, 0.3, 0], fov: 20deg)"
        picture = seen(tmp_path, text, size=(32, 32), samples=256, bounces=64)
        assert picture.mean(axis=(0, 1)) == pytest.approx([1.0, 1.0, 1.0], abs=within)


CAUSTIC = """
plane(y: 0, material: lambert(0.8))
sphere(0.5, center: [0, 0.5, 0], material: glass(ior: 1.6, dispersion: {dispersion}))
sun(from: [2, 3, 0], irradiance: 3)
camera(position: [0, 6, 0.1], look_at: [0, 0, 0], fov: 40deg)
"""


@pytest.mark.long
def test_photons_keep_the_light_of_a_caustic_and_color_its_edge(tmp_path: Path) -> None:
    plain, split = (
        seen(tmp_path, CAUSTIC.format(dispersion=d), size=(64, 64), samples=64, bounces=8) for d in (0, 2)
    )  # fmt: skip
    assert split.mean(axis=(0, 1)) == pytest.approx(plain.mean(axis=(0, 1)), rel=0.02)
    assert np.abs(split[..., 0] - split[..., 2]).max() > 0.2
    assert np.abs(plain[..., 0] - plain[..., 2]).max() < 0.02


def test_equal_on_any_number_of_threads(tmp_path: Path) -> None:
    pictures = [seen(tmp_path, CAUSTIC.format(dispersion=2), size=(24, 16), samples=8, bounces=6, threads=n) for n in (1, 3)]
    assert (pictures[0] == pictures[1]).all()


@pytest.mark.parametrize("words", [["--backend", "raster"], ["--plan", "transport=whitted"]])
def test_what_does_not_draw_it_says_so(tmp_path: Path, words: list[str]) -> None:
    path = tmp_path / "a.scene"
    path.write_text(CAUSTIC.format(dispersion=2), encoding="utf-8")
    said = CliRunner().invoke(cli, ["render", str(path), "--size", "16x16", "--samples", "4", "-o", str(tmp_path / "a.png"), *words])
    assert said.exit_code == 0
    assert "the dispersion of glass is left out" in said.output


@pytest.mark.parametrize(("ending", "says"), [("glb", False), ("usda", False), ("xml", True), ("pov", False)])
def test_exports_carry_it_or_name_it(tmp_path: Path, ending: str, says: bool) -> None:
    path = tmp_path / "a.scene"
    path.write_text(CAUSTIC.format(dispersion=0.5), encoding="utf-8")
    said = CliRunner().invoke(cli, ["convert", str(path), str(tmp_path / f"a.{ending}")])
    assert said.exit_code == 0
    assert ("dispersion of glass is not carried" in said.output) == says
    carried = {"pov": "dispersion 1.0", "usda": "inputs:transmission_dispersion_scale = 1"}
    assert carried.get(ending, "") in (tmp_path / f"a.{ending}").read_text(errors="replace")
