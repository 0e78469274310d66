"""Limits of all contenders: cores and, optionally, vector width. They are set before libraries load."""

from __future__ import annotations

import os
from collections.abc import MutableMapping
from pathlib import Path

from .harness import Missing

LIBRARY_PATHS = ("/usr/lib/x86_64-linux-gnu", "/usr/lib/aarch64-linux-gnu", "/usr/lib/llvm-19/lib", "/usr/lib64")
WIDTHS = {"avx512": "", "avx2": "256", "sse": "128"}  # llvmpipe's vector width in bits; "": its default
EMBREE = {"avx512": "avx512", "avx2": "avx2", "sse": "sse4.2"}
NAMES = {"avx512": "AVX-512", "avx2": "AVX2", "sse": "SSE"}
SIMD = "MAQUETTE_SIMD"


def limit(environment: MutableMapping[str, str], simd: str = "", cores: int = 1) -> None:
    """Limit this process and its children to `cores` cores and, if given, to the vectors of `simd`, one of WIDTHS."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[-cores:])
    environment["NUMBA_NUM_THREADS"] = environment["OMP_NUM_THREADS"] = "1"
    environment["LP_NUM_THREADS"] = "0"  # llvmpipe: rasterize in the calling thread
    environment["LIBGL_ALWAYS_SOFTWARE"] = "1"
    library = next((p for folder in LIBRARY_PATHS for p in sorted(Path(folder).glob("libLLVM*19*")) if p.is_file()), None)
    if library and "DRJIT_LIBLLVM_PATH" not in environment:
        environment["DRJIT_LIBLLVM_PATH"] = str(library)
    if simd:
        environment[SIMD] = simd
        if WIDTHS[simd]:
            environment["LP_NATIVE_VECTOR_WIDTH"] = WIDTHS[simd]


def simd() -> str:
    """The common vector limit, or "" without one."""
    return os.environ.get(SIMD, "")


def require_limit(peer: str) -> None:
    """Raise Missing if vectors are limited and this peer cannot be limited."""
    if simd():
        raise Missing(f"{peer} cannot be kept to {NAMES.get(simd(), simd())}")
