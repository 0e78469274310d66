"""Patterns that become pictures: atlases show the right point at every texel, and pictures come back."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import maquette
import numpy as np
import pytest
from click.testing import CliRunner
from maquette.cli.main import cli
from maquette.compiler import ir
from maquette.compiler.exporters.baking.atlas import make_atlas
from maquette.compiler.exporters.baking.charts import make_charts
from maquette.compiler.load import load

VIEW = "camera([0, 1.5, 5], look_at: [0, 0, 0], fov: 35deg)\ndirectional([1, 2, 1.5], illuminance: 3)\nrender(size: [48, 32])\n"
NOISE = "pattern(|x, y, z| lerp(#aa2211, #ddeeff, smoothstep(-0.2, 0.2, noise(3 * x, 3 * y, 3 * z))))"


def sphere(count: int) -> tuple[Any, Any]:
    polar, around = np.meshgrid(np.linspace(0, np.pi, count + 1), np.linspace(0, 2 * np.pi, 2 * count + 1), indexing="ij")
    points = np.stack([np.sin(polar) * np.cos(around), np.cos(polar), np.sin(polar) * np.sin(around)], axis=-1).reshape(-1, 3)
    row, column = np.meshgrid(np.arange(count), np.arange(2 * count), indexing="ij")
    a = (row * (2 * count + 1) + column).ravel()
    b = a + 2 * count + 1
    return points, np.concatenate([np.stack([a, a + 1, b], axis=1), np.stack([a + 1, b + 1, b], axis=1)]).astype(np.int32)


def ramp(turns: int, count: int) -> tuple[Any, Any]:
    """A winding ramp, whose floors lie above each other."""
    angle = np.linspace(0, 2 * np.pi * turns, count)
    points = np.concatenate([np.stack([r * np.cos(angle), 0.05 * angle, r * np.sin(angle)], axis=1) for r in (0.3, 1.0)])
    a = np.arange(count - 1)
    return points, np.concatenate([np.stack([a, a + 1, a + count], axis=1), np.stack([a + 1, a + count + 1, a + count], axis=1)])


def soup(count: int) -> tuple[Any, Any]:
    """Triangles that touch nowhere."""
    rng = np.random.default_rng(2)
    points = (rng.normal(size=(count, 1, 3)) + 0.05 * rng.normal(size=(count, 3, 3))).reshape(-1, 3)
    return points, np.arange(3 * count).reshape(-1, 3)


WITHOUT_AREA = (np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0], [np.nan, 0, 0]]), np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]]))
MESHES = {
    "sphere": sphere(24), "ramp": ramp(3, 200), "soup": soup(500), "one": (np.eye(3), np.array([[0, 1, 2]])), "flat": WITHOUT_AREA,
    "huge": (1e20 * np.eye(3), np.array([[0, 1, 2]])), "tiny": (1e-20 * np.eye(3), np.array([[0, 1, 2]])),
}  # fmt: skip


@pytest.mark.parametrize("name", MESHES)
def test_texels_show_their_points(name: str) -> None:
    """The picture of positions, interpolated as readers do, gives every point of the surface within a quarter of a texel."""
    points, triangles = MESHES[name]
    atlas = make_atlas(points, triangles, 192)
    assert atlas is not None
    assert max(atlas.width, atlas.height) <= 192
    corners = points[triangles]
    shown = np.full((atlas.height * atlas.width, 3), np.nan)
    shown[atlas.texels] = (atlas.weights[:, :, None] * corners[atlas.triangle]).sum(axis=1)
    rng = np.random.default_rng(1)
    chosen = rng.choice(np.flatnonzero(make_charts(points, triangles).chart >= 0), 4000)
    weights = rng.dirichlet([0.4] * 3, len(chosen))[:, :, None]
    expected = (weights * corners[chosen]).sum(axis=1)
    uv = (weights * atlas.coordinates[chosen]).sum(axis=1)
    x, y = uv[:, 0] * atlas.width - 0.5, (1 - uv[:, 1]) * atlas.height - 0.5
    total = np.zeros((len(chosen), 3))
    for i in (0, 1):
        for j in (0, 1):
            column, row = np.floor(x).astype(int) + i, np.floor(y).astype(int) + j
            share = (1 - np.abs(x - column)) * (1 - np.abs(y - row))
            texel = np.clip(row, 0, atlas.height - 1) * atlas.width + np.clip(column, 0, atlas.width - 1)
            total += np.where(share[:, None] > 1e-9, share[:, None] * shown[texel], 0.0)
    assert np.linalg.norm(total - expected, axis=1).max() * atlas.density < 0.25


def test_a_plane_is_finer_in_the_middle(tmp_path: Path) -> None:
    """Texels within a radius of the scene are less than a quarter of those of one density for the whole square of 40 radii."""
    text = f"sphere(1)\nplane(y: -1, material: lambert({NOISE}))\n"
    file, messages = converted(tmp_path, text, ".glb", "--bake", "128")
    tables = load(file).tables
    side = max(np.ptp(tables.geometries.bounds[g], axis=0).max() for g in tables.instances.geometry)
    width = float(messages.split(" texels of ")[1].split(" mm")[0]) / 1000
    assert width < side / 128 / 4


def test_meshes_without_a_picture() -> None:
    assert make_atlas(np.zeros((3, 3)), np.array([[0, 1, 2]]), 64) is None  # no area
    assert make_atlas(*soup(500), 32) is None  # 500 rectangles of nine texels


# --- files --------------------------------------------------------------------------------------------------------------


def converted(folder: Path, text: str, ending: str, *options: str) -> tuple[Path, str]:
    (folder / "a.scene").write_text(text + VIEW, encoding="utf-8")
    result = CliRunner().invoke(cli, ["convert", str(folder / "a.scene"), str(folder / f"a{ending}"), *options])
    assert result.exit_code == 0, result.stderr
    return folder / f"a{ending}", result.stderr


def document(path: Path) -> Any:
    data = path.read_bytes()
    return json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])


def pictures(folder: Path, file: Path, **settings: Any) -> tuple[Any, Any]:
    scenes = [maquette.load(path) for path in (folder / "a.scene", file)]
    first, second = (np.array(scene.render(size=(48, 32), samples=16, denoise=False, **settings))[..., :3] for scene in scenes)
    return first, second


@pytest.mark.long
@pytest.mark.parametrize("ending", [".glb", ".usda"])
@pytest.mark.parametrize(
    "objects",
    [
        f"sphere(1, material: lambert({NOISE}))\n",
        f"box(1.5, rotate: [20deg, 30deg, 0deg], scale: [-1, 0.7, 1], material: lambert({NOISE}))\n",
        f"torus(0.8, 0.4, rotate: [50deg, 0deg, 0deg], material: principled({NOISE}, roughness: pattern(|x, y, z| "
        "clamp(0.5 + noise(4 * x, y, z), 0.2, 1)), metallic: pattern(|x, y, z| if noise(2 * x, y, 5) > 0 then 1 else 0)))\n",
        "box(1.6, rotate: [10deg, 30deg, 0deg], material: lambert(0.7, bump_map: pattern(|x, y, z| noise(5 * x, 5 * y, 5 * z)), "
        "bump_height: 8cm))\n",
    ],
    ids=["sphere", "mirrored", "numbers", "bumps"],
)
def test_pictures_come_back(tmp_path: Path, objects: str, ending: str) -> None:
    file, messages = converted(tmp_path, objects, ending)
    assert "patterns are baked into pictures of" in messages
    assert "pattern is not carried" not in messages
    first, second = pictures(tmp_path, file)
    assert np.abs(first - second).mean() < 0.03 * first.mean()


def test_objects_share_pictures(tmp_path: Path) -> None:
    """One picture for equal objects, one more for one that is stretched."""
    text = f"let m = lambert({NOISE})\n"
    text += "".join(f"sphere(0.3, center: [{x}, 0, 0], material: m)\n" for x in (-1, 0, 1))
    file, _ = converted(tmp_path, text, ".glb", "--bake", "64")
    assert len(document(file)["images"]) == len(document(file)["meshes"]) == 1
    file, _ = converted(tmp_path, text + "sphere(0.3, scale: [1, 2, 1], material: m)\n", ".glb", "--bake", "64")
    assert len(document(file)["images"]) == 2


def test_pictures_beside_patterns_keep_their_coordinates(tmp_path: Path) -> None:
    """The picture of the roughness has the first set of coordinates or the second; the other one is the pattern's."""
    from PIL import Image

    Image.new("L", (4, 4), 90).save(tmp_path / "r.png")
    text = f'box(2, material: principled({NOISE}, roughness: image("r.png", scale: 3)))\n'
    file, _ = converted(tmp_path, text, ".glb", "--bake", "64")
    data = document(file)
    pbr = data["materials"][0]["pbrMetallicRoughness"]
    sets = {pbr[name].get("texCoord", 0) for name in ("baseColorTexture", "metallicRoughnessTexture")}
    assert sets == {0, 1}
    assert {"TEXCOORD_0", "TEXCOORD_1"} <= set(data["meshes"][0]["primitives"][0]["attributes"])


