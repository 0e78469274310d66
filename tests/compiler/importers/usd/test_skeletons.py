"""Skinned meshes: joints, blend shapes and normals at a time; a skeleton that does not fit."""

import numpy as np
import pytest
from maquette.compiler import ir

from .stages import attribute, corners, load

ARM = """#usda 1.0
(
    startTimeCode = 1
    endTimeCode = 10
)
def SkelRoot "Root" {
    def Skeleton "Skel" (prepend apiSchemas = ["SkelBindingAPI"]) {
        uniform token[] joints = ["A", "A/B"]
        uniform matrix4d[] bindTransforms = [((1,0,0,0),(0,1,0,0),(0,0,1,0),(0,0,0,1)), ((1,0,0,0),(0,1,0,0),(0,0,1,0),(0,2,0,1))]
        uniform matrix4d[] restTransforms = [((1,0,0,0),(0,1,0,0),(0,0,1,0),(0,0,0,1)), ((1,0,0,0),(0,1,0,0),(0,0,1,0),(0,2,0,1))]
        rel skel:animationSource = </Root/Skel/Anim>
        def SkelAnimation "Anim" {
            uniform token[] joints = ["A", "A/B"]
            uniform token[] blendShapes = ["fat"]
            float[] blendShapeWeights.timeSamples = { 1: [0], 10: [1] }
            float3[] translations = [(0,0,0), (0,2,0)]
            quatf[] rotations.timeSamples = { 1: [(1,0,0,0),(1,0,0,0)], 10: [(1,0,0,0),(0.70710678,0,0,0.70710678)] }
            half3[] scales = [(1,1,1),(1,1,1)]
        }
    }
    def Mesh "Arm" (prepend apiSchemas = ["SkelBindingAPI"]) {
        uniform token subdivisionScheme = "none"
        int[] faceVertexCounts = [4, 4]
        int[] faceVertexIndices = [0, 1, 3, 2, 2, 3, 5, 4]
        point3f[] points = [(-0.5, 0, 0), (0.5, 0, 0), (-0.5, 2, 0), (0.5, 2, 0), (-0.5, 4, 0), (0.5, 4, 0)]
        normal3f[] normals = [(0,0,1),(0,0,1),(0,0,1),(0,0,1),(0,0,1),(0,0,1)] (interpolation = "vertex")
        rel skel:skeleton = </Root/Skel>
        int[] primvars:skel:jointIndices = [0, 0, 0, 0, 1, 1] (interpolation = "vertex"
 elementSize = 1)
        float[] primvars:skel:jointWeights = [1, 1, 1, 1, 1, 1] (interpolation = "vertex"
 elementSize = 1)
        uniform token[] skel:blendShapes = ["fat"]
        rel skel:blendShapeTargets = </Root/Arm/fat>
        def BlendShape "fat" {
            uniform vector3f[] offsets = [(-1, 0, 0)]
            uniform int[] pointIndices = [0]
        }
    }
}
"""


def arm(tmp_path, code=None, change=()):
    """The scene of an arm whose upper half turns by 90 degrees about z from time code 1 to 10."""
    text = ARM
    for before, after in change:
        assert before in text
        text = text.replace(before, after)
    (tmp_path / f"arm{code}.usda").write_text(text)
    return load(tmp_path / f"arm{code}.usda", code=code)


def test_joints_and_blend_shapes_move_a_mesh(tmp_path):
    scene, messages = arm(tmp_path, 1)
    assert messages == []
    assert corners(scene).reshape(-1, 3).max(axis=0) == pytest.approx([0.5, 4, 0])
    scene, messages = arm(tmp_path, 10)
    points = corners(scene).reshape(-1, 3)
    assert messages == []
    # The blend shape moves the first point to -1.5; the ends turn about (0, 2, 0): (±0.5, 4, 0) go to (-2, 2 ± 0.5, 0).
    assert points.min(axis=0) == pytest.approx([-2, 0, 0], abs=1e-6)
    assert set(points[points[:, 0] < -1.9][:, 1].round(6).tolist()) == {1.5, 2.5}
    assert (np.abs(points - [-1.5, 0, 0]).max(axis=1) < 1e-6).any()
    half, _ = arm(tmp_path, 5.5)
    far = corners(half).reshape(-1, 3)[:, 0].min()
    assert far == pytest.approx(-2 * 0.5**0.5 - 0.5 * 0.5**0.5, abs=0.01)


