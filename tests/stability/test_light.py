"""Places 14, 15, 38 to 42 and 49: the terminator, the critical angle, fireflies, lamps from inside, energy, caustics, endless mirrors."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from maquette.compiler import ir
from maquette.compiler.plan import plan as planner
from maquette.compiler.scene.row_records import CameraData, LightData, MeshAttribute, MeshData
from maquette.lang.schema.picture_settings import MAX_BOUNCES
from maquette.render.image.image import Image
from maquette.render.material import bsdf, fresnel
from maquette.render.types import Tile

from ..render import pictures
from ..render.closed import K
from ..render.material.test_bsdf import albedo, shader
from ..render.tables import looking, phong, scene
from . import naive
from .meshes import ball

UP = (0.0, 1.0, 0.0)
FRONT = CameraData(1, 1.1, projection=ir.Projection.ORTHOGRAPHIC)


def grey(image: Image) -> np.ndarray:
    return image.channels["rgba"][..., 0].astype(np.float64)


def mean_and_error(values: np.ndarray) -> tuple[float, float]:
    """The mean of independent numbers, and its standard error."""
    return float(values.mean()), float(values.std(ddof=1) / math.sqrt(values.size))


# --- 14: the terminator of a smooth mesh -------------------------------------------------------------------------------------------


class Terminator(NamedTuple):
    """Errors near the terminator: √mean², or for `dark_…` sums of squares.

    The naive shadow calls a place dark where its facet faces away from the sun, though its interpolated normal does not; light
    without any shadow is what no shadow can better: the rest is the normals', on facets inside the ball.
    """

    ours: float  # against the analytic ball, where the sun is less than 30° up
    naive: float
    free: float  # without any shadow
    added: float  # ours and the naive one against the light without any shadow
    naively: float
    dark_ours: float  # against the analytic ball, where facets face away though normals do not, and the ball is lit
    dark_naive: float


def terminator(segments: int, angle: float, backend: str, size: int = 96) -> Terminator:
    """The errors of a smooth ball of so many segments, with the sun at an angle from the eye."""
    sun = np.array([math.sin(angle), 0.2, math.cos(angle)])
    sun /= np.linalg.norm(sun)
    light = LightData(ir.LightKind.DIRECTIONAL, (math.pi, math.pi, math.pi), direction=(sun[0], sun[1], sun[2]))
    points, triangles = ball(segments)
    smooth = MeshData(points, triangles, normals=MeshAttribute(points))
    frame = looking((0, 0, 5), (0, 0, 0))
    tables = scene(meshes=[(smooth, np.eye(4), 0)], lights=[light], camera=FRONT, frame=frame)
    true = scene([(K.SPHERE, [1.0], np.eye(4), 0)], lights=[light], camera=FRONT, frame=frame)
    ours, exact = (pictures.picture(t, backend, size=(size, size), aov=("normal",)) for t in (tables, true))
    primitive = np.zeros((size, size), int)
    _, hit = pictures.renderer(tables, "raster", size=(size, size)).centres(Tile(0, 0, size, size))
    primitive[:] = np.asarray(hit.primitive).reshape(size, size)
    corners = points[triangles[np.maximum(primitive, 0)]]
    facet = np.cross(corners[..., 1, :] - corners[..., 0, :], corners[..., 2, :] - corners[..., 0, :])
    lit = np.maximum(ours.channels["normal"].astype(float) @ sun, 0)
    away = facet @ sun <= 0
    plain = np.where(away, 0, lit)
    low = exact.channels["normal"].astype(float) @ sun
    band = (low > 0) & (low < 0.5) & (ours.channels["rgba"][..., 3] > 0)
    assert band.sum() > 100

    def error(picture: np.ndarray, other: np.ndarray) -> float:
        return float(np.sqrt(np.mean((picture - other)[band] ** 2)))

    true_light, seen = grey(exact), grey(ours)
    dark = away & (lit > 0) & (low > 0)
    return Terminator(
        error(seen, true_light), error(plain, true_light), error(lit, true_light), error(seen, lit), error(plain, lit),
        float(np.sum((seen - true_light)[dark] ** 2)), float(np.sum((plain - true_light)[dark] ** 2)),
    )  # fmt: skip


@pytest.mark.long
def test_the_terminator_of_a_smooth_ball(measured):
    """Rays to light start off the facets (Hanika 2021): what shadows add to the error of interpolated normals is gone.

    Where facets were dark by mistake the error against the analytic ball is less than half.
    """
    found = [terminator(8, math.radians(angle), backend) for angle in (30, 60, 90, 110) for backend in ("ray", "raster")]
    ours, naive = (math.sqrt(sum(squares)) for squares in zip(*((f.dark_ours, f.dark_naive) for f in found), strict=True))
    whole, before = max(f.ours for f in found[2:]), max(f.naive for f in found[2:])
    added, naively = max(f.added for f in found), max(f.naively for f in found)
    measured.place(
        14, "the terminator of a smooth ball of 8 segments", naive="1: facets that face away from the sun are dark",
        ours=f"{ours / naive:.2f}", bound="half of the error against the ball, where facets face away",
        note=f"shadows add {added:.1g} to the error of normals (naively {naively:.3f}); all within 30°: {before:.3f} → {whole:.3f}",
    )  # fmt: skip
    assert ours <= 0.5 * naive
    assert naively > 0.03
    assert added <= 0.01 * naively
    assert all(f.ours <= f.free + 1e-4 for f in found)


@pytest.mark.long
@pytest.mark.parametrize("backend", ["ray", "raster"])
def test_the_terminator_gets_better_with_segments(backend):
    """Four times the segments, less than half of the error."""
    coarse, fine = (terminator(n, math.radians(80), backend).ours for n in (8, 32))
    assert fine < 0.5 * coarse


# --- 15: the critical angle --------------------------------------------------------------------------------------------------------


def split(sine: np.ndarray, n: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(reflected, transmitted, total) from inside an index n: R by the shared function, T by Fresnel's amplitudes from its angle."""
    cosine = np.sqrt(np.maximum(1 - sine * sine, 0))
    share, bent, total = fresnel.fresnel(cosine, np.full_like(cosine, n))
    across, along = 2 * n * cosine / (n * cosine + bent), 2 * n * cosine / (cosine + n * bent)
    through = bent / (n * cosine) * 0.5 * (across**2 + along**2)  # Hecht, Optics, section 4.6.3
    return share, np.where(total, 0.0, through), total


