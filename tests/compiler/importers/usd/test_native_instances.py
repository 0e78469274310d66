"""Native instances: the same scene as without instancing, geometry read once for all, and a limit for instances that multiply."""

import numpy as np
import pytest
from maquette.compiler.importers.usd import draw_modes
from maquette.compiler.importers.usd.instancing import prototypes

from .stages import SQUARE, load, read

MATERIAL = """def Material "{name}" { token outputs:surface.connect = <{path}/S.outputs:surface>
    def Shader "S" { uniform token info:id = "UsdPreviewSurface"
        color3f inputs:diffuseColor = {color}
        token outputs:surface } }"""
MOVED = 'double3 xformOp:translate = (0, 3, 0)\nuniform token[] xformOpOrder = ["xformOp:translate"]\n'


def material(name: str, path: str, color: str) -> str:
    return MATERIAL.replace("{name}", name).replace("{path}", path).replace("{color}", color)


def at(x: float) -> str:
    return f'double3 xformOp:translate = ({x}, 0, 0)\nuniform token[] xformOpOrder = ["xformOp:translate"]\n'


def instance(name: str, x: float, more: str = "", metadata: str = "", of: str = "Prop") -> str:
    return f'def "{name}" (\n{metadata}\ninstanceable = true\nprepend inherits = </{of}>\n) {{ {at(x)} {more} }}\n'


PROP = f"""class Xform "Prop" {{
    {material("M", "/Prop/M", "(1, 0, 0)")}
    def Mesh "bound" (\nprepend apiSchemas = ["MaterialBindingAPI"]\n) {{ {SQUARE}
        rel material:binding = </Prop/M> }}
    def Xform "g" {{ {MOVED} def Mesh "plain" {{ {SQUARE} }} def Sphere "ball" {{}} }}
    EXTRA
}}
class Xform "Pair" {{ {instance("left", -1)} {instance("right", 1)} def Cube "c" {{}} }}
{material("Blue", "/Blue", "(0, 0, 1)")}
"""
BIND = "rel material:binding = </Blue>"
API = 'prepend apiSchemas = ["MaterialBindingAPI"]'
RENDER = 'uniform token purpose = "render"\n'
FLAT = '["xformOp:translate", "xformOp:scale"]\ndouble3 xformOp:scale = (0, 0, 0)'
COLLECTIONS = 'prepend apiSchemas = ["MaterialBindingAPI", "CollectionAPI:some"]'
STRONG = '(\nbindMaterialAs = "strongerThanDescendants"\n)'
COLOR = "color3f[] primvars:displayColor = [(0, 1, 0)]\n"
COLLECTION = """uniform token collection:some:expansionRule = "expandPrims"
    rel collection:some:includes = </W/b/g>
    rel material:binding:collection:some = [</W.collection:some>, </Blue>]"""
POINTS = """def PointInstancer "i" { int[] protoIndices = [0, 0]
    point3f[] positions = [(0, 0, 0), (0, 0, 5)]
    rel prototypes = <PATH/i/p>
    def Cone "p" {} }"""
SKINNED = f"""def SkelRoot "s" {{ def Mesh "m" {{ {SQUARE} }} }}"""

STAGES = {
    "plain": instance("a", 1) + instance("b", 2),
    "nested": instance("a", 1, of="Pair") + instance("b", 9, of="Pair"),
    "color of one": instance("a", 1) + instance("b", 2, COLOR) + instance("c", 3, COLOR.replace("0, 1", "1, 1")),
    "color above": f'def Xform "x" {{ {COLOR} {instance("a", 1)} {instance("b", 2)} }} {instance("a", 3)}',
    "binding of one": instance("a", 1) + instance("b", 2, BIND, API) + instance("c", 3, BIND, API),
    "own material": instance("a", 1, "rel material:binding = </W/a/M>", API) + instance("b", 2, "rel material:binding = </W/b/M>", API),
    "binding above": f'def Xform "x" (\n{API}\n) {{ {BIND} {instance("a", 1)} {instance("b", 2, of="Pair")} }} {instance("a", 3)}',
    "strong binding": instance("a", 1, BIND, API) + instance("b", 2, f"{BIND} {STRONG}", API),
    "invisible": instance("a", 1, 'token visibility = "invisible"\n') + instance("b", 2),
    "purpose": instance("a", 1, RENDER) + instance("b", 2),
    "renderVisibility": f"""def Xform "x" (\nprepend apiSchemas = ["VisibilityAPI"]\n) {{ uniform token renderVisibility = "invisible"
        {instance("a", 1, RENDER)} }} {instance("a", 2, RENDER)}""",
    "draw mode": instance("a", 1, 'uniform token model:drawMode = "bounds"\nuniform bool model:applyDrawMode = 1\n') + instance("b", 2),
    "singular": instance("a", 1) + instance("b", 2).replace('["xformOp:translate"]', FLAT),
}  # fmt: skip
EXTRAS = {
    "light": 'def SphereLight "l" { float inputs:intensity = 3 }',
    "light of a mesh": f'def Mesh "l" (\nprepend apiSchemas = ["MeshLightAPI"]\n) {{ {SQUARE} float inputs:intensity = 3 }}',
    "camera": 'def Camera "main" { double3 xformOp:translate = (0, 0, 9)\nuniform token[] xformOpOrder = ["xformOp:translate"] }',
    "reset": f'def Xform "r" {{ {MOVED.replace("[", "[" + chr(34) + "!resetXformStack!" + chr(34) + ", ")} def Cube "c" {{}} }}',
    "point instancer": POINTS.replace("PATH", "/Prop"),
    "points": 'def Points "p" { point3f[] points = [(0, 0, 0), (1, 0, 0)]\nfloat[] widths = [1, 2] }',
    "skeleton": SKINNED,
    "subsets": f"""def Mesh "m" {{ {SQUARE} def GeomSubset "s" (\n{API}\n) {{ uniform token elementType = "face"
        uniform token familyName = "materialBind"
        int[] indices = [0]
        rel material:binding = </Prop/M> }} }}""",
}


