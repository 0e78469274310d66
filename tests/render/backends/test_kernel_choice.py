"""General and specialised kernels give the same pictures, and no picture waits for specialised ones where general ones are ready."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import maquette
import numpy as np
import pytest
from maquette.compiler.io.environment import SettingError
from maquette.render.backends import kernel_choice, prepare
from maquette.render.jit import compile_process, kernel_cache

ROOT = Path(__file__).resolve().parents[3]
EXAMPLES = sorted(each for each in (ROOT / "examples").iterdir() if each.suffix in (".scene", ".usda", ".obj"))
QUICK = (("hello", "auto"), ("textures", "auto"), ("gear", "auto"), ("hello", "raster"))
BALL = "sphere(1)\ndirectional(from: [1, 1, 1])\ncamera(position: [0, 0, 4])\n"


def draw(path: Path, **settings: Any) -> Any:
    return maquette.render(path, **{"size": (48, 36), "samples": 2, **settings})


def pictures() -> list[Any]:
    """Every example on both backends; all but QUICK are long, since each compiles specialised kernels."""
    every = [(path, backend) for path in EXAMPLES for backend in ("auto", "raster") if (path.stem, backend) != ("panorama", "raster")]
    marks = {True: [], False: [pytest.mark.long]}
    return [pytest.param(*one, id=f"{one[0].stem}-{one[1]}", marks=marks[(one[0].stem, one[1]) in QUICK]) for one in every]


@pytest.mark.parametrize(("path", "backend"), pictures())
def test_general_kernels_draw_the_same_picture(monkeypatch: pytest.MonkeyPatch, path: Path, backend: str) -> None:
    found = []
    for kind in ("special", "general"):
        monkeypatch.setenv(kernel_choice.VARIABLE, kind)
        found.append(draw(path, backend=backend))
    special, general = map(np.asarray, found)
    assert np.array_equal(special, general)


def test_narrow_lobes_without_photons(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """General kernels split narrow lobes from their diffuse base only where photons light it."""
    path = tmp_path / "a.scene"
    path.write_text("sphere(1, material: principled(roughness: 0.12))\nsky(luminance: 1)\nrender(bounces: 1)\n")
    test_general_kernels_draw_the_same_picture(monkeypatch, path, "ray")


@pytest.fixture
def without_special(monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """Specialised kernels count as not compiled until the list holds True."""
    monkeypatch.setenv(kernel_choice.VARIABLE, "auto")
    compiled: list[bool] = []
    prepared = prepare.prepare

    def prepare_or_refuse(scene: Any, plan: Any, view: Any, general: bool = False) -> Any:
        if not general and kernel_cache.must_be_compiled() and not compiled:
            raise kernel_cache.NotCompiled("a kernel")
        return prepared(scene, plan, view, general)

    monkeypatch.setattr(prepare, "prepare", prepare_or_refuse)
    return compiled


@pytest.mark.parametrize(("name", "samples", "seen"), [("hello", 2, 1), pytest.param("room", 16, 3, marks=pytest.mark.long)])
def test_a_picture_goes_on_with_specialised_kernels(
    monkeypatch: pytest.MonkeyPatch, without_special: list[bool], name: str, samples: int, seen: int
) -> None:
    """They are compiled by another process, and taken while the picture is drawn; `room` has photons, traced anew each round."""
    scene = ROOT / "examples" / f"{name}.scene"
    for kind in ("general", "special"):
        monkeypatch.setenv(kernel_choice.VARIABLE, kind)
        expected = draw(scene, samples=samples)
    monkeypatch.setenv(kernel_choice.VARIABLE, "auto")
    asked: list[Any] = []
    left = [seen]

    def is_compiling() -> bool:
        left[0] -= 1
        return left[0] > 0

    def run_later(key: str, function: Any, message: Callable[[], bytes]) -> Callable[[], bool]:
        asked.append((key, function))
        without_special.append(True)
        return is_compiling

    monkeypatch.setattr(compile_process, "run_later", run_later)
    choices: list[Any] = []
    choose = kernel_choice.choose_renderer
    monkeypatch.setattr(kernel_choice, "choose_renderer", lambda *given: choices.append(choose(*given)) or choices[-1])
    picture = draw(scene, samples=samples)
    assert asked == [("a kernel", kernel_choice.compile_special)]
    assert len(choices[0].used) == 2
    assert np.array_equal(np.asarray(picture), np.asarray(expected))


def test_without_general_kernels_this_process_compiles(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    scene = tmp_path / "ball.scene"
    scene.write_text(BALL)
    monkeypatch.setenv(kernel_choice.VARIABLE, "auto")
    calls: list[tuple[bool, bool]] = []
    prepared = prepare.prepare

    def prepare_or_refuse(scene: Any, plan: Any, view: Any, general: bool = False) -> Any:
        calls.append((general, kernel_cache.must_be_compiled()))
        if kernel_cache.must_be_compiled():
            raise kernel_cache.NotCompiled("a kernel")
        return prepared(scene, plan, view, general)

    monkeypatch.setattr(prepare, "prepare", prepare_or_refuse)
    draw(scene)
    assert calls == [(False, True), (True, True), (False, False)]


def test_other_values_of_the_variable_are_refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    scene = tmp_path / "ball.scene"
    scene.write_text(BALL)
    monkeypatch.setenv(kernel_choice.VARIABLE, "fast")
    with pytest.raises(SettingError, match="MAQUETTE_KERNELS is fast; it can be auto, special, general"):
        draw(scene)


def test_a_kernel_that_is_not_compiled_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    from maquette.render.jit.kernel import kernel

    @kernel
    def double(x):
        return 2 * x

    with kernel_cache.compiled_only(), pytest.raises(kernel_cache.NotCompiled, match="double"):
        double(1)
    assert not kernel_cache.must_be_compiled()


LATER = """
import sys, time
import maquette
from maquette.compiler import ir
from maquette.compiler.plan import plan as planner
from maquette.render.backends import kernel_choice
from maquette.render.jit import kernel_cache
from maquette.render.types import View

scene = maquette.load(sys.argv[1])
plan = planner.make_plan(scene, ir.Settings(size=(16, 12), samples=1, backend="raster"))
view = View(plan["camera"], *plan["size"])
kernel_choice.make_renderer(scene, plan, view, True)
kernel_choice.choose_renderer(scene, plan, view)
end = time.monotonic() + 120
while time.monotonic() < end:
    try:
        with kernel_cache.compiled_only():
            kernel_choice.make_renderer(scene, plan, view, False)
        print("compiled")
        break
    except kernel_cache.NotCompiled:
        time.sleep(0.1)
"""


@pytest.mark.long
def test_another_process_compiles_what_a_picture_needs(tmp_path: Path) -> None:
    """It gets the picture through a pipe, larger than the pipe holds; no file but kernels is written."""
    folders = {name: tmp_path / name for name in ("cache", "temporary")}
    for folder in folders.values():
        folder.mkdir()
    points = "points: [[k, mod(k, 7), 0] for k in 0..29999], faces: [[3 * k, 3 * k + 1, 3 * k + 2] for k in 0..9999]"
    (tmp_path / "a.scene").write_text(f"mesh({points})\n{BALL}", encoding="utf-8")
    environment = {**os.environ, "MAQUETTE_CACHE": str(folders["cache"]), "TMPDIR": str(folders["temporary"]), "MAQUETTE_KERNELS": "auto"}
    done = subprocess.run([sys.executable, "-c", LATER, str(tmp_path / "a.scene")], env=environment, capture_output=True, text=True)
    assert done.stdout == "compiled\n", done.stderr
    assert not list(folders["temporary"].iterdir())
