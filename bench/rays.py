"""Closest and any hits of the ray backend's BVHs against Embree (directly and through embreex) and Mitsuba's LLVM mode."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiler import ir
from ..render.accel import ray_queries as traced
from ..render.accel.bvh_build.scene_layout import Bvh
from ..render.jit.packed_struct import Handle
from . import embree, limits, meshes, mitsuba, report
from .harness import OURS, Case, Contender, Disagreement, Effort, Peers, Seconds, measure, need, timed
from .meshes import Mesh, Rays

TEXT = """
A torus knot with bumps, in three sizes, and 10,000 instances of the smallest, scattered. Rays: *primary* from the eye in Morton
order, *diffuse* by the cosine from where those hit, *shadow* from there to a point light (any hit, up to the light). Each contender
gets the same float32 arrays and writes arrays of distance, triangle and weights, or of one truth value a ray. Embree does single rays
(`rtcIntersect1`, its default quality, not robust): *embreex* is one call of its `EmbreeScene.run` for all rays, which also writes normals;
*Embree* is the same library called ray by ray from a compiled loop, without Python. maquette: one call of `ray_queries` for all rays,
which runs the kernels that pictures use.
"""
INSTANCES = 10_000
MAX_DIFFERING = 2e-4  # allowed share of different rays: Embree's default has gaps at edges, and rounding decides at silhouettes
NEAR = 1e-4  # tolerance of equal hits, relative to the distance or the scene's size 1


def closest(rays: Rays, accel: Handle) -> Callable[[], tuple[NDArray[np.float32], NDArray[np.int32], NDArray[np.int32]]]:
    """A callable that returns distance (inf: no hit), triangle and instance (-1: none) of each ray's first hit."""
    n = len(rays.limit)
    (t, u, v), (triangle, instance) = np.zeros((3, n), np.float32), np.zeros((2, n), np.int32)
    hits: Any = traced.Hits(*(t, instance, triangle, u, v))  # pyright: ignore  # narrower than the renderer's own, like Embree's
    start = np.zeros(n, np.float32)

    def run() -> tuple[NDArray[np.float32], NDArray[np.int32], NDArray[np.int32]]:
        traced.trace_closest(accel, rays.origin, rays.direction, start, rays.limit, traced.CAMERA, hits)
        return t, triangle, instance

    return run


def occluded(rays: Rays, accel: Handle) -> Callable[[], NDArray[np.bool_]]:
    """A callable that returns whether each ray is occluded."""
    blocked, start = np.zeros(len(rays.limit), np.bool_), np.zeros(len(rays.limit), np.float32)

    def run() -> NDArray[np.bool_]:
        traced.trace_occluded(accel, rays.origin, rays.direction, start, rays.limit, traced.SHADOW, blocked)
        return blocked

    return run


