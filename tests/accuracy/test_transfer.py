"""Known answers 18, 20 and 29 to 31: form factors, what a wall leaves of the sky, enclosures, facing plates and mirrors, environments."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from . import radiometry as rm

WHITE = "lambert(1)"

every = pytest.mark.parametrize("backend", rm.EVERY)
tracers = pytest.mark.parametrize("backend", rm.TRACERS)


def means(folder: Path, text: str, backend: str, seeds: int = 8, **settings: Any) -> list[float]:
    """The mean of the picture for some seeds: over a receiver pixels have different answers, so the error is that between seeds."""
    scene = rm.load(folder, text)
    return [float(rm.grey(rm.picture(folder, scene, backend, seed=seed, **settings)).mean()) for seed in range(seeds)]


def looking_down(width: float, x: float = 0.0, above: float = 0.001) -> str:
    """An orthographic camera just above the floor, whose picture is a square of it."""
    cut = f"near: {above / 2}, far: {above * 2}"
    return f"camera(position: [{x}, {above}, 0], look_at: [{x}, 0, 0], up: [0, 0, -1], width: {width}, {cut})\n"


# --- 18: form factors: the mean over one surface of what the other sends it, E/πL ----------------------------------------------------


def between(corners: list[list[float]], low: float, high: float, side: float) -> float:
    """The form factor of a floor, x from low to high and z within ± side/2, to a polygon: Lambert's formula by Gauss and Legendre."""
    xs, wx = rm.legendre(low, high, 48)
    zs, wz = rm.legendre(-side / 2, side / 2, 24)
    total = sum(wa * wb * rm.under_polygon(corners, (x, 0, z)) for x, wa in zip(xs, wx, strict=True) for z, wb in zip(zs, wz, strict=True))
    return float(total) / math.pi / ((high - low) * side)


@pytest.mark.long
@every
@pytest.mark.parametrize(("gap", "size"), [(1.0, 1.0), (0.4, 0.7)])
def test_facing_squares(tmp_path, measured, backend, gap, size):
    h = size / 2
    answer = between([[-h, gap, -h], [h, gap, -h], [h, gap, h], [-h, gap, h]], -h, h, size)
    if gap == size:
        assert answer == pytest.approx(0.199825, abs=5e-7)
    text = looking_down(size) + f"plane(y: 0, material: {WHITE})\narea([0, {gap}, 0], size: {size}, luminance: 1)\n"
    found = means(tmp_path, text, backend, size=(32, 32), samples=4)
    rm.within_error(measured, 18, "facing squares", backend, found, answer)


def upright(height: float, side: float) -> list[list[float]]:
    """A rectangle that stands on x = 0 and faces +x."""
    return [[0, 0, side / 2], [0, 0, -side / 2], [0, height, -side / 2], [0, height, side / 2]]


@pytest.mark.long
@every
@pytest.mark.parametrize(("start", "height"), [(0.25, 1.0), pytest.param(0.1, 0.6, marks=pytest.mark.long)])
def test_squares_at_a_right_angle_with_a_gap(tmp_path, measured, backend, start, height):
    """A floor that starts a gap away from the wall that lights it.

    Samples of the light's area have no finite variance where the two touch, their squares growing as 1/x² towards the edge: so the
    edge is left to the diffuse rays of the next test.
    """
    answer = between(upright(height, 1), start, start + 1, 1)
    text = looking_down(1, start + 0.5) + f"plane(y: 0, material: {WHITE})\n"
    text += f"area([0, {height / 2}, 0], look_at: [1, {height / 2}, 0], up: [0, 1, 0], size: [1, {height}], luminance: 1)\n"
    found = means(tmp_path, text, backend, size=(48, 48), samples=16)
    rm.within_error(measured, 18, "squares at a right angle, apart", backend, found, answer)


@pytest.mark.long
@pytest.mark.parametrize("backend", ["ray", pytest.param("reference", marks=pytest.mark.long)])
def test_squares_at_a_right_angle_that_touch(tmp_path, measured, backend):
    """0.200044, by diffuse rays that meet a glowing wall."""
    assert between(upright(1, 1), 0, 1, 1) == pytest.approx(0.200044, abs=2e-6)
    text = looking_down(1, 0.5, 1e-5) + f"plane(y: 0, material: {WHITE})\n"
    text += f"polygon({upright(1, 1)}, material: emissive(1, luminance: 1))\nrender(bounces: 1)\n"
    found = means(tmp_path, text, backend, seeds=32, size=(48, 48), samples=36)
    rm.within_error(measured, 18, "squares at a right angle that touch", backend, found, 0.200044)


