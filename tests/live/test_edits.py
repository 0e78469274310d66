"""What an edit redoes, how soon the next one cancels it, and what many edits keep in memory."""

from __future__ import annotations

import gc
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from maquette.bench import meshes
from maquette.compiler import load
from maquette.live.scene_files import Opened
from maquette.live.studio import Studio
from maquette.render.accel.bvh_build import wide_bvh

from . import windows

SCENE = """\
param size = 1 in 0.1..2
mesh("knot.ply", material: lambert(#ff0000), translate: [0, 0, 0])
sphere(size, center: [3, 0, 0])
point([2, 4, 3], intensity: 20)
camera(position: [0, 0, 5], look_at: [0, 0, 0], fov: 35deg)
render(size: [32, 24], samples: 2, backend: "ray")
"""
NOTHING = {
    "meshes read": 0, "meshes triangulated": 0, "images read": 0, "mesh BVHs built": 0, "mesh BVHs refitted": 0, "mesh BVHs read": 0,
    "kernels compiled": 0,
}  # fmt: skip


class Shown:
    """A studio without pages."""

    def __init__(self, scene: Path) -> None:
        self.edits: list[dict[str, Any]] = []
        self.pictures: list[dict[str, Any]] = []
        self.messages: list[dict[str, Any]] = []
        self.scene = scene
        opened = Opened(scene, partial(load.load, scene))
        self.studio = Studio(opened, self.messages.append, lambda about, _: self.pictures.append(about), edited=self.edits.append)

    def write(self, text: str) -> None:
        """Save the scene; return when its edit has ended."""
        before = len(self.edits)
        self.save(text)
        windows.until(lambda: len(self.edits) > before, 120)

    def save(self, text: str) -> None:
        self.scene.write_text(text, encoding="utf-8")
        self.studio.files_changed()


@contextmanager
def shown(folder: Path, text: str = SCENE) -> Iterator[Shown]:
    """The studio of a scene with a mesh, after its first picture."""
    meshes.write_ply(folder / "knot.ply", meshes.knot(30, 12))
    scene = folder / "a.scene"
    scene.write_text(text, encoding="utf-8")
    made = Shown(scene)
    made.studio.start()
    try:
        yield made
    finally:
        made.studio.stop()


def first(made: Shown) -> None:
    windows.until(lambda: bool(made.edits), 120)


@pytest.mark.long
def test_an_edit_redoes_only_what_it_touches(tmp_path: Path) -> None:
    with shown(tmp_path) as made:
        first(made)
        made.write(SCENE.replace("#ff0000", "#00ff00"))  # kernels of a second scene are those of the first
        made.write(SCENE.replace("#ff0000", "#0000ff"))
        work = made.edits[-1]["work"]
        assert {name: work[name] for name in NOTHING} == NOTHING
        assert (work["sources parsed"], work["scenes evaluated"]) == (1, 1)
        assert work["pixels drawn"] == work["pictures drawn"] * 32 * 24
        assert list(made.edits[-1]["seconds"]) == ["compiled", "first picture", "whole picture", "finished"]
        made.write(SCENE.replace("#ff0000", "#0000ff").replace("translate: [0, 0, 0]", "translate: [0, 1, 0]"))
        work = made.edits[-1]["work"]
        assert {name: work[name] for name in NOTHING} == NOTHING
        before = len(made.edits)
        made.studio.change(lambda state: state.changed({"sets": {"size": "0.5"}}))
        windows.until(lambda: len(made.edits) > before)
        work = made.edits[-1]["work"]
        assert {name: work[name] for name in NOTHING} == NOTHING
        assert work["sources parsed"] == 0
        before = len(made.edits)
        pose = {"position": [0, 1, 5], "look_at": [0, 0, 0], "up": [0, 1, 0]}
        made.studio.change(lambda state: state.changed({"pose": pose}))
        windows.until(lambda: len(made.edits) > before)
        work = made.edits[-1]["work"]
        assert (work["sources parsed"], work["scenes evaluated"]) == (0, 0)
        assert {name: work[name] for name in NOTHING} == NOTHING


def test_another_mesh_is_read_and_built(tmp_path: Path) -> None:
    with shown(tmp_path) as made:
        first(made)
        meshes.write_ply(tmp_path / "other.ply", meshes.knot(31, 12))
        made.write(SCENE.replace("knot.ply", "other.ply"))
        work = made.edits[-1]["work"]
        assert (work["meshes read"], work["mesh BVHs built"]) == (1, 1)


@pytest.mark.long
def test_a_long_compilation_is_cancelled_by_the_next_edit(tmp_path: Path) -> None:
    with shown(tmp_path) as made:
        first(made)
        slow = SCENE + "for (k in 0..400000) { sphere(0.01, center: [0.001 * k, 0, sin(k)]) }\n"
        made.save(slow)
        time.sleep(2.5)
        assert len(made.edits) == 1
        began = time.monotonic()
        made.save(SCENE.replace("#ff0000", "#00ff00"))
        windows.until(lambda: len(made.edits) == 3, 60)
        assert time.monotonic() - began < 3.0
        assert "first picture" not in made.edits[1]["seconds"]
        assert "finished" in made.edits[2]["seconds"]
        assert not any(message["type"] == "diagnostics" and message["failed"] for message in made.messages)


@pytest.mark.long
def test_the_bvhs_of_many_meshes_are_cancelled_by_the_next_edit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    build, built = wide_bvh.build, []

    def slow(*given: Any) -> Any:
        time.sleep(0.3)
        built.append(1)
        return build(*given)

    with shown(tmp_path) as made:
        first(made)
        monkeypatch.setattr(wide_bvh, "build", slow)
        for k in range(30):
            meshes.write_ply(tmp_path / f"{k}.ply", meshes.knot(20 + k, 5))
        made.save(SCENE + "".join(f'mesh("{k}.ply", translate: [{k}, 0, 0])\n' for k in range(30)))
        windows.until(lambda: len(built) >= 4, 60)
        made.save(SCENE.replace("#ff0000", "#00ff00"))
        windows.until(lambda: len(made.edits) == 3, 60)
        assert len(built) < 15
        assert "finished" in made.edits[2]["seconds"]


@pytest.mark.long
def test_a_thousand_edits_keep_less_than_50_mb(tmp_path: Path) -> None:
    def resident() -> float:
        gc.collect()
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
        return pages * 4096 / 1e6

    if not Path("/proc/self/statm").exists():
        pytest.skip("no /proc: the memory of this process is unknown")
    with shown(tmp_path) as made:
        first(made)
        for k in range(50):
            made.write(SCENE.replace("#ff0000", f"#{k:02x}8040").replace("translate: [0, 0, 0]", f"translate: [0, 0.{k:03d}, 0]"))
        before = resident()
        for k in range(1000):
            broken = "sphre(1)\n" if k % 10 == 9 else ""
            made.write(SCENE.replace("#ff0000", f"#{k:06x}").replace("translate: [0, 0, 0]", f"translate: [0, 0.{k:04d}, 0]") + broken)
        assert resident() - before < 50.0
        assert len(made.edits) == 1051
