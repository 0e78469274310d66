"""Light meters against closed forms: every reading lies within its error, and the error is small."""

from __future__ import annotations

import math

import maquette
import pytest
from maquette.compiler import ir
from maquette.lang.diagnostics import Diagnostics
from maquette.measure.light import illuminance, sensors
from maquette.measure.light.replicates import Effort

SHEET = "mesh(points: [[-1, 0, -1.5], [-1, 0, 1.5], [1, 0, 1.5], [1, 0, -1.5]], faces: [[0, 1, 2, 3]]"
FLOOR = "box(size: [40, 1, 40], center: [0, -0.5, 0], material: lambert(0))\n"


def read(text: str, error: float = 0.01) -> list[illuminance.Reading]:
    scene = maquette.load_text(text, diagnostics=Diagnostics())
    return illuminance.read(scene, scene.meters, Effort(error))[0]


def check(found: illuminance.Value | None, right: float, most: float = 0.011) -> None:
    assert found is not None
    assert abs(found.value - right) <= found.error, (found, right)
    assert found.error <= most * right


def configuration_factor(a: float, b: float, c: float) -> float:
    """From a point to a parallel rectangle a by b at the distance c, one of whose corners lies over the point (Howell, B-3)."""
    x, y = a / c, b / c
    u, v = math.hypot(1.0, x), math.hypot(1.0, y)
    return (x / u * math.atan(y / u) + y / v * math.atan(x / v)) / (2.0 * math.pi)


def test_a_point_light_by_the_inverse_square_and_the_cosine() -> None:
    under, beside = read(FLOOR + "point([0, 2, 0], flux: 1000lm)\nmeter()\nmeter([1.5, 0, 0])")
    check(under.mean, 1000 / (4 * math.pi) / 4, 2e-4)
    check(beside.mean, 1000 / (4 * math.pi) * 2 / 2.5**3, 2e-4)
    assert under.flux is None
    assert under.least is None


def test_a_rectangle_of_light() -> None:
    reading = read(FLOOR + "area([0.5, 1.5, 1], size: [1, 2], luminance: 500nit)\nmeter()")[0]
    check(reading.mean, math.pi * 500 * configuration_factor(1, 2, 1.5))


def test_a_disk_and_a_ball_of_light() -> None:
    disk = read(FLOOR + 'area([0, 2, 0], size: 1.2, shape: "disk", luminance: 500nit)\nmeter()')[0]
    check(disk.mean, math.pi * 500 * 0.36 / (0.36 + 4))
    ball = read(FLOOR + "translate([0, 2, 0]) { sphere(0.5, material: emissive(#ffffff, luminance: 500nit)) }\nmeter()")[0]
    check(ball.mean, math.pi * 500 * 0.25 / 4)


def test_a_tiny_lamp() -> None:
    text = "translate([0, 2, 0]) { sphere(0.5mm, material: emissive(#ffffff, luminance: 1e8nit)) }\nmeter()"
    check(read(FLOOR + text)[0].mean, math.pi * 1e8 * (0.0005 / 2) ** 2)


def test_an_even_sky_and_the_overcast_sky_of_the_cie() -> None:
    even, down = read("sphere(0.01, center: [0, -5, 0])\nsky(luminance: 1000nit)\nmeter()\nmeter([0, 1, 0], facing: [0, -1, 0])")
    check(even.mean, math.pi * 1000)
    check(down.mean, math.pi * 1000)
    dome = "dome(pattern: |x, y, z| if y > 0 then (1 + 2 * y) / 3 else 0, luminance: 9000nit)"
    check(read(f"sphere(0.01, center: [0, -5, 0])\n{dome}\nmeter()")[0].mean, 7 / 9 * math.pi * 9000)


def test_a_sun_at_infinity() -> None:
    reading = read(FLOOR + SUN)[0]
    check(reading.mean, 80000 * math.cos(math.radians(60)))


SUN = "directional([1.7320508, 1, 0], illuminance: 80000lx)\nmeter(size: 1)"


def test_an_integrating_sphere_by_its_walls() -> None:
    text = 'sphere(2, name: "ball", material: lambert(0.8))\npoint([0, 0.3, 0], flux: 1000lm)\nmeter(on: ["ball"], side: "back")'
    reading = read(text)[0]
    area = 16 * math.pi
    check(reading.mean, 1000 / area / (1 - 0.8), 0.02)
    check(reading.flux, 1000 / (1 - 0.8), 0.03)


def test_light_beyond_the_limit_on_bounces_is_in_the_error() -> None:
    text = 'sphere(1, name: "ball", material: lambert(0.98))\npoint([0, 0, 0], flux: 100lm)\nmeter(on: ["ball"], side: "back")'
    check(read(text, 0.03)[0].mean, 100 / (4 * math.pi) / 0.02, 0.5)


