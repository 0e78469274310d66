"""Surfaces of glTF without doubleSided: seen from behind they are not there, on every backend."""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from maquette.compiler import ir, load
from maquette.compiler.importers.stage_options import StageOptions
from maquette.compiler.plan import plan as planner
from maquette.render.render_scene import draw as draw_scene

from .conftest import BACKENDS, Draw
from .views import alpha, interior, relative, rgb, show

QUADS = np.array([(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])
BOX = np.concatenate([QUADS[:, [0, 1, 2]], QUADS[:, [0, 2, 3]]])
CORNERS = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float32)
VIEW = "camera([0, 0, 6], look_at: [0, 0, 0], fov: 40deg)\n"


def write(path: Path, shells: Sequence[tuple[float, np.ndarray, dict[str, Any]]], **node: Any) -> None:
    """A glTF file of meshes on the corners of boxes: half size, triangles, material."""
    document: dict[str, Any] = {"asset": {"version": "2.0"}, "scenes": [{"nodes": []}], "nodes": [], "meshes": [], "materials": []}
    document |= {"accessors": [], "bufferViews": [], "buffers": []}
    data = b""
    for k, (half, triangles, material) in enumerate(shells):
        corners = (half * CORNERS[triangles]).reshape(-1, 3).astype("<f4")
        document["bufferViews"].append({"buffer": 0, "byteOffset": len(data), "byteLength": corners.nbytes})
        document["accessors"].append({"bufferView": k, "componentType": 5126, "count": len(corners), "type": "VEC3"})
        document["meshes"].append({"primitives": [{"attributes": {"POSITION": k}, "material": k}]})
        document["materials"].append(material)
        document["nodes"].append({"mesh": k, **node})
        document["scenes"][0]["nodes"].append(k)
        data += corners.tobytes()
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    document["buffers"].append({"byteLength": len(data), "uri": uri})
    path.write_text(json.dumps(document))


def shines(*color: float, **more: Any) -> dict[str, Any]:
    return {"pbrMetallicRoughness": {"baseColorFactor": [*color, 1.0]}, "extensions": {"KHR_materials_unlit": {}}, **more}


@pytest.mark.parametrize("scale", [[1, 1, 1], [-1, 1, 1]])
def test_an_outline_hull_shows_what_is_in_it(draw: Draw, tmp_path: Path, scale: list[int]) -> None:
    hull, cube = (1.3, BOX[:, ::-1], shines(0, 0, 1)), (1.0, BOX, shines(1, 0, 0))
    write(tmp_path / "a.gltf", [hull, cube], scale=scale)
    color = rgb(draw('mesh("a.gltf")\n' + VIEW))
    assert color[24, 24].tolist() == [1, 0, 0]
    assert ((color == [0, 0, 1]).all(axis=2)).sum() > 100  # its far side, around the cube
    write(tmp_path / "a.gltf", [(1.3, BOX[:, ::-1], shines(0, 0, 1, doubleSided=True)), cube], scale=scale)
    assert rgb(draw('mesh("a.gltf")\n' + VIEW))[24, 24].tolist() == [0, 0, 1]


