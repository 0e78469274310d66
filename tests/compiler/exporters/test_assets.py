"""Scenes as glTF and USD: the files as other readers see them, and the picture of a scene beside that of its file."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

import json
from pathlib import Path

import maquette
import numpy as np
import pytest
import trimesh
from click.testing import CliRunner
from maquette.cli.main import cli
from PIL import Image
from pxr import Usd, UsdGeom, UsdLux, UsdShade

ENDINGS = (".glb", ".usda", ".usdc", ".usdz")
CAMERA = "camera(position: [1.5, 2.2, 6], look_at: [0, 0.7, 0], fov: 40deg)\nrender(size: [96, 64], samples: 16)\n"
LIGHTS = """point([-4, 6, 5], intensity: 150)
spot(position: [4, 5, 3], look_at: [0.5, 0.5, 0.5], intensity: 90, cone: 40deg)
directional(from: [1, 2, 1], illuminance: 1)
"""
SHAPES = """let tex = checker(#e04040, #f0f0e0, size: 40cm)
box([6, 0.2, 6], center: [0, -0.1, 0], material: lambert(tex))
sphere(0.6, center: [-1.6, 0.6, 0], material: principled(#3060c0, roughness: 0.5))
torus(radius: 0.4, tube: 0.2, translate: [0, 0.2, 0.8], material: lambert(#40a0a0))
difference(material: lambert(#40a040)) { box(1, center: [1.4, 0.5, 0]); sphere(0.45, center: [1.4, 1, 0]) }
box([0.4, 0.8, 0.4], center: [0, 0.4, -1.4], material: lambert(stripes(#402010, #c09060, size: 10cm)))
"""
PARTS = """unit mm
union(name: "knob") {
  box([40, 10, 40], center: [0, 5, 0], material: lambert(#c03020))
  cylinder(8, 20, center: [0, 20, 0], material: principled(#203080, roughness: 0.4))
}
camera(position: [80, 70, 100], look_at: [0, 10, 0])
"""


def convert(tmp_path: Path, text: str, ending: str, *options: str) -> tuple[Path, str]:
    """(the file, what the command told)"""
    source, out = tmp_path / "a.scene", tmp_path / f"out{ending}"
    source.write_text(text, encoding="utf-8")
    done = CliRunner().invoke(cli, ["convert", str(source), str(out), *options])
    assert done.exit_code == 0, done.output
    return out, done.output


def document(path: Path) -> dict:
    """The JSON of a .glb file."""
    data = path.read_bytes()
    return json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])


@pytest.mark.long
@pytest.mark.parametrize("ending", ENDINGS)
def test_a_picture_of_the_file_is_that_of_the_scene(tmp_path, ending):
    """Shapes, textures, lights and the camera; the spot's falloff and the edges of cells differ a little."""
    out, _ = convert(tmp_path, SHAPES + LIGHTS + CAMERA, ending)
    settings = {"size": (96, 64), "samples": 16, "seed": 1}
    scene, file = (maquette.render(path, **settings) for path in (tmp_path / "a.scene", out))
    a, b = (np.asarray(image)[..., :3] for image in (scene, file))
    assert np.abs(a - b).mean() < 0.03 * a.mean()
    np.testing.assert_allclose(b.mean(axis=(0, 1)), a.mean(axis=(0, 1)), rtol=0.02)


@pytest.mark.long
def test_another_program_reads_the_solids_of_a_glb(tmp_path):
    """Volumes of trimesh: a box, and a box without the part of a ball (closed forms)."""
    text = 'box([1, 2, 3], name: "block")\ndifference(name: "bowl") { box(2); sphere(0.8, center: [0, 1, 0]) }\n' + CAMERA
    out, told = convert(tmp_path, text, ".glb", "--deviation", "0.5mm")
    read = trimesh.load(out)
    volumes = {name: mesh.volume for name, mesh in read.geometry.items()}
    assert volumes["block"] == pytest.approx(6.0, rel=1e-6)
    assert volumes["bowl"] == pytest.approx(8.0 - 2 / 3 * np.pi * 0.8**3, rel=1e-3)
    assert "distance from the true surface" in told.splitlines()[-1]


@pytest.mark.long
def test_parts_keep_their_materials(tmp_path):
    """A union of two materials: two primitives of glTF, two meshes of USD."""
    out, _ = convert(tmp_path, PARTS, ".glb")
    (mesh,) = document(out)["meshes"]
    colors = [document(out)["materials"][part["material"]]["pbrMetallicRoughness"]["baseColorFactor"] for part in mesh["primitives"]]
    assert [np.argmax(color[:3]) for color in colors] == [0, 2]
    out, _ = convert(tmp_path, PARTS, ".usda")
    stage = Usd.Stage.Open(str(out))
    parts = [prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    assert [str(prim.GetPath()) for prim in parts] == ["/World/knob/part0", "/World/knob/part1"]
    for prim, largest in zip(parts, (0, 2), strict=True):
        material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
        shader, *_ = material.ComputeSurfaceSource()
        assert np.argmax(shader.GetInput("diffuseColor").Get()) == largest
    box = UsdGeom.BBoxCache(Usd.TimeCode.Default(), ["default"]).ComputeWorldBound(stage.GetPrimAtPath("/World/knob")).ComputeAlignedRange()
    np.testing.assert_allclose([box.GetMin(), box.GetMax()], [[-0.02, 0, -0.02], [0.02, 0.03, 0.02]], atol=1e-5)


@pytest.mark.long
def test_edges_of_solids_are_sharp(tmp_path):
    """Each normal of a box with a hole is that of its face: along an axis, or away from the hole's axis."""
    out, _ = convert(tmp_path, "difference { box(2); cylinder(0.5, 4) }\n" + CAMERA, ".usda")
    stage = Usd.Stage.Open(str(out))
    (mesh,) = [UsdGeom.Mesh(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    normals, points = np.array(mesh.GetNormalsAttr().Get()), np.array(mesh.GetPointsAttr().Get())
    flat = np.abs(normals).max(axis=1) > 0.9999
    inside = np.abs(normals[:, 1]) < 1e-3
    assert (flat | (inside & (np.hypot(points[:, 0], points[:, 2]) < 0.51))).all()


def test_equal_objects_are_written_once(tmp_path):
    text = "for (k in 0..9) { sphere(0.4, center: [k, 0, 0], material: lambert(#808080)) }\n" + CAMERA
    out, _ = convert(tmp_path, text, ".glb")
    made = document(out)
    assert len(made["meshes"]) == 1
    assert len([node for node in made["nodes"] if "mesh" in node]) == 10
    out, _ = convert(tmp_path, text, ".usda")
    stage = Usd.Stage.Open(str(out))
    meshes = [prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    assert len(meshes) == 10
    assert sum(spec.hasReferences for spec in (stage.GetRootLayer().GetPrimAtPath(prim.GetPath()) for prim in meshes)) == 9


def test_lights_have_their_units(tmp_path):
    """Candela and lux of KHR_lights_punctual; a ball of USD as a point has four times the intensity, normalized."""
    out, _ = convert(tmp_path, LIGHTS + "sphere(1)\n" + CAMERA, ".glb")
    lights = document(out)["extensions"]["KHR_lights_punctual"]["lights"]
    assert [(light["type"], light["intensity"]) for light in lights] == [("point", 150), ("spot", 90), ("directional", 1)]
    assert lights[1]["spot"]["outerConeAngle"] == pytest.approx(np.radians(40))
    out, _ = convert(tmp_path, LIGHTS + "sphere(1)\n" + CAMERA, ".usda")
    stage = Usd.Stage.Open(str(out))
    point, distant = (UsdLux.LightAPI(stage.GetPrimAtPath(f"/World/{name}")) for name in ("point", "directional"))
    assert (point.GetIntensityAttr().Get(), distant.GetIntensityAttr().Get()) == (600, 1)


def test_everything_lost_is_told(tmp_path):
    text = "sphere(1, material: glass(ior: 1.5))\nsky(color: #ffffff, luminance: 1)\nambient(#ffffff, luminance: 0.1)\n" + CAMERA
    _, told = convert(tmp_path, text, ".glb")
    assert [line for line in told.splitlines() if "warning" in line] == [
        f"{tmp_path}/a.scene:2:1: warning: a sky is not carried: glTF has point, spot and directional lights",
        f"{tmp_path}/a.scene:3:1: warning: ambient light is not carried: glTF has none",
    ]
    _, told = convert(tmp_path, text, ".usda")
    assert [line for line in told.splitlines() if "warning" in line] == [
        f"{tmp_path}/a.scene:3:1: warning: ambient light is not carried: USD has none",
    ]


def test_gltf_has_no_light_links(tmp_path):
    _, told = convert(tmp_path, "sphere(1)\npoint([0, 5, 0], blockers: [])\n" + CAMERA, ".glb")
    lost = "`receivers` and `blockers` are not carried: the light lights every object, and each casts shadows"
    assert [line for line in told.splitlines() if "warning" in line] == [f"{tmp_path}/a.scene:2:1: warning: {lost}"]


def test_light_links_are_collections_of_usd(tmp_path):
    """The links of the scene that is read back are those of the scene."""
    text = """sphere(1, name: "left")
        sphere(1, center: [3, 0, 0], name: "right")
        box(1, center: [0, 3, 0], name: "top")
        point([0, 5, 0], receivers: ["left", "top"], blockers: [], name: "lamp")
        sun(from: [0, 1, 1], blockers: ["!top"], name: "sun")
        sky(name: "sky")
        """
    out, told = convert(tmp_path, text + CAMERA, ".usda")
    assert "warning" not in told
    found = maquette.load(out)
    names, lights = [name.rpartition("/")[2] for name in found.names.instances], found.tables.lights
    visible = found.tables.instances.visible
    sets = {
        name.rpartition("/")[2]: [{names[i] for i in np.flatnonzero(visible & mask)} for mask in (lights.receivers[k], lights.blockers[k])]
        for k, name in enumerate(found.names.lights)
    }
    every = {"left", "right", "top"}
    assert sets == {"lamp": [{"left", "top"}, set()], "sun": [every, {"left", "right"}], "sky": [every, every]}


@pytest.mark.parametrize("ending", ENDINGS)
def test_pictures_lie_as_in_the_scene(tmp_path, ending):
    """An image moved on a box, an opacity by an image, and a surface that shines."""
    image, hole = np.zeros((8, 8, 3), np.uint8), np.full((8, 8), 255, np.uint8)
    image[:3, :, 0], image[3:, :4, 1], image[3:, 4:, 2], hole[5:, 5:] = 220, 180, 200, 0
    Image.fromarray(image).save(tmp_path / "flag.png")
    Image.fromarray(hole).save(tmp_path / "hole.png")
    text = """let flag = image("flag.png", scale: [0.5, 0.5], offset: [0.1, 0.2])
box(1, center: [-0.8, 0.5, 0], material: lambert(flag))
box(1, center: [0.8, 0.5, 0], material: principled(image("flag.png"), roughness: 0.9, opacity: image("hole.png")))
box(0.4, center: [0, 0.2, 1], material: emissive(#ffc080, luminance: 0.4))
"""
    out, _ = convert(tmp_path, text + LIGHTS + CAMERA, ending)
    settings = {"size": (96, 64), "samples": 16, "seed": 1}
    a, b = (np.asarray(maquette.render(path, **settings))[..., :3] for path in (tmp_path / "a.scene", out))
    assert np.abs(a - b).mean() < 0.04 * a.mean()


CLIPPED = """#usda 1.0
def Camera "main_cam" {
    float4[] clippingPlanes = [(1, 0, 0, 0.5), (0, 1, -2, 3)]
}
def Sphere "s" {
}
"""


@pytest.mark.parametrize("ending", [".usda", ".glb"])
def test_clipping_planes_are_written_or_named(tmp_path, ending):
    source, out = tmp_path / "a.usda", tmp_path / f"b{ending}"
    source.write_text(CLIPPED, encoding="utf-8")
    done = CliRunner().invoke(cli, ["convert", str(source), str(out)])
    assert done.exit_code == 0, done.output
    assert ("clipping planes are not carried" in done.output) == (ending == ".glb")
    if ending == ".usda":
        stage = Usd.Stage.Open(str(out))
        camera = next(prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Camera))
        assert [tuple(p) for p in UsdGeom.Camera(camera).GetClippingPlanesAttr().Get()] == [(1, 0, 0, 0.5), (0, 1, -2, 3)]


@pytest.mark.parametrize("ending", [".usda", ".glb"])
def test_sheen_is_written_or_named(tmp_path, ending):
    text = "sphere(1, material: principled(#808080, sheen: rgb(0.5, 0.25, 0), sheen_roughness: 0.75))\n" + CAMERA
    out, told = convert(tmp_path, text, ending)
    assert ("sheen is not carried" in told) == (ending == ".usda")
    if ending == ".glb":
        found = next(m for m in document(out)["materials"] if "KHR_materials_sheen" in m.get("extensions", {}))
        assert found["extensions"]["KHR_materials_sheen"] == {"sheenColorFactor": [0.5, 0.25, 0], "sheenRoughnessFactor": 0.75}
        assert "KHR_materials_sheen" in document(out)["extensionsUsed"]
