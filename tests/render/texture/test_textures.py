"""Textures: mappings, wraps, images and patterns at computed points, on borders, and far away."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from maquette.compiler import ir
from maquette.compiler.scene.row_records import Input, MaterialData, TextureData
from maquette.render.surface import interaction
from maquette.render.texture import textures
from maquette.render.types import Surface

from .. import tables as make

K = ir.GeometryKind
M = ir.TextureMapping
W = ir.Wrap
IMAGE = ir.TextureKind.IMAGE
CHECKER = ir.TextureKind.CHECKER
STRIPES = ir.TextureKind.STRIPES
# 3 by 2 texels; red counts 1 … 6 from the top left
PICTURE = np.stack([np.arange(1, 7).reshape(2, 3), np.zeros((2, 3)), np.zeros((2, 3)), np.ones((2, 3))], axis=-1)


def scene(texture, picture=PICTURE, shape=(K.PLANE, ())):
    def prepare(builder):
        builder.image(np.asarray(picture, np.float32))
        builder.texture(texture)

    return make.scene([(*shape, make.matrix(), 0)], prepare=prepare)


def at(texture, u, v, metric=(1.0, 1.0), picture=PICTURE):
    """A texture's color (n, 3) at surface coordinates."""
    u, v = np.broadcast_arrays(np.asarray(u, float), np.asarray(v, float))
    u, v = np.atleast_1d(u), np.atleast_1d(v)
    ones = np.ones(u.shape)
    zero = (0 * ones, 0 * ones, 0 * ones)
    none = np.zeros(u.shape, int)
    lengths = (metric[0] * ones, metric[1] * ones)
    point = Surface(zero, zero, zero, zero, zero, (u, v), lengths, ones > 0, none, none, zero, 0 * ones)
    with np.errstate(all="ignore"):
        return np.stack(np.broadcast_arrays(*textures.value(scene(texture, picture), none, point)), axis=-1)


def seen(texture, origin, direction, shape, picture=PICTURE):
    """A texture's color (n, 3) at hits of rays with a shape."""
    tables = scene(texture, picture, shape)
    ray = make.rays(origin, direction)
    with np.errstate(all="ignore"):
        surface = interaction.make_interaction(tables, ray, make.first_hit(tables, ray), True)
        return np.stack(np.broadcast_arrays(*textures.value(tables, np.zeros(len(ray.t_min), int), surface)), axis=-1)


def test_texels_lie_with_v_upward_and_row_0_at_the_top():
    nearest = TextureData(IMAGE, image=0, nearest=True)
    u, v = np.meshgrid((np.arange(3) + 0.5) / 3, [0.75, 0.25])
    assert np.array_equal(at(nearest, u.ravel(), v.ravel())[:, 0], [1, 2, 3, 4, 5, 6])


def test_bilinear_is_exact_at_centres_and_even_between_them():
    smooth = TextureData(IMAGE, image=0, wrap_u=W.CLAMP, wrap_v=W.CLAMP)
    assert at(smooth, 0.5, 0.75)[0, 0] == pytest.approx(2.0)
    assert at(smooth, 1 / 3, 0.75)[0, 0] == pytest.approx(1.5)
    assert at(smooth, 0.5, 0.5)[0, 0] == pytest.approx(3.5)
    assert at(smooth, 0.0, 1.0)[0, 0] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("wrap", "expected"),
    [(W.REPEAT, [3, 1, 2, 3, 1, 2]), (W.CLAMP, [1, 1, 2, 3, 3, 3]), (W.MIRROR, [1, 1, 2, 3, 3, 2]), (W.BLACK, [0, 1, 2, 3, 0, 0])],
)
def test_wraps(wrap, expected):
    texture = TextureData(IMAGE, image=0, nearest=True, wrap_u=wrap, wrap_v=W.CLAMP)
    assert np.array_equal(at(texture, (np.array([-1, 0, 1, 2, 3, 4]) + 0.5) / 3, 0.75)[:, 0], expected)


def test_wraps_go_by_axis():
    texture = TextureData(IMAGE, image=0, nearest=True, wrap_u=W.REPEAT, wrap_v=W.BLACK)
    assert at(texture, 1.5, 0.75)[0, 0] == 2
    assert at(texture, 0.5, 1.5)[0, 0] == 0


@pytest.mark.long
@pytest.mark.parametrize("wrap", list(W))
@given(u=st.floats(allow_nan=True, allow_infinity=True), v=st.sampled_from([0.0, -1e-9, 1.0, 1 - 2**-53, 1e308, -math.inf, math.nan]))
@settings(max_examples=60, deadline=None)
def test_no_coordinate_reads_outside_of_the_image(wrap, u, v):
    """u = −1e-9 has the fraction 1.0 in float32: an index by fraction · width would be one too far."""
    for nearest in (False, True):
        value = at(TextureData(IMAGE, image=0, nearest=nearest, wrap_u=wrap, wrap_v=wrap), u, v)
        assert np.isfinite(value).all()
        assert 0 <= value[0, 0] <= 6


