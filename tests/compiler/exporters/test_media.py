"""Media in files of other programs: what is carried and read again, and the losses by name."""

from __future__ import annotations

import base64
import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from maquette.cli.main import cli
from maquette.compiler import ir, load
from maquette.lang.diagnostics import Diagnostics
from maquette.materials import losses

SCENE = """\
sphere(1, medium: medium(scattering: 2, absorption: [0.1, 0.2, 0.5]))
sphere(1, [3, 0, 0], material: glass(ior: 1.3), medium: medium(rgb(0.9, 0.8, 0.5), 20cm, phase: 0.3))
sphere(1, [-3, 0, 0], material: subsurface(#e0b080, radius: 5cm))
point([0, 5, 3])
camera([0, 0, 9])
render(filter: "box")
"""
HOMOGENEOUS = {"scattering": 1e-6, "absorption": 1e-6, "anisotropy": 1e-9}
LOSSES = """\
box(1, medium: medium(scattering: 1, density: |x, y, z| x))
box(1, [3, 0, 0], medium: medium(scattering: 1, emission: 2, priority: 1))
fog(visibility: 100m)
point([0, 5, 3])
camera([0, 0, 9])
render(filter: "box")
"""
EVERY = ["a medium whose density varies is not carried", "fog is not carried", "light that a medium emits is not carried",
         "the priority of a medium is not carried: where shapes overlap, both media are there"]  # fmt: skip


def converted(tmp_path: Path, text: str, name: str) -> tuple[Path, list[str]]:
    """The file, and the warnings."""
    (tmp_path / "a.scene").write_text(text, encoding="utf-8")
    path = tmp_path / name
    result = CliRunner().invoke(cli, ["convert", str(tmp_path / "a.scene"), str(path)])
    assert result.exit_code == 0, result.output
    return path, [line.partition("warning: ")[2] for line in result.output.splitlines() if "warning: " in line]


def test_gltf_carries_homogeneous_media_and_bodies(tmp_path: Path) -> None:
    path, lost = converted(tmp_path, SCENE, "a.glb")
    assert lost == []
    data = path.read_bytes()
    document = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    assert "KHR_materials_volume_scatter" in document["extensionsUsed"]
    diagnostics = Diagnostics()
    before, after = load.load(tmp_path / "a.scene"), load.load(path, diagnostics=diagnostics)
    assert [d.message for d in diagnostics.items] == []
    for column, off in HOMOGENEOUS.items():
        assert np.allclose(getattr(before.tables.media, column), getattr(after.tables.media, column), rtol=1e-4, atol=off)
    models = after.tables.materials.model[after.tables.instances.material].tolist()
    assert models == [ir.MaterialModel.GLASS, ir.MaterialModel.GLASS, ir.MaterialModel.SUBSURFACE]
    assert after.tables.instances.visible.tolist() == before.tables.instances.visible.tolist() == [5, 7, 7]


def test_gltf_carries_highlights_and_colours_of_bodies(tmp_path: Path) -> None:
    text = "sphere(1, material: subsurface(#e0b080, radius: [5cm, 2cm, 1cm], roughness: 0.3, ior: 1.4))\n" + SCENE[SCENE.index("point") :]
    path, lost = converted(tmp_path, text, "a.glb")
    before, after = load.load(tmp_path / "a.scene"), load.load(path)
    first, second = (scene.tables.materials for scene in (before, after))
    rows = [int(scene.tables.instances.material[0]) for scene in (before, after)]
    assert (lost, second.model[rows[1]]) == ([], ir.MaterialModel.SUBSURFACE)
    for slot, off in ((ir.Slot.IOR, 1e-6), (ir.Slot.ROUGHNESS, 1e-6), (ir.Slot.AMBIENT, 5e-3)):
        assert np.allclose(first.values[rows[0], slot], second.values[rows[1], slot], atol=off)
    for column, off in HOMOGENEOUS.items():
        assert np.allclose(getattr(before.tables.media, column), getattr(after.tables.media, column), rtol=1e-4, atol=off)


@pytest.mark.parametrize(
    ("material", "message"),
    [
        ("material: subsurface(checker(#ffffff, #000000))", losses.BODY_COLOR),
        ("medium: medium(scattering: 1, droplet: 20um)", losses.PHASE),
    ],
)
def test_gltf_tells_of_textures_and_phase_functions(tmp_path: Path, material: str, message: str) -> None:
    assert message in converted(tmp_path, f"sphere(1, {material})\n" + SCENE[SCENE.index("point") :], "a.glb")[1]