def test_light_passes_the_hull_that_is_not_seen(draw: Draw, tmp_path: Path) -> None:
    red = {"pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0, 1], "metallicFactor": 0}}
    sun = "directional([0.2, 0.1, 1])\n"
    write(tmp_path / "a.gltf", [(1.0, BOX, red)])
    alone = rgb(draw('mesh("a.gltf")\n' + sun + VIEW))
    write(tmp_path / "a.gltf", [(1.3, BOX[:, ::-1], shines(0, 0, 1)), (1.0, BOX, red)])
    assert np.allclose(rgb(draw('mesh("a.gltf")\n' + sun + VIEW))[24, 24], alone[24, 24], rtol=1e-5)
    assert alone[24, 24, 0] > 0.2


@pytest.mark.parametrize("turned", [False, True])
def test_a_square_from_behind(draw: Draw, tmp_path: Path, turned: bool) -> None:
    square = np.array([(1, 5, 7), (1, 7, 3)])
    write(tmp_path / "a.gltf", [(1.0, square[:, ::-1] if turned else square, shines(1, 1, 1))])
    found = alpha(draw('mesh("a.gltf")\n' + VIEW, background="transparent"))
    assert found.max() == (0 if turned else 1)


def test_a_back_casts_a_shadow(draw: Draw, tmp_path: Path) -> None:
    """A square over a floor that the camera sees from below, as its light does not."""
    lid = np.array([(2, 3, 7), (2, 7, 6)])  # y = 1, towards +y
    write(tmp_path / "a.gltf", [(1.0, lid, shines(1, 0, 0))])
    view = "camera([0, 0, 0.5], look_at: [0, -1, -0.5], fov: 60deg)\n"
    scene = f'mesh("a.gltf")\nplane(y: -1)\ndirectional([0, 1, 0])\n{view}'
    with_lid, without = rgb(draw(scene)), rgb(draw(scene.replace('mesh("a.gltf")\n', "")))
    assert without.max() > 0
    assert with_lid[20:, 16:32].max() < 0.5 * without[20:, 16:32].max()


WALL = np.array([(0, 2, 3), (0, 3, 1)])  # x = −1, towards +x
LID = np.array([(2, 3, 7), (2, 7, 6)])  # y = 1, towards +y
FLOOR = "plane(y: -1, material: lambert(#ffffff))\n"
PANE = "sphere(0.3, center: [50, 0, 0], material: lambert(#ffffff, opacity: 0.5))\n"


def floors(draw: Draw, path: Path, shell: tuple[np.ndarray, dict[str, Any]], text: str, **settings: Any) -> list[np.ndarray]:
    """The light (n, 3) of the floor y = −1 where a surface with two sides leaves it to be seen: with two sides, and with one."""
    found, where = [], np.zeros(0, bool)
    for double in (True, False):
        triangles, material = shell
        write(path / "a.gltf", [(1.0, triangles, {**material, "doubleSided": double})])
        image = draw('mesh("a.gltf")\n' + text, aov=("position",), **settings)
        if double:
            floor = np.pad(image.channels["position"][..., 1] < -0.999, 1)
            near = [np.roll(floor, (y, x), (0, 1)) for y in (-1, 0, 1) for x in (-1, 0, 1)]
            where = np.all(near, axis=0)[1:-1, 1:-1]  # away from edges
        found.append(rgb(image)[where])
    return found


@pytest.mark.long
@pytest.mark.parametrize("pane", ["", PANE])
def test_a_back_that_is_not_seen_sends_light_on(trace: Draw, tmp_path: Path, pane: str) -> None:
    """A red wall whose back is to the camera lights the floor in front of it, whatever else is see-through."""
    red = {"pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0, 1], "metallicFactor": 0, "roughnessFactor": 1}}
    view = "camera([-4, 3, 0], look_at: [0, -1, 0], fov: 50deg)\n"
    text = FLOOR + pane + "directional([1, 0.2, 0])\n" + view
    double, single = floors(trace, tmp_path, (WALL, red), text, bounces=3, samples=4, size=(32, 32))
    assert len(single) > 150
    assert single.mean(axis=0) == pytest.approx(double.mean(axis=0), rel=0.02)
    assert single[:, 0].mean() > 1.02 * single[:, 1].mean()


@pytest.mark.long
@pytest.mark.parametrize("pane", ["", PANE])
@pytest.mark.parametrize("triangles", [LID, LID[:, ::-1]])
def test_a_lamp_seen_from_behind_shines_on(trace: Draw, tmp_path: Path, triangles: np.ndarray, pane: str) -> None:
    glows = {"pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, 1]}, "emissiveFactor": [1, 1, 1]}
    view = "camera([0, 6, 6], look_at: [0, -1, 1], fov: 60deg)\n"
    double, single = floors(trace, tmp_path, (triangles, glows), FLOOR + pane + view, bounces=1, samples=4, size=(32, 32))
    assert single.mean() == pytest.approx(double.mean(), rel=0.02)
    assert single.mean() > 0.05


@pytest.mark.parametrize("turned", [False, True])
def test_a_square_from_behind_that_moves(draw: Draw, tmp_path: Path, turned: bool) -> None:
    square = np.array([(1, 5, 7), (1, 7, 3)])
    write(tmp_path / "a.gltf", [(1.0, square[:, ::-1] if turned else square, shines(1, 1, 1))])
    moves = 'transform(translate: [10 * time / 1s, 0, 0]) { mesh("a.gltf") }\n'
    image = draw(moves + VIEW.replace(")\n", ", shutter: 20ms)\n"), background="transparent", samples=4)
    assert alpha(image).max() == (0 if turned else 1)


@pytest.mark.long
def test_a_back_that_is_not_seen_blocks_photons(draw_on: Draw, tmp_path: Path) -> None:
    """A lid between a light and a glass ball, seen from below: no caustic on the floor."""
    ball = "sphere(0.6, center: [0, 0, 0], material: glass(ior: 1.5))\npoint([0, 5, 0], intensity: 100)\n"
    text = FLOOR + ball + "camera([0, 0, 4], look_at: [0, -1, 0], fov: 50deg)\n"
    settings: dict[str, Any] = {"bounces": 4, "samples": 16, "plan": {"transport": "path", "transport.caustics": "photons"}}
    grey = {"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.5, 0.5, 1], "metallicFactor": 0}}
    double, single = floors(partial(draw_on, "ray"), tmp_path, (LID, grey), text, **settings)
    assert single.mean() == pytest.approx(double.mean(), rel=0.02)
    assert rgb(draw_on("ray", text, **settings)).max() > 2 * single.max()


@pytest.mark.long
def test_glass_in_place_of_a_single_sided_material_has_both_its_sides(draw: Draw, tmp_path: Path) -> None:
    pictures = []
    for double in (True, False):
        write(tmp_path / "a.gltf", [(1.0, BOX, {"doubleSided": double})])
        light = "plane(y: -1)\npoint([3, 5, 4], intensity: 100)\n"
        pictures.append(rgb(draw('mesh("a.gltf", material: glass(ior: 1.5))\n' + light + VIEW, bounces=4)))
    assert np.array_equal(*pictures)


@pytest.mark.long
@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("opacity", [1.0, 0.5])
def test_backends_agree_on_an_open_box(draw_on: Draw, tmp_path: Path, turned: bool, opacity: float) -> None:
    """Its faces are seen from the front and from behind, past it, through it, in a mirror, and as a shadow."""
    box = np.array([t for t in BOX.tolist() if set(t) - {2, 3, 6, 7}])  # without its lid
    grey = {"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.6, 0.7, opacity], "metallicFactor": 0, "roughnessFactor": 1}}
    shell = (1.0, box[:, ::-1] if turned else box, {**grey, "alphaMode": "BLEND" if opacity < 1.0 else "OPAQUE"})
    write(tmp_path / "a.gltf", [shell])
    text = 'mesh("a.gltf")\nsphere(0.5, center: [0, -0.5, 0], material: lambert(#d04020))\nplane(y: -1.01, material: lambert(#ffffff))\n'
    text += "box([4, 4, 0.1], center: [0, 1, -3], material: mirror())\n"
    text += "directional([0.4, 1, 0.6])\ncamera([2.5, 2.5, 5], look_at: [0, -0.3, 0], fov: 45deg)\n"
    plans = {"reference": {}, "ray": {}, "raster": {"raster.secondary_rays": "trace"}}
    pictures = [draw_on(backend, text, plan, aov=("id",)) for backend, plan in plans.items()]
    inside = interior(*pictures)
    for other in pictures[1:]:
        different = inside & (relative(rgb(other), rgb(pictures[0])) > 0.02)
        assert np.count_nonzero(different) <= 24, show(different, 24)
    assert inside.sum() > 1000


@pytest.mark.parametrize("backend", BACKENDS)
def test_meshes_of_usd_by_cull_backfaces(tmp_path: Path, backend: str) -> None:
    square = "int[] faceVertexCounts = [4]\nint[] faceVertexIndices = [0, 1, 2, 3]\npoint3f[] points = [{}]"
    front = square.format("(-2, -1, 0), (0, -1, 0), (0, 1, 0), (-2, 1, 0)")
    back = square.format("(0, -1, 0), (0, 1, 0), (2, 1, 0), (2, -1, 0)")
    camera = """def Camera "main_cam" {
        float horizontalAperture = 24
        float verticalAperture = 24
        float focalLength = 24
        double3 xformOp:translate = (0, 0, 5)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }"""
    path = tmp_path / "a.usda"
    path.write_text(f'#usda 1.0\n{camera}\ndef Mesh "front" {{\n{front}\n}}\ndef Mesh "back" {{\n{back}\n}}\n')
    for cull, left in ((False, 1.0), (True, 0.0)):
        scene = load.load(path, stage=StageOptions(cull_backfaces=cull))
        settings = ir.Settings(size=(48, 48), samples=1, threads=1, backend=backend, background="transparent")
        covered = alpha(draw_scene(scene, planner.make_plan(scene, settings)))
        assert (covered[24, 16], covered[24, 32]) == (1.0, left)
