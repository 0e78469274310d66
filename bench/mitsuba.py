"""Mitsuba 3 as a peer on one thread, in its LLVM mode if available."""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import harness, limits
from .meshes import Mesh, Rays

INSTALL = "pip install mitsuba; llvm mode: Debian's libllvm19, or DRJIT_LIBLLVM_PATH"
LLVM = "llvm_ad_rgb"


def load(variant: str = LLVM) -> ModuleType:
    """The mitsuba module, set to a variant and one thread. Raises Missing."""
    limits.require_limit("Mitsuba")
    mi = harness.need("mitsuba", INSTALL)
    try:
        mi.set_variant(variant)
        dr = harness.need("drjit", INSTALL)
        dr.set_thread_count(1)
        if variant == LLVM:
            dr.eval(mi.Float([1.0, 2.0]) + 1.0)  # the first evaluation loads LLVM
    except (ImportError, RuntimeError) as why:
        raise harness.Missing(f"Mitsuba's {variant} mode does not start ({INSTALL})") from why
    return mi


def scene(mi: ModuleType, mesh: Mesh, transforms: NDArray[np.float64] | None) -> Any:
    """A scene of one mesh or of its instances."""
    shape = mi.Mesh("mesh", len(mesh.positions), len(mesh.triangles))
    values = mi.traverse(shape)
    values["vertex_positions"] = mesh.positions.ravel()
    values["faces"] = mesh.triangles.ravel().astype(np.uint32)
    values.update()
    if transforms is None:
        return mi.load_dict({"type": "scene", "mesh": shape})
    description: dict[str, Any] = {"type": "scene", "group": {"type": "shapegroup", "mesh": shape}}
    for k, matrix in enumerate(transforms):
        to_world = mi.ScalarTransform4f(np.vstack([matrix, [0.0, 0.0, 0.0, 1.0]]))
        description[f"i{k}"] = {"type": "instance", "to_world": to_world, "group": {"type": "ref", "id": "group"}}
    return mi.load_dict(description)


def contender(mi: ModuleType, mitsuba_scene: Any, rays: Rays, build: harness.Seconds, any_hit: bool) -> harness.Contender:
    """All rays in one call, as in Mitsuba's integrators."""
    dr = harness.need("drjit", INSTALL)
    ray = mi.Ray3f(mi.Point3f(rays.origin.T.copy()), mi.Vector3f(rays.direction.T.copy()))
    ray.maxt = mi.Float(np.minimum(rays.limit, np.float32(3e38)))
    dr.eval(ray)
    coherent = rays.name == "primary"

    def occluded() -> Any:
        blocked = mitsuba_scene.ray_test(ray, coherent=coherent)
        dr.eval(blocked)
        dr.sync_thread()
        return blocked

    def closest() -> Any:
        hits = mitsuba_scene.ray_intersect_preliminary(ray, coherent=coherent)
        dr.eval(hits.t, hits.prim_index, hits.prim_uv)
        dr.sync_thread()
        return hits

    def read(hits: Any) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
        t, triangle = np.array(hits.t), np.array(hits.prim_index).astype(np.int32)
        return t, np.where(np.isfinite(t) & (t < 1e37), triangle, -1)

    if any_hit:
        return harness.Contender("Mitsuba llvm", occluded, np.array, build, note="ray_test, all rays in one call")
    return harness.Contender("Mitsuba llvm", closest, read, build, note="ray_intersect_preliminary, all rays in one call")