def test_about_the_critical_angle(measured):
    sine = np.concatenate([1 / 1.5 + np.linspace(-1e-7, 1e-7, 4001), [1 / 1.5]])
    reflected, transmitted, _ = split(sine, 1.5)
    indices = np.linspace(1.3, 2.5, 1201, dtype=np.float32)
    plain = np.isnan(naive.refraction(np.arcsin(np.float32(1) / indices), indices))
    measured.place(
        15, "refraction within 10⁻⁷ of the critical angle", naive=f"f32: NaN at it for {plain.mean():.0%} of the indices from 1.3 to 2.5",
        ours=f"finite, R + T = 1 ± {np.abs(reflected + transmitted - 1).max():.1g}", bound="R + T = 1 ± 10⁻⁶, no NaN",
    )  # fmt: skip
    assert plain.any()
    assert np.isfinite(reflected).all()
    assert np.abs(reflected + transmitted - 1).max() < 1e-6


@pytest.mark.long
@given(st.floats(1.0001, 4.0), st.floats(-1e-7, 1e-7))
@settings(max_examples=200, deadline=None)
def test_reflected_and_transmitted_add_up(n, off):
    sine = np.clip(np.array([1 / n + off, 1 / n, np.nextafter(1 / n, 0), np.nextafter(1 / n, 1)]), 0, 1)
    reflected, transmitted, total = split(sine, n)
    assert np.isfinite(reflected).all()
    assert np.abs(reflected + transmitted - 1).max() < 1e-6
    assert ((reflected == 1) | ~total).all()


