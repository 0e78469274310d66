"""Building the tree: ours against Embree's, on one thread, with the bytes both take."""

from __future__ import annotations

import functools

from ..render import bvh
from ..render import rays as traced
from . import embree, meshes, report
from .harness import OURS, Case, Contender, Effort, Peers, measure
from .meshes import Mesh, Rays
from .rays import agree_closest, closest, size_of, warm_up

TEXT = """
From vertices and triangles in memory to a tree that rays can walk. Embree: a new scene with a copy of the mesh, and `rtcCommitScene` at
its default quality, on one thread. maquette: `render.rays.trees` of a scene of one mesh. Bytes are those a tree holds besides its mesh.
Both trees are then asked for the same rays, and those answers compared.
"""


def section(quick: bool, effort: Effort) -> report.Section:
    """Measure every size of mesh."""
    peers = Peers()
    warm_up()
    rays = meshes.primary(64 if quick else 256)
    found = report.Section("build", "Building trees", TEXT)
    results = []
    for name, size in (meshes.TINY if quick else meshes.SIZES).items():
        mesh = meshes.knot(*size)
        contenders = peers.gather(functools.partial(ours, mesh, rays), functools.partial(theirs, mesh, rays))
        results.append(measure(Case(f"{name} triangles", contenders, agree_closest, len(mesh.triangles)), effort))
    found.add("One mesh", results, "Mtriangles/s")
    found.missing = peers.missing
    found.versions = report.version_of("embreex")
    return found


def ours(mesh: Mesh, rays: Rays) -> Contender:
    """Our builder; the answer is what the rays hit."""
    tables = meshes.scene(mesh).tables
    share = size_of(bvh.build(tables), tables) / len(mesh.triangles)
    read = functools.partial(closest, rays)
    return Contender(OURS, lambda: traced.trees(tables), read, note=f"{share:.0f} bytes a triangle")


def theirs(mesh: Mesh, rays: Rays) -> Contender:
    """Embree's builder; the answer is what the rays hit."""
    device = embree.Device()

    def build() -> embree.Scene:
        scene = embree.Scene(device, mesh)
        scene.commit()
        return scene

    scene = build()
    share = (device.bytes - mesh.positions.nbytes - mesh.triangles.nbytes) / len(mesh.triangles)
    del scene
    return Contender("Embree", build, lambda scene: scene.intersect(rays)(), note=f"{share:.0f} bytes a triangle")