def described(scene) -> list:
    """Each instance: its name, matrix, geometry's kind and material's inputs; then lights and cameras."""
    t = scene.tables
    found: list = []
    for k, name in enumerate(scene.names.instances):
        geometry, material = t.instances.geometry[k], t.instances.material[k]
        matrix = t.transforms.matrix[t.instances.transform[k]]
        found.append((name, matrix.round(12).tolist(), int(t.geometries.kind[geometry]), t.materials.values[material].tolist()))
    found += [t.lights.kind.tolist(), t.lights.color.tolist()]
    return [*found, *t.transforms.matrix[t.cameras.transform].round(12).tolist()]


def both(folder, text: str):
    shared, messages = read(folder, text)
    alone, same = read(folder, text.replace("instanceable = true", "instanceable = false"))
    return shared, alone, messages, same


@pytest.mark.parametrize("which", STAGES)
def test_instances_are_what_the_prims_are_without_instancing(tmp_path, which):
    shared, alone, messages, same = both(tmp_path, f'{PROP.replace("EXTRA", "")} def Xform "W" {{ {STAGES[which]} }}')
    assert described(shared) == described(alone)
    assert messages == same
    assert len(shared.tables.geometries.kind) <= len(alone.tables.geometries.kind)


@pytest.mark.parametrize("which", EXTRAS)
def test_prototypes_may_hold_anything(tmp_path, which):
    prims = instance("a", 1) + instance("b", 2) + instance("c", 9, of="Pair") + instance("d", 20, of="Pair")
    shared, alone, _, _ = both(tmp_path, f'{PROP.replace("EXTRA", EXTRAS[which])} def Xform "W" {{ {prims} }}')
    assert described(shared) == described(alone)


def test_a_collection_binds_parts_of_one_instance(tmp_path):
    prims = COLLECTION + "\n" + instance("a", 1) + instance("b", 2)
    shared, _ = read(tmp_path, f'{PROP.replace("EXTRA", "")} def Xform "W" (\n{COLLECTIONS}\n) {{ {prims} }}')
    t = shared.tables
    blue = {name: t.materials.values[t.instances.material[k], 1].tolist() == [0, 0, 1] for k, name in enumerate(shared.names.instances)}
    assert {name for name, is_blue in blue.items() if is_blue} == {"/W/b/g/plain", "/W/b/g/ball"}


def test_the_pieces_of_alike_instances_are_read_once(tmp_path, monkeypatch):
    visited = []
    resolved_mode = draw_modes.resolved_mode
    monkeypatch.setattr(draw_modes, "resolved_mode", lambda prim, inherited: visited.append(prim) or resolved_mode(prim, inherited))
    text = "".join(instance(f"i{k}", k, of="Pair") for k in range(50))
    scene, messages = read(tmp_path, f'{PROP.replace("EXTRA", "")} def Xform "W" {{ {text} }}')
    assert (len(scene.names.instances), messages) == (50 * 7, [])
    assert len(visited) < 80


def bomb(folder, levels: int, leaf: str = 'def Sphere "s" {\n}\n'):
    """A stage whose instances multiply: 2^levels leaves."""
    text = "#usda 1.0\n"
    for k in range(levels):
        below = "".join(f'def "{name}" (\ninstanceable = true\nreferences = </P{k + 1}>\n) {{\n}}\n' for name in "ab")
        text += f'{"def" if k == 0 else "class"} "P{k}" {{\n{below}}}\n'
    (folder / "x.usda").write_text(text + f'class "P{levels}" {{\n{leaf}}}\n')
    return folder / "x.usda"


def test_instances_that_multiply_are_left_out(tmp_path):
    (tmp_path / "x.usda").write_text(bomb(tmp_path, 60).read_text() + 'def Cube "c" {\n}\n')
    scene, messages = load(tmp_path / "x.usda")
    assert scene.names.instances == ("/c",)
    what = "the stage has more than 4,000,000 prims, with those of instances: 2 instances are left out"
    assert messages == [f"x.usda</P0/a>: warning: {what}"]


@pytest.mark.long
def test_instances_below_the_limit_are_drawn(tmp_path):
    scene, messages = load(bomb(tmp_path, 12))
    assert (len(scene.names.instances), messages) == (4096, [])
    assert scene.names.instances[1] == "/P0" + "/a" * 11 + "/b/s"


@pytest.mark.long
def test_instances_that_nest_deeply(tmp_path):
    text = "#usda 1.0\n"
    for k in range(100):
        text += f'{"class" if k else "def"} "P{k}" {{\ndef "a" (\ninstanceable = true\nreferences = </P{k + 1}>\n) {{\n}}\n}}\n'
    (tmp_path / "x.usda").write_text(text + 'class "P100" {\ndef Cube "c" {\n}\n}\n')
    scene, messages = load(tmp_path / "x.usda")
    assert (scene.names.instances, messages) == (("/P0" + "/a" * 100 + "/c",), [])


def test_the_limit_counts_every_instance(tmp_path, monkeypatch):
    monkeypatch.setattr(prototypes, "MAX_PRIMS", 100)
    text = "".join(instance(f"i{k}", k) for k in range(30))
    scene, messages = read(tmp_path, f'{PROP.replace("EXTRA", "")} def Xform "W" {{ {text} }}')
    assert 9 * 3 <= len(scene.names.instances) < 16 * 3
    assert len(messages) == 1
    assert np.isfinite(scene.tables.transforms.matrix).all()