def test_just_left_of_zero_is_the_last_texel():
    assert at(TextureData(IMAGE, image=0, nearest=True), -1e-9, 0.75)[0, 0] == 3


def test_channel_gain_and_bias():
    picture = np.full((1, 1, 4), [0.1, 0.2, 0.3, 0.4])
    texture = TextureData(IMAGE, image=0, channel=3, gain=(2.0, 1.0, -1.0), bias=(0.0, 0.5, 1.0))
    assert at(texture, 0.5, 0.5, picture=picture)[0] == pytest.approx([0.8, 0.9, 0.6], abs=1e-6)
    assert at(TextureData(IMAGE, image=0), 0.5, 0.5, picture=picture)[0] == pytest.approx([0.1, 0.2, 0.3], abs=1e-6)


def test_the_frame_scales_and_moves_coordinates():
    texture = TextureData(IMAGE, image=0, nearest=True, frame=((2.0, 0.0, -1.0), (0.0, 0.5, 0.5)))
    assert at(texture, 0.75, 0.4)[0, 0] == 2  # u' = 0.5, v' = 0.7


# --- patterns ---


def cells(kind, u, v, **more):
    return at(TextureData(kind, color_a=(1.0, 1.0, 1.0), color_b=(0.0, 0.0, 0.0), **more), u, v)[:, 0]


def test_a_checker_has_eight_cells_over_u_and_v():
    u = (np.arange(16) + 0.5) / 16
    assert np.array_equal(cells(CHECKER, u, 0.01), np.repeat([1, 0] * 4, 2))
    assert np.array_equal(cells(CHECKER, 0.01, u), np.repeat([1, 0] * 4, 2))


def test_stripes_run_along_v():
    u = (np.arange(16) + 0.5) / 16
    assert np.array_equal(cells(STRIPES, u, 0.9), np.repeat([1, 0] * 4, 2))
    assert np.array_equal(cells(STRIPES, 0.01, u), np.ones(16))


def test_cells_are_half_open_and_go_on_below_zero():
    """Cells are [k, k + 1): borders belong to the next cell; there is no double cell at 0, as by truncation."""
    at_borders = np.array([-3.0, -2.0, -1.0, 0.0, 1.0, 2.0]) / 8
    assert np.array_equal(cells(STRIPES, at_borders, 0.0), [0, 1, 0, 1, 0, 1])
    assert np.array_equal(cells(STRIPES, np.nextafter(at_borders, -9), 0.0), [1, 0, 1, 0, 1, 0])


def test_size_is_in_metres_along_the_surface():
    """0.5 m cells on a surface where u spans 2 m and v spans 1 m: borders at u = 0.25 and v = 0.5."""
    texture = TextureData(CHECKER, color_a=make.grey(1.0), color_b=make.grey(0.0), size=0.5)
    values = at(texture, [0.2, 0.3, 0.2, 0.3], [0.4, 0.4, 0.6, 0.6], metric=(2.0, 1.0))[:, 0]
    assert np.array_equal(values, [1, 0, 0, 1])


def test_a_checker_on_a_plane_by_its_size():
    texture = TextureData(CHECKER, color_a=make.grey(1.0), color_b=make.grey(0.0), size=0.25)
    x = np.linspace(-3, 3, 40) + 1e-4
    origin = np.stack([x, 0 * x + 1, 0 * x - 0.1], axis=1)
    values = seen(texture, origin, (0, -1, 0), (K.PLANE, ()))[:, 0]
    assert np.array_equal(values, (np.floor(x / 0.25) % 2 == 0) * 1.0)


# --- mappings ---


def test_latlong_and_the_courses_projection():
    ramp = np.zeros((64, 128, 4))
    ramp[..., 0] = (np.arange(128) + 0.5) / 128
    ramp[..., 1] = (63.5 - np.arange(64))[:, None] / 64
    p = np.array([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.3, 0.5, math.sqrt(1 - 0.34)], [-0.5, -0.5, math.sqrt(0.5)]])
    x, y, z = p.T
    colors = seen(TextureData(IMAGE, image=0, mapping=M.LATLONG), 3 * p, -p, (K.SPHERE, (1.0,)), ramp)
    assert colors[:, 0] == pytest.approx(0.5 + np.arctan2(x, z) / (2 * math.pi), abs=1e-6)
    assert colors[:, 1] == pytest.approx(0.5 + np.arcsin(y) / math.pi, abs=1e-6)
    inside = p[2:3] * 2  # u = x/|p|, v = y/|p| whatever the distance
    colors = seen(TextureData(IMAGE, image=0, mapping=M.PROJECTED), 2 * inside, -inside, (K.SPHERE, (2.0,)), ramp)
    assert colors[0, :2] == pytest.approx([0.3, 0.5], abs=1e-6)


