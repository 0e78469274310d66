"""SIMD vectors in kernels: code on 16, 8, 4 or 1 lanes, written as on numbers. See docs/simd.md."""

from importlib import import_module
from typing import Any

from .aligned_arrays import CACHE_LINE, aligned_empty, paged_empty  # noqa: F401 - public names of this package
from .target import WIDTH, WIDTH64  # noqa: F401

# The functions of kernels, by module. These modules import Numba: they are loaded when a kernel is compiled.
_FUNCTIONS = {
    "denormals": "flush_denormals restore_denormals",
    "constructors":
        "CONSTRUCTED bits_float f32 f32x1 f32x16 f32x2 f32x4 f32x8 f64 f64x1 f64x16 f64x2 f64x4 f64x8 float_bits "
        "i32 i32x1 i32x16 i32x2 i32x4 i32x8 i64 i64x1 i64x16 i64x2 i64x4 i64x8 iota m32 m32x1 m32x16 m32x2 m32x4 m32x8 "
        "m64 m64x1 m64x16 m64x2 m64x4 m64x8 to_f32 to_f64 to_i32 to_i64 to_u32 to_u64 u32 u32x1 u32x16 u32x2 u32x4 u32x8 "
        "u64 u64x1 u64x16 u64x2 u64x4 u64x8",
    "functions":
        "absolute all_of any_of bits ceil copysign count first_lanes floor fma is_finite mask_from_bits maximum minimum none_of "
        "population reciprocal reciprocal_sqrt rint select select_signature sqrt trailing_zeros trunc",
    "shuffles": "high_half concatenate lane low_half max_of min_of sum_of transpose with_lane",
    "elementary": "acos asin atan atan2 cos exp hypot log power sin sincos tan",
    "gather_scatter": "compress compress_store gather gather_rows scatter scatter_rows store_rows",
    "memory":
        "load load3 load_aligned masked_load masked_store prefetch read stack_array store store_aligned store_past write",
    "llvm_expr": "Value mask_bits",
    "vector_type": "Vector",
}  # fmt: skip
_MODULES = {name: module for module, names in _FUNCTIONS.items() for name in names.split()}


def __getattr__(name: str) -> Any:
    """A function of kernels, when it is first used."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    function = globals()[name] = getattr(import_module(f".{_MODULES[name]}", __name__), name)
    return function