def test_normals_turn_with_the_joints(tmp_path):
    scene, _ = arm(tmp_path, 10, [(",".join(["(0,0,1)"] * 6), ",".join(["(1,0,0)"] * 6))])
    points, normals = corners(scene).reshape(-1, 3), attribute(scene, "normals").reshape(-1, 3)
    assert np.allclose(normals[points[:, 0] < -1.9], [0, 1, 0], atol=1e-6)
    assert np.allclose(normals[points[:, 0] > -1.4], [1, 0, 0], atol=1e-6)


def test_the_frame_of_the_skeleton_places_the_mesh(tmp_path):
    moved = ('rel skel:animationSource', 'double3 xformOp:translate = (5, 0, 0)\n uniform token[] xformOpOrder = ["xformOp:translate"]\n'
             ' rel skel:animationSource')  # fmt: skip
    scene, _ = arm(tmp_path, 1, [moved])
    assert corners(scene).reshape(-1, 3).min(axis=0) == pytest.approx([4.5, 0, 0])


def test_joints_that_do_not_fit_are_said(tmp_path):
    scene, messages = arm(tmp_path, 10, [("[0, 0, 0, 0, 1, 1]", "[0, 0, 0, 0, 1, 7]")])
    assert messages[0] == ("arm10.usda</Root/Arm>: warning: the joints of this mesh do not fit its skeleton: it is drawn undeformed")
    assert len(scene.tables.instances.geometry) == 1
    assert scene.tables.geometries.kind[0] == ir.GeometryKind.MESH


def test_a_mesh_that_orders_its_joints_itself(tmp_path):
    indices = ("jointIndices = [0, 0, 0, 0, 1, 1]", "jointIndices = [1, 1, 1, 1, 0, 0]")
    own = ("rel skel:skeleton = </Root/Skel>", 'rel skel:skeleton = </Root/Skel>\n        uniform token[] skel:joints = ["A/B", "A"]')
    scene, messages = arm(tmp_path, 10, [indices, own])
    assert messages == []
    assert corners(scene).reshape(-1, 3).min(axis=0) == pytest.approx([-2, 0, 0], abs=1e-6)


def test_joints_that_the_skeleton_lacks_are_named(tmp_path):
    own = ("rel skel:skeleton = </Root/Skel>", 'rel skel:skeleton = </Root/Skel>\n        uniform token[] skel:joints = ["A", "C"]')
    scene, messages = arm(tmp_path, 10, [own])
    assert messages == ["arm10.usda</Root/Arm>: warning: `skel:joints` of this mesh names joints that its skeleton lacks"]
    assert len(scene.tables.instances.geometry) == 1


def test_a_skeleton_without_joints_moves_by_blend_shapes(tmp_path):
    matrices = "((1,0,0,0),(0,1,0,0),(0,0,1,0),(0,0,0,1)), ((1,0,0,0),(0,1,0,0),(0,0,1,0),(0,2,0,1))"
    joints = (
        'uniform token[] joints = ["A", "A/B"]\n        uniform matrix4d[] bind',
        "uniform token[] joints = []\n        uniform matrix4d[] bind",
    )
    scene, messages = arm(tmp_path, 10, [joints, (matrices, "")])
    assert messages == ["arm10.usda</Root/Arm>: warning: this mesh has joint influences, and its skeleton has no joints: no joint moves it"]
    points = corners(scene).reshape(-1, 3)
    assert points.min(axis=0) == pytest.approx([-1.5, 0, 0], abs=1e-6)
    assert points.max(axis=0) == pytest.approx([0.5, 4, 0], abs=1e-6)