@pytest.mark.long
def test_a_ball_of_glass_full_of_critical_angles_is_finite(draw):
    """From inside of glass and through it, at every angle; `draw` sees that all is finite."""
    text = "sky(color: #a0c0ff, luminance: 1)\nsphere(1, material: glass(ior: {0}))\nrender(bounces: 8)\n"
    for n in (1.33, 1.5, 2.4):
        for eye in ("[0, 0, 0.97]", "[0.6, 0, 0]", "[0, 0, 4]"):
            draw(f"camera(position: {eye}, look_at: [0, 0, 0], up: [0, 1, 0.1], fov: 90deg)\n" + text.format(n), "ray")


# --- 38: fireflies -----------------------------------------------------------------------------------------------------------------

BEHIND_GLASS = """
camera(position: [0, 0.2, 0], look_at: [0, 0, 0], up: [0, 0, -1], width: 0.02, near: 0.01)
plane(y: 0, material: lambert(1))
box([20, 0.01, 20], center: [0, {height} / 2, 0], material: glass(ior: 1))
area([0, {height}, 0], look_at: [0, 0, 0], size: {side}, luminance: 100)
render(bounces: 4)
"""


def under_a_square(side: float, height: float) -> float:
    """E / πL below the middle of a square light (ORACLES 15: four equal corners)."""
    a = 0.5 * side
    slant = math.hypot(a, height)
    return 4 * a / (slant * math.pi) * math.atan(a / slant)


@pytest.mark.long
@pytest.mark.parametrize(("side", "height"), [(0.2, 1.0), (0.6, 1.0), (1.5, 2.0)])
def test_fireflies_from_a_lamp_behind_glass(measured, draw, side, height):
    """Matt, then glass, then a small lamp: seen only by diffuse rays that happen to meet it. Nothing is clamped, so the mean is right."""
    text = BEHIND_GLASS.format(side=side, height=height)
    true = 100 * under_a_square(side, height)
    pixels = grey(draw(text, "ray", size=(48, 48), samples=256))
    mean, error = mean_and_error(pixels)
    single = grey(draw(text, "ray", size=(160, 160), samples=1)).ravel()
    clamped = naive.clamped(single, 10 * true).mean()
    if side == 0.2:
        measured.place(
            38, "diffuse → glass → a small light, in paths", naive=f"samples clamped at 10 times the mean lose {1 - clamped / true:.0%}",
            ours=f"{mean / true - 1:+.1%} ± {error / true:.1%}; one sample in {1 / np.mean(single > 0):.0f} has all the light",
            bound="4 standard errors", note="noisy: waits for guiding",
        )  # fmt: skip
        assert clamped < 0.5 * true
    assert abs(mean - true) < 4 * error


# --- 39: lamps from inside, without area, buried -------------------------------------------------------------------------------------


@pytest.mark.parametrize(("radius", "at"), [(1.0, [0, 0, 0]), (1.0, [0.5, 0.2, -0.3]), (3.0, [0, -2.7, 0])])
def test_inside_a_sphere_light(measured, draw, radius, at):
    """A white ball anywhere inside of a glowing sphere of luminance 5 shows 5: E = πL."""
    eye = [at[0], at[1], at[2] + 0.04]
    text = f"camera(position: {eye}, look_at: {at}, fov: 40deg)\nsphere({radius}, material: emissive(1, luminance: 5))\n"
    image = draw(text + f"sphere(0.02, center: {at}, material: lambert(1))\n", "ray", samples=64, size=(32, 32), filter="box", aov=("id",))
    values = grey(image)[2:-2, 2:-2][image.channels["id"][2:-2, 2:-2, 0] == 1]
    mean, error = mean_and_error(values)
    if radius == 3.0:
        measured.place(
            39, "a point inside of a sphere light", naive=f"its cone: 1 − cos θ = {naive.cone_height(3.0, 2.7)}",
            ours=f"L = {mean:.4g} ± {error:.1g} of 5", bound="E = πL, 4 standard errors",
        )  # fmt: skip
        assert math.isnan(naive.cone_height(3.0, 2.7))
    assert len(values) > 100
    assert error < 0.01 * 5
    assert abs(mean - 5) < 4 * error


