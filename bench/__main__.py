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
    "paths": ("cornell", "knot", "lamps", "glossy", "glass", "interior", "slab", "milk", "haze", "cloud", "daylight", "evening", "door"),
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
    options = parser.parse_args(arguments)
    if options.results is None and not options.quick:
        options.results = report.RESULTS
    names = options.names or list(NAMES)
    unknown = [name for name in names if name not in NAMES]
    if unknown:
        parser.error(f"no benchmark is called {unknown[0]}; there are: {', '.join(NAMES)}")
    if options.only and any(options.only not in SECTION_PARTS.get(name, ()) for name in names):
        parser.error(f"no part of {names[0]} is called {options.only}")
    if len(names) > 1:
        return max(_run_in_process(name, options) for name in names)
    limited = limits.simd()
    limits.limit(os.environ, options.simd, CORES.get(names[0], 1))
    if limits.simd() != limited:  # the vectors of kernels are selected at import
        words = sys.argv[1:] if arguments is None else arguments
        return subprocess.run([sys.executable, "-P", "-m", "maquette.bench", *words]).returncode
    return run(names[0], options.quick, options.results, options.only)


def _run_in_process(name: str, options: argparse.Namespace) -> int:
    """Run one benchmark in its own process, as the libraries of peers conflict."""
    command = [sys.executable, "-P", "-m", "maquette.bench", name]
    command += ["--quick"] if options.quick else []
    command += ["--simd", options.simd] if options.simd else []
    command += ["--only", options.only] if options.only else []
    command += ["--results", str(options.results)] if options.results else []
    return subprocess.run(command).returncode


def run(name: str, quick: bool, results: Path | None, only: str = "") -> int:
    """Run one benchmark, or one part of it, in this process."""
    print(f"{name}:", flush=True)
    module = importlib.import_module(f".{name}", __package__)
    effort = Effort(rounds=2, fewest=1) if quick else Effort()
    section: report.Section = module.section(quick, effort, only) if only else module.section(quick, effort)
    parts = [section, *section.parts]
    for line in (*(f"not measured: {why}" for part in parts for why in part.missing), *(line for part in parts for line in part.blocks)):
        print(line, end="\n\n", flush=True)
    if limits.simd():
        for part in parts:
            part.key, part.title = f"{part.key} {limits.simd()}", f"{part.title}, {limits.NAMES[limits.simd()]} for all"
    if results is not None:
        report.write(section, results)
    refused = [line for part in parts for line in part.refused]
    for line in refused:
        print(f"answers differ: {line}", file=sys.stderr)
    return 1 if refused else 0


if __name__ == "__main__":
    sys.exit(main())
