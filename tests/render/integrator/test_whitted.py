"""Tests of the Whitted integrator: closed forms, and numpy lanes against kernels."""

from __future__ import annotations

import math

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.scene.row_records import Input, LightData, MaterialData, MeshAttribute
from maquette.render.types import Float3

from .. import tables as make

K = ir.GeometryKind
L = ir.LightKind
Slot = ir.Slot
WHITE = (1.0, 1.0, 1.0)
SKY = LightData(L.SKY, WHITE)
SUN = LightData(L.DIRECTIONAL, make.grey(math.pi), direction=(0.0, 1.0, 0.0))
BALL = (K.SPHERE, (1.0,), make.matrix(), 0)
FLOOR = (K.PLANE, (), make.matrix(), 0)
MIRROR = MaterialData(ir.MaterialModel.MIRROR, {Slot.REFLECTION: Input((0.5, 0.8, 1.0))})


def glass(ior=1.5, color=WHITE):
    return MaterialData(ir.MaterialModel.GLASS, {Slot.TRANSMISSION: Input(color), Slot.IOR: Input.number(ior)})


def emissive(radiance):
    return MaterialData(ir.MaterialModel.EMISSIVE, {Slot.EMISSION: Input((radiance,) * 3)})


def bundle(n=40, spread=0.9, seed=0):
    """Rays that meet the unit ball about the origin, from z = 5."""
    p = np.random.default_rng(seed).uniform(-spread / 1.5, spread / 1.5, (n, 2))
    return make.rays(np.append(p, np.full((n, 1), 5.0), axis=1), (0, 0, -1))


def options(**changes):
    return make.OPTIONS._replace(**changes)


def shown(tables, ray=None, samples=1, **changes):
    """Mean radiance (n, 3) along rays."""
    return make.radiance(tables, ray or bundle(), options(**changes), samples)[0].mean(axis=0)


# --- in a furnace of radiance 1 what loses nothing is not seen ---


def test_white_lambert_in_a_furnace_is_one_in_every_sample():
    rgb, alpha = make.radiance(make.scene([BALL], materials=[make.phong(1.0)], lights=[SKY]), bundle(), samples=3)
    assert np.abs(rgb - 1).max() < 1e-12
    assert np.all(alpha == 1)


def test_a_white_mirror_in_a_furnace_is_one():
    mirror = MaterialData(ir.MaterialModel.MIRROR, {Slot.REFLECTION: Input()})
    assert shown(make.scene([BALL], materials=[mirror], lights=[SKY]), bounces=1) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("ior", [1.0, 1.5, 2.4])
def test_glass_in_a_furnace_is_one_but_for_what_the_bounces_cut(ior):
    """After k crossings at most F^k is missing, and what stays below the threshold of the smallest weight."""
    found = shown(make.scene([BALL], materials=[glass(ior)], lights=[SKY]), bundle(spread=0.8), bounces=12)
    assert found.max() <= 1 + 1e-12
    assert found.min() > 1 - 2e-3


@pytest.mark.long
@pytest.mark.parametrize("normalized", [True, False])
def test_a_highlight_in_a_furnace_is_its_lobes_integral(normalized):
    """Seen straight from above, ∫ lobe (· cos · (n+2)/2) dω / π: 2/(n+1) for the course's, 1 normalized."""
    tables = make.scene([FLOOR], materials=[make.phong(0.0, 1.0, 7.0, normalized=normalized)], lights=[SKY])
    found = shown(tables, make.rays((0, 3, 0), (0, -1, 0)), samples=256)[0, 0]
    assert found == pytest.approx(1.0 if normalized else 2 / 8, rel=2e-3)


@pytest.mark.parametrize("bounces", [0, 1, 5])
def test_an_enclosure_of_emission_e(bounces):
    """Inside a sphere of emission e and albedo ρ, k bounces give e (1 − ρ^(k+1))/(1 − ρ), whatever the directions drawn."""
    e, rho = 0.7, 0.6
    wall = make.phong(rho, emission=e)
    tables = make.scene([(K.SPHERE, (1.0,), make.matrix(), 0)], materials=[wall])
    ray = make.rays([[0, 0, 0], [0.3, 0.2, -0.5]], [[0, 0, -1], [1, 0.2, 0.4]])
    found = shown(tables, ray, bounces=bounces, interreflection=True)
    assert found == pytest.approx(e * (1 - rho ** (bounces + 1)) / (1 - rho), rel=1e-9)


