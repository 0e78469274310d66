"""Translucent sheets: light of both sides against closed forms, kept energy, files of other formats, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import maquette
import numpy as np
import pytest
from click.testing import CliRunner
from maquette.cli.main import cli
from maquette.compiler import ir, load
from maquette.materials import diffuse_transmission


def document(path: Path) -> dict:
    """The JSON of a .glb file."""
    data = path.read_bytes()
    return json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])


def rewrite(path: Path, written: dict) -> None:
    """A .glb file with other JSON."""
    data = path.read_bytes()
    rest = data[20 + int.from_bytes(data[12:16], "little") :]
    text = json.dumps(written).encode()
    text += b" " * (-len(text) % 4)
    head = b"glTF" + (2).to_bytes(4, "little") + (20 + len(text) + len(rest)).to_bytes(4, "little")
    path.write_bytes(head + len(text).to_bytes(4, "little") + b"JSON" + text + rest)


LIGHTS = {  # of irradiance π or radiance 1, and the share of it that is seen of color 0.3 and transmission 0.6
    "behind": ("directional(from: [0, 0, -1], irradiance: 3.14159265)", 0.6),
    "before": ("directional(from: [0, 0, 1], irradiance: 3.14159265)", 0.3),
    "askew": ("directional(from: [1, 0, -1], irradiance: 3.14159265)", 0.6 * 0.70710678),
    "sky": ("sky(radiance: 1)", 0.9),
    "ambient": ("ambient(radiance: 1)", 0.9),
}
SHEET = "plane(normal: [0, 0, 1], material: translucent(0.3, transmission: 0.6))"


def seen(tmp_path: Path, text: str, **settings: Any) -> np.ndarray:
    path = tmp_path / "a.scene"
    path.write_text(f"camera(position: [0, 0, 4], look_at: [0, 0, 0], fov: 20deg)\n{text}\n", encoding="utf-8")
    settings = {"size": (8, 8), "samples": 64, "denoise": False, **settings}
    return maquette.render(path, **settings).channels["rgba"][..., :3]


@pytest.mark.parametrize("backend", ["ray", "reference", "raster"])
@pytest.mark.parametrize("light", LIGHTS)
def test_light_of_both_sides(tmp_path: Path, light: str, backend: str) -> None:
    text, share = LIGHTS[light]
    picture = seen(tmp_path, f"{SHEET}\n{text}", backend=backend)
    assert picture.mean() == pytest.approx(share, abs=0.01)


@pytest.mark.parametrize("bounces", [0, 8])
def test_a_lamp_behind_a_sheet(tmp_path: Path, bounces: int) -> None:
    """L = τ I / (π d²) straight before a point light."""
    lamp = "point([0, 0, -2], intensity: 5)"
    text = f"disk(2, normal: [0, 0, 1], material: translucent(0.3, transmission: rgb(0.6, 0.3, 0)))\n{lamp}"
    picture = seen(tmp_path, text, bounces=bounces, crop=(3, 3, 5, 5), backend="ray")
    expected = np.array([0.6, 0.3, 0.0]) * 5 / (np.pi * 4)
    assert picture.mean(axis=(0, 1)) == pytest.approx(expected, rel=0.02)


def test_a_furnace_keeps_all_light(tmp_path: Path) -> None:
    """Spheres that lose nothing vanish under a sky of radiance 1, whatever bounces inside."""
    text = "sky(radiance: 1)\nsphere(0.5, material: translucent(0.5, transmission: 0.5))\nrender(bounces: 64)"
    picture = seen(tmp_path, text, backend="ray", samples=256)
    assert picture.mean() == pytest.approx(1.0, abs=0.01)


LENS = """
translate([0, 0, -1]) { sphere(0.4, material: glass(ior: 1.5)) }
sphere(0.02, center: [0, 0, -4], material: emissive(radiance: 1e4))
"""


@pytest.mark.long
def test_photons_light_sheets_from_behind(tmp_path: Path) -> None:
    """A lens throws the light of a small lamp on the back of a sheet: the caustic is seen from the front of what passes light alone."""
    bright, black = (
        seen(tmp_path, f"disk(0.5, normal: [0, 0, 1], material: translucent({colors})){LENS}", backend="ray", samples=16)[3:5, 3:5].mean()
        for colors in ("0, transmission: 0.8", "0.8, transmission: 0")
    )
    assert bright > 100 * max(black, 1e-6)


def test_directions_have_their_density() -> None:
    rng = np.random.default_rng(1)
    n = 200_000
    normal, viewer = tuple(np.full(n, c) for c in (0.0, 0.6, 0.8)), tuple(np.full(n, c) for c in (0.0, 0.0, 1.0))
    inputs = (tuple(np.full(n, c) for c in (0.6, 0.3, 0.1)),)
    direction = np.array(diffuse_transmission.sample(inputs, normal, viewer, rng.random(n), rng.random(n)))
    density = diffuse_transmission.density(inputs, normal, tuple(direction), viewer)
    assert np.linalg.norm(direction, axis=0) == pytest.approx(1.0)
    assert (density > 0.0).all()
    assert np.mean(1.0 / density) == pytest.approx(2 * np.pi, rel=0.05)  # of the half space behind
    share = np.array(diffuse_transmission.value(inputs, normal, tuple(direction), viewer)) / (np.pi * density)
    assert share.mean(axis=1) == pytest.approx([0.6, 0.3, 0.1])


def test_more_light_than_arrives_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.scene"
    path.write_text("sphere(1, material: translucent(0.7, transmission: 0.6))\nsun()\n", encoding="utf-8")
    result = CliRunner().invoke(cli, ["check", str(path)])
    assert result.exit_code == 1
    assert "translucent: color and transmission are 1.3 together: a sheet sends on no more light than arrives" in result.output


def test_gltf_carries_it_both_ways(tmp_path: Path) -> None:
    path = tmp_path / "a.scene"
    path.write_text("sphere(1, material: translucent(rgb(0.3, 0.2, 0.1), transmission: rgb(0.6, 0.4, 0.5)))\nsun()\n", encoding="utf-8")
    result = CliRunner().invoke(cli, ["convert", str(path), str(tmp_path / "a.glb")])
    assert result.exit_code == 0, result.output
    written = document(tmp_path / "a.glb")
    assert "KHR_materials_diffuse_transmission" in written["extensionsUsed"]
    materials = load.load(tmp_path / "a.glb").tables.materials
    row = int(np.flatnonzero(materials.model == ir.MaterialModel.TRANSLUCENT)[0])
    assert materials.values[row, ir.Slot.DIFFUSE] == pytest.approx([0.3, 0.2, 0.1], rel=1e-6)
    assert materials.values[row, ir.Slot.DIFFUSE_TRANSMISSION] == pytest.approx([0.6, 0.4, 0.5], rel=1e-6)


def test_a_gltf_surface_with_a_highlight_is_blended(tmp_path: Path) -> None:
    path = tmp_path / "a.scene"
    path.write_text("sphere(1, material: principled(0.5, roughness: 0.3))\nsun()\n", encoding="utf-8")
    assert CliRunner().invoke(cli, ["convert", str(path), str(tmp_path / "a.glb")]).exit_code == 0
    written = document(tmp_path / "a.glb")
    factors = {"diffuseTransmissionFactor": 0.25, "diffuseTransmissionColorFactor": [1, 0.5, 0]}
    written["materials"][0].setdefault("extensions", {})["KHR_materials_diffuse_transmission"] = factors
    written.setdefault("extensionsUsed", []).append("KHR_materials_diffuse_transmission")
    rewrite(tmp_path / "a.glb", written)
    materials = load.load(tmp_path / "a.glb").tables.materials
    blend = int(np.flatnonzero(materials.model == ir.MaterialModel.BLEND)[0])
    assert materials.values[blend, ir.Slot.WEIGHT, 0] == pytest.approx(0.25)
    assert materials.model[materials.first[blend]] == ir.MaterialModel.PRINCIPLED
    sheet = materials.second[blend]
    assert materials.values[sheet, ir.Slot.DIFFUSE].tolist() == [0, 0, 0]
    assert materials.values[sheet, ir.Slot.DIFFUSE_TRANSMISSION] == pytest.approx([1, 0.5, 0])