def test_a_lamp_without_area_is_an_error(load):
    from maquette.lang.diagnostics import SceneError

    for lamp in ("area([0, 2, 0], look_at: [0, 0, 0], size: [0, 1])", "sphere(0, material: emissive(1))"):
        with pytest.raises(SceneError, match="must be more than 0"):
            load(f"camera(position: [0, 2, 5], look_at: [0, 0, 0])\nplane(y: 0)\n{lamp}\n")


BURIED = "camera(position: [0, 2, 5], look_at: [0, 0, 0])\nplane(y: 0)\nbox(1, center: [0, 0.5, 0])\npoint([0, 0.5, 0], intensity: 10)\n"


def test_a_buried_lamp_makes_no_nan(draw):
    for backend in ("ray", "raster", "reference"):
        assert grey(draw(BURIED, backend, size=(16, 16))).max() == 0


def test_a_buried_lamp_is_said(measured, load):
    _, said = load(BURIED)
    measured.place(
        39, "a light inside a box", naive="a black picture, silently", ours=f"a black picture; message: {'; '.join(said) or 'nothing'}",
        bound="a warning",
    )  # fmt: skip
    assert said == ["this light is inside of an opaque solid: nothing outside is lit by it"]


# --- 40: Phong's energy ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("model", [ir.MaterialModel.PHONG, ir.MaterialModel.BLINN_PHONG])
@pytest.mark.parametrize("n", [1.0, 0.0, 5.0, 200.0])
def test_phong_in_a_furnace(measured, model, n):
    """k = 1 as a reflectance, no normalising, reflects 2π/(n + 2); normalized, no more than 1 at any tilt."""
    most = max(albedo(phong(0.0, 1.0, n, model, normalized=True), tilt) for tilt in (0.0, 0.4, 0.9, 1.3, 1.5))
    if n == 1.0 and model == ir.MaterialModel.PHONG:
        measured.place(
            40, "Phong, k = 1, n = 1 in a furnace", naive=f"reflects {2 * math.pi / 3:.3f}", ours=f"normalized: {most:.6f} at most",
            bound="1", note="without `normalized` it is the course's equation, as written",
        )  # fmt: skip
        assert 2 * math.pi / 3 > 2
    assert most <= 1 + 1e-6


@pytest.mark.parametrize("shininess", [1, 20])
def test_a_normalized_highlight_in_a_furnace(draw, shininess):
    """By the public way: under a sky of 1 nothing is brighter than 1, but for its noise."""
    text = "camera(position: [0, 0, 4], look_at: [0, 0, 0], fov: 40deg)\nsky(color: #fff, luminance: 1)\n"
    text += f"sphere(1, material: phong(#000, specular: 1, shininess: {shininess}, normalized: true))\n"
    image = draw(text, "ray", size=(40, 40), samples=64, filter="box")
    inside = grey(image)[10:30, 10:30]
    mean, error = mean_and_error(inside)
    assert mean <= 1 + 4 * error
    assert inside.max() < 1.2


# --- 41: caustics of point lights ------------------------------------------------------------------------------------------------------

CAUSTIC = """
camera(position: [0, 3, 6], look_at: [0, 0, 0])
plane(y: 0)
sphere(0.5, center: [0, 1, 0], material: glass(ior: 1.5))
point([0, 4, 0], intensity: 10)
render(bounces: 6)
"""


@pytest.mark.long
def test_a_caustic_of_a_point_light(measured, load, draw):
    """Under the ball light is gathered; a path that starts at the eye can never find the lamp."""
    below = "camera(position: [0, 0.2, 0], look_at: [0, 0, 0], up: [0, 0, -1], width: 0.1, near: 0.01)\n"
    found = float(grey(draw(below + "\n".join(CAUSTIC.splitlines()[2:]), "ray", size=(8, 8), samples=16)).max())
    loaded, said = load(CAUSTIC)
    said += planner.warnings(loaded, planner.make_plan(loaded, ir.Settings(backend="ray")))
    measured.place(
        41, "the light a ball of glass gathers from a point light", naive="0: no path finds a point",
        ours=f"{found:g} where it is brightest; message: {'; '.join(said) or 'nothing'}", bound="the light, or a warning",
        note="by photons",
    )  # fmt: skip
    assert found > 0.2 or said


