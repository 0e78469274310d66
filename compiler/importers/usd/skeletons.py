"""Deforms the meshes below a SkelRoot by its skeletons and blend shapes at one time, through usd-core's UsdSkel queries."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from pxr import Tf, Usd, UsdGeom, UsdSkel, Vt

from ...mesh.polygon_mesh import PolyMesh
from ...mesh.skinning import blended_normals, deformed_normals
from .layers.reports import reason
from .stage import Warnings

_PREDICATE = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)


@dataclass(frozen=True, slots=True, eq=False)
class Skin:
    """A deformed prim: its points in the frame of its skeleton, and that frame in the frame of the SkelRoot."""

    points: np.ndarray  # (n, 3)
    joints: np.ndarray  # (j, 4, 4) from the bound mesh to the skeleton's frame
    indices: np.ndarray  # (n, k) joints of each point
    weights: np.ndarray  # (n, k)
    normal_offsets: np.ndarray | None  # (n, 3) of blend shapes
    frame: np.ndarray  # (4, 4)

    def deform(self, mesh: PolyMesh) -> PolyMesh:
        """The mesh with its normals moved along; its points are those of the skin already."""
        moved = blended_normals(mesh, self.normal_offsets)
        return deformed_normals(moved, self.joints, self.indices, self.weights)


def skins(prim: Any, time: Any, warnings: Warnings) -> dict[str, Skin]:
    """The deformed prims below a SkelRoot, by path."""
    root, cache = UsdSkel.Root(prim), UsdSkel.Cache()
    cache.Populate(root, _PREDICATE)
    by_path: dict[str, Skin] = {}
    world = UsdGeom.XformCache(time)
    to_root = np.linalg.inv(np.array(world.GetLocalToWorldTransform(prim)).T)
    for binding in cache.ComputeSkelBindings(root, _PREDICATE):
        skeleton, prim = cache.GetSkelQuery(binding.GetSkeleton()), binding.GetSkeleton().GetPrim()
        matrices = _matrices(skeleton, prim, time, warnings)
        frame = to_root @ np.array(world.GetLocalToWorldTransform(prim)).T
        for query in binding.GetSkinningTargets():
            try:
                skin = _skin(query, skeleton, matrices, time, frame, warnings)
            except (Tf.ErrorException, TypeError, ValueError) as failure:
                message = f"this mesh is drawn undeformed, as its skeleton cannot move it: {reason(failure, warnings.opened.path)}"
                warnings.tell(message, query.GetPrim())
                continue
            if skin is not None:
                by_path[str(query.GetPrim().GetPath())] = skin
    return by_path


def _matrices(skeleton: Any, prim: Any, time: Any, warnings: Warnings) -> Any:
    """The skinning matrices of the joints of a skeleton; empty, with a warning unless it has no joint, where none can be computed."""
    skinning_transforms = skeleton.ComputeSkinningTransforms(time) if skeleton else None
    if skinning_transforms:
        return skinning_transforms
    if len(UsdSkel.Skeleton(prim).GetJointsAttr().Get() or ()):
        warnings.tell("the skeleton has no valid bind or rest pose: its meshes are drawn undeformed", prim)
    return Vt.Matrix4dArray()


def _skin(query: Any, skeleton: Any, matrices: Any, time: Any, frame: np.ndarray, warnings: Warnings) -> Skin | None:
    prim = query.GetPrim()
    authored = UsdGeom.PointBased(prim).GetPointsAttr().Get(time) if prim.IsA(UsdGeom.PointBased) else None
    if authored is None:
        if prim.IsA(UsdGeom.Gprim):
            warnings.tell(f"the skeleton does not move this {prim.GetTypeName()}: only meshes and points are skinned", prim)
        return None
    points = Vt.Vec3fArray(authored)
    bind = np.array(query.GetGeomBindTransform(time)).T
    offsets = _blend(query, skeleton, time, points, warnings) if skeleton and query.HasBlendShapes() else None
    n = len(points)
    if not skeleton:
        return None
    if not query.HasJointInfluences() or not len(matrices):
        if query.HasJointInfluences() and not len(UsdSkel.Skeleton(skeleton.GetPrim()).GetJointsAttr().Get() or ()):
            warnings.tell("this mesh has joint influences, and its skeleton has no joints: no joint moves it", prim)
        plain = UsdGeom.XformCache(time).GetLocalToWorldTransform(prim)
        to_skeleton = np.linalg.inv(np.array(UsdGeom.XformCache(time).GetLocalToWorldTransform(skeleton.GetPrim())).T) @ np.array(plain).T
        moved = np.array(points, np.float64) @ to_skeleton[:3, :3].T + to_skeleton[:3, 3]
        return Skin(moved, to_skeleton[None], np.zeros((n, 1), np.int64), np.ones((n, 1)), offsets, frame)
    mapper = query.GetJointMapper()
    ordered = matrices
    if mapper is not None and not mapper.IsIdentity():
        ordered = mapper.RemapTransforms(matrices, Vt.Matrix4dArray()) or matrices
        if mapper.IsSparse():
            warnings.tell("`skel:joints` of this mesh names joints that its skeleton lacks", prim)
    indices, weights = (np.array(values) for values in query.ComputeVaryingJointInfluences(n, time))
    inside = not len(indices) or 0 <= indices.min() <= indices.max() < len(ordered)
    if len(indices) != n * query.GetNumInfluencesPerComponent() or not inside:
        warnings.tell("the joints of this mesh do not fit its skeleton: it is drawn undeformed", prim)
        return None
    if not query.ComputeSkinnedPoints(matrices, points, time):
        warnings.tell("the joint influences of this mesh do not fit its points: it is drawn undeformed", prim)
        return None
    joints = np.array(ordered, np.float64).reshape(-1, 4, 4).transpose(0, 2, 1) @ bind
    return Skin(np.array(points, np.float64), joints, indices.reshape(n, -1), weights.reshape(n, -1), offsets, frame)


def _blend(query: Any, skeleton: Any, time: Any, points: Any, warnings: Warnings) -> np.ndarray | None:
    """Moves `points` by the blend shapes at their weights; returns the offsets (n, 3) of the normals, if there are some."""
    animation, mapper = skeleton.GetAnimQuery(), query.GetBlendShapeMapper()
    if not animation or mapper is None:
        return None
    weights = mapper.Remap(animation.ComputeBlendShapeWeights(time))
    shapes = UsdSkel.BlendShapeQuery(UsdSkel.BindingAPI(query.GetPrim()))
    sub_shapes = shapes.ComputeSubShapeWeights(weights)
    if not sub_shapes:
        return None
    of_shapes, rows, parts = sub_shapes
    indices = shapes.ComputeBlendShapePointIndices()
    if not shapes.ComputeDeformedPoints(of_shapes, rows, parts, indices, shapes.ComputeSubShapePointOffsets(), points):
        warnings.tell("the blend shapes of this mesh do not fit its points: they are left out", query.GetPrim())
        return None
    offsets = np.zeros((len(points), 3))
    for weight, row in zip(of_shapes, rows, strict=True):
        normal_offsets = np.array(shapes.GetBlendShape(row).GetNormalOffsetsAttr().Get() or (), np.float64).reshape(-1, 3)
        moved = np.array(indices[row], np.int64) if len(indices[row]) else np.arange(len(points))
        if len(normal_offsets) and len(normal_offsets) == len(moved):
            np.add.at(offsets, moved, weight * normal_offsets)
    return offsets if offsets.any() else None
