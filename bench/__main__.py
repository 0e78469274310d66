"""`python -m maquette.bench [NAME …]`: run benchmarks, each in a process of its own on one core, and put what they say into RESULTS.md."""

from __future__ import annotations

import argparse
import importlib
import os
import subprocess
import sys
from pathlib import Path

from . import report
from .harness import Effort

NAMES = ("rays", "build", "paths", "raster", "start")
LIBRARY_PATHS = ("/usr/lib/x86_64-linux-gnu", "/usr/lib/aarch64-linux-gnu", "/usr/lib/llvm-19/lib", "/usr/lib64")


def main(arguments: list[str] | None = None) -> int:
    """Run what is asked for; 1 if some answers differed or a benchmark failed."""
    parser = argparse.ArgumentParser(prog="python -m maquette.bench", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"which: {', '.join(NAMES)}; all when none is given")
    parser.add_argument("--quick", action="store_true", help="tiny sizes and two rounds: does it run? The times mean nothing")
    parser.add_argument("--results", type=Path, default=report.RESULTS, help="the file to write (default: bench/RESULTS.md)")
    asked = parser.parse_args(arguments)
    names = asked.names or list(NAMES)
    unknown = [name for name in names if name not in NAMES]
    if unknown:
        parser.error(f"no benchmark is called {unknown[0]}; there are: {', '.join(NAMES)}")
    if len(names) > 1:
        return max(_apart(name, asked) for name in names)
    limit(os.environ)
    return run(names[0], asked.quick, asked.results)


def _apart(name: str, asked: argparse.Namespace) -> int:
    """Run one benchmark in a process of its own: peers bring libraries that do not get on with each other."""
    command = [sys.executable, "-m", "maquette.bench", name, "--results", str(asked.results), *(["--quick"] if asked.quick else [])]
    return subprocess.run(command).returncode


def limit(environment: os._Environ[str]) -> None:
    """One core for this process and all it starts, before any library has asked how many there are.

    The place for other limits on everybody alike, such as narrower vectors: they too are read when libraries load.
    """
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    environment["NUMBA_NUM_THREADS"] = environment["OMP_NUM_THREADS"] = "1"
    environment["LP_NUM_THREADS"] = "0"  # llvmpipe: rasterize in the calling thread
    environment["LIBGL_ALWAYS_SOFTWARE"] = "1"
    library = next((p for folder in LIBRARY_PATHS for p in sorted(Path(folder).glob("libLLVM*19*")) if p.is_file()), None)
    if library and "DRJIT_LIBLLVM_PATH" not in environment:
        environment["DRJIT_LIBLLVM_PATH"] = str(library)


def run(name: str, quick: bool, results: Path) -> int:
    """Run one benchmark in this process."""
    print(f"{name}:", flush=True)
    module = importlib.import_module(f".{name}", __package__)
    section: report.Section = module.section(quick, Effort(rounds=2, fewest=1) if quick else Effort())
    for line in (*(f"not measured: {why}" for why in section.missing), *section.blocks):
        print(line, end="\n\n", flush=True)
    report.write(section, results)
    for line in section.refused:
        print(f"answers differ: {line}", file=sys.stderr)
    return 1 if section.refused else 0


if __name__ == "__main__":
    sys.exit(main())
