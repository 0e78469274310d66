"""Tests of path reuse: equal light, no leaks through walls, and lower error."""

from __future__ import annotations

import maquette
import numpy as np
import pytest
from maquette.compiler import load
from maquette.compiler.plan import plan as planner
from maquette.render.film import adaptive_sampling
from maquette.render.sampling import pixel_groups

ROOM = """
box([4, 3, 4], center: [0, 1.5, 0], material: lambert(0.7))
sphere(0.5, center: [0.8, 0.5, 0.3], material: lambert(rgb(0.8, 0.3, 0.2)))
box([0.5, 1.4, 0.5], center: [-0.8, 0.7, -0.4], rotate: [0, 25deg, 0], material: lambert(0.5))
camera(position: [0, 1.4, 1.8], look_at: [0, 0.8, 0], fov: 60deg)
"""
LAMPS = {
    "rectangle": "area([0, 2.6, 0], size: [1, 0.8], luminance: 8)\n",
    "point": "point([0.7, 2.5, 0.4], intensity: 9)\n",
    "shining things": (
        "sphere(0.2, center: [0, 2.5, 0], material: emissive(1, luminance: 20))\n"
        "polygon([[-1.4, 2.8, -0.4], [-0.8, 2.8, -0.4], [-1, 2.8, 0.5]], material: emissive(1, luminance: 12))\n"
    ),
}
SURFACES = """
polygon([[-1.9, 0.01, 1.9], [1.9, 0.01, 1.9], [1.9, 0.01, -1.9], [-1.9, 0.01, -1.9]],
  material: principled(checker(#b58b5e, #56402f, size: 30cm), roughness: 0.3))
box([0.6, 1.2, 0.6], center: [-0.2, 0.6, -1.3], material: principled(0.6, roughness: 0.5, clearcoat: 0.8))
sphere(0.3, center: [-0.3, 0.3, 0.6], material: phong(#3080c0, specular: 0.4, shininess: 20))
sphere(0.3, center: [0.3, 0.3, -0.6], material: principled(#ffe0a0, metallic: 1, roughness: 0.4))
sphere(0.3, center: [-1.3, 0.3, 0.9], material: principled(#601020, sheen: #ffc0d0, sheen_roughness: 0.4))
box([0.4, 0.4, 0.4], center: [-0.7, 1.7, 0.4], material: glass(1.3, roughness: 0.5))
box([0.3, 0.6, 0.3], center: [1.3, 1.5, -0.6], material: mirror(0.8))
polygon([[-1.99, 0.5, 1], [-1.99, 0.5, -1], [-1.99, 2.5, -1], [-1.99, 2.5, 1]],
  material: lambert(0.6, bump_map: pattern(|x, y, z| noise(8 * x, 8 * y, 8 * z)), bump_height: 0.03))
"""
TORUS = "torus(0.6, 0.15, center: [0, 1.2, 0], material: lambert(0.6))\n"  # in a tree


@pytest.fixture
def draw(tmp_path):
    def run(text, samples=16, seed=0, size=(32, 32), threads=1, crop=None, **plan):
        path = tmp_path / "a.scene"
        path.write_text(text, encoding="utf-8")
        plan = {name.replace("_", ".", 1): value for name, value in plan.items()}
        image = maquette.render(
            path, size=size, samples=samples, seed=seed, backend="ray", filter="box", threads=threads, plan=plan, crop=crop
        )
        assert image.metadata["issues"] == 0
        return image.channels["rgba"].astype(np.float64)[..., :3]

    return run


def compared(draw, text, seeds, **settings):
    """(pictures with path reuse, those without, z of the difference of means of 24 × 24 pixels): (seeds, 96, 96, 3) twice and (4, 4, 3)."""

    def runs(how, first):
        return np.stack([draw(text, seed=first + k, size=(96, 96), transport_path_reuse=how, **settings) for k in range(seeds)])

    shared, alone = runs("groups", 1), runs("none", 101)
    a, b = (pictures.reshape(seeds, 4, 24, 4, 24, 3).mean(axis=(2, 4)) for pictures in (shared, alone))
    return shared, alone, (a.mean(axis=0) - b.mean(axis=0)) / np.sqrt((a.var(axis=0, ddof=1) + b.var(axis=0, ddof=1)) / seeds)


