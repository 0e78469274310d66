"""The light of a reference and the resulting sweeps."""

from __future__ import annotations

from pathlib import Path

import maquette
import pytest
from maquette.compiler import ir
from maquette.compiler.plan import plan as planner
from maquette.measure.chart import reference_light, setting_sweeps
from maquette.render import quality_settings as declared

CAMERA = "camera(position: [0, 1, 5], look_at: [0, 1, 0])\npoint([0, 3, 3], intensity: 9)\n"
MATT = CAMERA + "sphere(1, center: [0, 1, 0], material: lambert(#808080))\n"  # albedo 0.216
WHITE = CAMERA + "sphere(1, center: [0, 1, 0], material: lambert(0.9))\n"
GLASS = MATT + "sphere(0.2, center: [0, 0.2, 2], material: glass(ior: 1.5))\n"
AMBIENT = "ambient(#ffffff, luminance: 0.1)\n"
DEEP = "render(bounces: 3)\n"


def load(text: str, folder: Path) -> ir.Scene:
    path = folder / "a.scene"
    path.write_text(text, encoding="utf-8")
    return maquette.load(path)


@pytest.mark.parametrize(
    ("text", "bounces", "depth", "between", "how"),
    [
        (MATT, None, 8, True, "interreflection to 8 bounces"),
        (MATT + DEEP, None, 8, True, "interreflection to 8 bounces"),
        (WHITE, None, 32, True, "interreflection to 32 bounces"),
        (GLASS, None, 16, True, "interreflection to 16 bounces"),
        (MATT + AMBIENT, None, 0, False, "interreflection: none between matt surfaces: ambient light stands for it"),
        (MATT + AMBIENT + DEEP, None, 0, False, "interreflection: none between matt surfaces: ambient light stands for it"),
        (GLASS + AMBIENT, None, 16, False, "16 bounces at mirrors and glass, none between matt surfaces: ambient light stands for it"),
        (MATT, 2, 2, True, "2 bounces, as asked for, matt surfaces too"),
        (MATT, 0, 0, False, "0 bounces, as asked for"),
        (CAMERA + "sphere(1, material: emissive(#ffffff))\n", None, 0, False, "light as it is emitted"),
        (CAMERA + "sphere(1, material: mirror())\n", None, 16, False, "16 bounces at mirrors and glass"),
    ],
)
def test_the_light_of_the_reference(text: str, bounces: int | None, depth: int, between: bool, how: str, tmp_path: Path) -> None:
    scene = load(text, tmp_path)
    light = reference_light.choose(scene, ir.Settings(bounces=bounces))
    plan = light.plan(scene)
    assert (plan["bounces"], plan["interreflection"], light.how) == (depth, between, how)


def of(scene: ir.Scene, backend: str, **settings: object) -> dict[str, setting_sweeps.Sweep]:
    found = setting_sweeps.sweeps(scene, reference_light.choose(scene, ir.Settings(**settings)), backend)  # type: ignore[arg-type]
    return {sweep.name: sweep for sweep in found}


@pytest.fixture
def no_denoiser(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(declared, "can_denoise", lambda: False)


def test_where_there_is_a_denoiser_its_samples_have_a_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(declared, "can_denoise", lambda: True)
    denoised = of(load(MATT, tmp_path), "ray")["denoised samples, 8 bounces"]
    assert denoised.settings[0].arguments() == "--backend ray --denoise --samples 4 --bounces 8"


@pytest.mark.usefixtures("no_denoiser")
def test_a_scene_without_interreflection_of_its_own(tmp_path: Path) -> None:
    scene = load(MATT, tmp_path)
    ray = of(scene, "ray")
    assert list(ray) == ["samples, 8 bounces", "samples", "error, 8 bounces", "bounces"]
    assert ray["samples, 8 bounces"].settings[2].arguments() == "--backend ray --samples 16 --bounces 8"
    assert ray["samples"].settings[2].arguments() == "--backend ray --samples 16"
    assert ray["error, 8 bounces"].settings[-1].arguments() == "--backend ray --error 0.3% --bounces 8"
    assert [s.arguments() for s in ray["bounces"].settings] == [f"--backend ray --samples 64 --bounces {n}" for n in (0, 1, 2, 4)]
    assert {name: sweep.light for name, sweep in ray.items()} == {
        "samples, 8 bounces": "", "samples": "no interreflection", "error, 8 bounces": "", "bounces": "no more than 4 bounces of 8",
    }  # fmt: skip
    raster = of(scene, "raster")
    assert list(raster) == ["samples", "tolerance"]
    assert {sweep.light for sweep in raster.values()} == {"no interreflection"}
    assert raster["tolerance"].settings[0].arguments() == "--backend raster --samples 64 --plan tolerance=3.2"


@pytest.mark.usefixtures("no_denoiser")
def test_when_bounces_are_asked_for_all_take_them(tmp_path: Path) -> None:
    scene = load(MATT, tmp_path)
    assert [sweep.settings[0].arguments() for sweep in of(scene, "ray", bounces=2).values()] == [
        "--backend ray --samples 1 --bounces 2", "--backend ray --error 30% --bounces 2",
    ]  # fmt: skip
    assert {sweep.light for sweep in of(scene, "raster", bounces=2).values()} == {"no interreflection"}
    assert {sweep.light for sweep in of(scene, "raster", bounces=0).values()} == {""}


def test_interreflection_beside_ambient_light_shows_as_what_it_is(tmp_path: Path) -> None:
    found = of(load(MATT + AMBIENT + DEEP, tmp_path), "ray")
    assert [(name, sweep.light) for name, sweep in found.items()] == [
        ("samples", ""), ("samples, 3 bounces", "interreflection counted beside the ambient light"), ("error", ""),
    ]  # fmt: skip
    assert found["samples"].settings[0].arguments() == "--backend ray --samples 1 --bounces 0 --plan interreflection=off"
    assert found["samples, 3 bounces"].settings[0].arguments() == "--backend ray --samples 1"


def test_shared_overrides_are_on_every_step(tmp_path: Path) -> None:
    scene = load(GLASS + AMBIENT, tmp_path)
    light = reference_light.choose(scene, ir.Settings(), {"filter": "box"})
    assert light.plan(scene)["filter"] == "box"
    for backend in declared.QUALITY_SETTINGS:
        for sweep in setting_sweeps.sweeps(scene, light, backend):
            assert all(setting.plan["filter"] == "box" for setting in sweep.settings)
    ray = {sweep.name: sweep for sweep in setting_sweeps.sweeps(scene, light, "ray")}
    assert ray["samples, 16 bounces"].settings[0].arguments() == (
        "--backend ray --samples 1 --bounces 16 --plan filter=box --plan interreflection=off"
    )


@pytest.mark.parametrize("text", [MATT, GLASS, GLASS + AMBIENT, MATT + DEEP])
def test_every_step_has_a_plan_and_a_higher_cost(text: str, tmp_path: Path) -> None:
    scene = load(text, tmp_path)
    light = reference_light.choose(scene, ir.Settings(size=(40, 30)))
    for backend, made in declared.QUALITY_SETTINGS.items():
        assert [
            knob.name for knob in made if not all(knob.cost(a) < knob.cost(b) for a, b in zip(knob.values, knob.values[1:], strict=False))
        ] == []
        for sweep in setting_sweeps.sweeps(scene, light, backend):
            assert len(sweep.costs) == len(sweep.settings) > 1
            for setting in sweep.settings:
                planner.make_plan(scene, ir.Settings(**setting.options), setting.plan)
