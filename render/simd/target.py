"""The target machine of kernels: instruction set, LLVM's processor and features, lanes of a vector.

Code is compiled for fixed levels of instruction sets, not for the current machine, so that it runs on every machine of the level:
x86-64-v4 (AVX-512), x86-64-v3 (AVX2), x86-64-v2 (SSE4.2), and the baseline of aarch64 (NEON). The highest level of the machine is chosen.

MAQUETTE_SIMD=avx512|avx2|sse|scalar selects a level by its vectors, to test every width on one computer. "sse" means any 16-byte vectors
(also NEON), "scalar" no vectors. MAQUETTE_SIMD=native compiles for all features of the current machine.

MAQUETTE_REQUESTS=FOLDER lists in the folder which kernels are needed, to compile them later (tools/wheel.py). Then a level above the
machine's runs too: with the lanes of the level, which are part of types, and the machine's instructions.
"""

from __future__ import annotations

import os
from typing import NamedTuple

import llvmlite.binding as llvm

from ...compiler.io.environment import SettingError

BYTES = {"avx512": 64, "avx2": 32, "sse": 16, "scalar": 4}
"""Bytes of a vector in each instruction set."""
NATIVE = "native"


class Level(NamedTuple):
    """What code is compiled for."""

    isa: str  # of BYTES
    cpu: str  # LLVM's name of the processor
    features: str  # in LLVM's notation, beside those of the processor
    fma: bool  # whether fused multiply-add is one instruction


# Without "-prefer-256-bit" LLVM splits vectors of 64 bytes.
X86_LEVELS = {
    "avx512": Level("avx512", "x86-64-v4", "-prefer-256-bit", True),
    "avx2": Level("avx2", "x86-64-v3", "", True),
    "sse": Level("sse", "x86-64-v2", "", False),
    "scalar": Level("scalar", "x86-64-v2", "", False),
}
_V2 = ("cx16", "popcnt", "sse3", "ssse3", "sse4.1", "sse4.2")
_V3 = (*_V2, "avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe")
_V4 = (*_V3, "avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl")
_LEVELS = (("avx512", _V4), ("avx2", _V3), ("sse", _V2))


def _host_features() -> dict[str, bool]:
    """Features of the processor."""
    try:
        return dict(llvm.get_host_cpu_features())
    except RuntimeError:
        return {}


def highest(features: dict[str, bool]) -> str:
    """The instruction set of the highest level that a processor with these features has."""
    return next((isa for isa, needed in _LEVELS if all(features.get(name) for name in needed)), "sse")


def choose(requested: str, triple: str, features: dict[str, bool]) -> Level:
    """The level to compile for on a machine with these features: the highest, or the one asked for.

    Raises SettingError for an unknown name.
    """
    best = highest(features)
    if requested not in ("", NATIVE, *BYTES):
        raise SettingError(f"MAQUETTE_SIMD={requested} is not an instruction set; choose from: {', '.join(BYTES)}, {NATIVE}")
    x86 = triple.startswith("x86_64")
    if requested == NATIVE or not (x86 or triple.startswith("aarch64")):
        text = ",".join(f"{'+' if on else '-'}{name}" for name, on in sorted(features.items()))
        fma = bool(features.get("fma")) or ("neon" in features and not x86)
        return Level(best if requested in ("", NATIVE) else requested, llvm.get_host_cpu_name(), text, fma)
    if not x86:
        return Level(requested or best, "generic", "+neon", True)
    level = X86_LEVELS[requested or best]
    return level if level.isa in ("avx512", "avx2") or all(features.get(name) for name in _V2) else level._replace(cpu="x86-64")


def _runnable(level: Level, features: dict[str, bool]) -> Level:
    """A level with the lanes of another one and the instructions of a machine with these features."""
    best = X86_LEVELS.get(highest(features), level)
    return level if BYTES[level.isa] <= BYTES[best.isa] else best._replace(isa=level.isa)


HOST = _host_features()
REQUESTS = os.environ.get("MAQUETTE_REQUESTS", "")
LEVEL = choose(os.environ.get("MAQUETTE_SIMD", ""), llvm.get_process_triple(), HOST)
if REQUESTS:
    LEVEL = _runnable(LEVEL, HOST)
ISA, FMA = LEVEL.isa, LEVEL.fma
_CODE = next((isa for isa, level in X86_LEVELS.items() if level.cpu == LEVEL.cpu), ISA) if REQUESTS else ISA
X86 = llvm.get_process_triple().startswith(("x86_64", "i386", "i686"))
AVX512, AVX2 = _CODE == "avx512", _CODE == "avx2"
"""Whether code may use the instructions of these sets."""
CHECKED = os.environ.get("MAQUETTE_CHECKED") == "1"
"""Whether kernels check the places they access; see bounds_check.py."""
WIDTH = BYTES[ISA] // 4
"""Lanes of four bytes in a vector: 16, 8, 4 or 1."""
WIDTH64 = max(1, BYTES[ISA] // 8)
"""Lanes of eight bytes in a vector: 8, 4, 2 or 1."""


def check_host() -> None:
    """Raise SettingError if this machine does not run the code of the level."""
    best = highest(HOST)
    if BYTES[_CODE] > BYTES[best]:
        raise SettingError(f"MAQUETTE_SIMD={ISA} is more than this machine has ({best})")


def fingerprint() -> str:
    """Text that differs between targets whose compiled code differs."""
    return " ".join((*(("checked",) if CHECKED else ()), ISA, llvm.get_process_triple(), LEVEL.cpu, LEVEL.features))


def cores() -> int:
    """Count the processors that this process may run on."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
