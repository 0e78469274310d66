"""Furniture stands on the floor in sizes of its arguments; lamps send out their flux; rooms with windows have no other gaps."""

from __future__ import annotations

import math

import maquette
import numpy as np
import pytest
from maquette.compiler import ir
from maquette.lang.diagnostics import Diagnostics, SceneError

TILT = 0.004  # m: half of the foot of a leg that leans is below the floor


def loaded(text: str) -> ir.Scene:
    diagnostics = Diagnostics()
    scene = maquette.load_text(text, diagnostics=diagnostics)
    assert [d.message for d in diagnostics.items] == []
    return scene


def bounds(scene: ir.Scene) -> tuple[np.ndarray, np.ndarray]:
    """(3,) corners of the boxes of all instances, in the world."""
    tables = scene.tables
    boxes = tables.geometries.bounds[tables.instances.geometry].reshape(-1, 2, 3)
    matrix = tables.transforms.matrix[tables.instances.transform]
    corners = np.stack([boxes[:, [i, j, k], [0, 1, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)], axis=1)
    world = np.einsum("nij,nkj->nki", matrix[:, :3, :3], corners) + matrix[:, None, :3, 3]
    return world.min(axis=(0, 1)), world.max(axis=(0, 1))


@pytest.mark.parametrize(
    ("call", "size"),  # width, height and depth; None: not stated by an argument
    [
        ("sofa(1.9)", (1.9, None, None)),
        ("stool(60cm)", (None, 0.6, None)),
        ("nightstand([40cm, 50cm, 35cm])", (None, 0.5, None)),
        ("drawers([1, 70cm, 40cm], rows: 2)", (None, 0.7, None)),
        ("wardrobe([1.2, 2.1, 55cm], doors: 2)", (1.2, 2.1, None)),
        ("bookshelf([80cm, 1.8, 28cm])", (0.8, 1.8, 0.28)),
        ("coffee_table(40cm, 35cm)", (None, 0.35, None)),
        ("dining_table([1.4, 72cm, 80cm])", (1.4, 0.72, 0.8)),
        ("rug([2, 1.5])", (2.0, 0.01, 1.5)),
        ("fridge([60cm, 1.7, 64cm])", (0.6, 1.7, None)),
        ("kitchen_counter(2)", (2.0, None, None)),
    ],
)
def test_furniture_stands_on_the_floor_in_its_size(call: str, size: tuple[float | None, ...]) -> None:
    low, high = bounds(loaded(f'use "std/furniture"\nfurniture.{call}\n'))
    assert -TILT <= low[1] <= 1e-6
    for axis, wanted in enumerate(size):
        assert wanted is None or high[axis] - low[axis] == pytest.approx(wanted, abs=2 * TILT)


@pytest.mark.parametrize("call", ["table_lamp(flux: 450lm)", "pendant(flux: 450lm)"])
def test_a_bulb_sends_out_its_flux(call: str) -> None:
    """The flux of an even ball is π × luminance × 4π radius²."""
    tables = loaded(f'use "std/room"\nroom.{call}\n').tables
    ball = int(np.flatnonzero(tables.geometries.kind == ir.GeometryKind.SPHERE)[0])
    radius = float(tables.geometries.bounds[ball].reshape(2, 3)[1, 0])
    light = int(np.flatnonzero(tables.materials.model == ir.MaterialModel.EMISSIVE)[0])
    luminance = float(np.array([0.2126729, 0.7151522, 0.0721750]) @ tables.materials.values[light, ir.Slot.EMISSION])
    assert math.pi * luminance * 4.0 * math.pi * radius**2 == pytest.approx(450.0, rel=2e-3)


@pytest.mark.parametrize("lamp", ["standing_lamp", "table_lamp", "pendant", "ceiling_lamp"])
def test_a_lamp_that_is_off_gives_no_light(lamp: str) -> None:
    tables = loaded(f'use "std/room"\nroom.{lamp}(on: false)\nsun()\n').tables
    assert len(tables.lights.kind) == 1
    assert not (tables.materials.model == ir.MaterialModel.EMISSIVE).any()


@pytest.mark.parametrize("part", ["chair", "table", "books", "table_lamp", "standing_lamp", "pendant", "curtains"])
def test_a_part_of_a_room_turns_about_its_place(part: str) -> None:
    """A turn by 180° about y mirrors the box of a part in its place, in x and z."""
    low, high = bounds(loaded(f'use "std/room"\nroom.{part}(at: [5, 2, -3])\n'))
    turned_low, turned_high = bounds(loaded(f'use "std/room"\nroom.{part}(at: [5, 2, -3], rotate: [0, 180deg, 0])\n'))
    place = np.array([5.0, 0.0, -3.0])
    assert turned_low[[0, 2]] == pytest.approx((2 * place - high)[[0, 2]], abs=1e-6)
    assert turned_high[[0, 2]] == pytest.approx((2 * place - low)[[0, 2]], abs=1e-6)


def test_a_room_with_windows_is_open_there_alone() -> None:
    """From its middle, directions without a surface go through the openings: x = -2, |z ∓ 1| < 0.5, 0.9 < y < 2.1."""
    text = 'use "std/room"\nroom.with_windows(size: [4, 2.6, 5], left: [[-1, 90cm, 1, 1.2], [1, 90cm, 1, 1.2]])\n'
    text += 'point([0, 2, 0])\ncamera([0, 1.3, 0], look_at: [-1, 1.3, 0], projection: "panoramic")\n'
    image = maquette.render(loaded(text), size=(96, 48), samples=1, bounces=0, backend="reference")
    seen = np.asarray(image)[..., 3] < 0.5
    v, u = np.nonzero(seen)
    turn, up = (0.5 - (u + 0.5) / 96) * 2 * math.pi, (0.5 - (v + 0.5) / 48) * math.pi  # from -x, in the middle
    x, y, z = -np.cos(up) * np.cos(turn), np.sin(up), np.cos(up) * np.sin(turn)
    assert len(u) > 20
    assert (x < 0).all()
    at_y, at_z = 1.3 - 2.0 * y / x, np.abs(2.0 * z / x)
    slack = 0.2  # a pixel
    assert ((at_y > 0.9 - slack) & (at_y < 2.1 + slack) & (at_z > 0.5 - slack) & (at_z < 1.5 + slack)).all()


def test_a_room_may_have_a_doorway() -> None:
    loaded('use "std/room"\nroom.with_windows(back: [[1, 0, 90cm, 2.05]])\n')


def test_a_parametric_surface_has_rows_of_its_own() -> None:
    tables = loaded('use "std/surfaces"\nsurfaces.parametric(|u, v| [u, v, u ^ 2], steps: 4, rows: 3)\n').tables
    assert tables.geometries.vertex_count.tolist() == [5 * 4]


def test_the_message_about_wrong_arguments_lists_all_of_them() -> None:
    with pytest.raises(SceneError) as error:
        maquette.load_text('use "std/furniture"\nfurniture.sofa(cloth: 3)\n')
    hint = error.value.diagnostics[0].hint
    assert hint.startswith("it takes width = 2.1m, depth = 92cm, seats: int = 3, cloth = lambert(#6f7b78), legs = oak()")
