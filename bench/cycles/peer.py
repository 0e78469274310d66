"""Cycles in a process of its own, which draws pictures on request and tells its CPU time."""

from __future__ import annotations

import json
import os
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...render.image import image_reader
from .. import harness
from .worker import ANSWER

PYTHON = "MAQUETTE_BLENDER_PYTHON"  # environment variable: a Python that has bpy
INSTALL = f"pip install bpy==5.0.1 in an environment of Python 3.11, whose python {PYTHON} names"


class Cycles:
    """Cycles with one stage open."""

    def __init__(self, stage: Path, media: Mapping[str, Mapping[str, Any]] | None = None) -> None:
        """`media`: those of the stage's objects by name. Raises Missing without a Python that has bpy."""
        python = os.environ.get(PYTHON, "")
        if not python:
            raise harness.Missing(f"Cycles is not installed ({INSTALL})")
        command = [python, str(Path(__file__).with_name("worker.py")), str(stage), json.dumps(dict(media or {}))]
        try:
            self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        except OSError as why:
            raise harness.Missing(f"Cycles does not start: {why} ({INSTALL})") from why
        self._folder = tempfile.TemporaryDirectory()
        self.cpu = self._read()
        harness.RUNNING.append(self._spent)

    def draw(self, size: int, samples: int, seed: int, bounces: int, guiding: bool) -> Path:
        """The EXR file of a picture, which the next one replaces."""
        out = Path(self._folder.name) / "picture.exr"
        request = {"size": size, "samples": samples, "seed": seed, "bounces": bounces, "guiding": guiding, "out": str(out)}
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(request) + "\n")
        self._process.stdin.flush()
        self.cpu = self._read()
        return out

    def _spent(self) -> float:
        return self.cpu

    def _read(self) -> float:
        """The CPU seconds of the next answer."""
        assert self._process.stdout is not None
        for line in self._process.stdout:
            if line.startswith(ANSWER):
                return float(json.loads(line[len(ANSWER) :])["cpu"])
        raise harness.Missing(f"Cycles ends without an answer ({INSTALL})")

    def __enter__(self) -> Cycles:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()
        harness.RUNNING.remove(self._spent)
        self._folder.cleanup()


def read(path: Path) -> NDArray[np.float64]:
    """A picture of `draw`, linear (h, w, 3)."""
    pixels: Any = image_reader.read(path).channels["rgba"]
    return np.asarray(pixels[..., :3], np.float64)
