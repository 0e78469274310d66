"""BVH builds against Embree on one thread, with the memory of both."""

from __future__ import annotations

import functools

from ..render.accel import ray_queries as traced
from ..render.accel import scene_bvh
from ..render.accel.bvh_build import tree_cache
from ..render.jit.packed_struct import Handle
from . import embree, meshes, report
from .harness import OURS, Case, Contender, Effort, Peers, measure
from .meshes import Mesh, Rays
from .rays import agree_closest, closest, size_of, warm_up

TEXT = """
From vertices and triangles in memory to a tree that rays can walk. Embree: a new scene with a copy of the mesh, and `rtcCommitScene` at
its default quality, on one thread. maquette: `ray_queries.build` of a scene of one mesh, on one thread. Bytes are those a tree holds
besides its mesh.
*from disk* is the same call where the tree was kept from an earlier one: its mesh is hashed, and the tree read from a file.
All trees are then asked for the same rays, and those answers compared.
"""


def section(quick: bool, effort: Effort) -> report.Section:
    """Measure every size of mesh."""
    peers = Peers()
    warm_up()
    rays = meshes.primary(64 if quick else 256)
    result = report.Section("build", "Building trees", TEXT)
    results = []
    for name, size in meshes.sizes(quick).items():
        mesh = meshes.knot(*size)
        kept_too = [functools.partial(read_back, mesh, rays)] if len(mesh.triangles) >= tree_cache.LARGE else []
        contenders = peers.gather(functools.partial(our_build, mesh, rays), *kept_too, functools.partial(embree_build, mesh, rays))
        results.append(measure(Case(f"{name} triangles", contenders, agree_closest, len(mesh.triangles)), effort))
    result.add("One mesh", results, "Mtriangles/s")
    result.missing = peers.missing
    result.versions = report.version_of("embreex")
    return result


def our_build(mesh: Mesh, rays: Rays) -> Contender:
    """Our builder; the answer is the hits of the rays."""
    tables = meshes.scene(mesh).tables
    share = size_of(scene_bvh.build(tables, keep=False), tables) / len(mesh.triangles)
    read = lambda trees: closest(rays, trees)()  # noqa: E731
    return Contender(OURS, lambda: traced.build(tables, threads=1, keep=False), read, note=f"{share:.0f} bytes a triangle")


def read_back(mesh: Mesh, rays: Rays) -> Contender:
    """Our BVH, read from the disk cache."""
    tables = meshes.scene(mesh).tables

    def trees() -> Handle:
        tree_cache.clear()
        return traced.build(tables, threads=1)

    trees()
    return Contender(f"{OURS} from disk", trees, lambda tree: closest(rays, tree)())


def embree_build(mesh: Mesh, rays: Rays) -> Contender:
    """Embree's builder; the answer is the hits of the rays."""
    device = embree.Device()

    def build() -> embree.Scene:
        scene = embree.Scene(device, mesh)
        scene.commit()
        return scene

    scene = build()
    share = (device.bytes - mesh.positions.nbytes - mesh.triangles.nbytes) / len(mesh.triangles)
    del scene
    return Contender("Embree", build, lambda scene: scene.intersect(rays)(), note=f"{share:.0f} bytes a triangle")
