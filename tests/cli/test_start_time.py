"""The start of a budget is that of the process, and its end is that of writing."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from maquette.cli.job import start_time
from maquette.cli.main import cli
from maquette.compiler import ir
from maquette.compiler.plan.plan import Plan
from maquette.render import render_scene
from maquette.render.film.deadline import Deadline
from maquette.render.image import image_files
from maquette.render.image.image import Image

from ..files import standing_by

PROGRAM = """
import time
time.sleep(0.5)
from maquette.cli.job import start_time
start_time.begin()
print(time.perf_counter() - start_time.take().began, time.perf_counter() - start_time.take().began)
"""


@pytest.mark.long
def test_the_first_picture_begins_with_the_process_and_others_when_they_are_read() -> None:
    began = time.monotonic()
    said = subprocess.run([sys.executable, "-P", "-c", PROGRAM], capture_output=True, text=True, check=True).stdout
    first, second = map(float, said.split())
    assert 0.5 <= first <= time.monotonic() - began + 0.02
    assert abs(second) < first


def test_a_picture_outside_of_a_command_begins_now() -> None:
    before = time.perf_counter()
    assert before <= start_time.take().began <= time.perf_counter()


def test_a_drawing_leaves_the_time_of_writing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    standing_by(tmp_path, monkeypatch, "sphere(1)\nsun()\ncamera(position: [0, 1, 5], look_at: [0, 0, 0])\n")
    reserved: list[float] = []

    def draw(scene: ir.Scene, plan: Plan, *given: Any, deadline: Deadline) -> Image:
        reserved.append(deadline.seconds - deadline.spent() - deadline.left())
        raise KeyboardInterrupt

    monkeypatch.setattr(render_scene, "draw", draw)
    for more in ((), ("--bits", "16")):
        CliRunner().invoke(cli, ["render", "a.scene", "-o", "a.png", "--size", "2000x1500", "--budget", "60s", *more])
    looks = [image_files.Look(), image_files.Look(bits=16)]
    assert reserved == pytest.approx([image_files.writing_time(Path("a.png"), 2000 * 1500, look) for look in looks], abs=0.05)
