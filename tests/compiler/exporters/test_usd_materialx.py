"""MaterialX in USD files that are written: slabs and patterns come back, and the package MaterialX finds the graphs valid."""

# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from pathlib import Path
from typing import Any

import maquette
import MaterialX as mx
import numpy as np
import pytest
from click.testing import CliRunner
from maquette.cli.main import cli
from maquette.compiler import ir
from maquette.compiler.formula.tape import load_tape
from maquette.compiler.load import load
from maquette.compiler.texture_graph import evaluate
from maquette.materials import MATERIALS
from pxr import Usd, UsdShade

from ...files import write_image

VIEW = "camera([0, 1, 6], look_at: [0, 0, 0], fov: 30deg)\nsun([1, 2, 1.5], illuminance: 3)\nsky(luminance: 0.5)\nrender(size: [48, 32])\n"
SLABS = {
    "brushed": "openpbr(rgb(0.5, 0.4, 0.3), base_metalness: 1, specular_color: rgb(0.7, 0.8, 0.9), "
    "specular_roughness_anisotropy: 0.8, specular_rotation: 0.125)",
    "painted": "openpbr(#a02818, coat_weight: 0.8, coat_color: rgb(0.9, 0.5, 0.4), coat_roughness: 0.1, coat_ior: 1.4, "
    "coat_darkening: 0.5, fuzz_weight: 0.3, fuzz_color: rgb(0.1, 0.2, 0.9), base_diffuse_roughness: 0.4)",
    "bubble": "openpbr(transmission_weight: 1, geometry_thin_walled: true, thin_film_weight: 1, thin_film_thickness: 0.3, "
    "specular_ior: 1.2)",
    "tea": "openpbr(transmission_weight: 1, transmission_color: rgb(0.8, 0.4, 0.1), transmission_depth: 20cm, coat_weight: 0.2, "
    "transmission_scatter: rgb(0.1, 0.05, 0.02), transmission_scatter_anisotropy: 0.4)",
    "wax": "openpbr(subsurface_weight: 1, subsurface_color: rgb(0.8, 0.6, 0.4), subsurface_radius: 5mm, "
    "subsurface_scatter_anisotropy: 0.2)",
    "lamp": "openpbr(emission_luminance: 7, emission_color: rgb(1, 0.5, 0.25))",
    "prism": "glass(rgb(0.9, 1, 0.9), ior: 1.6, roughness: 0.1, dispersion: 0.3)",
}


def converted(folder: Path, text: str) -> tuple[Path, str]:
    (folder / "a.scene").write_text(text + VIEW, encoding="utf-8")
    done = CliRunner().invoke(cli, ["convert", str(folder / "a.scene"), str(folder / "a.usda")])
    assert done.exit_code == 0, done.stderr
    return folder / "a.usda", done.stderr


def errors(path: Path) -> str:
    """What MaterialX says of the nodes of a stage."""
    library = mx.createDocument()
    mx.loadLibraries(mx.getDefaultDataLibraryFolders(), mx.getDefaultDataSearchPath(), library)
    document = mx.createDocument()
    document.importLibrary(library)
    stage = Usd.Stage.Open(str(path))
    for prim in stage.Traverse():
        shader = UsdShade.Shader(prim)
        definition = library.getNodeDef(str(shader.GetIdAttr().Get())) if shader else None
        if definition is None:
            continue
        node = document.addNode(definition.getNodeString(), _name(prim), definition.getType())
        node.setNodeDefString(definition.getName())
        for entry in shader.GetInputs():
            described = definition.getActiveInput(entry.GetBaseName())
            assert described is not None, f"{definition.getName()} has no {entry.GetBaseName()}"
            port = node.addInput(entry.GetBaseName(), described.getType())
            sources = entry.GetConnectedSources()[0]
            if sources:
                port.setNodeName(_name(sources[0].source.GetPrim()))
            else:
                port.setValueString(_text(entry.Get()))
    valid, message = document.validate()
    return "" if valid else message


def _name(prim: Any) -> str:
    return mx.createValidName(str(prim.GetPath()).strip("/"))


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return str(
        getattr(value, "path", None) or (", ".join(map(str, value)) if hasattr(value, "__len__") and not isinstance(value, str) else value)
    )


