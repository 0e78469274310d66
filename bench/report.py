"""Writes bench/RESULTS.md: a section for each benchmark with machine, versions and tables. A run replaces only its own section."""

from __future__ import annotations

import os
import platform
import re
import subprocess
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path

from ..compiler.io.replace_file import replace_file
from ..lang.distribution import VERSION
from ..render.simd.target import cores
from . import harness

RESULTS = Path(__file__).resolve().parent / "RESULTS.md"
ORDER = (
    "rays", "build", "paths", "raster", "formulas", "edits", "start", "threads", "procedural", "slabs", "live", "imports", "cluster",
    "cores",
)  # fmt: skip
"""Of the sections; others follow in the order of their names."""
HEAD = """# Benchmarks: measured results

Written by `make bench`; a section is replaced when its benchmark runs again. Nothing here is written by hand.

How to read it: contenders take turns in one process (whole programs, where the section says so), on one core. *CPU* and *wall* are
medians of the rounds, with quartiles; *× ours* is how many times as long a peer takes as maquette, the median over rounds: above 1,
maquette is faster. *Build* comes before (trees, uploads, loading); *compile* is what the first run took more than later ones
(kernels compiled or loaded from their cache). Times stand only where the answers agreed, as the last line of each table says.
"""


@dataclass(slots=True)
class Section:
    """The section of a benchmark: `key` is its name on the command line, `text` the description, `blocks` tables and remarks.

    `parts` can be measured separately. Each is a section of its own after this one."""

    key: str
    title: str
    text: str
    blocks: list[str] = field(default_factory=list)
    versions: dict[str, str] = field(default_factory=dict)
    missing: Sequence[str] = ()
    refused: list[str] = field(default_factory=list)
    parts: list[Section] = field(default_factory=list)
    level: int = 2  # of its heading

    def add(self, title: str, results: Sequence[harness.Result], unit: str, scale: float = 1e6, by: str = "cpu") -> None:
        """Append a table of related cases. Rates are in `scale` units a second; rates and ratios by CPU or wall time."""
        lines = [f"**{title}**", table([r for r in results if not r.refused], unit, scale, by)]
        lines += [f"No times for {r.case.name}: answers differ: {r.refused}." for r in results if r.refused]
        agreed = [f"{r.case.name}: {r.agreement} ({len(r.times[0].runs)} rounds)" for r in results if not r.refused]
        self.blocks += [line for line in lines if line]
        if agreed:
            self.blocks.append("Answers. " + ".\n".join(agreed) + ".")
        self.refused += [f"{title}, {r.case.name}: {r.refused}" for r in results if r.refused]


def table(results: Sequence[harness.Result], unit: str, scale: float, by: str) -> str:
    """A markdown table with a row for each contender of each case; "" without cases."""
    rows = []
    for result in results:
        for k, times in enumerate(result.times):
            contender, cpu, wall = times.contender, times.spread("cpu"), times.spread("wall")
            compared = contender.name != harness.OURS and any(t.contender.name == harness.OURS for t in result.times)
            rows.append((
                result.case.name if k == 0 else "", contender.name,
                _ms(cpu.median), f"{_ms(cpu.low)} – {_ms(cpu.high)}", _ms(wall.median),
                f"{result.case.amount / scale / max(times.spread(by).median, 1e-9):.3g}" if unit else "",
                f"{result.ratio(contender.name, by):.2f}" if compared else "",
                _ms(contender.build.cpu) if contender.build else "", _ms(times.compile()), contender.note,
            ))  # fmt: skip
    head = ("", "", "CPU, ms", "quartiles", "wall, ms", unit, "× ours", "build, ms", "compile, ms", "note")
    return grid(head, rows) if rows else ""


def grid(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A markdown table: notes and columns without a head are left-aligned, numbers right-aligned; empty columns are omitted."""
    rows = [tuple(row) for row in rows]
    columns = [k for k in range(len(head)) if any(row[k] for row in rows)]
    sides = [":--" if head[k] in ("", "note") else "--:" for k in columns]
    lines = [[head[k] for k in columns], sides, *([row[k] for k in columns] for row in rows)]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _ms(seconds: float) -> str:
    milliseconds = seconds * 1e3
    return f"{milliseconds:.0f}" if milliseconds >= 100 else f"{milliseconds:.3g}"


# --- the file ------------------------------------------------------------------------------------------------------------


def write(section: Section, path: Path = RESULTS, machine: str | None = None) -> None:
    """Write a section and its parts, replacing those with the same keys."""
    sections = read(path)
    for part in (section, *section.parts):
        sections[part.key] = render(part, machine if machine is not None else machine_line())
    rank = {key: k for k, key in enumerate(ORDER)}
    keys = sorted(sections, key=lambda key: (rank.get(key.split(" ")[0], len(ORDER)), key))
    replace_file(path, ("\n\n".join([HEAD.strip(), *(sections[key].strip() for key in keys)]) + "\n").encode())


def read(path: Path) -> dict[str, str]:
    """The sections of a file by key; empty without a file."""
    if not path.exists():
        return {}
    parts = re.split(r"^(?=<!-- section .* -->$)", path.read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
    return {part.partition(" -->")[0].removeprefix("<!-- section "): part for part in parts}


def render(section: Section, machine: str) -> str:
    """A section as markdown."""
    versions = {**version_of("maquette", "numba", "numpy"), **section.versions}
    lines = [
        f"<!-- section {section.key} -->\n{'#' * section.level} {section.title}",
        section.text.strip(),
        f"{machine}. {', '.join(f'{name} {version}' for name, version in versions.items())}.",
        *(f"Not measured: {why}." for why in section.missing),
        *section.blocks,
    ]
    return "\n\n".join(line for line in lines if line)


# --- machine and versions ------------------------------------------------------------------------------------------------------


def version_of(*packages: str) -> dict[str, str]:
    """Installed versions; for a checkout of maquette with its commit."""
    versions = {}
    for name in packages:
        try:
            versions[name] = VERSION if name == harness.OURS else metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
        if name == harness.OURS and (commit := _commit()):
            versions[name] += f" ({commit})"
    return versions


def _commit() -> str:
    where = Path(__file__).resolve().parent
    try:
        said = subprocess.run(["git", "describe", "--always", "--dirty"], cwd=where, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return ""
    return said.stdout.strip()


def machine_line() -> str:
    """Processor, vector units, used cores, load, system, day."""
    model, flags = _processor()
    vectors = next((name for name, flag in (("AVX-512", "avx512f"), ("AVX2", "avx2"), ("SSE", "sse2")) if flag in flags), "no SIMD known")
    used = cores()
    load = os.getloadavg()[0]
    day = datetime.now(UTC).strftime("%Y-%m-%d")
    return (
        f"{day}, {model} ({vectors}), {used} of {os.cpu_count()} cores, load {load:.1f} at the end, "
        f"{platform.system()} {platform.release().split('-')[0]}, Python {platform.python_version()}"
    )


def _processor() -> tuple[str, frozenset[str]]:
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return platform.processor() or platform.machine(), frozenset()
    fields: Mapping[str, str] = {k.strip(): v.strip() for k, _, v in (line.partition(":") for line in text.splitlines()) if k.strip()}
    return fields.get("model name", platform.machine()), frozenset(fields.get("flags", "").split())