# --- mirrors and glass ---


def test_mirror_shows_what_stands_before_it_times_its_colour():
    lamp = (K.SPHERE, (0.5,), make.matrix((0, 3, 0)), 1)
    tables = make.scene([FLOOR, lamp], materials=[MIRROR, emissive(2.0)])
    ray = make.rays((-3, 3, 0), (1, -1, 0))  # to the origin, and from there up and away
    assert shown(tables, ray, bounces=1)[0] == pytest.approx([0, 0, 0], abs=1e-12)
    tables = make.scene([FLOOR, (K.SPHERE, (0.5,), make.matrix((3, 3, 0)), 1)], materials=[MIRROR, emissive(2.0)])
    assert shown(tables, ray, bounces=1)[0] == pytest.approx([1.0, 1.6, 2.0], rel=1e-12)
    assert shown(tables, ray, bounces=0)[0] == pytest.approx([0, 0, 0], abs=1e-12)


@pytest.mark.parametrize("bounces", [1, 2, 7])
def test_facing_mirrors_give_a_geometric_series(bounces):
    """Between plates of reflectance r the k-th image is r^k: only the lamp behind the viewer ends it; here none, so 0, and with a
    glowing lower plate of emission e every second bounce adds e r^k."""
    e, r = 1.0, 0.9
    wall = make.phong(0.0, emission=e, reflection=r)
    tables = make.scene([FLOOR, (K.PLANE, (), make.matrix((0, 1, 0)), 0)], materials=[wall])
    found = shown(tables, make.rays((0, 0.5, 0), (0.1, -1, 0)), bounces=bounces)[0, 0]
    assert found == pytest.approx(e * (1 - r ** (bounces + 1)) / (1 - r), rel=1e-9)


def test_a_slab_lets_through_2n_over_n_squared_plus_1():
    """All inner reflections at normal incidence: T = 2n/(n² + 1) of what stands behind, R = 1 − T of what stands before."""
    lamp = (K.RECTANGLE, (50.0, 50.0), make.matrix((0, -5, 0)), 1)
    tables = make.scene([(K.BOX, (40.0, 0.5, 40.0), make.matrix(), 0), lamp], materials=[glass(1.5), emissive(1.0)])
    found = shown(tables, make.rays((0, 4, 0), (0, -1, 0)), bounces=10)[0, 0]
    assert found == pytest.approx(2 * 1.5 / (1.5**2 + 1), abs=3e-4)


def test_a_slab_shifts_a_slanted_ray():
    """By s sin θ (1 − cos θ/√(n² − sin² θ)): a checker edge behind the slab is seen where the shifted ray meets it."""
    n, s, theta = 1.5, 1.0, math.radians(40)
    shift = s * math.sin(theta) * (1 - math.cos(theta) / math.sqrt(n * n - math.sin(theta) ** 2))
    along = shift / math.cos(theta)  # on a plane below, along x
    straight = 5 * math.tan(theta)
    for off, expected in ((-0.01, True), (0.01, False)):
        edge = straight - along + off
        lamp = (K.RECTANGLE, (50.0, 50.0), make.matrix((edge + 50.0, -3, 0)), 1)
        tables = make.scene([(K.BOX, (40.0, 0.5, 40.0), make.matrix(), 0), lamp], materials=[glass(n), emissive(1.0)])
        found = shown(tables, make.rays((0, 2, 0), (math.sin(theta), -math.cos(theta), 0)), bounces=2)[0, 0]
        assert (found > 0.5) == expected


