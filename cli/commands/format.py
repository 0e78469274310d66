"""The `format` command: formats scenes; each file is replaced atomically."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from ...compiler.io.regular_files import MAX_SOURCE, read_bytes, size
from ...compiler.io.replace_file import replace_file
from ...lang.diagnostics import Diagnostics, Span
from .. import common_options as shared
from .. import terminal

_FILES = click.Path(exists=True, dir_okay=False, path_type=Path, allow_dash=True)


@click.command("format")
@click.argument("scenes", metavar="SCENE...", type=_FILES, nargs=-1, required=True)
@click.option("--check", "only_check", is_flag=True, help="Write nothing; print the unformatted scenes and exit with 1 if there are any.")
@shared.examples("maquette format room.scene", "maquette format --check examples/*.scene", "maquette format - < room.scene")
@click.pass_context
def command(ctx: click.Context, scenes: tuple[Path, ...], only_check: bool) -> None:
    """Format SCENEs in place; - reads a scene from stdin and writes it to stdout.

    Changes only spaces, blank lines and the lines of braces. Comments and other line breaks stay. A scene with syntax errors is not
    changed; its errors are printed.
    """
    if other := next((path for path in scenes if path.suffix != ".scene" and path != Path("-")), None):
        raise click.UsageError(f"{other}: only .scene files can be formatted")
    failed = False
    for path in scenes:
        failed = not _format(path, only_check) or failed
    ctx.exit(1 if failed else 0)


def _format(path: Path, only_check: bool) -> bool:
    """Format one scene. Returns whether it has no errors and, with `only_check`, is formatted."""
    from ...lang.syntax.formatter import format_text
    from ...lang.syntax.parser import decode

    piped = path == Path("-")
    name = "stdin" if piped else str(path)
    data = sys.stdin.buffer.read(MAX_SOURCE + 1) if piped else read_bytes(path, MAX_SOURCE)
    diagnostics = Diagnostics()
    if piped and len(data) > MAX_SOURCE:
        diagnostics.error("stdin is too big", Span(name), f"the limit is {size(MAX_SOURCE)}")
        text = None
    else:
        text = decode(data, name, diagnostics)
    done = None if text is None else format_text(text, name, diagnostics)
    if done is None:
        terminal.report(diagnostics.items, {name: text} if piped else {})
        return False
    changed = done.encode() != data
    if only_check:
        if changed:
            click.echo(name)
        return not changed
    if piped:
        click.echo(done, nl=False)
    elif changed:
        replace_file(path, done.encode())
        click.echo(name)
    return True
