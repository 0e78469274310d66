"""The recipes of docs/architecture.md are applied to a copy of the package, which then does what they promise."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from .recipes.apply_recipe import RECIPES, ROOT, apply, copy_package

BALL = "camera(position: [0, 0, 4], look_at: [0, 0, 0])\n"
RUN = """
import sys
import maquette
from click.testing import CliRunner
from maquette.cli.main import cli
assert maquette.__file__.startswith(sys.argv[1]), maquette.__file__

def run(line, code=0):
    done = CliRunner().invoke(cli, line.split())
    assert done.exit_code == code, line + chr(10) + done.stderr
    return done.stdout + done.stderr

def picture(name):
    from pathlib import Path
    from maquette.render.image import image_reader
    return image_reader.read(Path(name)).channels

def draw_with_all(scene):
    for backend in ("ray", "raster", "reference"):
        run(f"render {scene} -o {backend}.exr --size 8x6 --samples 1 --backend {backend} -q")

def export_to_all(scene):
    from maquette.compiler.exporters import writers
    for writer in writers.WRITERS:
        for ending in writer.endings:
            run(f"convert {scene} out{ending}")
"""
CHECKS = {
    "material": """
export_to_all("a.scene")
assert "clay" in run("check bad.scene", 1)
from maquette.lang.reference_page import reference
page = reference({})["reference/materials.md"]
assert "# clay" in page and "clay(#9a6b52)" in page
run("render a.scene -o a.exr --size 8x6 --samples 1 --backend reference --aov albedo -q")
assert abs(picture("a.exr")["albedo"][3, 4, 0] - 0.5) < 1e-3
r = picture("a.exr")["rgba"][3, 4, 0]
assert 0.05 < r < 0.5, r
""",
    "lobe": """
export_to_all("a.scene")
run("render a.scene -o a.exr --size 8x6 --samples 1 --bounces 0 --backend reference --aov albedo -q")
run("render lambert.scene -o b.exr --size 8x6 --samples 1 --bounces 0 --backend reference -q")
ratio = picture("a.exr")["rgba"][3, 4, 0] / picture("b.exr")["rgba"][3, 4, 0]
assert abs(ratio - 1 / 8) < 1e-3, ratio
assert abs(picture("a.exr")["albedo"][3, 4, 0] - 0.8) < 1e-3
import numpy as np
from maquette.compiler.load import load
from maquette.materials import lommel_seeliger as lobe, traits
assert abs(traits.albedo(load("a.scene").tables).max() - 0.8) < 1e-9
rng = np.random.default_rng(1)
n, out, (u, v) = tuple(np.eye(3)[2][:, None] + np.zeros((3, 200000))), (0.6, 0.0, 0.8), rng.random((2, 200000))
out = tuple(np.full(200000, x) for x in out)
into = lobe.sample(((1.0, 1.0, 1.0),), n, out, u, v)
share = lobe.value(((1.0, 1.0, 1.0),), n, into, out)[0] / (np.pi * lobe.density(None, n, into, out))
expected = 0.5 * (1 - 0.8 * np.log(1.8 / 0.8))
assert abs(share.mean() - expected) < 4 * share.std() / 447, (share.mean(), expected)
""",
    "light": """
assert "no errors" in run("check a.scene")
export_to_all("a.scene")
assert "the beam of a panel is not carried: it shines evenly" in run("convert a.scene a.usda")
assert "an area light is not carried: POV-Ray draws lights without extent" in run("convert a.scene a.pov")
assert "an area light that is not seen is not carried" in run("convert a.scene a.xml")
run("convert a.scene b.scene")
assert "panel([" in open("b.scene").read()
from maquette.lang.reference_page import reference
assert "## panel" in reference({})["reference/lights.md"]
run("render a.scene -o a.exr --size 41x1 --samples 1 --bounces 0 --backend reference -q")
row = picture("a.exr")["rgba"][0, :, 0]
assert abs(row[40] / row[20] - 0.5 ** 3.5) < 0.01, row  # at 45 degrees: cos of the ground, cos / d² of the panel, and cos³
""",
    "light_element": """
draw_with_all("a.scene")
export_to_all("a.scene")
r, g, b = picture("ray.exr")["rgba"][3, 4, :3].tolist()
assert abs(g / r - 0.6) < 1e-3 and abs(b / r - 0.25) < 1e-3, (r, g, b)
""",
    "reader": """
draw_with_all("a.scene")
export_to_all("a.scene")
assert "error: a .tri file holds nine numbers a line" in run("check bad.tri", 1)
assert "a.tri: no errors" in run("check a.tri --unit mm --up z")
assert "known are .obj, .ply, .stl, .glb, .gltf, .off, .3mf, .xyz, .tri" in run("check bad.scene", 1)
from maquette.compiler import format_pages
assert "| TRI | `.tri` | metres | y | triangles |" in format_pages.page("meshes")
""",
    "writer": """
