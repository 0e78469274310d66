"""Each light answers all that the stages ask of it, and its answers agree with each other."""

from __future__ import annotations

import inspect

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.catalogue import CATALOGUE
from maquette.compiler.scene.builder import SceneBuilder
from maquette.lights import LIGHTS, PLACED, PROFILED, SURFACES
from maquette.lights.contract import ExportedLight, Form, Light
from maquette.shapes.lanes import HELPERS

NAMES = sorted(name for name in Light.__annotations__)

lights = pytest.mark.parametrize("light", LIGHTS.values(), ids=lambda light: light.KIND.name.lower())


def lacking(light: object) -> list[str]:
    return [name for name in NAMES if not hasattr(light, name)]


def exported(light: Light) -> ExportedLight:
    axis, frame = np.array([0.0, 0.0, 1.0]), np.eye(4)
    size, color, angle = np.array([0.5, 0.25]), np.array([1.0, 2.0, 3.0]), 0.1 if light.HAS_ANGLE else 0.0
    return ExportedLight(0, light.KIND, "a", color, np.zeros(3), axis, 0.5, 0.4, angle, True, frame, size)


@lights
def test_a_light_answers_everything(light: Light) -> None:
    file = f"lights/{light.KIND.name.lower()}.py"
    assert not lacking(light), f"{file} lacks {', '.join(lacking(light))}"
    assert light.profile is None or light.profile in HELPERS, f"{file}: @helper is missing at profile"
    assert LIGHTS[light.KIND] is light


def test_an_answer_left_out_is_named() -> None:
    class Half:
        KIND = ir.LightKind.SPHERE

    assert {"FORM", "ELEMENTS", "profile", "usd", "mitsuba"} <= set(lacking(Half))
    assert "KIND" not in lacking(Half)


@lights
def test_the_answers_agree(light: Light) -> None:
    assert all(each.entry.category == "light" and CATALOGUE[each.entry.name] is each.entry for each in light.ELEMENTS)
    assert not light.HAS_ANGLE or light.FORM == Form.DISTANT
    assert not light.HAS_IMAGE or light.FORM == Form.SKY
    assert light.profile is None or light.KIND in PLACED, "a light far away has no axis that its emission depends on"
    assert light.widest is None or light.profile is not None
    assert not light.HAS_IMAGE or not inspect.isfunction(light.profile)


@lights
def test_exporters_have_a_form_of_it(light: Light) -> None:
    given = exported(light)
    if light.usd is not None:
        from pxr import UsdLux

        described = light.usd(given)
        prim = getattr(UsdLux, described.prim)
        assert all(hasattr(prim, f"Create{name}Attr") for name in described.attributes)
        assert all(hasattr(UsdLux.ShapingAPI, f"Create{name}Attr") for name in described.shaping)  # type: ignore[attr-defined]
    if light.gltf is not None:
        assert light.gltf(given).entry["type"] in ("point", "spot", "directional")
    if light.FORM in (Form.POINT, Form.DISTANT):
        assert light.povray is not None
        assert light.mitsuba is not None


@pytest.mark.parametrize("kind", PROFILED)
def test_a_profile_is_one_along_its_axis_and_none_beyond_its_widest_angle(kind: int) -> None:
    light = LIGHTS[kind]
    angles = np.linspace(0.0, np.pi, 181)
    columns = {"cos_cone": np.full(181, np.cos(0.7)), "cos_full": np.full(181, np.cos(0.5))}
    rows = SceneBuilder().finish().tables.lights._replace(**columns)
    share = np.asarray(light.profile(rows, np.arange(181), np.cos(angles)))  # type: ignore[misc]
    assert share[0] == pytest.approx(1.0)
    assert (share >= 0.0).all()
    widest = 0.5 * np.pi if kind in SURFACES else np.pi
    if light.widest is not None:
        widest = light.widest(rows, 0)
    assert np.abs(share[angles > widest + 1e-9]).max(initial=0.0) == pytest.approx(0.0, abs=1e-12)
