"""Two threads against one: frames, ray-traced pictures and BVH builds, beside pure arithmetic on the same machine."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import load
from ..compiler import ir
from ..compiler.plan import plan
from ..render import simd
from ..render.accel import ray_queries as traced
from ..render.backends import prepare, ray
from ..render.film import film
from ..render.jit import thread_pool
from ..render.jit.kernel import kernel
from ..render.simd import target
from ..render.types import View
from . import meshes, raster, report
from .harness import OURS, Case, Contender, Disagreement, Effort, Missing, Peers, measure
from .rays import closest

TEXT = """
The same work by two threads (maquette) and by one, in turns, by wall time: *× ours* is how many times as fast two are. *arithmetic* is
multiplications in registers, in eight pieces: what the machine itself gives at that time (two processors of a virtual machine may be one
core, and both are slower while both are busy). Frames and meshes are those of *raster* at one sample; pictures by rays are drawn from a
prepared scene; trees are built of a mesh in memory. What one and two threads make is the same, bit for bit.
"""
ONE = "one thread"
PIECES = 8
Make = Callable[[int], tuple[Callable[[], Any], Callable[[Any], Any]]]
"""What to run on so many threads, and how to read its answer."""
Cases = Mapping[str, Make]
HERE = Path(__file__).resolve().parent


def section(quick: bool, effort: Effort) -> report.Section:
    """Measure all work that threads share."""
    peers = Peers()
    effort = effort if quick else replace(effort, rounds=31, fewest=7, seconds=5.0)  # seven rounds of milliseconds are too noisy
    result = report.Section("threads", "Two threads", TEXT)
    for title, cases in (("Arithmetic", arithmetic(quick)), ("Frames", frames(quick)), ("Rays", pictures(quick)), ("Trees", bvhs(quick))):
        results = []
        for name, make in cases.items():
            contenders = peers.gather(*(functools.partial(_contender, make, *who) for who in ((2, OURS), (1, ONE))))
            results.append(measure(Case(name, contenders, same), effort))
        result.add(title, results, "", by="wall")
    result.missing = peers.missing
    return result


def _contender(make: Make, threads: int, name: str) -> Contender:
    if target.cores() < 2:
        raise Missing("there is one core alone")
    return Contender(name, *make(threads))


def same(answers: Mapping[str, Any]) -> str:
    """Check that all results are equal bit for bit."""
    mine = answers[OURS]
    for theirs in answers.values():
        if not np.array_equal(mine, theirs):
            raise Disagreement("one and two threads made different things")
    return "the same, bit for bit"


@kernel
def multiply(times, out):
    """Compute sixteen running products four times."""
    a, b, c, d = simd.f32x16(1.0), simd.f32x16(2.0), simd.f32x16(3.0), simd.f32x16(4.0)
    for _ in range(times):
        a, b, c, d = a * 0.999 + 0.001, b * 0.999 + 0.001, c * 0.999 + 0.001, d * 0.999 + 0.001
    simd.store(out, 0, a + b + c + d)


def arithmetic(quick: bool) -> Cases:
    """Arithmetic as long as a frame and as a picture."""

    def make(times: int, threads: int) -> tuple[Callable[[], Any], Callable[[Any], Any]]:
        def run() -> NDArray[np.float32]:
            out = np.zeros((PIECES, 16), np.float32)
            thread_pool.parallel_for(lambda k: multiply(times // PIECES, out[k]), range(PIECES), threads)
            return out

        return run, _identity

    most = 1 << (10 if quick else 20)
    return {"short": functools.partial(make, most), "long": functools.partial(make, 16 * most)}


def frames(quick: bool) -> Cases:
    """The frames of the raster benchmark with one sample."""

    def make(mesh: meshes.Mesh, textured: bool, threads: int) -> tuple[Callable[[], Any], Callable[[Any], Any]]:
        return raster.our_frame(mesh, raster.side(quick), 1, textured, threads).run, _identity

    return {name: functools.partial(make, *case) for name, case in raster.cases(quick).items()}


def pictures(quick: bool) -> Cases:
    """A path-traced box, and the largest mesh."""
    side = 32 if quick else 256

    def make(scene: ir.Scene, settings: ir.Settings, threads: int) -> tuple[Callable[[], Any], Callable[[Any], Any]]:
        decided = plan.make_plan(scene, replace(settings, size=(side, side), backend="ray", threads=threads))
        view = View(decided["camera"], side, side)
        prepared = prepare.prepare(scene, decided, view)
        return lambda: film.run(ray.Renderer(prepared, decided, view), decided, view).channels["rgba"], _identity

    box = load(HERE / "scenes" / "cornell.scene")
    mesh = meshes.knot(*list(meshes.sizes(quick).values())[-1])
    return {
        "Cornell box, 64 paths a pixel": functools.partial(make, box, ir.Settings(samples=2 if quick else 64, bounces=6)),
        "1M triangles, 16 samples a pixel": functools.partial(make, raster.scene_of(mesh, False), ir.Settings(samples=2 if quick else 16)),
    }


def bvhs(quick: bool) -> Cases:
    """BVH builds of the meshes, compared by the hits of rays."""
    rays = meshes.primary(64 if quick else 256)

    def make(size: tuple[int, int], threads: int) -> tuple[Callable[[], Any], Callable[[Any], Any]]:
        tables = meshes.scene(meshes.knot(*size)).tables
        return lambda: traced.build(tables, threads=threads, keep=False), lambda tree: np.stack(closest(rays, tree)())

    return {f"{name} triangles": functools.partial(make, size) for name, size in meshes.sizes(quick).items()}


def _identity(answer: Any) -> Any:
    return answer
