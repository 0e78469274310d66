"""Functions of vectors, lane by lane against numpy: rounding, selection, conversions, masks, and cross-lane operations."""

from __future__ import annotations

import numpy as np
import pytest
from maquette.render import simd
from maquette.render.jit.kernel import kernel
from maquette.render.simd import target as simd_target

from .values import COUNT, FLOATS, INTS, TYPES, awkward, compiled, over, same, widths

FLOAT_KINDS = [(dtype, kind) for dtype in FLOATS for kind in widths(dtype)]
ALL_KINDS = FLOAT_KINDS + [(dtype, kind) for dtype in INTS for kind in widths(dtype)]


@pytest.mark.parametrize(("dtype", "kind"), FLOAT_KINDS)
def test_rounding_roots_and_signs(dtype, kind):
    x, y = awkward(dtype, 1), awkward(dtype, 2)
    names = ("sqrt", "floor", "ceil", "trunc", "rint", "absolute")
    outs = tuple(np.zeros(COUNT, dtype) for _ in range(9))
    expressions = [f"simd.{name}(x)" for name in names] + ["simd.copysign(x, y)", "np.floor(x)", "np.sqrt(x)"]
    over(kind, expressions)(x, y, outs)
    with np.errstate(all="ignore"):
        expected = [getattr(np, name)(x) for name in names] + [np.copysign(x, y), np.floor(x), np.sqrt(x)]
    for out, right in zip(outs, expected, strict=True):
        same(out, right)


@pytest.mark.parametrize(("dtype", "kind"), FLOAT_KINDS)
def test_a_fused_multiply_add_rounds_once_where_there_is_one(dtype, kind):
    x, y, z = (awkward(dtype, seed) for seed in (3, 4, 5))
    out = np.zeros(COUNT, dtype)
    over(kind, ["simd.fma(x, y, z)"], "xyz")(x, y, z, (out,))
    with np.errstate(all="ignore"):
        twice = x * y + z
        once = (x.astype(np.longdouble) * y + z).astype(dtype)
    if not simd_target.FMA:
        same(out, twice)
    elif dtype == np.float32:
        usual = np.isfinite(once)
        # longdouble rounds before float32 does: off in the last place at the most
        assert np.all(np.abs(out[usual] - once[usual]) <= 1.2e-7 * np.abs(once[usual]) + 1.5e-45)
        assert np.mean(out[usual] == once[usual]) > 0.999
        assert np.any(out != twice)


@pytest.mark.parametrize(("dtype", "kind"), FLOAT_KINDS)
@pytest.mark.parametrize(("name", "ulp"), [("reciprocal", 2), ("reciprocal_sqrt", 3)])
def test_reciprocals(dtype, kind, name, ulp):
    x = awkward(dtype, 6)
    out = np.zeros(COUNT, dtype)
    over(kind, [f"simd.{name}(x)"], "x")(x, (out,))
    with np.errstate(all="ignore"):
        exact = 1 / (x if name == "reciprocal" else np.sqrt(x))
    tiny = np.finfo(dtype).tiny
    usual = (np.abs(x) >= tiny) & np.isfinite(exact) & (np.abs(exact) >= tiny)
    assert np.all(np.abs(out[usual] - exact[usual]) <= ulp * np.spacing(np.abs(exact[usual])))
    special = (x == 0) | np.isinf(x) | np.isnan(x)
    same(out[special], exact[special])


@pytest.mark.parametrize(("dtype", "kind"), ALL_KINDS)
def test_selection(dtype, kind):
    x, y = awkward(dtype, 7), awkward(dtype, 8)
    outs = (*(np.zeros(COUNT, dtype) for _ in range(3)), np.zeros(COUNT, bool))
    choices = ["x < y, x, y", "x > 1, x, 1", "x < 2, 3, y", "x < y, x == y, x > 2"]
    over(kind, [f"simd.select({choice})" for choice in choices])(x, y, outs)
    right = (np.where(x < y, x, y), np.where(x > 1, x, dtype(1)), np.where(x < 2, dtype(3), y), np.where(x < y, x == y, x > 2))
    for out, expected in zip(outs, right, strict=True):
        same(out, expected)


@pytest.mark.parametrize("dtype", TYPES)
def test_conversions(dtype):
    x = awkward(dtype, 9)
    targets = {"to_f32": np.float32, "to_f64": np.float64, "to_i32": np.int32, "to_i64": np.int64, "to_u32": np.uint32, "to_u64": np.uint64}
    if dtype in FLOATS:
        x = np.where(np.abs(x) < 2e9, x, dtype(-1.5))  # what fits
        targets = {name: target for name, target in targets.items() if not name.startswith("to_u")}
    outs = tuple(np.zeros(COUNT, target) for target in targets.values())
    over(TYPES[dtype], [f"simd.{name}(x)" for name in targets], "x")(x, outs)
    with np.errstate(all="ignore"):
        for out, target in zip(outs, targets.values(), strict=True):
            same(out, x.astype(target))


@pytest.mark.parametrize("dtype", FLOATS)
def test_bits_of_floats(dtype):
    x = awkward(dtype, 10)
    ints = np.int32 if dtype == np.float32 else np.int64
    outs = (np.zeros(COUNT, ints), np.zeros(COUNT, dtype), np.zeros(COUNT, bool))
    over(TYPES[dtype], ["simd.float_bits(x)", "simd.bits_float(simd.float_bits(x))", "simd.is_finite(x)"], "x")(x, outs)
    assert np.array_equal(outs[0], x.view(ints))
    assert np.array_equal(outs[1].view(ints), x.view(ints))
    assert np.array_equal(outs[2], np.isfinite(x))