@pytest.mark.parametrize("name", SLABS)
def test_slabs_come_back(tmp_path: Path, name: str) -> None:
    stage, said = converted(tmp_path, f"sphere(1, material: {SLABS[name]})\n")
    assert "not carried" not in said
    assert not errors(stage)
    first, second = (load(tmp_path / file).tables for file in ("a.scene", "a.usda"))
    m, n = first.materials, second.materials
    row, again = int(first.instances.material[0]), int(second.instances.material[0])
    assert m.model[row] == n.model[again]
    for slot in MATERIALS[int(m.model[row])].SLOTS:
        width = 3 if slot in ir.COLOR_SLOTS else 1
        np.testing.assert_allclose(m.values[row, slot, :width], n.values[again, slot, :width], rtol=1e-6, atol=1e-7, err_msg=slot.name)
    assert (m.medium[row] >= 0) == (n.medium[again] >= 0)
    if m.medium[row] >= 0:
        for column in ("scattering", "absorption", "anisotropy"):
            expected, medium = (getattr(t.media, column)[k.medium[r]] for t, k, r in ((first, m, row), (second, n, again)))
            np.testing.assert_allclose(expected, medium, rtol=1e-4, atol=1e-5)


PATTERNED = [
    "lambert(pattern(|x, y, z| if mod(4 * x, 1) < 0.5 then rgb(0.8, 0.2, 0.1) else rgb(0.1, 0.3, abs(y))))",
    "openpbr(pattern(|x, y, z| rgb(0.5 + 0.5 * sin(9 * x), hypot(x, y) / 2, atan2(y, x + 3) ^ 2)), specular_roughness: 0.4)",
    "principled(rgb(0.5, 0.1, 0.1), roughness: pattern(|x, y, z| clamp(0.2 + floor(3 * y) / 4, 0.1, 0.9)))",
]


@pytest.mark.parametrize("material", PATTERNED)
def test_patterns_are_graphs(tmp_path: Path, material: str) -> None:
    stage, said = converted(tmp_path, f"box(1.5, rotate: [20deg, 30deg, 0deg], material: {material})\n")
    assert "pattern is not carried" not in said
    assert not errors(stage)
    scenes = [maquette.load(tmp_path / file) for file in ("a.scene", "a.usda")]
    first, second = (np.array(scene.render(size=(48, 32), samples=4, denoise=False))[..., :3] for scene in scenes)
    assert np.abs(first - second).mean() < 5e-3 * first.mean()


GRAPHS = {
    "openpbr(#e0c080, base_metalness: 1, specular_roughness: 0.4, specular_roughness_anisotropy: 0.8, "
    "specular_rotation: pattern(|x, y, z| 0.25 + 0.2 * sin(6 * y)))": ir.Slot.ROTATION,
    "lambert(pattern(|x, y, z, u, v, nx, ny, nz| rgb(abs(perlin(4 * x, 4 * y, 4 * z)), u * v, abs(nx)) "
    "+ 0.1 * perlin_color(2 * x, 2 * y) + 0.05 * perlin_color(2 * x, 2 * y, z)))": ir.Slot.DIFFUSE,
    'lambert(pattern(|u, v| lerp(image("p.exr", wrap: "clamp", filter: "nearest")(2 * u, v), image("p.exr")(v, u), 0.4)))': ir.Slot.DIFFUSE,
    'principled(0.5, metallic: 1, roughness: pattern(|u, v| 0.2 + 0.4 * image("p.exr")(3 * u, v).g))': ir.Slot.ROUGHNESS,
}


@pytest.mark.parametrize("material", GRAPHS)
def test_graphs_with_pictures_and_noise_come_back(tmp_path: Path, material: str) -> None:
    """Values at random points; pictures are looked up at whole texels, wrapped as their textures say."""
    write_image(tmp_path / "p.exr", np.random.default_rng(5).uniform(0.0, 1.0, (5, 4, 3)).astype(np.float32))
    stage, said = converted(tmp_path, f"box(1.5, rotate: [20deg, 30deg, 0deg], material: {material})\n")
    assert "pattern is not carried" not in said
    assert not errors(stage)
    first, second = (_values(load(tmp_path / file).tables, GRAPHS[material]) for file in ("a.scene", "a.usda"))
    assert np.ptp(first) > 0.1
    np.testing.assert_allclose(first, second, rtol=2e-3, atol=2e-3)


