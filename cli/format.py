"""The `format` command: scenes laid out in the standard way, each written whole or not at all."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from ..compiler.io.replace_file import replace_file
from ..lang.diagnostics import Diagnostics
from . import common_options as shared
from . import terminal

_FILES = click.Path(exists=True, dir_okay=False, path_type=Path, allow_dash=True)


@click.command("format")
@click.argument("scenes", metavar="SCENE...", type=_FILES, nargs=-1, required=True)
@click.option("--check", "only_check", is_flag=True, help="Write nothing: name the scenes that are laid out otherwise, and exit with 1.")
@shared.examples("maquette format room.scene", "maquette format --check examples/*.scene", "maquette format - < room.scene")
@click.pass_context
def format_command(ctx: click.Context, scenes: tuple[Path, ...], only_check: bool) -> None:
    """Lay SCENEs out in the standard way, in place; - reads one from stdin and writes it to stdout.

    Only spaces, blank lines and the lines of braces change: comments, and where lines are broken, stay yours. A scene with syntax
    errors stays as it is, and its errors are told.
    """
    if unlike := next((path for path in scenes if path.suffix != ".scene" and path != Path("-")), None):
        raise click.UsageError(f"{unlike}: only .scene files are laid out")
    failed = False
    for path in scenes:
        failed = not _laid_out(path, only_check) or failed
    ctx.exit(1 if failed else 0)


def _laid_out(path: Path, only_check: bool) -> bool:
    """Lays out one scene. Returns whether it has no errors and, where it is only checked, is in order."""
    from ..lang.syntax.formatter import format_text
    from ..lang.syntax.parser import decode

    piped = path == Path("-")
    name = "stdin" if piped else str(path)
    data = sys.stdin.buffer.read() if piped else path.read_bytes()
    found = Diagnostics()
    text = decode(data, name, found)
    done = None if text is None else format_text(text, name, found)
    if done is None:
        terminal.report(found.items, {name: text} if piped else {})
        return False
    changed = done.encode() != data
    if only_check:
        if changed:
            click.echo(name)
        return not changed
    if piped:
        click.echo(done, nl=False)
    elif changed:
        replace_file(path.resolve(), done.encode())
        click.echo(name)
    return True