@pytest.mark.parametrize(
    ("formula", "expected"),
    [
        ("sqrt(noise(x, y, z) - 2)", (0.0, 0.0)),  # nowhere defined: 0 as in pictures
        ("1e200 * (1 + 0 * noise(x, y, z))", (0.9, 1.0)),  # cut at 1
        ("noise(3 * x, 3 * y, 3 * z) - 5", (0.0, 0.0)),  # below 0
        ("1 / (noise(x, y, z) - noise(x, y, z))", (0.0, 0.0)),
    ],
)
def test_values_that_no_picture_holds(tmp_path: Path, formula: str, expected: tuple[float, float]) -> None:
    file, _ = converted(
        tmp_path, f"sphere(1, material: principled(0.5, roughness: pattern(|x, y, z| {formula})))\n", ".glb", "--bake", "64"
    )
    roughness = document(file)["materials"][0]["pbrMetallicRoughness"]["roughnessFactor"]
    assert expected[0] <= roughness <= expected[1]


def test_emission_above_one(tmp_path: Path) -> None:
    text = "sphere(1, material: emissive(pattern(|x, y, z| 40 * (1.2 + noise(3 * x, 3 * y, 3 * z)) * rgb(1, 0.5, 0.2))))\n"
    file, _ = converted(tmp_path, text, ".glb", "--bake", "128")
    tables = load(file).tables
    row = int(tables.instances.material[0])
    factor = tables.materials.values[row, ir.Slot.EMISSION, 0]
    image = int(tables.textures.image[tables.materials.textures[row, ir.Slot.EMISSION]])
    first = int(tables.images.first[image])
    texels = tables.images.texels[first : first + int(tables.images.width[image] * tables.images.height[image])]
    assert 40 < (factor * texels[:, 0]).max() < 90
    np.testing.assert_allclose(texels[:, 1].mean(), 0.5 * texels[:, 0].mean(), rtol=0.02)