def test_scattering_without_a_way_in_is_told(tmp_path: Path) -> None:
    data = converted(tmp_path, SCENE, "a.glb")[0].read_bytes()
    length = int.from_bytes(data[12:16], "little")
    document, rest = json.loads(data[20 : 20 + length]), data[20 + length + 8 :]
    document["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64.b64encode(rest).decode()
    path = tmp_path / "a.gltf"
    for material in document["materials"]:
        material["extensions"].pop("KHR_materials_transmission", None)
        material["extensions"].pop("KHR_materials_diffuse_transmission", None)
    path.write_text(json.dumps(document), encoding="utf-8")
    diagnostics = Diagnostics()
    load.load(path, diagnostics=diagnostics)
    message = "KHR_materials_volume_scatter counts where light passes: with KHR_materials_transmission from one half on"
    assert any(d.message.startswith(message) for d in diagnostics.items)


def test_mitsuba_gets_homogeneous_media_and_null_boundaries(tmp_path: Path) -> None:
    path, lost = converted(tmp_path, SCENE, "a.xml")
    text = path.read_text(encoding="utf-8")
    assert lost == ["light that scatters inside of a body is not carried: it is a diffuse surface of its colour"]
    assert '<integrator type="volpath">' in text
    assert '<bsdf type="null" id="material0"/>' in text
    assert text.count('<medium type="homogeneous" name="interior">') == 2
    for line in ('<float name="scale" value="2.5"/>', '<rgb name="sigma_t" value="0.84, 0.88, 1"/>', '<float name="g" value="0.3"/>'):
        assert line in text


def test_mitsuba_is_told_of_what_stands_inside_of_a_medium(tmp_path: Path) -> None:
    text = SCENE.replace("point([0, 5, 3])", "point([0, 0.2, 0])")
    assert "a light or a camera inside of a medium is not carried: Mitsuba takes it to be outside" in converted(tmp_path, text, "a.xml")[1]


def test_povray_gets_media(tmp_path: Path) -> None:
    path, lost = converted(tmp_path, SCENE, "a.pov")
    text = path.read_text(encoding="utf-8")
    assert "media { scattering { 1, rgb <0.5, 0.5, 0.5> extinction 4 } absorption rgb <0.1, 0.2, 0.5> }" in text
    assert "media { scattering { 5, rgb <1.125, 1, 0.625> extinction 4 eccentricity 0.3 } absorption rgb <0.5, 1, 2.5> }" in text
    assert text.count("\n  hollow\n") == 2
    assert set(lost) == {
        "light scatters once in media of POV-Ray: they are darker where it scatters more often",
        "light that scatters inside of a body is not carried: it is a diffuse surface of its colour",
    }


def test_usd_carries_homogeneous_media_and_bodies(tmp_path: Path) -> None:
    path, lost = converted(tmp_path, SCENE, "a.usda")
    assert lost == []
    diagnostics = Diagnostics()
    before, after = load.load(tmp_path / "a.scene"), load.load(path, diagnostics=diagnostics)
    assert [d.message for d in diagnostics.items if d.severity != "note"] == []
    rows = [[scene.tables.materials.medium[row] for row in scene.tables.instances.material] for scene in (before, after)]
    for column in HOMOGENEOUS:
        values = [getattr(scene.tables.media, column)[medium] for scene, medium in zip((before, after), rows, strict=True)]
        assert np.allclose(values[0], values[1], rtol=1e-4, atol=1e-6)
    models = after.tables.materials.model[after.tables.instances.material].tolist()
    assert models == [ir.MaterialModel.GLASS, ir.MaterialModel.GLASS, ir.MaterialModel.OPENPBR]
    assert after.tables.instances.visible.tolist() == before.tables.instances.visible.tolist() == [5, 7, 7]


@pytest.mark.parametrize("name", ["a.glb", "a.xml", "a.pov", "a.usda"])
def test_what_no_format_has_is_lost_by_name(tmp_path: Path, name: str) -> None:
    lost = [message for message in converted(tmp_path, LOSSES, name)[1] if not message.startswith("light scatters once")]
    assert sorted(lost) == EVERY