@pytest.mark.parametrize("dtype", INTS)
def test_counting_bits(dtype):
    x = awkward(dtype, 11)
    out = np.zeros(COUNT, dtype)
    over(TYPES[dtype], ["simd.population(x)"], "x")(x, (out,))
    assert np.array_equal(out, np.bitwise_count(x.view(f"u{x.itemsize}")))


@kernel
def _masks(x, out, lanes):
    for i in range(0, len(x), lanes):
        v = simd.load(x, i, simd.f32)
        m = v > 0
        k = i // lanes
        out[k, 0], out[k, 1], out[k, 2] = simd.any_of(m), simd.all_of(m), simd.none_of(m)
        out[k, 3], out[k, 4], out[k, 5] = simd.bits(m), simd.count(m), simd.trailing_zeros(simd.bits(m))
        out[k, 6] = simd.bits(simd.mask_from_bits(k * 5, v))
        out[k, 7] = simd.bits(simd.first_lanes(k - 2, v))


def test_masks_as_truth_and_as_bits():
    lanes, groups = simd.WIDTH, 64
    x = np.random.default_rng(0).normal(size=(groups, lanes)).astype(np.float32)
    x[0], x[1], x[2] = 1, -1, np.nan
    out = np.zeros((groups, 8), np.int64)
    _masks(x.ravel(), out, lanes)
    m = x > 0
    bits = (m * 2 ** np.arange(lanes)).sum(axis=1)
    lowest = np.where(m.any(axis=1), m.argmax(axis=1), 64)
    every = 2**lanes - 1
    first = 2 ** np.clip(np.arange(groups) - 2, 0, lanes) - 1
    expected = [m.any(axis=1), m.all(axis=1), ~m.any(axis=1), bits, m.sum(axis=1), lowest, np.arange(groups) * 5 & every, first]
    assert np.array_equal(out, np.stack(expected, axis=1))


@kernel
def _across(x, out):
    v = simd.load(x, 0, 8)
    out[0], out[1], out[2] = simd.sum_of(v), simd.min_of(v), simd.max_of(v)
    for k in range(8):
        out[3 + k] = simd.lane(v, 7 - k)
    simd.store(out, 11, simd.with_lane(v, 2, 100))
    simd.store(out, 19, simd.concatenate(simd.high_half(v), simd.low_half(v)))
    simd.store(out, 27, simd.iota(v))


@pytest.mark.parametrize("dtype", TYPES)
def test_across_lanes(dtype):
    x = np.random.default_rng(1).integers(0, 50, 8).astype(dtype)
    out = np.zeros(35, dtype)
    _across(x, out)
    changed = x.copy()
    changed[2] = 100
    expected = np.concatenate([[x.sum(), x.min(), x.max()], x[::-1], changed, x[4:], x[:4], np.arange(8)])
    assert np.array_equal(out, expected.astype(dtype))


def test_the_order_of_a_sum_is_by_halves():
    x = np.array([1e8, 1, -1e8, 1], np.float32)
    out = np.zeros(1, np.float32)
    over("f32x4", ["simd.f32x1(simd.sum_of(x))"], "x")(x, (out,))
    assert out[0] == (x[0] + x[2]) + (x[1] + x[3]) == 2.0


@pytest.mark.parametrize(("k", "lanes"), [(2, 4), (4, 4), (4, 8), (4, 16), (8, 8), (8, 16)])
def test_transposing_blocks(k, lanes):
    x = np.arange(k * lanes, dtype=np.float32)
    out = np.zeros_like(x)
    rows = ", ".join(f"simd.load(x, {i * lanes}, {lanes})" for i in range(k))
    stores = "".join(f"    simd.store(out, {i * lanes}, t[{i}])\n" for i in range(k))
    compiled(f"def run(x, out):\n    t = simd.transpose(({rows}))\n{stores}")(x, out)
    blocks = x.reshape(k, lanes // k, k)
    assert np.array_equal(out.reshape(k, lanes // k, k), blocks.transpose(2, 1, 0))


@kernel
def _constructed(out):
    simd.store(out, 0, simd.f32x8(2) + simd.f32x8(simd.i32x8(3)) + simd.f32x8(simd.m32x8(True)))
    simd.store(out, 8, simd.f32(1.5) + simd.to_f32(simd.i32(2)))
    return simd.lane(simd.f64(simd.i64(3)), 0) + simd.lane(simd.u32(7), 0)


def test_constructors():
    out = np.zeros(8 + simd.WIDTH, np.float32)
    assert _constructed(out) == 10.0
    assert np.all(out[:8] == 6.0)
    assert np.all(out[8:] == 3.5)


@kernel
def _numbers(x, n):
    return (
        simd.sqrt(x), simd.floor(x), simd.fma(x, x, x), simd.select(x > 1, x, 2.0), simd.any_of(x > 1), simd.bits(x > 1),
        simd.sum_of(x), simd.to_i32(x), simd.minimum(n, 2), simd.sin(x), simd.population(n), simd.is_finite(x),
    )  # fmt: skip


def test_functions_take_scalars():
    assert _numbers(2.25, 7) == (1.5, 2.0, 7.3125, 2.25, True, 1, 2.25, 2, 2, pytest.approx(np.sin(2.25)), 3, True)
