"""Each kind of shape, light, material and texture alone in a scene, on each backend, and the emptiest scenes.

General kernels hold the code of every kind, and read the tables of all. In these scenes most tables are empty. Elsewhere a read of an empty
table finds zeros; here it ends the process, as with MAQUETTE_CHECKED=1. tools/matrix.py runs this file with bounds checks, with
specialised kernels, and at each instruction set.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum
from pathlib import Path
from typing import Any

import maquette
import numpy as np
import pytest
from maquette.compiler import ir, load
from maquette.compiler.plan import plan as planner
from maquette.render.jit import value_types
from maquette.render.render_scene import draw as draw_scene

from . import alone

SCENES = alone.every_scene()


@pytest.fixture(autouse=True)
def no_zeros(monkeypatch: pytest.MonkeyPatch) -> None:
    """An empty array has the address 0."""
    monkeypatch.setattr(value_types, "address_of_zeros", lambda: 0)


@pytest.fixture
def written(tmp_path: Path, picture: Callable[..., None]) -> Path:
    """The folder of the files that the scenes refer to."""
    v, u = np.mgrid[0:12, 0:16]
    texels = np.stack([0.1 + 0.05 * u, 0.1 + 0.07 * v, 0.5 + 0.4 * np.sin(u + v)], axis=-1)
    picture("a.exr", texels)
    picture("sky.exr", texels)
    (tmp_path / "light.usda").write_text(alone.LIGHT_USD, encoding="utf-8")
    for interpolation in ("constant", "uniform", "vertex", "faceVarying"):
        (tmp_path / f"{interpolation}.usda").write_text(alone.colored_mesh(interpolation), encoding="utf-8")
    return tmp_path


def draw(folder: Path, text: str, backend: str, bounces: int) -> np.ndarray:
    """(16, 24, 4) of a scene, by four samples a pixel."""
    path = folder / "a.scene"
    path.write_text(text, encoding="utf-8")
    scene = load.load(path)
    asked = ir.Settings(size=(24, 16), samples=4, threads=1, bounces=bounces, backend=backend)
    image = draw_scene(scene, planner.make_plan(scene, asked))
    assert image.metadata["issues"] == 0
    assert np.isfinite(image.channels["rgba"]).all()
    return np.asarray(image.channels["rgba"], np.float64)


@pytest.mark.parametrize("name", SCENES)
def test_rays_draw_direct_light_as_the_reference_does(written: Path, name: str) -> None:
    """Same rays, formulas and random numbers: few pixels differ, where rounding decides between lit and dark."""
    expected, found = (draw(written, SCENES[name], backend, 0) for backend in ("reference", "ray"))
    different = (np.abs(found - expected) > 2e-3 + 5e-3 * np.abs(expected)).any(axis=-1)
    assert different.mean() <= 0.05, np.argwhere(different)


@pytest.mark.parametrize("name", SCENES)
def test_paths_carry_as_much_light_as_the_reference(written: Path, name: str) -> None:
    """Of one bounce; both have noise."""
    expected, found = (draw(written, SCENES[name], backend, 1).mean(axis=(0, 1)) for backend in ("reference", "ray"))
    assert found == pytest.approx(expected, rel=0.25, abs=0.02)


@pytest.mark.parametrize("name", [name for name in SCENES if name != "projection PANORAMIC"])
def test_the_raster_draws_it(written: Path, name: str) -> None:
    for bounces in (0, 1):
        draw(written, SCENES[name], "raster", bounces)


@pytest.mark.long
def test_an_emitter_lights_a_floor(written: Path) -> None:
    """A shining shape as the only light: the floor beside it is lit."""
    for kind in alone.SHAPES:
        if kind != ir.GeometryKind.PLANE:
            lit = draw(written, SCENES[f"emitter {kind.name}"], "ray", 1)[..., :3]
            assert (lit[lit.max(axis=-1) < 2.9].max(initial=0.0)) > 0.01, kind.name


def _present(scene: Any) -> dict[type[IntEnum], Any]:
    """The members of each enumeration in the tables of a scene."""
    tables = scene.tables
    textures = tables.textures
    return {
        ir.GeometryKind: tables.geometries.kind,
        ir.LightKind: tables.lights.kind,
        ir.MaterialModel: tables.materials.model,
        ir.Shading: tables.materials.shading,
        ir.TextureKind: textures.kind,
        ir.TextureMapping: textures.mapping,
        ir.Wrap: textures.wrap_u,
        ir.FalloffKind: tables.lights.falloff,
        ir.Projection: tables.cameras.projection,
        ir.Interpolation: tables.attributes.interpolation,
    }


@pytest.mark.long
def test_every_member_has_a_scene(written: Path) -> None:
    """A member that is new needs a row in alone.py."""
    cases = {
        "shape": (ir.GeometryKind, alone.SHAPES), "light": (ir.LightKind, alone.LIGHTS), "material": (ir.MaterialModel, alone.MODELS),
        "shading": (ir.Shading, alone.SHADINGS), "slot": (ir.Slot, alone.SLOTS), "texture": (ir.TextureKind, alone.TEXTURES),
        "mapping": (ir.TextureMapping, alone.MAPPINGS), "wrap": (ir.Wrap, alone.WRAPS), "falloff": (ir.FalloffKind, alone.FALLOFFS),
        "projection": (ir.Projection, alone.PROJECTIONS), "colors": (ir.Interpolation, alone.INTERPOLATIONS),
    }  # fmt: skip
    for word, (members, texts) in cases.items():
        assert set(texts) == set(members), word
        for member in members:
            path = written / "a.scene"
            path.write_text(SCENES[f"{word} {member.name}"], encoding="utf-8")
            scene = maquette.load(path)
            tables = scene.tables
            if members is ir.Slot:
                used = (tables.materials.textures[:, member] >= 0) | tables.materials.values[:, member].any(axis=-1)
                assert used.any(), member.name
            else:
                assert member in set(_present(scene)[members].tolist()), f"{word} {member.name}"