@pytest.mark.long
@every
@pytest.mark.parametrize(("radius", "other", "height"), [(1.0, 1.0, 1.0), (0.5, 1.5, 0.8)])
def test_facing_disks(tmp_path, measured, backend, radius, other, height):
    """½ [X − √(X² − 4 (r₂/r₁)²)], X = 1 + (1 + (r₂/h)²)/(r₁/h)²; for equal disks as far apart as their radius (3 − √5)/2."""
    x = 1 + (1 + (other / height) ** 2) / (radius / height) ** 2
    answer = 0.5 * (x - math.sqrt(x * x - 4 * (other / radius) ** 2))
    if radius == other == height:
        assert answer == pytest.approx((3 - math.sqrt(5)) / 2, rel=1e-12)
    text = looking_down(2 * radius) + f"disk({radius}, material: {WHITE})\nrender(background: #000000)\n"
    text += f'area([0, {height}, 0], size: {2 * other}, shape: "disk", luminance: 1)\n'
    found = np.array(means(tmp_path, text, backend, size=(64, 64), samples=4)) / (math.pi / 4)  # the disk's share of the picture
    rm.within_error(measured, 18, "facing disks", backend, found, answer)


# --- 20: what a wall leaves of the sky -----------------------------------------------------------------------------------------------


@every
@pytest.mark.parametrize(("height", "away"), [(1, 1), (3, 0.5), (0.2, 1.5), (5, 0.01)])
def test_the_sky_beside_a_wall(tmp_path, measured, backend, height, away):
    """½ (1 + a/√(a² + H²)) of it, for an endless wall: this one is 4000 times its height long."""
    wall = [[-away, -1, 2000 * height], [-away, -1, -2000 * height], [-away, height, -2000 * height], [-away, height, 2000 * height]]
    text = rm.receiver() + f"polygon({wall}, material: lambert(0))\nsky(luminance: 1)\n"
    answer = 0.5 * (1 + away / math.hypot(away, height))
    values = rm.grey(rm.picture(tmp_path, text, backend, size=(32, 32), samples=64))
    rm.within_error(measured, 20, "sky beside a wall", backend, values, answer)


@every
@pytest.mark.parametrize(("radius", "depth"), [(1, 1), (0.5, 1.2)])
def test_the_sky_from_the_bottom_of_a_well(tmp_path, measured, backend, radius, depth):
    """R²/(R² + H²) in its middle: the form factor of its opening."""
    text = rm.receiver() + f"cylinder({radius}, {depth + 1}, center: [0, {(depth - 1) / 2}, 0], capped: false, material: lambert(0))\n"
    values = rm.grey(rm.picture(tmp_path, text + "sky(luminance: 1)\n", backend, size=(32, 32), samples=64))
    rm.within_error(measured, 20, "sky from the bottom of a well", backend, values, radius**2 / (radius**2 + depth**2))


# --- 29: enclosures ------------------------------------------------------------------------------------------------------------------


def box_of(folder: Path, emitted: float, albedo: float) -> str:
    """A closed box that glows and reflects, by an OBJ file with its materials."""
    (folder / "box.mtl").write_text(f"newmtl wall\nKd {albedo} {albedo} {albedo}\nKe {emitted} {emitted} {emitted}\nKs 0 0 0\nillum 1\n")
    corners = "".join(f"v {x} {y} {z}\n" for x in (-1, 1) for y in (-2, 2) for z in (-1.5, 1.5))
    faces = "f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\n"
    (folder / "box.obj").write_text("mtllib box.mtl\n" + corners + "usemtl wall\n" + faces)
    return 'mesh("box.obj")\n'


INSIDE = "camera(position: [0.1, 0.2, 0.5], look_at: [-0.3, 0, -1], fov: 70deg)\n"


GLOWING = [(0.7, 0.6, 0), (0.7, 0.6, 1), (1.3, 0.9, 7), (1.0, 0.5, 30)]
LIT = [(4.0, 1.0, 0.8, 0), (4.0, 1.0, 0.8, 3), (9.0, 2.5, 0.5, 25)]


def where_followed(cases: list[Any]) -> list[Any]:
    """Each case on each backend that follows so many bounces: raster follows none."""
    return [(backend, *case) for backend in rm.EVERY for case in cases if backend != "raster" or case[-1] == 0]


TREE = {"transport": "whitted"}  # every branch followed: exact where the answer does not depend on directions; paths end by chance


@pytest.mark.parametrize(("backend", "emitted", "albedo", "bounces"), where_followed(GLOWING))
def test_a_glowing_enclosure(tmp_path, measured, backend, emitted, albedo, bounces):
    """e/(1 − ρ); k bounces after the first hit give e (1 − ρ^(k+1))/(1 − ρ), whatever directions are drawn: they see n = k + 1 times
    emission, and the list's 1 − ρᵏ counts those. Rays of a weight below 10⁻⁴ are not followed: at most that share of e/(1 − ρ)."""
    text = INSIDE + box_of(tmp_path, emitted, albedo) + f"render(bounces: {bounces})\n"
    answer = emitted * (1 - albedo ** (bounces + 1)) / (1 - albedo)
    found = rm.grey(rm.picture(tmp_path, text, backend, size=(12, 12), plan=TREE))
    cut = 1e-4 if albedo ** (bounces + 1) < 1e-4 else 0.0
    error = float(np.abs(found / answer - 1).max())
    measured.answer(29, "emissive enclosure, k bounces", backend, error, rm.SINGLE + cut, note="relative, the worst pixel")