@pytest.mark.long
@pytest.mark.parametrize("precision", ["float32", pytest.param("float64", marks=pytest.mark.long)])
@pytest.mark.parametrize("more", ["", TORUS], ids=["pieces", "tree"])
@pytest.mark.parametrize("lamp", LAMPS)
def test_it_is_the_light_that_each_pixel_finds_for_itself(draw, lamp, more, precision):
    """The means of parts of the picture, by z; several cells of pixels that share paths."""
    text = ROOM + more + LAMPS[lamp] + "render(bounces: 3)\n"

    shared, alone, z = compared(draw, text, 16, precision=precision)
    assert np.mean(z**2) < 2.2  # 1.07 for 30 degrees of freedom; by chance more once in 100 runs
    assert abs(shared.mean() / alone.mean() - 1.0) < 0.01


SUNLIT = """
polygon([[-2, 0, 2], [2, 0, 2], [2, 0, -2], [-2, 0, -2]], material: lambert(0.7))
polygon([[-2, 3, -2], [2, 3, -2], [2, 3, 2], [-2, 3, 2]], material: lambert(0.7))
polygon([[-2, 0, -2], [2, 0, -2], [2, 3, -2], [-2, 3, -2]], material: lambert(0.7))
polygon([[2, 0, -2], [2, 0, 2], [2, 3, 2], [2, 3, -2]], material: lambert(0.7))
polygon([[-2, 0, 2], [-2, 0, 0.5], [-2, 3, 0.5], [-2, 3, 2]], material: lambert(0.7))
polygon([[2, 0, 2], [-2, 0, 2], [-2, 3, 2], [2, 3, 2]], material: lambert(0.7))
sun(from: [-3, 3, 0.5], illuminance: 60)
sky(luminance: 8)
camera(position: [0, 1.4, 1.8], look_at: [0, 0.8, 0], fov: 60deg)
"""


@pytest.mark.long
def test_surfaces_of_all_kinds_keep_their_light(draw):
    """Highlights, coats, sheen, metal, glass, mirrors and bumps, which share nothing or their diffuse lobe alone."""
    text = SUNLIT + SURFACES + LAMPS["rectangle"] + "render(bounces: 3)\n"

    shared, alone, z = compared(draw, text, 24, indoors="on")
    assert np.mean(z**2) < 1.8  # 1.05 for 46 degrees of freedom
    assert abs(shared.mean() / alone.mean() - 1.0) < 0.02
    assert np.median(shared.var(axis=0)) < np.median(alone.var(axis=0))


@pytest.mark.long
@pytest.mark.parametrize("lamp", LAMPS)
def test_single_pixels_are_nearer_to_the_answer(draw, lamp):
    text = ROOM + LAMPS[lamp] + "render(bounces: 3)\n"
    error = [
        np.stack([draw(text, seed=k, transport_path_reuse=how) for k in range(6)]).var(axis=0, ddof=1).mean() for how in ("groups", "none")
    ]
    assert error[0] < 0.5 * error[1]


@pytest.mark.long
def test_errors_of_neighbors_are_independent(draw):
    """So neither squares nor the pattern of a group show, and means over pixels gain by path reuse as single pixels do."""
    text = ROOM + LAMPS["point"] + "render(bounces: 3)\n"
    found = {}
    for how in ("groups", "none"):
        pictures = np.stack([draw(text, seed=k, size=(64, 64), transport_path_reuse=how).mean(axis=-1) for k in range(8)])
        found[how] = pictures - pictures.mean(axis=0)
    errors = found["groups"] / found["groups"].std(axis=0)
    for axis in (1, 2):
        for distance in (1, 2, 4, 8):
            alike = np.moveaxis(errors * np.roll(errors, -distance, axis), axis, 0)[:-distance].mean()
            assert abs(alike) < 0.15, (axis, distance)
    means = {how: error.reshape(8, 16, 4, 16, 4).mean(axis=(2, 4)).var() for how, error in found.items()}
    assert means["groups"] < 0.6 * means["none"]


WALLS = {"piece": "box([0.02, 3, 4], center: [0, 1.5, 0], {})", "tree": "cylinder(0.02, 6, center: [0, 0, 0], scale: [1, 1, 120], {})"}