FACES = {"-x": (-1, 0, 0), "+x": (1, 0, 0), "-y": (0, -1, 0), "+y": (0, 1, 0), "-z": (0, 0, -1), "+z": (0, 0, 1)}


@pytest.mark.parametrize("face", FACES)
def test_box_mapping_shows_the_picture_upright_on_each_side(face):
    """Seen from outside, u grows to the right and v up (on top toward −z, below toward +z), over the whole side."""
    n = np.array(FACES[face], float)
    up = np.array([0, 0, -n[1]]) if n[1] else np.array([0.0, 1.0, 0.0])
    right = np.cross(up, n)
    half = np.array([1.0, 0.5, 2.0])
    ramp = np.zeros((32, 32, 4))
    ramp[..., 0] = (np.arange(32) + 0.5) / 32
    ramp[..., 1] = (31.5 - np.arange(32))[:, None] / 32
    spot = (n + 0.5 * right + 0.25 * up) * half
    color = seen(TextureData(IMAGE, image=0, mapping=M.BOX), spot + n, -n, (K.BOX, tuple(half)), ramp)
    assert color[0, :2] == pytest.approx([0.75, 0.625], abs=1e-6)


def test_neighbors_on_the_net_are_neighbors_on_the_box():
    """An image that is continuous across the net's inner borders is continuous across the box's edges."""
    cell = 16
    y, x = np.mgrid[0 : 3 * cell, 0 : 4 * cell] + 0.5
    picture = np.stack([x / cell, 3 - y / cell, 0 * x, 0 * x + 1], axis=-1)
    texture = TextureData(IMAGE, image=0, mapping=M.NET, wrap_u=W.CLAMP, wrap_v=W.CLAMP)
    box = (K.BOX, (1.0, 1.0, 1.0))

    def on(face, point):
        n = np.array(FACES[face], float)
        return seen(texture, np.array(point, float) + n, -n, box, picture)[0, :2]

    assert on("+z", (0, 0, 1)) == pytest.approx([1.5, 1.5], abs=1e-5)
    assert on("+x", (1, 0, 0)) == pytest.approx([2.5, 1.5], abs=1e-5)
    assert on("-x", (-1, 0, 0)) == pytest.approx([0.5, 1.5], abs=1e-5)
    assert on("-z", (0, 0, -1)) == pytest.approx([3.5, 1.5], abs=1e-5)
    assert on("+y", (0, 1, 0)) == pytest.approx([1.5, 2.5], abs=1e-5)
    assert on("-y", (0, -1, 0)) == pytest.approx([1.5, 0.5], abs=1e-5)
    e, t = 1 - 1e-7, 0.3
    for side, neighbor, p in (
        ("+z", "+x", (e, t, e)), ("+x", "-z", (e, t, -e)), ("-x", "+z", (-e, t, e)), ("+y", "+z", (t, e, e)), ("-y", "+z", (t, -e, e)),
    ):  # fmt: skip
        assert on(side, p) == pytest.approx(on(neighbor, p), abs=1e-5), (side, neighbor)


def test_kernels_and_numpy_look_up_the_same():
    """The same points through the compiled integrator, whose emission is the texture."""
    def prepare(builder):
        builder.image(np.asarray(np.random.default_rng(0).random((5, 7, 4)), np.float32))
        frame = ((2.3, 0.1, 0.0), (0.0, 1.7, 0.0))
        ways = ((M.UV, W.REPEAT, False), (M.LATLONG, W.MIRROR, True), (M.NET, W.CLAMP, False), (M.BOX, W.BLACK, False))
        rows = [
            builder.texture(TextureData(IMAGE, image=0, mapping=mapping, wrap_u=wrap, wrap_v=wrap, nearest=nearest, frame=frame))
            for mapping, wrap, nearest in ways
        ]
        rows.append(builder.texture(TextureData(CHECKER, mapping=M.PROJECTED, size=0.11)))
        return [MaterialData(ir.MaterialModel.EMISSIVE, {ir.Slot.EMISSION: Input(texture=row)}) for row in rows]

    kinds = [(K.SPHERE, (1.0,)), (K.BOX, (1.0, 0.8, 0.6)), (K.BOX, (0.7, 0.7, 0.7)), (K.TORUS, (1.0, 0.3)), (K.SPHERE, (0.8,))]
    tables = make.scene([(*kind, make.matrix((3 * k, 0, 0), make.turn(1, 0.4)), k) for k, kind in enumerate(kinds)], prepare=prepare)
    x = np.linspace(-1.2, 13.2, 150)
    ray = make.rays(np.stack([x, 0.2 * np.sin(9 * x) + 0.3, 0 * x + 5], axis=1), (0.02, -0.05, -1))
    expected, _ = make.radiance(tables, ray)
    compiled, _ = make.radiance_in_kernel(tables, ray)
    assert expected.max() > 0.1
    assert np.abs(expected - compiled).max() < 1e-12