@pytest.mark.parametrize(("backend", "intensity", "radius", "albedo", "bounces"), where_followed(LIT))
def test_a_lamp_in_the_middle_of_a_ball(tmp_path, measured, backend, intensity, radius, albedo, bounces):
    """ρI/(πR²(1 − ρ)) on its wall, and with k bounces that times 1 − ρ^(k+1)."""
    text = f"sphere({radius}, material: lambert({albedo}))\npoint([0, 0, 0], intensity: {intensity})\nrender(bounces: {bounces})\n"
    answer = albedo * intensity / (math.pi * radius**2) * (1 - albedo ** (bounces + 1)) / (1 - albedo)
    found = rm.grey(rm.picture(tmp_path, INSIDE + text, backend, size=(12, 12), samples=4, plan=TREE))
    cut = 1e-4 if albedo ** (bounces + 1) < 1e-4 else 0.0
    error = float(np.abs(found / answer - 1).max())
    measured.answer(29, "light in a ball, k bounces", backend, error, 1e-6 + cut, note="relative, the worst pixel")


# --- 30: endless plates --------------------------------------------------------------------------------------------------------------


BETWEEN = "camera(position: [0, 0.5, 0], look_at: [0, 0, 0], up: [0, 0, -1], fov: 60deg)\n"


def series(emitted: tuple[float, float], albedo: tuple[float, float], bounces: int) -> tuple[float, float]:
    """What a plate shows with k bounces, and the weight of the first term left out."""
    total, weight = 0.0, 1.0
    for k in range(bounces + 1):
        total += weight * emitted[k % 2]
        weight *= albedo[k % 2]
    return total, weight


@tracers
@pytest.mark.parametrize(("emitted", "albedo", "bounces"), [
    ((1.0, 0.0), (0.5, 0.8), 30), ((0.3, 0.9), (0.9, 0.4), 30), ((1.0, 0.25), (0.7, 0.7), 1), ((1.0, 0.25), (0.7, 0.2), 4),
])  # fmt: skip
def test_facing_plates(tmp_path, measured, backend, emitted, albedo, bounces):
    """B₁ = (E₁ + ρ₁E₂)/(1 − ρ₁ρ₂); cut after k bounces, its first k + 1 terms E₁ + ρ₁E₂ + ρ₁ρ₂E₁ + …

    What the planes emit is k_a of an ambient light of 1. Rays of a weight below 10⁻⁴ are not followed.
    """
    answer, weight = series(emitted, albedo, bounces)
    if bounces == 30:
        assert answer == pytest.approx((emitted[0] + albedo[0] * emitted[1]) / (1 - albedo[0] * albedo[1]), rel=1e-6)
    text = BETWEEN + f"ambient(luminance: 1)\nrender(bounces: {bounces})\n"
    for y in (0, 1):
        text += f"plane(y: {y}, material: phong({albedo[y]}, specular: 0, k_a: {emitted[y]}))\n"
    found = rm.grey(rm.picture(tmp_path, text, backend, size=(12, 12), plan=TREE))
    cut = 1e-4 * max(emitted) * 2 / (1 - albedo[0] * albedo[1]) / answer if weight < 1e-4 else 0.0
    error = float(np.abs(found / answer - 1).max())
    measured.answer(30, "facing plates", backend, error, rm.SINGLE + cut, note="relative, the worst pixel")


@tracers
def test_facing_plates_of_wide_triangles(tmp_path, measured, backend):
    """The same between two glowing squares of an OBJ file, 10⁴ wide and 1 apart: what leaves between them is 10⁻⁸ of all."""
    emitted, albedo, s = (1.0, 0.25), (0.7, 0.7), 5000
    materials = zip(emitted, albedo, strict=True)
    lines = (f"newmtl m{k}\nKd {a} {a} {a}\nKe {e} {e} {e}\nKs 0 0 0\nillum 1\n" for k, (e, a) in enumerate(materials))
    (tmp_path / "plates.mtl").write_text("".join(lines))
    corners = "".join(f"v {x} {y} {z}\n" for y in (0, 1) for x, z in ((-s, -s), (-s, s), (s, s), (s, -s)))
    (tmp_path / "plates.obj").write_text(f"mtllib plates.mtl\n{corners}usemtl m0\nf 1 2 3 4\nusemtl m1\nf 5 8 7 6\n")
    text = BETWEEN + 'mesh("plates.obj", unit: "m", up: "y")\nrender(bounces: 4)\n'
    found = rm.grey(rm.picture(tmp_path, text, backend, size=(12, 12), plan=TREE))
    error = float(np.abs(found / series(emitted, albedo, 4)[0] - 1).max())
    measured.answer(30, "facing plates, wide triangles", backend, error, rm.SINGLE, note="relative, the worst pixel")