@dataclass(eq=False)
class Sides:
    """One scene, built once by each installed contender."""

    mesh: Mesh
    transforms: NDArray[np.float64] | None
    peers: Peers
    makers: dict[str, Callable[[Rays, bool], Contender]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        scene = meshes.scene(self.mesh, self.transforms)
        self.accel, self.build = timed(lambda: traced.build(scene.tables, keep=False))

    def case(self, rays: Rays) -> Case:
        any_hit = rays.name == "shadow"
        factories = [lambda: self.ours(rays, any_hit), lambda: self.embree(rays, any_hit), lambda: self.mitsuba(rays, any_hit)]
        if self.transforms is None:
            factories.insert(1, lambda: self.embreex(rays, any_hit))
        return Case(rays.name, self.peers.gather(*factories), agree_any if any_hit else agree_closest, len(rays.limit))

    def ours(self, rays: Rays, any_hit: bool) -> Contender:
        if any_hit:
            return Contender(OURS, occluded(rays, self.accel), build=self.build)
        return Contender(OURS, closest(rays, self.accel), build=self.build)

    def embreex(self, rays: Rays, any_hit: bool) -> Contender:
        def make() -> Callable[[Rays, bool], Contender]:
            limits.require_limit("embreex")
            scene = need("embreex.rtcore_scene", embree.INSTALL).EmbreeScene()
            need("embreex.mesh_construction", embree.INSTALL).TriangleMesh(scene, self.mesh.positions, self.mesh.triangles)
            far_ray = np.zeros((1, 3), np.float32) + 9.0
            build = timed(lambda: scene.run(far_ray, far_ray))[1]

            def contender(rays: Rays, any_hit: bool) -> Contender:
                far = np.minimum(rays.limit, np.float32(1e37))
                note = "EmbreeScene.run"
                if any_hit:
                    run = lambda: scene.run(rays.origin, rays.direction, dists=far.copy(), query="OCCLUDED")  # noqa: E731
                    return Contender("embreex", run, lambda ids: ids >= 0, build, note)
                run = lambda: scene.run(rays.origin, rays.direction, dists=far.copy(), output=True)  # noqa: E731
                return Contender("embreex", run, lambda answer: (answer["tfar"], answer["primID"]), build, note)

            return contender

        return self._once("embreex", make)(rays, any_hit)

    def embree(self, rays: Rays, any_hit: bool) -> Contender:
        def make() -> Callable[[Rays, bool], Contender]:
            scene = embree.Scene(embree.Device(), self.mesh)
            build = timed(scene.commit if self.transforms is None else lambda: scene.place(self.transforms))[1]  # pyright: ignore[reportArgumentType]

            def contender(rays: Rays, any_hit: bool) -> Contender:
                run: Callable[[], Any] = scene.occluded(rays) if any_hit else scene.intersect(rays)
                return Contender("Embree", run, build=build, note="rtcOccluded1" if any_hit else "rtcIntersect1")

            return contender

        return self._once("Embree", make)(rays, any_hit)

    def mitsuba(self, rays: Rays, any_hit: bool) -> Contender:
        def make() -> Callable[[Rays, bool], Contender]:
            mi = mitsuba.load()
            mitsuba_scene, build = timed(lambda: mitsuba.scene(mi, self.mesh, self.transforms))
            return lambda rays, any_hit: mitsuba.contender(mi, mitsuba_scene, rays, build, any_hit)

        return self._once("Mitsuba", make)(rays, any_hit)

    def _once(self, name: str, make: Callable[[], Callable[[Rays, bool], Contender]]) -> Callable[[Rays, bool], Contender]:
        if name not in self.makers:
            self.makers[name] = make()
        return self.makers[name]

    def secondary(self, rays: Rays) -> tuple[Rays, Rays]:
        """Diffuse and shadow rays from slightly above the hits of primary rays."""
        t, triangle, instance = closest(rays, self.accel)()
        hit = np.flatnonzero(triangle >= 0)
        a, b, c = (self.mesh.positions[self.mesh.triangles[triangle[hit], k]].astype(np.float64) for k in range(3))
        normal = np.cross(b - a, c - a)
        if self.transforms is not None:
            normal = np.einsum("nij,nj->ni", self.transforms[instance[hit], :, :3], normal)  # rotations and uniform scales
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
        towards = rays.direction[hit].astype(np.float64)
        normal *= np.where(np.sum(normal * towards, axis=1, keepdims=True) > 0.0, -1.0, 1.0)
        points = rays.origin[hit] + towards * t[hit, None].astype(np.float64) + meshes.OUTSIDE * normal
        return meshes.diffuse(points, normal), meshes.shadow(points)


def agree_closest(answers: Mapping[str, Any]) -> str:
    """Compare hits, and distances where both hit, of each peer with ours."""
    t, triangle = answers[OURS][:2]
    hit = triangle >= 0
    said = [f"{hit.mean():.0%} of {len(hit):,} rays hit"]
    for name, (their_t, their_triangle, *_) in ((k, v) for k, v in answers.items() if k != OURS):
        both = hit & (their_triangle >= 0)
        hits_differ = int(np.count_nonzero(hit != (their_triangle >= 0)))
        apart = np.abs(t[both] - their_t[both]) > NEAR * np.maximum(their_t[both], 1.0)
        triangles_differ = int(np.count_nonzero(triangle[both] != their_triangle[both]))
        text = f"{name}: {hits_differ} hit in one only, {np.count_nonzero(apart)} distances differ, {triangles_differ} another triangle"
        _check_differing(hits_differ + int(np.count_nonzero(apart)), len(hit), text)
        _check_differing(triangles_differ, 10 * len(hit), text)  # at edges and intersections of surfaces
        said.append(text)
    return "; ".join(said)


def agree_any(answers: Mapping[str, Any]) -> str:
    """Compare the occlusion of each peer with ours."""
    blocked = answers[OURS]
    said = [f"{blocked.mean():.0%} of {len(blocked):,} rays are blocked"]
    for name, theirs in ((k, v) for k, v in answers.items() if k != OURS):
        apart = int(np.count_nonzero(blocked != theirs))
        _check_differing(apart, len(blocked), f"{name}: {apart} differ")
        said.append(f"{name}: {apart} differ")
    return "; ".join(said)


def _check_differing(apart: int, rays: int, text: str) -> None:
    if apart > max(2.0, MAX_DIFFERING * rays):
        raise Disagreement(text)


def section(quick: bool, effort: Effort) -> report.Section:
    """Measure all scenes."""
    peers = Peers()
    warm_up()
    result = report.Section("rays", "Rays", TEXT)
    resolution = 64 if quick else 512
    sizes = meshes.sizes(quick)
    count = 100 if quick else INSTANCES
    scenes: list[tuple[str, tuple[int, int], NDArray[np.float64] | None]]
    scenes = [(f"{name} triangles", rings, None) for name, rings in sizes.items()]
    smallest = next(iter(sizes))
    scenes.append((f"{count:,} instances of {smallest} triangles", sizes[smallest], meshes.boulders(count)))
    for title, rings, transforms in scenes:
        sides = Sides(meshes.knot(*rings), transforms, peers)
        rays = meshes.primary(resolution)
        results = [measure(sides.case(each), effort) for each in (rays, *sides.secondary(rays))]
        result.add(title, results, "Mrays/s")
    result.missing = peers.missing
    result.versions = report.version_of("embreex", "mitsuba", "drjit")
    return result


def warm_up() -> Seconds:
    """Compile the kernels of BVHs on a tiny mesh, alone and with instances, before the measurement."""
    scenes = [meshes.scene(meshes.knot(8, 4), places) for places in (None, meshes.boulders(100))]
    return timed(lambda: [traced.build(scene.tables, keep=False) for scene in scenes])[1]


def size_of(built: Bvh, tables: ir.Tables) -> int:
    """Bytes of a BVH beside the scene's tables."""
    shared = {id(tables.geometries.parameters), id(tables.geometries.origin)}
    trees = built.wide.nbytes + built.top.nodes.nbytes + built.top.links.nbytes
    return trees + sum(part.nbytes for part in built if isinstance(part, np.ndarray) and id(part) not in shared)
