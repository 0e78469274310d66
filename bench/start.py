"""Whole processes, from the command to the picture in a file: maquette, POV-Ray and Mitsuba on the same small scene."""

from __future__ import annotations

import functools
import itertools
import os
import shutil
import subprocess
import sysconfig
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..render.image import image_files
from . import limits, mitsuba, report
from .harness import OURS, Case, Contender, Disagreement, Effort, Missing, Peers, measure

SCENES = Path(__file__).resolve().parent / "scenes"
TEXT = """
A ball and a block on a board, 512², 4 samples a pixel, one distant light with shadows, no bounces; each run is one process, from its start
to its end, that reads its own renderer's scene file (`bench/scenes/start.*`) and writes a picture. *Warm*: kernels are in the cache.
*Cold*: an empty kernel cache for each run, so that maquette and Mitsuba's llvm mode compile everything. Files are in the system's memory
either way. *Check* reads and checks the scene and draws nothing. Ratios are of wall time.
"""
MOST_APART = 0.02  # share of pixels that may differ by more than COLOR: samples lie elsewhere in them
COLOR = 0.06
LONGEST = 300.0  # seconds a process may take


def section(quick: bool, effort: Effort) -> report.Section:
    """Measure warm, then cold (once: it takes long), unless in a hurry."""
    peers = Peers()
    found = report.Section("start", "Starting up", TEXT)
    size = 64 if quick else 512
    with tempfile.TemporaryDirectory() as folder:
        desk = Desk(Path(folder), size)
        sides = peers.gather(desk.ours, desk.povray, desk.mitsuba)
        results = [measure(Case("warm", sides, agree), effort)]
        results.append(measure(Case("check", [desk.check()], lambda _: "no picture"), effort))
        if not quick:
            cold = peers.gather(functools.partial(desk.ours, cold=True), functools.partial(desk.mitsuba, cold=True))
            results.append(measure(Case("cold", cold, agree), Effort(rounds=1, fewest=1)))
        found.add("One picture", results, "", by="wall")
    found.missing = peers.missing
    found.versions = {**report.version_of("mitsuba"), **_povray_version()}
    return found


class Desk:
    """A folder for pictures, and each renderer's command."""

    def __init__(self, folder: Path, size: int) -> None:
        self.folder, self.size = folder, size
        self._numbers = itertools.count()

    def ours(self, cold: bool = False) -> Contender:
        picture = self.folder / "maquette.exr"
        size = f"{self.size}x{self.size}"
        command = [_script("maquette"), "render", str(SCENES / "start.scene"), "-o", str(picture), "--size", size, "--threads", "1"]
        return Contender(OURS, lambda: self._run(command, MAQUETTE_CACHE=self._empty() if cold else ""), lambda _: _pixels(picture))

    def check(self) -> Contender:
        return Contender(OURS, lambda: self._run([_script("maquette"), "check", str(SCENES / "start.scene")]))

    def povray(self) -> Contender:
        program = shutil.which("povray")
        if program is None:
            raise Missing("povray is not installed (Debian's povray)")
        limits.unlimited("POV-Ray")
        picture = self.folder / "povray.png"
        size = [f"+W{self.size}", f"+H{self.size}"]
        samples = ["+A0.0", "+AM1", "+R2", "-J"]  # each pixel by 2 × 2 samples in its own places
        linear = ["+FN16", "File_Gamma=1.0"]
        command = [program, f"+I{SCENES / 'start.pov'}", f"+O{picture}", *size, *samples, *linear, "-D", "+WT1", "-GA"]
        return Contender("POV-Ray", lambda: self._run(command), lambda _: _pixels(picture, linear=True))

    def mitsuba(self, cold: bool = False) -> Contender:
        mitsuba.load()
        picture = self.folder / "mitsuba.pfm"
        scene = self.folder / "start.xml"
        text = (SCENES / "start.xml").read_text(encoding="utf-8")
        scene.write_text(text.replace('value="512"', f'value="{self.size}"'), encoding="utf-8")
        command = [_script("mitsuba"), "-m", mitsuba.LLVM, "-t", "1", "-o", str(picture), str(scene)]
        return Contender("Mitsuba llvm", lambda: self._run(command, HOME=self._empty() if cold else ""), lambda _: _pixels(picture))

    def _empty(self) -> str:
        """A new empty folder, for a cache."""
        folder = self.folder / f"empty{next(self._numbers)}"
        folder.mkdir()
        return str(folder)

    def _run(self, command: list[str], **more: str) -> None:
        environment = {**os.environ, **{name: value for name, value in more.items() if value}}
        environment.pop("PYTHONDONTWRITEBYTECODE", None)  # installed packages are compiled, and so are those that are run where they stand
        done = subprocess.run(command, env=environment, cwd=self.folder, capture_output=True, text=True, timeout=LONGEST)
        if done.returncode:
            raise RuntimeError(f"{' '.join(command)} failed:\n{done.stdout}{done.stderr}")


def _script(name: str) -> str:
    """A command of this environment."""
    path = Path(sysconfig.get_path("scripts")) / name
    if not path.exists():
        raise Missing(f"there is no command `{name}` in this environment")
    return str(path)


def _povray_version() -> dict[str, str]:
    if shutil.which("povray") is None:
        return {}
    said = subprocess.run(["povray", "--version"], capture_output=True, text=True)
    words = (said.stdout + said.stderr).split()
    return {"POV-Ray": next((w for w in words if w[:1].isdigit()), "?")}


def _pixels(path: Path, linear: bool = False) -> NDArray[np.float64]:
    """The picture's linear colours. `linear`: a file of integers that are linear already, whatever it says of itself."""
    rgb = np.asarray(image_files.read(path).channels["rgba"][..., :3], dtype=np.float64)
    return image_files.encode_srgb(rgb) if linear else rgb


def agree(answers: Mapping[str, Any]) -> str:
    """Means, and pixels, of each peer against ours."""
    mine = answers[OURS]
    said = [f"mean {mine.mean():.4f}"]
    for name, theirs in ((k, v) for k, v in answers.items() if k != OURS):
        apart = float(np.mean(np.abs(mine - theirs).max(axis=2) > COLOR))
        off = theirs.mean() / mine.mean() - 1.0
        text = f"{name}: mean {off:+.2%}, {apart:.2%} of pixels differ by more than {COLOR}"
        if apart > MOST_APART * max(1.0, 256 / mine.shape[0]) or abs(off) > 0.01:
            raise Disagreement(text)
        said.append(text)
    return "; ".join(said)