run("convert a.scene a.tri --deviation 10mm")
assert all(len(line.split()) == 9 for line in open("a.tri"))
assert ".tri (triangles as text)" in run("convert a.scene a.fbx", 2)
assert "TRI: closed triangles in metres, y up" in run("convert --help")
assert "a file of triangles has no camera" in run("convert a.scene a.tri --size 8x6", 2)
assert "a texture is not carried: a .tri file has none" in run("convert textured.scene a.tri")
from maquette.compiler.exporters import writers
assert "| `.tri` (TRI) | closed triangles in metres, y up | none | none |" in writers.table()
""",
    "setting": """
assert ["shadows", "off", "asked", "for", "--no-shadows"] in [line.split() for line in run("explain a.scene --no-shadows").splitlines()]
run("render a.scene -o with.exr --size 8x6 --samples 1 -q")
run("render a.scene -o without.exr --size 8x6 --samples 1 -q --no-shadows")
assert (picture("without.exr")["rgba"].sum() > picture("with.exr")["rgba"].sum())
maquette.load("a.scene").render(size=(8, 6), samples=1, shadows=False)
""",
    "channel": """
for backend in ("ray", "raster", "reference"):
    run(f"render a.scene -o {backend}.exr --size 8x6 --samples 1 --aov distance,depth --backend {backend} -q")
    drawn = picture(f"{backend}.exr")
    assert abs(drawn["distance"][3, 4, 0] - 3.0) < 0.05 and drawn["distance"][0, 0, 0] == float("inf"), drawn["distance"]
assert "did you mean `distance`?" in run("render a.scene -o a.exr --aov distanc", 2)
assert "distance" in run("render --help")
from maquette.live.state import State
assert State().changed({"channel": "distance"}).channel == "distance"
from maquette.live import channels
assert channels.auxiliary("distance", drawn["distance"]).shape == (6, 8, 4)
""",
    "command": """
assert run("count a.scene") == "1" + chr(10)
assert "count" in run("--help") and "maquette count room.scene" in run("count --help")
""",
    "backend": """
run("render a.scene -o a.exr --size 8x6 --samples 1 --backend normals -q")
run("render a.scene -o b.exr --size 8x6 --samples 4 --backend normals -q")
assert abs(picture("a.exr")["rgba"][3, 4, 2] - 1.0) < 0.02 and (picture("a.exr")["rgba"] == picture("b.exr")["rgba"]).all()
run("compare a.scene --backends normals:samples=1,ray:samples=1 --size 8x6 -q")
assert "normals" in run("render --help") and "normals" in run("chart a.scene --backends nothing", 2)
from maquette.live.state import State
assert State().changed({"backend": "normals"}).backend == "normals"
""",
    "metric": """
run("render a.scene -o a.exr --size 8x6 --samples 1 -q")
run("render a.scene -o b.exr --size 8x6 --samples 1 -q --background #ffffff")
said = run("compare a.exr b.exr --metric mae --threshold 0", 1)
assert ": mean absolute" in said and "mean absolute is 0." in said, said
assert "mae" in run("chart a.scene --metric nothing", 2)
""",
    "shape": """
assert "no errors" in run("check a.scene")
said = run("check solid.scene", 1)
assert "`annulus` cannot be a part of a solid: an annulus has no inside" in said, said
assert "its measures are not finite, or not above 0" in run("check wrong.scene", 1)
export_to_all("a.scene")
from maquette.lang.reference_page import reference
page = reference({})["reference/shapes.md"]
assert "## annulus" in page and "annulus(1, 0.5)" in page
run("render a.scene -o a.exr --size 32x24 --samples 1 --bounces 1 --backend reference -q")
alpha = picture("a.exr")["rgba"][12, :, 3]
assert alpha[16] == 0.0 and alpha[16 + 6] == 1.0, alpha
""",
    "solid_shape": """
assert "no errors" in run("check a.scene")
""",
}  # fmt: skip
LONG = {
    "material": """
draw_with_all("a.scene")
run("compare a.scene --backends ray:samples=16,reference:samples=16 --size 16x12 --threshold 0.02 -q")
""",
    "lobe": """
draw_with_all("a.scene")
run("compare a.scene --backends ray:samples=1:bounces=0,reference:samples=1:bounces=0 --size 16x12 --threshold 0.001 -q")
run("compare b.scene --backends ray:samples=64,reference:samples=64 --size 8x6 --threshold 0.1 -q")
""",
    "light": """
for backend in ("ray", "raster", "reference"):
    for bounces in (0, 2):
        run(f"render a.scene -o a.exr --size 41x1 --samples 1 --bounces {bounces} --backend {backend} -q")
        row = picture("a.exr")["rgba"][0, :, 0]
        assert abs(row[40] / row[20] - 0.5 ** 3.5) < 0.01, (backend, bounces, row)
""",
    "solid_shape": """
export_to_all("a.scene")
assert "do not have one triangle on each side" not in run("convert a.scene a.stl")
draw_with_all("a.scene")
""",
    "shape": """
draw_with_all("a.scene")
run("compare a.scene --backends ray:samples=1,reference:samples=1 --size 32x24 --threshold 0.001 -q")
run("compare a.scene --backends raster:samples=16,reference:samples=16 --size 32x24 --threshold 5 -q")
""",
    "backend": """
