"""Renders that are killed at random instants lose nothing, and go on to the same bits."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from maquette.compiler.io import replace_file
from maquette.render.image import image_reader

KILLS = int(os.environ.get("MAQUETTE_KILLS", "12"))
SCENE = """
sphere(center: [0, 1, 0], material: lambert(#c0c0c0))
plane(material: lambert(checker(#d0402a, #e8e8e8, size: 0.5)))
area(position: [1, 4, 1], look_at: [0, 0, 0], size: [1, 1], luminance: 40)
camera(position: [0, 1.6, 5], look_at: [0, 1, 0], fov: 35deg)
"""
WORK = {"samples": ("--samples", "60"), "error": ("--error", "5%")}
OLD = b"the old picture"


class Render:
    """A command that draws a.scene into a.exr, in a folder where it was drawn before."""

    def __init__(self, folder: Path, options: tuple[str, ...]) -> None:
        self.folder = folder
        self.picture, self.checkpoint = folder / "a.exr", folder / "a.exr.checkpoint"
        self.command = [sys.executable, "-m", "maquette", "render", "a.scene", "-q", "--size", "320x240", "--bounces", "4", *options]
        self.environment = {**os.environ, "MAQUETTE_PROGRESS": "off"}

    def start(self, *options: str) -> subprocess.Popen[bytes]:
        command = [*self.command, *options]
        return subprocess.Popen(command, cwd=self.folder, env=self.environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)

    def partials(self) -> list[Path]:
        """Temporary files."""
        return list(self.folder.glob(f"{replace_file.PREFIX}*"))

    def is_whole(self, expected: np.ndarray) -> bool:
        """Whether the picture is the new one; asserts that it is the whole old one otherwise, and that the checkpoint is whole."""
        if self.checkpoint.exists():
            with np.load(self.checkpoint, allow_pickle=False) as arrays:
                assert all(arrays[name].dtype != object for name in arrays.files)
        if self.picture.read_bytes() == OLD:
            return False
        np.testing.assert_array_equal(image_reader.read(self.picture).channels["rgba"], expected)
        return True


def kill(process: subprocess.Popen[bytes], instant: float, render: Render, writing: bool) -> bool:
    """Kill a render after some seconds, or while it writes a file after these; whether it was alive."""
    time.sleep(instant)
    end = time.monotonic() + 2.0
    while writing and process.poll() is None and time.monotonic() < end and not render.partials():
        time.sleep(0.0005)
    process.send_signal(signal.SIGKILL)
    return process.wait() == -signal.SIGKILL


@pytest.mark.long
@pytest.mark.parametrize("work", WORK)
def test_killed_renders_lose_nothing(tmp_path: Path, work: str) -> None:
    """MAQUETTE_KILLS kills at random instants, every other one while a checkpoint or the picture is written."""
    (tmp_path / "a.scene").write_text(SCENE, encoding="utf-8")
    render, rng = Render(tmp_path, WORK[work]), random.Random(1)
    assert render.start("-o", "whole.exr").wait() == 0
    began = time.monotonic()
    assert render.start("-o", "whole.exr").wait() == 0
    seconds = time.monotonic() - began
    expected = image_reader.read(tmp_path / "whole.exr").channels["rgba"]
    render.picture.write_bytes(OLD)
    kills = resumed = finished = unfinished = 0
    while kills < KILLS:
        process = render.start("-o", "a.exr", "--checkpoint", "0.2s", "--resume")
        resumed += render.checkpoint.exists()
        killed = kill(process, rng.uniform(0.0, 1.1 * seconds), render, writing=bool(kills % 2))
        kills += killed
        unfinished += bool(render.partials())
        if not killed:
            assert process.returncode == 0, process.stderr.read() if process.stderr else ""
        if process.stderr is not None:
            process.stderr.close()
        if render.is_whole(expected):
            finished += 1
            render.picture.write_bytes(OLD)
        else:
            assert killed
        for partial in render.partials():  # as a minute later, when the next command removes it
            os.utime(partial, (0, 0))
    assert render.start("-o", "a.exr", "--resume").wait() == 0
    assert render.is_whole(expected)
    assert not render.checkpoint.exists()
    assert not render.partials()
    print(f"{kills} kills, {resumed} starts from a checkpoint, {unfinished} unfinished files, {finished} pictures")
    assert resumed
