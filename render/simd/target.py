"""The target machine of kernels: instruction set, lanes of a vector, and Numba's target settings.

MAQUETTE_SIMD=avx512|avx2|sse|scalar selects a smaller instruction set than the machine's, to test every width on one computer. "sse" means
any 16-byte vectors (also NEON), "scalar" no vectors.
"""

from __future__ import annotations

import os

import llvmlite.binding as llvm

BYTES = {"avx512": 64, "avx2": 32, "sse": 16, "scalar": 4}
"""Bytes of a vector in each instruction set."""

_AVX512 = ("avx512f", "avx512vl", "avx512bw", "avx512dq")
# Features to remove with each set; LLVM also removes the features that depend on them.
_FIRST_IN_AVX512 = ("avx512", "avx10", "evex512", "amx")
_FIRST_IN_AVX2 = ("avx", "fma", "f16c", "xop", "vaes", "vpclmulqdq", "sha512", "sm3", "sm4")


def _host() -> dict[str, bool]:
    """Features of the processor."""
    try:
        return dict(llvm.get_host_cpu_features())
    except RuntimeError:
        return {}


def _best(features: dict[str, bool]) -> str:
    if all(features.get(name) for name in _AVX512) and features.get("fma"):
        return "avx512"
    if features.get("avx2") and features.get("fma"):
        return "avx2"
    return "sse"


def _restrict(features: dict[str, bool], isa: str) -> dict[str, bool]:
    """Features of the machine that belong to `isa`."""
    gone: tuple[str, ...] = ()
    if isa == "avx2":
        gone = _FIRST_IN_AVX512
    elif isa in ("sse", "scalar"):
        gone = (*_FIRST_IN_AVX512, *_FIRST_IN_AVX2)
    return {name: on and not name.startswith(gone) for name, on in features.items()} if gone else features


def choose(asked: str, features: dict[str, bool]) -> tuple[str, dict[str, bool]]:
    """Return the instruction set and its features on a machine with these; without a name, the best one.

    Raises ValueError for an unknown name; RuntimeError if the machine lacks the set.
    """
    best = _best(features)
    asked = asked or best
    if asked not in BYTES:
        raise ValueError(f"MAQUETTE_SIMD={asked} is not an instruction set; choose from: {', '.join(BYTES)}")
    if BYTES[asked] > BYTES[best]:
        raise RuntimeError(f"MAQUETTE_SIMD={asked} is more than this machine has ({best})")
    return asked, _restrict(features, asked) if asked != best else features


ISA, FEATURES = choose(os.environ.get("MAQUETTE_SIMD", ""), _host())
CPU = llvm.get_host_cpu_name()
"""LLVM's name of the processor."""
X86 = llvm.get_process_triple().startswith(("x86_64", "i386", "i686"))
AVX512, AVX2 = ISA == "avx512", ISA == "avx2"
FMA = bool(FEATURES.get("fma")) or ("neon" in FEATURES and not X86)
"""Whether fused multiply-add is one instruction; elsewhere it would be a library call."""
CHECKED = os.environ.get("MAQUETTE_CHECKED") == "1"
"""Whether kernels check the places they access; see bounds_check.py."""
WIDTH = BYTES[ISA] // 4
"""Lanes of four bytes in a vector: 16, 8, 4 or 1."""
WIDTH64 = max(1, BYTES[ISA] // 8)
"""Lanes of eight bytes in a vector: 8, 4, 2 or 1."""


def features_text() -> str:
    """The features in LLVM's notation."""
    return ",".join(f"{'+' if on else '-'}{name}" for name, on in sorted(FEATURES.items()))


def fingerprint() -> str:
    """Text that differs between machines whose compiled code differs."""
    return " ".join(("checked " * CHECKED + ISA, CPU, *sorted(feature for feature, on in FEATURES.items() if on)))


def cores() -> int:
    """Count the processors that this process may run on."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