run("chart a.scene --backends normals,ray --size 8x6 --budget 20s -o chart.svg -q")
assert "normals" in open("chart.svg").read()
""",
    "metric": """
run("chart a.scene --backends ray --size 8x6 --budget 20s --metric mae -o chart.svg -q")
assert "mean absolute error, linear light" in open("chart.svg").read()
""",
}
RINGS = f"""\
annulus(1, 0.5, rotate: [90deg, 0, 0], material: lambert(checker(#ff0000, #00ff00, size: 10cm)))
annulus(0.4, 0.2, rotate: [90deg, 0, 0], material: emissive(luminance: 2))
annulus(0.5, 0.2, center: [0, 1, 0], rotate: [90deg, 0, 0], material: lambert(0.5))
sun(from: [0, 1, 1])
{BALL}"""
PANEL = """\
camera([0, 2, 0], look_at: [0, 0, 0], up: [0, 0, 1], width: 2.05)
box([4, 1, 4], center: [0, -0.5, 0], material: lambert(0.5))
panel([0, 1, 0], size: 1mm, luminance: 1000000)
"""
OCTAHEDRA = f"""\
difference {{ octahedron(1); sphere(0.6) }}
octahedron(0.4, center: [2, 0, 0], material: glass())
octahedron(0.3, center: [-1.5, 0, 0], material: emissive(luminance: 2))
union(translate: [0, 1.5, 0]) {{
    octahedron(0.4)
    mesh(points: [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], faces: [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
}}
sun(from: [0, 1, 1])
{BALL}"""
TRI = "-1 -1 0 1 -1 0 0 1 0\n"
SCENES = {
    "lobe": {
        "a.scene": "camera(position: [0, 0, 4], look_at: [0, 0, 0])\nbox(2, material: regolith(0.8))\ndirectional(from: [0, 0, 1])\n",
        "lambert.scene": "camera(position: [0, 0, 4], look_at: [0, 0, 0])\nbox(2, material: lambert(0.8))\ndirectional(from: [0, 0, 1])\n",
        "b.scene": f"{BALL}sphere(1, material: regolith(0.8))\nplane(y: -1, material: regolith(0.9))\n"
        "sky(luminance: 1)\nrender(bounces: 3)\n",
    },
    "material": {"a.scene": f"{BALL}sphere(1, material: clay(0.5))\n", "bad.scene": "sphere(1, material: cley(0.5))\n"},
    "light": {"a.scene": PANEL},
    "light_element": {"a.scene": f"{BALL}sphere(1, material: lambert(0.5))\ncandle([0, 0, 4])\n"},
    "reader": {"a.scene": f'{BALL}mesh("a.tri")\n', "a.tri": TRI, "bad.tri": "1 2\n", "bad.scene": 'mesh("a.foo")\n', "a.foo": "\n"},
    "writer": {"a.scene": "sphere(1)\n", "textured.scene": "sphere(1, material: lambert(checker(#333333, #cccccc)))\n"},
    "setting": {"a.scene": f"{BALL}plane(y: -1)\nsphere(1)\nsun(from: [1, 4, 1])\n"},
    "shape": {
        "a.scene": RINGS, "solid.scene": f"union {{ annulus(1, 0.5); sphere(1) }}\n{BALL}", "wrong.scene": f"annulus(0.5, 1)\n{BALL}",
    },
    "solid_shape": {"a.scene": OCTAHEDRA},
    **{name: {"a.scene": f"{BALL}sphere(1)\n"} for name in ("channel", "command", "backend", "metric")},
}


def test_each_recipe_is_checked() -> None:
    assert {path.stem for path in RECIPES} == set(CHECKS) == set(SCENES)


@pytest.mark.parametrize("recipe", RECIPES, ids=lambda path: path.stem)
def test_the_page_quotes_the_recipe_or_names_its_file(recipe: Path) -> None:
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    assert f"```python\n{recipe.read_text(encoding='utf-8')}```\n" in page or f"`tests/recipes/{recipe.name}`" in page


@pytest.mark.long
@pytest.mark.parametrize("recipe", RECIPES, ids=lambda path: path.stem)
def test_a_recipe_works(recipe: Path, tmp_path: Path) -> None:
    check(recipe, tmp_path, CHECKS[recipe.stem])


@pytest.mark.long
@pytest.mark.parametrize("recipe", [path for path in RECIPES if path.stem in LONG], ids=lambda path: path.stem)
def test_a_recipe_is_drawn_or_charted(recipe: Path, tmp_path: Path) -> None:
    check(recipe, tmp_path, LONG[recipe.stem])


def check(recipe: Path, folder: Path, script: str) -> None:
    """Run a script on a copy of the package to which the recipe is applied, beside the recipe's scenes."""
    package, scenes = folder / "path", folder / "scenes"
    apply(recipe, copy_package(package))
    scenes.mkdir()
    for name, text in SCENES[recipe.stem].items():
        (scenes / name).write_text(text, encoding="utf-8")
    command = [sys.executable, "-P", "-c", RUN + script, str(package)]
    environment = {**os.environ, "PYTHONPATH": str(package), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(command, cwd=scenes, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