@pytest.mark.parametrize("color", [0.7, 0.9])
def test_light_of_many_collisions_in_a_body_is_in_the_value_or_the_error(color: float) -> None:
    """64 bounces gave 0.82 of the light for 0.9. The colour of a body is its albedo within 0.5 %."""
    body = f"box([200, 20, 200], center: [0, -11, 0], material: subsurface(rgb({color}, {color}, {color}), radius: 2cm))"
    mean = read(f"directional(from: [0, 1, 0], illuminance: 100lx)\n{body}\nmeter([0, -0.5, 0], facing: [0, -1, 0])")[0].mean
    assert abs(mean.value - 100 * color) <= mean.error + 0.5 * color, mean
    assert mean.error < 6.0 * color


@pytest.mark.parametrize("far", [0, 50, 5000])
def test_a_scene_far_from_the_origin(far: int) -> None:
    floor = f"box(size: [10, 1, 10], center: [{far}, -0.5, {far}], material: lambert(0))"
    reading = read(f"{floor}\npoint([{far}, 2, {far}], flux: 1000lm)\nmeter([{far}, 0, {far}])")[0]
    check(reading.mean, 1000 / (4 * math.pi) / 4, 5e-4)


def test_bounces_alone() -> None:
    """A small black ball hides the lamp of an integrating sphere from a place on its wall, which the walls alone light."""
    text = "sphere(2, material: lambert(0.5))\nsphere(0.02, center: [0, -1, 0], material: lambert(0))\n"
    text += "point([0, 0, 0], flux: 1000lm)\nmeter([0, -1.999, 0])"
    check(read(text)[0].mean, 1000 * 0.5 / (16 * math.pi * (1 - 0.5)), 0.02)


def test_the_flux_through_a_closed_box_is_that_of_its_lamp() -> None:
    sides = [(axis, sign) for axis in range(3) for sign in (-1, 1)]
    meters = []
    for axis, sign in sides:
        center, facing = [0.0] * 3, [0.0] * 3
        center[axis], facing[axis] = float(sign), float(-sign)
        meters.append(f"meter({center}, facing: {facing}, size: 2, grid: [8, 8])")
    lamp = "translate([0.3, 0.2, -0.1]) { sphere(0.1, material: emissive(#ffffff, luminance: 5000nit)) }"
    readings = read("\n".join([lamp, *meters]), 0.003)
    fluxes = [reading.flux for reading in readings if reading.flux]
    total = illuminance.Value(sum(flux.value for flux in fluxes), math.hypot(*(flux.error for flux in fluxes)))
    check(total, math.pi * 5000 * 4 * math.pi * 0.01)


def test_light_that_a_diffuse_wall_reflects() -> None:
    """After CIE 171:2006, 5.6: a lit diffuse rectangle lights a point opposite to it by ρ E times the configuration factor."""
    text = SHEET + ", material: lambert(0.6))\ndirectional([0, 1, 0], illuminance: 1000lx)\nmeter([0, 1.2, 0], facing: [0, -1, 0])"
    check(read(text)[0].mean, 0.6 * 1000 * 4 * configuration_factor(1, 1.5, 1.2))


def test_a_grid_has_its_least_and_greatest_and_uniformity() -> None:
    reading = read(FLOOR + "point([0, 2, 0], flux: 1000lm)\nmeter(size: [4, 2], grid: [5, 3])")[0]
    assert reading.cells.shape == (3, 5)
    check(reading.mean, 1000 / (4 * math.pi) * 4 * math.atan(2 / 2 / 3) / 8)
    assert reading.least
    assert reading.most
    assert reading.uniformity
    assert reading.cells.min() == reading.least.value
    assert reading.cells.max() == reading.most.value
    assert reading.uniformity.value == pytest.approx(reading.least.value / reading.mean.value)
    assert reading.area == pytest.approx(8.0)
    assert reading.flux
    assert reading.flux.value == pytest.approx(8.0 * reading.mean.value)


def test_cells_lie_along_the_edges_of_the_meter() -> None:
    """The first cell is the one at the least x and z of the meter's frame."""
    reading = read(FLOOR + "point([-2, 0.5, -1], flux: 1000lm)\nmeter(size: [4, 2], grid: [4, 2])")[0]
    assert reading.cells.argmax() == 0


def test_units_and_blocks_place_and_scale_a_meter() -> None:
    plain = read(FLOOR + "point([0, 2, 0], flux: 1000lm)\nmeter([1, 0, 0], size: [2, 1], grid: [2, 2])")[0]
    text = "unit cm\nbox(size: [4000, 100, 4000], center: [0, -50, 0], material: lambert(0))\npoint([0, 200, 0], flux: 1000lm)\n"
    text += "translate([100, 0, 0]) { scale([2, 5, 1]) { meter(size: 100, grid: [2, 2]) } }"
    scaled = read(text)[0]
    check(scaled.mean, plain.mean.value, 2e-3)
    assert scaled.area == pytest.approx(2.0)


