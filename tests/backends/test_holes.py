"""Opacity textures cut holes exactly where their formula says, at any distance; channels see through them."""

from __future__ import annotations

from pathlib import Path

import maquette
import numpy as np
import pytest

SIZE = (48, 36)
FLOOR = "plane(y: 0, material: lambert(opacity: pattern(|x, y, z| 0.5 + 0.5 * sin(9 * x)), opacity_threshold: 0.5))\n"
VIEW = "directional([1, 2, 1])\ncamera([-1.8, 1.3, 4.8], look_at: [0, 0.7, 0], fov: 45deg)\n"


def drawn(folder: Path, backend: str, text: str) -> dict[str, np.ndarray]:
    (folder / "a.scene").write_text(text + VIEW)
    return maquette.render(folder / "a.scene", size=SIZE, samples=1, backend=backend, aov=("id", "depth", "position")).channels


def test_stripes_are_cut_out_as_far_as_the_horizon(tmp_path: Path, backend: str) -> None:
    """Pixels span many stripes: a threshold of the mean is wrong there."""
    place = drawn(tmp_path, backend, "plane(y: 0)\n")
    solid = place["id"][..., 0] >= 0
    want = solid & (np.sin(9.0 * place["position"][..., 0].astype(float)) >= 0.0)
    near = np.abs(place["position"][..., 0]) < 1e3  # of float32
    found = drawn(tmp_path, backend, FLOOR)
    assert np.array_equal(found["rgba"][..., 3][near] > 0.5, want[near])
    assert np.array_equal(found["id"][..., 0][near] == 0, want[near])


def test_what_is_there_in_half_of_its_points_covers_half_of_far_pixels(tmp_path: Path, backend: str) -> None:
    """Stripes of opacity 0 and 1 without threshold: samples and footprint must not both average."""
    stripes = "pattern(|x, y, z| 0.5 + 0.5 * sign(sin(4000 * x)))"
    (tmp_path / "a.scene").write_text(f"plane(y: 0, material: lambert(opacity: {stripes}))\n{VIEW}")
    plan = {"texture_filter": "footprint"}
    picture = maquette.render(tmp_path / "a.scene", size=(96, 72), samples=1, backend=backend, background="transparent", plan=plan)
    rows = picture.channels["rgba"][36:, :, 3]  # each pixel has many stripes
    assert abs(rows.mean() - 0.5) < 0.05


@pytest.mark.long
def test_channels_tell_what_stands_behind_holes(tmp_path: Path, backend: str) -> None:
    """A box under the floor is visible through it; a half-transparent ball does not hide itself."""
    things = "box(0.5, translate: [0, -0.4, 0])\nsphere(1, center: [0, 1, 0], material: lambert(opacity: 0.5))\n"
    found, reference = (drawn(tmp_path, name, FLOOR + things) for name in (backend, "reference"))
    assert set(np.unique(reference["id"][..., 0])) == {-1.0, 0.0, 1.0, 2.0}
    assert np.array_equal(found["id"], reference["id"])
    assert np.allclose(found["depth"], reference["depth"], rtol=1e-5)


@pytest.mark.long
@pytest.mark.parametrize("name", ["reference", "ray"])
def test_a_formula_lets_as_much_pass_as_the_shape_that_it_is(tmp_path: Path, name: str) -> None:
    """Stochastic alpha on implicit surfaces: a path must not hit the same approximate root again."""
    veil = "material: lambert(0.5, opacity: 0.5)"
    balls = f"sphere(1, {veil})\n", f"implicit(|x, y, z| sqrt(x*x + y*y + z*z) + 0.0000001 * sin(x) <= 1, within: 1.1, {veil})\n"
    box = "box(0.8, translate: [0.5, 0, -1.6])\n"
    found = []
    for ball in balls:
        (tmp_path / "a.scene").write_text(ball + box + VIEW)
        found.append(maquette.render(tmp_path / "a.scene", size=SIZE, samples=8, backend=name, bounces=2))
    shape, formula = (image.channels["rgba"][..., :3].astype(float) for image in found)
    assert formula.mean() == pytest.approx(shape.mean(), rel=1e-3)
    assert np.mean(np.abs(formula - shape).max(axis=-1) > 1e-3) < 0.01


@pytest.mark.parametrize("background", ["sky", (0.5, 0.25, 1.0)])
def test_the_background_shines_once_through_a_veil(tmp_path: Path, backend: str, background: object) -> None:
    """A black veil of opacity 3/4 lets a quarter of the background pass."""
    veil = "triangle([[-1, 0, 0], [1, 0, 0], [0, 2, 0]], material: lambert(#000, opacity: 0.75))\n"
    (tmp_path / "a.scene").write_text(f"{veil}sky(color: #88f, luminance: 0.5)\n{VIEW}")
    found = maquette.render(tmp_path / "a.scene", size=(24, 18), samples=1, backend=backend, background=background).channels["rgba"]
    color = found[0, 0, :3] if background == "sky" else np.array(background)
    middle = found[9, 12]
    assert found[0, 0, :3] == pytest.approx(color, rel=1e-6)
    assert middle[3] == pytest.approx(0.75, abs=1e-6)
    assert middle[:3] == pytest.approx(0.25 * color, rel=1e-3)
