"""Notes on emissive shapes whose light reaches nothing: by the plan, the kind of shape and the surfaces around it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from maquette.compiler import ir, load
from maquette.compiler.plan import plan as planner
from maquette.lang.diagnostics import render_text

Compile = Callable[..., ir.Scene]

FLOOR = "\nplane(y: 0, material: lambert(0.5))\n"
LAMP = "box(1, center: [0, 2, 0], material: emissive())"
LAMPS = f"for (k in 1..9) {{ translate([k, 0, 0]) {{ {LAMP} }} }}"
ONE = "this emits light, but lights other objects only with bounces"
ONE_RASTER = "this emits light, but raster lights no other objects with it"


def notes(scene: ir.Scene, plan: dict[str, str] | None = None, **settings: object) -> list[str]:
    made = planner.make_plan(scene, ir.Settings(**settings), plan)  # type: ignore[arg-type]
    return [note.message for note in planner.notes(scene, made)]


def test_the_note_is_at_the_shape_with_the_fix(compiled: Compile) -> None:
    (note,) = planner.default_notes(compiled(LAMP + FLOOR))
    hint = "render(bounces: 1) or --bounces 1, or more; area lights and round spheres of one color are sampled without"
    said = render_text(note, lambda name: Path(name).read_text(encoding="utf-8"))
    assert said.partition("a.scene:")[2] == f"1:1: note: {ONE}\n   1 | {LAMP}\n     | {'^' * len(LAMP)} {hint}"


@pytest.mark.parametrize("lights", ["", "sun()", "point([0, 3, 0])"])
def test_raster_lights_with_none(compiled: Compile, lights: str) -> None:
    scene = compiled(LAMP + FLOOR + lights + "\nrender(bounces: 4)")
    assert notes(scene) == notes(scene, backend="reference") == []
    (note,) = planner.notes(scene, planner.make_plan(scene, ir.Settings(backend="raster")))
    assert (note.message, str(note.span).rpartition("a.scene:")[2]) == (ONE_RASTER, "1:1")
    assert note.hint == "--backend ray with bounces draws that light; area lights and round spheres of one color light with raster, too"


def test_raster_with_bounces_does(compiled: Compile) -> None:
    scene, traced = compiled(LAMP + FLOOR), {"raster.secondary_rays": "trace"}
    assert notes(scene, traced, backend="raster", bounces=2) == []
    assert notes(scene, traced, backend="raster") == [ONE]


def test_several_shapes_are_one_note(compiled: Compile) -> None:
    scene = compiled(LAMPS + FLOOR)
    assert notes(scene) == ["this and 8 more shapes emit light, but light other objects only with bounces"]
    assert notes(scene, backend="raster") == ["this and 8 more shapes emit light, but raster lights no other objects with them"]
    scene = compiled(LAMP + f"\ntranslate([3, 0, 0]) {{ {LAMP} }}" + FLOOR)
    assert notes(scene, backend="raster") == ["this and 1 more shape emit light, but raster lights no other objects with them"]


def test_a_pattern_of_no_luminance_emits_nothing(compiled: Compile) -> None:
    dark = "box([1, 1, 1], material: principled(emission: checker(#ff0000, #00ff00), luminance: 0nit))\n"
    assert notes(compiled(dark + FLOOR)) == notes(compiled(dark + FLOOR), backend="raster") == []


EMITTING = ("principled(emission: #ff8000)", "emissive(checker(#ff0000, #00ff00))", "blend(emissive(), lambert())")


@pytest.mark.parametrize("material", EMITTING)
def test_every_material_that_emits(compiled: Compile, material: str) -> None:
    scene = compiled(f"box(1, center: [0, 2, 0], material: {material})" + FLOOR)
    assert notes(scene) == [ONE]
    assert notes(scene, bounces=1) == []
    assert notes(scene, bounces=1, backend="raster") == [ONE_RASTER]


@pytest.mark.parametrize(
    "text",
    [
        "sphere(1, center: [0, 2, 0], material: emissive())" + FLOOR,  # a light
        "area([0, 2, 0])" + FLOOR,
        LAMPS,  # nothing receives light
        "box(1, material: principled(emission: #ff8000))",  # but itself
        LAMP + "\nplane(y: 0, material: mirror())",  # the mirror shows it
        "box(1, material: emissive(#000))" + FLOOR,
        FLOOR,
    ],
)
def test_no_note_where_nothing_is_lost(compiled: Compile, text: str) -> None:
    scene = compiled(text)
    assert notes(scene) == notes(scene, backend="raster") == []


def test_bounces_of_glossy_surfaces_carry_the_light(compiled: Compile) -> None:
    scene = compiled(LAMP + FLOOR + 'sphere(1, material: metal("gold"))')
    assert notes(scene) == []
    assert notes(scene, bounces=0) == [ONE]


def test_settings_that_exclude_each_other_have_no_notes(compiled: Compile) -> None:
    scene = replace(compiled(LAMP + FLOOR), settings=ir.Settings(aov=("none of these",)))
    assert planner.default_notes(scene) == []


def test_mesh_lights_of_a_stage(tmp_path: Path) -> None:
    quad = "int[] faceVertexCounts = [4]\nint[] faceVertexIndices = [0, 1, 2, 3]"
    file = tmp_path / "a.usda"
    file.write_text(
        f'#usda 1.0\ndef Mesh "Floor" {{\n{quad}\npoint3f[] points = [(-2, 0, 2), (2, 0, 2), (2, 0, -2), (-2, 0, -2)]\n}}\n'
        f'def Mesh "Lamp" (prepend apiSchemas = ["MeshLightAPI"]) {{\n{quad}\n'
        "point3f[] points = [(-1, 2, -1), (1, 2, -1), (1, 2, 1), (-1, 2, 1)]\n}\n",
        encoding="utf-8",
    )
    scene = load.load(file)
    assert planner.default_notes(scene) == []
    (note,) = planner.notes(scene, planner.make_plan(scene, ir.Settings(bounces=0)))
    assert (note.message, str(note.span)) == (ONE, f"{file}</Lamp>")
    assert notes(scene, bounces=1) == []
    assert notes(scene, bounces=1, backend="raster") == [ONE_RASTER]
