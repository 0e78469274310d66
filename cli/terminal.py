"""Terminal: diagnostics with source lines, tables; Ctrl-C."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import click

from ..compiler.io.sandbox import source_text
from ..lang import diagnostics
from ..lang.plain_values import show_value
from .process import supervisor

if TYPE_CHECKING:
    from ..compiler import ir
    from ..compiler.plan.decision import Decision
    from ..compiler.plan.plan import Plan

MAX_SHOWN = 100  # diagnostics of a severity
_STYLES = {"error": "bold red", "warning": "bold yellow", "note": "bold cyan"}


def supports_color(stream: Any) -> bool:
    """Whether `stream` is a terminal that shows colour, and NO_COLOR is not set."""
    return stream.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"


def report(items: Iterable[diagnostics.Diagnostic], texts: Mapping[str, str | None] = MappingProxyType({})) -> None:
    """Print diagnostics to stderr, sorted and without duplicates; of many, the first of each severity.

    `texts` are sources that are not files.
    """
    cache = dict(texts)
    shown: Counter[str] = Counter()

    def source(name: str) -> str | None:
        if name not in cache:
            cache[name] = source_text(name)
        return cache[name]

    for d in diagnostics.sort_diagnostics(items):
        shown[d.severity] += 1
        if shown[d.severity] > MAX_SHOWN:
            continue
        text = diagnostics.render_text(d, source)
        if supports_color(sys.stderr):
            _print_coloured(d, text)
        else:
            click.echo(text, err=True)
    for severity, count in shown.items():
        if (more := count - MAX_SHOWN) > 0:
            click.echo(f"{more:,} more {severity}{'' if more == 1 else 's'}: `maquette check --json` shows all", err=True)


def _print_coloured(d: diagnostics.Diagnostic, text: str) -> None:
    from rich.console import Console
    from rich.text import Text

    style = _STYLES[d.severity]
    place = f"{d.span}: " if d.span else ""
    first, *rest = text.removeprefix(place).split("\n")
    shown = Text.assemble((place, "bold"), (f"{d.severity}:", style), first.removeprefix(f"{d.severity}:"))
    for line in rest:
        shown.append("\n")
        shown.append(line, style=style if line.partition("| ")[2].lstrip(" ").startswith("^") else "")
    Console(stderr=True, highlight=False, soft_wrap=True).print(shown)


def table(headings: Sequence[str], rows: Iterable[Sequence[str]], marked: Iterable[bool] = ()) -> None:
    """Print a table to stdout, with marked rows in bold; in plain columns if stdout is not a terminal."""
    rows = [tuple(row) for row in rows]
    if supports_color(sys.stdout):
        from rich.console import Console
        from rich.table import Table

        shown = Table(box=None, header_style="bold", pad_edge=False)
        for heading in headings:
            shown.add_column(heading, overflow="fold")
        for row, bold in zip(rows, [*marked] or [False] * len(rows), strict=True):
            shown.add_row(*row, style="bold" if bold else "")
        Console(highlight=False).print(shown)
        return
    widths = [max(len(row[i]) for row in (tuple(headings), *rows)) for i in range(len(headings))]
    for row in (tuple(headings), *rows):
        click.echo("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())


def explain(scene: ir.Scene, plan: Plan, matters: Iterable[Decision]) -> None:
    """Print the decisions that matter most, every decision with its reason and its switch, and the defaults added to the scene."""
    click.echo("The decisions with the largest effect on this scene:")
    for decision in matters:
        click.echo(f"  {decision.name} = {show_value(decision.value)}: {decision.reason}")
    click.echo("\nAll decisions:")
    decisions = list(plan.decisions.values())
    rows = [(d.name, show_value(d.value), d.reason, d.fixed or d.switch) for d in decisions]
    table(("decision", "value", "reason", "changed by"), rows, [d.overridden for d in decisions])
    for added in scene.defaults:
        click.echo(f"added: {added}")


def inspect(scene: ir.Scene, about: Sequence[str] = ()) -> None:
    """Print a summary of the scene: lines about its file, rows of each table, names of cameras and lights, params, files."""
    click.echo(f"{scene.name}")
    for line in about:
        click.echo(line)
    tables = scene.tables._asdict()
    rows = [(name, str(len(rows[0])), _names(scene, name)) for name, rows in tables.items() if name != "pools" and len(rows[0])]
    pools = scene.tables.pools
    rows += [("vertices", str(len(pools.positions)), ""), ("triangles", str(len(pools.triangles)), "")]
    table(("table", "rows", "names"), rows)
    for param in scene.params:
        unit = f" {param.unit}" if param.unit else ""
        within = f" in {_range(param.range)}" if param.range else ""
        click.echo(f"param {param.name}: {param.type} = {show_value(param.value)}{unit}{within}  {param.doc}".rstrip())
    if scene.duration is not None:
        click.echo(f"animation: {scene.duration:g} s at {scene.fps:g} frames a second")
    for added in scene.defaults:
        click.echo(f"added: {added}")
    for file in scene.files:
        click.echo(f"file: {file}")


def _range(values: tuple[Any, ...]) -> str:
    if len(values) == 2 and all(isinstance(v, int | float) for v in values):
        return f"{show_value(values[0])}..{show_value(values[1])}"
    return f"[{', '.join(map(show_value, values))}]"


def _names(scene: ir.Scene, table_name: str, most: int = 8) -> str:
    names = [name for name in dict.fromkeys(getattr(scene.names, table_name, ())) if name]
    return ", ".join(names[:most]) + (f", … {len(names) - most} more" if len(names) > most else "")


@contextmanager
def catch_interrupt() -> Iterator[threading.Event]:
    """An event that the first Ctrl-C, SIGTERM or SIGHUP sets; the second raises KeyboardInterrupt at once.

    SIGTERM ends jobs of batch systems, SIGHUP those of a terminal that closes; the latter stays ignored under nohup. Signals within
    `supervisor.APART` count as one: `timeout` and batch systems send one to a process and to its group.
    """
    event = threading.Event()
    first = 0.0

    def interrupt(number: int, frame: Any) -> None:
        nonlocal first
        now = time.monotonic()
        if not event.is_set():
            first = now
            event.set()
        elif now - first > supervisor.APART:
            raise KeyboardInterrupt

    numbers = [signal.SIGINT, signal.SIGTERM]
    if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) != signal.SIG_IGN:
        numbers.append(signal.SIGHUP)
    before = {number: signal.signal(number, interrupt) for number in numbers}
    try:
        yield event
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
