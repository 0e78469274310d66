"""`python -m maquette.bench [NAME …]`: runs benchmarks, each in its own process, and writes their sections of RESULTS.md."""

from __future__ import annotations

import argparse
import importlib
import os
import subprocess
import sys
from pathlib import Path

from . import limits, report
from .harness import Effort

NAMES = report.ORDER
SECTION_PARTS = {  # parts that can be measured separately
    "paths": ("cornell", "knot", "lamps", "glossy", "glass", "interior", "daylight", "evening", "door"),
    "formulas": ("512", "1024", "povray"), "start": ("waits",),
    "live": ("edits", "orbit", "refined"),
}  # fmt: skip
CORES = {"threads": 2, "start": 2, "live": 2, "cluster": 2, "cores": os.cpu_count() or 1}  # of a benchmark; one by default


def main(arguments: list[str] | None = None) -> int:
    """Run the given benchmarks; returns 1 if answers differed or a benchmark failed."""
    parts = "; of ".join(f"{name}: {', '.join(parts)}" for name, parts in SECTION_PARTS.items())
    parser = argparse.ArgumentParser(prog="python -m maquette.bench", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"which: {', '.join(NAMES)}; all when none is given")
    parser.add_argument("--quick", action="store_true", help="tiny sizes and two rounds: does it run? The times mean nothing")
    parser.add_argument("--simd", choices=list(limits.WIDTHS), default="", help="keep everybody to these vectors: sections of their own")
    parser.add_argument("--results", type=Path, help="the file to write (bench/RESULTS.md, but none with --quick)")
    parser.add_argument("--only", metavar="PART", default="", help=f"one part of {parts}")
    asked = parser.parse_args(arguments)
    if asked.results is None and not asked.quick:
        asked.results = report.RESULTS
    names = asked.names or list(NAMES)
    unknown = [name for name in names if name not in NAMES]
    if unknown:
        parser.error(f"no benchmark is called {unknown[0]}; there are: {', '.join(NAMES)}")
    if asked.only and any(asked.only not in SECTION_PARTS.get(name, ()) for name in names):
        parser.error(f"no part of {names[0]} is called {asked.only}")
    if len(names) > 1:
        return max(_run_in_process(name, asked) for name in names)
    known = limits.simd()
    limits.limit(os.environ, asked.simd, CORES.get(names[0], 1))
    if limits.simd() != known:  # the vectors of kernels are selected at import
        words = sys.argv[1:] if arguments is None else arguments
        return subprocess.run([sys.executable, "-P", "-m", "maquette.bench", *words]).returncode
    return run(names[0], asked.quick, asked.results, asked.only)


def _run_in_process(name: str, asked: argparse.Namespace) -> int:
    """Run one benchmark in its own process, as the libraries of peers conflict."""
    command = [sys.executable, "-P", "-m", "maquette.bench", name]
    command += ["--quick"] if asked.quick else []
    command += ["--simd", asked.simd] if asked.simd else []
    command += ["--only", asked.only] if asked.only else []
    command += ["--results", str(asked.results)] if asked.results else []
    return subprocess.run(command).returncode


def run(name: str, quick: bool, results: Path | None, only: str = "") -> int:
    """Run one benchmark, or one part of it, in this process."""
    print(f"{name}:", flush=True)
    module = importlib.import_module(f".{name}", __package__)
    effort = Effort(rounds=2, fewest=1) if quick else Effort()
    section: report.Section = module.section(quick, effort, only) if only else module.section(quick, effort)
    whole = [section, *section.parts]
    for line in (*(f"not measured: {why}" for one in whole for why in one.missing), *(line for one in whole for line in one.blocks)):
        print(line, end="\n\n", flush=True)
    if limits.simd():
        for one in whole:
            one.key, one.title = f"{one.key} {limits.simd()}", f"{one.title}, {limits.NAMES[limits.simd()]} for all"
    if results is not None:
        report.write(section, results)
    refused = [line for one in whole for line in one.refused]
    for line in refused:
        print(f"answers differ: {line}", file=sys.stderr)
    return 1 if refused else 0


if __name__ == "__main__":
    sys.exit(main())