def test_a_glass_ball_focuses_at_half_its_radius_behind():
    """Back focal length R(2 − n)/(2(n − 1)) = R/2 for n = 1.5: a ray near the axis meets the axis there."""
    h = 1e-3
    lamp = (K.DISK, (1e-6,), make.matrix((0, 0, -1.5), make.turn(0, math.pi / 2)), 1)
    tables = make.scene([BALL, lamp], materials=[glass(1.5), emissive(1.0)])
    found = shown(tables, make.rays((h, 0, 5), (0, 0, -1)), bounces=2)[0, 0]
    assert found == pytest.approx((1 - 0.04) ** 2, abs=1e-3)


def test_total_reflection_goes_to_the_reflected_ray():
    """From inside at 60° nothing leaves glass; k_t of the course's model goes the same way."""
    above = (K.RECTANGLE, (500.0, 500.0), make.matrix((0, 9, 0)), 1)
    within = (K.RECTANGLE, (500.0, 500.0), make.matrix((0, -9, 0)), 2)
    ray = make.rays((0, -1, 0), (math.sin(1.05), math.cos(1.05), 0))
    for material, expected in ((glass(1.5), 3.0), (make.phong(0.0, transmission=0.5, ior=1.5), 1.5)):
        tables = make.scene([FLOOR, above, within], materials=[material, emissive(7.0), emissive(3.0)])
        assert shown(tables, ray, bounces=1)[0, 0] == pytest.approx(expected, rel=1e-12)


# --- lights ---


def test_shadows_and_their_switches():
    roof = (K.RECTANGLE, (1.0, 1.0), make.matrix((0, 2, 0)), 0)
    ray = make.rays([[0, 1, 0], [3, 1, 0]], (0, -1, 0))
    tables = make.scene([FLOOR, roof], materials=[make.phong(0.5)], lights=[SUN])
    assert shown(tables, ray)[:, 0] == pytest.approx([0.0, 0.5], abs=1e-12)
    assert shown(tables, ray, shadows=False)[:, 0] == pytest.approx([0.5, 0.5])
    always = LightData(L.DIRECTIONAL, make.grey(math.pi), direction=(0.0, 1.0, 0.0), shadows=False)
    assert shown(make.scene([FLOOR, roof], materials=[make.phong(0.5)], lights=[always]), ray)[:, 0] == pytest.approx([0.5, 0.5])


def test_ambient_light_is_ka_la_without_shadows():
    tables = make.scene([FLOOR], materials=[make.phong(0.5, ambient=0.25)], lights=[LightData(L.AMBIENT, (1.0, 2.0, 4.0))])
    assert shown(tables, make.rays((0, 1, 0), (0, -1, 0)))[0] == pytest.approx([0.25, 0.5, 1.0])


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e5])
def test_nothing_shadows_itself_near_or_far(scale):
    """A convex ball, a floor and a slanted box under an open sun at coordinates of 1e-3, 1 and 1e5."""
    at = (0.3 * scale, 0.7 * scale, -0.2 * scale)
    slanted = make.matrix(at, make.turn(0, 0.5) * min(scale, 1.0))
    for kind, parameters in ((K.SPHERE, (1.0,)), (K.BOX, (1.0, 1.0, 1.0)), (K.CYLINDER, (0.5, 1.0, 1.0))):
        tables = make.scene([(kind, parameters, slanted, 0)], materials=[make.phong(1.0)], lights=[SUN])
        size = min(scale, 1.0)
        p = np.random.default_rng(1).uniform(-0.4, 0.4, (200, 3)) * size + at
        ray = make.rays(p + [0, 5 * size, size], (0, -1, -0.2))
        assert shown(tables, ray) == pytest.approx(shown(tables, ray, shadows=False), abs=1e-15)


