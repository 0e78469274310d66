"""A picture goes on from a checkpoint made at any time, and ends with the same bits."""

from __future__ import annotations

import shutil
import struct
import threading
from pathlib import Path
from typing import Any

import maquette
import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.plan import plan as planner
from maquette.render import render_scene
from maquette.render.film import checkpoint, film
from maquette.render.types import Film, Tile, View

from .test_film import SIZE, Painter, plan

GLASS = """box([4, 0.1, 4], center: [0, -0.05, 0], material: lambert(#808080))
sphere(0.6, center: [0, 0.6, 0], material: glass())
area(position: [0, 3, 1], look_at: [0, 0, 0], size: [0.6, 0.6], luminance: 30)
camera(position: [1, 2, 5], look_at: [0, 0.6, 0], fov: 40deg)
"""


class Rounds(Painter):
    """A painter whose samples depend on data that each round makes from the last."""

    round = 8

    def __init__(self, width: float) -> None:
        super().__init__(width)
        self.made, self.data = 0, 0

    def refresh(self, samples: int) -> None:
        self.made, self.data = self.made + 1, (self.made + 1) * 1_000_003 + samples

    def shared(self) -> tuple[int, ...]:
        return (self.made,)

    def share(self, state: tuple[int, ...]) -> None:
        (self.made,) = state

    def sample(self, tile: Tile, first: np.ndarray, count: np.ndarray, total: int, film: Film) -> None:
        super().sample(tile, first + self.data, count, total, film)


CASES = {
    "fixed samples": (Painter, {"samples": 48}),
    "an error": (Painter, {"samples": 4096, "error": 0.02}),
    "a fixed number in rounds": (Rounds, {"samples": 40}),
    "an error in rounds": (Rounds, {"samples": 4096, "error": 0.02}),
}


class Copying(checkpoint.Keeper):
    """Keeps a copy of every checkpoint; one is due after every tile."""

    def __init__(self, path: Path, key: str, resume: bool = False, cancel: threading.Event | None = None, after: int = 0) -> None:
        super().__init__(path, lambda: key, 0.0, 0.0, resume)
        self.copies: list[Path] = []
        self._cancel, self._after = cancel, after

    def due(self) -> bool:
        return True

    def save(self, state: checkpoint.State) -> None:
        super().save(state)
        self.copies.append(Path(shutil.copy(self.path, self.path.with_name(f"copy{len(self.copies)}"))))
        if self._cancel is not None and len(self.copies) == self._after:
            self._cancel.set()


def draw(case: str, keeper: Any = None, cancel: Any = None) -> Any:
    kind, changed = CASES[case]
    return film.run(kind(0.7), plan(aov=("depth", "samples", "variance"), **changed), View(0, *SIZE), cancel=cancel, keeper=keeper)


def prepared(tmp_path: Path, text: str, **settings: Any) -> tuple[ir.Scene, Any]:
    (tmp_path / "a.scene").write_text(text, encoding="utf-8")
    scene = maquette.load(tmp_path / "a.scene")
    return scene, planner.make_plan(scene, ir.Settings(**{"size": (70, 50), "threads": 2, "seed": 3, **settings}))


def same(a: Any, b: Any) -> None:
    for name in a.channels:
        np.testing.assert_array_equal(a.channels[name], b.channels[name], name)
    for name in ("samples", "samples_mean", "error", "rays", "issues", "partial"):
        assert a.metadata[name] == b.metadata[name], name
    np.testing.assert_array_equal(a.metadata["variance"], b.metadata["variance"])