@pytest.mark.long
@tracers
@pytest.mark.parametrize(("share", "last"), [(0.9, 6), (0.5, 8)])
def test_facing_mirrors(tmp_path, measured, backend, share, last):
    """The k-th image between mirrors is r^k as bright: a ray of steps 1 along x meets the plates, 1 apart, k times before it leaves past
    their ends, where a wall of radiance 3 glows."""
    worst = 0.0
    for k in range(1, last + 1):
        end = k - 0.5  # the ray meets the floor at x = 0, the roof at 1, the floor at 2, …: k plates before it passes x = end
        text = "camera(position: [-0.5, 0.5, 0], look_at: [0, 0, 0], width: 0.01)\n"
        for y, normal in ((0, 1), (1, -1)):
            text += f"polygon({[[-0.4, y, -1], [-0.4, y, 1], [end, y, 1], [end, y, -1]][::normal]}, material: mirror({share}))\n"
        text += f"polygon([[{end}, -90, -90], [{end}, -90, 90], [{end}, 90, 90], [{end}, 90, -90]], material: emissive(1, luminance: 3))\n"
        found = rm.grey(rm.picture(tmp_path, text + f"render(bounces: {last})\n", backend, size=(8, 8)))
        worst = max(worst, float(np.abs(found / (3 * share**k) - 1).max()))
    measured.answer(30, "images between mirrors", backend, worst, rm.SINGLE, note=f"relative, the worst of {last} images")


# --- 31: environments ----------------------------------------------------------------------------------------------------------------

AXES = {"up": (0.0, 1.0, 0.0), "+z": (0.0, 0.0, 1.0), "+x": (1.0, 0.0, 0.0)}
NORMALS = [(0.0, 1.0, 0.0), (0.0, -1.0, 0.0), (0.6, 0.64, -0.48), (1.0, 0.0, 0.0)]


def environment(folder: Path, value: Any, size: int = 512) -> str:
    """A dome's picture of value(direction (h, w, 3)): its middle toward +z, +x left of it, and its top up."""
    import OpenImageIO as oiio

    v, u = (np.mgrid[0:size, 0 : 2 * size] + 0.5) / size
    longitude, latitude = math.pi * (1 - u), math.pi * (0.5 - v)
    way = np.stack([np.cos(latitude) * np.sin(longitude), np.sin(latitude), np.cos(latitude) * np.cos(longitude)], axis=-1)
    pixels = np.ascontiguousarray(np.repeat(value(way)[..., None], 3, axis=-1), np.float32)
    out = oiio.ImageOutput.create(str(folder / "sky.exr"))
    assert out is not None
    out.open(str(folder / "sky.exr"), oiio.ImageSpec(2 * size, size, 3, "float"))
    assert out.write_image(pixels), out.geterror()
    out.close()
    return 'dome("sky.exr", luminance: 1)\n'


@pytest.mark.long
@every
@pytest.mark.parametrize(("axis", "a", "b"), [("up", 1.0, 0.8), ("+z", 1.0, 0.8), ("+x", 2.0, -1.5)])
def test_an_environment_linear_in_a_direction(tmp_path, measured, backend, axis, a, b):
    """L = a + b ω·z gives E = πa + 2πb n·z/3."""
    z = np.array(AXES[axis])
    dome = environment(tmp_path, lambda way: a + b * (way @ z))
    for normal in NORMALS:
        answer = a + 2 * b * float(rm.unit(normal) @ z) / 3
        values = rm.grey(rm.picture(tmp_path, rm.receiver(normal=normal) + dome, backend, size=(24, 24), samples=16))
        rm.within_error(measured, 31, "environment a + b ω·z", backend, values, answer, scale=a)


@pytest.mark.long
@every
@pytest.mark.parametrize("axis", ["up", "+x"])
def test_an_environment_quadratic_in_a_direction(tmp_path, measured, backend, axis):
    """L = (ω·z)² gives E = (π/4)(1 + (n·z)²)."""
    z = np.array(AXES[axis])
    dome = environment(tmp_path, lambda way: (way @ z) ** 2)
    for normal in NORMALS[1:]:
        answer = (1 + float(rm.unit(normal) @ z) ** 2) / 4
        values = rm.grey(rm.picture(tmp_path, rm.receiver(normal=normal) + dome, backend, size=(24, 24), samples=64))
        rm.within_error(measured, 31, "environment (ω·z)²", backend, values, answer)
