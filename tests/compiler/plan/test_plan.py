"""The plan: each decision taken from small scenes, its reason, its override, and the messages for what cannot be."""

from __future__ import annotations

import importlib.util
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.plan import picture_rules, plan, transport_rules
from maquette.compiler.plan.decision import DEFAULT_ERROR, Decision, Plan, denoises, error_asked


def scene(
    *lights: ir.LightKind, models: tuple[ir.MaterialModel, ...] = (), cameras: tuple[str, ...] = ("main",), aspect: float = 0.0
) -> ir.Scene:
    n = len(lights)
    tables = ir.empty_tables()._replace(
        lights=ir.table_of(
            "lights",
            {name: np.ones((n, *ir.column_type("lights", name)[1]), ir.column_type("lights", name)[0]) for name in ir.Lights._fields}
            | {"kind": [int(k) for k in lights]},
        ),
        materials=ir.table_of(
            "materials",
            {
                "model": [int(m) for m in models],
                "shading": [0] * len(models),
                "normalized": [False] * len(models),
                "values": [[{ir.Slot.DIFFUSE: [0.5] * 3, ir.Slot.OPACITY: [1, 0, 0]}.get(s, [0] * 3) for s in ir.Slot] for _ in models],
                "textures": [[-1] * ir.SLOTS for _ in models],
                "medium": [-1] * len(models),
            },
        ),
        cameras=ir.table_of(
            "cameras",
            {
                "projection": [0] * len(cameras), "aspect": [aspect] * len(cameras), "exposure": [math.nan] * len(cameras),
                "shutter": [0.0] * len(cameras), "lens": [0.0] * len(cameras), "focus": [1.0] * len(cameras),
                "pixel_aspect": [1.0] * len(cameras), "planes": np.zeros((len(cameras), ir.CLIP_PLANES, 4)),
            },
        ),
    )
    return ir.Scene("test", tables, names=ir.Names(cameras=cameras))


def test_point_lights_need_no_random_numbers_and_few_samples() -> None:
    made = plan.make_plan(scene(ir.LightKind.POINT, models=(ir.MaterialModel.LAMBERT,)), ir.Settings())
    assert made["area_lights"] is False
    assert made["samples"] == picture_rules.SAMPLES_SHARP
    assert made["bounces"] == 0
    assert made["background"] == "transparent"


def test_a_sky_is_soft_and_seen() -> None:
    made = plan.make_plan(scene(ir.LightKind.SKY, models=(ir.MaterialModel.LAMBERT,)), ir.Settings())
    assert made["area_lights"] is True
    assert (made["error"], made["samples"]) == (DEFAULT_ERROR, picture_rules.SAMPLES_MOST)
    assert made["background"] == "sky"
    assert "sky" in made.decisions["area_lights"].reason


def test_a_sky_that_lights_nothing_takes_no_random_numbers() -> None:
    made = plan.make_plan(scene(ir.LightKind.SKY), ir.Settings())
    assert made["area_lights"] is False
    assert made["monte_carlo"] is False
    assert made["samples"] == picture_rules.SAMPLES_SHARP
    assert "no surface is lit" in made.decisions["area_lights"].reason


def test_glass_takes_bounces_and_matt_things_interreflect_only_when_asked() -> None:
    built = scene(ir.LightKind.POINT, models=(ir.MaterialModel.GLASS, ir.MaterialModel.LAMBERT))
    made = plan.make_plan(built, ir.Settings())
    assert made["bounces"] == transport_rules.SPECULAR_BOUNCES
    assert made["interreflection"] is False
    asked = plan.make_plan(built, ir.Settings(bounces=3))
    assert (asked["bounces"], asked["interreflection"]) == (3, True)
    assert plan.make_plan(built, ir.Settings(bounces=0))["interreflection"] is False


def test_the_command_line_goes_before_the_scene() -> None:
    built = replace(scene(ir.LightKind.POINT), settings=ir.Settings(samples=4, seed=7))
    made = plan.make_plan(built, ir.Settings(samples=9))
    assert (made["samples"], made["seed"]) == (9, 7)


