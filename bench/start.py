"""Whole processes from the command to the picture file: maquette, POV-Ray and Mitsuba on the same small scene."""

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

from ..render.image import image_files, image_reader
from . import edit_session, limits, mitsuba, report
from .harness import OURS, Case, Contender, Disagreement, Effort, Missing, Peers, measure

SCENES = Path(__file__).resolve().parent / "scenes"
TEXT = """
A ball and a block on a board, 512², 4 samples a pixel, one distant light with shadows, no bounces; each run is one process, from its start
to its end, that reads its own renderer's scene file (`bench/scenes/start.*`) and writes a picture. *Warm*: kernels are in the cache.
*Cold*: an empty kernel cache for each run, so that maquette and Mitsuba's llvm mode compile everything. Files are in the system's memory
either way. *Check* reads and checks the scene and draws nothing. Ratios are of wall time.
"""
WAITS = """
maquette's wheel in a new environment with an empty home (that of a user who has just installed it), on two cores. *Kernels*: the seconds
of a picture in which its rendering waits for code to be compiled or loaded. *Edits*: a scene in `watch`, 320 × 240, 4 samples a pixel;
each of the first ten edits adds a line, each of the others changes the first scene; the seconds from the save to the picture. *Warm
processes*: a sphere of 64 × 48 pixels, one sample, with its kernels on disk; checking hello.scene; the help.
"""
SPHERE = "sphere(1)\npoint([2, 4, 3], intensity: 20)\ncamera(position: [0, 0, 5], look_at: [0, 0, 0])\nrender(size: [64, 48], samples: 1)\n"
MAX_DIFFERING = 0.02  # allowed share of pixels that differ by more than COLOR, as samples lie elsewhere
COLOR = 0.06
NAMES = ("waits",)  # parts
TIMEOUT = 300.0  # seconds of a process


def section(quick: bool, effort: Effort, only: str = "") -> report.Section:
    """Measure warm starts and, unless `quick`, one cold start and `waits`, or these alone."""
    if only in NAMES:
        return waits(effort)
    peers = Peers()
    result = report.Section("start", "Starting up", TEXT)
    size = 64 if quick else 512
    with tempfile.TemporaryDirectory() as folder:
        programs = Programs(Path(folder), size)
        sides = peers.gather(programs.ours, programs.povray, programs.mitsuba)
        results = [measure(Case("warm", sides, agree), effort)]
        results.append(measure(Case("check", [programs.check()], lambda _: "no picture"), effort))
        if not quick:
            cold = peers.gather(functools.partial(programs.ours, cold=True), functools.partial(programs.mitsuba, cold=True))
            results.append(measure(Case("cold", cold, agree), Effort(rounds=1, fewest=1)))
        result.add("One picture", results, "", by="wall")
        if not quick:
            result.parts.append(waits(effort))
    result.missing = peers.missing
    result.versions = {**report.version_of("mitsuba"), **_povray_version()}
    return result


def waits(effort: Effort) -> report.Section:
    """Measure the waits after an installation: first pictures, thirty edits, and the shortest commands."""
    result = report.Section("start waits", "Waiting for kernels", WAITS, level=3)
    with tempfile.TemporaryDirectory() as name:
        environment = edit_session.Environment(Path(name))
        environment.install()
        locked = environment.read_only_home()
        hello = edit_session.ROOT / "examples/hello.scene"
        rows = [("hello.scene, empty home", *_seconds(environment.render(hello)))]
        rows += [("hello.scene, home that cannot be written", *_seconds(environment.render(hello, **locked)))]
        for scene in sorted(hello.parent.glob("*.scene")):
            rows.append((f"{scene.name}, 64 pixels wide, the same home", *_seconds(environment.render(scene, "--size", "64x48", **locked))))
        result.blocks += ["**First picture**", report.grid(("", "process, s", "kernels, s"), rows)]
        edits = [(name, *_seconds((total, kernels))) for name, kernels, total in edit_session.session(environment, edit_session.scenes())]
        result.blocks += ["**Edits**", report.grid(("", "redraw, s", "kernels, s"), edits)]
        sphere = environment.folder / "sphere.scene"
        sphere.write_text(SPHERE, encoding="utf-8")
        environment.run("render", str(sphere), "--quiet", MAQUETTE_KERNELS="special")  # compiles or loads what the warm runs take
        commands = {"render a sphere": ("render", str(sphere)), "check": ("check", str(hello)), "--help": ("--help",)}
        results = [measure(Case(name, [_command(environment, words)], lambda _: "no peer"), effort) for name, words in commands.items()]
        result.add("Warm processes", results, "", by="wall")
    return result


def _command(environment: edit_session.Environment, words: tuple[str, ...]) -> Contender:
    return Contender(OURS, lambda: environment.run(*words))


def _seconds(measured: tuple[float, float]) -> tuple[str, str]:
    return f"{measured[0]:.2f}", f"{measured[1]:.2f}"


class Programs:
    """The commands of the renderers, with a folder for pictures."""

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
        limits.require_limit("POV-Ray")
        picture = self.folder / "povray.png"
        size = [f"+W{self.size}", f"+H{self.size}"]
        samples = ["+A0.0", "+AM1", "+R2", "-J"]  # 2 × 2 samples a pixel
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
        """A new empty cache folder."""
        folder = self.folder / f"empty{next(self._numbers)}"
        folder.mkdir()
        return str(folder)

    def _run(self, command: list[str], **more: str) -> None:
        environment = {**os.environ, **{name: value for name, value in more.items() if value}}
        environment.pop("PYTHONDONTWRITEBYTECODE", None)  # byte code is cached, as for installed packages
        done = subprocess.run(command, env=environment, cwd=self.folder, capture_output=True, text=True, timeout=TIMEOUT)
        if done.returncode:
            raise RuntimeError(f"{' '.join(command)} failed:\n{done.stdout}{done.stderr}")


def _script(name: str) -> str:
    """The path of a command of this environment."""
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
    """The linear colours of a picture. `linear`: the integers of the file are linear, regardless of its metadata."""
    rgb = np.asarray(image_reader.read(path).channels["rgba"][..., :3], dtype=np.float64)
    return image_files.encode_srgb(rgb) if linear else rgb


def agree(answers: Mapping[str, Any]) -> str:
    """Compare means and pixels of each peer with ours."""
    mine = answers[OURS]
    said = [f"mean {mine.mean():.4f}"]
    for name, theirs in ((k, v) for k, v in answers.items() if k != OURS):
        apart = float(np.mean(np.abs(mine - theirs).max(axis=2) > COLOR))
        off = theirs.mean() / mine.mean() - 1.0
        text = f"{name}: mean {off:+.2%}, {apart:.2%} of pixels differ by more than {COLOR}"
        if apart > MAX_DIFFERING * max(1.0, 256 / mine.shape[0]) or abs(off) > 0.01:
            raise Disagreement(text)
        said.append(text)
    return "; ".join(said)
