"""General and specialised kernels give the same pictures, and no picture waits for specialised ones where general ones are ready."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import maquette
import numpy as np
import pytest
from maquette.compiler.io.environment import SettingError
from maquette.render.backends import kernel_choice, prepare
from maquette.render.jit import kernel_cache

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
    return [pytest.param(*case, id=f"{case[0].stem}-{case[1]}", marks=marks[(case[0].stem, case[1]) in QUICK]) for case in every]


@pytest.mark.long
@pytest.mark.parametrize(("path", "backend"), pictures())
def test_general_kernels_draw_the_same_picture(monkeypatch: pytest.MonkeyPatch, path: Path, backend: str) -> None:
    images = []
    for kind in ("special", "general"):
        monkeypatch.setenv(kernel_choice.VARIABLE, kind)
        images.append(draw(path, backend=backend))
    special, general = map(np.asarray, images)
    assert np.array_equal(special, general)


SLABS = (
    "specular_roughness: 0.3", "base_metalness: 1, specular_roughness: 0.4, specular_rotation: 0.1", "coat_weight: 1, coat_roughness: 0.2",
    "fuzz_weight: 0.8", "transmission_weight: 1, specular_roughness: 0.2", "subsurface_weight: 0.5, geometry_thin_walled: true",
    "thin_film_weight: 0.7, thin_film_thickness: 0.4", "base_metalness: 1, specular_roughness: 0.4, specular_roughness_anisotropy: 0.7",
    "coat_weight: 0.5, coat_roughness: 0.3, coat_roughness_anisotropy: 0.7", "normal_map: checker(#8080ff, #9080f0)",
    "coat_weight: 1, geometry_coat_smooth: true, normal_map: checker(#8080ff, #9080f0)", "normal_map: flakes(5cm), base_metalness: 0.5",
)  # fmt: skip


@pytest.mark.parametrize("arguments", [pytest.param(each, marks=[pytest.mark.long] * (each != SLABS[0])) for each in SLABS])
def test_slabs_of_any_parts_are_equal(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, arguments: str) -> None:
    """General kernels have all parts, of films, lines and coats among others, which a scene may lack."""
    path = tmp_path / "a.scene"
    path.write_text(
        f"sphere(1, material: openpbr(#c06020, {arguments}))\nsky()\ncamera([0, 0.5, 4], look_at: [0, 0, 0])\nrender(bounces: 2)\n",
        encoding="utf-8",
    )
    test_general_kernels_draw_the_same_picture(monkeypatch, path, "ray")


def test_narrow_lobes_without_photons(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """General kernels split narrow lobes from their diffuse base only where photons light it."""
    path = tmp_path / "a.scene"
    path.write_text("sphere(1, material: principled(roughness: 0.12))\nsky(luminance: 1)\nrender(bounces: 1)\n")
    test_general_kernels_draw_the_same_picture(monkeypatch, path, "ray")


def test_general_kernels_are_taken_where_special_ones_are_not_on_disk(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """No process compiles specialised kernels for later: general ones are about as fast."""
    scene = tmp_path / "ball.scene"
    scene.write_text(BALL)
    monkeypatch.setenv(kernel_choice.VARIABLE, "auto")
    calls: list[bool] = []
    prepared = prepare.prepare

    def prepare_or_refuse(scene: Any, plan: Any, view: Any, general: bool = False) -> Any:
        calls.append(general)
        if not general:
            raise kernel_cache.NotCompiled("a kernel")
        return prepared(scene, plan, view, general)

    monkeypatch.setattr(prepare, "prepare", prepare_or_refuse)
    started: list[object] = []
    monkeypatch.setattr(subprocess, "Popen", lambda *args, **more: started.append(args))
    draw(scene)
    assert calls == [False, True]
    assert not started


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