def test_an_error_or_a_budget_lets_samples_grow() -> None:
    assert plan.make_plan(scene(), ir.Settings(error=0.01))["samples"] == picture_rules.MAX_SAMPLES
    assert plan.make_plan(scene(), ir.Settings(budget=2.0))["samples"] == picture_rules.MAX_SAMPLES
    both = plan.make_plan(scene(), ir.Settings(error=0.01, samples=8))
    assert (both["samples"], both["error"]) == (8, 0.0)
    said = replace(scene(), settings=ir.Settings(samples=8))
    over = plan.make_plan(said, ir.Settings(error=0.01))
    assert (over["samples"], over["error"]) == (picture_rules.MAX_SAMPLES, 0.01)


def test_a_picture_without_samples_ends_at_the_default_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of random light on the ray backend. What 256 samples leave is denoised, where the package is there and nothing else is asked for."""
    soft, default = scene(ir.LightKind.SKY, models=(ir.MaterialModel.LAMBERT,)), (0.03, 256, "above_error")
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: True)

    def made(**asked: Any) -> tuple[float, int, str]:
        found = plan.make_plan(soft, ir.Settings(**asked))
        return found["error"], found["samples"], found["denoise"]

    assert made() == default
    assert made(backend="raster") == (0.0, 64, "off")
    assert made(samples=9) == (0.0, 9, "off")
    assert made(samples=9, denoise=True) == (0.0, 9, "on")
    assert made(denoise=True) == (0.03, 256, "on")
    assert made(denoise=False) == (0.03, 256, "off")
    assert made(error=0.03) == (0.03, picture_rules.MAX_SAMPLES, "off")
    assert made(budget=2.0) == (0.0, picture_rules.MAX_SAMPLES, "above_error")
    assert made(budget=2.0, denoise=False) == (0.0, picture_rules.MAX_SAMPLES, "off")
    assert made(budget=2.0, error=0.03)[2] == made(budget=2.0, samples=9)[2] == made(budget=2.0, backend="raster")[2] == "off"
    sharp = plan.make_plan(scene(ir.LightKind.POINT, models=(ir.MaterialModel.LAMBERT,)), ir.Settings())
    assert (sharp["error"], sharp["samples"], sharp["denoise"]) == (0.0, 16, "off")
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert made() == (0.03, 256, "off")


def test_the_default_and_a_budget_are_denoised_above_an_error() -> None:
    def plan_of(error: float, samples: int, denoise: str, budget: float = math.inf) -> Plan:
        values = {"error": error, "samples": samples, "denoise": denoise, "budget": budget}
        return Plan({name: Decision(name, value, "") for name, value in values.items()})

    assert [denoises(plan_of(0.03, 256, "above_error"), error) for error in (0.04, 0.03, None)] == [True, False, False]
    assert [denoises(plan_of(0.03, 256, "on"), error) for error in (0.04, 0.01, None)] == [True] * 3
    assert not denoises(plan_of(0.03, 256, "off"), 0.5)
    in_time = plan_of(0.0, picture_rules.MAX_SAMPLES, "above_error", budget=5.0)
    assert [denoises(in_time, error) for error in (0.04, 0.03, None)] == [True, False, True]
    assert not denoises(in_time, 0.04, partial=True)
    assert denoises(plan_of(0.03, 256, "on"), None, partial=True)
    assert [error_asked(plan_of(0.03, n, "off")) for n in (256, picture_rules.MAX_SAMPLES)] == [0.0, 0.03]


def test_the_film_sets_the_shape_of_the_picture() -> None:
    assert plan.make_plan(scene(), ir.Settings())["size"] == picture_rules.DEFAULT_SIZE
    assert plan.make_plan(scene(aspect=1.5), ir.Settings())["size"] == (960, 640)


def test_exposure_is_metered_only_where_light_has_units() -> None:
    assert plan.make_plan(scene(), ir.Settings())["exposure"] == 0.0
    assert plan.make_plan(replace(scene(), photometric=True), ir.Settings())["exposure"] == "metered"
    assert plan.make_plan(replace(scene(), photometric=True), ir.Settings(exposure=2.0))["exposure"] == 2.0


def test_every_decision_has_a_reason_and_a_switch() -> None:
    made = plan.make_plan(scene(ir.LightKind.SUN), ir.Settings())
    for decision in made.decisions.values():
        assert decision.reason
        if decision.fixed:
            with pytest.raises(plan.PlanError, match="is set by"):
                plan.make_plan(scene(), ir.Settings(), {decision.name: "1"})


def test_overrides() -> None:
    made = plan.make_plan(scene(), ir.Settings(), {"raster.coverage": "scanline", "tolerance": "0.5", "shadows": "on"})
    assert (made["raster.coverage"], made["tolerance"], made["shadows"]) == ("scanline", 0.5, True)
    assert made.decisions["raster.coverage"].overridden


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        ({"raster.coverag": "edges"}, "no decision is called `raster.coverag`; did you mean `raster.coverage`?"),
        ({"raster.coverage": "magic"}, "`raster.coverage` cannot be magic; it can be: edges, areas, scanline"),
        ({"tolerance": "-1"}, "`tolerance` cannot be -1; it can be: a positive number like 0.05"),
        ({"shadows": "maybe"}, "`shadows` cannot be maybe; it can be: on, off"),
        ({"samples": "3"}, "`samples` is set by --samples"),
    ],
)
def test_overrides_that_cannot_be(overrides: dict[str, str], message: str) -> None:
    with pytest.raises(plan.PlanError) as caught:
        plan.make_plan(scene(), ir.Settings(), overrides)
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (ir.Settings(camera="mian"), "no camera is called `mian`; the scene has: `main`. did you mean `main`?"),
        (
            ir.Settings(aov=("dept",)),
            "no channel is called `dept`; there are "
            "depth, normal, position, albedo, uv, id, transmittance, scatter_depth, "
            "variance, samples, cryptomatte, lights, issues. did you mean `depth`?",
        ),
        (ir.Settings(size=(10, 10), crop=(0, 0, 11, 5)), "the crop 0,0,11,5 does not lie inside the picture of 10x10 pixels"),
    ],
)
def test_settings_that_cannot_be(settings: ir.Settings, message: str) -> None:
    with pytest.raises(plan.PlanError) as caught:
        plan.make_plan(scene(), settings)
    assert str(caught.value) == message


def test_ambient_light_and_interreflection_are_warned_about() -> None:
    built = scene(ir.LightKind.AMBIENT, models=(ir.MaterialModel.LAMBERT,))
    assert plan.warnings(built, plan.make_plan(built, ir.Settings(bounces=2)))
    assert not plan.warnings(built, plan.make_plan(built, ir.Settings()))


def test_cameras_are_found_by_the_last_part_of_their_path() -> None:
    names = ("/World/main_cam", "/World/side")
    assert picture_rules.find_camera(names, "side") == 1
    assert picture_rules.find_camera(names, "/World/main_cam") == 0


def test_clipping_planes_are_drawn_by_rays_alone() -> None:
    made = scene(ir.LightKind.POINT)
    planes = np.zeros((1, ir.CLIP_PLANES, 4))
    planes[0, 0] = (1, 0, 0, 0)
    cameras = ir.table_of("cameras", {**made.tables.cameras._asdict(), "planes": planes})
    clipped = replace(made, tables=made.tables._replace(cameras=cameras))
    assert plan.make_plan(clipped, ir.Settings())["backend"] == "ray"
    with pytest.raises(plan.PlanError, match="the raster backend draws no pictures of cameras with clipping planes: write --backend ray"):
        plan.make_plan(clipped, ir.Settings(backend="raster"))


def test_photometric_pictures_roll_highlights_off() -> None:
    lit = replace(scene(), photometric=True)
    assert plan.make_plan(lit, ir.Settings())["view"] == "rolloff"
    assert plan.make_plan(lit, ir.Settings(exposure=-2.0))["view"] == "rolloff"
    assert plan.make_plan(lit, ir.Settings(view="standard"))["view"] == "standard"
    assert plan.make_plan(scene(), ir.Settings())["view"] == "sRGB"


def test_white_balance_is_as_asked_or_of_the_lights() -> None:
    assert plan.make_plan(scene(), ir.Settings())["white"] == 0.0
    assert plan.make_plan(scene(), ir.Settings(white=4000.0))["white"] == 4000.0
