"""Pictures drawn by worker processes equal those of one process, bit for bit, while workers join, are killed and stopped."""

from __future__ import annotations

import os
import random
import signal
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import maquette
import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.plan import plan as planner
from maquette.compiler.plan.plan import Plan
from maquette.lang.diagnostics import Diagnostic
from maquette.render import render_scene
from maquette.render.cluster import dask_cluster, dispatcher, draw
from maquette.render.cluster.dask_cluster import Cluster
from maquette.render.cluster.remote_renderer import RemoteRenderer
from maquette.render.cluster.requests import ClusterError
from maquette.render.film import checkpoint, denoise
from maquette.render.film.progress import Progress
from maquette.render.image.image import Image
from maquette.render.types import View

from ...cluster_processes import Processes, until

KILLS = int(os.environ.get("MAQUETTE_KILLS", "12"))
BALLS = """sphere(0.5, center: [0, 0.5, 0], material: phong(#d0402a, shininess: 40))
sphere(0.4, center: [1, 0.4, 0.4], material: mirror())
plane(material: lambert(checker(#e8e8e8, #606060, size: 0.5)))
area(position: [1, 3, 2], look_at: [0, 0, 0], size: [0.6, 0.6], luminance: 30, group: "key")
point([-2, 3, 1], intensity: 10, group: "fill")
camera(position: [0, 1.2, 4], look_at: [0.3, 0.4, 0], fov: 35deg)
"""
GLASS = """box([4, 0.1, 4], center: [0, -0.05, 0], material: lambert(#808080))
sphere(0.6, center: [0, 0.6, 0], material: glass())
area(position: [0, 3, 1], look_at: [0, 0, 0], size: [0.6, 0.6], luminance: 30)
camera(position: [1, 2, 5], look_at: [0, 0.6, 0], fov: 40deg)
"""

LENS = BALLS.replace("fov: 35deg", "fov: 35deg, aperture: 0.7, focus: 4")
CASES: dict[str, tuple[str, dict[str, Any], dict[str, str]]] = {
    "fixed samples": (BALLS, {"samples": 24}, {}),
    "one sample": (BALLS, {"samples": 1}, {}),
    "channels": (BALLS, {"samples": 8, "aov": ("depth", "normal", "albedo", "cryptomatte", "variance", "samples")}, {}),
    "a crop": (BALLS, {"samples": 8, "crop": (10, 5, 50, 40)}, {}),
    "an error": (BALLS, {"error": 0.08}, {}),
    "light groups": (BALLS, {"samples": 70, "aov": ("lights",)}, {}),
    "light groups to an error": (BALLS, {"error": 0.1, "aov": ("lights",)}, {}),
    "paths": (GLASS, {"samples": 12, "bounces": 3}, {"transport": "path"}),
    "photons": (GLASS, {"samples": 600, "size": (64, 48), "bounces": 4}, {"transport": "path", "transport.caustics": "photons"}),
    "photons to an error": (GLASS, {"error": 0.2, "bounces": 4}, {"transport": "path", "transport.caustics": "photons"}),
    "the rasterizer": (BALLS, {"samples": 8, "backend": "raster"}, {}),
    "the rasterizer to an error": (BALLS, {"error": 0.08, "backend": "raster"}, {}),
    "the rasterizer's depth of field": (LENS, {"samples": 8, "backend": "raster"}, {}),
    "the reference": (BALLS, {"samples": 2, "size": (16, 12), "backend": "reference"}, {}),
}


@pytest.fixture(scope="module")
def processes(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Processes]:
    running = Processes(tmp_path_factory.mktemp("dask"))
    try:
        running.start(2)
        yield running
    finally:
        running.close()


@pytest.fixture
def cluster(processes: Processes) -> Iterator[Cluster]:
    """A connection to two workers, started again where a test killed some."""
    processes.start(2 - len(processes.workers))
    with dask_cluster.connect(processes.address) as connection:
        until(lambda: connection.workers == 2, "two workers")
        yield connection


def planned(text: str, overrides: dict[str, str] | None = None, **settings: Any) -> tuple[ir.Scene, Plan]:
    scene = maquette.load_text(text)
    return scene, planner.make_plan(scene, ir.Settings(**{"size": (70, 50), "seed": 3, **settings}), overrides)


def same(a: Image, b: Image) -> None:
    assert list(a.channels) == list(b.channels)
    for name in a.channels:
        np.testing.assert_array_equal(a.channels[name], b.channels[name], name)
    times = {"seconds", "ready", "ready_cpu", "elapsed", "elapsed_cpu", "pace"}
    different = {*times, "threads", "variance", "half_difference"}  # arrays that are compared elsewhere
    assert {k: v for k, v in a.metadata.items() if k not in different} == {k: v for k, v in b.metadata.items() if k not in different}