@pytest.mark.parametrize("wall", WALLS)
def test_nothing_comes_through_a_wall(draw, wall):
    """It halves a room that is open to the eye; one half has a lamp, and groups in the middle have pixels of both."""
    matt = "material: lambert(0.7))"
    text = f"""
polygon([[-2, 0, 2], [2, 0, 2], [2, 0, -2], [-2, 0, -2]], {matt}
polygon([[-2, 3, -2], [2, 3, -2], [2, 3, 2], [-2, 3, 2]], {matt}
polygon([[-2, 0, -2], [2, 0, -2], [2, 3, -2], [-2, 3, -2]], {matt}
polygon([[2, 0, -2], [2, 0, 2], [2, 3, 2], [2, 3, -2]], {matt}
polygon([[-2, 0, 2], [-2, 0, -2], [-2, 3, -2], [-2, 3, 2]], {matt}
{WALLS[wall].format("material: lambert(0.5)")}
area([1, 2.9, 0], size: [1, 0.8], luminance: 50)
camera(position: [0, 1.5, 6], look_at: [0, 1.5, 0], fov: 40deg)
render(bounces: 4)
"""
    found = draw(text, samples=4, size=(66, 48))
    assert found[:, :33].max() == 0.0
    assert found[:, 34:].mean() > 0.1


def test_a_crop_is_a_part_of_the_whole_on_any_number_of_threads(draw):
    text = ROOM + LAMPS["rectangle"] + "render(bounces: 3)\n"
    whole = draw(text, samples=2, size=(70, 45), threads=2)
    part = draw(text, samples=2, size=(70, 45), crop=(13, 5, 51, 38))
    assert np.array_equal(part, whole[5:38, 13:51])


def test_the_plan_says_where(tmp_path):
    def decided(text):
        path = tmp_path / "b.scene"
        path.write_text(text, encoding="utf-8")
        scene = load.load(path)
        return planner.make_plan(scene, scene.settings)

    text = ROOM + LAMPS["point"] + "render(bounces: 3)\n"
    for more in ("", SURFACES):
        assert decided(text + more)["transport.path_reuse"] == "groups"
    for more in ("lambert(0.5, opacity: 0.5)", 'lambert(0.5, shading: "gouraud")'):
        plan = decided(text + f"sphere(0.1, center: [0, 0.2, 0], material: {more})\n")
        assert plan["transport.path_reuse"] == "none", more
        assert "partly transparent, shaded at vertices" in plan.decisions["transport.path_reuse"].reason
    shiny = decided(text.replace("material: lambert(0.7)", "material: mirror(0.7)"))
    assert "has a diffuse lobe: other light depends on the direction" in shiny.decisions["transport.path_reuse"].reason
    assert decided(text.replace("bounces: 3", "bounces: 0"))["transport.path_reuse"] == "none"


@pytest.mark.long
def test_under_a_sky_rooms_alone_share_paths(tmp_path):
    def decided(text):
        path = tmp_path / "d.scene"
        path.write_text(text, encoding="utf-8")
        scene = load.load(path)
        return planner.make_plan(scene, scene.settings)

    inside = decided(SUNLIT + "render(bounces: 3)\n")
    assert inside["indoors"]
    assert inside["transport.path_reuse"] == "groups"
    ground = "plane(y: 0, material: lambert(0.5))\nsphere(0.5, center: [0, 0.5, 0])\nsky()\n"
    outside = decided(ground + "camera(position: [0, 1, 4])\nrender(bounces: 3)\n")
    assert not outside["indoors"]
    assert outside.decisions["indoors"].reason == "places around the camera see the sky in 50 % of all directions"
    assert outside.decisions["transport.path_reuse"].reason == "outdoors most noise comes from the light samples of first surfaces"


def test_cells_are_the_pictures():
    """Of a crop from column 3 and row 6 the first cells are one column wide and two rows high."""
    cells = adaptive_sampling.Cells((3, 6, 10, 13), 4)
    values = np.arange(49.0).reshape(7, 7)
    means = cells.means(values)
    assert means.shape == (3, 3)
    assert means[0, 0] == values[:2, :1].mean()
    assert means[1, 1] == values[2:6, 1:5].mean()
    assert means[2, 2] == values[6:, 5:].mean()
    spread = cells.spread(means)
    assert spread.shape == values.shape
    assert np.array_equal(cells.means(spread), means)


@pytest.mark.long
def test_pixels_of_a_cell_take_the_same_samples_where_an_error_is_asked_for(tmp_path):
    path = tmp_path / "c.scene"
    path.write_text(ROOM + LAMPS["rectangle"] + "render(bounces: 3)\n", encoding="utf-8")
    crop = (3, 2, 141, 99)
    image = maquette.render(path, size=(160, 100), crop=crop, error=0.05, backend="ray", aov=("samples",), threads=1)
    taken = image.channels["samples"][..., 0]
    assert image.metadata["error"] <= 0.05
    assert np.ptp(taken) > 0
    x, y = (np.arange(crop[k], crop[k + 2]) // pixel_groups.CELL for k in (0, 1))
    for row in np.unique(y):
        for column in np.unique(x):
            assert np.ptp(taken[y == row][:, x == column]) == 0