def test_no_light_reaches_a_meter_in_a_wall_behind_the_lamp_or_in_a_closed_box() -> None:
    text = """
        box(size: [1, 1, 1], center: [3, 0.5, 0])
        box(size: [2, 2, 2], center: [-4, 1, 0])
        area([0, 2, 0], size: 1, flux: 1000lm)
        meter([3, 0.5, 0], name: "in a wall")
        meter([-4, 1, 0], size: 1, grid: [2, 2], name: "in a box")
        meter([0, 3, 0], facing: [0, 1, 0], name: "behind")
    """
    scene = maquette.load_text(text)
    readings, told = illuminance.read(scene, scene.meters, Effort())
    assert [reading.mean for reading in readings] == [(0.0, 0.0)] * 3
    assert [str(d.message) for d in told] == [
        "no light reaches the meter `in a wall`", "no light reaches the meter `in a box`", "no light reaches the meter `behind`",
    ]  # fmt: skip
    assert readings[1].uniformity is None


def test_a_meter_on_a_surface_and_one_above_it_agree() -> None:
    text = SHEET + ', name: "table")\npoint([0.5, 1, 0], flux: 1000lm)\nmeter(on: ["table"])\nmeter(size: [2, 3])\n'
    bound, free = read(text + 'meter(on: ["table"], side: "back")')[:2]
    check(bound.mean, free.mean.value, 0.02)
    assert bound.area == pytest.approx(6.0)


def test_meters_back_to_back_do_not_see_each_other() -> None:
    text = "sphere(0.01, center: [9, 9, 9])\npoint([0, 1, 0], intensity: 100cd)\n"
    up, down = read(text + "meter(size: 0.01)\nmeter(size: 0.01, facing: [0, -1, 0])")
    check(up.mean, 100, 0.02)
    assert down.mean.value == 0.0


def test_a_meter_costs_a_picture_nothing() -> None:
    text = FLOOR + "point([0, 2, 0], flux: 1000lm)"
    plain, metered = maquette.load_text(text), maquette.load_text(text + "\nmeter(size: 3)")
    for table in ir.TABLES:
        for before, after in zip(getattr(plain.tables, table), getattr(metered.tables, table), strict=True):
            assert before.tobytes() == after.tobytes()


def test_small_lights_behind_glass_are_told() -> None:
    text = FLOOR + "sphere(0.3, center: [0, 0.5, 0], material: glass())\npoint([0, 2, 0], flux: 1000lm)\nmeter()"
    scene = maquette.load_text(text)
    told = illuminance.read(scene, scene.meters, Effort())[1]
    assert told[0].message == (
        "small lights shine through glass or off mirrors here: paths find that light by chance, and that of points not at all; "
        "values and their errors may be too small"
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('sphere(1)\nmeter(on: ["bal"])', "the meter `meter` has no surface: no instance is called `bal`; there are: sphere"),
        ('plane(name: "ground")\nmeter(on: ["ground"])', "the meter `meter` is on `ground`, which has no end or no surface"),
    ],
)  # fmt: skip
def test_a_surface_that_is_not_there(text: str, message: str) -> None:
    scene = maquette.load_text(text)
    with pytest.raises(sensors.MeterError) as raised:
        illuminance.read(scene, scene.meters, Effort())
    assert str(raised.value) == message


@pytest.mark.long
def test_errors_hold_for_many_seeds() -> None:
    """Of 40 readings of a rectangle's light, 95 % lie within their errors: at least 34."""
    scene = maquette.load_text(FLOOR + "area([0.5, 1.5, 1], size: [1, 2], luminance: 500nit)\nmeter()")
    right = math.pi * 500 * configuration_factor(1, 2, 1.5)
    means = [illuminance.read(scene, scene.meters, Effort(0.01, seed=seed))[0][0].mean for seed in range(40)]
    assert sum(abs(mean.value - right) <= mean.error for mean in means) >= 34


def test_the_height_of_a_meter_far_from_the_origin_is_in_its_error() -> None:
    def reading(far: float) -> illuminance.Reading:
        ball = f"sphere(0.2, [{far}, 1, 0], material: emissive(luminance: 1000nit))"
        return read(f"{ball}\nbox([2, 0.1, 2], [{far}, -0.05, 0])\nmeter([{far}, 0, 0])")[0]

    exact = math.pi * 1000.0 * 0.2**2  # illuminance under a ball at a distance of 1 m
    near, far = reading(0.0), reading(1e5)  # the second lies 1 mm above its plane
    assert abs(near.mean.value - exact) < near.mean.error < 1e-3 * exact
    assert 1e-3 * exact < abs(far.mean.value - exact) < far.mean.error
    with pytest.raises(sensors.MeterError, match=r"1% of the scene's 2 m"):
        reading(1e7)