@pytest.mark.long
@pytest.mark.parametrize("case", CASES)
def test_a_picture_goes_on_with_the_same_bits(tmp_path: Path, case: str) -> None:
    """From checkpoints all over the rendering, as after the process was killed."""
    complete = Copying(tmp_path / "whole", "k")
    expected = draw(case, complete)
    assert len(complete.copies) >= 6
    for row in range(0, len(complete.copies), max(1, len(complete.copies) // 20)):
        shutil.copy(complete.copies[row], tmp_path / "again")
        keeper = checkpoint.Keeper(tmp_path / "again", lambda: "k", 1e9, 1e9, True)
        assert keeper.saved_state is not None
        same(draw(case, keeper), expected)


@pytest.mark.long
@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("after", [1, 4])
def test_an_interrupted_picture_goes_on(tmp_path: Path, case: str, after: int) -> None:
    """A cancelled rendering leaves a checkpoint of whole batches."""
    cancel = threading.Event()
    draw(case, Copying(tmp_path / "p", "k", cancel=cancel, after=after), cancel)
    assert cancel.is_set()
    same(draw(case, Copying(tmp_path / "p", "k", resume=True)), draw(case))


@pytest.mark.long
def test_photons_go_on(tmp_path: Path) -> None:
    """Photon maps of the interrupted round are made again."""
    scene, decided = prepared(tmp_path, GLASS, error=0.15, bounces=4)
    complete = Copying(tmp_path / "whole", "k")
    expected = render_scene.draw(scene, decided, keeper=complete)
    for row in sorted({round(share * (len(complete.copies) - 1)) for share in (0.0, 0.3, 0.6, 0.8, 1.0)}):
        shutil.copy(complete.copies[row], tmp_path / "again")
        same(render_scene.draw(scene, decided, keeper=checkpoint.Keeper(tmp_path / "again", lambda: "k", 1e9, 1e9, True)), expected)


def test_a_key_is_that_of_one_picture(tmp_path: Path) -> None:
    """Another scene, seed or version has another key; threads and budget do not count."""
    scene, decided = prepared(tmp_path, GLASS, samples=8)
    key = checkpoint.key_of(scene, decided, "1")
    again, other_threads = prepared(tmp_path, GLASS, samples=8, threads=1)
    assert checkpoint.key_of(again, other_threads, "1") == key
    assert checkpoint.key_of(*prepared(tmp_path, GLASS, samples=8, seed=4), "1") != key
    assert checkpoint.key_of(*prepared(tmp_path, GLASS.replace("0.6, center", "0.7, center"), samples=8), "1") != key
    assert checkpoint.key_of(scene, decided, "2") != key


@pytest.mark.parametrize("damage", [b"", b"PK\x03\x04", None, "cut", "flipped", "fewer", "header"])
def test_a_damaged_checkpoint_counts_as_none(tmp_path: Path, damage: Any) -> None:
    keeper = Copying(tmp_path / "a", "k")
    draw("fixed samples", keeper)
    content = keeper.path.read_bytes()
    assert checkpoint.load(keeper.path, "k") is not None
    assert checkpoint.load(keeper.path, "other") is None
    header = content.index(b"NUMPY\x01\x00", content.index(b"NUMPY") + 1)  # of the second array, read before its checksum
    first = content.index(b"PK\x01\x02")  # of the entries in the directory; the others become its comment
    others = struct.pack("<H", content.index(b"PK\x05\x06") - content.index(b"PK\x01\x02", first + 4))
    damages = {
        "fewer": content[: first + 32] + others + content[first + 34 :],
        "header": content[: header + 6] + b"\x03" + content[header + 7 :],
    }
    damages |= {
        "cut": content[: len(content) // 2],
        "flipped": content[:200] + bytes(64) + content[264:],
        None: content.replace(b"head", b"heap"),
    }
    keeper.path.write_bytes(damage if isinstance(damage, bytes) else damages[damage])
    assert checkpoint.load(keeper.path, "k") is None


def test_a_full_disk_keeps_the_last_checkpoint(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    keeper = checkpoint.Keeper(tmp_path / "a", lambda: "k", 0.0, 0.0, False)
    state = checkpoint.State({"rgba": np.ones((2, 2, 4), np.float32)}, {"least": 0.0})
    keeper.save(state)

    def full(*_: Any, **__: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez", full)
    keeper.save(state._replace(numbers={"least": 1.0}))
    loaded = checkpoint.load(tmp_path / "a", "k")
    assert loaded is not None
    assert loaded.numbers["least"] == 0.0
    assert [path.name for path in tmp_path.iterdir()] == ["a"]
