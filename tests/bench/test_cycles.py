"""The Cycles peer: requests and answers of its process, its CPU time, and what is said where it is missing."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from maquette.bench import harness, path_scenes, paths
from maquette.bench.cycles import peer
from maquette.render.image.image import Image

WORKER = """#!{python}
import json, shutil, sys
print("Blender 5.0")
print('@answer {{"cpu": 2.0}}', flush=True)
for k, line in enumerate(sys.stdin):
    asked = json.loads(line)
    open({log!r}, "a").write(line)
    shutil.copy({picture!r}, asked["out"])
    print("Fra: 1")
    print(json.dumps({{"cpu": 3.0 + k}}).join(["@answer ", ""]), flush=True)
"""


@pytest.fixture
def worker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The log of the requests to a process that answers as the worker does, with a gray picture."""
    picture, program, log = tmp_path / "gray.exr", tmp_path / "python", tmp_path / "log"
    gray = np.full((4, 4, 4), 0.25, np.float32)
    Image(4, 4, {"rgba": gray}, {}).save(picture)
    program.write_text(WORKER.format(python=sys.executable, log=str(log), picture=str(picture)))
    program.chmod(0o755)
    monkeypatch.setenv(peer.PYTHON, str(program))
    return log


def test_requests_and_cpu_time(worker: Path, tmp_path: Path) -> None:
    before = len(harness.RUNNING)
    with peer.Cycles(tmp_path / "room.usdc") as cycles:
        start = harness.clock().cpu
        picture = peer.read(cycles.draw(4, 16, 7, 8, True))
        assert 1.0 <= harness.clock().cpu - start < 2.0  # a second of the worker, and less of this process
        assert picture == pytest.approx(np.full((4, 4, 3), 0.25))
    assert worker.read_text().startswith('{"size": 4, "samples": 16, "seed": 7, "bounces": 8, "guiding": true, "out": ')
    assert len(harness.RUNNING) == before


def test_without_bpy_it_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(peer.PYTHON, raising=False)
    with pytest.raises(harness.Missing, match="Cycles is not installed"):
        peer.Cycles(tmp_path / "room.usdc")
    monkeypatch.setenv(peer.PYTHON, str(tmp_path / "none"))
    with pytest.raises(harness.Missing, match="Cycles does not start"):
        peer.Cycles(tmp_path / "room.usdc")


def test_noise_of_blocks_is_told_beside_that_of_pixels() -> None:
    rng: Any = np.random.default_rng(3)
    reference = paths.Reference.from_runs(1.0 + 1e-3 * rng.standard_normal((4, 64, 64, 3)))
    alone = 1.0 + 0.1 * rng.standard_normal((64, 64, 3))
    shared = 1.0 + 0.1 * np.kron(rng.standard_normal((16, 16, 1)), np.ones((4, 4, 3)))
    assert reference.errors(alone) == pytest.approx((0.1, 0.025), rel=0.1)
    assert reference.errors(shared) == pytest.approx((0.1, 0.1), rel=0.15)


@pytest.mark.long
@pytest.mark.skipif(not os.environ.get(peer.PYTHON), reason="no Python with bpy")
def test_cycles_draws_the_room_that_we_draw(tmp_path: Path) -> None:
    setting = path_scenes.SETTINGS["daylight"](tmp_path, True)
    assert setting.stage is not None
    ours = paths.our_renderer(setting.decide)
    mean = ours.read(ours.draw(64, 256, 1)()).mean()
    with peer.Cycles(setting.stage) as cycles:
        assert peer.read(cycles.draw(64, 256, 1, setting.depth - 2, False)).mean() == pytest.approx(mean, rel=0.05)