def there(cluster: Cluster, scene: ir.Scene, plan: Plan, report: Callable[[Progress], None] = lambda _: None, **more: Any) -> Image:
    return draw.draw(cluster, scene, plan, report, more.pop("cancel", threading.Event()), **more)


@pytest.mark.long
@pytest.mark.parametrize("case", CASES)
def test_a_picture_equals_that_of_one_process(cluster: Cluster, case: str) -> None:
    text, settings, overrides = CASES[case]
    scene, plan = planned(text, overrides, **settings)
    shares: list[float] = []
    image = there(cluster, scene, plan, lambda progress: shares.append(progress.share))
    same(render_scene.draw(scene, plan), image)
    assert max(shares) == 1.0 or draw.is_in_bands(plan)
    assert cluster.notes() == []


def test_the_guides_of_the_denoiser_equal_those_of_one_process(cluster: Cluster) -> None:
    scene, plan = planned(BALLS, samples=4)
    local = render_scene.choose_renderer(scene, plan, View(plan["camera"], *plan["size"]))
    remote = RemoteRenderer(cluster, scene, plan, None)
    for mine, theirs in zip(denoise.guides(local, plan), denoise.guides(remote, plan), strict=True):
        np.testing.assert_array_equal(mine, theirs)


@pytest.mark.long
def test_several_pictures_are_drawn_at_a_time(cluster: Cluster) -> None:
    plans = [planned(BALLS, samples=2, seed=seed) for seed in range(6)]
    requests = [draw.begin(cluster, scene, plan, threading.Event()) for scene, plan in plans]
    for request, (scene, plan) in zip(requests, plans, strict=True):
        same(render_scene.draw(scene, plan), draw.finish(request))


@pytest.mark.long
@pytest.mark.parametrize("case", [{"samples": 256}, {"error": 0.03}])
def test_a_checkpoint_goes_on_here_and_there(tmp_path: Path, cluster: Cluster, case: dict[str, Any]) -> None:
    """A picture begun on a cluster goes on in one process, and the other way round."""
    scene, plan = planned(BALLS, size=(288, 216), **case)
    complete = render_scene.draw(scene, plan)
    drawing: dict[bool, Callable[..., Image]] = {
        True: lambda **more: there(cluster, scene, plan, **more), False: lambda **more: render_scene.draw(scene, plan, **more)
    }  # fmt: skip
    for first in (True, False):
        cancel = threading.Event()

        def stop(progress: Progress, cancel: threading.Event = cancel) -> None:
            if progress.samples > 9.0:
                cancel.set()

        path = tmp_path / f"{first}.checkpoint"
        keeper = checkpoint.Keeper(path, lambda: "k", 0.0, 0.0, False)
        partial = drawing[first](report=stop, cancel=cancel, keeper=keeper)
        assert partial.metadata["partial"]
        again = checkpoint.Keeper(path, lambda: "k", 1e9, 1e9, True)
        assert again.saved_state is not None
        same(complete, drawing[not first](keeper=again))


@pytest.mark.long
def test_a_budget_is_held(cluster: Cluster) -> None:
    scene, plan = planned(BALLS, samples=1 << 20, budget=1.5)
    there(cluster, *planned(BALLS, samples=2))  # kernels are ready
    began = time.monotonic()
    image = there(cluster, scene, plan)
    assert time.monotonic() - began < 1.5 + 2.0
    assert 16 <= image.metadata["samples_mean"] < 1 << 20
    assert image.metadata["error"] > 0.0


# --- faults ----------------------------------------------------------------------------------------------------------------

LONG = {"size": (160, 120), "samples": 700, "seed": 3}


@pytest.fixture(scope="module")
def long_picture() -> Image:
    """A picture of some seconds, by one process."""
    return render_scene.draw(*planned(BALLS, **LONG))


def at(share: float, act: Callable[[], Any]) -> Callable[[Progress], None]:
    """A report that acts once, when so much is drawn."""
    actions = [act]

    def report(progress: Progress) -> None:
        if actions and progress.stage == "rendering" and progress.share >= share:
            actions.pop()()

    return report


@pytest.mark.long
def test_a_killed_worker_loses_nothing(processes: Processes, cluster: Cluster, long_picture: Image) -> None:
    victim = next(iter(processes.workers))
    same(long_picture, there(cluster, *planned(BALLS, **LONG), at(0.1, lambda: processes.send(victim, signal.SIGKILL))))
    assert victim not in processes.workers