def _values(tables: ir.Tables, slot: ir.Slot) -> np.ndarray:
    """(3, n) an input of the first material at random points."""
    row = int(tables.instances.material[0])
    texture = int(tables.materials.textures[row, slot])
    textures, images = tables.textures, tables.images
    points = np.random.default_rng(7).uniform(-1.0, 1.0, (8, 200))
    points[3:5], points[5:] = np.abs(points[3:5]), points[5:] / np.linalg.norm(points[5:], axis=0)

    def look(picture: int, s: np.ndarray, t: np.ndarray) -> list[np.ndarray]:
        image, clamps = int(textures.image[picture]), textures.wrap_u[picture] == ir.Wrap.CLAMP
        width, height, begin = int(images.width[image]), int(images.height[image]), int(images.first[image])
        s, t = (np.clip(x, 0.0, 1.0 - 1e-9) if clamps else x % 1.0 for x in (s, 1.0 - t))
        texels = images.texels[begin : begin + width * height].reshape(height, width, 4)
        return [*texels[(t * height).astype(int) % height, (s * width).astype(int) % width].T.astype(np.float64)]

    results = np.array(evaluate.results(load_tape(tables, int(textures.tape[texture])), list(points), look))
    levels = textures.gain[texture][:, None] * results + textures.bias[texture][:, None]
    return tables.materials.values[row, slot][: len(results), None] * levels[: len(results)]


@pytest.mark.parametrize("material", PATTERNED)
def test_patterns_are_pictures_of_usd_preview_surface(tmp_path: Path, material: str) -> None:
    """For programs that do not read MaterialX: the stage without its networks gives the same picture."""
    file, messages = converted(tmp_path, f"box(1.5, rotate: [20deg, 30deg, 0deg], material: {material})\n")
    stage = Usd.Stage.Open(str(file))
    assert "note: patterns are baked into pictures of " in messages
    for prim in stage.Traverse():
        if prim.GetTypeName() == "Material":
            prim.RemoveProperty("outputs:mtlx:surface")
    stage.GetRootLayer().Export(str(tmp_path / "b.usda"))
    scenes = [maquette.load(tmp_path / file) for file in ("a.scene", "b.usda")]
    first, second = (np.array(scene.render(size=(48, 32), samples=16, denoise=False))[..., :3] for scene in scenes)
    assert np.abs(first - second).mean() < 0.04 * first.mean()


def test_pictures_of_slabs_come_back(tmp_path: Path) -> None:
    text = (
        "plane(y: 0, material: openpbr(checker(rgb(0.8, 0.2, 0.1), rgb(0.1, 0.3, 0.8), size: 1), specular_roughness: 0.6))\nsphere(0.1)\n"
    )
    stage, said = converted(tmp_path, text)
    assert not errors(stage)
    assert "texture" not in said.replace("textures", "")
    colors = [load(tmp_path / file).tables for file in ("a.scene", "a.usda")]
    assert all((t.materials.textures[t.instances.material[0], ir.Slot.DIFFUSE] >= 0) for t in colors)


def test_flakes_are_their_roughness(tmp_path: Path) -> None:
    stage, said = converted(
        tmp_path, "sphere(1, material: openpbr(#c09040, specular_roughness: 0.3, normal_map: flakes(1mm, tilt: 0.4)))\n"
    )
    assert "single flakes are not carried" in said
    opened = Usd.Stage.Open(str(stage))
    shader = UsdShade.Shader(opened.GetPrimAtPath("/World/Materials/material0/mtlx_open_pbr"))
    assert shader.GetInput("specular_roughness").Get() == pytest.approx((0.3**4 + 0.4**4) ** 0.25)


def test_our_own_noise_is_a_picture(tmp_path: Path) -> None:
    _, said = converted(tmp_path, "sphere(1, material: lambert(pattern(|x, y, z| noise(4 * x, y, z))))\n")
    assert "patterns are baked into pictures of" in said


def test_a_stage_has_both_networks(tmp_path: Path) -> None:
    stage = Usd.Stage.Open(str(converted(tmp_path, f"sphere(1, material: {SLABS['brushed']})\n")[0]))
    material = UsdShade.Material(stage.GetPrimAtPath("/World/Materials/material0"))
    assert [material.ComputeSurfaceSource(context)[0].GetIdAttr().Get() for context in ("", "mtlx")] == [
        "UsdPreviewSurface", "ND_open_pbr_surface_surfaceshader",
    ]  # fmt: skip
