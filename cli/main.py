"""Entry point of the `maquette` command. Exit codes: 0 done, 1 errors, 2 wrong usage, 130 interrupted."""

from __future__ import annotations

import contextlib
import errno
import importlib
import io
import os
import sys
from typing import Any

import click

from .. import __version__
from ..compiler.io.environment import SettingError
from ..lang.diagnostics import SceneError
from . import common_options as shared
from . import memory, terminal
from .job import start_time

COMMANDS = {  # modules of `commands`, in the order of --help, which imports none of them
    "new": "Write the starter scene NAME.scene.",
    "render": "Render SCENE to a picture or an animation.",
    "check": "Report errors and warnings in SCENES without rendering.",
    "inspect": "Show the compiled SCENE.",
    "explain": "Show the render plan of SCENE with reasons.",
    "chart": "Measure error against time over backends and settings.",
    "compare": "Measure the difference of A from B.",
    "watch": "Show SCENE in a window that follows edits, or write a picture at every save.",
    "test": "Test scenes: their asserts, and their pictures against kept ones.",
    "sweep": "Render SCENE over values of its params, on one labelled sheet.",
    "thumbnail": "Draw a picture of each of ASSETS, which are files or folders of them.",
    "convert": "Convert IN for other programs.",
    "measure": "Measure the parts of SCENE: size, volume, area, center, mass, inertia; and its light.",
    "format": "Format SCENEs in place; - reads a scene from stdin and writes it to stdout.",
    "lsp": "Serve an editor: errors while typing, completion, docs, renames.",
    "doctor": "Show what this installation renders with.",
}


class Commands(click.Group):
    """The command group. Converts every exception to a message on stderr and an exit code."""

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except (click.ClickException, click.exceptions.Exit):
            raise
        except SceneError as error:
            terminal.report(error.diagnostics)
            ctx.exit(1)
        except (KeyboardInterrupt, click.Abort):
            ctx.exit(130)
        except BrokenPipeError:  # the reader of stdout has ended, as in `maquette inspect a.scene | head -1`
            ctx.exit(1)
        except OSError as error:
            click.echo(f"error: {memory.refused_library(error) or _os_message(error)}", err=True)
            ctx.exit(1)
        except UnicodeEncodeError as error:
            name = error.object[error.start : error.end]
            click.echo(f"error: no file name has `{ascii(name)[1:-1]}` here, where names are {error.encoding}: set PYTHONUTF8=1", err=True)
            ctx.exit(1)
        except SettingError as error:
            click.echo(f"error: {error}", err=True)
            ctx.exit(1)
        except MemoryError:
            click.echo("error: not enough memory for this picture: give a smaller --size, or fewer channels by --aov", err=True)
            ctx.exit(1)
        except Exception as error:
            if why := memory.refused_library(error):
                click.echo(f"error: {why}", err=True)
                ctx.exit(1)
            if os.environ.get("MAQUETTE_TRACEBACK"):
                raise
            click.echo(f"internal error: {type(error).__name__}: {error}", err=True)
            click.echo("This is a bug in maquette, not an error in the scene. MAQUETTE_TRACEBACK=1 shows the traceback.", err=True)
            ctx.exit(1)

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The object `command` of the module of this name in `commands`, which is imported here."""
        return importlib.import_module(f".commands.{cmd_name}", __package__).command if cmd_name in COMMANDS else None

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="maquette")
@shared.examples("maquette render examples/hello.scene -o hello.png", "maquette watch room.scene")
def cli() -> None:
    """Compile scenes (.scene, USD, glTF and files of meshes) and render them.

    Exit codes: 0 done, warnings or not; 1 errors; 2 wrong usage; 130 interrupted.
    """


def _os_message(error: OSError) -> str:
    if error.errno == errno.EMFILE:
        return f"{error.strerror}: raise the limit of this shell, such as by ulimit -n 1024"
    if error.filename:
        return f"{error.filename}: {error.strerror}"
    return f"cannot print: {error.strerror}" if error.errno == errno.ENOSPC else str(error)


def _open_streams() -> None:
    """Open stdin, stdout and stderr that are closed, as by `maquette … >&-`: otherwise a file takes their number."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w" if number else "r", encoding="utf-8"))  # noqa: SIM115 (for as long as the process)


def main() -> None:
    """The `maquette` command. Exits by os._exit, because a regular exit of the interpreter takes 1/6 s."""
    start_time.begin()
    _open_streams()
    if why := memory.refused_limits():
        sys.exit(f"error: {why}")
    shared.raise_gc_threshold()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="surrogateescape")  # file names are bytes, and not always UTF-8
    try:
        cli(prog_name="maquette")
    except SystemExit as stop:
        if stop.code is not None and not isinstance(stop.code, int):
            raise
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError, ValueError):
                stream.flush()
        os._exit(stop.code or 0)
