"""Point instancers with many instances: nested ones, their names and materials, and what a million cost."""

import numpy as np
import pytest
from maquette.compiler import load
from pxr import Usd, UsdGeom

from .stages import kinds, read, world

NESTED = """def PointInstancer "o" {
    int[] protoIndices = [0, 0]
    point3f[] positions = [(0, 0, 0), (10, 0, 0)]
    color3f[] primvars:displayColor = [(1, 0, 0), (0, 1, 0)] (interpolation = "vertex")
    rel prototypes = </o/i>
    def PointInstancer "i" {
        int[] protoIndices = [0, 0, 0]
        int64[] invisibleIds = [1]
        point3f[] positions = [(0, 1, 0), (0, 2, 0), (0, 3, 0)]
        rel prototypes = </o/i/s>
        def Sphere "s" {} } }
"""


def test_nested_instancers(tmp_path):
    scene, messages = read(tmp_path, NESTED)
    assert (messages, kinds(scene)) == ([], ["SPHERE"] * 4)
    assert sorted(world(scene, k)[:, 3].tolist() for k in range(4)) == [[0, 1, 0], [0, 3, 0], [10, 1, 0], [10, 3, 0]]
    assert scene.names.instances == ("/o[0]", "/o[0]", "/o[1]", "/o[1]")
    m = scene.tables
    colors = [m.materials.values[m.instances.material[k], 1].tolist() for k in range(4)]
    assert colors == [[1, 0, 0], [1, 0, 0], [0, 1, 0], [0, 1, 0]]


def test_nested_instancers_make_a_valid_scene(tmp_path):
    read(tmp_path, NESTED)
    scene = load.load(tmp_path / "x.usda")
    assert len(scene.names.instances) == 4


def doubling(levels: int) -> str:
    """Two instancers a level, each of which places the two of the next level; the last two place a sphere twice: 2^levels spheres."""
    text = ""
    for k in range(levels):
        last = k == levels - 1
        for name in "ab":
            below = "</L>" if last else f"</I{k + 1}a>, </I{k + 1}b>"
            text += f"""{"class" if k or name == "b" else "def"} PointInstancer "I{k}{name}" {{ rel prototypes = [{below}]
                int[] protoIndices = [0, {0 if last else 1}]
                point3f[] positions = [(0, 0, 0), ({2**k}, 0, 0)] }}\n"""
    return text + 'class Sphere "L" {}'


def test_instancers_that_share_prototypes(tmp_path):
    scene, messages = read(tmp_path, doubling(5))
    assert messages == []
    assert sorted(world(scene, k)[0, 3] for k in range(len(scene.names.instances))) == list(range(2**5))
    assert set(scene.names.instances) == {"/I0a[0]", "/I0a[1]"}


@pytest.mark.long
def test_instancers_that_multiply_end_with_a_warning(tmp_path):
    scene, messages = read(tmp_path, doubling(30))
    assert len(scene.names.instances) == 0
    assert messages[0].partition(": ")[2] == "warning: the stage has more than 4,000,000 instances: the rest is left out"


@pytest.mark.long
def test_a_million_instances(tmp_path):
    n = 1_000_000
    stage = Usd.Stage.CreateNew(str(tmp_path / "many.usdc"))  # pyright: ignore[reportAttributeAccessIssue]
    instancer = UsdGeom.PointInstancer.Define(stage, "/pi")  # pyright: ignore[reportAttributeAccessIssue]
    UsdGeom.Sphere.Define(stage, "/pi/s")  # pyright: ignore[reportAttributeAccessIssue]
    instancer.CreatePrototypesRel().SetTargets(["/pi/s"])
    instancer.CreateProtoIndicesAttr(np.zeros(n, np.int32))
    positions = np.random.default_rng(0).random((n, 3), np.float32)
    instancer.CreatePositionsAttr(positions)
    stage.Save()
    scene = load.load(tmp_path / "many.usdc")
    assert len(scene.tables.geometries.kind) == 1
    assert np.array_equal(scene.tables.transforms.matrix[scene.tables.instances.transform, :, 3], positions.astype(np.float64))
