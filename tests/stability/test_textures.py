"""Places 23 and 24: coordinates just left of 0, seams and poles, and footprints a thousand times as long as wide."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from maquette.compiler import ir
from maquette.compiler.scene.row_records import TextureData

from ..files import write_image
from ..render.texture.test_textures import at
from . import naive

W = ir.Wrap
COLUMNS = np.repeat(np.arange(16, dtype=float)[None, :, None], 3, axis=2).repeat(8, axis=0)  # every texel holds its column
ROW = np.concatenate([COLUMNS, np.ones((8, 16, 1))], axis=2)


def column(u: np.ndarray, wrap: ir.Wrap = W.REPEAT) -> np.ndarray:
    """The column of the texel that is looked up at u, no interpolation."""
    texture = TextureData(ir.TextureKind.IMAGE, image=0, nearest=True, wrap_u=wrap, wrap_v=W.CLAMP)
    return at(texture, u, np.full_like(u, 0.5), picture=ROW)[:, 0]


def test_just_left_of_zero(measured):
    u = np.array([-1e-9, -1e-12, -2.0**-40, -1e-300])
    plain, ours = naive.texel(u, 16), column(u)
    measured.place(
        23, "u = −10⁻⁹ in a repeated picture of 16 columns", naive=f"the f32 fraction is 1: column {plain[0]} of 0 … 15",
        ours=f"column {ours[0]:g}", bound="15",
    )  # fmt: skip
    assert plain[0] == 16
    assert (ours[:3] == 15).all()
    assert 0 <= ours[3] <= 15


@pytest.mark.long
@given(st.floats(-1e6, 1e6), st.integers(0, 40))
@settings(max_examples=200, deadline=None)
def test_any_coordinate_has_a_column(u, power):
    """Beside a whole number, by a power of two: never outside of the picture, and the right column where float64 holds it."""
    near = np.array([u, math.floor(u) - 2.0**-power, float(math.floor(u))])
    found = column(near)
    assert ((found >= 0) & (found <= 15)).all()
    assert found[2] == 0
    if 2.0**-power > np.spacing(abs(u) + 1) and power > 4:
        assert found[1] == 15


SHAPES = ["sphere(1", "torus(0.8, 0.3", "cylinder(1, 1.5", "cone(1, 1.5", "capsule(0.5, 1", "disk(1"]
VIEWS = {"seam": ("[0, 0, -5]", "[0, 1, 0]"), "north pole": ("[0, 5, 0]", "[0, 0, 1]"), "south pole": ("[0, -5, 0]", "[0, 0, 1]")}


@pytest.mark.long
@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("mapping", ["uv", "latlong", "projected"])
def test_seams_and_poles_are_finite(draw, tmp_path, view, mapping):
    """An odd number of pixels looks exactly into the seam and the poles; `draw` sees that all is finite."""
    write_image(tmp_path / "a.exr", np.random.default_rng(1).uniform(0.1, 1, (8, 16, 3)).astype(np.float32))
    position, up = VIEWS[view]
    for shape in SHAPES:
        text = f"camera(position: {position}, look_at: [0, 0, 0], up: {up}, width: 2.2)\n"
        text += f'{shape}, material: emissive(image("a.exr", mapping: "{mapping}")))\n'
        pictures = [draw(text, backend, size=(21, 21)).channels["rgba"] for backend in ("raster", "ray")]
        seen = (pictures[0][..., 3] == 1) & (pictures[1][..., 3] == 1)
        assert pictures[1][seen].min(initial=1) > 0.05
        assert seen.any() or shape.startswith("disk")


# --- 24: long footprints -----------------------------------------------------------------------------------------------------------


def grazing(draw, backend: str, samples: int, textures: str = "footprint", rows: int = 3, turned: float = 0.0) -> np.ndarray:
    """The first rows below the horizon of a checker floor of 1 cm cells: there a pixel sees some 1 m by 1 km of it."""
    down = math.tan(math.radians(1)) + 0.0005
    text = f"camera(position: [0.3, 1, 0.2], look_at: [0.3, {1 - down!r}, -0.8], fov: 2deg)\n"
    text += f"plane(y: 0, rotate: [0, {turned}deg, 0], material: emissive(checker(#fff, #000, size: 1cm)))\n"
    drawn = draw(text, backend, {"texture_filter": textures}, size=(64, 64), crop=(0, 1, 64, 1 + rows), samples=samples)
    return drawn.channels["rgba"][..., 0].astype(float)


@pytest.mark.parametrize("backend", ["raster", "ray"])
def test_a_footprint_of_a_thousand_to_one(measured, draw, backend):
    plain = float(np.abs(grazing(draw, backend, 64, "point") - 0.5).max() * 255)
    ours = max(float(np.abs(grazing(draw, backend, n, turned=turned) - 0.5).max() * 255) for n, turned in [(1, 0), (1, 31), (64, 0)])
    if backend == "ray":
        measured.place(
            24, "a checker floor of 1 cm at the horizon, 1000 : 1", naive=f"64 samples at points: off by up to {plain:.0f}/255",
            ours=f"1 and 64 samples: off by up to {ours:.2g}/255", bound="0.5 ± 1/255",
        )  # fmt: skip
    assert plain > 10
    assert ours <= 1


@pytest.mark.parametrize("backend", ["raster", "ray"])
def test_the_mean_at_the_horizon_is_half(draw, backend):
    """By samples at points: only noise, no bias."""
    seen = grazing(draw, backend, 256, "point", rows=8)
    assert abs(seen.mean() - 0.5) < 4 * seen.std(ddof=1) / math.sqrt(seen.size)