@pytest.mark.long
def test_area_lights_are_seen_by_the_eye_and_counted_once_by_walls():
    """A wall under an area light in a closed room without albedo elsewhere: diffuse rays that meet the lamp add nothing again."""
    lamp = LightData(L.RECTANGLE, make.grey(4.0), transform=1, size=(0.5, 0.5))
    frame = make.facing((0, 1, 0), (0, 0, 0))
    tables = make.scene([FLOOR], materials=[make.phong(0.8)], lights=[lamp], frame=frame)
    shape = (K.RECTANGLE, (0.5, 0.5), frame, 1)
    seen = _with_light(make.scene([FLOOR, shape], materials=[make.phong(0.8), emissive(4.0)], lights=[lamp], frame=frame))
    ray = make.rays((2, 0.5, 0), (-2, -0.5, 0))
    alone = shown(tables, ray, samples=64)
    assert shown(seen, ray, samples=64, bounces=3, interreflection=True) == pytest.approx(alone, rel=1e-12)
    up = make.rays([[0, 0.5, 0], [0, 3, 0]], [[0, 1, 0], [0, -1, 0]])
    assert shown(seen, up)[:, 0] == pytest.approx([4.0, 0.0], abs=1e-12)  # it shines downward only
    mirror = make.scene([FLOOR, shape], materials=[MIRROR, emissive(4.0)], lights=[lamp], frame=frame)
    assert shown(_with_light(mirror), make.rays((0.1, 0.5, 0), (0, -1, 0)), bounces=1)[0] == pytest.approx([2.0, 3.2, 4.0])


def _with_light(tables):
    """The second instance is light 0's shape and casts no shadow."""
    light, visible = tables.instances.light.copy(), tables.instances.visible.copy()
    light[1], visible[1] = 0, ir.Visibility.CAMERA | ir.Visibility.REFLECTION
    columns = {**tables.instances._asdict(), "light": light, "visible": visible}
    return tables._replace(instances=ir.table_of("instances", columns))


# --- backgrounds ---


def test_backgrounds():
    tables = make.scene([BALL], materials=[MIRROR], lights=[LightData(L.SKY, (1.0, 2.0, 3.0))])
    ray = make.rays([[0, 0, 5], [0, 3, 5]], (0, 0, -1))
    color = (0.25, 0.5, 0.75)
    for background, behind in ((0, (1.0, 2.0, 3.0)), (1, (0.0, 0.0, 0.0)), (2, color)):
        rgb, alpha = make.radiance(tables, ray, options(background=background, color=Float3(*color), bounces=1))
        assert rgb[0, 1] == pytest.approx(behind)
        assert rgb[0, 0] == pytest.approx([0.5, 1.6, 3.0])  # the mirror shows the sky whatever stands behind the picture
        assert list(alpha[0]) == [1.0, 0.0]


def test_opacity_lets_the_background_through_and_lowers_alpha():
    """A ball that lets 0.4 straight through each of its faces: 0.16 of the background, and of the sky of 1 what its outside reflects."""
    tables = make.scene([BALL], materials=[make.phong(0.6, transmission=0.4, ior=1.0)], lights=[SKY])
    color = (0.25, 0.5, 0.75)
    rgb, alpha = make.radiance(tables, make.rays((0.2, 0.1, 5), (0, 0, -1)), options(background=2, color=Float3(*color), bounces=2))
    # Its inside sees no sky, since what lets light through throws a full shadow.
    assert rgb[0, 0] == pytest.approx([0.6 + 0.16 * c for c in color], rel=1e-9)
    assert alpha[0, 0] == pytest.approx(1 - 0.16)


@pytest.mark.long
def test_a_sphere_light_is_seen_from_inside_as_it_lights_there():
    lamp = LightData(L.SPHERE, make.grey(2.0), transform=1, size=(3.0, 0.0))
    shape = (K.SPHERE, (3.0,), make.matrix((0, 0, 0.5)), 1)
    tables = make.scene([BALL, shape], materials=[make.phong(1.0), emissive(2.0)], lights=[lamp], frame=make.matrix((0, 0, 0.5)))
    ray = make.rays([[0, 0, 2], [0, 2, 2]], (0, 0, -1))
    found = shown(_with_light(tables), ray, samples=512)
    assert found[1, 0] == pytest.approx(2.0)
    assert found[0, 0] == pytest.approx(2.0, rel=0.02)  # a furnace