@pytest.mark.long
def test_a_stopped_worker_loses_nothing(processes: Processes, cluster: Cluster, long_picture: Image) -> None:
    victim = next(iter(processes.workers))
    try:
        same(long_picture, there(cluster, *planned(BALLS, **LONG), at(0.1, lambda: processes.send(victim, signal.SIGSTOP))))
    finally:
        processes.send(victim, signal.SIGCONT)


@pytest.mark.long
def test_a_stopped_worker_that_has_a_whole_picture_is_replaced(
    processes: Processes, cluster: Cluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(dispatcher, "SILENCE", 1.0)
    for name in (names := list(processes.workers)):
        processes.send(name, signal.SIGSTOP)
    try:
        scene, plan = planned(BALLS, samples=2)
        request = draw.begin(cluster, scene, plan, threading.Event())
        processes.send(names[1], signal.SIGCONT)
        same(render_scene.draw(scene, plan), draw.finish(request))
    finally:
        processes.send(names[0], signal.SIGCONT)


@pytest.mark.long
def test_a_worker_that_joins_draws(processes: Processes, cluster: Cluster, long_picture: Image) -> None:
    joined: list[str] = []
    same(long_picture, there(cluster, *planned(BALLS, **LONG), at(0.02, lambda: joined.extend(processes.start(1)))))
    until(lambda: cluster.workers == 3, "third worker")
    same(long_picture, there(cluster, *planned(BALLS, **LONG)))
    processes.send(joined[0], signal.SIGKILL)


@pytest.mark.long
def test_without_a_worker_left_the_render_ends(processes: Processes, cluster: Cluster, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dispatcher, "PATIENCE", 1.0)

    def kill() -> None:
        for name in list(processes.workers):
            processes.send(name, signal.SIGKILL)

    with pytest.raises(ClusterError, match=rf"^no worker of {processes.address} is left: start some with `dask"):
        there(cluster, *planned(BALLS, **LONG), at(0.1, kill))


REFUSED: dict[str, tuple[str, dict[str, str], str, str]] = {
    "another version": (
        "from maquette.lang import distribution; distribution.VERSION = '0.0.1'", {},
        "has maquette 0.0.1, and this client 0.1.0", "install the same version on all",
    ),
    "other kernels": (
        "from maquette.render.jit import cache_key; cache_key.version = lambda: '0'", {},
        "has other kernels of the same version of maquette", "install the same files on all",
    ),
    "other instructions": (
        "", {"MAQUETTE_SIMD": "scalar"}, "renders with scalar instructions, and this client with ",
        "start workers and client with MAQUETTE_SIMD=scalar",
    ),
    "no maquette": (
        "import sys; sys.modules['maquette'] = None", {},
        "cannot draw (ModuleNotFoundError: ", "install maquette 0.1.0 with the extra `cluster` there",
    ),
}  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize("case", REFUSED)
def test_a_worker_that_would_draw_other_bits_is_refused(processes: Processes, cluster: Cluster, case: str) -> None:
    preload, environment, why, hint = REFUSED[case]
    (name,) = processes.start(1, preload, **environment)
    try:
        (note,) = until(cluster.notes, "note")
        assert isinstance(note, Diagnostic)
        assert why in note.message
        assert note.message.endswith(": it draws nothing")
        assert note.hint.startswith(hint)
        assert cluster.workers == 2
        scene, plan = planned(BALLS, samples=4)
        same(render_scene.draw(scene, plan), there(cluster, scene, plan))
    finally:
        processes.send(name, signal.SIGKILL)


@pytest.mark.long
@pytest.mark.parametrize("case", [{"samples": 2000}, {"error": 0.012}, {"samples": 600, "aov": ("lights", "depth")}], ids=str)
def test_random_kills_lose_nothing(processes: Processes, cluster: Cluster, case: dict[str, Any]) -> None:
    """MAQUETTE_KILLS kills and stops at random times, while two workers draw, each followed by a new worker."""
    scene, plan = planned(BALLS, **{**LONG, **case})
    expected, rng = render_scene.draw(scene, plan), random.Random(1)
    done, over, kills = threading.Event(), threading.Event(), [0]

    def kill() -> None:
        while not done.wait(rng.uniform(0.0, 3.0)) and kills[0] < KILLS:
            if cluster.workers < 2:  # the last ones still start
                continue
            victim = rng.choice(list(processes.workers))
            processes.start(1)
            processes.send(victim, rng.choice([signal.SIGKILL, signal.SIGKILL, signal.SIGSTOP]))
            kills[0] += 1
        over.set()

    killer = threading.Thread(target=kill)
    killer.start()
    try:
        while not over.is_set():
            same(expected, there(cluster, scene, plan))
    finally:
        done.set()
        killer.join()
        for name in list(processes.workers):
            processes.send(name, signal.SIGKILL)
    assert kills[0] == KILLS