# --- 42: mirrors without end -----------------------------------------------------------------------------------------------------------

MIRRORS = (
    "camera(position: [0, 0, 0.9], look_at: [0.1, 0.2, 0])\nbox(2, material: mirror(1))\nsphere(0.1, center: [0.3, 0, 0], "
    "material: emissive(1))\nrender(bounces: {0})\n"
)


@pytest.mark.parametrize("bounces", [8, 30, 64])
def test_facing_mirrors_end(measured, draw, bounces):
    """A closed room of perfect mirrors: every ray ends in the lamp or at the cap, without recursion."""
    lit = [float(np.mean(grey(draw(MIRRORS.format(n), "ray", size=(24, 24))) > 0)) for n in (bounces, 0)]
    if bounces == 64:
        with pytest.raises(RecursionError):
            naive.mirror_room(1.0)
        measured.place(
            42, "facing lossless mirrors", naive="recursion until the weight is small: RecursionError",
            ours=f"ends after {bounces} bounces, iteratively; {1 - lit[0]:.0%} of the pixels are cut off", bound="ends",
        )  # fmt: skip
    assert lit[0] > lit[1]


def test_what_the_cap_cuts_off_is_reported(measured, draw):
    """The share of the light that the longest limit finds and 8 bounces do not, in blocks of 4 by 4 pixels, is told."""
    text = MIRRORS.format(8)
    image, longest = draw(text, "ray", size=(24, 24)), draw(text, "ray", size=(24, 24), bounces=MAX_BOUNCES)
    ours, far = (grey(picture).reshape(6, 4, 6, 4).mean(axis=(1, 3)) for picture in (image, longest))
    true = float(np.mean((far - ours) / np.hypot(far, 0.01 * far.mean())))
    cut = image.metadata["cut"]
    measured.place(
        42, "the light that a cap of 8 bounces cuts off", naive="lost silently",
        ours=f"{true:.0%} is lost, {cut.share:.0%} ± {cut.error:.0%} reported", bound="reported, within 4 standard errors",
    )  # fmt: skip
    assert true > 0.5
    assert abs(cut.share - true) < 4 * cut.error
    assert cut.matters
    assert not longest.metadata["cut"]


# --- 49: powers of negative cosines ------------------------------------------------------------------------------------------------------


def directions(n: int, seed: int) -> np.ndarray:
    v = np.random.default_rng(seed).normal(size=(n, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


@pytest.mark.parametrize("model", [ir.MaterialModel.PHONG, ir.MaterialModel.BLINN_PHONG])
@pytest.mark.parametrize("exponent", [2.5, 0.0, 1.0, 32.0, 0.3])
def test_powers_of_negative_cosines(measured, model, exponent):
    light, view = directions(20_000, 1), directions(20_000, 2)
    view[:, 1] = np.abs(view[:, 1])
    plain = naive.phong(np.tile(UP, (20_000, 1)), light, view, exponent)
    with np.errstate(all="ignore"):
        ours = np.asarray(bsdf.reflected(shader(phong(1.0, 1.0, exponent, model)), UP, tuple(light.T), tuple(view.T))[0])
    if exponent == 2.5 and model == ir.MaterialModel.PHONG:
        measured.place(
            49, "N·L + (R·V)^2.5 for any directions",
            naive=f"NaN for {np.isnan(plain).mean():.0%}, negative for {np.mean(plain < 0):.0%}",
            ours=f"{np.min(ours):g} to {np.max(ours):.3g}, 0 behind the light", bound="finite, ≥ 0, no highlight on the far side",
        )  # fmt: skip
    assert np.isnan(plain).any() or (plain < 0).any() or exponent == 0
    assert np.isfinite(ours).all()
    assert (ours >= 0).all()
    assert (ours[light[:, 1] <= 0] == 0).all()
