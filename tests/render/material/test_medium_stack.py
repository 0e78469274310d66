"""Tests of medium stacks: stack operations, boundaries, and pictures of nested glass against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from maquette.compiler import ir
from maquette.compiler.scene.row_records import Input, MaterialData
from maquette.render.material import medium_stack, principled

from .. import tables as make

K = ir.GeometryKind


def packed(entries):
    """The list of media as a ray carries it, the first one in front."""
    return np.array(sum(number << (medium_stack.BITS * k) for k, number in enumerate(entries)), np.int64)


def unpacked(inside):
    return [int(inside) >> (medium_stack.BITS * k) & medium_stack.MASK for k in range(medium_stack.DEPTH)]


numbers = st.integers(1, medium_stack.MASK)


@given(st.lists(numbers, max_size=medium_stack.DEPTH), numbers)
def test_a_medium_is_taken_out_once_and_others_keep_their_order(entries, number):
    left = list(entries)
    if number in left:
        left.remove(number)
    assert [n for n in unpacked(medium_stack.remove(packed(entries), np.int64(number))) if n] == left


@given(st.lists(numbers, max_size=medium_stack.DEPTH))
def test_no_medium_takes_out_nothing(entries):
    assert medium_stack.remove(packed(entries), np.int64(0)) == packed(entries)


@given(st.lists(numbers, max_size=medium_stack.DEPTH - 1), numbers)
def test_what_is_entered_is_left_again(entries, number):
    inside = medium_stack.push(packed(entries), np.int64(number))
    assert unpacked(inside)[0] == number
    assert int(medium_stack.top(inside)) == max([*entries, number])
    assert int(medium_stack.remove(inside, np.int64(number))) == int(packed(entries))


def glass(ior, priority=0.0, absorption=0.0):
    slots = {ir.Slot.TRANSMISSION: Input(), ir.Slot.IOR: Input.number(ior), ir.Slot.PRIORITY: Input.number(priority)}
    return MaterialData(ir.MaterialModel.GLASS, {**slots, ir.Slot.ABSORPTION: Input((absorption, absorption, absorption))})


def test_media_are_numbered_by_their_priority():
    two = [(K.SPHERE, (1,), make.matrix(), k) for k in range(3)]
    tables = principled.tables_for(make.scene(two, materials=[glass(1.5, 2), glass(1.33, 1), make.phong(0.5)]))
    made = tables.materials.media  # pyright: ignore
    assert made.number.tolist() == [2, 1, 0]
    assert made.index.tolist() == [1, 1.33, 1.5]


def test_plain_glass_needs_none():
    tables = make.scene([(K.SPHERE, (1,), make.matrix(), 0)], materials=[glass(1.5)])
    assert principled.tables_for(tables) is tables
    assert medium_stack.initial_stack(tables, np.zeros(3)) is None


@pytest.mark.long
@pytest.mark.parametrize("transport", ["whitted", "path"])
@pytest.mark.parametrize("backend", ["ray", "reference"])
def test_an_absorbing_slab_behind_another_that_it_overlaps(tmp_path, backend, transport):
    """Two slabs of index 1 that share half, in which the one of the higher priority absorbs: e^-(σ₁ d₁ + σ₂ d₂) comes through. Paths that
    have lost most of their light end by chance: theirs is right in the mean."""
    from ...accuracy import radiometry as rm

    text = (
        "camera(position: [0, 0, 3], width: 0.5)\n"
        "box([4, 4, 2], center: [0, 0, 0], material: glass(ior: 1, inside: rgb(0.5, 0.5, 0.5), depth: 1m, priority: 1))\n"
        "box([4, 4, 2], center: [0, 0, -1], material: glass(ior: 1, inside: rgb(0.25, 0.25, 0.25), depth: 1m, priority: 2))\n"
        "disk(9, center: [0, 0, -4], normal: [0, 0, 1], material: emissive(1))\nplane(y: -9, material: lambert(0.5))\nsun()\n"
    )
    how = {"transport": transport}
    found = rm.grey(rm.picture(tmp_path, text, backend, size=(8, 8), samples=16, bounces=6, plan=how)) / (0.5 * 0.25**2)
    if transport == "whitted":
        assert np.abs(found - 1).max() < 1e-5
    else:
        assert abs(found.mean() - 1) < 5 * found.std() / 8


@pytest.mark.parametrize("lamp", ["point([0.5, 2, 0], intensity: 10)", "spot([0.5, 2, 0], look_at: [0, 0, 0], cone: 60deg, intensity: 10)"])
@pytest.mark.parametrize("transport", ["whitted", "path"])
@pytest.mark.parametrize("backend", ["ray", "reference"])
def test_a_lamp_in_a_medium_fades_on_the_way(tmp_path, backend, transport, lamp):
    """A white floor and a lamp in a medium of index 1 that ends 4 m above the floor: e^(-σ d) reaches it, e^(-σ 4 m) of that leaves."""
    from ...accuracy import radiometry as rm

    text = (
        f"camera(position: [0, 6, 0], look_at: [0, 0, 0], up: [0, 0, -1], width: 0.002)\n{lamp}\n"
        "box([8, 8, 8], material: glass(ior: 1, inside: rgb(0.5, 0.7, 0.9), depth: 1m))\n"
        "disk(3, center: [0, 0, 0], normal: [0, 1, 0], material: lambert(1))\n"
    )
    away = math.hypot(0.5, 2)
    arrives = 10 / away**2 * (2 / away) / math.pi
    image = rm.picture(tmp_path, text, backend, size=(4, 4), bounces=2, plan={"transport": transport})
    for k, left in enumerate((0.5, 0.7, 0.9)):
        found = image.channels["rgba"][..., k].astype(float)
        assert found == pytest.approx(arrives * left ** (away + 4), rel=1e-3)  # pixels off the middle are that much nearer or farther


def test_a_glass_of_water_without_a_gap_of_air():
    """Water of a lower priority that stands into its glass: the boundary of the water inside of the glass is none."""
    tables = principled.tables_for(
        make.scene([(K.SPHERE, (1,), make.matrix(), 0), (K.SPHERE, (1,), make.matrix(), 1)], materials=[glass(1.5, 2), glass(1.33, 1)])
    )

    class Point:
        material = np.array([1])
        front = np.array([True])

    in_glass, in_air = packed([2]), packed([])
    assert float(medium_stack.relative_ior(in_glass, np.array([1.33]), tables, Point, None)[0]) == 1.0
    assert bool(medium_stack.is_ignored(in_glass, np.array([False]), tables, Point)[0])
    assert float(medium_stack.relative_ior(in_air, np.array([1.33]), tables, Point, None)[0]) == 1.33
    Point.material, Point.front = np.array([0]), np.array([False])
    leaving = medium_stack.relative_ior(packed([2, 1]), np.array([1.5]), tables, Point, None)  # out of the glass, into the water
    assert float(leaving[0]) == pytest.approx(1.5 / 1.33)
    assert math.isclose(float(medium_stack.attenuate(in_air, (1.0, 1.0, 1.0), tables, 5.0)[0]), 1.0)