def test_mirrored_rays_do_not_enter_a_smooth_surface():
    """Where an interpolated normal leans away, a grazing ray would be mirrored below the triangle; it leaves above it."""
    lean = np.array([[0.8, 0.6, 0.0]] * 3)
    triangle = make.mesh(np.array([[-50.0, 0, 50], [50, 0, 50], [0, 0, -50]]), [[0, 1, 2]], normals=MeshAttribute(lean))
    below = (K.PLANE, (), make.matrix((0, -1, 0)), 1)
    tables = make.scene([below], [(triangle, make.matrix(), 0)], [MIRROR, emissive(9.0)], [SKY])
    assert shown(tables, make.rays((-1, 0.5, 0), (1, -0.5, 0)), bounces=1)[0] == pytest.approx([0.5, 0.8, 1.0])


# --- numpy and kernels ---


def everything():
    """A scene with every material model and every kind of light."""
    blinn = ir.MaterialModel.BLINN_PHONG
    materials = [
        make.phong(0.5, 0.4, 20.0, reflection=0.2), make.phong(0.3, 0.5, 9.0, blinn, normalized=True, transmission=0.3, ior=1.2),
        MIRROR, glass(1.5, (0.9, 1.0, 0.8)), emissive(0.5), make.phong(0.8, model=ir.MaterialModel.LAMBERT),
    ]  # fmt: skip
    ball = (K.SPHERE, (0.6,))
    kinds = [ball, (K.TORUS, (0.5, 0.2)), ball, ball, (K.CYLINDER, (0.3, 0.5, 1.0)), (K.BOX, (0.4, 0.4, 0.4))]
    shapes = [(*kind, make.matrix((1.5 * k - 3.7, 0.7, 0.2 * k), make.turn(0, 0.3 * k)), k) for k, kind in enumerate(kinds)]
    plate = {"transform": 1, "size": (0.4, 0.3)}
    lights = [
        LightData(L.POINT, make.grey(5.0), position=(2, 3, 3)), LightData(L.AMBIENT, make.grey(0.1)), SKY,
        LightData(L.SPOT, make.grey(9.0), position=(-2, 4, 2), direction=(0.4, -0.8, -0.4), cos_cone=0.7, cos_full=0.9),
        LightData(L.SUN, make.grey(2.0), direction=(0.6, 0.8, 0.0), angle=0.05), LightData(L.RECTANGLE, make.grey(3.0), **plate),
        LightData(L.DISK, make.grey(3.0), **plate), LightData(L.SPHERE, make.grey(3.0), **plate),
    ]  # fmt: skip
    frame = make.facing((0, 4, 1), (0, 0, 0))
    return make.scene([*shapes, (K.PLANE, (), make.matrix(), 5)], materials=materials, lights=lights, frame=frame)


@pytest.mark.long
@pytest.mark.parametrize("interreflection", [False, True])
def test_kernels_and_numpy_agree_in_every_sample(interreflection):
    """One source: same numbers drawn, same branches; differences are those of rounding. No sample is lost."""
    tables = everything()
    x = np.linspace(-4.5, 4.5, 120)
    origin = np.stack([0.3 * x, 0 * x + 1.5, 0 * x + 7], axis=1)
    ray = make.rays(origin, np.stack([0.1 * x, -0.15 + 0.1 * np.sin(7 * x), 0 * x - 1], axis=1))
    how = options(bounces=4, interreflection=interreflection)
    one, alpha = make.radiance(tables, ray, how, 4)
    other, alpha_other = make.radiance_in_kernel(tables, ray, how, 4)
    assert one.max() > 1
    assert np.abs(one - other).max() < 1e-9
    assert np.array_equal(alpha, alpha_other)


@pytest.mark.long
def test_numbers_come_from_pixel_sample_and_seed():
    tables = everything()
    ray = bundle(40)
    one, _ = make.radiance(tables, ray, options(bounces=2), 2)
    same, _ = make.radiance(tables, ray, options(bounces=2), 2)
    assert np.array_equal(one, same)
    assert not np.array_equal(one, make.radiance(tables, ray, options(bounces=2, seed=1), 2)[0])
    assert not np.array_equal(one, make.radiance(tables, ray, options(bounces=2), 2, pixel=100)[0])
    assert not np.array_equal(one[0], one[1])