def test_baking_is_left_out(tmp_path: Path) -> None:
    file, messages = converted(tmp_path, f"sphere(1, material: lambert({NOISE}))\n", ".glb", "--bake", "0")
    assert "a pattern is not carried: it is white" in messages
    assert "images" not in document(file)


def test_meshes_of_too_many_parts_are_reported(tmp_path: Path) -> None:
    points, triangles = soup(500)
    lines = [f"v {' '.join(map(str, point))}" for point in points] + [f"f {' '.join(str(k + 1) for k in face)}" for face in triangles]
    (tmp_path / "soup.obj").write_text("\n".join(lines), encoding="utf-8")
    _, messages = converted(tmp_path, f'mesh("soup.obj", material: lambert({NOISE}))\n', ".glb", "--bake", "16")
    assert "more separate parts than its picture has texels" in messages
    assert "--bake" in messages


def test_formats_without_pictures_refuse_the_option(tmp_path: Path) -> None:
    (tmp_path / "a.scene").write_text("sphere(1)\n" + VIEW, encoding="utf-8")
    result = CliRunner().invoke(cli, ["convert", str(tmp_path / "a.scene"), str(tmp_path / "a.stl"), "--bake", "64"])
    assert result.exit_code != 0
    assert "--bake applies to patterns that become pictures: OUT ends in .glb" in result.stderr


@pytest.mark.long
def test_blends_are_mixed(tmp_path: Path) -> None:
    """A blend is one surface whose inputs are mixed; its edge lies where the formula has it, not at triangles."""
    text = 'sphere(1, material: blend(metal("gold", roughness: 0.4), principled(#204080, roughness: 0.7), pattern(|x, y, z| '
    text += "smoothstep(-0.02, 0.02, noise(3 * x, 3 * y, 3 * z)))))\n"
    file, messages = converted(tmp_path, text, ".glb")
    assert "each triangle has the one that counts more" not in messages
    assert "a blend is carried as one surface" in messages
    first, second = pictures(tmp_path, file)
    assert np.abs(first - second).mean() < 0.05 * first.mean()


def test_parts_of_solids_keep_their_edges(tmp_path: Path) -> None:
    text = "union() {\n  box(1, material: lambert(#f00))\n  sphere(0.6, center: [0.5, 0, 0], material: lambert(#0f0))\n}\n"
    file, messages = converted(tmp_path, text, ".glb")
    assert "a blend is carried as one surface" not in messages
    assert len(document(file)["materials"]) == 2


def test_blends_with_glass_are_divided_by_triangles(tmp_path: Path) -> None:
    file, messages = converted(
        tmp_path, "sphere(1, material: blend(glass(), lambert(#0f0), pattern(|x, y, z| if x > 0 then 1 else 0)))\n", ".glb"
    )
    assert "each triangle has the one that counts more" in messages
    assert len(document(file)["materials"]) == 2
