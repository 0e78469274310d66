"""One level of detail below an LODRootAPI: by default index, by override, nested, and in point instancers."""

import numpy as np
import pytest

from .stages import kinds, read

ITEMS = 'def Cube "a" {}\ndef Material "looks" {}\ndef Xform "b" { def Sphere "s" {} }\ndef Cone "c" {}'
ROOT = 'prepend apiSchemas = ["LODRootAPI"]'
OVERRIDE = 'prepend apiSchemas = ["LODOverrideAPI"]'


def root(extra: str = "", items: str = ITEMS) -> str:
    return f'def Xform "lod" ({ROOT}) {{ {extra}\n{items} }}'


@pytest.mark.parametrize(
    ("index", "expected"),
    [
        ("", ["BOX"]),
        ("int lod:default:index = 1", ["SPHERE"]),
        ("int lod:default:index = 2", ["CONE"]),
        ("int lod:default:index = 9", ["CONE"]),
    ],
)
def test_the_default_index_selects_an_item(tmp_path, index, expected):
    """The children that may hold geometry are counted: the material is not one."""
    scene, messages = read(tmp_path, root(index))
    assert (kinds(scene), messages) == (expected, [])


@pytest.mark.parametrize(
    ("mode", "expected"),
    [
        ('token lod:override:mode = "indexedLOD"\nfloat lod:override:index = 1', ["SPHERE"]),
        ('token lod:override:mode = "indexedLOD"\nfloat lod:override:index = 1.6', ["CONE"]),
        ('token lod:override:mode = "indexedLOD"\nfloat lod:override:index = -4', ["BOX"]),
        ('token lod:override:mode = "allLOD"', ["BOX", "SPHERE", "CONE"]),
        ('token lod:override:mode = "noLOD"', ["BOX"]),  # of the cube beside the root
        ('token lod:override:mode = "inherited"', ["BOX"]),
    ],
)
def test_an_override_above_the_root_precedes_its_index(tmp_path, mode, expected):
    beside = 'def Cube "beside" {}' if "noLOD" in mode else ""
    scene, messages = read(tmp_path, f'def Xform "top" ({OVERRIDE}) {{ {mode}\n{root()}\n{beside} }}')
    assert (kinds(scene), messages) == (expected, [])


def test_no_override_ends_that_of_an_ancestor(tmp_path):
    inner = f'def Xform "x" ({OVERRIDE}) {{ token lod:override:mode = "noOverride"\n{root()} }}'
    outer = f'def Xform "top" ({OVERRIDE}) {{ token lod:override:mode = "indexedLOD"\nfloat lod:override:index = 2\n{inner} }}'
    assert kinds(read(tmp_path, outer)[0]) == ["BOX"]


def test_roots_nest(tmp_path):
    inner = root("int lod:default:index = 1").replace('"lod"', '"inner"')
    assert kinds(read(tmp_path, root(items=f'{inner}\ndef Cone "far" {{}}'))[0]) == ["SPHERE"]


def test_instances_of_a_root(tmp_path):
    text = f"""def PointInstancer "pi" {{
        int[] protoIndices = [0, 0, 0]
        point3f[] positions = [(0, 0, 0), (3, 0, 0), (6, 0, 0)]
        rel prototypes = </pi/lod>
        {root("int lod:default:index = 1")} }}"""
    scene, _ = read(tmp_path, text)
    assert kinds(scene) == ["SPHERE"] * 3
    assert np.unique(scene.tables.instances.geometry).size == 1


def test_heuristics_are_named(tmp_path):
    rule = 'def LODDistanceHeuristic "rule" { uniform float[] thresholds = [1, 2]\nuniform token lod:domain = "imaging" }'
    scene, messages = read(tmp_path, root("rel lod:heuristics = </lod/rule>", rule + "\n" + ITEMS))
    message = "x.usda</lod>: warning: `lod:heuristics` of Xform is not drawn: a level of detail is drawn at every distance"
    assert (kinds(scene), messages) == (["BOX"], [message])
