"""Shared helpers of vector tests: special numbers of each type, and kernels over arrays from a line of code."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from maquette.render import simd
from maquette.render.jit.kernel import kernel
from numpy.typing import NDArray

COUNT = 10_000 // 64 * 64 + 64
TYPES = {
    np.float32: "f32", np.float64: "f64", np.int32: "i32", np.int64: "i64", np.uint32: "u32", np.uint64: "u64",
}  # fmt: skip
FLOATS, INTS = (np.float32, np.float64), (np.int32, np.int64, np.uint32, np.uint64)


def awkward(dtype: Any, seed: int = 0, count: int = COUNT) -> NDArray[Any]:
    """Numbers of random bits, with the special ones of the type."""
    random, size = np.random.default_rng(seed), np.dtype(dtype).itemsize
    numbers = random.integers(0, 2 ** (8 * size), count, dtype=np.uint32 if size == 4 else np.uint64).view(dtype)
    numbers[: count // 2] = random.integers(-9, 10, count // 2).astype(dtype)
    if np.issubdtype(dtype, np.floating):
        limits = np.finfo(dtype)
        numbers[count // 4 : count // 2] = random.normal(size=count // 2 - count // 4)
        special = [0.0, -0.0, 1, -1, np.inf, -np.inf, np.nan, limits.max, -limits.max, limits.tiny, limits.tiny / 8, -limits.tiny / 8]
    else:
        limits = np.iinfo(dtype)
        special = [0, 1, 2, limits.max, limits.min, limits.max - 1, limits.min + 1]
    places = random.permutation(count)[: 8 * len(special)]
    numbers[places] = np.resize(np.array(special, dtype), len(places))
    return numbers


def over(kind: str, expressions: Sequence[str], inputs: str = "xy") -> Callable[..., Any]:
    """A compiled function of arrays and a tuple of outputs: one an expression of vectors of `kind` ("f32x4"), named as in `inputs`."""
    lanes = simd.CONSTRUCTED[getattr(simd, kind)].lanes
    lines = [
        f"def run({', '.join(f'{name}_' for name in inputs)}, outs):",
        f"    for i in range(0, len({inputs[0]}_), {lanes}):",
        *(f"        {name} = simd.load({name}_, i, {lanes})" for name in inputs),
        *(f"        simd.store(outs[{k}], i, {expression})" for k, expression in enumerate(expressions)),
    ]
    return compiled("\n".join(lines))


def compiled(source: str) -> Any:
    """Compile the function `run` of a source text."""
    space: dict[str, Any] = {"simd": simd, "np": np}
    exec(source, space)
    return kernel(space["run"])


def widths(dtype: Any) -> list[str]:
    """Vector types of a number: the native one, and a wider or narrower one unless a width is forced."""
    name = TYPES[dtype]
    return [name] if "MAQUETTE_SIMD" in os.environ else [name, f"{name}x4" if simd.WIDTH > 8 else f"{name}x16"]


def same(values: NDArray[Any], expected: NDArray[Any]) -> None:
    """Check equal bits; all NaNs count as equal."""
    expected = np.asarray(expected).astype(values.dtype) if values.dtype != np.bool_ else np.asarray(expected, bool)
    wrong = (values != expected) & ~(np.isnan(values) & np.isnan(expected)) if values.dtype.kind == "f" else values != expected
    if values.dtype.kind == "f":
        wrong |= (np.signbit(values) != np.signbit(expected)) & ~np.isnan(values)
    lanes = np.flatnonzero(wrong)
    assert not len(lanes), f"{len(lanes)} lanes differ, the first at {lanes[0]}: {values[lanes[0]]!r} and not {expected[lanes[0]]!r}"
